//! `volcomp identify fivedof` as a user runs it: the reference vectors, and files.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test runs the program on files")]

use std::path::Path;
use std::process::{Command, Output};

use serde_json::{Value, json};

fn volcomp(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcomp"))
        .args(["identify", "fivedof"])
        .args(args)
        .current_dir(folder)
        .output()
        .unwrap()
}

fn json_of(output: &Output) -> Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn check_case(case: &Value) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("case.json"), case.to_string()).unwrap();
    let got = json_of(&volcomp(folder.path(), &["--input", "case.json", "--json"]));
    let compare = |got: &Value, expected: &Value| {
        for (key, value) in expected.as_object().unwrap() {
            let limit = if key == "EY" || key == "EZ" { 1e-12 } else { 1e-15 };
            let (g, e) = (got[key].as_f64().unwrap(), value.as_f64().unwrap());
            assert!((g - e).abs() <= limit, "{} {key}: {g} instead of {e}", case["id"]);
        }
    };
    compare(&got, &case["expect"]);
    compare(&got["without_drift_compensation"], &case["expect_without_drift_compensation"]);
}

/// FIVEDOF-o3: the two beams drift differently.
#[test]
fn kept_vector() {
    check_case(&json!({"id": "FIVEDOF-o3", "sense": "carriage",
        "focal": {"f1": 188.9, "f2": 138.0, "f3": 227.2}, "distance": 2988.1,
        "beam_1_yz": [-26.96, 7.6], "beam_2_yz": [26.68, 7.6],
        "readings": {"PSD1_y": 0.01413421582, "PSD1_z": 0.01627175155, "PSD2_y": -0.0003242724,
            "PSD2_z": -0.000270963, "PSD3_y": -0.00040084896, "PSD3_z": -0.00094206208,
            "QD2_y": -0.00206072196, "QD2_z": -0.00192138982, "QD1_y": 0.00143834314, "QD1_z": -0.01889210472},
        "expect": {"EY": 0.005713, "EZ": 0.00392, "EA": -3.6589e-05, "EB": 4.2088e-05, "EC": -3.6237e-05},
        "expect_without_drift_compensation": {"EY": -0.00048307892627143923, "EA": -0.0001581908547725578,
            "EB": 4.306975e-05, "EC": -3.74119e-05}}));
}

#[test]
fn reference_vectors() {
    let file: Value = serde_json::from_str(include_str!("../vectors/fivedof.json")).unwrap();
    file["cases"].as_array().unwrap().iter().for_each(check_case);
}

const HEAD: &str = "format = \"volcomp-fivedof/1\"\nfocal-mm = { psd1 = 200, psd2 = 200, psd3 = 200 }\n\
    beam-1-mm = [-30, 0]\nbeam-2-mm = [30, 0]\n";

/// Columns of axis Y: lateral directions z and x.
fn header() -> String {
    let mut text = String::from("position_mm,distance_mm");
    for detector in ["psd1", "psd2", "psd3", "qd1", "qd2"] {
        for letter in ["z", "x"] {
            text.push_str(&format!(",{detector}_{letter}_um"));
        }
    }
    text
}

/// A Y run: the carriage bows by 4 um in z, pitches about x by up to 3 arcsec, rolls by 6 arcsec; um on the detectors.
fn run_y(level: bool) -> String {
    let mut text = header() + if level { ",level_arcsec\n" } else { "\n" };
    for i in 0..=10 {
        let s = f64::from(i) / 10.0;
        let arcsec = std::f64::consts::PI / 648_000.0;
        let (bow, roll, about_x) = (4.0 * 4.0 * s * (1.0 - s), 6.0 * arcsec * s, 3.0 * arcsec * s);
        // laser coordinates (y, z, x): first lateral z, second lateral x; EC is about the second, x
        let psd1 = [200e3 * -2.0 * about_x, 0.0];
        let cube = |y: f64| [bow, 1e3 * roll * y];
        text.push_str(&format!("{},{}", 50 * i, 400 + 50 * i));
        let pairs = [psd1, [0.0; 2], [0.0; 2], cube(30.0).map(|v| 2.0 * v), cube(-30.0).map(|v| 2.0 * v)];
        for v in pairs.as_flattened() {
            text.push_str(&format!(",{v:.7}"));
        }
        if level {
            text.push_str(&if i % 10 == 0 { format!(",{:.4}", 6.0 * s) } else { ",".to_owned() });
        }
        text.push('\n');
    }
    text
}

#[test]
fn a_run_of_y_becomes_curves_in_either_sense() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("y.csv"), run_y(true)).unwrap();
    std::fs::write(folder.path().join("head.toml"), HEAD).unwrap();
    let common = ["--data", "y.csv", "--calibration", "head.toml", "--axis", "y", "--basis", "table"];
    let with = |more: &[&str]| volcomp(folder.path(), &[&common[..], more].concat());
    let r = json_of(&with(&["--json"]));
    let last = |key: &str| r[key].as_array().unwrap()[10].as_f64().unwrap();
    assert!((last("eay_arcsec") - 3.0).abs() < 1e-4, "{r:#}");
    assert!((last("eby_arcsec") - 6.0).abs() < 1e-4, "{r:#}");
    assert!(
        (r["ezy_um"][5].as_f64().unwrap() - 4.0).abs() < 1e-4
            && r["exy_um"][5].as_f64().unwrap().abs() < 1e-3
    );

    let chain = ["--chain", "[w X' Y' b Z t]", "--point-mm", "10,250,-600", "--out", "m.toml"];
    let refused = with(&chain);
    assert_eq!(refused.status.code(), Some(64));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("say --sense carriage"));
    let read = |more: &[&str]| {
        let output = with(&[&chain[..], more].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        std::fs::read_to_string(folder.path().join("m.toml")).unwrap()
    };
    let relative = read(&["--sense", "carriage"]);
    assert!(
        relative.contains("sense = \"relative\"") || !relative.contains("sense = \"carriage\""),
        "{relative}"
    );
    assert!(relative.contains("[10, 250, -600]"), "{relative}");
    let value = |text: &str, symbol: &str| -> Vec<f64> {
        let at = text.find(&format!("[errors.{symbol}.table]")).unwrap();
        let list = text[at..].split("value-").nth(1).unwrap();
        let list = &list[list.find('[').unwrap() + 1..list.find(']').unwrap()];
        list.split(',').map(str::trim).filter(|v| !v.is_empty()).map(|v| v.parse().unwrap()).collect()
    };
    // the table carries the workpiece: what the carriage does, the tool does the other way round
    assert!((value(&relative, "ezy")[5] + 4.0).abs() < 1e-3);
    assert!((value(&relative, "eby")[10] + 6.0).abs() < 1e-3);
    let carriage = read(&["--sense", "carriage", "--store", "carriage"]);
    assert!(carriage.contains("sense = \"carriage\""), "{carriage}");
    // over the carriage's own displacement -500 .. 0
    assert!((value(&carriage, "eby")[0] - 6.0).abs() < 1e-3);
}

#[test]
fn without_a_level_roll_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("y.csv"), run_y(false)).unwrap();
    std::fs::write(folder.path().join("head.toml"), HEAD).unwrap();
    let args = ["--data", "y.csv", "--calibration", "head.toml", "--axis", "y", "--json"];
    let output = volcomp(folder.path(), &args);
    assert!(String::from_utf8_lossy(&output.stderr).contains("roll is left out"));
    assert!(json_of(&output).get("eby_arcsec").is_none());
    let r = json_of(&volcomp(folder.path(), &[&args[..], &["--roll", "detrended"]].concat()));
    assert!(r["eby_arcsec"][10].as_f64().unwrap().abs() < 1e-9);
    let half = run_y(true).replace(",6.0000\n", ",\n");
    std::fs::write(folder.path().join("y.csv"), half).unwrap();
    let output = volcomp(folder.path(), &args);
    assert_eq!(output.status.code(), Some(65));
    assert!(String::from_utf8_lossy(&output.stderr).contains("must be read at both ends, 0 and 500 mm"));
}

#[test]
fn a_resting_log_with_one_distance_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut text = header().replace("position_mm,", "") + "\n";
    for i in 0..40 {
        let d = f64::from(i * i % 17);
        text.push_str(&format!("500,{}\n", [d; 10].map(|v| v.to_string()).join(",")));
    }
    std::fs::write(folder.path().join("rest.csv"), text).unwrap();
    std::fs::write(folder.path().join("head.toml"), HEAD).unwrap();
    let output =
        volcomp(folder.path(), &["--resting", "rest.csv", "--calibration", "head.toml", "--axis", "y"]);
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(65), "{message}");
    assert!(message.contains("rest.csv: the log has one distance only (500.0 mm)"), "{message}");
}
