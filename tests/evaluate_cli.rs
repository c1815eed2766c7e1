//! `volcomp evaluate` on real tests and on bad input.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::print_stderr, reason = "a skipped test says so")]
#![expect(clippy::disallowed_methods, reason = "the test writes files")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

fn evaluate(test: &str, data: &Path, extra: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcomp"))
        .args(["evaluate", test, "--data"])
        .arg(data)
        .args(extra)
        .output()
        .unwrap()
}

fn shared(name: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/iso230_2_linear_axes").join(name);
    if path.exists() {
        return Some(path);
    }
    eprintln!("skipped: {} is not present", path.display());
    None
}

#[test]
fn real_axes_have_their_textbook_figures() {
    // B, R, E, M, A; the published values, to the digits they were published with
    for (file, expected, tolerance) in [
        ("ess_slits11360_example_data_ISO230_2.dat", [4.49, 14.34, 12.94, 9.24, 21.97], 0.005_001),
        ("ess_mcu1025_report.md_ISO230.dat", [43.46, 204.76, 74.77, 48.09, 204.76], 0.005_001),
        ("ess_target_b02_report_target_y.md_ISO230.dat", [20.0, 46.9, 100.1, 84.3, 125.7], 0.050_001),
    ] {
        let Some(path) = shared(file) else { return };
        let output = evaluate("iso230-2", &path, &["--json"]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let report: Value = serde_json::from_slice(&output.stdout).unwrap();
        for (key, want) in ["b_um", "r_um", "e_um", "m_um", "a_um"].into_iter().zip(expected) {
            let got = report[key].as_f64().unwrap();
            assert!((got - want).abs() <= tolerance, "{file} {key}: {got} instead of {want}");
        }
        for key in ["e_fwd_um", "e_bwd_um", "a_fwd_um", "a_bwd_um", "r_fwd_um", "r_bwd_um"] {
            assert!(report[key].as_f64().unwrap() > 0.0, "{file} {key}");
        }
    }
}

#[test]
fn csv_and_dat_give_the_same() {
    let Some(path) = shared("ess_target_b02_report_target_y.md_ISO230.dat") else { return };
    let text = std::fs::read_to_string(&path).unwrap();
    let mut targets = std::collections::BTreeMap::new();
    let mut csv = String::from("cycle,direction,target_mm,deviation_um\n");
    for line in text.lines() {
        let Some((key, value)) = line.split_once('=') else { continue };
        let index = |name: &str| key.strip_prefix(name).map(|r| r.trim_matches(['[', ']']).to_owned());
        if let Some(i) = index("TGT_DATA") {
            targets.insert(i, value.trim().parse::<f64>().unwrap());
        }
    }
    for line in text.lines() {
        for (name, direction) in [("REF_DATA_FWD[", 1), ("REF_DATA_BWD[", -1)] {
            let Some((index, value)) = line.strip_prefix(name).and_then(|r| r.split_once("]=")) else {
                continue;
            };
            let (i, j) = index.split_once(',').unwrap();
            let target = targets[i];
            let deviation = (value.trim().parse::<f64>().unwrap() - target) * 1e3;
            csv.push_str(&format!("{j},{direction},{target},{deviation}\n"));
        }
    }
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("f.csv");
    std::fs::write(&file, csv).unwrap();
    let [a, b]: [Value; 2] = [&path, &file].map(|p| {
        serde_json::from_slice(&evaluate("iso230-2", p, &["--json", "--cycles", "1-4"]).stdout).unwrap()
    });
    for key in ["b_um", "r_um", "e_um", "m_um", "a_um", "r_bwd_um"] {
        assert!((a[key].as_f64().unwrap() - b[key].as_f64().unwrap()).abs() < 1e-9, "{key}");
    }
    assert_eq!(a["cycles"], 4);
}

#[test]
fn circles_and_diagonals() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("c.csv");
    let mut csv = String::from("angle_deg,deviation_um,direction\n");
    for (direction, reversal) in [(1, 4.0), (-1, -4.0)] {
        for i in 0..360 {
            let t = f64::from(i).to_radians();
            let deviation = 20.0 * t.cos() - 7.0 * t.sin() + reversal + 5.0 * (2.0 * t).sin();
            csv.push_str(&format!("{i},{deviation},{direction}\n"));
        }
    }
    std::fs::write(&file, csv).unwrap();
    let report: Value = serde_json::from_slice(&evaluate("iso230-4", &file, &["--json"]).stdout).unwrap();
    for (key, want) in
        [("g_fwd_um", 10.0), ("g_bwd_um", 10.0), ("g_bi_um", 18.0), ("fmax_um", 9.0), ("fmin_um", -9.0)]
    {
        assert!((report[key].as_f64().unwrap() - want).abs() < 0.01, "{key}: {}", report[key]);
    }
    let raw: Value =
        serde_json::from_slice(&evaluate("iso230-4", &file, &["--json", "--centring", "none"]).stdout)
            .unwrap();
    assert!(raw["g_fwd_um"].as_f64().unwrap() > 40.0);

    let file = directory.path().join("d.csv");
    let mut csv = String::from("diagonal,cycle,direction,target_mm,deviation_um\n");
    for (diagonal, slope) in [("ppp", 1.0), ("npp", -2.0), ("pnp", 0.5), ("ppn", 3.0)] {
        for cycle in 1..=2 {
            for direction in [1, -1] {
                for i in 0..5 {
                    let deviation = slope * f64::from(i) + 0.5 * f64::from(direction);
                    csv.push_str(&format!("{diagonal},{cycle},{direction},{},{deviation}\n", i * 100));
                }
            }
        }
    }
    std::fs::write(&file, csv).unwrap();
    let output = evaluate("iso230-6", &file, &["--json"]);
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!((report["e_um"].as_f64().unwrap() - 13.0).abs() < 1e-9);
    assert_eq!(report["worst"]["e_um"], "ppn");
    assert!((report["diagonals"]["npp"]["b_um"].as_f64().unwrap() - 1.0).abs() < 1e-9);
    let people = evaluate("iso230-6", &file, &[]);
    assert!(String::from_utf8_lossy(&people.stdout).contains("worst e_um"));
}

#[test]
fn bad_data_are_refused_with_their_place() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("f.csv");
    for (test, text, expected) in [
        ("iso230-2", "", "the file is empty"),
        ("iso230-2", "cycle,direction,target_mm\n", "column deviation_um is missing"),
        ("iso230-2", "cycle,direction,target_mm,deviation_um,x\n", "x: unknown column"),
        ("iso230-2", "cycle,direction,target_mm,deviation_um\n", "no rows"),
        (
            "iso230-2",
            "cycle,direction,target_mm,deviation_um\n1,1,0,nan\n",
            "f.csv:2:7: deviation_um: nan is not finite",
        ),
        ("iso230-2", "cycle,direction,target_mm,deviation_um\n1,up,0,1\n", "'up' is not a number"),
        ("iso230-2", "cycle,direction,target_mm,deviation_um\n1,1,0,1\n2,1,0,1\n", "1 targets"),
        ("iso230-2", "cycle,direction,target_mm,deviation_um\n1,1,0,1\n1,1,5,1\n", "target 0 has 1 readings"),
        ("iso230-2", "REF_DATA_FWD[1,1]=3\n", "no TGT_DATA[1]"),
        ("iso230-4", "angle_deg,deviation_um\n", "column direction is missing"),
        ("iso230-4", "angle_deg,deviation_um,direction\n0,0,1\n", "1 readings in one direction"),
        (
            "iso230-6",
            "diagonal,cycle,direction,target_mm,deviation_um\nxyz,1,1,0,0\n",
            "'xyz' is no diagonal",
        ),
        (
            "iso230-6",
            "diagonal,cycle,direction,target_mm,deviation_um\nppp,1,1,0,0\n",
            "diagonal ppp: 1 targets",
        ),
    ] {
        std::fs::write(&file, text).unwrap();
        let output = evaluate(test, &file, &["--json"]);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(65), "{text:?}: {message}");
        assert!(message.contains(expected), "{text:?} gives {message:?}");
    }
    assert_eq!(evaluate("iso230-9", &file, &[]).status.code(), Some(64));
    assert_eq!(evaluate("iso230-2", Path::new("/nonexistent"), &[]).status.code(), Some(74));
}
