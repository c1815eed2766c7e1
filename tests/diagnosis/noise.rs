//! The white noise of each instrument, where only some of them repeat, and beside causes that differ between neighbours.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes files")]

use core::f64::consts::TAU;
use std::fmt::Write as _;

use serde_json::Value;

use crate::cli::declared;
use crate::instruments::diagnose;
use crate::support::normal;

const BALLBAR_UM: f64 = 0.4;
const LASER_UM: f64 = 0.3;

/// A circle of 100 mm in XY to and fro, each once, with a reading every `step_deg`, and three cycles along Y with a scale error of
/// 20 um/m. `error_um`: of X by its position and direction.
fn session(step_deg: f64, seed: u64, error_um: impl Fn(f64, f64) -> f64) -> Value {
    let mut noise = normal(seed);
    let mut table = "t_s,instrument,setup,run,repeat,x_mm,y_mm,u_x,u_y,u_z,deviation_um\n".to_owned();
    let (mut t_s, mut run) = (0.0, 0);
    for sign in [1.0, -1.0] {
        run += 1;
        for k in 0..(360.0 / step_deg) as usize {
            let (sin, cos) = (sign * step_deg * (k as f64 + 0.5)).to_radians().sin_cos();
            let (x, y) = (200.0 + 100.0 * cos, 200.0 + 100.0 * sin);
            let read_um = error_um(x, -sign * sin) * cos + 0.02 * y * sin + BALLBAR_UM * noise();
            t_s += step_deg.to_radians() * 6.0;
            writeln!(table, "{t_s:.3},ballbar,1,{run},1,{x:.4},{y:.4},{cos:.7},{sin:.7},0,{read_um:.3}")
                .unwrap();
        }
        t_s += 30.0;
    }
    for cycle in 1..=3 {
        for sign in [1.0, -1.0] {
            run += 1;
            for k in 0..11 {
                let y = 31.7 * f64::from(if sign > 0.0 { k } else { 10 - k });
                t_s += 9.0;
                let read_um = 0.02 * y + LASER_UM * noise();
                writeln!(table, "{t_s:.3},laser,2,{run},{cycle},100,{y:.1},0,1,0,{read_um:.3}").unwrap();
            }
        }
    }
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("session.csv");
    std::fs::write(&path, table).unwrap();
    diagnose(&path, &[]).0
}

fn assert_noise(r: &Value, case: &str) {
    for (name, truth) in [("ballbar", BALLBAR_UM), ("laser", LASER_UM)] {
        let all = r["noise"].as_array().unwrap();
        let white_um = all.iter().find(|n| n["instrument"] == name).unwrap()["white_um"].as_f64().unwrap();
        assert!((0.6..1.6).contains(&(white_um / truth)), "{case}: {name} {white_um}, not {truth}");
    }
    let [noise_um, rms_um] = ["noise_um", "rms_um"].map(|k| r["gap"][k].as_f64().unwrap());
    assert!(noise_um < rms_um, "{case}: {noise_um} of {rms_um}");
}

/// Circles that pass by the same places both ways, once each: their noise is that of neighbours on the path, not of the other pass.
#[test]
fn a_ballbar_without_repeats_has_the_noise_of_its_path() {
    for seed in 1..=3 {
        let r = session(8.0, seed, |_, velocity| if velocity < 0.0 { 6.0 } else { 0.0 });
        assert_noise(&r, &seed.to_string());
        assert_eq!(declared(&r), ["backlash:x", "scale:y"], "{seed}");
        assert_ne!(r["verdict"], "unexplained", "{seed}");
    }
}

/// A wave of 8 mm that a circle samples coarsely differs between neighbours: beside it the noise is what is left.
#[test]
fn the_noise_of_a_circle_is_judged_beside_a_periodic_error() {
    for seed in 1..=2 {
        let r = session(1.5, seed, |x, _| 5.0 * (x * TAU / 8.0).sin());
        assert_noise(&r, &seed.to_string());
        assert!(declared(&r).contains(&"cyclic:x".to_owned()), "{seed}: {:?}", declared(&r));
    }
}

/// Positioning tests of three axes while the hall warms and cools, one after another; the structure lifts Z by some um/K, 700 s behind
/// the hall, whose temperature is logged, and the laser wanders by `drift_um` within 1500 s.
fn in_a_hall(seed: u64, um_per_k: f64, drift_um: f64) -> Value {
    let mut noise = normal(seed);
    let hall_k = |t: f64| 0.8 * (t / 900.0).sin() + 0.5 * (t / 410.0 + 1.0).sin();
    let mut table = "t_s,instrument,setup,run,repeat,x_mm,y_mm,z_mm,u_x,u_y,u_z,dir_x,dir_y,dir_z,deviation_um,moving,temp_ambient_degc\n"
        .to_owned();
    let (mut t_s, mut run, mut structure_k, mut laser_um) = (0.0, 0, hall_k(0.0), 0.0);
    for axis in 0..3 {
        for repeat in 1..=3 {
            for sign in [1.0, -1.0] {
                run += 1;
                for k in 0..11 {
                    for _ in 0..8 {
                        t_s += 5.0;
                        structure_k += (hall_k(t_s) - structure_k) * 5.0 / 700.0;
                        laser_um +=
                            drift_um * (2.0 * 5.0f64 / 1500.0).sqrt() * noise() - laser_um * 5.0 / 1500.0;
                    }
                    let at = sign * (40.0 * f64::from(k) - 200.0);
                    let error_um = [0.02 * at, 2.0 * sign, um_per_k * structure_k][axis];
                    let (x, y, z) = [(at, 0.0, 0.0), (0.0, at, 0.0), (0.0, 0.0, at)][axis];
                    let along = |value: f64| [0, 1, 2].map(|a| if a == axis { value } else { 0.0 });
                    let ([u, v, w], [p, q, r]) = (along(1.0), along(sign));
                    let (read_um, hall) =
                        (error_um + laser_um + 0.4 * noise(), 20.0 + hall_k(t_s) + 0.02 * noise());
                    writeln!(
                        table,
                        "{t_s:.0},laser,{axis},{run},{repeat},{x},{y},{z},{u},{v},{w},{p},{q},{r},{read_um:.3},0,{hall:.3}"
                    )
                    .unwrap();
                }
            }
        }
    }
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("hall.csv");
    std::fs::write(&path, table).unwrap();
    diagnose(&path, &[]).0
}

#[test]
fn what_follows_a_logged_temperature_is_no_drift_of_the_instrument() {
    for seed in 1..=3 {
        let report = in_a_hall(seed, 4.0, 0.0);
        let mut found = declared(&report);
        found.sort();
        assert_eq!(found, ["ambient-drift:", "backlash:y", "scale:x"], "seed {seed}: {}", report["causes"]);
        assert_eq!(report["verdict"], "explained", "seed {seed}");
        let left_um = report["shrink"]["rms_after_um"].as_f64().unwrap();
        assert!(left_um < 1.2 * 0.4, "seed {seed}: {left_um}");
    }
}

#[test]
fn a_drift_of_the_instrument_follows_no_logged_temperature() {
    for seed in 1..=4 {
        let report = in_a_hall(seed, 0.0, 2.0);
        let found = declared(&report);
        assert!(found.contains(&"backlash:y".to_owned()), "seed {seed}: {}", report["causes"]);
        let others = found.iter().filter(|c| !["backlash:y", "scale:x"].contains(&c.as_str()));
        assert_eq!(others.count(), 0, "seed {seed}: {}", report["causes"]);
    }
}

/// A probe at one place every 190 s along three directions; a cooling unit moves the structure to and fro within nine readings.
fn beside_a_cooling_unit(seed: u64, amplitude_um: f64) -> Value {
    let mut noise = normal(seed);
    let mut table =
        "t_s,instrument,setup,run,repeat,x_mm,y_mm,z_mm,u_x,u_y,u_z,deviation_um,moving\n".to_owned();
    for k in 0..115 {
        let t_s = 190.0 * f64::from(k);
        // linear up and down again
        let phase = (t_s / 1700.0 + 0.1 * seed as f64).fract();
        let swing = if phase < 0.4 { phase / 0.2 - 1.0 } else { 1.0 - (phase - 0.4) / 0.3 };
        for (axis, share) in [1.0, 0.3, -0.25].into_iter().enumerate() {
            let [u, v, w] = [0, 1, 2].map(|a| i32::from(a == axis));
            let read_um = share * amplitude_um * swing + 0.6 * noise();
            writeln!(table, "{t_s},probe,1,1,1,100,200,-50,{u},{v},{w},{read_um:.3},0").unwrap();
        }
    }
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("log.csv");
    std::fs::write(&path, table).unwrap();
    diagnose(&path, &[]).0
}

#[test]
fn the_cycle_of_a_cooling_unit_is_unexplained_and_no_noise() {
    for seed in 1..=3 {
        let report = beside_a_cooling_unit(seed, 12.0);
        assert_eq!(declared(&report), Vec::<String>::new(), "{seed}");
        assert_eq!(report["verdict"], "unexplained", "{seed}");
        let looks = report["unexplained"]["looks_like"].as_str().unwrap();
        let period_s: f64 =
            looks.split("a cycle of ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
        assert!((period_s - 1700.0).abs() < 30.0, "{looks}");
        let left_um = report["unexplained"]["rms_um"].as_f64().unwrap();
        assert!((3.0..6.0).contains(&left_um), "{left_um}");
        let [rms_um, noise_um] = ["rms_um", "noise_um"].map(|key| report["gap"][key].as_f64().unwrap());
        assert!(noise_um < 0.6 * rms_um, "{noise_um} of {rms_um}");
        assert_eq!(beside_a_cooling_unit(seed, 0.0)["verdict"], "no-gap", "{seed}");
    }
}
