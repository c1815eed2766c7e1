//! Circles: state from the angle, at any phase to the quadrants and any step of time.

use core::f64::consts::{PI, TAU};

use super::*;

/// A ballbar in the YZ plane, counter-clockwise and clockwise, at a constant feed.
#[derive(Debug, Clone, Copy)]
struct Ballbar {
    /// Samples per turn.
    count: u32,
    /// Place of the first sample, in steps from a quadrant.
    phase: f64,
    radius: f64,
    feed_mm_per_min: f64,
    moving: Option<f64>,
}

/// Position, velocity and acceleration of Y and Z, their directions, distances and times since reversal.
struct Truth {
    velocity: [f64; 2],
    acceleration: [f64; 2],
    since_s: [f64; 2],
    since: [f64; 2],
}

impl Ballbar {
    fn is(count: u32, phase: f64) -> Self {
        Self { count, phase, radius: 100.0, feed_mm_per_min: 3000.0, moving: Some(1.0) }
    }

    fn rate(self) -> f64 {
        self.feed_mm_per_min / 60.0 / self.radius
    }

    /// Angle travelled, rad, and the way, of each row.
    fn angles(self) -> impl Iterator<Item = (f64, f64)> {
        let angle = move |k: u32| (f64::from(k) + self.phase) * TAU / f64::from(self.count);
        [1.0, -1.0].into_iter().flat_map(move |way| (0..self.count).map(move |k| (angle(k), way)))
    }

    /// Coordinates with five decimals, times with three.
    fn raw(self, instrument: &str) -> Raw {
        let names = ["t_s", "setup", "run", "repeat", "y_mm", "z_mm", "u_x", "u_y", "u_z", "deviation_um"];
        let mut raw = Raw::made_up("c.csv", &names);
        let mut moving = Vec::new();
        for (i, (angle, way)) in self.angles().enumerate() {
            let (sine, cosine) = (PI + way * angle).sin_cos();
            let round = |v: f64, digits: f64| (v * digits).round() / digits;
            let [y, z] = [cosine, sine].map(|v| round(self.radius * v, 1e5));
            let t = round(angle / self.rate() + if way > 0.0 { 10.0 } else { 300.0 }, 1e3);
            let run = if way > 0.0 { 1.0 } else { 2.0 };
            let deviation = 3.0 * (0.7 * i as f64).sin();
            raw.push(instrument, i as u64 + 2, &[t, 1.0, run, 1.0, y, z, 0.0, cosine, sine, deviation]);
            moving.extend(self.moving);
        }
        if self.moving.is_some() {
            raw.names.push("moving".into());
            raw.columns.push(moving);
        }
        raw
    }

    fn truth(self) -> Vec<Truth> {
        let (r, w) = (self.radius, self.rate());
        let first = self.angles().next().unwrap().0;
        let of = |(angle, way): (f64, f64)| {
            let (sine, cosine) = (PI + way * angle).sin_cos();
            // Y turns round at each half turn, Z a quarter later
            let since = [angle, angle - 0.5 * PI].map(|a| {
                let since = a.rem_euclid(PI);
                if angle - first < since { f64::INFINITY } else { since }
            });
            Truth {
                velocity: [-r * w * way * sine, r * w * way * cosine],
                acceleration: [-r * w * w * cosine, -r * w * w * sine],
                since_s: since.map(|s| s / w),
                since: since.map(|s| if s.is_finite() { r * (1.0 - s.cos()) } else { s }),
            }
        };
        self.angles().map(of).collect()
    }

    fn check(self, instrument: &str) {
        let s = build(self.raw(instrument)).unwrap();
        let near = |found: f64, expected: f64, limit: f64| {
            found == expected || (found - expected).abs() <= limit * expected.abs().max(1.0)
        };
        for (i, (m, truth)) in s.moments.iter().zip(self.truth()).enumerate() {
            for (k, slot) in [1, 2].into_iter().enumerate() {
                let told = format!("{self:?}, row {i}, axis {slot}");
                let v = truth.velocity[k];
                assert!(near(m.velocity[slot], v, 1e-3), "{told}: {} of {v} mm/s", m.velocity[slot]);
                let a = truth.acceleration[k];
                assert!(near(m.acceleration[slot], a, 1e-2), "{told}: {} of {a}", m.acceleration[slot]);
                if v.abs() > 1e-6 {
                    assert_eq!(m.direction[slot], v.signum(), "{told}: {v} mm/s");
                    let since = (m.since_mm[slot], truth.since[k]);
                    assert!(near(since.0, since.1, 1e-3), "{told}: {since:?} mm");
                    let since_s = (m.since_s[slot], truth.since_s[k]);
                    assert!(near(since_s.0, since_s.1, 5e-3), "{told}: {since_s:?} s");
                }
            }
        }
    }
}

#[test]
fn the_state_on_a_circle_does_not_depend_on_the_phase_to_the_quadrants() {
    for count in [12, 36, 72, 100, 144, 360] {
        for phase in [0.5, 0.25, 0.1, 0.49999] {
            Ballbar::is(count, phase).check("ballbar");
        }
    }
}

#[test]
fn slow_circles_in_motion_have_velocities() {
    let slow = Ballbar { radius: 150.0, feed_mm_per_min: 1000.0, ..Ballbar::is(72, 0.5) };
    slow.check("ballbar");
    slow.check("grid encoder");
    Ballbar { feed_mm_per_min: 300.0, ..slow }.check("ballbar");
    // a ballbar is read in motion
    Ballbar { moving: None, ..slow }.check("ballbar");
    let at_rest = |b: Ballbar, instrument: &str| {
        build(b.raw(instrument)).unwrap().moments.iter().all(|m| m.velocity == [0.0; 6])
    };
    assert!(at_rest(Ballbar { moving: None, ..slow }, "probe"), "holes on a circle");
    assert!(at_rest(Ballbar { moving: Some(0.0), ..slow }, "ballbar"), "the file says so");
    assert!(at_rest(Ballbar { count: 10, ..slow }, "ballbar"), "too few for the way between");
}

#[test]
fn a_circle_whose_feed_changes_has_the_velocity_of_each_place() {
    let mut raw = Ballbar::is(360, 0.5).raw("ballbar");
    // twice as fast in the second half of each turn
    let half = |i: usize| if i % 360 < 180 { 1.0 } else { 0.5 };
    let mut t = 0.0;
    for (i, slot) in column(&mut raw, "t_s").iter_mut().enumerate() {
        t += if i == 360 { 100.0 } else { 0.035 * half(i) };
        *slot = t;
    }
    let s = build(raw).unwrap();
    for (i, m) in s.moments.iter().enumerate().filter(|(i, _)| ![179, 180].contains(&(i % 360))) {
        let speed = m.velocity[1].hypot(m.velocity[2]);
        let expected = TAU * 100.0 / 360.0 / 0.035 / half(i);
        assert!((speed - expected).abs() < 1e-3 * expected, "row {i}: {speed} of {expected} mm/s");
    }
}

#[test]
fn an_axis_at_its_vertex_has_not_turned_yet() {
    let s = build(Ballbar::is(72, 0.0).raw("ballbar")).unwrap();
    // Z is at its ends at a quarter and three quarters of the first turn
    let directions = |rows: [usize; 3]| rows.map(|i| s.moments[i].direction[2]);
    assert_eq!(directions([17, 18, 19]), [-1.0, -1.0, 1.0]);
    assert_eq!(directions([53, 54, 55]), [1.0, 1.0, -1.0]);
    assert!(s.moments[19].since_mm[2] > 0.3 && s.moments[19].since_mm[2] < 0.4);
}

/// Directions and ways are those of the angle, too, where the times are an order; no speed follows from one.
#[test]
fn in_ordinal_times_a_circle_has_directions_and_no_velocities() {
    let ballbar = Ballbar::is(72, 0.5);
    let timed = build(ballbar.raw("ballbar")).unwrap();
    let mut raw = ballbar.raw("ballbar");
    raw.columns[0] = (0..raw.len()).map(|i| i as f64).collect();
    raw.times = Some(Times::Ordinal);
    let ordered = build(raw).unwrap();
    for (a, b) in timed.moments.iter().zip(&ordered.moments) {
        assert_eq!((a.direction, a.since_mm), (b.direction, b.since_mm));
        assert_eq!((b.velocity, b.acceleration), ([0.0; 6], [0.0; 6]));
        assert_eq!(b.since_s[1], f64::INFINITY);
    }
}

#[test]
fn notes_say_what_was_derived_and_nothing_else() {
    let derived = |raw: Raw| {
        let notes = build(raw).unwrap().notes;
        notes.into_iter().map(|n| n.text).filter(|t| t.contains("derived")).collect::<Vec<_>>()
    };
    let mut raw = Ballbar::is(72, 0.5).raw("ballbar");
    assert_eq!(
        derived(raw.clone()),
        [
            "c.csv: velocity, acceleration, direction of travel, distance and time since reversal of y, z derived from the angle on the circle"
        ]
    );
    let add = |raw: &mut Raw, name: &str, values: &dyn Fn(&Truth) -> f64| {
        raw.names.push(name.into());
        raw.columns.push(Ballbar::is(72, 0.5).truth().iter().map(values).collect());
    };
    for (k, axis) in ["y", "z"].into_iter().enumerate() {
        add(&mut raw, &format!("dir_{axis}"), &|t| t.velocity[k].signum());
        add(&mut raw, &format!("v{axis}_mm_per_s"), &|t| t.velocity[k]);
    }
    assert_eq!(
        derived(raw.clone()),
        [
            "c.csv: acceleration, distance and time since reversal of y, z derived from the angle on the circle"
        ]
    );
    for (k, axis) in ["y", "z"].into_iter().enumerate() {
        add(&mut raw, &format!("a{axis}_mm_per_s2"), &|t| t.acceleration[k]);
        add(&mut raw, &format!("since_reversal_{axis}_mm"), &|t| t.since[k]);
        add(&mut raw, &format!("since_reversal_{axis}_s"), &|t| t.since_s[k]);
    }
    assert_eq!(derived(raw), Vec::<String>::new());
}
