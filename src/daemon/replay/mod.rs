//! A recording through the same engine: does it give the same corrections, bit for bit?
//!
//! The engine is [`LinkSession`], as in the daemon, built from the machine file and the hello in the recording; every
//! input comes with the time it had. Where entries are missing the engine's inner state cannot be known. A new engine
//! is then told how things stand, and follows the recorded frames, with its own offsets as the read-back and the lag
//! that was measured then ([`own_offsets`]), until it has agreed with the recording for [`AGREEMENT`] cycles on end. Nothing
//! before that is compared, and that is said.

mod own_offsets;

use std::collections::BTreeMap;
use std::sync::Arc;

use super::link_session::{LinkSession, Reaction};
use super::recorder::command_of;
use volcomp_config::MachineConfig;
use volcomp_engine::fault;
use volcomp_engine::{Command, READ_BACK_CYCLES_MAX, State};
use volcomp_model::Model;
use volcomp_protocol::record::{Answer, Change, Context, Cycle, Entry, Item, LIVE_MAX};
use volcomp_protocol::{ControlHello, Correction, Message};
use volcomp_units::MonoTime;
use volcomp_units::axes::AxisName;

use own_offsets::OwnOffsets;

/// Cycles on end that must agree before an engine counts as caught up.
pub const AGREEMENT: u32 = 100;
/// Of these, those with the engine's own offsets as the read-back: then all that it compares a read-back with is what
/// was sent at the time, and the recorded read-back is as good.
const OWN_READ_BACK: u32 = READ_BACK_CYCLES_MAX as u32;
const _: () = assert!(OWN_READ_BACK < AGREEMENT);
/// Differences kept for the report.
const DIFFERENCES_MAX: usize = 100;

/// What a replay found.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Report {
    /// Entries read.
    pub records: u64,
    /// Cycles and deadlines among them.
    pub cycles: u64,
    /// Of these: compared with what was recorded.
    pub compared: u64,
    /// Of the compared: those that differ.
    pub differing: u64,
    /// The first of these.
    pub differences: Vec<Difference>,
    /// Largest difference of an offset, mm or deg.
    pub largest: f64,
    /// Where entries were missing.
    pub gaps: Vec<Gap>,
    /// Why the rest of a link could not be repeated.
    pub refused: Vec<(u64, String)>,
}

/// Missing entries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Gap {
    /// Number of the first entry after the gap.
    pub record: u64,
    /// How many are missing.
    pub dropped: u64,
    /// Cycles until the engine had caught up; `None` where it never did.
    pub caught_up: Option<u64>,
}

/// A cycle that came out otherwise.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// Number of the entry.
    pub record: u64,
    /// Sequence of the position frame; `None` for a deadline.
    pub sequence: Option<u32>,
    /// What differs: `offset`, `state`, `limited`, ..
    pub what: &'static str,
    /// The axis, where it is an offset.
    pub axis: Option<AxisName>,
    /// As recorded.
    pub recorded: String,
    /// As it comes out now.
    pub replayed: String,
}

/// How far the engine can be relied upon.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Trust {
    /// There is no engine yet, or none that could repeat what was recorded.
    None,
    /// It has had every input, or nothing tells it from one that has.
    Full,
    /// It has to agree first.
    CatchingUp { agreed: u32, cycles: u64 },
}

/// Runs entries through an engine.
#[derive(Debug)]
pub struct Replay {
    config: MachineConfig,
    /// The model of the beginning.
    first: Arc<Model>,
    /// The model in use.
    model: Arc<Model>,
    /// Models that the engine may go on with, by the hash of their files.
    models: BTreeMap<[u8; 32], Arc<Model>>,
    session: Option<LinkSession>,
    axes: Vec<AxisName>,
    trust: Trust,
    own: OwnOffsets,
    /// The lag when the engine had caught up. It may have seen less of the measurement than the one that was recorded,
    /// so the next change is taken over.
    lag_caught_up: Option<u8>,
    /// How things stand after a gap, until the next entry tells the time.
    resume: Option<Context>,
    report: Report,
}

impl Replay {
    /// A replay with these files.
    #[must_use]
    pub fn new(config: MachineConfig, model: Arc<Model>) -> Self {
        Self {
            config,
            first: Arc::clone(&model),
            model,
            models: BTreeMap::new(),
            session: None,
            axes: Vec::new(),
            trust: Trust::None,
            own: OwnOffsets::default(),
            lag_caught_up: None,
            resume: None,
            report: Report::default(),
        }
    }

    /// A model that the engine may go on with, by the hash of its file.
    pub fn add_model(&mut self, hash: [u8; 32], model: Arc<Model>) {
        self.models.insert(hash, model);
    }

    /// The next item of the recording.
    pub fn feed(&mut self, item: &Item) {
        match item {
            Item::Entry { record, entry } => {
                self.report.records += 1;
                if let Some(context) = self.resume.take() {
                    self.catch_up(*record, entry.now(), &context);
                }
                self.entry(*record, entry);
            }
            Item::Gap { record, dropped, context } => {
                self.report.gaps.push(Gap { record: *record, dropped: *dropped, caught_up: None });
                self.session = None;
                self.trust = Trust::None;
                self.resume = Some(*context);
            }
            Item::Unknown { record, tag } => {
                self.report.records += 1;
                if *tag >= 128 {
                    self.refuse(*record, format!("an input of kind {tag} that this version does not know"));
                }
            }
        }
    }

    /// What was found.
    #[must_use]
    pub fn finish(self) -> Report {
        self.report
    }

    fn refuse(&mut self, record: u64, why: String) {
        self.session = None;
        self.trust = Trust::None;
        self.report.refused.push((record, why));
    }

    /// A new engine for a control.
    fn build(&mut self, record: u64, hello: &ControlHello) {
        let engine = self.config.engine_config(hello).map_err(|e| e.to_string());
        let session = engine
            .and_then(|engine| LinkSession::new(&engine, Arc::clone(&self.model)).map_err(|e| e.to_string()));
        match session {
            Ok(mut session) => {
                if let Some(before) = &self.session {
                    session.succeed(before);
                }
                self.axes = hello.used_axes().iter().map(|axis| axis.name).collect();
                self.session = Some(session);
            }
            Err(why) => self.refuse(record, why),
        }
    }

    /// A new engine in the middle of things.
    fn catch_up(&mut self, record: u64, now: MonoTime, context: &Context) {
        let Some(hello) = &context.hello else { return };
        self.model = match context.model {
            None => Arc::clone(&self.first),
            Some(hash) => match self.known(&hash) {
                Ok(model) => model,
                Err(why) => return self.refuse(record, why),
            },
        };
        self.build(record, hello);
        let Some(session) = &mut self.session else { return };
        if let Some(gain) = context.gain {
            session.command(now, Command::SetGain(gain));
        }
        if context.enabled {
            session.command(now, Command::Enable);
        }
        if context.link {
            session.link_up(now);
        }
        if let Some(tool) = context.tool {
            let _ = session.handle(now, &Message::Tool(tool));
        }
        self.trust = Trust::CatchingUp { agreed: 0, cycles: 0 };
        self.own.clear();
        self.lag_caught_up = None;
    }

    fn known(&self, hash: &[u8; 32]) -> Result<Arc<Model>, String> {
        self.models.get(hash).cloned().ok_or_else(|| {
            let hash = blake3::Hash::from(*hash).to_hex();
            format!("a model that is in none of the files (blake3 {hash})")
        })
    }

    fn switch(&mut self, record: u64, now: MonoTime, hash: [u8; 32]) {
        let switched = self.known(&hash).and_then(|model| {
            self.model = Arc::clone(&model);
            let Some(session) = &mut self.session else { return Ok(()) };
            session.switch_model(now, model, hash).map(drop).map_err(|e| e.to_string())
        });
        if let Err(why) = switched {
            self.refuse(record, why);
        }
    }

    fn entry(&mut self, record: u64, entry: &Entry) {
        if let Entry::Engine { hello, .. } = entry {
            self.build(record, hello);
            self.trust = if self.session.is_some() { Trust::Full } else { Trust::None };
            self.lag_caught_up = None;
            return;
        }
        if let Entry::Model { now, hash } = entry {
            // without an engine, too: the next one uses it
            return self.switch(record, *now, *hash);
        }
        if matches!(entry, Entry::Cycle(_) | Entry::Deadline { .. }) {
            self.report.cycles += 1;
        }
        let Some(session) = &mut self.session else { return };
        match entry {
            Entry::Cycle(cycle) => self.cycle(record, cycle),
            Entry::Deadline { now, answer, .. } => {
                let correction = session.deadline(*now);
                self.judge(record, None, answer.as_ref(), correction.as_ref());
            }
            Entry::Tool { now, tool } => {
                let _ = session.handle(*now, &Message::Tool(*tool));
            }
            Entry::Request { now, request } => match command_of(*request) {
                Some(command) => session.command(*now, command),
                None => {
                    let why =
                        format!("a command with the code {} that this version does not know", request.code);
                    self.refuse(record, why);
                }
            },
            Entry::LinkUp { now } => {
                session.link_up(*now);
                // measured anew, and every cycle of it is seen
                self.lag_caught_up = None;
            }
            Entry::LinkDown { now } => session.link_down(*now),
            Entry::Live { now, told, values } => {
                for (channel, value) in values.iter().enumerate().take(LIVE_MAX) {
                    if told >> channel & 1 == 1 {
                        session.live(*now, channel, *value);
                    }
                }
            }
            Entry::Engine { .. } | Entry::Model { .. } | Entry::Gap { .. } => {}
        }
    }

    fn cycle(&mut self, record: u64, cycle: &Cycle) {
        let Some(session) = &mut self.session else { return };
        let recorded_lag = cycle.answer.map(|answer| answer.lag_cycles);
        let mut frame = cycle.frame;
        match (self.trust, recorded_lag) {
            (Trust::CatchingUp { agreed, .. }, _) if agreed < OWN_READ_BACK => {
                let lag = recorded_lag.unwrap_or_default();
                frame = self.own.read_back(&frame, lag.into());
                session.assume_lag(measured(lag));
            }
            (_, Some(lag)) if self.lag_caught_up.is_some_and(|known| known != lag) => {
                session.assume_lag(measured(lag));
                self.lag_caught_up = None;
            }
            _ => {}
        }
        let correction = match session.handle(cycle.now, &Message::Position(frame)) {
            Reaction::Answer(correction) => Some(correction),
            _ => None,
        };
        self.judge(record, Some(cycle.frame.sequence), cycle.answer.as_ref(), correction.as_ref());
    }

    /// Compares, or counts how long it has agreed.
    fn judge(
        &mut self,
        record: u64,
        sequence: Option<u32>,
        recorded: Option<&Answer>,
        correction: Option<&Correction>,
    ) {
        let replayed = correction.and_then(|_| self.session.as_ref()?.recorded());
        let place = Place { record, sequence, axes: &self.axes };
        let found = place.differences(recorded, replayed.as_ref());
        match &mut self.trust {
            Trust::None => {}
            Trust::Full => {
                self.report.compared += 1;
                if found.is_empty() {
                    return;
                }
                self.report.differing += 1;
                if let Some((a, b)) = recorded.zip(replayed.as_ref()) {
                    self.report.largest = a
                        .offset
                        .iter()
                        .zip(&b.offset)
                        .map(|(a, b)| (a - b).abs())
                        .fold(self.report.largest, f64::max);
                }
                let room = DIFFERENCES_MAX.saturating_sub(self.report.differences.len());
                self.report.differences.extend(found.into_iter().take(room));
            }
            Trust::CatchingUp { agreed, cycles } => {
                if let Some(correction) = correction {
                    self.own.sent(correction.sequence, correction.offset);
                }
                *cycles += 1;
                *agreed = if found.is_empty() && recorded.is_some() { *agreed + 1 } else { 0 };
                if *agreed >= AGREEMENT {
                    if let Some(gap) = self.report.gaps.last_mut() {
                        gap.caught_up = Some(*cycles);
                    }
                    self.lag_caught_up = recorded.map(|answer| answer.lag_cycles);
                    self.trust = Trust::Full;
                }
            }
        }
    }
}

/// A recorded lag as the engine has it.
fn measured(recorded: u8) -> Option<u32> {
    (recorded > 0).then_some(recorded.into())
}

/// A change of state in words.
fn cause(change: Option<Change>) -> String {
    change.map_or_else(|| "none".to_owned(), |c| format!("from {:?} by {}", c.from, fault::Code(c.cause)))
}

/// Where two answers are compared.
struct Place<'a> {
    record: u64,
    sequence: Option<u32>,
    axes: &'a [AxisName],
}

impl Place<'_> {
    fn differences(&self, recorded: Option<&Answer>, replayed: Option<&Answer>) -> Vec<Difference> {
        let mut found = Vec::new();
        let mut differs = |what, axis, recorded: String, replayed: String| {
            found.push(Difference {
                record: self.record,
                sequence: self.sequence,
                what,
                axis,
                recorded,
                replayed,
            });
        };
        let (a, b) = match (recorded, replayed) {
            (Some(a), Some(b)) => (a, b),
            (None, None) => return found,
            (a, b) => {
                let word = |given: bool| if given { "an answer" } else { "none" }.to_owned();
                differs("answer", None, word(a.is_some()), word(b.is_some()));
                return found;
            }
        };
        for (what, a, b) in [("offset", &a.offset, &b.offset), ("wanted", &a.wanted, &b.wanted)] {
            for (k, (a, b)) in a.iter().zip(b).enumerate() {
                if a.to_bits() != b.to_bits() {
                    // the shortest text that reads back as the same number
                    differs(what, self.axes.get(k).copied(), format!("{a:?}"), format!("{b:?}"));
                }
            }
        }
        let state = |state: State| format!("{state:?}");
        if a.state != b.state {
            differs("state", None, state(a.state), state(b.state));
        }
        if a.change != b.change {
            differs("change", None, cause(a.change), cause(b.change));
        }
        if a.lag_cycles != b.lag_cycles {
            differs("lag-cycles", None, a.lag_cycles.to_string(), b.lag_cycles.to_string());
        }
        for (what, a, b) in [
            ("limited", a.limited, b.limited),
            ("warning", a.warning, b.warning),
            ("out-of-range", a.out_of_range, b.out_of_range),
            ("faded", a.faded, b.faded),
            ("stopped", a.stopped.into(), b.stopped.into()),
        ] {
            if a != b {
                differs(what, None, format!("{a:#010b}"), format!("{b:#010b}"));
            }
        }
        if a.sequence != b.sequence {
            differs("sequence", None, a.sequence.to_string(), b.sequence.to_string());
        }
        found
    }
}

#[cfg(test)]
mod tests;
