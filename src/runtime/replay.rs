//! A recording through the same engine: does it give the same corrections, bit for bit?
//!
//! The engine is [`CycleBody`], as in the daemon, built from the machine file and the hello in the recording; every
//! input comes with the time it had. Where entries are missing the engine's inner state cannot be known. A new engine
//! is then told how things stand, and follows the recorded frames, with its own offset as the read-back, until it has
//! agreed with the recording for [`AGREEMENT`] cycles on end. Nothing before that is compared, and that is said.

use std::sync::Arc;

use super::body::{CycleBody, Reaction};
use super::recorder::{answer_of, command_of};
use crate::config::MachineConfig;
use crate::core::axes::{AxisArray, AxisName};
use crate::core::engine::{Command, State};
use crate::core::model::Model;
use crate::core::protocol::{ControlHello, Correction, MachineState, Message, Position};
use crate::core::record::{Answer, Context, Cycle, Entry, Item};
use crate::core::units::MonoTime;

/// Cycles on end that must agree before an engine counts as caught up; more than the read-back is watched for.
pub const AGREEMENT: u32 = 100;
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
    /// It has had every input.
    Full,
    /// It has to agree first.
    CatchingUp { agreed: u32, cycles: u64 },
}

/// Runs entries through an engine.
#[derive(Debug)]
pub struct Replay {
    config: MachineConfig,
    model: Arc<Model>,
    body: Option<CycleBody>,
    axes: Vec<AxisName>,
    trust: Trust,
    /// How things stand after a gap, until the next entry tells the time.
    resume: Option<Context>,
    report: Report,
}

impl Replay {
    /// A replay with these files.
    #[must_use]
    pub const fn new(config: MachineConfig, model: Arc<Model>) -> Self {
        let report = Report {
            records: 0,
            cycles: 0,
            compared: 0,
            differing: 0,
            differences: Vec::new(),
            largest: 0.0,
            gaps: Vec::new(),
            refused: Vec::new(),
        };
        Self { config, model, body: None, axes: Vec::new(), trust: Trust::None, resume: None, report }
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
                self.body = None;
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
        self.body = None;
        self.trust = Trust::None;
        self.report.refused.push((record, why));
    }

    /// A new engine for a control.
    fn build(&mut self, record: u64, hello: &ControlHello) {
        let engine = self.config.engine_config(hello).map_err(|e| e.to_string());
        let body = engine
            .and_then(|engine| CycleBody::new(&engine, Arc::clone(&self.model)).map_err(|e| e.to_string()));
        match body {
            Ok(body) => {
                self.axes = hello.used_axes().iter().map(|axis| axis.name).collect();
                self.body = Some(body);
            }
            Err(why) => self.refuse(record, why),
        }
    }

    /// A new engine in the middle of things.
    fn catch_up(&mut self, record: u64, now: MonoTime, context: &Context) {
        let Some(hello) = &context.hello else { return };
        self.build(record, hello);
        let Some(body) = &mut self.body else { return };
        if let Some(gain) = context.gain {
            body.command(now, Command::SetGain(gain));
        }
        if context.enabled {
            body.command(now, Command::Enable);
        }
        if context.link {
            body.link_up(now);
        }
        if let Some(tool) = context.tool {
            let _ = body.handle(now, &Message::Tool(tool));
        }
        self.trust = Trust::CatchingUp { agreed: 0, cycles: 0 };
    }

    fn entry(&mut self, record: u64, entry: &Entry) {
        if let Entry::Engine { hello, .. } = entry {
            self.build(record, hello);
            self.trust = if self.body.is_some() { Trust::Full } else { Trust::None };
            return;
        }
        if matches!(entry, Entry::Cycle(_) | Entry::Deadline { .. }) {
            self.report.cycles += 1;
        }
        let Some(body) = &mut self.body else { return };
        match entry {
            Entry::Cycle(cycle) => self.cycle(record, cycle),
            Entry::Deadline { now, answer, .. } => {
                let correction = body.deadline(*now);
                self.judge(record, None, answer.as_ref(), correction.as_ref());
            }
            Entry::Tool { now, tool } => {
                let _ = body.handle(*now, &Message::Tool(*tool));
            }
            Entry::Request { now, request } => match command_of(*request) {
                Some(command) => body.command(*now, command),
                None => {
                    let why =
                        format!("a command with the code {} that this version does not know", request.code);
                    self.refuse(record, why);
                }
            },
            Entry::LinkUp { now } => body.link_up(*now),
            Entry::LinkDown { now } => body.link_down(*now),
            Entry::Model { .. } => {
                self.refuse(
                    record,
                    "the engine went on with another model, which a replay does not follow".to_owned(),
                );
            }
            Entry::Engine { .. } | Entry::Gap { .. } | Entry::Value { .. } => {}
        }
    }

    fn cycle(&mut self, record: u64, cycle: &Cycle) {
        let Some(body) = &mut self.body else { return };
        let frame = match self.trust {
            Trust::CatchingUp { .. } => own_read_back(body, &cycle.frame),
            Trust::Full | Trust::None => cycle.frame,
        };
        let reaction = body.handle(cycle.now, &Message::Position(frame));
        let correction = match reaction {
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
        let output = self.body.as_ref().and_then(CycleBody::output);
        let replayed = correction.zip(output).map(|(c, o)| answer_of(c, o));
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
                *cycles += 1;
                *agreed = if found.is_empty() && recorded.is_some() { *agreed + 1 } else { 0 };
                if *agreed >= AGREEMENT {
                    if let Some(gap) = self.report.gaps.last_mut() {
                        gap.caught_up = Some(*cycles);
                    }
                    self.trust = Trust::Full;
                }
            }
        }
    }
}

/// The frame with the engine's own offset as the read-back: an engine that catches up is not the one that the control
/// listened to, and must not take that for a foreign writer.
fn own_read_back(body: &CycleBody, frame: &Position) -> Position {
    let took_over = frame.state.has(MachineState::OFFSET_RAMPING_OUT);
    let Some(sent) = body.sent().filter(|_| frame.state.is_ready() && !took_over) else { return *frame };
    let actual: AxisArray = core::array::from_fn(|k| frame.actual[k] - frame.applied[k] + sent[k]);
    Position { actual, applied: sent, ..*frame }
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
        for (k, (a, b)) in a.offset.iter().zip(&b.offset).enumerate() {
            if a.to_bits() != b.to_bits() {
                // the shortest text that reads back as the same number
                differs("offset", self.axes.get(k).copied(), format!("{a:?}"), format!("{b:?}"));
            }
        }
        let state = |state: State| format!("{state:?}");
        if a.state != b.state {
            differs("state", None, state(a.state), state(b.state));
        }
        for (what, a, b) in [
            ("limited", a.limited, b.limited),
            ("warning", a.warning, b.warning),
            ("out-of-range", a.out_of_range, b.out_of_range),
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
