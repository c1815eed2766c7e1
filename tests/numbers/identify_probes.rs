//! `volcomp identify probe`, `grinder` and `ballbar` through the command line.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test runs the program and writes its files")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

fn volcomp(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcomp")).args(args).output().unwrap()
}

fn stdout(output: &Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout.clone()).unwrap()
}

/// Exit code and message of a run that must fail.
fn refused(args: &[&str]) -> (i32, String) {
    let output = volcomp(args);
    assert!(!output.status.success(), "{args:?} succeeded");
    assert!(output.stdout.is_empty(), "a failure prints no result");
    (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
}

/// Runs every case of a vector file and compares with what it expects.
fn check_probe_vectors(path: &Path) {
    let text = fs::read_to_string(path).unwrap();
    let file: Value = serde_json::from_str(&text).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let cases = file["cases"].as_array().unwrap();
    assert!(!cases.is_empty());
    for case in cases {
        let id = case["id"].as_str().unwrap();
        let one = folder.path().join("case.json");
        fs::write(&one, case.to_string()).unwrap();
        let alone = stdout(&volcomp(&["identify", "probe", "--input", one.to_str().unwrap(), "--json"]));
        let chosen = stdout(&volcomp(&[
            "identify",
            "probe",
            "--input",
            path.to_str().unwrap(),
            "--case",
            id,
            "--json",
        ]));
        assert_eq!(alone, chosen);
        let found: Value = serde_json::from_str(&alone).unwrap();
        for (key, expected) in case["expect"].as_object().unwrap() {
            let kasa = key.contains("kasa");
            let limit = file["tolerance"][if kasa { "kasa" } else { "geometric" }].as_f64().unwrap();
            let near = |got: &Value, want: &Value, limit: f64| {
                let (got, want) = (got.as_f64().unwrap(), want.as_f64().unwrap());
                assert!((got - want).abs() <= limit, "{id} {key}: {got} for {want}");
            };
            match expected {
                Value::Object(circle) => {
                    circle.iter().for_each(|(k, want)| near(&found[key][k], want, limit))
                }
                want if key.starts_with("cond") => near(&found[key], want, 1e-8 * want.as_f64().unwrap()),
                want => near(&found[key], want, limit),
            }
        }
    }
}

#[test]
fn probe_vectors() {
    check_probe_vectors(&PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/vectors/probe.json")));
}

#[test]
fn a_probe_from_a_table_says_what_it_is_worth() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("contacts.csv");
    let mut text = String::from("\u{feff}# upper side only\r\ny_mm,z_mm\r\n");
    for i in 0..60 {
        // a rough surface, repeatable without a generator
        let rough = 0.0005 * (f64::from(i * i * 7 % 13) / 6.0 - 1.0);
        let (angle, far) = (f64::from(90 + i).to_radians(), 16.5 + rough);
        text.push_str(&format!("{},{}\r\n", 168.8 + far * angle.cos(), far * angle.sin()));
    }
    fs::write(&file, text).unwrap();
    let file = file.to_str().unwrap();
    let base = ["identify", "probe", "--data", file, "--bar-radius-mm", "15"];
    let output = volcomp(&base);
    let (report, notes) = (stdout(&output), String::from_utf8(output.stderr).unwrap());
    assert!(
        report.contains("effective ball radius r_c") && report.contains("60 contacts over 59 deg"),
        "{report}"
    );
    assert!(notes.contains("touch it from both sides"), "{notes}");
    let model = folder.path().join("m.toml");
    let model = model.to_str().unwrap();
    stdout(&volcomp(&[&base[..], &["--nominal-mm", "168.79,0", "--out", model]].concat()));
    let written = fs::read_to_string(model).unwrap();
    assert!(written.contains("source-hash = \"blake3:"), "{written}");
    assert!(
        written.contains("[errors.ey0a.constant]") && written.contains("[errors.ez0a.constant]"),
        "{written}"
    );
    let (code, message) = refused(&[&base[..], &["--out", model]].concat());
    assert_eq!(code, 64, "{message}");
    let (code, message) = refused(&["identify", "probe", "--data", file, "--bar-radius-mm", "30"]);
    assert!(code == 65 && message.contains("not its diameter"), "{message}");
    let (code, message) = refused(&[&base[..], &["--arm-mm", "100", "--arm-zero-deg", "0"]].concat());
    assert!(code == 64 && message.contains("b_deg"), "{message}");
    let wrong = folder.path().join("wrong.csv");
    fs::write(&wrong, "y_mm,zmm\n1,2\n").unwrap();
    let (code, message) =
        refused(&["identify", "probe", "--data", wrong.to_str().unwrap(), "--bar-radius-mm", "15"]);
    assert!(code == 65 && message.contains("wrong.csv:1:6"), "{message}");
}

#[test]
fn a_vector_file_needs_a_case_that_exists() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/vectors/probe.json");
    let (code, message) = refused(&["identify", "probe", "--input", path, "--json"]);
    assert!(code == 64 && message.contains("PROBE-o3"), "{message}");
    let (code, message) = refused(&["identify", "probe", "--input", path, "--case", "X", "--json"]);
    assert!(code == 65 && message.contains("no case X"), "{message}");
}

/// A circle with squareness 60 um/m and 6 um of lost motion in X, both directions, with a turn of overshoot.
fn circle_csv() -> String {
    let mut text = String::from("angle_deg,deviation_um,direction,feed_mm_per_min\n");
    for direction in [1i32, -1] {
        for i in 0..=(720 * 2) {
            let angle = (f64::from(direction * (i - 360)) / 2.0).rem_euclid(360.0);
            let (s, c) = angle.to_radians().sin_cos();
            let travel = -f64::from(direction) * s.signum();
            let wobble = 0.05 * (f64::from(i * 37 % 101) / 50.0 - 1.0);
            let um = -60e-6 * 150e3 * s * c - 3.0 * travel * c + wobble;
            text.push_str(&format!("{angle},{um},{direction},1000\n"));
        }
    }
    text
}

#[test]
fn a_ballbar_circle_is_ranked_and_becomes_a_model() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("xy.csv");
    fs::write(&file, circle_csv()).unwrap();
    let data = format!("xy={}", file.display());
    let model = folder.path().join("m.toml");
    let model = model.to_str().unwrap();
    let base = ["identify", "ballbar", "--data", &data, "--radius-mm", "150", "--centre-mm=300,200,0"];
    let json = stdout(&volcomp(&[&base[..], &["--json", "--out", model]].concat()));
    let found: Value = serde_json::from_str(&json).unwrap();
    let plane = &found["planes"][0];
    assert_eq!(plane["ranking"][0]["effect"], "squareness:xy");
    assert_eq!(plane["ranking"][1]["effect"], "backlash:x");
    let feature = |name: &str| plane["features"][name]["value"].as_f64().unwrap();
    assert!((feature("AF_SQUARENESS") - 60.0).abs() < 0.2);
    assert_eq!(plane["features"]["AF_SQUARENESS"]["unit"], "um/m");
    assert!((feature("AF_BACKLASH_A_POS") - 6.0).abs() < 0.05);
    assert!((feature("AF_BACKLASH_A_NEG") - 6.0).abs() < 0.05);
    assert!(feature("AF_SERVO_MISMATCH").abs() < 0.01);
    let readings = plane["readings"].as_u64().unwrap();
    assert!((2 * 720..=2 * 722).contains(&readings), "{readings}: the overshoot is cut");
    // the same figure as volcomp evaluate gives for the measured turn
    let measured = folder.path().join("turn.csv");
    let turn: String = circle_csv()
        .lines()
        .enumerate()
        .filter(|(i, _)| *i == 0 || (361..=1081).contains(&((i - 1) % 1441 + 1)))
        .map(|(_, l)| l.rsplit_once(',').unwrap().0.to_owned() + "\n")
        .collect();
    fs::write(&measured, turn).unwrap();
    let figures =
        ["evaluate", "iso230-4", "--json", "--radius-mm", "150", "--data", measured.to_str().unwrap()];
    let figures: Value = serde_json::from_str(&stdout(&volcomp(&figures))).unwrap();
    let (ours, standard) = (plane["circularity_um"].as_f64().unwrap(), figures["g_bi_um"].as_f64().unwrap());
    assert!((ours - standard).abs() < 0.02, "{ours} {standard}");
    let written = fs::read_to_string(model).unwrap();
    assert!(
        written.contains("source = \"xy.csv\"") && written.contains("source-hash = \"blake3:"),
        "{written}"
    );
    assert!(written.contains("[errors.ec0y.constant]") && written.contains("reverse-um"), "{written}");
    let points = folder.path().join("p.csv");
    fs::write(&points, "x_mm,y_mm,dir_x\n300,200,1\n300,200,-1\n").unwrap();
    let predicted =
        stdout(&volcomp(&["predict", "--model", model, "--points", points.to_str().unwrap(), "--out", "-"]));
    let dx: Vec<f64> =
        predicted.lines().skip(1).map(|l| l.split(',').nth(3).unwrap().parse().unwrap()).collect();
    assert!((dx[1] - dx[0] - 6.0).abs() < 0.05, "lost motion of 6 um between the directions: {dx:?}");
    let report = stdout(&volcomp(&base));
    assert!(report.contains("squareness:xy") && report.contains("µm/m"), "{report}");
}

#[test]
fn ballbar_data_that_are_none_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("bad.csv");
    let data = format!("xy={}", file.display());
    let run = |text: &str, more: &[&str]| {
        fs::write(&file, text).unwrap();
        refused(&[&["identify", "ballbar", "--data", &data, "--radius-mm", "150"], more].concat())
    };
    let (code, message) = run("angle_deg,deviation_um\n0,1\n", &[]);
    assert!(code == 65 && message.contains("direction is missing"), "{message}");
    let (code, message) = run("angle_deg,deviation_um,direction\n0,1,1\n", &[]);
    assert!(code == 65 && message.contains("1 of at least 120 readings in plane xy"), "{message}");
    let (code, message) = run("angle_deg,deviation_um,direction\n0,nan,1\n", &[]);
    assert!(code == 65 && message.contains("bad.csv:2:3"), "{message}");
    let (code, message) = run(&circle_csv(), &["--data", &data]);
    assert!(code == 64 && message.contains("given twice"), "{message}");
    let (code, message) = run(&circle_csv(), &["--radius-mm", "0.15"]);
    assert!(code == 64 || message.contains("radius"), "{message}");
}

const DRAWING: &str = "format = \"volcomp-model/1\"\nmachine = \"g\"\nchain = \"[w A' b X Y B t]\"\n\
    [frame]\nworkpiece-origin-mm = [40, 0, 0]\ntool-tip-mm = [45, 80, 0]\n\
    [axes.a]\ntravel-deg = [-180, 180]\npoint-mm = [0, 0, 0]\n[axes.x]\ntravel-mm = [-50, 350]\n\
    [axes.y]\ntravel-mm = [-120, 180]\n[axes.b]\ntravel-deg = [-60, 60]\npoint-mm = [180, 80, 60]\n";

#[test]
fn a_grinder_is_planned_and_refused_step_by_step() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    fs::write(at("d.toml"), DRAWING).unwrap();
    let base = ["identify", "grinder", "--drawing", &at("d.toml")];
    stdout(&volcomp(&[&base[..], &["--next", &format!("a={}", at("a.csv")), "--positions", "9"]].concat()));
    let plan = fs::read_to_string(at("a.csv")).unwrap();
    let header = plan.lines().next().unwrap();
    assert_eq!(header, "a_deg,x_mm,y_mm,b_deg,tool_x_mm,tool_y_mm,tool_z_mm,ca_arcsec,cx_um,cy_um,cb_arcsec");
    // five visits of home and eight other positions, four tips each
    assert_eq!(plan.lines().count(), 1 + 4 * (5 + 8));
    // EAA of 10 arcsec at every position but home: z follows y, y follows -z, in the frame of the workpiece
    let rows: Vec<Vec<f64>> =
        plan.lines().skip(1).map(|l| l.split(',').map(|v| v.parse().unwrap()).collect()).collect();
    let mut text = String::from(header) + ",dx_um,dy_um,dz_um\n";
    for (r, line) in rows.iter().zip(plan.lines().skip(1)) {
        let turn = if r[0] == 0.0 { 0.0 } else { (10.0f64 / 3600.0).to_radians() };
        let (s, c) = r[0].to_radians().sin_cos();
        let (y, z) = (c * r[5] - s * r[6], s * r[5] + c * r[6]);
        text.push_str(&format!("{line},0,{},{}\n", -turn * z * 1e3, turn * y * 1e3));
    }
    fs::write(at("seen.csv"), &text).unwrap();
    let step = format!("a={}", at("seen.csv"));
    let model = at("m.toml");
    let json = stdout(&volcomp(&[&base[..], &["--step", &step, "--json", "--out", &model]].concat()));
    let found: Value = serde_json::from_str(&json).unwrap();
    let values = found["steps"][0]["motions"]["eaa"]["value_arcsec"].as_array().unwrap();
    let reference = found["steps"][0]["reference"].as_u64().unwrap() as usize;
    for (i, v) in values.iter().enumerate() {
        let want = if i == reference { 0.0 } else { 10.0 };
        assert!((v.as_f64().unwrap() - want).abs() < 1e-3, "{values:?}");
    }
    assert!(fs::read_to_string(&model).unwrap().contains("[errors.eaa.table]"));
    assert_eq!(fs::read_to_string(at("d.toml")).unwrap(), DRAWING, "the drawing stays");
    let report = stdout(&volcomp(&[&base[..], &["--step", &step]].concat()));
    assert!(report.contains("inherited") && report.contains("Assumed"), "{report}");
    let moved = text.replacen("\n0,0,0,0,", "\n0,5,0,0,", 1);
    fs::write(at("moved.csv"), moved).unwrap();
    let (code, message) = refused(&[&base[..], &["--step", &format!("a={}", at("moved.csv"))]].concat());
    assert!(code == 65 && message.contains("axis X moves by 5.000 mm"), "{message}");
    let (code, message) = refused(&[&base[..], &["--step", &step, "--step", &step]].concat());
    assert!(code == 65 && message.contains("identified in a step before"), "{message}");
    let (code, message) = refused(&base);
    assert!(code == 64 && message.contains("nothing to do"), "{message}");
    fs::write(at("none.csv"), "a_deg,x_mm\n0,0\n").unwrap();
    let (code, message) = refused(&[&base[..], &["--step", &format!("a={}", at("none.csv"))]].concat());
    assert!(code == 65 && message.contains("dx_um"), "{message}");
}
