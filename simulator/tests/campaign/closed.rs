//! A twin measured, diagnosed, corrected with what was found, and measured anew on another day.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]
#![expect(clippy::disallowed_methods, reason = "processes and files of a test")]

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use nalgebra::{Matrix3, Vector3};
use serde_json::{Value, json};
use simulator::campaign::{Campaign, Plan, Taken, files, run_campaign, run_corrected};
use simulator::twin::TwinTruth;
use simulator::twin::machine::nominal_model;

use crate::support::{Corrected, Loop};

/// Runs cncsim in a folder; what it prints.
pub(crate) fn run(dir: &Path, args: &[&str]) -> String {
    let out = Command::new(env!("CARGO_BIN_EXE_cncsim")).args(args).current_dir(dir).output().unwrap();
    assert!(out.status.success(), "{args:?}: {}", String::from_utf8_lossy(&out.stderr));
    String::from_utf8(out.stdout).unwrap()
}

/// What a campaign leaves behind: sessions, log, the drawing of the machine. Nothing of the truth.
fn leave(campaign: &Campaign, out: &Path) {
    std::fs::create_dir(out).unwrap();
    let sessions = files::sessions(campaign);
    let data: Vec<_> = sessions.iter().map(|s| out.join(&s.name)).collect();
    for text in sessions.iter().chain([&files::history(campaign)]) {
        std::fs::write(out.join(&text.name), &text.text).unwrap();
    }
    std::fs::write(out.join("model.toml"), nominal_model()).unwrap();
    std::fs::write(out.join("campaign.json"), json!({ "data": data }).to_string()).unwrap();
}

/// Measures the machine as it is.
pub(crate) fn uncorrected(truth: &TwinTruth, plan: Plan, day: u64, out: &Path) -> Campaign {
    let campaign = run_campaign(truth, plan, day).unwrap();
    leave(&campaign, out);
    campaign
}

/// Measures the machine with volcompd's engine beside its control; `better.toml` stands beside `out`.
pub(crate) fn corrected(truth: &TwinTruth, plan: Plan, day: u64, nature: Loop, out: &Path) -> Campaign {
    let better = std::fs::read_to_string(out.with_file_name("better.toml")).unwrap();
    let campaign = run_corrected(truth, plan, day, Box::new(Corrected::new(&better, nature))).unwrap();
    leave(&campaign, out);
    campaign
}

/// Diagnoses the sessions of a folder; the report.
pub(crate) fn diagnose(dir: &Path, campaign: &str, out: &str) -> Value {
    let model = format!("{campaign}/model.toml");
    let history = format!("{campaign}/history.csv");
    let mut args = vec!["volcomp", "diagnose", "--model", &model, "--history", &history, "--out", out];
    let listed = std::fs::read_to_string(dir.join(campaign).join("campaign.json")).unwrap();
    let listed: Value = serde_json::from_str(&listed).unwrap();
    let data: Vec<&str> = listed["data"].as_array().unwrap().iter().map(|p| p.as_str().unwrap()).collect();
    for file in data {
        args.extend(["--data", file]);
    }
    run(dir, &args);
    serde_json::from_str(&std::fs::read_to_string(dir.join(out).join("report.json")).unwrap()).unwrap()
}

/// Makes what was found part of the model; what `model extend` says of it.
pub(crate) fn extend(dir: &Path) -> Value {
    let args =
        ["--model", "monday/model.toml", "--add", "gap/addition.toml", "--out", "better.toml", "--json"];
    serde_json::from_str(&run(dir, &[&["volcomp", "model", "extend"][..], &args].concat())).unwrap()
}

/// The declared causes of a report with their groups.
pub(crate) fn declared(report: &Value) -> BTreeMap<String, Vec<String>> {
    let text = |v: &Value| v.as_str().unwrap().to_owned();
    let label = |c: &Value| match (text(&c["effect"]), text(&c["subject"])) {
        (effect, subject) if subject.is_empty() => effect,
        (effect, subject) => format!("{effect}:{subject}"),
    };
    let group = |c: &Value| c["confounded_with"].as_array().unwrap().iter().map(text).collect();
    let causes = report["causes"].as_array().unwrap().iter();
    causes.filter(|c| c["declared"] == true).map(|c| (label(c), group(c))).collect()
}

/// RMS of what the machine really does, um, without the offset vector of each setup; no instrument has touched it.
pub(crate) fn really(taken: &Taken) -> f64 {
    let mut setups: BTreeMap<i64, Vec<(Vector3<f64>, f64)>> = BTreeMap::new();
    for s in &taken.states {
        setups.entry(s.place[0]).or_default().push((Vector3::from(s.u), s.true_um));
    }
    let mut sum = 0.0;
    for rows in setups.values() {
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for (u, true_um) in rows {
            normal += u * u.transpose();
            right += u * *true_um;
        }
        // a laser sees one direction only
        let offset = normal.pseudo_inverse(1e-9).unwrap() * right;
        sum += rows.iter().map(|(u, true_um)| (true_um - u.dot(&offset)).powi(2)).sum::<f64>();
    }
    (sum / taken.states.len() as f64).sqrt()
}
