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

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::core::axes::MAX_AXES;
    use crate::core::protocol::{Axis, AxisUnit, Name, PROTOCOL_VERSION, Tool};
    use crate::core::record::Request;
    use crate::runtime::{Loaded, load, tap};

    const CYCLE_NS: i64 = 1_000_000;

    fn loaded() -> Loaded {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/examples/vmc-850/machine.toml");
        load(&file).expect("the example loads")
    }

    fn hello(loaded: &Loaded) -> ControlHello {
        let axes = &loaded.config.axes;
        let axis = |k: usize| Axis { name: axes[k.min(axes.len() - 1)].name, unit: AxisUnit::Millimetre };
        ControlHello {
            version: PROTOCOL_VERSION,
            machine: Name::new(&loaded.config.machine),
            software: Name::new("test"),
            cycle_ns: CYCLE_NS.unsigned_abs(),
            axis_count: u8::try_from(axes.len()).expect("few"),
            axes: std::array::from_fn(axis),
        }
    }

    /// A link with everything that the engine can be told, as items.
    fn record(loaded: &Loaded, cycles: u32) -> Vec<Item> {
        let hello = hello(loaded);
        let engine = loaded.config.engine_config(&hello).expect("fits");
        let mut body = CycleBody::new(&engine, Arc::clone(&loaded.model)).expect("an engine");
        let (tap, entries) = tap(4 * cycles as usize);
        body.record_to(tap, MonoTime::ZERO, &hello);
        body.link_up(MonoTime::ZERO);
        body.command(MonoTime::ZERO, Command::Enable);
        let mut applied = [0.0; MAX_AXES];
        for cycle in 1..=cycles {
            let mut now = MonoTime::from_ns(i64::from(cycle) * CYCLE_NS + i64::from(cycle % 17) * 1000);
            let phase = f64::from(cycle) * 1e-3;
            let mut commanded = [0.0; MAX_AXES];
            commanded[0] = 200.0 + 150.0 * phase.sin();
            commanded[1] = 200.0 + 150.0 * (0.7 * phase).sin();
            commanded[2] = -250.0 + 150.0 * (0.3 * phase).sin();
            let mut bits = MachineState::HOMED | MachineState::ENABLED;
            match cycle {
                7_000..7_050 => bits |= MachineState::ESTOP,
                11_000 => commanded[0] = f64::NAN,
                14_000 => body.command(now, Command::SetGain(0.5)),
                16_000 => {
                    let tool = Tool { number: 2, tip: [0.0, 0.0, -80.0] };
                    let _ = body.handle(now, &Message::Tool(tool));
                }
                18_000 => {
                    for _ in 0..30 {
                        now = body.next_deadline().map_or(now, |due| due.max(now));
                        if let Some(correction) = body.deadline(now) {
                            applied = correction.offset;
                        }
                    }
                }
                20_000 => {
                    body.link_down(now);
                    body.link_up(now);
                }
                _ => {}
            }
            let frame = Position {
                sequence: cycle,
                control_ns: i64::from(cycle) * CYCLE_NS,
                state: MachineState::from_bits(bits),
                feed_mm_per_min: 9000.0,
                commanded,
                actual: std::array::from_fn(|k| commanded[k] + applied[k]),
                applied,
            };
            if let Reaction::Answer(correction) = body.handle(now, &Message::Position(frame)) {
                applied = correction.offset;
            }
            body.tell();
        }
        drop(body);
        (0..).zip(entries.try_iter()).map(|(record, entry)| Item::Entry { record, entry }).collect()
    }

    fn replay(loaded: &Loaded, items: &[Item]) -> Report {
        let mut replay = Replay::new(loaded.config.clone(), Arc::clone(&loaded.model));
        items.iter().for_each(|item| replay.feed(item));
        replay.finish()
    }

    /// The same with the items from `from` to `to` missing.
    fn with_gap(items: &[Item], from: usize, to: usize) -> Vec<Item> {
        let mut context = Context::default();
        for item in &items[..to] {
            if let Item::Entry { entry, .. } = item {
                context.follow(entry);
            }
        }
        let gap = Item::Gap { record: to as u64, dropped: (to - from) as u64, context };
        [&items[..from], &[gap], &items[to..]].concat()
    }

    #[test]
    fn the_same_inputs_give_the_same_corrections_bit_for_bit() {
        let loaded = loaded();
        let items = record(&loaded, 24_000);
        let report = replay(&loaded, &items);
        assert_eq!((report.differing, report.differences.len()), (0, 0), "{:?}", report.differences);
        assert!(report.compared > 24_000 && report.compared == report.cycles, "{}", report.compared);
        assert!(report.gaps.is_empty() && report.refused.is_empty());
    }

    #[test]
    fn the_last_bit_of_one_offset_is_found_with_its_place_and_both_values() {
        let loaded = loaded();
        let mut items = record(&loaded, 6_000);
        let Some(Item::Entry { entry: Entry::Cycle(cycle), .. }) = items.get_mut(5_000) else {
            panic!("a cycle")
        };
        let sequence = cycle.frame.sequence;
        let answer = cycle.answer.as_mut().expect("answered");
        let before = answer.offset[1];
        assert!(before != 0.0);
        answer.offset[1] = f64::from_bits(before.to_bits() ^ 1);
        let forged = format!("{:?}", answer.offset[1]);
        let report = replay(&loaded, &items);
        assert_eq!(report.differing, 1);
        let expected = Difference {
            record: 5_000,
            sequence: Some(sequence),
            what: "offset",
            axis: Some(AxisName::Y),
            recorded: forged,
            replayed: format!("{before:?}"),
        };
        assert_eq!(report.differences, [expected]);
        assert!(report.largest > 0.0 && report.largest < 1e-15);
    }

    #[test]
    fn another_model_is_not_the_same() {
        let loaded = loaded();
        let items = record(&loaded, 6_000);
        let mut spec = crate::config::model::parse("other", &loaded.model_text).expect("valid");
        spec.errors.clear();
        let model = Arc::new(Model::new(&spec).expect("a model without errors"));
        let mut replay = Replay::new(loaded.config, model);
        items.iter().for_each(|item| replay.feed(item));
        assert!(replay.finish().differing > 1000);
    }

    #[test]
    fn after_a_gap_the_engine_catches_up_and_then_agrees_bit_for_bit() {
        let loaded = loaded();
        let items = record(&loaded, 24_000);
        // in the middle of steady work; over the change of gain; over the e-stop; over the new link
        for (from, to) in [(4_000, 4_500), (13_900, 14_500), (6_990, 7_100), (19_900, 20_200)] {
            let report = replay(&loaded, &with_gap(&items, from, to));
            assert_eq!(report.differing, 0, "gap {from}..{to}: {:?}", report.differences);
            let [gap] = report.gaps[..] else { panic!("{:?}", report.gaps) };
            assert_eq!(gap.dropped, (to - from) as u64);
            let cycles = gap.caught_up.expect("caught up");
            assert!(cycles < 5_000, "gap {from}..{to}: {cycles} cycles");
            let lost = report.cycles - report.compared;
            assert_eq!(lost, cycles, "all else is compared");
        }
    }

    #[test]
    fn what_cannot_be_repeated_is_said_and_not_compared() {
        let loaded = loaded();
        let mut items = record(&loaded, 2_000);
        let now = MonoTime::from_ns(1);
        let request = Request { code: 99, value: 0.0 };
        items.insert(1_000, Item::Entry { record: 1_000, entry: Entry::Request { now, request } });
        let report = replay(&loaded, &items);
        assert_eq!((report.differing, report.refused.len()), (0, 1));
        assert!(report.refused[0].1.contains("code 99"), "{:?}", report.refused);
        assert!(report.compared < 1_000);
        items[1_000] = Item::Unknown { record: 1_000, tag: 201 };
        assert!(replay(&loaded, &items).refused[0].1.contains("kind 201"));
        items[1_000] = Item::Unknown { record: 1_000, tag: 20 };
        let report = replay(&loaded, &items);
        assert_eq!((report.refused.len(), report.compared), (0, 2_000));
    }
}
