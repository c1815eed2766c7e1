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
    // at steady feed the following error is 4.12 cycles of 2 ms on each axis
    for (axis, after_um) in [("x", 3.0), ("y", 3.5), ("z", 1.2)] {
        let r = diagnose(&path, &[AXES[0], AXES[1], "--only", axis]);
        let servo = format!("servo-mismatch:{axis}");
        let all = declared(&r);
        assert!(all.contains(&servo) || all.contains(&"latency".to_owned()), "{all:?}");
        let lag = parameter(&r, &servo, "lag_ms");
        assert!((lag - 8.24).abs() < 0.2, "{axis}: {lag} ms");
        // dead time and position loop share the lag; how, only the accelerations tell
        let (gain, dead) =
            (parameter(&r, &servo, "velocity_gain_per_s"), parameter(&r, &servo, "dead_time_ms"));
        assert!((dead + 1e3 / gain - lag).abs() < 0.05, "{axis}: {dead} ms, {gain} 1/s of {lag} ms");
        assert!(number(&r["shrink"], "rms_after_um") < after_um, "{}", r["shrink"]);
        for innocent in ["backlash", "cyclic", "vibration", "positioning", "scale", "inertial"] {
            assert!(all.iter().all(|c| !c.starts_with(innocent)), "{all:?}");
        }
    }
}

#[test]
fn all_axes_together_show_one_velocity_gain() {
    let path = vendored(CAPTURE);
    let r = diagnose(&path, &AXES);
    let lag = parameter(&r, "latency", "lag_ms");
    assert!((lag - 8.24).abs() < 0.03, "{lag}");
    // what remains is below 0.3 % of the gap
    assert_eq!(declared(&r), ["latency"]);
    assert!(number(&r["shrink"], "fraction") > 0.997, "{}", r["shrink"]);
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
fn the_target_axis_has_a_position_error_a_small_reversal_error_and_a_drift() {
    let name = "iso230_2_linear_axes/ess_target_b02_report_target_y.md_ISO230.dat";
    let path = external(name);
    let r = diagnose(&path, &["--axis", "y"]);
    // both directions share the table; a mean reversal of some 12 um beside B = 20 um stands on its own
    let mut all = declared(&r);
    all.sort();
    assert_eq!(all, ["backlash:y", "positioning:y"]);
    assert!((8.0..16.0).contains(&parameter(&r, "backlash:y", "width_um").abs()));
    let s = &r["shrink"];
    assert!((number(s, "rms_before_um") - 24.2).abs() < 0.1, "{s}");
    // 5.6 um stay beside a table of means; new data show the uncertainty of the table, too
    assert!(24.2 * (1.0 - number(s, "in_sample_fraction")) < 6.0 && number(s, "rms_after_um") < 7.5, "{s}");
    let looks = r["unexplained"]["looks_like"].as_str().unwrap();
    assert!(r["unexplained"]["significant"] == true && looks.contains("slow drift"), "{looks}");
    // the times of the file are ordinal: no duration is stated
    assert!(looks.contains("points in the order measured") && !looks.contains(" s, of"), "{looks}");
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
    let notes = r["notes"].to_string();
    assert!(notes.contains("line 23: start-up outlier at 15 mm forward, cycle 1: +114.5"), "{notes}");
    assert!(notes.contains("line 25: start-up outlier at 25.2 mm forward, cycle 1: +48.0"), "{notes}");
    assert!(declared(&r).iter().all(|c| c != "outliers" && !c.starts_with("backlash")), "{:?}", declared(&r));
}

#[test]
#[cfg_attr(not(data_cnc_drilled_plates), ignore = "needs ../shared/data/cnc_drilled_plates or VOLCOMP_DATA")]
fn the_drilled_plate_shows_a_difference_of_scales_and_much_that_nothing_explains() {
    let path = external("cnc_drilled_plates/D1597A_orig_meas_2003");
    let r = diagnose(&path, &[]);
    let all = declared(&r);
    assert!(all.iter().any(|c| c.starts_with("scale")), "{all:?}");
    // smooth forms of the second and third order may have a name; what a plate cannot show must not
    let geometric = ["scale", "straightness", "angular", "positioning"];
    assert!(all.iter().all(|c| geometric.iter().any(|g| c.starts_with(g))), "{all:?}");
    let of = |axis: &str| {
        let c = format!("scale:{axis}");
        if all.contains(&c) { parameter(&r, &c, "scale_ppm") } else { 0.0 }
    };
    assert!((of("x") - of("y") + 33.0).abs() < 8.0, "{} {}", of("x"), of("y"));
    assert_eq!(r["unexplained"]["significant"], true);
    assert!(number(&r["unexplained"], "share") > 0.2, "{}", r["unexplained"]);
}

#[test]
#[cfg_attr(not(data_real_sessions), ignore = "needs ../shared/data/real_sessions or VOLCOMP_DATA")]
fn times_of_real_sessions_are_known_and_no_vibration_is_made_of_an_order() {
    for (name, times) in [
        ("muts42_back_y", Some("times are nominal")),
        ("plate1597a_redrilled", Some("times are ordinal")),
        ("resolver_divider", None),
    ] {
        let folder = external("real_sessions").join(name);
        let model = folder.join("m.toml").display().to_string();
        let r = diagnose(&folder.join("s.csv"), &["--model", &model]);
        let notes = r["notes"].to_string();
        assert_eq!(notes.contains("times are"), times.is_some(), "{name}: {notes}");
        assert!(times.is_none_or(|t| notes.contains(t)), "{name}: {notes}");
        let causes = r["causes"].as_array().unwrap();
        assert!(causes.iter().all(|c| c["effect"] != "vibration"), "{name}: {causes:?}");
    }
}

#[test]
#[cfg_attr(not(data_cnc_drilled_plates), ignore = "needs ../shared/data/cnc_drilled_plates or VOLCOMP_DATA")]
fn a_plate_of_82_holes_is_read_as_it_is() {
    let r = diagnose(&external("cnc_drilled_plates/D8131_1"), &[]);
    let notes = r["notes"].to_string();
    assert!(notes.contains("82 holes in the xy plane") && notes.contains("times are ordinal"), "{notes}");
    assert!(
        declared(&r).iter().all(|c| !c.starts_with("backlash") && c != "vibration"),
        "{:?}",
        declared(&r)
    );
}

#[test]
#[cfg_attr(
    not(data_laser_tracker_3smr_robot),
    ignore = "needs ../shared/data/laser_tracker_3smr_robot or VOLCOMP_DATA"
)]
fn poses_of_a_robot_are_no_session_of_a_machine_tool() {
    let directory = tempfile::tempdir().unwrap();
    let done = Command::new(env!("CARGO_BIN_EXE_volcomp"))
        .current_dir(directory.path())
        .args(["diagnose", "--out", "out", "--data"])
        .arg(external("laser_tracker_3smr_robot/N1N2N3Jval.csv"))
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&done.stderr);
    assert_eq!(done.status.code(), Some(65), "{said}");
    assert!(said.contains("36 poses of three reflectors (sides 244.055 ± 0.039 mm"), "{said}");
}

#[test]
#[cfg_attr(
    not(data_sinumerik_edge_capture),
    ignore = "needs ../shared/data/sinumerik_edge_capture or VOLCOMP_DATA"
)]
fn a_capture_gives_its_linear_axes_by_name_and_behaviour() {
    let r = diagnose(&external("sinumerik_edge_capture/capture_840Dsl.json"), &[]);
    let notes = r["notes"].to_string();
    assert!(notes.contains("axes x=1 (X1), y=2 (Y1) assumed"), "{notes}");
    assert!(notes.contains("3 (Z1): it turns") && notes.contains("6 (SP1)"), "{notes}");
}

#[test]
fn a_thermal_log_takes_its_five_probes() {
    let r = diagnose(&vendored("fl_thermal_spindle/fl_thermal.csv"), &[]);
    let notes = r["notes"].to_string();
    assert!(notes.contains("11115 samples of 5 probes, 16 temperatures, spindle speed"), "{notes}");
    assert!(!notes.contains("times are"), "{notes}");
    assert!(declared(&r).iter().any(|c| c == "spindle-growth"), "{:?}", declared(&r));
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

#[test]
#[cfg_attr(not(data_real_sessions), ignore = "needs ../shared/data/real_sessions or VOLCOMP_DATA")]
fn three_real_machines_are_answered_as_a_metrologist_would() {
    let of = |name: &str| {
        let folder = external(&format!("real_sessions/{name}"));
        let model = folder.join("m.toml");
        diagnose(&folder.join("s.csv"), &["--model", model.to_str().unwrap()])
    };
    // a reversal error that is not the same everywhere beside a drift
    let back = of("muts42_back_y");
    assert_eq!(declared(&back), ["backlash:y"]);
    assert_eq!(back["verdict"], "partly-explained");
    assert!((40.0..75.0).contains(&parameter(&back, "backlash:y", "width_um").abs()));
    let looks = back["unexplained"]["looks_like"].as_str().unwrap();
    assert!(looks.contains("drift") && looks.contains("programmed point"), "{looks}");
    // the angle of two axes and one common scale; nothing that an order cannot show
    let plate = of("plate1597a_redrilled");
    let all = declared(&plate);
    for cause in ["squareness:xy", "scale:x", "scale:y"] {
        assert!(all.iter().any(|c| c == cause), "{all:?}");
    }
    assert!(all.iter().all(|c| c != "vibration"), "{all:?}");
    let urad = parameter(&plate, "squareness:xy", "angle_arcsec") * 4.848;
    assert!((urad.abs() - 64.0).abs() < 10.0, "{urad}");
    assert_eq!(plate["verdict"], "partly-explained");
    // a delay, not a lost motion: at standstill the error is the same before and after the return
    let resolver = of("resolver_divider");
    let all = declared(&resolver);
    let shrink = |c: &&Value| c["shrink"].as_f64().unwrap();
    let largest =
        resolver["causes"].as_array().unwrap().iter().max_by(|a, b| shrink(a).total_cmp(&shrink(b)));
    assert_eq!(largest.unwrap()["effect"], "latency", "{all:?}");
    assert!(all.contains(&"latency".to_owned()), "{all:?}");
    assert!(all.iter().all(|c| !c.starts_with("backlash")), "{all:?}");
    assert!((parameter(&resolver, "latency", "lag_ms") - 34.0).abs() < 2.0);
}

#[test]
#[cfg_attr(not(data_real_sessions), ignore = "needs ../shared/data/real_sessions or VOLCOMP_DATA")]
fn an_axis_that_turns_without_a_model_is_said_to_hide_its_own_errors() {
    let r = diagnose(&external("real_sessions/resolver_divider/s.csv"), &[]);
    let notes = r["notes"].to_string();
    assert!(notes.contains("axis c turns, and no model says where it stands"), "{notes}");
}
