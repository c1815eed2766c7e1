//! Where the correction is looked up, and what bounds it: lag, feed, soft and stop limits, live values, other models.

use core::f64::consts::TAU;

use super::*;
use volcomp_model::curve::{Fourier, Live};

/// EXX = `amplitude` times a sine of `wave` mm.
fn cyclic(amplitude: f64, wave: f64) -> Model {
    let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y Z t]").unwrap());
    let curve = Fourier::new(0.0, 500.0, wave, 0.0, 0.0, &[], &[amplitude]).unwrap();
    spec.errors.push((ErrorSymbol::parse("exx").unwrap(), ErrorFunction::single(Curve::Fourier(curve))));
    Model::new(&spec).unwrap()
}

/// The largest error left on a straight run at `speed` mm/s through `model`, when a correction takes effect `delay`
/// cycles after its position.
fn left_over(
    config: &EngineConfig,
    model: Model,
    speed: f64,
    delay: usize,
    truth: impl Fn(f64) -> f64,
) -> f64 {
    let mut w = World::new(config);
    w.model = model;
    w.engine.on_command(MonoTime::ZERO, Command::Enable);
    w.frame.commanded[0] = 5.0;
    w.frame.state = MachineState::from_bits(READY.bits | MachineState::MOVING);
    let mut sent = std::collections::VecDeque::from(vec![[0.0; MAX_AXES]; delay]);
    let mut worst = 0.0f64;
    for n in 0..3000 {
        w.now = w.now.plus_seconds(CYCLE_S);
        w.frame.sequence += 1;
        w.frame.control_ns += 1_000_000;
        w.frame.commanded[0] = 5.0 + speed * CYCLE_S * f64::from(n);
        w.frame.applied = sent.pop_front().unwrap();
        if n > 1500 {
            worst = worst.max((truth(w.frame.commanded[0]) + w.frame.applied[0]).abs());
        }
        sent.push_back(w.send().offset);
    }
    worst
}

#[test]
fn the_lag_is_measured_and_taken_out() {
    let (amplitude, wave, speed) = (0.002, 40.0, 100.0);
    let truth = |x: f64| amplitude * (TAU * x / wave).sin();
    for delay in [1, 2, 5] {
        let left = left_over(&config(), cyclic(amplitude, wave), speed, delay, truth);
        let blind = EngineConfig { lag: Lag::Cycles(0.0), ..config() };
        let without = left_over(&blind, cyclic(amplitude, wave), speed, delay, truth);
        // A 2 sin(pi d / w) with d = v times the delay
        let expected =
            2.0 * amplitude * (core::f64::consts::PI * speed * delay as f64 * CYCLE_S / wave).sin();
        assert!((without / expected - 1.0).abs() < 0.05, "delay {delay}: {without} {expected}");
        assert!(left < 0.02 * expected, "delay {delay}: {left} of {expected}");
    }
}

#[test]
fn waves_too_short_for_the_feed_fade_instead_of_doubling_the_error() {
    let (amplitude, wave) = (0.001, 1.0);
    let truth = |x: f64| amplitude * (TAU * x / wave).sin();
    // the control is 10 cycles late without saying so: an offset of d = 0.3 mm at 30 mm/s, far beyond a sixth of a wave
    let fast = EngineConfig { lag: Lag::Cycles(0.0), lag_uncertainty_cycles: 10.0, ..config() };
    let naive = EngineConfig { lag_uncertainty_cycles: 0.0, ..fast.clone() };
    let limits = vec![AxisLimits { rate: 100.0, acceleration: 1e5, step: 1.0, ..LIMITS }; 3];
    let run = |c: &EngineConfig, speed: f64| {
        let c = EngineConfig { limits: limits.clone(), ..c.clone() };
        let mut w = left_over_free(&c, speed, 10, truth, cyclic(amplitude, wave));
        w = w.max(0.0);
        w
    };
    let (faded, full) = (run(&fast, 30.0), run(&naive, 30.0));
    assert!(full > 1.5 * amplitude, "without fading it would be worse than nothing: {full}");
    assert!(faded <= amplitude * 1.001, "{faded}");
    // at a crawl the whole wave is corrected
    assert!(run(&fast, 0.5) < 0.1 * amplitude);
}

/// Like [`left_over`], without the check of steps that belongs to other limits.
fn left_over_free(
    config: &EngineConfig,
    speed: f64,
    delay: usize,
    truth: impl Fn(f64) -> f64,
    model: Model,
) -> f64 {
    let mut engine = Compensator::new(config, &model).unwrap();
    engine.on_link_up(MonoTime::ZERO);
    engine.on_command(MonoTime::ZERO, Command::Enable);
    let mut frame = Position { state: READY, ..Position::default() };
    let mut sent = std::collections::VecDeque::from(vec![[0.0; MAX_AXES]; delay]);
    let mut worst = 0.0f64;
    for n in 0..3000u32 {
        frame.sequence = n + 1;
        frame.control_ns += 1_000_000;
        frame.commanded[0] = 5.0 + speed * CYCLE_S * f64::from(n);
        frame.applied = sent.pop_front().unwrap();
        if n > 1500 {
            worst = worst.max((truth(frame.commanded[0]) + frame.applied[0]).abs());
        }
        let now = MonoTime::ZERO.plus_seconds(CYCLE_S * f64::from(n));
        sent.push_back(engine.on_position(now, &frame, &model).unwrap().offset);
    }
    worst
}

#[test]
fn no_offset_carries_an_axis_over_its_soft_limit() {
    // the error is +10 um: the correction is -10 um, so the lower limit is the one in the way
    let limits = EngineConfig { soft_limits: vec![[0.0, 500.0]; 3], ..config() };
    let mut w = World::active(&limits);
    for n in 0..4000 {
        // 100 mm to 0 at 50 mm/s, then rest at the limit
        w.frame.commanded[0] = (100.0 - 0.05 * f64::from(n)).max(0.0);
        let out = w.cycle();
        let reached = w.frame.commanded[0] + out.offset[0];
        assert!(reached >= -1e-4, "{reached} in cycle {n}");
    }
    assert_eq!(w.last.offset[0], 0.0);
    assert_eq!(w.last.limited & 1, 1, "limiting is reported");
    // back inside the correction returns
    w.frame.commanded[0] = 0.5;
    w.run(500);
    assert!((w.last.offset[0] + 0.010).abs() < 1e-9);
    assert_eq!(w.last.limited, 0);
}

/// A circle that touches the limit: the axis comes in ever more slowly, and the offset takes effect some cycles late.
#[test]
fn no_offset_carries_a_circle_over_a_soft_limit_that_it_touches() {
    let limits = EngineConfig { soft_limits: vec![[0.0, 500.0]; 3], ..config() };
    for delay in [1, 2, 4] {
        let mut w = World::new(&limits);
        w.engine.on_command(MonoTime::ZERO, Command::Enable);
        let mut sent = std::collections::VecDeque::from(vec![[0.0; MAX_AXES]; delay]);
        let (radius, speed) = (100.0, 33.3);
        let (mut lowest, mut touched, mut before) = (f64::MAX, false, 2.0 * radius);
        for n in 0..12_000 {
            w.now = w.now.plus_seconds(CYCLE_S);
            w.frame.sequence += 1;
            w.frame.control_ns += 1_000_000;
            let angle = speed / radius * CYCLE_S * f64::from(n);
            w.frame.commanded[0] = radius * (1.0 + angle.cos());
            w.frame.applied = sent.pop_front().unwrap();
            // the motor may be a cycle behind
            lowest = lowest.min(w.frame.commanded[0].min(before) + w.frame.applied[0]);
            before = w.frame.commanded[0];
            touched |= w.frame.commanded[0] < 1e-4;
            sent.push_back(w.send().offset);
        }
        assert!(touched && w.last.state == State::Active, "{:?}", w.last);
        assert!(lowest >= -1e-5, "delay {delay}: {lowest} mm");
    }
}

#[test]
fn what_a_tool_or_a_model_changes_is_told_with_the_next_cycle_and_once() {
    let mut w = World::active(&config());
    let told = |w: &mut World| match w.cycle().event {
        Some(Event::StateChanged { from: State::Active, to: State::RampingIn, reason, .. }) => Some(reason),
        Some(other) => panic!("{other:?}"),
        None => None,
    };
    w.engine.on_tool(Vec3::new(0.0, 0.0, -50.0));
    assert_eq!((told(&mut w), told(&mut w)), (Some(Reason::ToolChanged), None));
    w.run(3000);
    let model = w.model.clone();
    w.engine.on_model(&model).unwrap();
    assert_eq!((told(&mut w), told(&mut w)), (Some(Reason::ModelChanged), None));
}

#[test]
fn a_correction_beyond_the_stop_limit_is_a_fault() {
    let mut w = World::active(&config());
    let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y Z t]").unwrap());
    spec.errors.push((ErrorSymbol::parse("exx").unwrap(), ErrorFunction::single(Curve::Constant(0.2))));
    let absurd = Model::new(&spec).unwrap();
    w.engine.on_model(&absurd).unwrap();
    w.model = absurd;
    let out = w.cycle();
    assert_eq!(out.state, State::Faulted);
    assert!(matches!(out.event, Some(Event::StateChanged { reason: Reason::StopLimit, .. })));
    w.run(1000);
    assert_eq!(w.last.offset, [0.0; MAX_AXES]);
}

#[test]
fn positions_that_stay_while_the_machine_says_it_moves_are_frozen() {
    let mut w = World::active(&config());
    w.frame.state = MachineState::from_bits(READY.bits | MachineState::MOVING);
    w.frame.feed_mm_per_min = 600.0;
    // 0.05 mm at 10 mm/s are 5 ms
    w.run(4);
    assert_eq!(w.last.state, State::Active);
    w.run(3);
    assert_eq!(w.last.state, State::Holding);
    // a dwell is no freeze
    let mut w = World::active(&config());
    w.frame.feed_mm_per_min = 600.0;
    w.run(1000);
    assert_eq!(w.last.state, State::Active);
}

#[test]
fn another_model_is_taken_without_a_step() {
    let mut w = World::active(&config());
    let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y Z t]").unwrap());
    spec.errors.push((ErrorSymbol::parse("exx").unwrap(), ErrorFunction::single(Curve::Constant(-0.03))));
    let other = Model::new(&spec).unwrap();
    w.engine.on_model(&other).unwrap();
    w.model = other;
    // World::cycle checks every step
    w.run(5);
    assert_eq!(w.last.state, State::RampingIn);
    w.run(400);
    assert_eq!(w.last.state, State::Active);
    assert!((w.last.offset[0] - 0.03).abs() < 1e-12);
    let foreign = ModelSpec::new("m", Chain::parse("[w b X Y Z A t]").unwrap());
    let refused = w.engine.on_model(&Model::new(&foreign).unwrap());
    assert_eq!(refused, Err(EngineError::AxisMissing { axis: AxisName::A }));
    w.run(10);
    assert_eq!(w.last.state, State::Active, "the old model goes on");
}

#[test]
fn a_sensor_that_falls_silent_fades_to_the_static_model() {
    let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y Z t]").unwrap());
    let live = Live { sensor: "ram".to_owned(), limit: 0.05, reference: None };
    let function = ErrorFunction { live: vec![live], ..ErrorFunction::single(Curve::Constant(0.010)) };
    spec.errors.push((ErrorSymbol::parse("exx").unwrap(), function));
    let model = Model::new(&spec).unwrap();
    let mut w = World::new(&config());
    w.engine = Compensator::new(&config(), &model).unwrap();
    w.model = model;
    w.engine.on_link_up(MonoTime::ZERO);
    w.engine.on_command(MonoTime::ZERO, Command::Enable);
    for _ in 0..800 {
        w.engine.on_live(w.now, 0, 0.005);
        w.cycle();
    }
    assert_eq!(w.last.state, State::Active);
    assert!((w.last.offset[0] + 0.015).abs() < 1e-9, "{:?}", w.last.offset);
    w.run(90);
    assert!((w.last.offset[0] + 0.015).abs() < 1e-9, "held while it may only be late");
    w.run(50);
    assert_eq!(w.last.state, State::FadingToStatic);
    w.run(300);
    assert_eq!(w.last.state, State::Active);
    assert!((w.last.offset[0] + 0.010).abs() < 1e-9);
}
