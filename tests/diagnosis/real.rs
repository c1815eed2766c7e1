//! Real recordings through `volcomp diagnose`: what is known of them must come out, and nothing that is not there.

#![expect(clippy::disallowed_methods, reason = "the test runs the program on files")]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::print_stderr, reason = "the figures are the result")]

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;

/// A file of a set that is part of the repository.
fn vendored(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

/// A file of a set that is not part of the repository (`build.rs`).
fn external(name: &str) -> PathBuf {
    Path::new(env!("VOLCOMP_DATA_FOLDER")).join(name)
}

/// The report on a file.
fn diagnose(path: &Path, extra: &[&str]) -> Value {
    let directory = tempfile::tempdir().unwrap();
    let done = Command::new(env!("CARGO_BIN_EXE_volcomp"))
        .current_dir(directory.path())
        .args(["diagnose", "--json", "--out", "out", "--data"])
        .arg(path)
        .args(extra)
        .stdin(Stdio::null())
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let r: Value = serde_json::from_slice(&done.stdout).unwrap();
    eprintln!("{} {extra:?}", path.display());
    eprintln!(
        "  {}: {:.2} -> {:.2} um by cross-validation",
        r["verdict"],
        number(&r["shrink"], "rms_before_um"),
        number(&r["shrink"], "rms_after_um")
    );
    for c in r["causes"].as_array().unwrap() {
        eprintln!(
            "  {} {} {}",
            label(c),
            c["probability"],
            if c["declared"] == true { "declared" } else { "" }
        );
    }
    r
}

fn number(v: &Value, key: &str) -> f64 {
    v[key].as_f64().unwrap_or_else(|| panic!("{key} is no number in {v}"))
}

fn label(c: &Value) -> String {
    let (effect, subject) = (c["effect"].as_str().unwrap(), c["subject"].as_str().unwrap());
    if subject.is_empty() { effect.to_owned() } else { format!("{effect}:{subject}") }
}

fn declared(r: &Value) -> Vec<String> {
    r["causes"].as_array().unwrap().iter().filter(|c| c["declared"] == true).map(label).collect()
}

fn parameter(r: &Value, cause: &str, name: &str) -> f64 {
    let c = r["causes"].as_array().unwrap().iter().find(|c| label(c) == cause).unwrap();
    number(&c["parameters"][name], "value")
}

const CAPTURE: &str = "sinumerik_edge_capture/capture_linear_axes.csv";
const AXES: [&str; 2] = ["--axes", "x=1,y=2,z=6"];

#[test]
fn the_following_error_of_each_axis_is_its_lag() {
    let path = vendored(CAPTURE);
    for (axis, lag_ms, after_um) in [("x", 8.1, 12.0), ("y", 8.2, 6.0), ("z", 7.9, 3.0)] {
        let r = diagnose(&path, &[AXES[0], AXES[1], "--only", axis]);
        let servo = format!("servo-mismatch:{axis}");
        let all = declared(&r);
        assert!(all.contains(&servo) || all.contains(&"latency".to_owned()), "{all:?}");
        assert!(all.contains(&format!("inertial:{axis}")), "{all:?}");
        let lag = parameter(&r, &servo, "lag_ms");
        assert!((lag - lag_ms).abs() < 0.15, "{axis}: {lag} ms");
        assert!(number(&r["shrink"], "rms_after_um") < after_um, "{}", r["shrink"]);
        for innocent in ["backlash", "cyclic", "vibration", "positioning", "scale"] {
            assert!(all.iter().all(|c| !c.starts_with(innocent)), "{all:?}");
        }
    }
}

#[test]
fn all_axes_together_show_a_common_delay_and_the_mismatch() {
    let path = vendored(CAPTURE);
    let r = diagnose(&path, &AXES);
    let lag = parameter(&r, "latency", "lag_ms");
    assert!((7.9..8.3).contains(&lag), "{lag}");
    let mismatch = parameter(&r, "servo-mismatch:y", "lag_ms");
    assert!((0.05..0.25).contains(&mismatch), "{mismatch}");
    assert!(declared(&r).iter().any(|c| c.starts_with("reversal-spike")), "friction: {:?}", declared(&r));
    assert!(number(&r["shrink"], "fraction") > 0.99, "{}", r["shrink"]);
}

#[test]
#[cfg_attr(
    not(data_sinumerik_edge_capture),
    ignore = "needs ../shared/data/sinumerik_edge_capture or VOLCOMP_DATA"
)]
fn a_capture_says_the_same_as_json_and_as_a_table() {
    let table = vendored(CAPTURE);
    let json = external("sinumerik_edge_capture/capture_840Dsl.json");
    let args = [AXES[0], AXES[1], "--only", "z"];
    let (a, b) = (diagnose(&table, &args), diagnose(&json, &args));
    assert_eq!(declared(&a), declared(&b));
    assert!((number(&a["gap"], "rms_um") - number(&b["gap"], "rms_um")).abs() < 1e-3);
}

#[test]
#[cfg_attr(
    not(data_iso230_2_linear_axes),
    ignore = "needs ../shared/data/iso230_2_linear_axes or VOLCOMP_DATA"
)]
fn the_target_axis_has_a_position_error_and_a_drift_but_no_lost_motion() {
    let name = "iso230_2_linear_axes/ess_target_b02_report_target_y.md_ISO230.dat";
    let path = external(name);
    let r = diagnose(&path, &["--axis", "y"]);
    assert_eq!(declared(&r), ["positioning:y"]);
    let s = &r["shrink"];
    assert!((number(s, "rms_before_um") - 24.2).abs() < 0.1 && number(s, "rms_after_um") < 6.5, "{s}");
    let looks = r["unexplained"]["looks_like"].as_str().unwrap();
    assert!(r["unexplained"]["significant"] == true && looks.contains("slow drift"), "{looks}");
}

#[test]
#[cfg_attr(
    not(data_iso230_2_linear_axes),
    ignore = "needs ../shared/data/iso230_2_linear_axes or VOLCOMP_DATA"
)]
fn the_first_readings_of_the_demo_stage_are_outliers_and_no_cause() {
    let name = "iso230_2_linear_axes/ess_mcu1025_report.md_ISO230.dat";
    let path = external(name);
    let r = diagnose(&path, &[]);
    let named: Vec<&str> =
        r["outlying_readings"].as_array().unwrap().iter().map(|o| o["at"].as_str().unwrap()).collect();
    // REF_DATA_FWD[1,1] and [2,1]
    for line in [":23", ":25"] {
        assert!(named.iter().any(|n| n.ends_with(line)), "{named:?}");
    }
    assert!(declared(&r).iter().all(|c| c != "outliers" && !c.starts_with("backlash")), "{:?}", declared(&r));
}

#[test]
#[cfg_attr(not(data_cnc_drilled_plates), ignore = "needs ../shared/data/cnc_drilled_plates or VOLCOMP_DATA")]
fn the_drilled_plate_shows_a_difference_of_scales_and_much_that_nothing_explains() {
    let path = external("cnc_drilled_plates/D1597A_orig_meas_2003");
    let r = diagnose(&path, &[]);
    let all = declared(&r);
    assert!(!all.is_empty() && all.iter().all(|c| c.starts_with("scale")), "{all:?}");
    let of = |axis: &str| {
        let c = format!("scale:{axis}");
        if all.contains(&c) { parameter(&r, &c, "scale_ppm") } else { 0.0 }
    };
    assert!((of("x") - of("y") + 33.0).abs() < 4.0, "{} {}", of("x"), of("y"));
    assert_eq!(r["unexplained"]["significant"], true);
    assert!(number(&r["unexplained"], "share") > 0.5, "{}", r["unexplained"]);
}

#[test]
fn spindle_growth_has_a_lag_and_other_days_are_forecast_worse() {
    let path = vendored("fl_thermal_spindle/fl_thermal.csv");
    let r = diagnose(&path, &["--series", "z=ch5_um"]);
    assert!(declared(&r).iter().any(|c| c == "spindle-growth"), "{:?}", declared(&r));
    let s = &r["shrink"];
    assert!(number(s, "fraction") < number(s, "in_sample_fraction"), "{s}");
    assert!(number(s, "fraction") > 0.1, "{s}");
}
