//! The engine against a small control: frames at 1 ms, offsets applied one cycle later.

mod answers;
mod commands;
mod gaps;
mod holding;
mod loss;
mod lying_control;
mod motion;
mod obstacles;
mod ramps;
mod reported_offset;
mod sequences;
mod setpoint;
mod shadow;
mod silence;

use proptest::prelude::*;

use super::*;
use volcomp_model::axes::{AxisArray, AxisName, MAX_AXES};
use volcomp_model::geometry::Vec3;
use volcomp_model::units::MonoTime;
use volcomp_model::{AxisSpec, Chain, Curve, ErrorFunction, ErrorSymbol, Model, ModelSpec};
use volcomp_protocol::{MachineState, Position};

const CYCLE_S: f64 = 1e-3;
const READY: MachineState = MachineState::from_bits(MachineState::HOMED | MachineState::ENABLED);
const LIMITS: AxisLimits =
    AxisLimits { warning: 0.03, size: 0.05, stop: 0.15, rate: 1.0, acceleration: 20.0, step: 0.002 };

fn config() -> EngineConfig {
    EngineConfig {
        axes: vec![AxisName::X, AxisName::Y, AxisName::Z],
        limits: vec![LIMITS; 3],
        cycle_s: CYCLE_S,
        limit_time: LimitTime::Control,
        ramp_s: 0.2,
        stale_s: 0.02,
        hold_s: 0.1,
        after_loss: AfterLoss::Latch,
        jump_limit: vec![1.0; 3],
        gain: 1.0,
        position_source: PositionSource::Commanded,
        out_of_travel: OutOfTravel::Hold,
        reversal_deadband: vec![0.001; 3],
        rest: RestOffset::Zero,
        read_back_tolerance: vec![1e-4; 3],
        read_back_cycles: 10,
        soft_limits: vec![[f64::NEG_INFINITY, f64::INFINITY]; 3],
        lag: Lag::Measured,
        lag_uncertainty_cycles: 0.5,
        live_max_age_s: 0.1,
    }
}

/// EXX = +10 um everywhere, travel of X 0 to 500 mm.
fn model() -> Model {
    constant_model(0.010)
}

/// The reason of the change of state that an answer tells.
fn reason(out: &CycleOutput) -> Option<Reason> {
    out.event.map(|Event::StateChanged { reason, .. }| reason)
}

/// An offset of X alone, mm.
fn x_only(mm: f64) -> AxisArray {
    let mut offset = [0.0; MAX_AXES];
    offset[0] = mm;
    offset
}

/// Five axes, two of them rotary, and a model without errors.
fn five_axes(limits: [AxisLimits; 5]) -> (EngineConfig, Model) {
    let spec = ModelSpec::new("m", Chain::parse("[w b X Y Z C A t]").unwrap());
    let config = EngineConfig {
        axes: vec![AxisName::X, AxisName::Y, AxisName::Z, AxisName::A, AxisName::C],
        limits: limits.to_vec(),
        jump_limit: vec![1.0; 5],
        reversal_deadband: vec![0.001; 5],
        read_back_tolerance: vec![1e-4; 5],
        soft_limits: vec![[f64::NEG_INFINITY, f64::INFINITY]; 5],
        ..config()
    };
    (config, Model::new(&spec).unwrap())
}

/// EXX = `size` mm everywhere, travel of X 0 to 500 mm.
fn constant_model(size: f64) -> Model {
    let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y Z t]").unwrap());
    let mut x = AxisSpec::new(AxisName::X);
    x.travel = Some([0.0, 500.0]);
    spec.axes.push(x);
    spec.errors.push((ErrorSymbol::parse("exx").unwrap(), ErrorFunction::single(Curve::Constant(size))));
    Model::new(&spec).unwrap()
}

struct World {
    engine: Compensator,
    model: Model,
    frame: Position,
    now: MonoTime,
    last: CycleOutput,
    /// The next answer is the first of a link.
    fresh: bool,
}

impl World {
    fn new(config: &EngineConfig) -> Self {
        let model = model();
        let mut engine = Compensator::new(config, &model).unwrap();
        engine.on_link_up(MonoTime::ZERO);
        let mut frame = Position { state: READY, ..Position::default() };
        frame.commanded[0] = 100.0;
        let last = CycleOutput {
            sequence: 0,
            state: State::Off,
            offset: [0.0; MAX_AXES],
            limited: 0,
            at_soft_limit: 0,
            warning: 0,
            out_of_order: false,
            out_of_range: 0,
            out_of_travel: 0,
            lagging: 0,
            faded: 0,
            wanted: [0.0; MAX_AXES],
            known: [0.0; MAX_AXES],
            lag_cycles: None,
            event: None,
            stopped: false,
        };
        Self { engine, model, frame, now: MonoTime::ZERO, last, fresh: true }
    }

    /// One cycle; the offset asked for before is now applied.
    fn cycle(&mut self) -> CycleOutput {
        self.now = self.now.plus_seconds(CYCLE_S);
        self.frame.sequence = self.frame.sequence.wrapping_add(1);
        self.frame.control_ns += 1_000_000;
        self.frame.applied = self.last.offset;
        self.send()
    }

    fn send(&mut self) -> CycleOutput {
        match self.engine.on_position(self.now, &self.frame, &self.model) {
            Some(out) => {
                self.check_step(&out);
                self.last = out;
            }
            None => self.control_alone(),
        }
        self.fresh = self.engine.needs_new_link();
        if self.fresh {
            self.new_link();
        }
        self.last
    }

    /// The next frame of the control, which reports `applied`: the answer as it is, unchecked.
    fn reports(&mut self, applied: AxisArray) -> Option<CycleOutput> {
        self.lost_cycles(1);
        self.frame.applied = applied;
        let answer = self.engine.on_position(self.now, &self.frame, &self.model);
        self.last = answer.unwrap_or(self.last);
        answer
    }

    /// So many cycles of the control; no frame is seen.
    fn lost_cycles(&mut self, cycles: u32) {
        self.now = self.now.plus_seconds(f64::from(cycles) * CYCLE_S);
        self.frame.sequence += cycles;
        self.frame.control_ns += 1_000_000 * i64::from(cycles);
    }

    /// Another model, which the engine takes at the next cycle.
    fn use_model(&mut self, model: Model) {
        self.engine.on_model(&model).unwrap();
        self.model = model;
    }

    /// No answer: the control removes its offset by its own rule.
    fn control_alone(&mut self) {
        assert!(self.engine.is_silenced() || self.engine.needs_new_link(), "an answer is missing");
        self.last.state = self.engine.state();
        self.last.event = self.engine.take_event();
        for (v, held) in self.last.offset.iter_mut().zip(self.frame.applied) {
            *v = held - held.clamp(-1e-4, 1e-4);
        }
    }

    fn new_link(&mut self) {
        self.engine.on_link_down(self.now);
        self.engine.on_link_up(self.now);
        self.fresh = true;
    }

    /// No step from the answer before, and nothing beyond the size, whatever the control reports.
    fn check_step(&self, out: &CycleOutput) {
        for k in 0..3 {
            let from = if self.fresh { self.frame.applied[k] } else { self.last.offset[k] };
            let step = (out.offset[k] - from).abs();
            let most = (LIMITS.rate * 2.0 * CYCLE_S).min(LIMITS.step);
            assert!(step <= most * 1.000_001, "step of {step} mm in {:?}", out.state);
            assert!(out.offset[k].abs() <= LIMITS.size.max(from.abs()) + 1e-12);
        }
    }

    fn run(&mut self, cycles: usize) -> CycleOutput {
        for _ in 0..cycles {
            self.cycle();
        }
        self.last
    }

    /// The control claims an offset that it was never sent, until that is a fault.
    fn foreign_writer(&mut self) {
        for _ in 0..30 {
            self.now = self.now.plus_seconds(CYCLE_S);
            self.frame.sequence += 1;
            self.frame.control_ns += 1_000_000;
            self.frame.applied = [0.002; MAX_AXES];
            self.send();
        }
        assert_eq!(self.last.state, State::Faulted);
        assert!(self.engine.is_silenced(), "what the control holds is not known");
    }

    fn active(config: &EngineConfig) -> Self {
        let mut world = Self::new(config);
        world.engine.on_command(MonoTime::ZERO, Command::Enable);
        world.run(300);
        assert_eq!(world.last.state, State::Active);
        world
    }
}

#[test]
fn off_by_default_and_nothing_moves() {
    let mut w = World::new(&config());
    let out = w.run(500);
    assert_eq!(out.state, State::Off);
    assert_eq!(out.offset, [0.0; MAX_AXES]);
}

#[test]
fn ten_um_too_far_is_answered_by_minus_ten_um() {
    let w = World::active(&config());
    assert!((w.last.offset[0] + 0.010).abs() < 1e-15);
    assert_eq!(w.last.offset[1..], [0.0; MAX_AXES - 1]);
    assert_eq!((w.last.limited, w.last.warning), (0, 0));
}

#[test]
fn disabling_ramps_to_zero_and_ends_off() {
    let mut w = World::active(&config());
    w.engine.on_command(w.now, Command::Disable);
    assert_eq!(w.cycle().state, State::RampingOut);
    let out = w.run(400);
    assert_eq!((out.state, out.offset[0]), (State::Off, 0.0));
}

#[test]
fn a_gain_below_one_is_a_share_and_is_ramped() {
    let mut w = World::active(&config());
    w.engine.on_command(w.now, Command::SetGain(0.3));
    let out = w.run(300);
    assert!((out.offset[0] + 0.003).abs() < 1e-12);
    w.engine.on_command(w.now, Command::SetGain(7.0));
    assert!((w.run(300).offset[0] + 0.003).abs() < 1e-12, "an impossible gain is refused");
}

#[test]
fn one_nan_holds_and_compensation_comes_back() {
    let mut w = World::active(&config());
    w.frame.commanded[1] = f64::NAN;
    let out = w.cycle();
    assert_eq!(out.state, State::Holding);
    assert!((out.offset[0] + 0.010).abs() < 1e-12);
    w.frame.commanded[1] = 0.0;
    w.run(20);
    assert_eq!(w.last.state, State::RampingIn);
    assert_eq!(w.run(300).state, State::Active);
}

#[test]
fn lasting_nan_is_ramped_out() {
    let mut w = World::active(&config());
    w.frame.commanded[1] = f64::INFINITY;
    let out = w.run(600);
    assert_eq!((out.state, out.offset[0]), (State::Faulted, 0.0));
}

#[test]
fn a_jump_holds_once_and_goes_on_from_the_new_place() {
    let mut w = World::active(&config());
    w.frame.commanded[0] = 300.0;
    let out = w.cycle();
    assert!(matches!(out.event, Some(Event::StateChanged { to: State::Holding, reason: Reason::Jump, .. })));
    assert_eq!(w.run(400).state, State::Active);
}

#[test]
fn a_clock_that_goes_back_is_a_bad_frame() {
    let mut w = World::active(&config());
    w.frame.control_ns -= 5_000_000;
    let out = w.cycle();
    assert!(matches!(
        out.event,
        Some(Event::StateChanged { to: State::Holding, reason: Reason::ControlClock, .. })
    ));
}

#[test]
fn repeated_and_old_frames_change_nothing() {
    let mut w = World::active(&config());
    let before = w.last;
    let out = w.send();
    assert_eq!((out.state, out.offset, out.event), (State::Active, before.offset, None));
    w.frame.sequence = w.frame.sequence.wrapping_sub(3);
    assert_eq!(w.send().state, State::Active);
}

#[test]
fn lost_frames_are_no_reason_to_stop() {
    let mut w = World::active(&config());
    w.frame.sequence = w.frame.sequence.wrapping_add(7);
    w.frame.control_ns += 7_000_000;
    assert_eq!(w.cycle().state, State::Active);
}

#[test]
fn sequence_numbers_wrap() {
    let mut w = World::new(&config());
    w.frame.sequence = u32::MAX - 50;
    w.engine.on_command(MonoTime::ZERO, Command::Enable);
    assert_eq!(w.run(400).state, State::Active);
}

#[test]
fn silence_holds_then_ramps_out_and_frames_bring_it_back_where_they_may() {
    let mut w = World::active(&EngineConfig { after_loss: AfterLoss::Resume, ..config() });
    let due = w.engine.next_deadline().unwrap();
    assert!(w.engine.on_deadline(w.now).is_none(), "early is harmless");
    let out = w.engine.on_deadline(due).unwrap();
    assert_eq!(out.state, State::Holding);
    assert!((out.offset[0] + 0.010).abs() < 1e-12);
    let mut calls = 0;
    while let Some(next) = w.engine.next_deadline() {
        let out = w.engine.on_deadline(next).unwrap();
        w.check_step(&out);
        w.last = out;
        w.now = next;
        calls += 1;
        assert!(calls < 2000, "never ends");
    }
    assert_eq!((w.last.state, w.last.offset[0]), (State::Armed, 0.0));
    w.frame.control_ns += 500_000_000;
    w.frame.sequence += 500;
    assert_eq!(w.run(400).state, State::Active);
}

#[test]
fn emergency_stop_in_mid_ramp_freezes_the_offset_and_goes_on_from_there() {
    let mut w = World::new(&config());
    w.engine.on_command(MonoTime::ZERO, Command::Enable);
    w.run(110);
    assert_eq!(w.last.state, State::RampingIn);
    w.frame.state = MachineState::from_bits(MachineState::HOMED | MachineState::ESTOP);
    let out = w.run(50);
    assert_eq!(out.state, State::Holding);
    assert_eq!(w.run(500).offset, out.offset, "frozen as long as it lasts");
    w.frame.state = READY;
    assert_eq!(w.run(400).state, State::Active);
}

#[test]
fn after_an_emergency_stop_in_motion_the_first_answer_is_what_the_control_held() {
    let mut w = World::new(&config());
    w.engine.on_command(MonoTime::ZERO, Command::Enable);
    w.run(110);
    // the control cannot move: the answer to the last frame before the stop never acts
    let held = w.frame.applied;
    assert!((w.last.offset[0] - held[0]).abs() > 1e-5, "the ramp is moving");
    w.frame.state = MachineState::from_bits(READY.bits | MachineState::ESTOP);
    for _ in 0..50 {
        w.last.offset = held;
        assert_eq!(w.cycle().offset, held);
    }
    w.frame.state = READY;
    assert_eq!(w.cycle().offset, held);
    assert_eq!(w.run(400).state, State::Active);
}

#[test]
fn a_fault_does_not_bring_an_offset_back_that_the_control_has_taken_out() {
    let mut w = World::active(&config());
    w.foreign_writer();
    w.new_link();
    w.last.offset = [0.0; MAX_AXES];
    for _ in 0..300 {
        w.frame.sequence += 1;
        w.frame.control_ns += 1_000_000;
        assert_eq!(w.engine.on_position(w.now, &w.frame, &w.model), None, "a latched fault sends nothing");
        assert_eq!(w.engine.state(), State::Faulted);
    }
}

#[test]
fn nothing_is_sent_before_the_control_has_told_its_offset() {
    let mut w = World::active(&config());
    w.new_link();
    w.frame.applied = [f64::NAN; MAX_AXES];
    w.frame.sequence += 1;
    assert_eq!(w.engine.on_position(w.now, &w.frame, &w.model), None);
    // the offset is told, the position is not: start from the offset, and take it out when that lasts
    w.last.offset = x_only(-0.002);
    w.frame.commanded[0] = f64::NAN;
    assert!((w.cycle().offset[0] + 0.002).abs() < 1e-12);
    let out = w.run(600);
    assert_eq!((out.state, out.offset[0]), (State::Armed, 0.0));
}

#[test]
fn a_new_link_knows_no_tool_and_the_same_tool_again_changes_nothing() {
    let mut w = World::active(&config());
    let tip = Vec3::new(0.0, 0.0, -120.0);
    w.engine.on_tool(tip);
    assert_eq!(w.engine.state(), State::RampingIn);
    assert_eq!(w.run(300).state, State::Active);
    w.engine.on_tool(tip);
    assert_eq!(w.engine.state(), State::Active);
    w.new_link();
    assert_eq!(w.run(400).state, State::Active);
    w.engine.on_tool(tip);
    assert_eq!(w.engine.state(), State::RampingIn, "the tool of the link before was forgotten");
}

#[test]
fn a_stop_is_carried_out_in_every_state() {
    // faulted and back at zero
    let mut w = World::active(&config());
    w.foreign_writer();
    w.run(500);
    w.engine.on_command(w.now, Command::Stop);
    assert!(w.engine.is_stopped());
    // off, with frames that say nothing
    let mut w = World::new(&config());
    w.run(20);
    w.frame.commanded[0] = f64::NAN;
    w.run(5);
    w.engine.on_command(w.now, Command::Stop);
    assert!(w.cycle().stopped);
    // off, and silent
    let mut w = World::new(&config());
    w.run(20);
    w.engine.on_command(w.now, Command::Stop);
    assert!(w.engine.is_stopped());
}

#[test]
fn emergency_stop_counts_even_where_the_position_is_nonsense() {
    let mut w = World::active(&config());
    w.frame.state = MachineState::from_bits(READY.bits | MachineState::ESTOP);
    w.frame.commanded[0] = f64::NAN;
    let out = w.run(600);
    assert_eq!(out.state, State::Holding);
    assert!((out.offset[0] + 0.010).abs() < 1e-9, "frozen, not ramped out");
}

#[test]
fn an_offset_changed_by_the_control_while_off_is_taken_over() {
    let mut w = World::active(&config());
    w.frame.state = MachineState::from_bits(MachineState::HOMED);
    w.run(50);
    w.last.offset[0] = 0.0;
    w.frame.state = READY;
    let out = w.cycle();
    assert_eq!(out.offset[0], 0.0, "starts from what the control holds");
    assert_eq!(w.run(400).state, State::Active);
}

#[test]
fn a_restart_goes_on_from_the_offset_that_the_control_holds() {
    let mut w = World::new(&config());
    w.last.offset[0] = -0.010;
    w.engine.on_command(MonoTime::ZERO, Command::Enable);
    for _ in 0..400 {
        let out = w.cycle();
        assert!((out.offset[0] + 0.010).abs() < 1e-9, "was right already and stays: {}", out.offset[0]);
    }
    assert_eq!(w.last.state, State::Active);
}

#[test]
fn an_offset_found_while_off_is_ramped_out() {
    let mut w = World::new(&config());
    w.last.offset[0] = -0.010;
    let out = w.run(500);
    assert_eq!((out.state, out.offset[0]), (State::Off, 0.0));
}

#[test]
fn a_foreign_writer_is_a_fault_that_stays_until_cleared() {
    let mut w = World::active(&config());
    w.foreign_writer();
    let out = w.run(500);
    assert_eq!((out.state, out.offset[0]), (State::Faulted, 0.0));
    w.engine.on_command(w.now, Command::Enable);
    assert_eq!(w.run(50).state, State::Faulted, "enabling does not clear a fault");
    w.engine.on_command(w.now, Command::ClearFault);
    w.engine.on_command(w.now, Command::Enable);
    assert_eq!(w.run(400).state, State::Active);
}

#[test]
fn stop_ramps_to_zero_or_keeps_the_offset_as_configured() {
    let mut w = World::active(&config());
    w.engine.on_command(w.now, Command::Stop);
    assert!(!w.cycle().stopped);
    let out = w.run(400);
    assert_eq!((out.stopped, out.state, out.offset[0]), (true, State::Off, 0.0));

    let mut w = World::active(&EngineConfig { rest: RestOffset::Hold, ..config() });
    w.engine.on_command(w.now, Command::Stop);
    let out = w.run(50);
    assert!(out.stopped);
    assert!((out.offset[0] + 0.010).abs() < 1e-12);
}

#[test]
fn the_control_acting_on_its_own_is_followed() {
    let mut w = World::active(&config());
    w.frame.state = MachineState::from_bits(READY.bits | MachineState::OFFSET_RAMPING_OUT);
    w.last.offset[0] = -0.0099;
    let out = w.cycle();
    assert!((out.offset[0] + 0.0099).abs() < 1e-9);
    w.frame.state = READY;
    assert_eq!(w.run(400).state, State::Active);
}

#[test]
fn beyond_the_travel_is_held_and_flagged_or_ramped_out() {
    let mut w = World::active(&config());
    for _ in 0..500 {
        w.frame.commanded[0] += 0.9;
        w.cycle();
    }
    assert_eq!((w.last.state, w.last.out_of_range), (State::Active, 1));
    let mut w = World::active(&EngineConfig { out_of_travel: OutOfTravel::RampOut, ..config() });
    for _ in 0..500 {
        w.frame.commanded[0] += 0.9;
        w.cycle();
    }
    let out = w.run(400);
    assert_eq!((out.state, out.offset[0]), (State::Armed, 0.0));
}

#[test]
fn an_axis_that_runs_to_the_end_of_its_travel_is_not_beyond_it() {
    let mut w = World::active(&EngineConfig { out_of_travel: OutOfTravel::RampOut, ..config() });
    for cycle in 1..=1100 {
        w.frame.commanded[0] = (100.0 + 0.4 * f64::from(cycle)).min(500.0);
        let out = w.cycle();
        assert_eq!((out.state, out.out_of_travel), (State::Active, 0), "at {}", w.frame.commanded[0]);
    }
    for (beyond, is_outside) in [(0.002, false), (0.049, false), (0.051, true)] {
        w.frame.commanded[0] = 500.0 + beyond;
        let out = w.run(20);
        assert_eq!(out.out_of_range == 1, is_outside, "{beyond} mm beyond");
    }
}

#[test]
fn wire_units_of_rotary_axes_are_degrees() {
    let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y Z C A t]").unwrap());
    spec.tool_tip.z = -100.0;
    spec.errors.push((ErrorSymbol::parse("eax").unwrap(), ErrorFunction::single(Curve::Constant(1e-4))));
    let model = Model::new(&spec).unwrap();
    let (config, _) = five_axes([LIMITS; 5]);
    let mut engine = Compensator::new(&config, &model).unwrap();
    engine.on_command(MonoTime::ZERO, Command::Enable);
    let mut frame = Position { state: READY, ..Position::default() };
    // a pole must be avoided: the head is tilted by 30 degrees
    frame.commanded[3] = 30.0;
    let mut out = None;
    for _ in 0..400 {
        frame.sequence += 1;
        frame.control_ns += 1_000_000;
        let o = engine.on_position(MonoTime::ZERO, &frame, &model).unwrap();
        frame.applied = engine.message(&o).offset;
        out = Some(o);
    }
    let out = out.unwrap();
    // EAX = 100 urad is taken back by A, to first order
    assert!((out.offset[3] + 1e-4).abs() < 1e-7, "{:?}", out.offset);
    assert!((engine.message(&out).offset[3] - out.offset[3].to_degrees()).abs() < 1e-15);
}

#[test]
fn a_configuration_that_cannot_be_right_is_refused() {
    let model = model();
    let bad = |c: EngineConfig| Compensator::new(&c, &model).unwrap_err();
    assert!(matches!(bad(EngineConfig { limits: vec![LIMITS; 2], ..config() }), EngineError::Length { .. }));
    assert!(matches!(bad(EngineConfig { gain: 1.5, ..config() }), EngineError::Range { .. }));
    assert!(matches!(bad(EngineConfig { ramp_s: 0.0, ..config() }), EngineError::Range { .. }));
    let no_x = vec![AxisName::A, AxisName::Y, AxisName::Z];
    assert_eq!(bad(EngineConfig { axes: no_x, ..config() }), EngineError::AxisMissing { axis: AxisName::X });
}
