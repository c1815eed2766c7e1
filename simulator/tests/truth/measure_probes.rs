//! Probe, grinder and ballbar from end to end: the simulated machine is measured, the product identifies, the truth
//! comes back.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test runs the programs and reads their files")]

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::Value;
use simulator::truth::{GRINDER_AB, TruthMachine, VMC_850};
use volcomp::config;
use volcomp::model::axes::{AxisArray, AxisName, MAX_AXES};
use volcomp::model::geometry::Vec3;
use volcomp::model::{Model, ModelSpec, Pose};

/// Runs cncsim; its stdout.
fn cncsim(args: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_cncsim")).args(args).output().unwrap();
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// Runs the command that an instrument printed, with more arguments.
fn printed(command: &str, more: &[&str]) -> String {
    let words: Vec<&str> = command.split_whitespace().chain(more.iter().copied()).collect();
    cncsim(&words)
}

fn write(path: &Path, text: &str) -> String {
    fs::write(path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

/// The truth file without its error motions: drives and location errors stay.
fn without_motions(text: &str) -> &str {
    &text[..text.find("[errors]").unwrap()]
}

/// One number of a truth file replaced.
fn with(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "{from}");
    text.replace(from, to)
}

#[test]
fn a_probe_is_calibrated_and_the_bar_is_where_the_axis_is() {
    let folder = tempfile::tempdir().unwrap();
    // only the location of A is wrong
    let truth = with(without_motions(GRINDER_AB), "ez0b-um = -7", "ez0b-um = 0");
    let truth =
        with(&with(&truth, "ea0b-arcsec = 4.0", "ea0b-arcsec = 0"), "ec0b-arcsec = 3.0", "ec0b-arcsec = 0");
    let truth =
        with(&with(&truth, "eb0a-arcsec = 5.0", "eb0a-arcsec = 0"), "ec0a-arcsec = -4.0", "ec0a-arcsec = 0");
    let truth = with(&with(&truth, "ex0b-um = 9", "ex0b-um = 0"), "ec0y-arcsec = -8.0", "ec0y-arcsec = 0");
    let machine = write(&folder.path().join("truth.toml"), &truth);
    let out = folder.path().join("p");
    let command = cncsim(&[
        "measure",
        "probe",
        "--machine",
        &machine,
        "--out",
        out.to_str().unwrap(),
        "--noise-um",
        "0.5",
        "--ball-radius-mm",
        "1.4871",
        "--spacing-mm",
        "0.5",
    ]);
    let json = printed(&command, &["--json", "--noise-um", "0.5"]);
    let found: Value = serde_json::from_str(&json).unwrap();
    let std = found["r_c_std"].as_f64().unwrap();
    let off = found["r_c_geometric"].as_f64().unwrap() - 1.4871;
    assert!(std < 1e-4 && off.abs() < 4.0 * std, "{off} {std}");
    assert!(found["p_value"].as_f64().unwrap() > 0.001 && found["outliers"].as_array().unwrap().is_empty());
    let spec = model(&out.join("model.toml"));
    for (name, truth) in [("ey0a", 0.004), ("ez0a", -0.006)] {
        let symbol = volcomp::model::ErrorSymbol::parse(name).unwrap();
        let (_, f) = spec.errors.iter().find(|(s, _)| *s == symbol).unwrap();
        let off = f.value(0.0, Default::default()) - truth;
        assert!(off.abs() < 4.0 * f.std.unwrap(), "{name}: {off} {:?}", f.std);
    }
}

fn model(path: &Path) -> ModelSpec {
    config::model::parse(path.to_str().unwrap(), &fs::read_to_string(path).unwrap()).unwrap()
}

/// A deviation in the workpiece frame that lies where the tips show it at home.
fn aligned(at: impl Fn(&AxisArray, Vec3) -> (Vec3, Vec3), q: &AxisArray, tip: Vec3, first: Vec3) -> Vec3 {
    const FAR: f64 = 1000.0;
    let home = [0.0; MAX_AXES];
    let (_, start) = at(&home, first);
    let slope = |d: Vec3| (at(&home, first + d * FAR).1 - start) / FAR;
    let (x, y) = (slope(Vec3::x()), slope(Vec3::y()));
    let turn = Vec3::new(y.z, -x.z, x.y);
    let (place, deviation) = at(q, tip);
    deviation - start - turn.cross(&(place - at(&home, first).0))
}

#[test]
fn a_grinder_identified_step_by_step_is_predicted_within_its_uncertainty() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let drawing = at("drawing.toml");
    cncsim(&["measure", "grinder", "--drawing", &drawing]);
    let mut steps: Vec<String> = Vec::new();
    for (seed, axis) in ["a", "b", "x", "y"].into_iter().enumerate() {
        let (poses, seen) = (at(&format!("poses-{axis}.csv")), at(&format!("{axis}.csv")));
        let next = format!("{axis}={poses}");
        let mut args = vec!["volcomp", "identify", "grinder", "--drawing", &drawing, "--next", &next];
        args.extend(steps.iter().flat_map(|s| ["--step", s.as_str()]));
        cncsim(&args);
        let seed = seed.to_string();
        cncsim(&[
            "measure",
            "grinder",
            "--poses",
            &poses,
            "--out",
            &seen,
            "--noise-um",
            "0.2",
            "--seed",
            &seed,
        ]);
        steps.push(format!("{axis}={seen}"));
    }
    let out = at("model.toml");
    let mut args =
        vec!["volcomp", "identify", "grinder", "--drawing", &drawing, "--json", "--noise-um", "0.2"];
    args.extend(steps.iter().flat_map(|s| ["--step", s.as_str()]));
    let report: Value = serde_json::from_str(&cncsim(&args)).unwrap();
    cncsim(&[&args[..], &["--out", &out]].concat());
    let list = report["steps"].as_array().unwrap();
    assert_eq!(list[0]["inherited_um"], 0.0);
    for pair in list.windows(2) {
        let chain = |v: &Value| v["chain_um"].as_f64().unwrap();
        assert!(chain(&pair[1]) > chain(&pair[0]), "the uncertainty grows from step to step");
        assert!(pair[1]["inherited_um"].as_f64().unwrap() > 0.0);
    }
    for step in list {
        assert!(step["p_value"].as_f64().unwrap() > 1e-4, "{step}");
        assert!(step["rms_um"].as_f64().unwrap() < 2.0 * step["expected_rms_um"].as_f64().unwrap(), "{step}");
    }
    let stated = list[3]["chain_um"].as_f64().unwrap();

    let truth = TruthMachine::from_toml(GRINDER_AB).unwrap();
    let spec = model(Path::new(&out));
    let (compiled, first) = (Model::new(&spec).unwrap(), Vec3::from(truth.tool_tip_mm()));
    let chain: Vec<AxisName> = compiled.axes().map(|a| a.name).collect();
    // true pose of a machine at chain coordinates in mm and deg
    let real = |q: &AxisArray, tip: Vec3| {
        let mut machine = truth.clone();
        machine.set_tool_tip_mm(tip.into());
        let mut wire = AxisArray::default();
        for (k, axis) in chain.iter().enumerate() {
            wire[machine.index_of(*axis).unwrap()] = q[k];
        }
        let place = Vec3::from(machine.nominal(&wire).tip_mm);
        (place, Vec3::from(machine.deviation(&wire, &[0; MAX_AXES]).tip_mm))
    };
    let predicted = |q: &AxisArray, tip: Vec3| {
        let mut inner = *q;
        for (k, axis) in chain.iter().enumerate() {
            if matches!(axis, AxisName::A | AxisName::B) {
                inner[k] = q[k].to_radians();
            }
        }
        let pose = Pose { tool_tip: Some(tip), ..Pose::at(inner) };
        (real(q, tip).0, compiled.deviation(&pose).position)
    };
    let (mut before, mut after, mut count) = (0.0, 0.0, 0.0);
    for i in 0..60 {
        let share = |step: f64| (f64::from(i) * step).fract();
        let mut q = [0.0; MAX_AXES];
        for (k, axis) in chain.iter().enumerate() {
            let [low, high] = truth.travel(truth.index_of(*axis).unwrap());
            q[k] = low + (high - low) * share([0.618, 0.414, 0.732, 0.236][k]);
        }
        let wanted = aligned(real, &q, first, first);
        before += wanted.norm_squared();
        after += (aligned(predicted, &q, first, first) - wanted).norm_squared();
        count += 1.0;
    }
    let [before, after] = [before, after].map(|s: f64| 1e3 * (s / count).sqrt());
    assert!(after < 2.0 * stated, "{after} um left of {before}, {stated} um stated");
    assert!(after < 0.25 * before, "{after} um left of {before}");
}

/// A machine with nothing wrong but what a ballbar should name.
fn bare_machine() -> String {
    let mut text = with(without_motions(VMC_850), "eb0z-arcsec = 9.0", "eb0z-arcsec = 5.0");
    text = with(&text, "lag-ms = 5.00, feed-forward = 0.0", "lag-ms = 0.50, feed-forward = 0.0");
    text = with(&text, "servo = { lag-ms = 5.02 }", "servo = { lag-ms = 0.65 }");
    text = with(&text, "servo = { lag-ms = 4.98 }", "servo = { lag-ms = 0.50 }");
    text = with(
        &text,
        "backlash-um = 0.3                          # lost",
        "backlash-um = 5.0                          # lost",
    );
    text = with(&text, "backlash-um = 0.2", "backlash-um = 3.0");
    text + "[errors]\n\
        exx = [{ slope = { rise-um = 34 } }]\n\
        eyx = [{ bow = { height-um = 40 } }]\n\
        ezz = [{ pitch = { pitch-mm = 10, first-um = 1.5 } }]\n"
}

#[test]
fn a_ballbar_names_what_is_wrong_with_the_machine() {
    let folder = tempfile::tempdir().unwrap();
    let machine = write(&folder.path().join("truth.toml"), &bare_machine());
    let out = folder.path().join("b");
    let command = cncsim(&[
        "measure",
        "ballbar",
        "--machine",
        &machine,
        "--out",
        out.to_str().unwrap(),
        "--plane",
        "xy,zx",
        "--feed-mm-per-min",
        "1000,3000",
        "--rate-hz",
        "100",
        "--noise-um",
        "0.1",
        "--mounting-um",
        "10",
    ]);
    let model_out = out.join("model.toml");
    let json = printed(&command, &["--json", "--pitch-mm", "z=10", "--out", model_out.to_str().unwrap()]);
    let found: Value = serde_json::from_str(&json).unwrap();
    let [xy, zx] = [0, 1].map(|i| &found["planes"][i]);
    let check = |plane: &Value, name: &str, truth: f64, limit: f64| {
        let f = &plane["features"][name];
        let (value, std) = (f["value"].as_f64().unwrap(), f["std"].as_f64().unwrap());
        assert!((value - truth).abs() < limit.max(4.0 * std), "{name}: {value} +- {std} for {truth}");
        assert!(std < limit, "{name}: {std}");
    };
    let um_per_m = |arcsec: f64| 1e6 * (arcsec / 3600.0f64).to_radians();
    check(xy, "AF_SQUARENESS", um_per_m(-11.0), 1.0);
    // above 90 deg is minus for EB0Z
    check(zx, "AF_SQUARENESS", -um_per_m(5.0), 1.0);
    // 34 um over 850 mm: 40 ppm, seen over 300 mm
    check(xy, "AF_SCALE_MISMATCH", 40e-3 * 300.0, 0.3);
    check(zx, "AF_SCALE_MISMATCH", -40e-3 * 300.0, 0.3);
    check(xy, "AF_SERVO_MISMATCH", 0.15, 0.02);
    for name in ["AF_BACKLASH_A_POS", "AF_BACKLASH_A_NEG"] {
        check(xy, name, 5.0, 0.4);
        check(zx, name, 3.0, 0.4);
    }
    // a bow of 40 um over 850 mm has 40 (300/850)^2 um over the circle, and slope none at the middle of travel
    check(xy, "AF_STRAIGHTNESS_A", 40.0 * (300.0f64 / 850.0).powi(2), 0.3);
    check(zx, "AF_CYCLIC_ERROR_A_FWD", 3.0, 0.2);
    for plane in [xy, zx] {
        assert!(
            plane["residual_circularity_um"].as_f64().unwrap()
                < 0.5 * plane["circularity_um"].as_f64().unwrap()
        );
    }
    let spec = model(&model_out);
    let symbols: Vec<String> = spec.errors.iter().map(|(s, _)| s.to_string()).collect();
    for wanted in ["EXX", "EYX", "EZZ", "EC0Y", "EB0Z"] {
        assert!(symbols.contains(&wanted.to_owned()), "{wanted} in {symbols:?}");
    }
    let of = |name: &str| {
        let symbol = volcomp::model::ErrorSymbol::parse(name).unwrap();
        spec.errors.iter().find(|(s, _)| *s == symbol).unwrap().1.value(0.0, Default::default())
    };
    assert!((of("ec0y") - (-11.0f64 / 3600.0).to_radians()).abs() < 1e-6);
    assert!((of("eb0z") - (5.0f64 / 3600.0).to_radians()).abs() < 1e-6);
}

#[test]
fn an_arc_with_overshoot_is_cut_and_analysed() {
    let folder = tempfile::tempdir().unwrap();
    let machine = write(&folder.path().join("truth.toml"), &bare_machine());
    let out = folder.path().join("b");
    let command = cncsim(&[
        "measure",
        "ballbar",
        "--machine",
        &machine,
        "--out",
        out.to_str().unwrap(),
        "--plane",
        "yz",
        "--arc-deg",
        "220",
        "--start-deg",
        "-20",
        "--overshoot-deg",
        "10",
        "--radius-mm",
        "100",
        "--rate-hz",
        "100",
        "--mounting-um",
        "5",
    ]);
    let found: Value = serde_json::from_str(&printed(&command, &["--json"])).unwrap();
    let plane = &found["planes"][0];
    let notes = plane["notes"].to_string();
    assert!(notes.contains("cover 220 deg"), "{notes}");
    let square = &plane["features"]["AF_SQUARENESS"];
    let truth = 1e6 * (-8.0f64 / 3600.0).to_radians();
    let off = square["value"].as_f64().unwrap() - truth;
    assert!(off.abs() < 4.0 * square["std"].as_f64().unwrap() + 2.0, "{square} {truth}");
    let has_negative = plane["features"].get("AF_BACKLASH_B_NEG").is_some();
    assert!(!has_negative, "the arc has no reversal at the lower end of Z");
}
