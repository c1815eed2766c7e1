//! `volcomp identify kalman`: the reference vectors, and a recording that becomes a map.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test reads and writes files")]

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;
use volcomp::model::ErrorSymbol;

fn volcomp(directory: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcomp")).current_dir(directory).args(args).output().unwrap()
}

fn list(v: &Value) -> Vec<f64> {
    v.as_array().unwrap_or_else(|| panic!("{v} is no list")).iter().map(|n| n.as_f64().unwrap()).collect()
}

#[test]
fn every_case_gives_the_expected_states_and_variances() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let path = root.join("tests/vectors/kalman.json");
    let file: Value = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
    let tolerance = |key: &str| file["tolerance"][key].as_f64().unwrap();
    for case in file["cases"].as_array().unwrap() {
        let id = case["id"].as_str().unwrap();
        let output =
            volcomp(root, &["identify", "kalman", "--input", path.to_str().unwrap(), "--case", id, "--json"]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let got: Value = serde_json::from_slice(&output.stdout).unwrap();
        for (key, want) in case["expect"].as_object().unwrap() {
            let relative = if key == "state" { tolerance("state_rel") } else { tolerance("variance_rel") };
            let (have, want) = (list(&got[key]), list(want));
            assert_eq!(have.len(), want.len(), "{id} {key}");
            let size = want.iter().fold(0.0f64, |a, w| a.max(w.abs()));
            for (a, b) in have.iter().zip(&want) {
                let scale = if key == "state" { size } else { b.abs() };
                assert!((a - b).abs() <= relative * scale, "{id} {key}: {a} instead of {b}");
            }
        }
    }
}

/// A twist of the ram in arcsec that no product of the model's own curves can hold.
fn twist(x: f64, y: f64, z: f64) -> f64 {
    1.5 + 3.0 * x / 800.0 - 2.0 * (y / 300.0) * (z / 250.0)
}

#[test]
fn a_recording_becomes_a_grid_in_the_model() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    let mut csv = String::from("t_s,x_mm,y_mm,z_mm,eaz_arcsec\n");
    let mut state = 1u64;
    let mut even = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    for i in 0..400 {
        let (x, y, z) = (800.0 * even(), 300.0 * even(), 250.0 * even());
        // the sum of twelve is near enough to normal
        let noise = 0.5 * ((0..12).map(|_| even()).sum::<f64>() - 6.0);
        let spike = if i == 200 { 300.0 } else { 0.0 };
        csv.push_str(&format!("{i},{x},{y},{z},{}\n", twist(x, y, z) + noise + spike));
    }
    std::fs::write(d.join("ram.csv"), csv).unwrap();
    let args = [
        "identify",
        "kalman",
        "--data",
        "ram.csv",
        "--first",
        "0,400,800",
        "--second",
        "0,300",
        "--third",
        "0,250",
        "--sigma",
        "4",
        "--correlation-mm",
        "400",
        "--noise",
        "2",
        "--adaptive",
        "--json",
        "--out",
        "m.toml",
        "--chain",
        "[w b X Y Z t]",
        "--machine",
        "g1",
    ];
    let output = volcomp(d, &args);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let got: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((got["readings"].as_u64(), got["rejected"].as_u64()), (Some(400), Some(1)));
    // the spike is not in it
    assert!(got["mean_ratio"].as_f64().unwrap() < 1.5, "{got}");
    let noise = got["noise_arcsec"].as_f64().unwrap();
    assert!((noise / 0.5 - 1.0).abs() < 0.15, "{noise}");
    let text = std::fs::read_to_string(d.join("m.toml")).unwrap();
    let spec = volcomp::config::model::parse("m.toml", &text).unwrap();
    let symbol = ErrorSymbol::parse("eaz").unwrap();
    let (_, function) = spec.errors.iter().find(|(s, _)| *s == symbol).unwrap();
    for (x, y, z) in [(0.0, 0.0, 0.0), (800.0, 300.0, 250.0), (123.0, 200.0, 77.0)] {
        let (value, _) = function.grids[0].value(&[z, y, x]);
        let off = value.to_degrees() * 3600.0 - twist(x, y, z);
        assert!(off.abs() < 0.5, "{x} {y} {z}: off by {off}");
    }
    // the same data again find little to add to the map they made
    let again = volcomp(d, &[&args[..18], &["--into", "m.toml", "--out", "m2.toml"]].concat());
    assert!(again.status.success(), "{}", String::from_utf8_lossy(&again.stderr));
    let got: Value = serde_json::from_slice(&again.stdout).unwrap();
    assert!(list(&got["change_arcsec"]).iter().all(|c| c.abs() < 0.5), "{got}");
    let text = std::fs::read_to_string(d.join("m2.toml")).unwrap();
    let spec = volcomp::config::model::parse("m2.toml", &text).unwrap();
    assert_eq!(spec.errors.iter().find(|(s, _)| *s == symbol).unwrap().1.grids.len(), 1);
}

#[test]
fn bad_recordings_are_refused_with_their_place() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    let base = [
        "identify",
        "kalman",
        "--data",
        "r.csv",
        "--first",
        "0,1",
        "--second",
        "0,1",
        "--third",
        "0,1",
        "--sigma",
        "1",
        "--noise",
        "1",
        "--chain",
        "[w b X Y Z t]",
    ];
    for (csv, extra, code, expected) in [
        ("x_mm,y_mm,z_mm\n", &[][..], 65, "no column with an error"),
        ("x_mm,y_mm,z_mm,eaz_um\n", &[], 65, "unknown column"),
        ("x_mm,y_mm,eaz_arcsec\n", &[], 65, "column z_mm is missing"),
        ("x_mm,y_mm,z_mm,eaz_arcsec,ebz_arcsec\n", &[], 65, "filter one error at a time"),
        ("x_mm,y_mm,z_mm,eaz_arcsec\n1,1,1,one\n", &[], 65, "r.csv:2:7: eaz_arcsec: 'one' is not a number"),
        ("x_mm,y_mm,z_mm,eaz_arcsec\n1,1,1,2e3\n", &[], 65, "no reading was accepted"),
        ("x_mm,y_mm,z_mm,eaz_arcsec\n1,1,1,1e6\n", &[], 65, "r.csv:2:7: eaz_arcsec: reaches 1000000 arcsec"),
        ("t_s,x_mm,y_mm,z_mm,eaz_arcsec\n5,1,1,1,0\n4,1,1,1,0\n", &[], 65, "4 s is before the row above"),
        ("x_mm,y_mm,z_mm,eaz_arcsec\n1,1,1,0\n", &["--walk-per-sqrt-h", "1"], 65, "needs the column t_s"),
        ("x_mm,y_mm,z_mm,eaz_arcsec\n1,1,1,0\n", &["--axes", "x,y"], 64, "a grid has three"),
        ("x_mm,y_mm,z_mm,eaz_arcsec\n1,1,1,0\n", &["--axes", "x,y,c"], 64, "invalid linear axis"),
    ] {
        std::fs::write(d.join("r.csv"), csv).unwrap();
        let output = volcomp(d, &[&base[..], extra].concat());
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(code), "{csv:?}: {message}");
        assert!(message.contains(expected), "{csv:?} gives {message:?}");
    }
    let case = r#"{"grid": {"x": [0], "y": [0, 1], "z": [0, 1]}, "x0": [], "P0": {"sigma": 1}, "Q_diag": 0, "R": 1, "observations": []}"#;
    std::fs::write(d.join("c.json"), case).unwrap();
    let output = volcomp(d, &["identify", "kalman", "--input", "c.json"]);
    assert_eq!(output.status.code(), Some(65));
    assert!(String::from_utf8_lossy(&output.stderr).contains("grid x: 1 positions"));
}
