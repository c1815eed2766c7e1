//! `volcomp identify straightness` as a user runs it: the reference vectors, and files.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test runs the program on files")]

use std::path::Path;
use std::process::{Command, Output};

use serde_json::{Value, json};

fn volcomp(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcomp"))
        .args(["identify", "straightness"])
        .args(args)
        .current_dir(folder)
        .output()
        .unwrap()
}

fn json_of(output: &Output) -> Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn message(output: &Output, code: i32) -> String {
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{text}");
    text
}

fn assert_expected(id: &Value, path: &str, got: &Value, expected: &Value) {
    match expected {
        Value::Object(object) => {
            for (key, value) in object {
                assert_expected(id, &format!("{path}.{key}"), &got[key], value);
            }
        }
        Value::Array(list) => {
            assert_eq!(got.as_array().map(Vec::len), Some(list.len()), "{id}{path}");
            for (i, value) in list.iter().enumerate() {
                assert_expected(id, &format!("{path}[{i}]"), &got[i], value);
            }
        }
        _ => {
            let limit = if path.ends_with("slope") { 1e-15 } else { 1e-12 };
            let (g, e) = (got.as_f64().unwrap_or(f64::NAN), expected.as_f64().unwrap());
            assert!((g - e).abs() <= limit, "{id}{path}: {g} instead of {e}");
        }
    }
}

fn check_case(case: &Value) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("case.json"), case.to_string()).unwrap();
    let got = json_of(&volcomp(folder.path(), &["--input", "case.json", "--json"]));
    assert_expected(&case["id"], "", &got, &case["expect"]);
}

#[test]
fn a_case_by_hand() {
    // contact at (0, 0) and (300, 0.001) below, (100, 0.004) above
    check_case(&json!({"id": "hand", "x": [0, 100, 200, 300], "y": [0, 0.004, 0.002, 0.001], "expect": {
        "end_point": {"slope": 0.001 / 300.0, "intercept": 0.0, "straightness": 0.004 - 0.001 / 3.0},
        "minimum_zone": {"slope": 0.001 / 300.0, "intercept": (0.004 - 0.001 / 3.0) / 2.0,
            "straightness": 0.004 - 0.001 / 3.0},
        "least_squares": {"slope": 1e-6, "intercept": 0.0016}}}));
}

#[test]
fn reference_vectors() {
    let file: Value = serde_json::from_str(include_str!("../vectors/straightness.json")).unwrap();
    file["cases"].as_array().unwrap().iter().for_each(check_case);
}

const SIGNS: &str = "format = \"volcomp-6d/1\"\ninstrument = \"6D no 7\"\n[x]\ndistance = \"+x\"\nhorizontal = \"-y\"\n\
    vertical = \"+z\"\nroll = \"-a\"\npitch = \"+b\"\nyaw = \"-c\"\n";

/// Tilts as this instrument reads them; `pitch` is the true sign of that channel.
fn tilts(pitch: f64) -> String {
    let mut text = String::from(
        "applied_ea_arcsec,applied_eb_arcsec,applied_ec_arcsec,distance_um,horizontal_um,vertical_um,roll_arcsec,pitch_arcsec,yaw_arcsec\n",
    );
    for about in 0..3 {
        for (k, tilt) in [0.0, 20.0, 0.0, -20.0].into_iter().enumerate() {
            let mut applied = [0.0; 3];
            applied[about] = tilt;
            let [a, b, c] = applied;
            let noise = if k % 2 == 0 { 0.05 } else { -0.05 };
            text.push_str(&format!(
                "{a},{b},{c},0.1,0,0,{},{},{}\n",
                -a + noise,
                pitch * b + noise,
                -c + noise
            ));
        }
    }
    text
}

/// Two cycles out and back along X; yaw grows by 10 arcsec, the carriage bows by 6 um in y.
fn run_x(reversal: f64) -> String {
    let mut text = String::from(
        "position_mm,cycle,direction,distance_um,horizontal_um,vertical_um,roll_arcsec,pitch_arcsec,yaw_arcsec\n",
    );
    for cycle in 1..=3 {
        for direction in [1, -1] {
            for i in 0..=10 {
                let s = f64::from(i) / 10.0;
                let back = if direction < 0 { -reversal } else { 0.0 };
                let wiggle = 0.1 * f64::from((i * 7 + cycle * 3 + direction) % 5 - 2);
                let y = 6.0 * 4.0 * s * (1.0 - s) + 30.0 * s + back + wiggle;
                text.push_str(&format!(
                    "{},{cycle},{direction},{},{},{},0,{},{}\n",
                    50 * i,
                    2.0 * s + wiggle,
                    -y,
                    wiggle,
                    wiggle,
                    -10.0 * s + wiggle
                ));
            }
        }
    }
    text
}

#[test]
fn signs_are_checked_for_parity_and_confirmed_by_tilts() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("x.csv", &run_x(0.0));
    write("signs.toml", SIGNS);
    let args = ["--data", "x.csv", "--axis", "x", "--signs", "signs.toml", "--json"];
    let bare = volcomp(folder.path(), &args);
    // -y alone is a mirror: roll and yaw of a right-handed instrument change sign with it
    assert!(message(&bare, 0).contains("no tilt test has confirmed them"));
    let straight = &json_of(&bare)["eyx"];
    assert!((straight["end_point"]["straightness_um"].as_f64().unwrap() - 6.0).abs() < 0.3, "{straight}");
    assert!((straight["end_point"]["slope_arcsec"].as_f64().unwrap() - 12.4).abs() < 0.3, "{straight}");

    write("wrong.toml", &SIGNS.replace("\"+b\"", "\"-b\""));
    let wrong = ["--data", "x.csv", "--axis", "x", "--signs", "wrong.toml", "--json"];
    let refused = message(&volcomp(folder.path(), &wrong), 78);
    assert!(refused.contains("is not a rotation of axes: pitch would turn against"), "{refused}");

    // an instrument that really is so: the tilt test proves it, and its word is kept in the table
    write("tilt.csv", &tilts(-1.0));
    let proven = volcomp(
        folder.path(),
        &[&wrong[..], &["--tilt-test", "tilt.csv", "--write-signs", "proven.toml"]].concat(),
    );
    assert!(message(&proven, 0).contains("the tilt test shows that it is so"));
    let again = ["--data", "x.csv", "--axis", "x", "--signs", "proven.toml", "--json"];
    assert!(!message(&volcomp(folder.path(), &again), 0).contains("warning"));
    // and contradicts the other table
    let contradiction = volcomp(folder.path(), &[&args[..], &["--tilt-test", "tilt.csv"]].concat());
    let text = message(&contradiction, 78);
    assert!(text.contains("pitch = \"+b\" in the sign table, but the tilt test shows \"-b\""), "{text}");
    let none = ["--data", "x.csv", "--axis", "x"];
    assert!(message(&volcomp(folder.path(), &none), 64).contains("with unknown signs"));
}

#[test]
fn reversal_is_kept_where_it_is_significant() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("signs.toml"), SIGNS).unwrap();
    let model = |reversal: f64| {
        std::fs::write(folder.path().join("x.csv"), run_x(reversal)).unwrap();
        let args = [
            "--data",
            "x.csv",
            "--axis",
            "x",
            "--signs",
            "signs.toml",
            "--chain",
            "[w b X Y Z t]",
            "--point-mm",
            "0,100,-300",
            "--out",
            "m.toml",
        ];
        let output = volcomp(folder.path(), &args);
        message(&output, 0);
        std::fs::read_to_string(folder.path().join("m.toml")).unwrap()
    };
    let with = model(3.0);
    let eyx = &with[with.find("errors.eyx").unwrap()..with.find("errors.ezx").unwrap()];
    assert!(eyx.contains("reverse-um"), "{eyx}");
    let without = model(0.0);
    assert!(!without.contains("reverse-um"), "{without}");
    assert!(without.contains("instrument = \"6D no 7\"") && without.contains("[0, 100, -300]"), "{without}");
}

#[test]
fn the_base_point_keeps_the_levers() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("signs.toml"), SIGNS).unwrap();
    std::fs::write(folder.path().join("x.csv"), run_x(0.0)).unwrap();
    let common = [
        "--data",
        "x.csv",
        "--axis",
        "x",
        "--signs",
        "signs.toml",
        "--chain",
        "[w b X Y Z t]",
        "--basis",
        "table",
        "--out",
        "m.toml",
    ];
    let output = volcomp(folder.path(), &[&common[..], &["--base-point-mm", "0,0,0"]].concat());
    assert!(message(&output, 64).contains("needs to know where the optics was"));
    let args =
        [&common[..], &["--abbe-mm", "0,100,0", "--bryan-mm", "0,0,0", "--base-point-mm", "0,0,0"]].concat();
    message(&volcomp(folder.path(), &args), 0);
    let model = std::fs::read_to_string(folder.path().join("m.toml")).unwrap();
    // EXX at the base point: 2 um + EC (100 mm - 0) = 2 + 10 arcsec * 100 mm = 2 + 4.85 um
    let exx = &model[model.find("errors.exx").unwrap()..model.find("errors.eyx").unwrap()];
    let list = &exx[exx.find("value-um = [").unwrap() + 12..];
    let list = list[..list.find(']').unwrap()].split(',').map(str::trim).filter(|v| !v.is_empty());
    let values: Vec<f64> = list.map(|v| v.parse().unwrap()).collect();
    assert!((values[10] - values[0] - 6.85).abs() < 0.3, "{values:?}");
}
