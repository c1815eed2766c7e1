//! `volcomp fit thermal` on a recording of 46 hours of a real spindle, and on small ones.

#![allow(clippy::unwrap_used, clippy::disallowed_methods, reason = "a test program: it fails by panicking")]

use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

fn volcomp(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcomp")).args(args).output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Forecast of the last 30 % by plain regression on 16 temperatures, and by the forecasts of this method at most, um.
const REAL: [(&str, f64, f64); 3] = [("ch1_um", 4.54, 2.4), ("ch3_um", 5.26, 2.9), ("ch5_um", 6.19, 1.7)];

#[test]
fn the_real_spindle_is_predicted_better_than_by_plain_regression() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/fl_thermal_spindle/fl_thermal.csv");
    for (channel, plain_um, limit_um) in REAL {
        let out =
            volcomp(&["fit", "thermal", data.to_str().unwrap(), "--displacement", channel, "--json", "-"]);
        assert!(out.status.success(), "{}", said(&out));
        let report: Value = serde_json::from_slice(&out.stdout).unwrap();
        let forecast = &report["forecast"];
        let plain = forecast["by_regression_rms_um"].as_f64().unwrap();
        // the published figure is met, so the comparison is one of like with like
        assert!((plain - plain_um).abs() < 0.01, "{channel}: {plain}");
        let own = forecast["rms_um"].as_f64().unwrap();
        assert!(own < limit_um, "{channel}: {own}");
    }
}

/// A room that swings and a spindle that follows it, one row a minute.
fn small() -> String {
    let mut text = "t_s,temp_room_degc,z_um\n".to_owned();
    for k in 0..600 {
        let t = f64::from(k) * 60.0;
        let room = 21.0 + 2.0 * (t / 7000.0).sin();
        writeln!(text, "{t},{room:.4},{:.4}", 3.0 * (room - 21.0)).unwrap();
    }
    text
}

#[test]
fn a_model_receives_the_growth_and_keeps_the_rest() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    std::fs::write(at("log.csv"), small()).unwrap();
    let model = concat!(env!("CARGO_MANIFEST_DIR"), "/config/examples/vmc-850/model.toml");
    let out = volcomp(&[
        "fit",
        "thermal",
        &at("log.csv"),
        "--displacement",
        "z_um",
        "--name",
        "spindle-z",
        "--symbol",
        "ezz",
        "--limit-um",
        "40",
        "--into",
        model,
        "--out",
        &at("model.toml"),
        "--picture",
        &at("picture.html"),
    ]);
    assert!(out.status.success(), "{}", said(&out));
    let written = std::fs::read_to_string(at("model.toml")).unwrap();
    for words in ["[thermal.spindle-z]", "sensor = \"temp_room\"", "[errors.ezz.live]", "[errors.exx"] {
        assert!(written.contains(words), "{words}");
    }
    assert!(String::from_utf8_lossy(&out.stdout).contains("never seen"));
    assert!(std::fs::read_to_string(at("picture.html")).unwrap().contains("<svg"));
    // once more replaces it instead of adding another
    let again = volcomp(&[
        "fit",
        "thermal",
        &at("log.csv"),
        "--displacement",
        "z_um",
        "--name",
        "spindle-z",
        "--symbol",
        "ezz",
        "--limit-um",
        "40",
        "--into",
        &at("model.toml"),
    ]);
    assert!(again.status.success(), "{}", said(&again));
    assert_eq!(written.matches("[[thermal.").count(), 1);
    let twice = std::fs::read_to_string(at("model.toml")).unwrap();
    assert_eq!(twice.matches("[[thermal.").count(), 1);
    let check = volcomp(&["check", &at("model.toml")]);
    assert!(check.status.success(), "{}", said(&check));
}

#[test]
fn what_is_missing_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("log.csv").display().to_string();
    let with = |text: &str, more: &[&str]| {
        std::fs::write(&log, text).unwrap();
        let mut args = vec!["fit", "thermal", &log, "--displacement", "z_um"];
        args.extend(more);
        let out = volcomp(&args);
        (out.status.code().unwrap(), said(&out))
    };
    for (text, more, code, words) in [
        (small(), &["--temperatures", "temp_rom_degc"][..], 65, "temp_room_degc"),
        (small().replace("temp_room_degc", "room"), &[], 65, "no temperature and no speed"),
        (small().lines().take(9).collect::<Vec<_>>().join("\n"), &[], 65, "8 rows"),
        (small().replace("\n120,", "\n60,"), &[], 65, "row 3"),
        (small().replace("\n120,", "\nsoon,"), &[], 65, "log.csv:4"),
        (small(), &["--symbol", "ezz", "--limit-um", "5"], 64, "--into"),
        (small(), &["--symbol", "eaz", "--limit-um", "5"], 64, "eaz"),
    ] {
        let (found, message) = with(&text, more);
        assert!(found == code && message.contains(words), "{words}: {found} {message}");
    }
}
