//! Every cycle to a file, without the cycle waiting for it.
//!
//! The cycle thread holds a [`Tap`]: one `try_send` of a fixed-size entry after the correction has been sent. A thread
//! of its own ([`writer`]) polls the queue, packs, writes and syncs; a slow or full disk makes the queue run full, and
//! then entries are dropped and counted. [`disk`] is the file system: names, sizes, what to delete.
//!
//! The format is [`volcomp_protocol::record`]; `docs/reference/recording.md` has it byte by byte.

mod disk;
mod health;
mod model_texts;
mod writer;

use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, bounded};
use tracing::{info, warn};

use super::clock::Clock;
use super::load::Loaded;
use super::models::Prepared;
use super::status::RecordingStatus;
use volcomp_config::RecordingConfig;
use volcomp_engine::fault;
use volcomp_engine::{Command, CycleOutput, Event};
use volcomp_protocol::Correction;
use volcomp_protocol::record::{Answer, Change, Context, Entry, Request, request};
use volcomp_units::MonoTime;
use volcomp_units::axes::AxisArray;

use disk::{Description, Folder};
pub(super) use health::HealthSlot;
pub use model_texts::ModelTexts;
use writer::{Limits, Writer};

/// Entries in flight: four seconds at 4 kHz.
const QUEUE: usize = 16_384;
/// Pause between two looks into the queue; a sleeping receiver would make the cycle wake it.
const POLL: Duration = Duration::from_millis(10);
/// Time for the last blocks to reach the disk when the daemon ends.
const FINISH_LIMIT: Duration = Duration::from_secs(3);

/// The cycle's end of the recording.
#[derive(Debug, Clone)]
pub struct Tap {
    sender: Sender<Entry>,
    stats: Arc<Stats>,
    models: Arc<ModelTexts>,
    context: Context,
    /// Entries dropped since the last one that found a place.
    lost: u64,
}

/// What the recording has done, for the status. Numbers are relaxed: they inform, nothing depends on them.
#[derive(Debug, Default)]
pub(super) struct Stats {
    /// Entries safe on the disk.
    pub(super) records: AtomicU64,
    /// Entries that found the queue or the disk full.
    pub(super) dropped: AtomicU64,
    /// Bytes written.
    pub(super) bytes: AtomicU64,
    /// Name of the file being written, and what is wrong at the moment.
    words: Mutex<Words>,
}

#[derive(Debug, Default)]
struct Words {
    file: Option<String>,
    error: Option<String>,
}

impl Stats {
    pub(super) fn set_file(&self, file: Option<String>) {
        self.words.lock().unwrap_or_else(PoisonError::into_inner).file = file;
    }

    pub(super) fn set_error(&self, error: Option<String>) {
        self.words.lock().unwrap_or_else(PoisonError::into_inner).error = error;
    }

    /// For the status.
    pub(super) fn status(&self) -> RecordingStatus {
        let words = self.words.lock().unwrap_or_else(PoisonError::into_inner);
        RecordingStatus {
            file: words.file.clone(),
            records: self.records.load(Relaxed),
            records_dropped: self.dropped.load(Relaxed),
            bytes: self.bytes.load(Relaxed),
            error: words.error.clone(),
        }
    }
}

/// Both ends of a queue for entries.
#[must_use]
pub fn tap(capacity: usize) -> (Tap, Receiver<Entry>) {
    let (sender, receiver) = bounded(capacity);
    let (stats, models) = (Arc::default(), Arc::default());
    (Tap { sender, stats, models, context: Context::default(), lost: 0 }, receiver)
}

impl Tap {
    /// Where models are announced before the engine goes on with them.
    #[must_use]
    pub const fn models(&self) -> &Arc<ModelTexts> {
        &self.models
    }

    /// Passes an entry on, or drops and counts it; the first one after a loss is preceded by a word about it.
    ///
    /// # Cycle   no allocation, no wait, no panic
    pub fn send(&mut self, entry: &Entry) {
        if self.lost > 0 {
            let gap = Entry::Gap { now: entry.now(), dropped: self.lost, context: self.context };
            if self.sender.try_send(gap).is_ok() {
                self.lost = 0;
            }
        }
        self.context.follow(entry);
        if self.lost > 0 || self.sender.try_send(*entry).is_err() {
            self.lost += 1;
            // the cycle thread is the only writer of what the queue has cost
            self.stats.dropped.fetch_add(1, Relaxed);
        }
    }
}

/// The code under which a command is recorded.
#[must_use]
pub const fn request_of(command: Command) -> Request {
    let (code, value) = match command {
        Command::Enable => (request::ENABLE, 0.0),
        Command::Disable => (request::DISABLE, 0.0),
        Command::SetGain(gain) => (request::SET_GAIN, gain),
        Command::Stop => (request::STOP, 0.0),
        Command::ClearFault => (request::CLEAR_FAULT, 0.0),
        Command::KeepFault => (request::KEEP_FAULT, 0.0),
    };
    Request { code, value }
}

/// The command of a code; `None` where this version does not know it.
#[must_use]
pub const fn command_of(request: Request) -> Option<Command> {
    Some(match request.code {
        request::ENABLE => Command::Enable,
        request::DISABLE => Command::Disable,
        request::SET_GAIN => Command::SetGain(request.value),
        request::STOP => Command::Stop,
        request::CLEAR_FAULT => Command::ClearFault,
        request::KEEP_FAULT => Command::KeepFault,
        _ => return None,
    })
}

/// An answer as it is recorded: the offset as it was sent, and what was wanted in the same units.
#[must_use]
pub fn answer_of(correction: &Correction, output: &CycleOutput, wanted: AxisArray) -> Answer {
    Answer {
        sequence: correction.sequence,
        state: correction.state,
        limited: correction.limited,
        warning: output.warning,
        out_of_range: output.out_of_range,
        faded: output.faded,
        lag_cycles: output.lag_cycles.map_or(0, |cycles| u8::try_from(cycles).unwrap_or(u8::MAX)),
        stopped: output.stopped,
        offset: correction.offset,
        wanted,
        change: output.event.map(change_of),
    }
}

const fn change_of(event: Event) -> Change {
    let Event::StateChanged { from, reason, .. } = event;
    Change { from, cause: fault::reason_code(reason).0 }
}

/// The recorder's thread, seen from the service.
#[derive(Debug)]
pub(super) struct Recorder {
    stop: Arc<AtomicBool>,
    ended: Receiver<()>,
    pub(super) stats: Arc<Stats>,
    /// Where models are announced before the cycle thread is asked to go on with them.
    pub(super) models: Arc<ModelTexts>,
}

impl Recorder {
    /// Starts to record where the machine file asks for it. A folder that is missing or full is tried again later.
    pub(super) fn start(
        config_path: &Path,
        loaded: &Loaded,
        model: &Prepared,
        health: Arc<HealthSlot>,
        clock: Clock,
    ) -> io::Result<Option<(Tap, Self)>> {
        let config = &loaded.config.recording;
        let Some(directory) = &config.directory else { return Ok(None) };
        let directory = config_path.with_file_name(directory);
        info!(directory = %directory.display(), "recording");
        let (tap, receiver) = tap(QUEUE);
        let description = Description::new(config_path, loaded, model);
        let folder = Folder::new(directory, description, Arc::clone(&tap.models), config, clock);
        let (stats, models) = (Arc::clone(&tap.stats), Arc::clone(&tap.models));
        let stop = Arc::new(AtomicBool::new(false));
        let (end, ended) = bounded::<()>(1);
        let writer = Writer::new(folder, limits(config), Arc::clone(&stats));
        let stop_seen = Arc::clone(&stop);
        std::thread::Builder::new().name("volcomp-record".to_owned()).spawn(move || {
            // dropped on return and on panic alike
            let _end = end;
            run(&receiver, &health, writer, &stop_seen, || clock.now());
        })?;
        Ok(Some((tap, Self { stop, ended, stats, models })))
    }

    /// Writes what is left and closes the file; gives up where the disk does not answer.
    pub(super) fn finish(&self) {
        self.stop.store(true, Relaxed);
        if let Err(crossbeam_channel::RecvTimeoutError::Timeout) = self.ended.recv_timeout(FINISH_LIMIT) {
            warn!("the disk does not take the last records within {} s", FINISH_LIMIT.as_secs());
        }
    }
}

fn limits(config: &RecordingConfig) -> Limits {
    Limits { flush_s: config.flush_s, file_bytes: config.file_bytes, file_s: config.file_s }
}

/// The recorder's life: until it is asked to stop, and then once more for what is left.
fn run<D: writer::Disk>(
    entries: &Receiver<Entry>,
    health: &HealthSlot,
    mut writer: Writer<D>,
    stop: &AtomicBool,
    now: impl Fn() -> MonoTime,
) {
    loop {
        let last = stop.load(Relaxed);
        while let Ok(entry) = entries.try_recv() {
            writer.take(&entry, now());
        }
        if let Some((at, text)) = health.take() {
            writer.note_health(at, &text);
        }
        writer.tick(now());
        if last {
            writer.finish(now());
            return;
        }
        std::thread::sleep(POLL);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_protocol::record::LIVE_MAX;

    fn value(k: i64) -> Entry {
        Entry::Live { now: MonoTime::from_ns(k), told: 1, values: [0.0; LIVE_MAX] }
    }

    #[test]
    fn a_full_queue_drops_counts_and_says_so_when_there_is_room() {
        let (mut tap, receiver) = tap(8);
        tap.send(&Entry::Request { now: MonoTime::ZERO, request: request_of(Command::Enable) });
        // a reader that is stuck for ever costs nothing but the records: the loop ends
        for k in 0..100_000 {
            tap.send(&value(k));
        }
        let dropped = 100_000 - 7;
        assert_eq!(tap.stats.dropped.load(Relaxed), dropped);
        while receiver.try_recv().is_ok() {}
        tap.send(&value(-1));
        let Ok(Entry::Gap { dropped: told, context, .. }) = receiver.try_recv() else {
            panic!("a gap first")
        };
        assert_eq!(told, dropped);
        assert!(context.enabled);
        assert_eq!(receiver.try_recv(), Ok(value(-1)));
    }

    #[test]
    fn every_command_survives_its_code() {
        for command in [
            Command::Enable,
            Command::Disable,
            Command::SetGain(0.25),
            Command::Stop,
            Command::ClearFault,
            Command::KeepFault,
        ] {
            assert_eq!(command_of(request_of(command)), Some(command));
        }
        assert_eq!(command_of(Request { code: 250, value: 0.0 }), None);
    }
}
