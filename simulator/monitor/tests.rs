use volcomp_protocol::CorrectionState::{Active, Armed, Faulted, Holding, Off, RampingIn, RampingOut};

use volcomp_protocol::Message;
use volcomp_units::axes::AxisName;

use super::*;

const READY: u16 = MachineState::HOMED | MachineState::ENABLED;
const LINK: u64 = 1;
const CYCLE_NS: i64 = 1_000_000;
/// Change per cycle that every limit permits, mm.
const SLOW: f64 = 1e-4;

/// X and Y with the limits of the shipped machine file, C without any.
fn settings() -> Settings {
    let file = "[link]\ncycle-ms = 1\n[engine]\nramp-s = 0.5\n\
        [axes.x]\nlimit-um = 150\nrate-um-per-s = 2000\nacceleration-um-per-s2 = 40000\n\
        [axes.y]\nlimit-um = 150\nrate-um-per-s = 2000\nacceleration-um-per-s2 = 40000\n";
    Settings::from_machine_file(file, &[AxisName::X, AxisName::Y, AxisName::C]).unwrap()
}

/// A control and a daemon that say whatever a test wants.
struct Trace {
    monitor: Monitor,
    sequence: u32,
    control_ns: i64,
    state: u16,
    applied: AxisArray,
}

impl Trace {
    fn new() -> Self {
        let mut monitor = Monitor::new(settings());
        monitor.link_opened(LINK);
        Self { monitor, sequence: 0, control_ns: 0, state: READY, applied: [0.0; MAX_AXES] }
    }

    fn position(&mut self) {
        self.sequence = self.sequence.wrapping_add(1);
        self.control_ns += CYCLE_NS;
        let frame = Position {
            sequence: self.sequence,
            control_ns: self.control_ns,
            state: MachineState::from_bits(self.state),
            applied: self.applied,
            ..Position::default()
        };
        self.monitor.position(LINK, &frame);
    }

    fn answer(&mut self, state: CorrectionState, x: f64) {
        let mut correction = Correction { sequence: self.sequence, state, ..Correction::default() };
        correction.offset[0] = x;
        self.monitor.correction(LINK, &correction);
        self.applied = correction.offset;
    }

    fn cycle(&mut self, state: CorrectionState, x: f64) {
        self.position();
        self.answer(state, x);
    }

    /// Cycles from the present offset to another one.
    fn go(&mut self, state: CorrectionState, to: f64) {
        self.go_by(SLOW, state, to);
    }

    fn go_by(&mut self, step: f64, state: CorrectionState, to: f64) {
        let from = self.applied[0];
        let cycles = ((to - from).abs() / step).ceil().max(1.0);
        for n in 1..=cycles as u32 {
            self.cycle(state, from + (to - from) * f64::from(n) / cycles);
        }
    }

    /// Off, armed, ramped in, active at 10 um.
    fn active() -> Self {
        let mut trace = Self::new();
        trace.cycle(Off, 0.0);
        trace.cycle(Armed, 0.0);
        trace.go(RampingIn, 0.01);
        trace.go(Active, 0.01);
        trace
    }

    /// The invariants that did not hold, each once.
    fn found(&self) -> Vec<Invariant> {
        let mut found: Vec<_> = self.monitor.report().violations.iter().map(|v| v.invariant).collect();
        found.sort_unstable();
        found.dedup();
        found
    }

    fn assert_clean(&self) {
        assert!(self.monitor.report().is_clean(), "{:#?}", self.monitor.report());
    }

    fn assert_found(&self, wanted: Invariant) {
        assert!(self.found().contains(&wanted), "{wanted}: {:#?}", self.monitor.report());
    }

    fn new_link(&mut self) {
        self.monitor.link_opened(LINK);
    }
}

#[test]
fn a_course_without_fault_is_clean() {
    let mut t = Trace::active();
    // lost positions: two cycles of movement at most
    t.position();
    t.position();
    t.position();
    t.cycle(Active, 0.01 + 2.0 * 2e-3);
    // silence: held, then ramped out without a new position, and in again
    t.answer(Holding, 0.014);
    for n in (0..140).rev() {
        t.answer(RampingOut, f64::from(n) * SLOW);
    }
    t.go(RampingIn, 0.01);
    t.cycle(Active, 0.01);
    // emergency stop: the control moves its offset, the daemon follows
    t.state = READY | MachineState::ESTOP;
    t.cycle(Holding, 0.01);
    for answer in [0.008, 0.006, 0.004] {
        t.applied[0] = 0.004;
        t.cycle(Holding, answer);
    }
    t.state = READY;
    t.cycle(Holding, 0.004);
    t.go(RampingIn, 0.01);
    t.go(Active, -0.01);
    // the control takes the offset back by itself
    t.state = READY | MachineState::OFFSET_RAMPING_OUT;
    t.applied[0] = -0.0095;
    t.cycle(Holding, -0.0095);
    t.state = READY;
    t.go(RampingIn, -0.01);
    t.go(RampingOut, 0.0);
    t.cycle(Off, 0.0);
    // enabled, and a fault that is cleared at zero
    t.go(RampingIn, 0.01);
    t.go(Faulted, 0.0);
    t.cycle(Off, 0.0);
    t.assert_clean();
    assert!(t.monitor.report().figures.step > 3.9e-3);
    assert_eq!(t.monitor.report().figures.unanswered, 3);
}

#[test]
fn an_offset_found_beyond_the_limit_is_led_back() {
    let mut t = Trace::new();
    t.applied[0] = 0.2;
    t.cycle(Off, 0.2);
    t.go_by(3.0 * SLOW, RampingOut, 0.0);
    t.cycle(Off, 0.0);
    t.assert_clean();
}

#[test]
fn i1_size() {
    let mut t = Trace::active();
    t.go(Active, 0.151);
    t.assert_found(Invariant::Size);
    // found beyond the limit: neither again beyond it, nor more, nor more than the factor
    let mut t = Trace::new();
    t.applied[0] = 0.2;
    t.cycle(Off, 0.2);
    t.cycle(RampingOut, 0.2001);
    assert_eq!(t.found(), [Invariant::Size]);
    let mut t = Trace::new();
    t.applied[0] = 0.31;
    t.cycle(Off, 0.31);
    assert_eq!(t.found(), [Invariant::Size]);
    // found beyond the limit and left there
    let mut t = Trace::new();
    t.applied[0] = 0.2;
    t.cycle(Off, 0.2);
    t.go(RampingOut, 0.199);
    for _ in 0..1000 {
        t.cycle(RampingOut, 0.199);
    }
    t.assert_found(Invariant::Size);
    // an axis without limits
    let mut t = Trace::new();
    t.position();
    let mut correction = Correction { sequence: 1, ..Correction::default() };
    correction.offset[2] = 0.001;
    t.monitor.correction(LINK, &correction);
    t.assert_found(Invariant::Size);
}

#[test]
fn i1_size_holds_whatever_the_control_says() {
    // drives off: the answer follows the read-back, but not beyond the limit
    let mut t = Trace::active();
    t.state = MachineState::HOMED;
    t.applied[0] = 1e308;
    t.cycle(Holding, 1e308);
    assert_eq!(t.found(), [Invariant::Size, Invariant::Step, Invariant::Rate]);
    // nor in an answer to a position that was never sent
    let mut t = Trace::active();
    t.sequence += 7;
    t.answer(Active, 1.0);
    assert_eq!(t.found(), [Invariant::Size, Invariant::Sequence]);
}

#[test]
fn i2_step() {
    let mut t = Trace::active();
    t.position();
    t.position();
    t.cycle(Active, 0.01 + 4.1e-3);
    t.assert_found(Invariant::Step);
    // the first answer is the read-back
    let mut t = Trace::new();
    t.applied[0] = 0.02;
    t.cycle(Off, 0.0);
    assert_eq!(t.found(), [Invariant::Step]);
    // a read-back elsewhere is no permission
    let mut t = Trace::active();
    t.applied[0] = 0.04;
    t.cycle(Faulted, 0.04);
    t.assert_found(Invariant::Step);
    // the control moved its offset, and the answer goes further
    let mut t = Trace::active();
    t.state = READY | MachineState::OFFSET_RAMPING_OUT;
    t.applied[0] = 0.006;
    t.cycle(Holding, 0.001);
    t.assert_found(Invariant::Step);
}

#[test]
fn i2_step_after_a_silence() {
    // ramped out without a new position: what the control still holds is where a new link starts, and not this one
    for (held, clean) in [(0.0, true), (0.002, true), (0.005, false), (0.01, false), (5.0, false)] {
        let mut t = Trace::active();
        t.answer(Holding, 0.01);
        for n in (0..100).rev() {
            t.answer(RampingOut, f64::from(n) * SLOW);
        }
        t.applied[0] = held;
        t.cycle(RampingOut, held);
        assert_eq!(t.monitor.report().is_clean(), clean, "{held}: {:?}", t.monitor.report());
    }
}

#[test]
fn i3_rate() {
    let mut t = Trace::active();
    t.cycle(Active, 0.01 + 2.1e-3);
    assert_eq!(t.found(), [Invariant::Rate]);
    assert!((t.monitor.report().figures.rate - 2.1).abs() < 1e-9);
}

#[test]
fn i4_finite() {
    for (k, value) in [(0, f64::NAN), (1, f64::INFINITY), (3, 1e-3)] {
        let mut t = Trace::active();
        t.position();
        let mut correction = Correction { sequence: t.sequence, state: Active, ..Correction::default() };
        correction.offset[0] = 0.01;
        correction.offset[k] = value;
        t.monitor.correction(LINK, &correction);
        assert_eq!(t.found(), [Invariant::Finite]);
    }
}

#[test]
fn i5_state() {
    for (from, to) in [(Faulted, Active), (Off, Active), (Armed, Holding), (RampingOut, Active)] {
        let mut t = Trace::active();
        t.go(RampingOut, 0.0);
        match from {
            Off | Armed => t.cycle(from, 0.0),
            Faulted => t.cycle(Faulted, 0.0),
            _ => {}
        }
        t.assert_clean();
        t.cycle(to, 0.0);
        assert_eq!(t.found(), [Invariant::State], "{from:?} to {to:?}");
    }
    // the first answer of a link
    let mut t = Trace::new();
    t.cycle(Active, 0.0);
    assert_eq!(t.found(), [Invariant::State]);
    // a fault left with an offset
    let mut t = Trace::active();
    t.go(Faulted, 0.005);
    t.cycle(Off, 0.005);
    assert_eq!(t.found(), [Invariant::State]);
}

#[test]
fn i5_no_growth_and_rest() {
    let mut t = Trace::active();
    t.go(Faulted, 0.005);
    t.go(Faulted, 0.006);
    assert_eq!(t.found(), [Invariant::State]);
    let mut t = Trace::active();
    t.go(Holding, 0.012);
    assert_eq!(t.found(), [Invariant::State]);
}

#[test]
fn i6_sequence() {
    let mut t = Trace::active();
    t.sequence += 1;
    t.answer(Active, 0.01);
    assert_eq!(t.found(), [Invariant::Sequence]);
    // older than the answer before
    let mut t = Trace::active();
    t.sequence -= 1;
    t.answer(Active, 0.01);
    assert_eq!(t.found(), [Invariant::Sequence]);
    // the number of another link
    let mut t = Trace::active();
    t.new_link();
    t.answer(Off, 0.0);
    assert_eq!(t.found(), [Invariant::Sequence]);
    // five that follow one another are a new count
    for (positions, valid) in [(4, false), (5, true)] {
        let mut t = Trace::active();
        t.sequence = t.sequence.wrapping_sub(1000);
        for _ in 0..positions {
            t.position();
        }
        t.answer(Active, 0.01);
        assert_eq!(t.monitor.report().is_clean(), valid);
    }
}

#[test]
fn i7_time_to_zero() {
    let mut t = Trace::active();
    for _ in 0..1000 {
        t.cycle(RampingOut, 0.009);
    }
    assert_eq!(t.found(), [Invariant::TimeToZero]);
    // with drives off there is no limit
    let mut t = Trace::active();
    t.cycle(Faulted, 0.01);
    t.state = MachineState::HOMED;
    for _ in 0..2000 {
        t.cycle(Faulted, 0.01);
    }
    t.assert_clean();
}

/// A fault that has long led the offset to zero, and a control that then reports another one: the way starts anew.
#[test]
fn i7_time_to_zero_counts_from_the_last_way() {
    let reported = |to: f64| {
        let mut t = Trace::active();
        t.go(Faulted, 0.0);
        for _ in 0..1000 {
            t.cycle(Faulted, 0.0);
        }
        t.applied[0] = 0.001;
        t.cycle(Faulted, 0.001);
        t.go(Faulted, to);
        t
    };
    reported(0.0).assert_clean();
    let mut stays = reported(0.0005);
    for _ in 0..1000 {
        stays.cycle(Faulted, 0.0005);
    }
    assert_eq!(stays.found(), [Invariant::TimeToZero]);
}

#[test]
fn i8_read_back() {
    let mut t = Trace::new();
    t.applied[1] = f64::NAN;
    t.cycle(Off, 0.0);
    assert_eq!(t.found(), [Invariant::ReadBack]);
    let mut t = Trace::active();
    t.state = READY | MachineState::ESTOP;
    t.cycle(Holding, 0.0101);
    assert_eq!(t.found(), [Invariant::ReadBack]);
}

#[test]
fn frames_of_another_link_are_ignored() {
    let mut t = Trace::active();
    t.monitor.correction(LINK + 1, &Correction { sequence: 99, ..Correction::default() });
    t.assert_clean();
}

#[test]
fn the_largest_violation_is_kept_and_told() {
    let mut t = Trace::active();
    for n in 0..20 {
        t.cycle(Active, if n == 15 { 1e308 } else { 0.2 });
    }
    let lines = t.monitor.report().lines().join("\n");
    assert!(lines.contains("I1 size: offset beyond the limit: X 2.000000e-1"), "{lines}");
    assert!(lines.contains("largest 1.000000e308"), "{lines}");
}

#[test]
fn the_monitor_reads_frames_from_bytes() {
    use volcomp_protocol::{ControlHello, MAX_FRAME, encode};
    let shared = SharedMonitor::new(settings());
    let (mut down, mut up) = (DirectionTap::new(shared.clone(), 5), DirectionTap::new(shared.clone(), 5));
    let bytes = |message: &Message| {
        let mut buffer = [0; MAX_FRAME];
        let length = encode(message, &mut buffer);
        buffer[..length].to_vec()
    };
    let mut offset = [0.0; MAX_AXES];
    offset[0] = 1.0;
    let hello = ControlHello {
        version: 1,
        machine: volcomp_protocol::Name::new("m"),
        software: volcomp_protocol::Name::default(),
        cycle_ns: 1_000_000,
        axis_count: 1,
        axes: [volcomp_protocol::Axis { name: AxisName::X, unit: volcomp_protocol::AxisUnit::Millimetre };
            MAX_AXES],
    };
    let mut stream = bytes(&Message::ControlHello(hello));
    stream.extend(bytes(&Message::Position(Position { sequence: 1, ..Position::default() })));
    for piece in stream.chunks(7) {
        down.feed(piece);
    }
    up.feed(&bytes(&Message::Correction(Correction { sequence: 1, offset, ..Correction::default() })));
    let report = shared.report();
    assert_eq!([report.figures.links, report.figures.positions, report.figures.answers], [1; 3]);
    assert!(report.violations.iter().any(|v| v.invariant == Invariant::Size), "{report:?}");
}
