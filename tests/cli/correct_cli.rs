//! `volcomp correct`: what comes out is nominal minus what `predict` says, and a refusal leaves no file.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes files and starts programs")]

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

fn volcomp(args: &[&str], folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcomp")).args(args).current_dir(folder).output().unwrap()
}

#[test]
fn a_program_is_corrected_by_what_predict_says() {
    let folder = tempfile::tempdir().unwrap();
    let model = concat!(env!("CARGO_MANIFEST_DIR"), "/config/examples/gantry-5ax/model.toml");
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("in.nc", "G0 X1000 Y500 Z-300 A20 C40 (start)\nG1 X1010 F1000\n");
    let output = volcomp(
        &["correct", "--model", model, "--gcode", "in.nc", "--out", "out.nc", "--json"],
        folder.path(),
    );
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["blocks"], 2);
    assert!(report["rest_x_um"].as_f64().unwrap() < 0.01, "five axes bring the tip back: {report}");
    write("points.csv", "x_mm,y_mm,z_mm,a_deg,c_deg\n1000,500,-300,20,40\n");
    let output =
        volcomp(&["predict", "--model", model, "--points", "points.csv", "--out", "-"], folder.path());
    let text = String::from_utf8(output.stdout).unwrap();
    let mut lines = text.lines().map(|l| l.split(',').collect::<Vec<_>>());
    let (head, row) = (lines.next().unwrap(), lines.next().unwrap());
    let program = std::fs::read_to_string(folder.path().join("out.nc")).unwrap();
    let first = program.lines().next().unwrap();
    assert!(first.ends_with(" (start)"), "{first}");
    for (axis, nominal, column, unit) in [
        ("X", 1000.0, "cx_um", 1e-3),
        ("Y", 500.0, "cy_um", 1e-3),
        ("Z", -300.0, "cz_um", 1e-3),
        ("A", 20.0, "ca_arcsec", 1.0 / 3600.0),
        ("C", 40.0, "cc_arcsec", 1.0 / 3600.0),
    ] {
        let word = first.split(' ').find_map(|w| w.strip_prefix(axis)).unwrap();
        let k = head.iter().position(|h| *h == column).unwrap();
        let want = nominal + unit * row[k].parse::<f64>().unwrap();
        assert!((word.parse::<f64>().unwrap() - want).abs() < 2e-6, "{axis}: {word} instead of {want}");
    }
}

#[test]
fn blocks_beyond_the_range_of_a_curve_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write(
        "model.toml",
        "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w b X Y t]\"\n[axes.x]\ntravel-mm = [0, 800]\n\
         [errors.exx.table]\nposition-mm = [0, 400]\nvalue-um = [0, 40]\n",
    );
    write("in.nc", "O1234 (part)\nT1 M6\nG0 X100 Y0\nG1 X500 F1000\nX700\n");
    let args = ["correct", "--model", "model.toml", "--gcode", "in.nc", "--out", "out.nc", "--json"];
    let output = volcomp(&args, folder.path());
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{said}");
    assert!(
        said.contains("in.nc: 2 blocks, the first in line 4, beyond the range of a curve of X"),
        "{said}"
    );
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["held"], serde_json::json!([{"axis": "x", "blocks": 2, "line": 4}]));
    assert!(
        std::fs::read_to_string(folder.path().join("out.nc")).unwrap().starts_with("O1234 (part)\nT1 M6\n")
    );
}

#[test]
fn what_is_refused_has_a_place_and_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let model = concat!(env!("CARGO_MANIFEST_DIR"), "/config/examples/vmc-850/model.toml");
    std::fs::write(folder.path().join("in.nc"), "G0 X10 Y10 Z-10\nG2 X20 I5 F100\n").unwrap();
    let base = ["correct", "--model", model, "--gcode", "in.nc", "--out", "out.nc"];
    for (extra, code, said) in [
        (
            &[][..],
            65,
            "error: in.nc:2:1: G2 (arc) is not corrected; let the CAM system output straight lines",
        ),
        (&["--limit-um", "0.001"][..], 65, "error: in.nc:1:12: correction of "),
        (&["--axes", "q"][..], 64, "unknown axis 'q'"),
        (&["--axes", "a"][..], 64, "axis A is not in the chain of the model"),
        (&["--start", "x"][..], 64, "invalid AXIS=VALUE"),
    ] {
        let output = volcomp(&[&base[..], extra].concat(), folder.path());
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(code) && text.contains(said), "{extra:?}: {text}");
        assert!(!folder.path().join("out.nc").exists());
    }
}

#[test]
fn words_that_are_not_understood_are_refused_and_a_byte_order_mark_stays() {
    let folder = tempfile::tempdir().unwrap();
    let model = concat!(env!("CARGO_MANIFEST_DIR"), "/config/examples/vmc-850/model.toml");
    let args = ["correct", "--model", model, "--gcode", "in.nc", "--out", "out.nc"];
    for (block, said) in [
        ("G1 X1e-05 F100", "in.nc:3:4: X with an exponent is not corrected; write the number out"),
        ("L200 P3", "in.nc:3:1: L200 (subprogram) is not corrected; write its blocks out"),
        ("T0202", "in.nc:3:1: a second tool; split the program"),
        ("G54 P1", "in.nc:3:5: P1 (additional work offset) is not corrected"),
    ] {
        let program = format!("T0101\nG0 X10 Y10 Z-10\n{block}\n");
        std::fs::write(folder.path().join("in.nc"), program).unwrap();
        let output = volcomp(&args, folder.path());
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(65) && text.contains(said), "{block}: {text}");
        assert!(!folder.path().join("out.nc").exists());
    }
    std::fs::write(folder.path().join("in.nc"), "\u{feff}G0 X10 Y10 Z-10\n").unwrap();
    assert!(volcomp(&args, folder.path()).status.success());
    assert!(std::fs::read_to_string(folder.path().join("out.nc")).unwrap().starts_with("\u{feff}G0 X"));
}
