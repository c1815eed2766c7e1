//! `--input` and `--case` are the same for every method that takes cases; what is wrong with a case is refused with its
//! place, an exit code and nothing on stdout.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test runs the program on files")]

use std::path::Path;
use std::process::{Command, Output};

use serde_json::{Value, json};

fn identify(folder: &Path, method: &str, args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_volcomp"));
    command.arg("identify").arg(method).args(args).current_dir(folder).output().unwrap()
}

fn refused(output: &Output, code: i32) -> String {
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{message}");
    assert!(output.stdout.is_empty(), "{message}");
    assert!(message.starts_with("error: "), "{message}");
    message
}

/// A small case of every method.
fn cases() -> Vec<(&'static str, Value)> {
    let kept = |text: &str| serde_json::from_str::<Value>(text).unwrap()["cases"][1].clone();
    let still = json!({"at_0": [0, 0, 0, 0, 0, 0], "at_travel": [0, 0, 0, 0, 0, 0]});
    vec![
        ("threepoint", kept(include_str!("../vectors/threepoint.json"))),
        ("circles", kept(include_str!("../vectors/circles.json"))),
        ("nineline", kept(include_str!("../vectors/nineline.json"))),
        ("probe", kept(include_str!("../vectors/probe.json"))),
        ("ram", kept(include_str!("../vectors/ram.json"))),
        ("fits", kept(include_str!("../vectors/fits.json"))),
        ("kalman", kept(include_str!("../vectors/kalman.json"))),
        ("straightness", json!({"id": "S", "x": [0, 10, 20, 30], "y": [0, 1e-3, 1e-3, 0]})),
        (
            "diagonals",
            json!({"id": "D", "chain": "[w b X Y Z t]", "box": [300, 200, 100],
                "axis_errors_at_box_ends": {"X": still, "Y": still, "Z": still},
                "displacement": {"ppp": 1e-3, "npp": -2e-3, "pnp": 3e-3, "ppn": 0}}),
        ),
        (
            "fivedof",
            json!({"id": "F", "focal": {"f1": 230.1, "f2": 231.3, "f3": 106.5}, "distance": 785.2,
                "beam_1_yz": [-21.16, -12.3], "beam_2_yz": [47.49, -12.3],
                "readings": {"PSD1_y": 0.019, "PSD1_z": -0.009, "PSD2_y": 0, "PSD2_z": 0, "PSD3_y": 0, "PSD3_z": 0,
                    "QD2_y": -0.004, "QD2_z": 0.036, "QD1_y": -0.004, "QD1_z": 0.039}}),
        ),
    ]
}

#[test]
fn a_case_stands_alone_or_in_a_file_of_cases() {
    for (method, case) in cases() {
        let folder = tempfile::tempdir().unwrap();
        let id = case["id"].as_str().unwrap();
        std::fs::write(folder.path().join("one.json"), format!("\u{feff}{case:#}").replace('\n', "\r\n"))
            .unwrap();
        let file = json!({"cases": [{"id": "other"}, case]});
        std::fs::write(folder.path().join("file.json"), file.to_string()).unwrap();
        let run = |args: &[&str]| identify(folder.path(), method, args);

        let alone = run(&["--input", "one.json", "--json"]);
        assert!(alone.status.success(), "{method}: {}", String::from_utf8_lossy(&alone.stderr));
        let chosen = run(&["--input", "file.json", "--case", id, "--json"]);
        assert_eq!(alone.stdout, chosen.stdout, "{method}");

        let which = refused(&run(&["--input", "file.json", "--json"]), 64);
        assert!(which.contains(&format!("--case: other, {id}")), "{method}: {which}");
        let unknown = refused(&run(&["--input", "file.json", "--case", "none", "--json"]), 65);
        assert!(unknown.contains("no case none"), "{method}: {unknown}");
        refused(&run(&["--input", "one.json", "--case", "none", "--json"]), 65);
        let empty = refused(&run(&["--input", "file.json", "--case", "other"]), 65);
        assert!(empty.contains("missing field"), "{method}: {empty}");
        refused(&run(&["--input", "none.json", "--json"]), 74);
        refused(&run(&["--case", id, "--json"]), 64);
    }
}

#[test]
fn what_is_wrong_with_a_case_has_a_place() {
    for (method, mut case) in cases() {
        let folder = tempfile::tempdir().unwrap();
        // what is ignored cannot be wrong
        case.as_object_mut()
            .unwrap()
            .retain(|key, _| !(key.starts_with("expect") || key.starts_with("truth")));
        let text = format!("{case:#}");
        let cut = &text[..text.len() / 2];
        let infinite = text.replacen("0.0", "1e999", 1).replacen("-", "-1e999", 1);
        let key = case.as_object().unwrap().iter().find(|(_, v)| v.is_array() || v.is_object()).unwrap().0;
        let mut kind = case.clone();
        kind[key] = json!("text");
        for (damaged, what) in
            [(cut, ":"), (&infinite, ":"), (&format!("{kind:#}"), "invalid type"), ("", ":1:")]
        {
            std::fs::write(folder.path().join("bad.json"), damaged).unwrap();
            let message = refused(&identify(folder.path(), method, &["--input", "bad.json", "--json"]), 65);
            assert!(message.starts_with("error: bad.json:"), "{method}: {message}");
            assert!(message.contains(what), "{method}: {message}");
        }
    }
}

#[test]
fn a_case_writes_no_model() {
    for (method, case) in cases() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("case.json"), case.to_string()).unwrap();
        if matches!(method, "probe" | "fits") {
            // the place of a bar is a result of its case; plain curves have no model
            continue;
        }
        let output = identify(folder.path(), method, &["--input", "case.json", "--out", "model.toml"]);
        refused(&output, 64);
        assert!(!folder.path().join("model.toml").exists());
    }
}
