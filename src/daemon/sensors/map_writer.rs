//! The thread that writes `live.json`: the newest text counts, older ones are superseded.
//!
//! A disk that hangs stops this thread and nobody else. Whoever must not answer before a text is durable asks
//! [`Saving::saved`] with its number.

use std::io;
use std::path::Path;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use volcomp_state::disk::{RealDisk, replace};

use super::checkpoint::FILE;
use crate::write_queue::Saved;

/// Time after which a disk that has not taken a text counts as one that does not answer.
const SLOW: Duration = Duration::from_secs(10);

#[derive(Debug, Default)]
struct Slot {
    /// The newest text that the thread has not taken.
    text: Option<Vec<u8>>,
    /// Number of the newest text handed over.
    asked: u64,
    /// Number of the newest text that is durable.
    saved: u64,
    /// Number of the newest text that the disk refused, and why.
    refused: (u64, String),
    /// Since when a text waits or is being written.
    since: Option<Instant>,
    /// Nothing more comes.
    end: bool,
    ended: bool,
}

impl Slot {
    fn saved(&self, number: u64) -> Saved {
        if self.saved >= number {
            Saved::Yes
        } else if self.refused.0 >= number {
            Saved::No(self.refused.1.clone())
        } else if self.ended {
            Saved::No("the thread that writes has ended".to_owned())
        } else {
            Saved::Waiting
        }
    }
}

#[derive(Debug, Default)]
struct Shared {
    slot: Mutex<Slot>,
    changed: Condvar,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Slot> {
        self.slot.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What becomes of the texts, for whoever waits for them.
#[derive(Debug, Clone)]
pub(crate) struct Saving(Arc<Shared>);

impl Saving {
    /// What has become of a text.
    pub(crate) fn saved(&self, number: u64) -> Saved {
        self.0.lock().saved(number)
    }
}

/// The thread, seen from the estimator.
#[derive(Debug)]
pub(super) struct Writer {
    shared: Arc<Shared>,
    thread: JoinHandle<()>,
}

impl Writer {
    /// Starts it.
    pub(super) fn start(directory: &Path) -> io::Result<Self> {
        let path = directory.join(FILE);
        let shared = Arc::new(Shared::default());
        let running = Running(Arc::clone(&shared));
        let thread = std::thread::Builder::new()
            .name("volcomp-keep".to_owned())
            .spawn(move || run(&running, &path))?;
        Ok(Self { shared, thread })
    }

    /// Who waits for a text asks here.
    pub(super) fn saving(&self) -> Saving {
        Saving(Arc::clone(&self.shared))
    }

    /// Hands a text over; gives its number. Never waits for the disk.
    pub(super) fn write(&self, text: Vec<u8>) -> u64 {
        let mut slot = self.shared.lock();
        slot.asked += 1;
        slot.text = Some(text);
        slot.since.get_or_insert_with(Instant::now);
        let number = slot.asked;
        drop(slot);
        self.shared.changed.notify_all();
        number
    }

    /// Waits until the disk has taken or refused the newest text, no longer than `limit`; false where it has not.
    pub(super) fn wait(&self, limit: Duration) -> bool {
        let slot = self.shared.lock();
        let number = slot.asked;
        let waits = |slot: &mut Slot| slot.saved(number) == Saved::Waiting;
        let waited = self.shared.changed.wait_timeout_while(slot, limit, waits);
        !waited.unwrap_or_else(PoisonError::into_inner).1.timed_out()
    }

    /// Why the newest text is not on the disk, where that is more than a moment's wait.
    pub(super) fn problem(&self) -> Option<String> {
        let slot = self.shared.lock();
        if slot.since.is_some_and(|since| since.elapsed() >= SLOW) {
            return Some(format!("{FILE}: the disk does not answer"));
        }
        (slot.refused.0 > slot.saved).then(|| slot.refused.1.clone())
    }

    /// Whether the file is older than what was handed over: nothing may be read back from it.
    pub(super) fn is_behind(&self) -> bool {
        let slot = self.shared.lock();
        slot.saved < slot.asked
    }

    /// The last text; then everything is written and the thread has ended.
    pub(super) fn finish(self, last: Option<Vec<u8>>) {
        if let Some(text) = last {
            self.write(text);
        }
        self.shared.lock().end = true;
        self.shared.changed.notify_all();
        let _ = self.thread.join();
    }
}

/// Says on return and on panic alike that the thread has ended.
struct Running(Arc<Shared>);

impl Drop for Running {
    fn drop(&mut self) {
        self.0.lock().ended = true;
        self.0.changed.notify_all();
    }
}

fn run(running: &Running, path: &Path) {
    let shared = &running.0;
    let mut slot = shared.lock();
    loop {
        if let Some(text) = slot.text.take() {
            let number = slot.asked;
            drop(slot);
            let why = replace(&RealDisk, path, &text).err();
            slot = shared.lock();
            match why {
                None => slot.saved = number,
                Some(e) => slot.refused = (number, format!("{}: {e}", path.display())),
            }
            slot.since = slot.text.is_some().then(Instant::now);
            shared.changed.notify_all();
        } else if slot.end {
            return;
        } else {
            slot = shared.changed.wait(slot).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    const LIMIT: Duration = Duration::from_secs(10);

    #[test]
    fn a_disk_that_refuses_is_reported_until_it_takes_a_text_again() {
        let folder = tempfile::tempdir().unwrap();
        let directory = folder.path().join("state");
        let writer = Writer::start(&directory).unwrap();
        let saving = writer.saving();
        let first = writer.write(b"{}".to_vec());
        assert!(writer.wait(LIMIT));
        assert!(writer.problem().unwrap().contains(FILE) && writer.is_behind());
        assert!(matches!(saving.saved(first), Saved::No(why) if why.contains(FILE)));
        fs::create_dir(&directory).unwrap();
        let second = writer.write(b"{}".to_vec());
        assert_eq!((first, second), (1, 2));
        assert!(writer.wait(LIMIT));
        assert_eq!((writer.problem(), saving.saved(second)), (None, Saved::Yes));
        assert!(!writer.is_behind());
        // what came after it is on the disk
        assert_eq!(saving.saved(first), Saved::Yes);
        writer.finish(Some(b"{\"last\":1}".to_vec()));
        assert_eq!(fs::read(directory.join(FILE)).unwrap(), b"{\"last\":1}");
        assert!(matches!(saving.saved(9), Saved::No(_)), "nobody writes any more");
    }

    #[test]
    fn a_disk_that_hangs_keeps_nobody_waiting_and_the_newest_text_comes_last() {
        let folder = tempfile::tempdir().unwrap();
        // a pipe that nobody reads, in the place of the temporary file
        let pipe = folder.path().join(format!("{FILE}.tmp"));
        rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR)
            .unwrap();
        let writer = Writer::start(folder.path()).unwrap();
        let saving = writer.saving();
        let numbers = [b"1", b"2", b"3"].map(|text| writer.write(text.to_vec()));
        assert_eq!(numbers, [1, 2, 3]);
        assert!(!writer.wait(Duration::from_millis(50)));
        assert_eq!(saving.saved(3), Saved::Waiting);
        // the pipe is read: the write goes on
        let read = fs::File::open(&pipe).unwrap();
        fs::remove_file(&pipe).unwrap();
        let _ = writer.wait(LIMIT);
        drop(read);
        writer.finish(Some(b"4".to_vec()));
        assert_eq!(fs::read(folder.path().join(FILE)).unwrap(), b"4");
    }
}
