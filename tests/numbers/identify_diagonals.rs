//! `volcomp identify diagonals` as a user runs it: the reference vectors, and files.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test runs the program on files")]

use std::path::Path;
use std::process::{Command, Output};

use serde_json::{Value, json};

fn volcomp(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcomp"))
        .args(["identify", "diagonals"])
        .args(args)
        .current_dir(folder)
        .output()
        .unwrap()
}

fn json_of(output: &Output) -> Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Refused with this exit code; the message.
fn refused(output: &Output, code: i32) -> String {
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{message}");
    assert!(output.stdout.is_empty());
    message
}

/// DIAG-o1 and DIAG-o4 of the vectors: squareness alone, and with angular errors on a chain with X' and a tool.
fn kept_cases() -> Vec<Value> {
    let zero = json!([0, 0, 0, 0, 0, 0]);
    let still = json!({"at_0": zero, "at_travel": zero});
    vec![
        json!({"id": "DIAG-o1", "chain": "[w b X Y Z t]", "box": [3000, 1500, 780], "tool_tip": [0, 0, 0],
            "axis_errors_at_box_ends": {"X": still, "Y": still, "Z": still},
            "displacement": {"ppp": 0.0907818185194087, "npp": -0.12080593107222065, "pnp": -0.03035898321246891,
                "ppn": 0.06037733608609525},
            "expect": {"squareness": {"C0Y": -5.783799996775306e-05, "B0Z": 4.446199994195866e-05,
                "A0Z": 4.4179999985627715e-05}, "common": -1.4399197964009464e-06,
                "sigma_squareness_per_sigma_1um": {"C0Y": 3.8262252939417984e-07, "B0Z": 7.358125565272689e-07,
                    "A0Z": 1.4716251130545379e-06}}}),
        json!({"id": "DIAG-o4", "chain": "[w X' b Y Z t]", "box": [3000, 1500, 780],
            "tool_tip": [5.131, -5.634, -198.086],
            "axis_errors_at_box_ends": {
                "X": {"at_0": [0, 0, 0, -7.45e-06, 1.2786e-05, 1.9427e-05],
                    "at_travel": [-0.011228, 0, 0, -4.5917e-05, 3.5791e-05, 2.2911e-05]},
                "Y": {"at_0": [0, 0, 0, 9.936e-06, 7.073e-06, -1.2935e-05],
                    "at_travel": [0, 0.008676, 0, -4.3818e-05, -6.792e-06, -3.5685e-05]},
                "Z": {"at_0": [0, 0, 0, -9.868e-06, 4.22e-06, -1.4769e-05],
                    "at_travel": [0, 0, 0.003631, -4.865e-06, -1.2509e-05, -1.097e-06]}},
            "displacement": {"ppp": -0.13374941279824928, "npp": 0.10648041481118131, "pnp": 0.10859256199419705,
                "ppn": -0.07790257063995898},
            "expect": {"model_displacement_without_squareness_first_order": {"ppp": -0.0010434314365791923,
                    "npp": 0.01537467008319562, "pnp": -0.019789270273783247, "ppn": 0.00890918499856947},
                "squareness_without_subtraction": {"C0Y": 8.163729182201597e-05, "B0Z": -1.9769331641984884e-05,
                    "A0Z": 4.264695212096312e-05},
                "squareness": {"C0Y": 8.39866618293493e-05, "B0Z": -3.170667144523344e-06,
                    "A0Z": 6.119776082932209e-05},
                "common": -7.540001058133084e-06}}),
    ]
}

fn assert_expected(id: &str, path: &str, got: &Value, expected: &Value) {
    if let Some(object) = expected.as_object() {
        for (key, value) in object {
            assert_expected(id, &format!("{path}.{key}"), &got[key], value);
        }
        return;
    }
    // displacements are mm, the tolerance of squareness holds for both
    let (got, expected) = (got.as_f64().unwrap_or(f64::NAN), expected.as_f64().unwrap());
    assert!((got - expected).abs() <= 1e-12, "{id}{path}: {got} instead of {expected}");
}

fn check_case(case: &Value) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("case.json"), case.to_string()).unwrap();
    let got = json_of(&volcomp(folder.path(), &["--input", "case.json", "--json"]));
    assert_expected(case["id"].as_str().unwrap(), "", &got, &case["expect"]);
}

#[test]
fn kept_vectors() {
    kept_cases().iter().for_each(check_case);
}

#[test]
fn straightness_beside_angles_leaves_the_end_point_lines_to_be_told() {
    // along X the tool rises by 6 um towards +Y and yaws by 20 urad; the lines themselves are square
    let still = json!({"at_0": [0, 0, 0, 0, 0, 0], "at_travel": [0, 0, 0, 0, 0, 0]});
    let length = 300f64.hypot(200.0).hypot(100.0);
    let rise = 6e-3 * 200.0 / length;
    // yaw moves the tip by -2e-5 y along X: only where x and y end at their upper ends together
    let both = rise - 2e-5 * 200.0 * 300.0 / length;
    let displacement = [both, -rise, -rise, both];
    let case = json!({"id": "both", "chain": "[w b X Y Z t]", "box": [300, 200, 100], "tool_tip": [0, 0, 0],
        "axis_errors_at_box_ends": {"X": {"at_0": [0, 0, 0, 0, 0, 0], "at_travel": [0, 6e-3, 0, 0, 0, 2e-5]},
            "Y": still, "Z": still},
        "displacement": {"ppp": displacement[0], "npp": displacement[1], "pnp": displacement[2],
            "ppn": displacement[3]},
        "expect": {"squareness": {"C0Y": 0.0, "B0Z": 0.0, "A0Z": 0.0},
            "squareness_of_end_point_lines_first_order": {"C0Y": -2e-5, "B0Z": 0.0, "A0Z": 0.0}}});
    check_case(&case);
}

#[test]
fn a_case_without_the_angles_of_an_axis_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut case = kept_cases().remove(1);
    case["axis_errors_at_box_ends"].as_object_mut().unwrap().remove("Z");
    std::fs::write(folder.path().join("case.json"), case.to_string()).unwrap();
    let message = refused(&volcomp(folder.path(), &["--input", "case.json", "--json"]), 65);
    assert!(message.contains("no Z"), "{message}");
}

#[test]
fn reference_vectors() {
    let file: Value = serde_json::from_str(include_str!("../vectors/diagonals.json")).unwrap();
    file["cases"].as_array().unwrap().iter().for_each(check_case);
}

const BOX: [f64; 3] = [3000.0, 1500.0, 780.0];

/// Readings of the displacements of paper 002 (um), with cycles that differ by `spread` um.
fn paper(spread: f64, back: bool) -> String {
    let length = BOX.iter().map(|s| s * s).sum::<f64>().sqrt();
    let mut text = String::from("diagonal,cycle,direction,target_mm,deviation_um\n");
    for (name, d) in [("ppp", -51.5), ("npp", 56.0), ("pnp", -95.7), ("ppn", 91.1)] {
        for cycle in 1..=5 {
            let end = d + spread * f64::from(cycle - 3);
            let mut rows = vec![(1, 0.0, 1.0), (1, length, 1.0 + end)];
            if back {
                rows.extend([(-1, length, 1.0 + end), (-1, 0.0, 1.0)]);
            }
            for (direction, target, value) in rows {
                text.push_str(&format!("{name},{cycle},{direction},{target:.6},{value}\n"));
            }
        }
    }
    text
}

const ANGLES: &str = "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w X' b Y Z t]\"\n";

fn angles(value: &str) -> String {
    let mut text = ANGLES.to_owned();
    for axis in ["x", "y", "z"] {
        for angle in ["a", "b", "c"] {
            text.push_str(&format!(
                "[errors.e{angle}{axis}.table]\nposition-mm = [0, 3000]\nvalue-arcsec = {value}\n"
            ));
        }
    }
    text
}

#[test]
fn the_paper_and_what_is_not_significant() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("d.csv"), paper(3.16, true)).unwrap();
    std::fs::write(folder.path().join("a.toml"), angles("[0, 0]")).unwrap();
    let args = ["--data", "d.csv", "--box-mm", "3000,1500,780", "--model", "a.toml", "--out", "m.toml"];
    let output = volcomp(folder.path(), &[&args[..], &["--json"]].concat());
    let r = json_of(&output);
    // theta_xy, -theta_xz, theta_yz
    for (key, expected) in [("ec0y", -3.13), ("eb0z", -22.33), ("ea0z", -1.37)] {
        let got = r[format!("{key}_arcsec")].as_f64().unwrap();
        assert!((got - expected).abs() < 0.02, "{key} {got}");
    }
    // 5 um repeatability
    assert!((r["run_std_um"].as_f64().unwrap() - 5.0).abs() < 0.01);
    assert_eq!(r["eb0z_significant"], json!(true));
    assert_eq!(r["ea0z_significant"], json!(false));
    assert_eq!((&r["open_runs"], &r["dof"]), (&json!(0), &json!(16)));
    let model = std::fs::read_to_string(folder.path().join("m.toml")).unwrap();
    assert!(model.contains("[errors.eb0z.constant]") && model.contains("std-arcsec"), "{model}");
    assert!(model.contains("source-hash = \"blake3:"), "{model}");
    let text = String::from_utf8(volcomp(folder.path(), &args).stdout).unwrap();
    assert!(text.contains("not significant"), "{text}");
}

#[test]
fn without_angular_data_it_refuses_or_states_the_bias() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("d.csv"), paper(1.0, false)).unwrap();
    let args = ["--data", "d.csv", "--box-mm", "3000,1500,780", "--chain", "[w X' b Y Z t]"];
    let message = refused(&volcomp(folder.path(), &args), 65);
    assert!(message.contains("EBX") && message.contains("by 5.0 arcsec"), "{message}");
    assert!(message.contains("--accept-bias-arcsec"), "{message}");
    let output = volcomp(folder.path(), &[&args[..], &["--accept-bias-arcsec", "4", "--json"]].concat());
    let r = json_of(&output);
    assert_eq!(r["bias_bound_arcsec"], json!(4.0));
    assert!(r["eb0z_half_width_95_arcsec"].as_f64().unwrap() > 4.0);
    assert_eq!(r["ec0y_significant"], json!(false));
    let plain = volcomp(folder.path(), &[&args[..], &["--accept-bias-arcsec", "4"]].concat());
    assert!(String::from_utf8_lossy(&plain.stdout).contains("bias up to 4.00 arcsec accepted"));
    assert!(String::from_utf8_lossy(&plain.stderr).contains("20 runs do not return to their start"));
}

#[test]
fn a_model_with_some_angles_only_is_not_enough() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("d.csv"), paper(1.0, true)).unwrap();
    let text = angles("[0, 0]").replace("[errors.ecx.table]", "[errors.exx.table]").replacen(
        "[errors.exx.table]\nposition-mm = [0, 3000]\nvalue-arcsec",
        "[errors.exx.table]\nposition-mm = [0, 3000]\nvalue-um",
        1,
    );
    std::fs::write(folder.path().join("a.toml"), text).unwrap();
    let args = ["--data", "d.csv", "--box-mm", "3000,1500,780", "--model", "a.toml"];
    let message = refused(&volcomp(folder.path(), &args), 65);
    assert!(message.contains("the model lacks ECX:"), "{message}");
}

#[test]
fn damaged_files_are_refused_with_their_place() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.toml"), angles("[0, 0]")).unwrap();
    let run = |text: &str| {
        std::fs::write(folder.path().join("d.csv"), text).unwrap();
        let args = ["--data", "d.csv", "--box-mm", "3000,1500,780", "--model", "a.toml"];
        refused(&volcomp(folder.path(), &args), 65)
    };
    let good = paper(1.0, true);
    assert!(
        run(&good.replace("pnp,", "ppp,"))
            .contains("diagonal pnp has no readings: three diagonals give rank 3")
    );
    assert!(run(&good.replacen("npp", "nqp", 1)).contains("d.csv:22:1: diagonal: invalid diagonal 'nqp'"));
    assert!(run(&good.replacen("ppp,1,1,0.000000", "ppp,1,1,9000", 1)).contains("is --box-mm right?"));
    assert!(run("diagonal,cycle,direction,target_mm\n").contains("column deviation_um is missing"));
    let args = ["--data", "d.csv", "--box-mm", "3000,1500,2", "--model", "a.toml"];
    assert!(refused(&volcomp(folder.path(), &args), 65).contains("factor of 1500, limit 1000"));
    assert!(refused(&volcomp(folder.path(), &["--data", "d.csv"]), 64).contains("--box-mm"));
}
