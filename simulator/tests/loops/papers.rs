//! One seed of each paper's experiment: every limit holds with kind and hard truth, the JSON says so, and the figures do
//! not depend on the load of the computer, so that these tests run beside others.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test starts programs")]

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

/// The entries of one seed of a paper, by truth; all limits hold.
fn experiment(paper: &str, truth: &str) -> Vec<Value> {
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_cncsim"))
        .args(["paper", paper, "--seed", "1", "--json", "--no-shares", "--truth", truth, "--out"])
        .arg(folder.path())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let json: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(json["format"], "volcomp-paper/1");
    let entries = json["papers"].as_array().unwrap().clone();
    let truths: Vec<&str> = entries.iter().map(|e| e["truth"].as_str().unwrap()).collect();
    assert_eq!(truths, if truth == "both" { vec!["kind", "hard"] } else { vec![truth] });
    for entry in &entries {
        assert_eq!((&entry["paper"], &entry["seed"]), (&paper.into(), &1.into()));
        let figures = entry["figures"].as_array().unwrap();
        assert!(!figures.is_empty());
        for f in figures {
            let [name, unit] = ["name", "unit"].map(|key| f[key].as_str().unwrap());
            assert!(!name.is_empty() && f["ours"].is_number() && f["limit"].is_number(), "{f} {unit}");
            assert!(f["pass"] == true && f.as_object().unwrap().contains_key("paper"), "{f}");
        }
        let report = std::fs::read_to_string(entry["report"].as_str().unwrap()).unwrap();
        assert!(report.contains("<svg") && !report.contains("NaN"), "plots without gaps");
    }
    entries
}

#[test]
fn tracker_points_against_nine_lines() {
    experiment("000", "both");
}

#[test]
fn lasers_live_on_three_axes() {
    experiment("002", "hard");
}

#[test]
fn circle_predicted_and_compensated() {
    experiment("004", "both");
}

#[test]
fn parts_cut_by_a_gantry_with_a_drifting_ram() {
    let both = experiment("003", "both");
    let again = experiment("003", "kind");
    // bit for bit: the estimator keeps the control's time
    for part in ["figures", "reported"] {
        assert_eq!(both[0][part], again[0][part]);
    }
}

#[test]
fn a_gear_inspected_on_its_grinder() {
    experiment("001", "both");
}

#[test]
fn a_daemon_ends_with_the_program_that_started_it() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("machine.toml");
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("../config/examples/vmc-850/model.toml");
    std::fs::copy(model, folder.path().join("model.toml")).unwrap();
    let text = "format = \"volcomp-machine/1\"\nmachine = \"vmc-850\"\nmodel = \"model.toml\"\n\
        [link]\naddress = \"127.0.0.1:1\"\n[status]\nsocket = \"\"\n[log]\ntarget = \"stderr\"\n";
    let axes = ["x", "y", "z"].map(|a| {
        format!("[axes.{a}]\nlimit-um = 150\nrate-um-per-s = 2000\nacceleration-um-per-s2 = 40000\n")
    });
    std::fs::write(&config, text.to_owned() + &axes.concat()).unwrap();
    // the shell stands for an experiment that is killed
    let mut shell = Command::new("sh")
        .args(["-c", "\"$0\" volcompd --config \"$1\" 2>&1 & echo $!; wait", env!("CARGO_BIN_EXE_cncsim")])
        .arg(&config)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(shell.stdout.take().unwrap()).lines().map(Result::unwrap);
    let stat = format!("/proc/{}/stat", lines.next().unwrap());
    assert!(lines.any(|line| line.contains("no link")), "the daemon did not start");
    let runs = || std::fs::read_to_string(&stat).is_ok_and(|s| !s.contains(") Z "));
    assert!(runs());
    shell.kill().unwrap();
    shell.wait().unwrap();
    let deadline = Instant::now() + Duration::from_secs(10);
    while runs() {
        assert!(Instant::now() < deadline, "the daemon still runs");
        std::thread::sleep(Duration::from_millis(20));
    }
}
