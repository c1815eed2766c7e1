//! Corrections that follow the motion of the axes: what they estimate, what they ask for, and what bounds them.

use super::*;
use proptest::collection::vec;
use volcomp_model::{DynamicTerm, Law};

const TAU_S: f64 = 0.004;
const COMPLIANCE_S2: f64 = 2e-5;

/// A model whose EXX has dynamic terms alone.
fn dynamic_model(terms: &[DynamicTerm]) -> Model {
    let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y Z t]").unwrap());
    let function = ErrorFunction { dynamics: terms.to_vec(), ..ErrorFunction::default() };
    spec.errors.push((ErrorSymbol::parse("exx").unwrap(), function));
    Model::new(&spec).unwrap()
}

fn term(law: Law, gain: f64) -> DynamicTerm {
    DynamicTerm { law, gain, growth: 0.0, limit: 0.04 }
}

fn backlash(build_up: f64) -> DynamicTerm {
    term(Law::Reversal { build_up }, 0.010)
}

/// A machine with this model, compensating.
fn world(terms: &[DynamicTerm]) -> World {
    let mut w = World::new(&config());
    w.engine.on_command(MonoTime::ZERO, Command::Enable);
    w.run(20);
    w.use_model(dynamic_model(terms));
    w.run(400);
    assert_eq!(w.last.state, State::Active);
    w
}

/// Moves X along a path for so many cycles; the offset of X after each.
fn along(w: &mut World, cycles: u32, path: impl Fn(f64) -> f64) -> Vec<f64> {
    let start = w.frame.commanded[0];
    (1..=cycles)
        .map(|k| {
            w.frame.commanded[0] = start + path(f64::from(k) * CYCLE_S);
            w.cycle().offset[0]
        })
        .collect()
}

/// 20 mm at 0.5 Hz: up to 31 mm/s and 99 mm/s^2.
const OMEGA: f64 = core::f64::consts::PI;
fn wave(t: f64) -> f64 {
    10.0 * (1.0 - (OMEGA * t).cos())
}

#[test]
fn an_axis_that_has_not_moved_gets_no_reversal_correction_and_one_that_moves_gets_half_the_width() {
    let mut w = world(&[backlash(0.0)]);
    assert_eq!(w.last.offset[0], 0.0);
    along(&mut w, 500, |t| 5.0 * t);
    assert!((w.last.offset[0] - 0.005).abs() < 1e-9, "{}", w.last.offset[0]);
    along(&mut w, 500, |t| -5.0 * t);
    assert!((w.last.offset[0] + 0.005).abs() < 1e-9, "{}", w.last.offset[0]);
}

#[test]
fn half_of_a_reversal_error_with_build_up_comes_at_once_and_the_rest_over_its_length() {
    let mut w = world(&[backlash(0.5)]);
    along(&mut w, 1000, |t| 10.0 * t);
    assert!((w.last.offset[0] - 0.005).abs() < 1e-8);
    // 0.5 mm back: a reversal error of -5 um (1 - 1/e)
    along(&mut w, 100, |t| -5.0 * t);
    let expected = -0.005 * (1.0 - (-1.0f64).exp());
    assert!((w.last.offset[0] - expected).abs() < 1.5e-4, "{} {expected}", w.last.offset[0]);
    // a short way forth does not wind it up the other way
    along(&mut w, 20, |t| 0.5 * t);
    assert!(w.last.offset[0] < 0.0015, "{}", w.last.offset[0]);
}

#[test]
fn a_correction_that_turns_a_standing_axis_is_a_reversal_and_dither_is_none() {
    let mut w = world(&[backlash(0.0)]);
    along(&mut w, 500, |t| 5.0 * t);
    // what moves the axis now is its own correction: another model that shifts X by 20 um towards minus
    let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y Z t]").unwrap());
    let function =
        ErrorFunction { dynamics: vec![backlash(0.0)], ..ErrorFunction::single(Curve::Constant(0.020)) };
    spec.errors.push((ErrorSymbol::parse("exx").unwrap(), function));
    w.use_model(Model::new(&spec).unwrap());
    w.run(600);
    assert_eq!(w.last.state, State::Active);
    assert!((w.last.offset[0] + 0.025).abs() < 1e-9, "{}", w.last.offset[0]);
    // half the dead band to and fro
    let offsets = along(&mut w, 2000, |t| if ((t * 100.0) as u32).is_multiple_of(2) { 0.0 } else { 5e-4 });
    assert!(offsets.iter().all(|o| (o + 0.025).abs() < 1e-9));
}

#[test]
fn a_lag_is_led_by_the_velocity_and_a_compliance_by_the_acceleration_at_the_moment_of_effect() {
    let mut w = world(&[term(Law::Velocity, -TAU_S * 0.1), term(Law::Acceleration, -COMPLIANCE_S2)]);
    let offsets = along(&mut w, 4000, wave);
    let mut largest = 0.0f64;
    for (k, offset) in offsets.iter().enumerate().skip(100) {
        // the correction of a frame is in force one cycle later
        let t = (k as f64 + 2.0) * CYCLE_S;
        let (v, a) = (10.0 * OMEGA * (OMEGA * t).sin(), 10.0 * OMEGA * OMEGA * (OMEGA * t).cos());
        largest = largest.max((offset - (0.1 * TAU_S * v + COMPLIANCE_S2 * a)).abs());
    }
    // of 12.6 um and 2 um
    assert!(largest < 3e-5, "{largest}");
}

#[test]
fn rounded_positions_make_no_noise_of_more_than_a_micrometre() {
    let mut w = world(&[term(Law::Velocity, -0.002), term(Law::Acceleration, -COMPLIANCE_S2)]);
    let rounded = |t: f64| (wave(t) * 1000.0).round() / 1000.0;
    // the noise of the positions becomes known on the way
    along(&mut w, 4000, rounded);
    let offsets = along(&mut w, 4000, rounded);
    let mut sum = 0.0;
    for (k, offset) in offsets.iter().enumerate() {
        let t = (k as f64 + 2.0) * CYCLE_S;
        let (v, a) = (10.0 * OMEGA * (OMEGA * t).sin(), 10.0 * OMEGA * OMEGA * (OMEGA * t).cos());
        let wanted = (0.002 * v + COMPLIANCE_S2 * a).clamp(-0.04, 0.04);
        sum += (offset - wanted).powi(2);
    }
    let rms = (sum / offsets.len() as f64).sqrt();
    assert!(rms < 1e-3, "{rms}");
}

#[test]
fn what_follows_velocity_goes_to_rest_when_frames_stay_away_and_the_reversal_stays() {
    let mut w = world(&[term(Law::Velocity, -TAU_S * 0.1), backlash(0.0)]);
    along(&mut w, 600, |t| 30.0 * t);
    let moving = 0.005 + 0.1 * TAU_S * 30.0;
    assert!((w.last.offset[0] - moving).abs() < 1e-6, "{}", w.last.offset[0]);
    let mut last = w.last.offset[0];
    for k in 0..80 {
        w.now = w.now.plus_seconds(if k == 0 { 0.02 } else { CYCLE_S });
        let out = w.engine.on_deadline(w.now).unwrap();
        assert_eq!(out.state, State::Holding);
        assert!((out.offset[0] - last).abs() <= 1e-3 + 1e-12);
        last = out.offset[0];
    }
    assert!((last - 0.005).abs() < 1e-6, "held at rest: {last}");
}

#[test]
fn frozen_positions_lead_to_rest() {
    let mut w = world(&[term(Law::Velocity, -TAU_S * 0.1)]);
    along(&mut w, 600, |t| 30.0 * t);
    assert!(w.last.offset[0] > 0.011);
    // the control says that it moves
    w.frame.state = MachineState::from_bits(READY.bits | MachineState::MOVING);
    w.frame.feed_mm_per_min = 1800.0;
    w.run(80);
    assert!(w.last.offset[0].abs() < 1e-6, "{}", w.last.offset[0]);
}

#[test]
fn a_transient_part_never_trips_the_stop_limit_and_reports_that_it_is_limited() {
    let mut w = world(&[DynamicTerm { law: Law::Velocity, gain: -0.02, growth: 0.0, limit: 1.0 }]);
    // 600 um of following error, of which 50 um may be corrected
    along(&mut w, 1000, |t| 30.0 * t);
    assert_eq!(w.last.state, State::Active);
    assert!((w.last.offset[0] - LIMITS.size).abs() < 1e-9 && w.last.limited & 1 == 1, "{:?}", w.last);
}

/// All laws at once on X.
fn every_law(build_up: f64, width: f64, [velocity, acceleration, peak]: [f64; 3]) -> World {
    world(&[
        term(Law::Reversal { build_up }, width),
        term(Law::Velocity, velocity),
        term(Law::Acceleration, acceleration),
        term(Law::FrictionPeak { rise_s: 0.002, fall_s: 0.02 }, peak),
        term(Law::Friction { speed: 0.1 }, peak / 4.0),
    ])
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    #[test]
    fn size_rate_and_acceleration_hold_whatever_regular_frames_report(
        moves in vec((prop_oneof![
            6 => -0.05..0.05f64, 2 => Just(0.0), 2 => -0.9..0.9f64, 1 => Just(f64::NAN),
        ], 1..40u32), 1..40),
        build_up in prop_oneof![Just(0.0), 0.01..1.0f64], width in -0.03..0.03f64,
        velocity in -0.01..0.01f64, acceleration in -1e-4..1e-4f64, peak in -0.02..0.02f64,
    ) {
        let mut w = every_law(build_up, width, [velocity, acceleration, peak]);
        let (mut rate, mut before, mut at) = (0.0, w.last.offset[0], 250.0);
        for (step, cycles) in moves {
            for _ in 0..cycles {
                at += if step.is_nan() { 0.0 } else { step };
                w.frame.commanded[0] = if step.is_nan() { step } else { at };
                // World checks the size of every answer
                let out = w.cycle();
                let now = (out.offset[0] - before) / CYCLE_S;
                prop_assert!(now.abs() <= LIMITS.rate * (1.0 + 1e-9), "rate {now}");
                let change = (now - rate).abs() / CYCLE_S;
                prop_assert!(change <= LIMITS.acceleration * (1.0 + 1e-6) + 1e-6, "acceleration {change}");
                (rate, before) = (now, out.offset[0]);
            }
        }
    }

    /// World checks size and step of every answer.
    #[test]
    fn lost_late_and_jumping_frames_make_no_step(
        moves in vec((prop_oneof![
            6 => -0.05..0.05f64, 1 => Just(0.0), 1 => -0.9..0.9f64, 1 => Just(f64::NAN), 1 => Just(f64::INFINITY),
        ], 1..40u32, 0..30u32, any::<bool>()), 1..40),
        build_up in prop_oneof![Just(0.0), 0.01..1.0f64], width in -0.03..0.03f64,
        velocity in -0.01..0.01f64, acceleration in -1e-4..1e-4f64, peak in -0.02..0.02f64,
    ) {
        let mut w = every_law(build_up, width, [velocity, acceleration, peak]);
        let mut at = 250.0;
        for (step, cycles, lost, jump) in moves {
            w.lost_cycles(lost);
            at = if jump { 150.0 } else { at };
            for _ in 0..cycles {
                at += if step.is_finite() { step } else { 0.0 };
                w.frame.commanded[0] = if step.is_finite() { at } else { step };
                let out = w.cycle();
                prop_assert!(out.offset[0].is_finite() && out.offset[0].abs() <= LIMITS.size + 1e-12);
            }
        }
    }
}
