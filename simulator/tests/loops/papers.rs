//! One seed of each paper's experiment: every limit holds with kind and hard truth, and the JSON says so.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test starts programs")]

use std::process::Command;

fn experiment(paper: &str) {
    of_truths(paper, &["kind", "hard"]);
}

fn of_truths(paper: &str, truths: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_cncsim"))
        .args(["paper", paper, "--seed", "1", "--json", "--no-shares", "--out"])
        .arg(folder.path())
        .args(["--truth", if let [truth] = truths { truth } else { "both" }])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(json["format"], "volcomp-paper/1");
    let entry = &json["papers"][0];
    assert_eq!(entry["paper"], paper);
    let figures = entry["figures"].as_array().unwrap();
    let limited = figures.iter().filter(|f| !f["limit"].is_null());
    assert!(limited.clone().count() > 0);
    for f in limited {
        assert!(truths.iter().all(|truth| f[truth].is_number()) && f["pass"] == true, "{f}");
    }
    let report = std::fs::read_to_string(folder.path().join(format!("paper-{paper}/report.html"))).unwrap();
    assert!(report.contains("<svg") && !report.contains("NaN"), "plots without gaps");
}

#[test]
fn tracker_points_against_nine_lines() {
    experiment("000");
}

/// It holds its cycles for most of the time and does not depend on the load, so that it runs beside the others.
#[test]
fn lasers_live_on_three_axes() {
    of_truths("002", &["hard"]);
}

#[test]
fn circle_predicted_and_compensated() {
    let _processors = crate::processors();
    experiment("004");
}

#[test]
fn parts_cut_by_a_gantry_with_a_drifting_ram() {
    let _processors = crate::processors();
    experiment("003");
}

#[test]
fn a_gear_inspected_on_its_grinder() {
    let _processors = crate::processors();
    experiment("001");
}
