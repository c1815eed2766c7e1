//! A control that behaves like a real one: applies answers some cycles later, holds and takes back when none come,
//! moves no offset without drives, and tells what it applies.

use std::collections::{BTreeSet, VecDeque};

use super::super::*;
use super::judge::{Circumstances, Judge};
use crate::transitions::Cause;
use volcomp_model::axes::AxisArray;

/// Cycles without an answer after which the control takes the offset back.
const HOLD_CYCLES: u32 = 100;
/// What it takes back per cycle, mm.
const TAKE_BACK_MM: f64 = 1e-4;
/// Cycles until the daemon has connected again.
const RECONNECT_CYCLES: u16 = 20;
/// The most control time that one answer may use, cycles.
const STEP_CYCLES: f64 = 2.0;
/// Nanoseconds of a cycle.
const CYCLE_NS: i64 = 1_000_000;

/// A change of state that was seen, and why.
pub(super) type Seen = (State, State, Cause);

/// What is wrong with a frame on its way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Damage {
    None,
    Lost,
    Nan,
    AppliedNan,
    Off(f64),
    /// Another number, once.
    Number(i32),
}

/// The control, the engine, and what is known of both.
pub(super) struct Plant {
    pub(super) engine: Compensator,
    pub(super) model: Model,
    pub(super) config: EngineConfig,
    pub(super) judge: Judge,
    pub(super) now: MonoTime,
    pub(super) frame: Position,
    /// The last frame as it was before anything happened to it on its way.
    pub(super) sent: Position,
    /// Another program writes this offset.
    pub(super) foreign: Option<f64>,
    /// Somebody has enabled it, or another program has written an offset.
    pub(super) ever_enabled: bool,
    /// The daemon stands still: not even its deadlines are met.
    pub(super) hangs: bool,
    pub(super) transitions: BTreeSet<Seen>,
    /// Cycles from a position to the use of its answer.
    delay: u32,
    cycle: u64,
    linked: bool,
    /// Links so far.
    pub(super) links: u32,
    answers: VecDeque<(u64, AxisArray)>,
    missing: u32,
    /// Cycles in which an offset may jump without the engine's doing.
    disturbed: u32,
    last_delivered: Option<Position>,
    /// Time of the last frame of this link that was all numbers.
    last_used_ns: Option<i64>,
    /// The state that a reader of the events knows.
    told: State,
}

impl Plant {
    pub(super) fn new(config: &EngineConfig, model: Model, delay: u32) -> Self {
        let mut engine = Compensator::new(config, &model).unwrap();
        engine.on_link_up(MonoTime::ZERO);
        let mut judge = Judge::new(config);
        judge.link_up();
        let mut frame = Position { state: READY, ..Position::default() };
        frame.commanded[0] = 100.0;
        Self {
            engine,
            model,
            config: config.clone(),
            judge,
            now: MonoTime::ZERO,
            frame,
            sent: frame,
            foreign: None,
            ever_enabled: false,
            hangs: false,
            transitions: BTreeSet::new(),
            delay,
            cycle: 0,
            linked: true,
            links: 1,
            answers: VecDeque::new(),
            missing: 0,
            disturbed: 0,
            last_delivered: None,
            last_used_ns: None,
            told: State::Off,
        }
    }

    /// One cycle of the control, its frame on the way damaged like this.
    pub(super) fn cycle(&mut self, damage: Damage) {
        self.now = self.now.plus_seconds(CYCLE_S);
        self.cycle += 1;
        self.frame.sequence = self.frame.sequence.wrapping_add(1);
        self.frame.control_ns += CYCLE_NS;
        self.apply();
        for k in 0..MAX_AXES {
            self.frame.actual[k] = self.frame.commanded[k] + self.frame.applied[k];
        }
        self.sent = self.frame;
        let mut sent = self.frame;
        match damage {
            Damage::None => {}
            Damage::Lost => {
                self.judge.doubt();
                if !self.hangs {
                    self.deadline();
                }
                return;
            }
            Damage::Nan => {
                sent.commanded[1] = f64::NAN;
                sent.actual[1] = f64::NAN;
            }
            Damage::AppliedNan => sent.applied[0] = f64::INFINITY,
            Damage::Off(mm) => {
                sent.commanded[0] += mm;
                sent.actual[0] += mm;
            }
            Damage::Number(by) => sent.sequence = sent.sequence.wrapping_add(by.cast_unsigned()),
        }
        if damage != Damage::None {
            self.judge.doubt();
        }
        self.deliver(&sent);
    }

    /// What the control does with the offset in a cycle.
    fn apply(&mut self) {
        let state = self.frame.state;
        let movable = state.has(MachineState::ENABLED) && !state.has(MachineState::ESTOP);
        let before = self.frame.applied;
        self.frame.state.bits &= !MachineState::OFFSET_RAMPING_OUT;
        self.missing += 1;
        if !movable {
            // what was on its way when the drives went off never acts
            self.missing = if self.answers.is_empty() { self.missing } else { 0 };
            self.answers.clear();
            let told = |last: Position| self.frame.sequence.wrapping_sub(last.sequence) <= 1;
            if !self.last_delivered.is_some_and(told) {
                // an engine that is not told goes on; what it has done then the control's own limiter takes up
                self.disturbed = self.disturbed.max(self.delay + 2);
            }
            return;
        }
        while let Some((due, offset)) = self.answers.front().copied() {
            self.missing = 0;
            if due > self.cycle {
                break;
            }
            self.frame.applied = offset;
            self.answers.pop_front();
        }
        if let Some(offset) = self.foreign {
            self.ever_enabled = true;
            self.frame.applied[..3].fill(offset);
            self.disturbed = self.delay + 2;
        } else if self.missing > HOLD_CYCLES {
            for v in &mut self.frame.applied {
                *v -= v.clamp(-TAKE_BACK_MM, TAKE_BACK_MM);
            }
            if self.frame.applied != [0.0; MAX_AXES] {
                self.frame.state.bits |= MachineState::OFFSET_RAMPING_OUT;
            }
        }
        self.check_machine(&before);
        self.disturbed = self.disturbed.saturating_sub(1);
    }

    /// The offset in force never steps, whatever the engine answered.
    fn check_machine(&self, before: &AxisArray) {
        if self.disturbed > 0 {
            return;
        }
        for (k, limits) in self.config.limits.iter().enumerate() {
            let step = (self.frame.applied[k] - before[k]).abs();
            let most = (limits.rate * STEP_CYCLES * CYCLE_S).min(limits.step).max(TAKE_BACK_MM);
            assert!(step <= most * 1.000_001 + 1e-12, "axis {k} stepped by {step} mm, at most {most}");
        }
    }

    /// A frame reaches the engine.
    pub(super) fn deliver(&mut self, frame: &Position) {
        if !self.linked {
            return;
        }
        let since_ns = |ns: i64| frame.control_ns.saturating_sub(ns);
        let since = self.last_delivered.map_or(0, |l| since_ns(l.control_ns));
        if self.last_delivered.is_some_and(|l| frame.sequence.wrapping_sub(l.sequence) != 1) {
            self.judge.doubt();
        }
        let stands = self.last_delivered.is_some_and(|l| l.commanded == frame.commanded);
        let stuck = stands && frame.state.has(MachineState::MOVING) && frame.feed_mm_per_min > 0.0;
        let far = |l: Position| (0..3).any(|k| (frame.commanded[k] - l.commanded[k]).abs() > 0.99);
        if stuck || self.last_delivered.is_some_and(far) || !(0..=2 * CYCLE_NS).contains(&since) {
            self.judge.doubt();
        }
        let from = self.engine.state();
        let out = self.engine.on_position(self.now, frame, &self.model);
        self.last_delivered = Some(*frame);
        let Some(out) = out else {
            let event = self.engine.take_event();
            self.note_event(event);
            assert!(event.is_some() || from == self.engine.state(), "a change of state that is not reported");
            if self.engine.needs_new_link() {
                self.link(RECONNECT_CYCLES);
            }
            return;
        };
        // a frame that told nothing leaves its time to the next one
        let seconds = |ns: i64| (ns as f64 * 1e-9).clamp(0.0, STEP_CYCLES * CYCLE_S);
        let intervals: &[f64] = match self.last_used_ns {
            _ if out.out_of_order => &[0.0],
            None => &[0.0, CYCLE_S],
            Some(used) => &[CYCLE_S, seconds(since), seconds(since_ns(used))],
        };
        if !out.out_of_order && frame.commanded.iter().chain(&frame.applied).all(|v| v.is_finite()) {
            self.last_used_ns = Some(frame.control_ns);
        }
        self.judge.check(&out, Circumstances { frame: Some(frame), intervals });
        self.note(&out);
        self.answer(&out, self.delay);
    }

    /// The engine's deadline, where it is due.
    fn deadline(&mut self) {
        let Some(out) = self.engine.on_deadline(self.now) else { return };
        self.judge.doubt();
        self.judge.check(&out, Circumstances { frame: None, intervals: &[CYCLE_S] });
        self.note(&out);
        self.answer(&out, 1);
    }

    /// An answer is on its way to the control, which takes none that is older than its hold time.
    fn answer(&mut self, out: &CycleOutput, delay: u32) {
        if self.frame.sequence.wrapping_sub(out.sequence) <= HOLD_CYCLES {
            self.answers.push_back((self.cycle + u64::from(delay), out.offset));
        }
    }

    pub(super) fn command(&mut self, command: Command) {
        self.ever_enabled |= command == Command::Enable;
        let from = self.engine.state();
        self.engine.on_command(self.now, command);
        match command {
            // only a new engine, which begins with a link, is told so
            Command::KeepFault if self.engine.state() == from => {}
            Command::KeepFault => self.silent_change(from, Cause::Link),
            _ => self.silent_change(from, Cause::Command),
        }
    }

    pub(super) fn tool(&mut self, z: f64) {
        self.engine.on_tool(Vec3::new(0.0, 0.0, z));
    }

    pub(super) fn model(&mut self, model: Model) {
        self.engine.on_model(&model).unwrap();
        self.model = model;
    }

    /// The link breaks; the control goes on alone for so many cycles, then there is another link.
    pub(super) fn link(&mut self, cycles: u16) {
        let from = self.engine.state();
        self.engine.on_link_down(self.now);
        self.linked = false;
        self.silent_change(from, Cause::Link);
        for _ in 0..cycles {
            self.cycle(Damage::None);
        }
        self.answers.clear();
        let from = self.engine.state();
        self.engine.on_link_up(self.now);
        self.silent_change(from, Cause::Link);
        self.linked = true;
        self.links += 1;
        (self.last_delivered, self.last_used_ns) = (None, None);
        self.judge.link_up();
    }

    /// A change of state that the caller knows of, because it asked for it.
    fn silent_change(&mut self, from: State, cause: Cause) {
        let to = self.engine.state();
        if to != from {
            self.transitions.insert((from, to, cause));
        }
        // a change that was not yet told is told with the next answer, but not on another link
        if to != from || cause == Cause::Link {
            self.told = to;
        }
    }

    /// Every change of state is reported once.
    fn note(&mut self, out: &CycleOutput) {
        assert_eq!(out.state, self.engine.state());
        self.note_event(out.event);
        if !self.ever_enabled {
            assert_eq!(out.offset, [0.0; MAX_AXES], "default off");
        }
    }

    fn note_event(&mut self, event: Option<Event>) {
        let state = self.engine.state();
        match event {
            Some(Event::StateChanged { from, to, reason, .. }) => {
                assert_eq!((from, to), (self.told, state), "{reason:?}");
            }
            None => assert_eq!(self.told, state, "a change of state that is not reported"),
        }
        self.told = state;
        let single = self.engine.trace.drain(..);
        self.transitions.extend(single.map(|(from, to, reason)| (from, to, Cause::Reason(reason))));
    }
}
