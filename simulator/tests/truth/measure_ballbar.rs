//! A ballbar on the simulated machine: what `cncsim measure ballbar` writes is what `volcomp evaluate iso230-4` reads.
#![expect(clippy::unwrap_used, reason = "a failure here is a failed test")]
#![expect(clippy::disallowed_methods, reason = "the test runs the programs on files")]

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

fn cncsim(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_cncsim")).args(args).current_dir(folder).output().unwrap()
}

fn message(out: &Output) -> String {
    String::from_utf8_lossy(&out.stderr).into_owned()
}

fn measure(folder: &Path, more: &[&str]) {
    let base = ["measure", "ballbar", "--out", ".", "--radius-mm", "50", "--mounting-um", "5"];
    let out = cncsim(folder, &[&base[..], more].concat());
    assert!(out.status.success(), "{}", message(&out));
}

fn evaluate(folder: &Path, more: &[&str]) -> Output {
    let base = ["volcomp", "evaluate", "iso230-4", "--data", "ballbar-xy.csv", "--radius-mm", "50", "--json"];
    cncsim(folder, &[&base[..], more].concat())
}

#[test]
fn a_centre_with_negative_coordinates_is_read() {
    let folder = tempfile::tempdir().unwrap();
    measure(folder.path(), &["--centre-mm", "425,250,-250"]);
    let out = cncsim(folder.path(), &["measure", "ballbar", "--out", ".", "--centre-mm", "425,250"]);
    assert_eq!(out.status.code(), Some(64));
    assert!(message(&out).contains("three numbers"), "{}", message(&out));
}

#[test]
fn the_circular_test_reads_the_files_of_the_ballbar() {
    let folder = tempfile::tempdir().unwrap();
    measure(folder.path(), &[]);
    let out = evaluate(folder.path(), &[]);
    assert!(out.status.success(), "{}", message(&out));
    // overshoot is no part of the test
    assert!(message(&out).contains("are overshoot and are not evaluated"), "{}", message(&out));
    let figures: Value = serde_json::from_slice(&out.stdout).unwrap();
    let whole = figures["g_bi_um"].as_f64().unwrap();
    assert!(whole > 1.0 && whole < 100.0, "{figures}");
    let text = std::fs::read_to_string(folder.path().join("ballbar-xy.csv")).unwrap();
    let all = text.lines().count() - 1;
    let used = figures["readings"].as_u64().unwrap() as usize;
    assert!(used.abs_diff(all / 2) <= 2, "{used} of {all}: one of two turns");
}

#[test]
fn of_several_feeds_one_is_evaluated() {
    let folder = tempfile::tempdir().unwrap();
    measure(folder.path(), &["--feed-mm-per-min", "1000,4000"]);
    let out = evaluate(folder.path(), &[]);
    assert_eq!(out.status.code(), Some(65));
    assert!(message(&out).contains("1000, 4000 mm/min"), "{}", message(&out));
    for feed in ["1000", "4000"] {
        let out = evaluate(folder.path(), &["--feed-mm-per-min", feed]);
        assert!(out.status.success(), "{}", message(&out));
    }
    let out = evaluate(folder.path(), &["--feed-mm-per-min", "2000"]);
    assert_eq!(out.status.code(), Some(64));
    assert!(message(&out).contains("no readings at 2000 mm/min"), "{}", message(&out));
}
