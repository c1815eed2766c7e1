//! The promises of the profile, checked on the positions that come out.

use proptest::prelude::*;
use volcomp_units::axes::{AxisName, MAX_AXES};

use super::*;
use crate::motion::axes::AxisSetup;
use crate::motion::gcode::interpret;
use crate::motion::paths;

fn axes() -> MachineAxes {
    MachineAxes::three_axis([0.0, 850.0], [0.0, 500.0], [0.0, 500.0]).unwrap()
}

fn home() -> AxisArray {
    let mut q = [0.0; MAX_AXES];
    q[..3].copy_from_slice(&[425.0, 250.0, 250.0]);
    q
}

fn run(text: &str, cycle_s: f64) -> (Trajectory, Vec<MotionCycle>) {
    let axes = axes();
    let program = interpret(text, &axes, home()).unwrap();
    let mut t = Trajectory::new(home(), &program.segments, &axes, &Dynamics::default(), cycle_s).unwrap();
    let mut cycles = Vec::new();
    while let Some(c) = t.next_cycle() {
        cycles.push(c);
    }
    (t, cycles)
}

fn norm(a: &AxisArray) -> f64 {
    a.iter().map(|v| v * v).sum::<f64>().sqrt()
}

fn minus(a: &AxisArray, b: &AxisArray) -> AxisArray {
    let mut d = *a;
    for k in 0..MAX_AXES {
        d[k] -= b[k];
    }
    d
}

#[test]
fn every_sample_of_a_circle_lies_on_it() {
    let text = paths::circle(&paths::Circle {
        centre_mm: [425.0, 250.0, 250.0],
        radius_mm: 150.0,
        feed_mm_per_min: 3000.0,
        ..paths::Circle::default()
    });
    let (_, cycles) = run(&text, 0.001);
    let scored: Vec<_> = cycles.iter().filter(|c| c.scored).collect();
    // one turn at constant feed: 2 pi 150 mm at 50 mm/s
    let expected = core::f64::consts::TAU * 150.0 / 50.0 / 0.001;
    assert!((scored.len() as f64 - expected).abs() <= 2.0, "{} {expected}", scored.len());
    for c in scored {
        let r = (c.commanded[0] - 425.0).hypot(c.commanded[1] - 250.0);
        assert!((r - 150.0).abs() < 1e-9, "{r}");
        assert!((c.feed_mm_per_min - 3000.0).abs() < 1e-6, "{}", c.feed_mm_per_min);
        assert_eq!(c.commanded[2], 250.0);
    }
}

#[test]
fn the_end_is_exact_and_the_start_too() {
    let (t, cycles) = run("F3000\nG1 X500.123456 Y200\nG2 X520.123456 Y180 I20 J0\nG1 Z300.1", 0.0007);
    assert_eq!(cycles[0].commanded, home());
    assert_eq!(cycles.last().unwrap().commanded[..3], [520.123_456, 180.0, 300.1]);
    assert!(!cycles.last().unwrap().moving);
    assert!((cycles.len() as f64 * 0.0007 - t.duration_s()).abs() < 0.0015);
}

#[test]
fn a_sharp_corner_is_an_exact_stop_and_a_tangent_one_is_not() {
    let (t, cycles) = run("F3000\nG1 X500\nG1 Y300\n", 0.001);
    let slowest_near_corner =
        cycles.iter().filter(|c| (c.commanded[0] - 500.0).abs() < 1e-3).map(|c| c.feed_mm_per_min);
    assert!(slowest_near_corner.fold(f64::INFINITY, f64::min) < 50.0);
    assert!(t.duration_s() > 0.0);
    let (_, cycles) = run("F3000\nG1 X500\nG1 X550\nG3 X600 Y300 I0 J50\nG1 Y350", 0.001);
    let middle = cycles.iter().filter(|c| c.commanded[0] > 470.0 && c.commanded[1] < 320.0);
    assert!(middle.map(|c| c.feed_mm_per_min).fold(f64::INFINITY, f64::min) > 2999.0);
}

#[test]
fn exact_stop_mode_stops_on_a_straight_line() {
    let (_, cycles) = run("G61 F3000\nG1 X500\nG1 X550", 0.001);
    let near = cycles.iter().filter(|c| (c.commanded[0] - 500.0).abs() < 0.01);
    assert!(near.map(|c| c.feed_mm_per_min).fold(f64::INFINITY, f64::min) < 200.0);
}

#[test]
fn a_list_of_short_blocks_runs_at_the_programmed_feed() {
    let text = paths::s_path(&paths::SPath { centre_mm: [425.0, 250.0, 250.0], ..paths::SPath::default() });
    let (t, cycles) = run(&text, 0.001);
    let scored: Vec<_> = cycles.iter().filter(|c| c.scored).collect();
    let at_feed = scored.iter().filter(|c| c.feed_mm_per_min > 1990.0).count();
    assert!(at_feed * 10 > scored.len() * 9, "{at_feed} of {} in {} s", scored.len(), t.duration_s());
}

#[test]
fn dwell_stands_still_for_its_time() {
    let (_, cycles) = run("F3000\nG1 X430\nG4 P0.5\nG1 X440", 0.001);
    let still = cycles.iter().filter(|c| c.commanded[0] == 430.0 && !c.moving).count();
    assert!((499..=502).contains(&still), "{still}");
}

#[test]
fn rapids_respect_the_rate_of_every_axis() {
    let mut slow_z = AxisSetup::new(AxisName::Z, [0.0, 500.0]);
    slow_z.rapid_per_min = 6_000.0;
    let axes = MachineAxes::new(vec![
        AxisSetup::new(AxisName::X, [0.0, 850.0]),
        AxisSetup::new(AxisName::Y, [0.0, 500.0]),
        slow_z,
    ])
    .unwrap();
    let program = interpret("G0 X800 Y450 Z400", &axes, home()).unwrap();
    let mut t = Trajectory::new(home(), &program.segments, &axes, &Dynamics::default(), 0.001).unwrap();
    let mut last = home();
    let mut fastest = [0.0_f64; 3];
    while let Some(c) = t.next_cycle() {
        for k in 0..3 {
            fastest[k] = fastest[k].max((c.commanded[k] - last[k]).abs() / 0.001 * 60.0);
        }
        last = c.commanded;
    }
    assert!(fastest[2] <= 6_000.0 * (1.0 + 1e-6) && fastest[2] > 5_900.0, "{fastest:?}");
    assert!(fastest[0] <= 24_000.0 * (1.0 + 1e-6));
}

#[test]
fn the_same_positions_come_again_after_a_rewind() {
    let (mut t, cycles) = run("F2000\nG1 X500\nG2 X500 Y250 I10", 0.002);
    t.rewind();
    let mut again = Vec::new();
    while let Some(c) = t.next_cycle() {
        again.push(c);
    }
    assert_eq!(cycles, again);
}

#[test]
fn an_empty_program_is_one_cycle_at_the_start() {
    let (_, cycles) = run("; nothing\n", 0.001);
    assert_eq!(cycles.len(), 1);
    assert_eq!(cycles[0].commanded, home());
}

#[test]
fn cycle_times_outside_the_range_are_refused() {
    for cycle_s in [0.0, 0.0002, 0.011, f64::NAN] {
        assert!(Trajectory::new(home(), &[], &axes(), &Dynamics::default(), cycle_s).is_err());
    }
    for cycle_s in [0.00025, 0.010] {
        assert!(Trajectory::new(home(), &[], &axes(), &Dynamics::default(), cycle_s).is_ok());
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    /// Polylines of any shape: feed, path acceleration and jerk hold on every span; so does the acceleration of the
    /// sampled positions away from corners.
    #[test]
    fn feed_acceleration_and_jerk_hold(
        points in prop::collection::vec((0.0..850.0_f64, 0.0..500.0_f64, 0.0..500.0_f64), 1..12),
        feed in 60.0..20_000.0_f64, radius in 1.0..100.0_f64,
    ) {
        let mut text = format!("F{feed}\n");
        for (k, (x, y, z)) in points.iter().enumerate() {
            text.push_str(&format!("G1 X{x:.6} Y{y:.6} Z{z:.6}\n"));
            // a circle now and then, where it fits
            if k % 3 == 0 && x + 2.0 * radius < 850.0 && y + radius < 500.0 && y - radius > 0.0 {
                text.push_str(&format!("G2 X{x:.6} Y{y:.6} I{radius:.6} J0\n"));
            }
        }
        let dynamics = Dynamics::default();
        let (t, cycles) = run(&text, 0.002);
        let limit = feed / 60.0;
        for pair in cycles.windows(2) {
            let step = norm(&minus(&pair[1].commanded, &pair[0].commanded));
            prop_assert!(step <= limit * 0.002 * (1.0 + 1e-6) + 1e-9, "{step} at {}", pair[0].line);
            prop_assert!(pair[1].feed_mm_per_min <= feed * (1.0 + 1e-9));
        }
        let dt = t.duration_s() / 5000.0;
        let mut before = t.along(0.0);
        for k in 1..5000 {
            let now = t.along(f64::from(k) * dt);
            prop_assert!(now.acceleration.abs() <= dynamics.acceleration_mm_per_s2 * (1.0 + 1e-6));
            prop_assert!(
                (now.acceleration - before.acceleration).abs()
                    <= dynamics.jerk_mm_per_s3 * dt * (1.0 + 1e-6) + 1e-3
            );
            before = now;
        }
        for three in cycles.windows(3) {
            if three[0].line == three[2].line {
                let second = minus(
                    &minus(&three[2].commanded, &three[1].commanded),
                    &minus(&three[1].commanded, &three[0].commanded),
                );
                let a = norm(&second) / (0.002 * 0.002);
                prop_assert!(a <= dynamics.acceleration_mm_per_s2 * (1.0 + 1e-3) + 1e-2, "{a}");
            }
        }
        let end = interpret(&text, &axes(), home()).unwrap().segments.last().unwrap().end;
        prop_assert_eq!(cycles.last().unwrap().commanded, end);
    }
}

#[test]
fn dwells_are_segments_of_their_own() {
    let program = interpret("G4 P1.5", &axes(), home()).unwrap();
    assert!(matches!(program.segments[0].shape, Shape::Dwell(s) if s == 1.5));
}
