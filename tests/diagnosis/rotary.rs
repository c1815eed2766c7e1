//! Tests of rotary axes: readings are angles, and what shifts the axis is not seen in them.

use std::fmt::Write;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

use super::instruments::diagnose;

/// A table with the columns of ISO 230-2 for a rotary axis: five cycles over the whole turn and back; `angle_arcsec` of
/// position (deg) and direction.
fn test(seed: u64, noise_arcsec: f64, angle_arcsec: &dyn Fn(f64, f64) -> f64) -> String {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut table = "cycle,direction,target_deg,deviation_arcsec\n".to_owned();
    for cycle in 1..=5 {
        for sign in [1.0, -1.0] {
            for k in 0..13 {
                let target = 30.0 * f64::from(if sign > 0.0 { k } else { 12 - k });
                let normal: f64 = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
                let deviation = angle_arcsec(target, sign) + noise_arcsec * normal;
                writeln!(table, "{cycle},{sign},{target},{deviation:.3}").unwrap();
            }
        }
    }
    table
}

fn report(table: &str, model: Option<&str>, axis: &str) -> Value {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("c.csv");
    std::fs::write(&path, table).unwrap();
    let mut options = vec!["--axis", axis];
    let model_path = directory.path().join("model.toml");
    if let Some(model) = model {
        std::fs::write(&model_path, model).unwrap();
        options.extend(["--model", model_path.to_str().unwrap()]);
    }
    diagnose(&path, &options).0
}

fn declared(report: &Value) -> Vec<String> {
    let causes = report["causes"].as_array().unwrap().iter().filter(|c| c["declared"] == true);
    let mut all: Vec<String> = causes
        .map(|c| format!("{}:{}", c["effect"].as_str().unwrap(), c["subject"].as_str().unwrap()))
        .collect();
    all.sort();
    all
}

#[test]
fn an_eccentric_scale_is_no_location_of_the_axis() {
    for (seed, axis) in [(1, "c"), (2, "a"), (3, "b"), (4, "c")] {
        let phase = f64::from(seed as u32) * 1.7;
        let truth = |q: f64, sign: f64| {
            5.0 * ((q.to_radians() + phase).sin() - phase.sin()) + if sign < 0.0 { 2.0 } else { 0.0 }
        };
        let found = report(&test(seed, 0.3, &truth), None, axis);
        assert_eq!(
            declared(&found),
            [format!("backlash:{axis}"), format!("rotary-eccentricity:{axis}")],
            "{seed}"
        );
        for cause in found["causes"].as_array().unwrap() {
            assert_ne!(cause["effect"], "rotary-location", "translations are not seen in angles");
            let group = cause["confounded_with"].to_string();
            assert!(!group.contains("rotary-location") && !group.contains("rotary-motion"), "{group}");
        }
    }
}

/// A machine whose rotary axis is displaced, turns with an error of its own, and stands on crooked linear axes.
fn machine(chain: &str) -> String {
    format!(
        r#"format = "volcomp-model/1"
machine = "m"
chain = "{chain}"

[frame]
tool-tip-mm = [3, -4, -200]

[axes.c]
point-mm = [20, -10, 0]

[errors]
ex0c.constant.value-um = 40.0
ey0c.constant.value-um = -25.0
ec0y.constant.value-arcsec = 12.0

[errors.ecc.fourier]
span-deg = 360
period-deg = 360
cos-arcsec = [0.0, 1.5]
sin-arcsec = [6.0]
"#
    )
}

#[test]
fn a_model_predicts_the_angle_on_either_side_of_the_chain() {
    let truth = |q: f64, _: f64| {
        let q = q.to_radians();
        6.0 * q.sin() + 1.5 * (2.0 * q).cos()
    };
    for chain in ["[w C' b X Y Z t]", "[w b X Y Z C t]"] {
        let found = report(&test(5, 0.3, &truth), Some(&machine(chain)), "c");
        let of = |key: &str| found["gap"][key].as_f64().unwrap();
        assert!(of("rms_um") < 1.2 * of("noise_um"), "{chain}: {}", found["gap"]);
        assert_eq!(declared(&found), [""; 0], "{chain}");
        let without = report(&test(5, 0.3, &truth), None, "c");
        assert!(without["gap"]["rms_um"].as_f64().unwrap() > 10.0 * of("rms_um"));
    }
}
