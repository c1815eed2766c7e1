//! Circular tests through `volcomp diagnose`, as a ballbar records them: one plane, at one feed and at two.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes and reads files")]

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::process::{Command, Stdio};

use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

use crate::instruments::{cause, diagnose, parameter, text};
use crate::support::normal;

/// What is wrong with a machine whose circles have 150 mm.
#[derive(Debug, Clone, Copy, Default)]
struct Truth {
    /// EC0Y, rad.
    squareness_rad: f64,
    /// Of X and Y, um/m.
    scale_ppm: [f64; 2],
    /// Of X and Y, um.
    backlash_um: [f64; 2],
    /// Amplitude of a wave of 10 mm in X, um.
    wave_um: f64,
    /// Bow of EYX at the ends of the circle, um.
    bow_um: f64,
    /// Lag of X and Y, ms.
    lag_ms: [f64; 2],
    /// The ballbar is longer than stated, and grows over the whole test, um.
    length_um: f64,
    growth_um: f64,
    /// Angle of the first reading, deg.
    start_deg: f64,
}

impl Truth {
    /// One to four errors, each well above the noise.
    fn random(rng: &mut ChaCha8Rng) -> Self {
        let mut truth = Self::default();
        for _ in 0..rng.random_range(1..=4) {
            let sign = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
            match rng.random_range(0..8) {
                0 => truth.squareness_rad = sign * rng.random_range(15e-6..100e-6),
                1 => truth.scale_ppm[0] = sign * rng.random_range(10.0..50.0),
                2 => truth.scale_ppm[1] = sign * rng.random_range(10.0..50.0),
                3 => truth.backlash_um[0] = sign * rng.random_range(1.5..8.0),
                4 => truth.backlash_um[1] = sign * rng.random_range(1.5..8.0),
                5 => truth.wave_um = rng.random_range(0.8..3.0),
                6 => truth.bow_um = sign * rng.random_range(3.0..10.0),
                _ => truth.lag_ms = [1.0, 1.0 + sign * rng.random_range(0.1..0.5)],
            }
        }
        truth
    }

    /// The effects that have these errors; a mismatch of servos has no axis of its own.
    fn names(&self) -> BTreeSet<&'static str> {
        let [mx, my] = self.lag_ms;
        [
            (self.squareness_rad, "squareness:xy"),
            (self.scale_ppm[0], "scale:x"),
            (self.scale_ppm[1], "scale:y"),
            (self.backlash_um[0], "backlash:x"),
            (self.backlash_um[1], "backlash:y"),
            (self.wave_um, "cyclic:x"),
            (self.bow_um, "straightness:eyx"),
            (mx - my, "servo-mismatch"),
        ]
        .into_iter()
        .filter_map(|(size, name)| (size != 0.0).then_some(name))
        .collect()
    }

    /// Circles at some feeds (mm/min) about a centre (mm), in both directions, with normal noise.
    fn circles(&self, feeds: &[f64], centre: [f64; 2], noise_um: f64, seed: u64) -> String {
        let mut table = "angle_deg,deviation_um,direction,feed_mm_per_min\n".to_owned();
        let mut noise = normal(seed);
        let mut done = 0.0;
        for feed in feeds {
            for direction in [1.0, -1.0] {
                for k in 0..360 {
                    let angle = self.start_deg + f64::from(k) * direction;
                    let (sin, cos) = angle.to_radians().sin_cos();
                    let [x, y] = [centre[0] + 150.0 * cos, centre[1] + 150.0 * sin];
                    let velocity = [-direction * sin, direction * cos].map(|v| v * feed / 60.0);
                    // the mounting is off centre by (3, -2) um
                    let mut dx = 3.0 + 1e-3 * self.scale_ppm[0] * x - 1e3 * self.squareness_rad * y;
                    dx += self.wave_um * (x * std::f64::consts::TAU / 10.0).sin();
                    let mut dy = -2.0 + 1e-3 * self.scale_ppm[1] * y + self.bow_um * cos * cos;
                    for (i, d) in [&mut dx, &mut dy].into_iter().enumerate() {
                        *d -= 0.5 * self.backlash_um[i] * velocity[i].signum() + self.lag_ms[i] * velocity[i];
                    }
                    done += 1.0 / (720.0 * feeds.len() as f64);
                    let bar = self.length_um + self.growth_um * done;
                    let deviation = dx * cos + dy * sin - bar + noise_um * noise();
                    writeln!(table, "{angle},{deviation:.4},{direction},{feed}").unwrap();
                }
            }
        }
        table
    }
}

/// A cause declared.
#[derive(Debug)]
struct Declared {
    name: String,
    probability: f64,
    confounded_with: Vec<String>,
}

/// The causes declared in circles, by name, and the report.
fn declared(table: &str, centre: [f64; 2]) -> (Vec<Declared>, Value) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("circle.csv");
    std::fs::write(&path, table).unwrap();
    let centre = format!("--centre-mm={},{},-250", centre[0], centre[1]);
    let (report, _) = diagnose(&path, &["--radius-mm", "150", "--plane", "xy", &centre]);
    (declared_in(&report), report)
}

/// The causes declared in a report, by name.
fn declared_in(report: &Value) -> Vec<Declared> {
    let of = |c: &Value| {
        let (effect, subject) = (c["effect"].as_str().unwrap(), c["subject"].as_str().unwrap());
        let is_pair = effect == "servo-mismatch";
        Declared {
            name: if is_pair { effect.to_owned() } else { format!("{effect}:{subject}") },
            probability: c["probability"].as_f64().unwrap(),
            confounded_with: serde_json::from_value(c["confounded_with"].clone()).unwrap(),
        }
    };
    let causes = report["causes"].as_array().unwrap().iter().filter(|c| c["declared"] == true);
    let mut all: Vec<Declared> = causes.map(of).collect();
    all.sort_by(|a, b| a.name.cmp(&b.name));
    all
}

const CENTRE: [f64; 2] = [425.0, 250.0];

fn names(found: &[Declared]) -> Vec<&str> {
    found.iter().map(|d| d.name.as_str()).collect()
}

/// At 1000 mm/min the acceleration is 1.9 mm/s^2: a compliance that did this would be that of a soft spring.
#[test]
fn a_slow_circle_shows_a_squareness_and_no_effect_of_its_acceleration() {
    let truth = Truth { squareness_rad: 40e-6, ..Truth::default() };
    let (found, report) = declared(&truth.circles(&[1000.0], CENTRE, 0.3, 1), CENTRE);
    assert_eq!(names(&found), ["squareness:xy"]);
    assert!(found[0].probability > 0.9, "{found:?}");
    let of_acceleration = found[0].confounded_with.iter().find(|l| l.starts_with("inertial"));
    assert_eq!(of_acceleration, None, "mechanics do not allow it");
    let angle = parameter(&report, "squareness", "xy", "angle_arcsec");
    assert!((angle + 8.25).abs() < 0.3, "{angle}");
}

#[test]
fn circles_at_two_feeds_are_compared_exactly() {
    let truth = Truth { squareness_rad: -50e-6, backlash_um: [4.0, 0.0], ..Truth::default() };
    let (found, report) = declared(&truth.circles(&[500.0, 2000.0], CENTRE, 0.3, 2), CENTRE);
    assert_eq!(names(&found), ["backlash:x", "squareness:xy"]);
    assert!(found.iter().all(|d| d.probability > 0.9), "{found:?}");
    let width = parameter(&report, "backlash", "x", "width_um");
    assert!((width - 4.0).abs() < 0.3, "{width}");
}

/// Differences of places say that an axis has turned round one reading late, where the angle says when.
#[test]
fn a_reversal_error_is_known_from_the_first_reading_on() {
    for start_deg in [0.0, 7.13, 20.46] {
        let truth = Truth { backlash_um: [4.0, 7.0], start_deg, ..Truth::default() };
        let (found, report) = declared(&truth.circles(&[1000.0, 3000.0], CENTRE, 0.25, 8), CENTRE);
        assert_eq!(names(&found), ["backlash:x", "backlash:y"], "{start_deg}");
        assert!(
            report["shrink"]["rms_after_um"].as_f64().unwrap() < 0.3,
            "{start_deg}: {}",
            report["shrink"]
        );
        for (axis, wanted) in [("x", 4.0), ("y", 7.0)] {
            let width = parameter(&report, "backlash", axis, "width_um");
            assert!((width - wanted).abs() < 0.1, "{start_deg}, {axis}: {width}");
        }
    }
}

/// About this centre an angular error ECX is nearly the sum of both, and so is a tilt of 2000 " per m/s^2 under acceleration.
#[test]
fn one_effect_that_resembles_two_does_not_keep_them_out() {
    let truth = Truth { squareness_rad: -48.5e-6, scale_ppm: [25.0, 0.0], ..Truth::default() };
    let (found, _) = declared(&truth.circles(&[1000.0], CENTRE, 0.3, 3), CENTRE);
    assert_eq!(names(&found), ["scale:x", "squareness:xy"]);
}

/// A session file of the YZ circle that states positions, time and `moving`: 72 readings per turn, half a step beside the quadrants.
fn session(radius_mm: f64, feed_mm_per_min: f64, backlash_z_um: f64, lag_z_ms: f64) -> String {
    let mut table = "t_s,instrument,setup,run,repeat,y_mm,z_mm,u_x,u_y,u_z,deviation_um,moving\n".to_owned();
    let mut noise = normal(4);
    let speed = feed_mm_per_min / 60.0;
    for (run, direction) in [(1, 1.0), (2, -1.0)] {
        for k in 0..72 {
            let turned = (f64::from(k) + 0.5).to_radians() * 5.0;
            let (sin, cos) = (direction * turned).sin_cos();
            let t = 600.0 * f64::from(run) + radius_mm * turned / speed;
            let velocity = direction * speed * cos;
            let dz = -0.5 * backlash_z_um * velocity.signum() - lag_z_ms * velocity;
            let deviation = dz * sin + noise();
            let [y, z] = [radius_mm * cos, radius_mm * sin];
            writeln!(table, "{t:.3},ballbar,1,{run},1,{y:.5},{z:.5},0,{cos:.6},{sin:.6},{deviation:.2},1")
                .unwrap();
        }
    }
    table
}

/// Readings at equal places on both sides of a vertex, and readings 0.8 s apart, show when each axis turns round and how fast it is.
#[test]
fn a_session_of_a_circle_needs_positions_and_time_only() {
    for (table, wanted) in [
        (session(100.0, 3000.0, 20.0, 0.0), "backlash:z"),
        (session(150.0, 1000.0, 0.0, 1.2), "servo-mismatch"),
    ] {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("session.csv");
        std::fs::write(&path, &table).unwrap();
        let (report, _) = diagnose(&path, &[]);
        assert_eq!(report["verdict"], "explained", "{wanted}: {report}");
        assert_eq!(names(&declared_in(&report)), [wanted]);
    }
}

/// Without a calibrator the radius says nothing of the scales.
#[test]
fn a_wrong_length_is_that_of_the_ballbar() {
    for feeds in [&[1000.0][..], &[500.0, 2000.0]] {
        let truth = Truth { length_um: -5.0, backlash_um: [0.0, 4.0], ..Truth::default() };
        let (found, report) = declared(&truth.circles(feeds, CENTRE, 0.3, 5), CENTRE);
        assert_eq!(names(&found), ["backlash:y", "ballbar-length:"]);
        let length = parameter(&report, "ballbar-length", "", "length_error_um");
        assert!((length - 5.0).abs() < 0.3, "{length}");
        // one scale alone is no length
        let truth = Truth { scale_ppm: [30.0, 0.0], ..Truth::default() };
        let (found, _) = declared(&truth.circles(feeds, CENTRE, 0.3, 6), CENTRE);
        assert_eq!(names(&found), ["scale:x"]);
    }
}

/// On another day the bar is set to another length, 0.4 to 1.2 times as wrong, which is measured there.
#[test]
fn a_ballbar_set_anew_on_another_day_shrinks_as_forecast() {
    let directory = tempfile::tempdir().unwrap();
    let day = |feeds: &[f64], length_um: f64, seed: u64| {
        let truth = Truth { length_um, backlash_um: [0.0, 4.0], ..Truth::default() };
        let path = directory.path().join(format!("{seed}.csv"));
        std::fs::write(&path, truth.circles(feeds, CENTRE, 0.3, seed)).unwrap();
        path
    };
    // a campaign takes the length off, an answer from one circle names it
    let cases = [(&[1000.0][..], -4.0), (&[1000.0], 2.0), (&[1000.0], 6.0), (&[500.0, 1000.0, 2000.0], 9.0)];
    for (feeds, length_um) in cases {
        let (first, fresh) = (day(feeds, -5.0, 31), day(feeds, length_um, 32));
        let centre = format!("--centre-mm={},{},-250", CENTRE[0], CENTRE[1]);
        let options = ["--radius-mm", "150", "--plane", "xy", &centre, "--fresh", fresh.to_str().unwrap()];
        let (report, _) = diagnose(&first, &options);
        let seen = &report["fresh"];
        let after_um = seen["rms_after_um"].as_f64().unwrap();
        assert!((0.25..0.35).contains(&after_um), "{length_um}: {seen}");
        assert_eq!(seen["within_forecast"], true, "{length_um}: {seen}, {}", report["shrink"]);
    }
}

/// A bar that grows warm in the hand is a drift and makes no errors of the machine.
#[test]
fn a_ballbar_that_grows_names_no_error_of_the_machine() {
    for feeds in [&[1000.0][..], &[500.0, 2000.0]] {
        let truth = Truth { growth_um: 5.0, squareness_rad: 60e-6, ..Truth::default() };
        let (found, report) = declared(&truth.circles(feeds, CENTRE, 0.3, 7), CENTRE);
        let machine: Vec<&str> = names(&found).into_iter().filter(|n| *n != "ballbar-length:").collect();
        assert_eq!(machine, ["squareness:xy"], "{report}");
    }
}

/// Two seeds that had no part in the development gave 85 and 89 % of 80 machines exactly, and 1 and 5 of them a name outside its
/// group (docs/development/evidence.md). An angular error EAX, which is a squareness with a bow to one circle, names both.
#[test]
fn circles_of_random_machines_name_what_is_at_work_or_its_group() {
    let mut rng = ChaCha8Rng::seed_from_u64(31);
    let (mut exact, mut outside, mut report) = (0, 0, String::new());
    const MACHINES: usize = 24;
    for machine in 0..MACHINES {
        let truth = Truth::random(&mut rng);
        let centre = [rng.random_range(200.0..600.0), rng.random_range(150.0..400.0)];
        let noise_um = [0.2, 0.4, 0.8][machine % 3];
        let feeds: &[f64] = if machine % 2 == 0 { &[1000.0] } else { &[500.0, 2000.0] };
        let (found, _) = declared(&truth.circles(feeds, centre, noise_um, machine as u64), centre);
        let at_work = truth.names();
        let given: BTreeSet<&str> = found.iter().map(|d| d.name.as_str()).collect();
        exact += usize::from(given == at_work);
        let is_known = |d: &Declared| {
            let mut names = d.confounded_with.iter().map(String::as_str).chain([d.name.as_str()]);
            names.any(|n| at_work.iter().any(|w| n.starts_with(w)))
        };
        outside += usize::from(!found.iter().all(is_known));
        if given != at_work {
            writeln!(report, "{machine}: {at_work:?} {truth:?} -> {found:?}").unwrap();
        }
    }
    assert!(exact >= 17 && outside <= 3, "{exact} of {MACHINES} exact, {outside} outside\n{report}");
}

/// A circle at one feed in both directions, with a lost motion of 4 um in X and noise of some 0.2 um.
fn circle(readings: usize) -> String {
    let mut table = "angle_deg,deviation_um,direction,feed_mm_per_min\n".to_owned();
    for direction in [1.0, -1.0] {
        for k in 0..readings / 2 {
            let angle = 720.0 * k as f64 / readings as f64 * direction;
            let (sin, cos) = angle.to_radians().sin_cos();
            let noise = 0.7 * ((k as f64 * 12.9898 + direction).sin() * 43_758.545_3).fract();
            let deviation = 2.0 * (direction * sin).signum() * cos + noise;
            writeln!(table, "{angle:.6},{deviation:.5},{direction},1000").unwrap();
        }
    }
    table
}

/// A single feed is compared by evidence, whose matrices grow with the square of the readings that carry it.
#[test]
fn a_long_circle_at_one_feed_needs_little_memory_and_time() {
    let directory = tempfile::tempdir().unwrap();
    let mut seconds = Vec::new();
    for readings in [2_000, 20_000] {
        std::fs::write(directory.path().join("circle.csv"), circle(readings)).unwrap();
        let started = std::time::Instant::now();
        let done = Command::new("sh")
            .args(["-c", "ulimit -v 1000000; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_volcomp")])
            .args(["diagnose", "--json", "circle.csv", "--radius-mm", "150", "--centre-mm=425,250,-250"])
            .current_dir(directory.path())
            .stdin(Stdio::null())
            .output()
            .unwrap();
        seconds.push(started.elapsed().as_secs_f64());
        assert!(done.status.success(), "{readings}: {}", text(&done.stderr));
        let report: Value = serde_json::from_slice(&done.stdout).unwrap();
        let width = parameter(&report, "backlash", "x", "width_um");
        assert!((width - 4.0).abs() < 0.4, "{readings}: {width}");
        assert!(
            cause(&report, "backlash", "x")["probability"].as_f64().unwrap() > 0.95,
            "{readings}: {report}"
        );
    }
    // ten times the readings: at most ten times the time
    assert!(seconds[1] < 10.0 * seconds[0], "{seconds:?} s");
}
