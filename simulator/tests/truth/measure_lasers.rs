//! Lasers on the simulated machine: what `cncsim measure` writes, `volcomp identify` turns into the truth.
#![expect(clippy::unwrap_used, reason = "a failure here is a failed test")]
#![expect(clippy::disallowed_methods, reason = "the test runs the programs on files")]

use std::path::Path;
use std::process::Command;

use serde_json::Value;
use simulator::truth::{TruthMachine, VMC_850};
use volcomp::model::axes::AxisName;
use volcomp::model::geometry::Vec3;
use volcomp::model::units::{arcsec_from_rad, um_from_mm};
use volcomp::model::{Model, ModelSpec};

fn cncsim(folder: &Path, args: &[&str]) -> (String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_cncsim")).args(args).current_dir(folder).output().unwrap();
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{args:?}: {error}");
    (String::from_utf8(output.stdout).unwrap(), error)
}

/// Runs the command line that `cncsim measure` proposes.
fn identify(folder: &Path, line: &str, more: &[&str]) -> (String, String) {
    let mut words: Vec<String> = Vec::new();
    let mut quoted = false;
    for part in line.trim().split('"') {
        if quoted {
            words.push(part.to_owned());
        } else {
            words.extend(part.split_whitespace().map(str::to_owned));
        }
        quoted = !quoted;
    }
    let args: Vec<&str> = words.iter().map(String::as_str).chain(more.iter().copied()).collect();
    cncsim(folder, &args)
}

fn model(folder: &Path, name: &str) -> ModelSpec {
    let text = std::fs::read_to_string(folder.join(name)).unwrap();
    volcomp::config::model::parse(name, &text).unwrap()
}

/// Largest difference of the deviation by a model and by the truth while one axis moves, about the end-point line:
/// um at the tip that stands at `tip` at home, and arcsec.
fn difference(spec: &ModelSpec, axis: AxisName, tip: [f64; 3], with_roll: bool) -> ([f64; 3], [f64; 3]) {
    let mut machine = TruthMachine::from_toml(VMC_850).unwrap();
    machine.set_tool_tip_mm(tip);
    let k = machine.index_of(axis).unwrap();
    let [low, high] = machine.travel(k);
    let model = Model::new(spec).unwrap();
    let gap = |q: f64| -> [f64; 6] {
        let mut position = [0.0; 8];
        position[k] = q;
        let truth = [-1, 1].map(|d| {
            let mut direction = [0; 8];
            direction[k] = d;
            machine.deviation(&position, &direction)
        });
        let mut pose = model.pose_of(&[(axis, q)]);
        pose.tool_tip = Some(Vec3::from(tip));
        let said = model.deviation(&pose);
        std::array::from_fn(|i| {
            if i < 3 {
                um_from_mm(said.position[i] - (truth[0].tip_mm[i] + truth[1].tip_mm[i]) / 2.0)
            } else {
                let i = i - 3;
                arcsec_from_rad(
                    said.rotation[i] - (truth[0].rotation_rad[i] + truth[1].rotation_rad[i]) / 2.0,
                )
            }
        })
    };
    let (first, last, home) = (gap(low), gap(high), gap(0.0));
    let mut worst = ([0.0f64; 3], [0.0f64; 3]);
    for step in 0..=60 {
        let share = f64::from(step) / 60.0;
        let here = gap(low + share * (high - low));
        for i in 0..3 {
            // the slope of a straightness is squareness and set-up, unknown to one run
            let line = first[i] + share * (last[i] - first[i]);
            worst.0[i] = worst.0[i].max((here[i] - line).abs());
            if with_roll || i != axis.direction() {
                worst.1[i] = worst.1[i].max((here[i + 3] - home[i + 3]).abs());
            }
        }
    }
    worst
}

#[test]
fn a_fivedof_laser_on_the_table_finds_its_error_motions() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for (axis, letter, mount) in [
        (AxisName::X, "x", "carriage"),
        (AxisName::Y, "y", "carriage"),
        (AxisName::Z, "z", "carriage"),
        (AxisName::X, "x", "relative"),
    ] {
        // 0.1 um on the detectors would be 2 arcsec of roll at 1.2 m: the beams are 68 mm apart
        let quiet = ["--noise-um", "0.02", "--noise-arcsec", "0.05"];
        let args = ["measure", "fivedof", "--axis", letter, "--mount", mount, "--out", ".", "--seed", "4"];
        let (line, _) = cncsim(folder, &[&args[..], &quiet].concat());
        let (table, notes) = identify(folder, &line, &["--basis", "table"]);
        assert!(table.contains("within the noise"), "{table}\n{notes}");
        // a point away from the optics: the levers count, too
        let (um, arcsec) = difference(&model(folder, "model.toml"), axis, [350.0, 150.0, -500.0], true);
        for i in 0..3 {
            // positioning is not measured; sampling of the truth between 21 positions limits the rest
            assert!(i == axis.direction() || um[i] < 2.0, "{letter} {mount}: {um:?} um");
            assert!(arcsec[i] < 1.0, "{letter} {mount}: {arcsec:?} arcsec");
        }
    }
}

#[test]
fn a_six_d_interferometer_finds_its_error_motions_with_levers() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for (axis, letter, mount) in
        [(AxisName::X, "x", "carriage"), (AxisName::Y, "y", "relative"), (AxisName::Z, "z", "carriage")]
    {
        for left_handed in [false, true] {
            let mut args = vec!["measure", "straightness", "--axis", letter, "--mount", mount, "--out", "."];
            if left_handed {
                args.push("--left-handed");
            }
            let (line, _) = cncsim(folder, &args);
            let (_, notes) = identify(folder, &line, &["--basis", "table"]);
            assert_eq!(notes.contains("not those of a right-handed frame"), left_handed, "{notes}");
            let (um, arcsec) = difference(&model(folder, "model.toml"), axis, [350.0, 150.0, -500.0], true);
            for i in 0..3 {
                assert!(um[i] < 1.5, "{letter} {mount}: {um:?} um");
                assert!(arcsec[i] < 0.6, "{letter} {mount}: {arcsec:?} arcsec");
            }
        }
    }
}

#[test]
fn body_diagonals_find_squareness_once_angles_are_known() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    cncsim(folder, &["survey", "--out", "survey"]);
    let mut fit = vec!["volcomp", "fit"];
    for axis in ["x", "y", "z"] {
        fit.extend([
            "--errors",
            ["survey/survey-x.csv", "survey/survey-y.csv", "survey/survey-z.csv"]
                [usize::from(axis > "x") + usize::from(axis > "y")],
        ]);
        fit.extend(["--axis", axis]);
    }
    fit.extend(["--into", "survey/geometry.toml", "--out", "angles.toml"]);
    cncsim(folder, &fit);
    let (line, _) = cncsim(folder, &["measure", "diagonals", "--out", ".", "--seed", "9"]);
    let (report, _) = identify(folder, &line, &["--json"]);
    let report: Value = serde_json::from_str(&report).unwrap();
    assert_eq!(report["open_runs"], 0);
    // the truth file: between the end-point lines at the reference points
    for (key, truth) in [("ec0y", -11.0), ("eb0z", 9.0), ("ea0z", -8.0)] {
        let of = |what: &str| report[format!("{key}{what}_arcsec")].as_f64().unwrap();
        let gap = (of("") - truth).abs();
        assert!(gap < 0.25, "{key}: {} instead of {truth}", of(""));
        assert!(gap < 3.0 * of("_std") + 0.05, "{key}: {gap} beyond {}", of("_std"));
        assert_eq!(report[format!("{key}_significant")], true);
    }
    // raw diagonals would have been wrong by more than the interval
    let wrong = ["ec0y", "eb0z", "ea0z"].iter().any(|key| {
        let of = |what: &str| report[format!("{key}{what}_arcsec")].as_f64().unwrap();
        (of("_without_subtraction") - of("")).abs() > 3.0 * of("_half_width_95")
    });
    assert!(wrong, "{report:#}");
    let (closure, steps) = (&report["closure_um"]["ppp"], report["steps_rms_um"].as_f64().unwrap());
    // 22 readings of 0.02 um each, and lost motion
    assert!((closure.as_f64().unwrap() - 0.42).abs() < 0.9, "{closure}");
    assert!(steps < 1.0, "{steps}");
    let spec = model(folder, "model.toml");
    assert_eq!(spec.machine, "vmc-850");
    assert!(spec.errors.iter().any(|(s, f)| s.to_string() == "EC0Y" && f.std.is_some()));
}

#[test]
fn json_beside_a_written_model_is_one_document() {
    let folder = tempfile::tempdir().unwrap();
    for instrument in ["fivedof", "straightness"] {
        let (line, _) = cncsim(folder.path(), &["measure", instrument, "--axis", "x", "--out", "."]);
        let (stdout, _) = identify(folder.path(), &line, &["--json"]);
        let report: Value = serde_json::from_str(&stdout)
            .unwrap_or_else(|e| panic!("identify {instrument} --json --out: {e}:\n{stdout}"));
        assert!(report.is_object(), "{report}");
        if instrument == "fivedof" {
            drift_is_compensated(&report["drift_check"]);
        }
        assert!(folder.path().join("model.toml").exists());
        std::fs::remove_file(folder.path().join("model.toml")).unwrap();
    }
}

/// The pointing wanders by arcseconds: the straightnesses repeat with the compensation, not without it, and half as well with
/// the printed factor.
fn drift_is_compensated(check: &Value) {
    assert_eq!(check["runs"], 2);
    for row in check["std"].as_array().unwrap() {
        let of = |key: &str| row[key]["mean"].as_f64().unwrap();
        let (on, off, printed) = (of("on"), of("off"), of("printed_factor"));
        if row["unit"] == "um" {
            assert!(on < 0.3 * printed && printed < off, "{row}");
        }
    }
}
