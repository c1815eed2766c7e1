//! `volcomp predict` from the outside: reference vectors through files, and bad input one by one.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes and reads files")]

use std::collections::HashMap;
use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde_json::Value;

const MODEL: &str = r#"
format = "volcomp-model/1"
machine = "test"
chain = "[w X' b Y Z t]"
[frame]
workpiece-origin-mm = [0, 0, 0]
tool-tip-mm = [0, 0, -100]
gauge-point-mm = [0, 0, 0]
[axes.x]
travel-mm = [0, 500]
[axes.y]
travel-mm = [0, 400]
[errors.exx.table]
position-mm = [0, 500]
value-um = [0, 10]
reverse-um = [5, 15]
[errors.eay.constant]
value-arcsec = 10
"#;

fn predict(directory: &Path, model: &str, points: &str, extra: &[&str]) -> Output {
    std::fs::write(directory.join("m.toml"), model).unwrap();
    std::fs::write(directory.join("p.csv"), points).unwrap();
    Command::new(env!("CARGO_BIN_EXE_volcomp"))
        .current_dir(directory)
        .args(["predict", "--model", "m.toml", "--points", "p.csv", "--out", "e.csv"])
        .args(extra)
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

/// Header and rows of the result.
fn result(directory: &Path) -> Vec<HashMap<String, String>> {
    let text = std::fs::read_to_string(directory.join("e.csv")).unwrap();
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    lines
        .map(|l| header.iter().map(|h| (*h).to_owned()).zip(l.split(',').map(str::to_owned)).collect())
        .collect()
}

fn number(row: &HashMap<String, String>, key: &str) -> f64 {
    row.get(key).unwrap_or_else(|| panic!("column {key}")).parse().unwrap()
}

fn predicted(points: &str, extra: &[&str]) -> Vec<HashMap<String, String>> {
    let directory = tempfile::tempdir().unwrap();
    let output = predict(directory.path(), MODEL, points, extra);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    result(directory.path())
}

#[test]
fn a_direction_that_is_not_known_is_that_towards_plus() {
    let rows = predicted(
        "x_mm,dir_x,tool_z_mm\n100,1,-50\n100,0,-50\n100,,-50\n100,-1,-50\n100,1,\n100,1,-100\n",
        &[],
    );
    let at = |row: usize| ["dx_um", "dy_um", "cx_um"].map(|key| number(&rows[row], key));
    assert_eq!((at(1), at(2)), (at(0), at(0)));
    assert_ne!(at(3), at(0));
    assert_eq!(at(4), at(5), "the tip of the model");
    assert_ne!(at(4), at(0));
}

fn list(v: &Value) -> String {
    let numbers: Vec<String> =
        v.as_array().unwrap().iter().map(|n| format!("{:e}", n.as_f64().unwrap())).collect();
    format!("[{}]", numbers.join(", "))
}

const RAD_PER_ARCSEC: f64 = core::f64::consts::PI / 648_000.0;

fn constant(text: &mut String, symbol: &str, angle: bool, value: f64) {
    let (key, value) =
        if angle { ("value-arcsec", value / RAD_PER_ARCSEC) } else { ("value-um", value * 1e3) };
    writeln!(text, "[errors.{symbol}.constant]\n{key} = {value:e}").unwrap();
}

/// The model file of a kinematic vector.
fn model_text(case: &Value) -> String {
    let mut text = String::from("format = \"volcomp-model/1\"\n");
    writeln!(text, "machine = {}\nchain = {}", case["id"], case["chain"]).unwrap();
    writeln!(text, "[frame]\nworkpiece-origin-mm = {}", list(&case["workpiece_origin"])).unwrap();
    writeln!(text, "tool-tip-mm = {}", list(&case["tool_tip"])).unwrap();
    let mut errors = String::new();
    for (letter, axis) in case["axes"].as_object().unwrap() {
        let lower = letter.to_lowercase();
        writeln!(text, "[axes.{lower}]").unwrap();
        if axis["kind"] == "rotary" {
            writeln!(text, "point-mm = {}", list(&axis["point"])).unwrap();
        }
        if axis["sense"] == "carriage" {
            writeln!(text, "sense = \"carriage\"").unwrap();
        }
        if let Some(reference) = axis["ref"].as_object().filter(|_| axis["kind"] == "linear") {
            let points: Vec<String> =
                reference.iter().map(|(c, p)| format!("{} = {}", c.to_lowercase(), list(p))).collect();
            writeln!(text, "reference-points-mm = {{ {} }}", points.join(", ")).unwrap();
        }
        for (i, component) in ["x", "y", "z", "a", "b", "c"].iter().enumerate() {
            constant(&mut errors, &format!("e{component}{lower}"), i > 2, axis["E"][i].as_f64().unwrap());
            if let Some(value) = axis["location"][i].as_f64().filter(|v| *v != 0.0) {
                constant(&mut errors, &format!("e{component}0{lower}"), i > 2, value);
            }
        }
    }
    for (key, value) in case["squareness"].as_object().unwrap() {
        constant(&mut errors, &format!("e{}", key.to_lowercase()), true, value.as_f64().unwrap());
    }
    text + &errors
}

fn assert_near(id: &str, what: &str, got: f64, expected: f64, tolerance: f64) {
    assert!((got - expected).abs() <= tolerance, "{id} {what}: {got} instead of {expected}");
}

#[test]
fn the_kinematic_vectors_through_files() {
    let directory = tempfile::tempdir().unwrap();
    let mut cases = 0;
    for file in ["kin_three_axis", "kin_gantry", "kin_grinder"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/vectors/{file}.json"));
        let text = std::fs::read_to_string(&path).unwrap();
        let data: Value = serde_json::from_str(&text).unwrap();
        for case in data["cases"].as_array().unwrap() {
            let id = case["id"].as_str().unwrap();
            let (mut header, mut row) = (Vec::new(), Vec::new());
            for (letter, q) in case["q"].as_object().unwrap() {
                let rotary = case["axes"][letter]["kind"] == "rotary";
                header.push(format!("{}_{}", letter.to_lowercase(), if rotary { "deg" } else { "mm" }));
                let q = q.as_f64().unwrap();
                row.push(format!("{:e}", if rotary { q.to_degrees() } else { q }));
            }
            let points = format!("{}\n{}\n", header.join(","), row.join(","));
            for (mode, extra, tolerance_um, tolerance_arcsec) in
                [("first", &[][..], 3e-9, 3e-9), ("exact", &["--exact"][..], 2e-7, 5e-5)]
            {
                let output = predict(directory.path(), &model_text(case), &points, extra);
                assert!(output.status.success(), "{id}: {}", String::from_utf8_lossy(&output.stderr));
                let rows = result(directory.path());
                let expect = &case["expect"];
                for i in 0..3 {
                    let e = expect[format!("e_{mode}")][i].as_f64().unwrap() * 1e3;
                    let key = ["dx_um", "dy_um", "dz_um"][i];
                    assert_near(id, key, number(&rows[0], key), e, tolerance_um);
                    let theta = expect[format!("theta_{mode}")][i].as_f64().unwrap() / RAD_PER_ARCSEC;
                    let key = ["da_arcsec", "db_arcsec", "dc_arcsec"][i];
                    assert_near(id, key, number(&rows[0], key), theta, tolerance_arcsec);
                }
                if mode == "first" {
                    corrections(id, expect, &rows[0]);
                }
            }
            cases += 1;
        }
    }
    assert_eq!(cases, 35);
}

fn corrections(id: &str, expect: &Value, row: &HashMap<String, String>) {
    if let Some(five) = expect["five_axis_correction_first"].as_object() {
        for axis in ["X", "Y", "Z"] {
            let key = format!("c{}_um", axis.to_lowercase());
            assert_near(id, &key, number(row, &key), five[axis].as_f64().unwrap() * 1e3, 1e-6);
        }
        for axis in ["A", "C"] {
            let key = format!("c{}_arcsec", axis.to_lowercase());
            assert_near(id, &key, number(row, &key), five[axis].as_f64().unwrap() / RAD_PER_ARCSEC, 1e-6);
        }
        assert!(!row.contains_key("cs_arcsec"), "a spindle has no correction");
    } else if row.contains_key("cz_um") {
        for (i, key) in ["cx_um", "cy_um", "cz_um"].into_iter().enumerate() {
            assert_near(
                id,
                key,
                number(row, key),
                expect["correction_first"][i].as_f64().unwrap() * 1e3,
                3e-9,
            );
        }
    }
}

#[test]
fn columns_flags_and_directions() {
    let rows = predicted(
        "\u{feff}# three points\r\nt_s,x_mm,y_mm,z_mm,dir_x\r\n0.5,250,10,0,1\r\n\r\n1,250,10,0,-1\r\n2,600,401,-7,1\r\n",
        &[],
    );
    assert_eq!(rows.len(), 3);
    assert_eq!(rows[0]["t_s"], "0.5");
    assert_eq!(number(&rows[0], "dx_um"), 5.0);
    assert_eq!(number(&rows[0], "cx_um"), -5.0);
    assert_eq!(number(&rows[1], "dx_um"), 10.0);
    assert_eq!(number(&rows[0], "da_arcsec"), 10.0);
    assert_eq!(rows[0]["flags"], "");
    assert_eq!(rows[2]["flags"], "x:out-of-travel y:out-of-travel");
    // the end value is held
    assert_eq!(number(&rows[2], "dx_um"), 10.0);
}

#[test]
fn the_tool_may_change_from_point_to_point() {
    // roll of Y acts on the tip with its lever: dy = -eay (z - 0)
    let lever = |length: f64| 10.0 * RAD_PER_ARCSEC * length * 1e3;
    let rows = predicted("x_mm,y_mm,tool_z_mm\n0,0,-100\n0,0,-250\n", &[]);
    assert_near("tool_z", "dy", number(&rows[0], "dy_um"), lever(100.0), 1e-8);
    assert_near("tool_z", "dy", number(&rows[1], "dy_um"), lever(250.0), 1e-8);
    let rows = predicted("x_mm,y_mm,tool_length_mm\n0,0,250\n0,0,0\n", &[]);
    assert_near("length", "dy", number(&rows[0], "dy_um"), lever(250.0), 1e-8);
    assert_near("length", "dy", number(&rows[1], "dy_um"), 0.0, 1e-8);
}

#[test]
fn standard_input_and_output() {
    use std::io::Write as _;
    let directory = tempfile::tempdir().unwrap();
    std::fs::write(directory.path().join("m.toml"), MODEL).unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_volcomp"))
        .current_dir(directory.path())
        .args(["predict", "--model", "m.toml", "--points", "-", "--out", "-"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(b"x_mm\n500").unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success());
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(
        text.starts_with(
            "x_mm,dx_um,dy_um,dz_um,da_arcsec,db_arcsec,dc_arcsec,cx_um,cy_um,cz_um,flags\n500,10,"
        ),
        "{text}"
    );
}

#[test]
fn bad_points_are_refused_and_leave_no_file() {
    for (points, expected) in [
        ("", "p.csv: the file is empty"),
        ("t_s\n1\n", "no column with an axis of the chain"),
        ("x_mm,x_mm\n", "p.csv:1:6: column x_mm occurs twice"),
        ("xmm\n1\n", "p.csv:1:1: xmm: unknown column; axis X is given as x_mm"),
        ("X_mm\n1\n", "axis X is given as x_mm"),
        ("x_deg\n1\n", "axis X is given as x_mm"),
        ("x_mm,c_deg\n", "c_deg: axis C is not in the chain of the model"),
        ("x_mm,dir_c\n", "axis C is not in the chain"),
        ("x_mm,tool_w_mm\n", "tool_w_mm: unknown column"),
        ("x_mm,tool_lenght_mm\n", "is tool_length_mm meant?"),
        ("x_mm,dx_um\n", "predict writes this column itself"),
        ("x_mm,tool_z_mm,tool_length_mm\n", "both place the tip"),
        ("x_mm,y_mm\n1,2\n3,abc\n", "p.csv:3:3: y_mm: 'abc' is not a number"),
        ("x_mm\nnan\n", "p.csv:2:1: x_mm: nan is not finite"),
        ("x_mm\ninf\n", "inf is not finite"),
        ("x_mm,y_mm\n1\n", "p.csv:2: 1 fields, the header has 2 columns"),
        ("x_mm,y_mm\n1,\n", "the field is empty"),
        ("x_mm,dir_x\n1,2\n", "2 is no direction"),
        ("comment,x_mm,y_mm\n\"a, b\",1,abc\n", "p.csv:2:10: y_mm: 'abc' is not a number"),
    ] {
        let directory = tempfile::tempdir().unwrap();
        let output = predict(directory.path(), MODEL, points, &[]);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(65), "{points:?}: {message}");
        assert!(message.contains(expected), "{points:?} gives {message:?}");
        assert!(output.stdout.is_empty());
        let left: Vec<_> =
            std::fs::read_dir(directory.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert_eq!(left.len(), 2, "{points:?} leaves {left:?}");
    }
}

#[test]
fn other_failures_have_their_exit_codes() {
    let directory = tempfile::tempdir().unwrap();
    let code = |model: &str, extra: &[&str]| {
        let output = predict(directory.path(), model, "x_mm\n0\n", extra);
        (output.status.code().expect("ends by itself"), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    assert_eq!(code("format = \"volcomp-model/9\"", &[]).0, 78);
    let no_gauge = MODEL.replace("gauge-point-mm = [0, 0, 0]\n", "");
    let output = predict(directory.path(), &no_gauge, "x_mm,tool_length_mm\n0,1\n", &[]);
    assert_eq!(output.status.code(), Some(65));
    assert!(String::from_utf8_lossy(&output.stderr).contains("the model has no gauge point"));
    let (status, message) = code(MODEL, &["--add", "addition.toml"]);
    assert!(status == 74 && message.contains("addition.toml"), "{message}");
    let missing = Command::new(env!("CARGO_BIN_EXE_volcomp"))
        .args(["predict", "--model", "missing.toml", "--points", "p.csv", "--out", "-"])
        .current_dir(directory.path())
        .output()
        .expect("runs");
    assert_eq!(missing.status.code(), Some(74));
    assert!(String::from_utf8_lossy(&missing.stderr).contains("missing.toml"));
}

#[test]
fn readings_of_temperatures_enter_as_the_daemon_takes_them() {
    let model = format!(
        "{MODEL}[errors.exx.live]\nsensor = \"scale-x\"\nlimit-um = 300\nreference-mm = 100\n\
         [thermal.scale-x]\nkind = \"expansion\"\n[[thermal.scale-x.input]]\nsensor = \"scales.1\"\n\
         range-degc = [10, 30]\nreference-degc = 20\nstrain-um-per-m-k = [11.5]\n"
    );
    let points = "x_mm,y_mm,z_mm,dir_x\n100,0,0,1\n400,0,0,1\n";
    let directory = tempfile::tempdir().unwrap();
    let of = |extra: &[&str]| {
        let out = predict(directory.path(), &model, points, extra);
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        let rows = result(directory.path());
        rows.iter().map(|r| number(r, "dx_um")).collect::<Vec<f64>>()
    };
    let (cold, warm) = (of(&[]), of(&["--reading", "scales.1=22"]));
    // X carries the workpiece, and so does its error: the strain of 2 K over 300 mm
    assert!((warm[0] - cold[0]).abs() < 1e-6, "{warm:?} {cold:?}");
    let grown = warm[1] - cold[1];
    assert!((grown.abs() - 11.5 * 2.0 * 0.3).abs() < 1e-3, "{grown}");
    for (reading, words) in [
        ("scales.2=22", "nothing in m.toml depends on this sensor; its [thermal.NAME] depend on scales.1"),
        ("scales.1", "give SENSOR=VALUE"),
        ("scales.1=nan", "give SENSOR=VALUE"),
    ] {
        let out = predict(directory.path(), &model, points, &["--reading", reading]);
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert!(!out.status.success() && said.contains(words), "{said}");
    }
    let out = predict(directory.path(), MODEL, points, &["--reading", "scales.1=22"]);
    assert!(String::from_utf8_lossy(&out.stderr).contains("it has no [thermal.NAME] that an error names"));
}
