//! Rough error curves, as screws and guideways have them: in single tests and beside other errors in a campaign; and the slope of
//! a straightness test among other programs.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes and reads files")]

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use super::instruments::{cause, diagnose, parameter, run, text};
use crate::support::normal;

pub(crate) const HALF_MM: f64 = 200.0;
pub(crate) const NOISE_UM: f64 = 0.3;

/// A curve with independent values every 40 mm, straight lines between, um; counted from its least-squares line.
fn rough(seed: u64) -> impl Fn(f64) -> f64 {
    let mut value = normal(seed);
    let mut knots: Vec<f64> = (0..11).map(|_| 3.0 * value()).collect();
    let mean = knots.iter().sum::<f64>() / 11.0;
    let slope = knots.iter().enumerate().map(|(k, v)| (k as f64 - 5.0) * v).sum::<f64>() / 110.0;
    knots.iter_mut().enumerate().for_each(|(k, v)| *v -= mean + slope * (k as f64 - 5.0));
    move |x: f64| {
        let place = (x / HALF_MM + 1.0) * 5.0;
        let k = (place.floor() as usize).min(9);
        knots[k] + (place - k as f64) * (knots[k + 1] - knots[k])
    }
}

/// Lines there and back three times, each a set-up of its own with an offset.
pub(crate) struct Lines {
    text: String,
    /// The middle of all lines, mm.
    pub(crate) middle_mm: [f64; 3],
    noise: Box<dyn FnMut() -> f64>,
    setup: u32,
    run: u32,
    t_s: f64,
}

impl Lines {
    pub(crate) fn new(seed: u64) -> Self {
        let text = "t_s,instrument,setup,run,repeat,x_mm,y_mm,z_mm,dir_x,dir_y,dir_z,moving,u_x,u_y,u_z,deviation_um\n";
        Self {
            text: text.to_owned(),
            middle_mm: [0.0; 3],
            noise: Box::new(normal(seed)),
            setup: 0,
            run: 0,
            t_s: 0.0,
        }
    }

    /// From `-end` to `end` and back, measured along `u`; `error` of position and direction of travel, um.
    pub(crate) fn line(
        &mut self,
        end: [f64; 3],
        u: [f64; 3],
        targets: u32,
        error: &dyn Fn([f64; 3], [f64; 3]) -> [f64; 3],
    ) {
        self.setup += 1;
        let offset = 5.0 * (self.noise)();
        for repeat in 1..=3 {
            for sense in [1.0, -1.0] {
                self.run += 1;
                for k in 0..targets {
                    self.t_s += 1.3 + 0.2 * f64::from(k % 3);
                    let share = sense * (2.0 * f64::from(k) / f64::from(targets - 1) - 1.0);
                    let [p, d] = [
                        end.map(|v| share * v),
                        end.map(|v| if v == 0.0 { 0.0 } else { sense * v.signum() }),
                    ];
                    let e: f64 = error(p, d).iter().zip(u).map(|(e, u)| e * u).sum();
                    let deviation = e + offset + NOISE_UM * (self.noise)();
                    let p: [f64; 3] = core::array::from_fn(|k| p[k] + self.middle_mm[k]);
                    writeln!(
                        self.text,
                        "{:.1},laser,{},{},{repeat},{:.3},{:.3},{:.3},{},{},{},0,{:.9},{:.9},{:.9},{deviation:.2}",
                        self.t_s, self.setup, self.run, p[0], p[1], p[2], d[0], d[1], d[2], u[0], u[1], u[2]
                    )
                    .unwrap();
                }
            }
        }
    }

    pub(crate) fn report(&self) -> Value {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("lines.csv");
        std::fs::write(&path, &self.text).unwrap();
        diagnose(&path, &[]).0
    }
}

pub(crate) fn along(axis: usize, length: f64) -> [f64; 3] {
    core::array::from_fn(|k| if k == axis { length } else { 0.0 })
}

pub(crate) fn declared(report: &Value) -> Vec<String> {
    let mut all = super::cli::declared(report);
    all.sort();
    all
}

#[test]
fn a_rough_guideway_is_a_straightness_error() {
    for seed in 1..=4 {
        let curve = rough(seed);
        let mut test = Lines::new(10 + seed);
        test.line(along(0, HALF_MM), along(1, 1.0), 17, &|p, _| [0.0, curve(p[0]), 0.0]);
        let report = test.report();
        assert_eq!(declared(&report), ["straightness:eyx"], "seed {seed}");
        assert_eq!(report["verdict"], "explained", "seed {seed}");
        let left = report["shrink"]["rms_after_um"].as_f64().unwrap();
        assert!(left < 1.3 * NOISE_UM, "seed {seed}: {left} um left");
    }
}

#[test]
fn rough_screws_of_two_axes_are_positioning_errors_of_each() {
    const SESSIONS: u64 = 16;
    // of one session what is left is chance to a fifth
    let mut all_left = 0.0;
    for seed in 1..=SESSIONS {
        let curves = [rough(seed), rough(100 + seed)];
        let error = |p: [f64; 3], d: [f64; 3]| [curves[0](p[0]), 0.0, curves[1](p[2]) - 3.0 * d[2]];
        let mut tests = Lines::new(40 + seed);
        for axis in [0, 2] {
            tests.line(along(axis, HALF_MM), along(axis, 1.0), 17, &error);
        }
        let report = tests.report();
        assert_eq!(declared(&report), ["backlash:z", "positioning:x", "positioning:z"], "seed {seed}");
        let left = report["shrink"]["rms_after_um"].as_f64().unwrap();
        assert!(left < 1.5 * NOISE_UM, "seed {seed}: {left} um left");
        all_left += left / SESSIONS as f64;
    }
    assert!(all_left < 1.2 * NOISE_UM, "{all_left} um left");
}

#[test]
fn a_rough_screw_hides_no_other_error_of_a_campaign() {
    for seed in 1..=3 {
        let curve = rough(seed);
        let error = |p: [f64; 3], d: [f64; 3]| [curve(p[0]) + 0.05 * p[1], -3.0 * d[1] + 0.04 * p[1], 0.0];
        let mut campaign = Lines::new(20 + seed);
        for axis in 0..3 {
            campaign.line(along(axis, HALF_MM), along(axis, 1.0), 17, &error);
        }
        for signs in [[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, -1.0]] {
            let root = 3f64.sqrt();
            campaign.line(signs.map(|s| s * HALF_MM), signs.map(|s| s / root), 9, &error);
        }
        let report = campaign.report();
        assert_eq!(
            declared(&report),
            ["backlash:y", "positioning:x", "scale:y", "squareness:xy"],
            "seed {seed}"
        );
        assert!((parameter(&report, "scale", "y", "scale_ppm") - 40.0).abs() < 3.0);
        assert_eq!(report["verdict"], "explained", "seed {seed}");
        let left = report["shrink"]["rms_after_um"].as_f64().unwrap();
        assert!(left < 1.5 * NOISE_UM, "seed {seed}: {left} um left");
    }
}

/// A random walk of steps of 5 mm, as pitch errors add up, smoothed over 25 mm; counted from its least-squares line, `size_um` RMS.
fn walk(seed: u64, size_um: f64) -> impl Fn(f64) -> f64 {
    let mut step = normal(seed);
    let raw: Vec<f64> = (0..=84).scan(0.0, |sum, _| Some(std::mem::replace(sum, *sum + step()))).collect();
    let mut knots: Vec<f64> = raw.windows(5).map(|w| w.iter().sum::<f64>() / 5.0).collect();
    let (n, middle) = (knots.len() as f64, (knots.len() - 1) as f64 / 2.0);
    let mean = knots.iter().sum::<f64>() / n;
    let from_middle = |k: usize| k as f64 - middle;
    let square: f64 = (0..knots.len()).map(|k| from_middle(k).powi(2)).sum();
    let slope = knots.iter().enumerate().map(|(k, v)| from_middle(k) * v).sum::<f64>() / square;
    knots.iter_mut().enumerate().for_each(|(k, v)| *v -= mean + slope * from_middle(k));
    let rms = (knots.iter().map(|v| v * v).sum::<f64>() / n).sqrt();
    move |x: f64| {
        let place = (x / HALF_MM + 1.0) * middle;
        let k = (place.floor() as usize).min(knots.len() - 2);
        size_um / rms * (knots[k] + (place - k as f64) * (knots[k + 1] - knots[k]))
    }
}

/// A screw and a guideway that are rough, and a backlash: lines along and across the axes and diagonals, each of its own number of
/// targets; `more` targets on another day.
fn campaign(seed: u64, noise: u64, more: u32) -> Lines {
    let (screw, guideway) = (walk(seed, 10.0), walk(50 + seed, 10.0));
    let error = |p: [f64; 3], d: [f64; 3]| [screw(p[0]), -1.5 * d[1], guideway(p[1])];
    let mut campaign = Lines::new(noise);
    for (axis, targets) in [(0, 21), (1, 17), (2, 17)] {
        campaign.line(along(axis, HALF_MM), along(axis, 1.0), targets + more, &error);
    }
    campaign.line(along(1, HALF_MM), along(2, 1.0), 23 + more, &error);
    for (signs, targets) in
        [([1.0, 1.0, 0.0], 31), ([1.0, -1.0, 0.0], 26), ([0.0, 1.0, 1.0], 29), ([1.0, 0.0, -1.0], 28)]
    {
        campaign.line(signs.map(|s| s * HALF_MM), signs.map(|s| s / 2f64.sqrt()), targets + more, &error);
    }
    campaign
}

/// What a polynomial leaves of such curves differs from program to program, for each has its own targets: it once passed for periodic and
/// angular errors, and then nothing was declared.
#[test]
fn what_a_polynomial_leaves_of_a_rough_curve_is_no_effect_of_its_own() {
    for seed in 1..=4 {
        let report = campaign(seed, 80 + seed, 0).report();
        assert_eq!(
            declared(&report),
            ["backlash:y", "positioning:x", "straightness:ezy"],
            "seed {seed}: {}",
            report["verdict"]
        );
        assert_ne!(report["verdict"], "unexplained", "seed {seed}");
        let notes = report["notes"].to_string();
        assert!(
            notes.contains("roughness of ") && notes.contains("beyond the polynomial"),
            "seed {seed}: {notes}"
        );
    }
}

/// Both take out what the polynomials leave, at targets that nobody read before, too.
#[test]
fn forecast_and_addition_hold_the_roughness_of_curves() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    for seed in 1..=2 {
        std::fs::write(d.join("one.csv"), campaign(seed, 80 + seed, 0).text).unwrap();
        std::fs::write(d.join("other.csv"), campaign(seed, 90 + seed, 5).text).unwrap();
        let done = run(d, Path::new("one.csv"), &["--fresh", "other.csv"]);
        assert!(done.status.success(), "{}", text(&done.stderr));
        let report: Value = serde_json::from_slice(&done.stdout).unwrap();
        let fresh = &report["fresh"];
        assert_eq!(fresh["within_forecast"], true, "seed {seed}: {} {fresh}", report["shrink"]);
        // the polynomials alone leave 2.1 and 2.8 times the noise
        let left = fresh["rms_after_um"].as_f64().unwrap();
        assert!(left < 1.6 * NOISE_UM, "seed {seed}: {left} um left");
        std::fs::copy(d.join("out/addition.toml"), d.join("first.toml")).unwrap();
        let model = ["--model", "out/model.toml", "--add", "first.toml", "--out", "extended.toml"];
        let extend = Command::new(env!("CARGO_BIN_EXE_volcomp"))
            .args([&["model", "extend"][..], &model].concat())
            .current_dir(d)
            .output()
            .unwrap();
        assert!(extend.status.success(), "{}", text(&extend.stderr));
        for with in [["--add", "first.toml"], ["--model", "extended.toml"]] {
            let done = run(d, Path::new("other.csv"), &with);
            assert!(done.status.success(), "{}", text(&done.stderr));
            let closed: Value = serde_json::from_slice(&done.stdout).unwrap();
            let gap = closed["gap"]["rms_um"].as_f64().unwrap();
            assert!((gap - left).abs() < 0.03 * left, "seed {seed}, {with:?}: {gap} and {left} um");
        }
    }
}

#[test]
fn the_addition_of_a_curve_is_valid_where_readings_look_along_it() {
    let directory = tempfile::tempdir().unwrap();
    let bend = |p: [f64; 3], _: [f64; 3]| [-0.04 * p[0], 6.0 * (p[0] / 100.0).powi(2), 0.0];
    let mut campaign = Lines::new(7);
    campaign.line(along(0, HALF_MM), along(0, 1.0), 17, &bend);
    campaign.line(along(1, HALF_MM), along(1, 1.0), 17, &bend);
    campaign.line(along(0, 0.5 * HALF_MM), along(1, 1.0), 27, &bend);
    campaign.line(along(0, 0.5 * HALF_MM), along(2, 1.0), 17, &bend);
    std::fs::write(directory.path().join("one.csv"), campaign.text).unwrap();
    let done = run(directory.path(), Path::new("one.csv"), &[]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let addition = std::fs::read_to_string(directory.path().join("out/addition.toml")).unwrap();
    let addition: toml::Table = addition.parse().unwrap();
    for effect in addition["effect"].as_array().unwrap() {
        let half = if effect["name"].as_str() == Some("straightness") { 0.5 * HALF_MM } else { HALF_MM };
        let [low, high] = [0, 1].map(|k| effect["valid"]["x_mm"][k].as_float().unwrap());
        assert_eq!([low, high], [-half, half], "{}", effect["name"]);
    }
    assert_eq!(addition["effect"].as_array().unwrap().len(), 2, "{addition}");
}

#[test]
fn the_reference_line_of_a_straightness_test_is_no_squareness_among_other_programs() {
    let mut campaign = Lines::new(31);
    let none = |_: [f64; 3], _: [f64; 3]| [0.0; 3];
    for axis in 0..3 {
        campaign.line(along(axis, HALF_MM), along(axis, 1.0), 17, &none);
        let across = (axis + 1) % 3;
        // the straightedge stands at an angle of 30 urad
        campaign.line(along(axis, HALF_MM), along(across, 1.0), 17, &|p, _| along(across, 0.03 * p[axis]));
    }
    let report = campaign.report();
    assert!(declared(&report).is_empty(), "{:?}", declared(&report));
    assert_eq!(report["verdict"], "no-gap");
    let notes = report["notes"].to_string();
    assert!(notes.contains(":2, ") && notes.contains("slope of each set-up"), "{notes}");
    // what shows it all the same: a line of both axes in one set-up
    let square = |p: [f64; 3], _: [f64; 3]| [-0.05 * p[1], 0.0, 0.0];
    for sign in [1.0, -1.0] {
        let (end, root) = ([HALF_MM, sign * HALF_MM, 0.0], 2f64.sqrt());
        campaign.line(end, [1.0 / root, sign / root, 0.0], 17, &square);
    }
    let report = campaign.report();
    assert_eq!(cause(&report, "squareness", "xy")["declared"], true, "{:?}", declared(&report));
}
