//! `cncsim campaign`: files as in `docs/reference/session-files.md`, a day is a day, and nothing of the truth is in them.

#![expect(clippy::disallowed_methods, reason = "a test of processes and files")]
#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

const TRUTH: &str = "format = \"volcomp-twin/1\"\nseed = 5\n[instruments]\ndropouts = 0.03\n\
[[effect]]\nname = \"backlash\"\nsubject = \"x\"\nsize-um = 3.0\n\
[[effect]]\nname = \"thermal-expansion\"\nsubject = \"y\"\nsize-um = 4.0\n";

fn campaign(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_cncsim")).arg("campaign").args(args).output().unwrap()
}

fn texts(folder: &Path) -> BTreeMap<String, String> {
    fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "csv"))
        .map(|p| (p.file_name().unwrap().to_string_lossy().into_owned(), fs::read_to_string(p).unwrap()))
        .collect()
}

#[test]
fn a_day_is_the_same_bytes_and_another_day_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let truth = folder.path().join("twin.toml");
    fs::write(&truth, TRUTH).unwrap();
    let run = |out: &str, seed: &str| {
        let to = folder.path().join(out);
        let words = ["--plan", "small", "--seed", seed, "--truth"];
        let done =
            campaign(&[&words[..], &[truth.to_str().unwrap(), "--out", to.to_str().unwrap()]].concat());
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        texts(&to)
    };
    let (monday, again, tuesday) = (run("a", "1"), run("b", "1"), run("c", "2"));
    assert_eq!(monday, again);
    assert_ne!(monday, tuesday);
    let mut lost = 0;
    for name in ["laser", "ballbar", "tracker", "probe", "rtest", "load", "dynamic", "capture"] {
        let text = &monday[&format!("{name}.csv")];
        let head: Vec<&str> = text.lines().next().unwrap().split(',').collect();
        for column in ["t_s", "instrument", "setup", "run", "repeat", "pair", "x_mm", "u_z", "deviation_um"] {
            assert!(head.contains(&column), "{name}: {column}");
        }
        let place = |c: &str| head.iter().position(|h| *h == c).unwrap();
        let mut before = f64::NEG_INFINITY;
        let mut empty = 0;
        for line in text.lines().skip(1) {
            let fields: Vec<&str> = line.split(',').collect();
            assert_eq!(fields.len(), head.len(), "{line}");
            assert_eq!(fields[place("instrument")], name);
            let number = |c: &str| fields[place(c)].parse::<f64>().unwrap();
            assert!(number("t_s") >= before, "{line}");
            before = number("t_s");
            let u = ["u_x", "u_y", "u_z"].map(number).iter().map(|v| v * v).sum::<f64>();
            assert!((u - 1.0).abs() < 1e-4, "{line}");
            empty += usize::from(fields[place("deviation_um")].is_empty());
        }
        lost += empty;
        assert!(empty * 5 < text.lines().count(), "{name} lost {empty}");
        assert!(!text.contains("backlash") && !text.contains("thermal"));
    }
    assert!(lost > 0, "a share of 0.03 was to be lost");
    let log = &monday["history.csv"];
    assert!(log.starts_with("t_s,spindle_rpm,temp_x_degc"), "{log:.80}");
    let first: f64 = log.lines().nth(1).unwrap().split(',').next().unwrap().parse().unwrap();
    let reading: f64 =
        monday["ballbar.csv"].lines().nth(1).unwrap().split(',').next().unwrap().parse().unwrap();
    assert!(reading - first > 7200.0, "the log begins two hours before: {first} {reading}");
}

#[test]
fn what_is_wrong_with_a_truth_file_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let truth = folder.path().join("twin.toml");
    let wrong = [
        ("format = \"volcomp-truth/1\"\n", "volcomp-twin/1"),
        (
            "format = \"volcomp-twin/1\"\n[[effect]]\nname = \"gremlin\"\nsize-um = 1.0\n",
            "unknown effect `gremlin`",
        ),
        (
            "format = \"volcomp-twin/1\"\n[[effect]]\nname = \"backlash\"\nsubject = \"c\"\nsize-um = 1.0\n",
            "x y z",
        ),
        (
            "format = \"volcomp-twin/1\"\n[[effect]]\nname = \"scale\"\nsubject = \"x\"\nsize-um = 1.0\nwith = { a = 1.0 }\n",
            "no constant a",
        ),
        ("format = \"volcomp-twin/1\"\n[instruments]\nnoise = -1.0\n", "instruments.noise"),
        ("format = \"volcomp-twin/1\"\nnoise = 1\n", "unknown field"),
    ];
    for (text, said) in wrong {
        fs::write(&truth, text).unwrap();
        let out = folder.path().join("out");
        let done = campaign(&["--truth", truth.to_str().unwrap(), "--out", out.to_str().unwrap()]);
        let message = String::from_utf8_lossy(&done.stderr).into_owned();
        assert_eq!(done.status.code(), Some(78), "{message}");
        assert!(message.contains(said), "{message}");
    }
}

/// Readings by file and line: mounting and direction of sensitivity, and the deviation where there is one.
fn readings(folder: &Path) -> Vec<(String, Option<f64>)> {
    let mut all = Vec::new();
    for (name, text) in texts(folder) {
        let head: Vec<&str> = text.lines().next().unwrap().split(',').collect();
        let Some(value) = head.iter().position(|h| *h == "deviation_um") else { continue };
        let place = |c: &str| head.iter().position(|h| *h == c).unwrap();
        for line in text.lines().skip(1) {
            let f: Vec<&str> = line.split(',').collect();
            let group = ["setup", "u_x", "u_y", "u_z"].map(|c| f[place(c)]).join(" ");
            all.push((format!("{name} {group}"), f[value].parse().ok()));
        }
    }
    all
}

/// RMS of the differences of two campaigns, each mounting's offset along each direction taken out.
fn apart_um(a: &[(String, Option<f64>)], b: &[(String, Option<f64>)]) -> f64 {
    let mut groups: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for ((group, a), (_, b)) in a.iter().zip(b) {
        if let (Some(a), Some(b)) = (a, b) {
            groups.entry(group).or_default().push(a - b);
        }
    }
    let mut square = 0.0;
    let mut count = 0.0;
    for values in groups.into_values().filter(|v| v.len() > 5) {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        square += values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
        count += values.len() as f64;
    }
    (square / count).sqrt()
}

#[test]
fn the_twin_takes_what_the_diagnosis_has_found_and_comes_close_to_the_real_machine() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    fs::write(path("twin.toml"), TRUTH.replace("dropouts = 0.03", "")).unwrap();
    let run = |more: &[&str], out: &str| {
        let done = campaign(&[&["--plan", "small", "--seed", "1", "--out", out][..], more].concat());
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        readings(Path::new(out))
    };
    let real = run(&["--truth", &path("twin.toml")], &path("real"));
    let plain = run(&[], &path("plain"));
    let mut words: Vec<String> =
        ["volcomp", "diagnose", "--model", "real/model.toml", "--out", "gap"].map(String::from).into();
    for name in texts(&folder.path().join("real")).keys() {
        let kind = if name == "history.csv" { "--history" } else { "--data" };
        words.extend([kind.to_owned(), format!("real/{name}")]);
    }
    let done =
        Command::new(env!("CARGO_BIN_EXE_cncsim")).args(&words).current_dir(folder.path()).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    // found on one day, put on the twin: what the simulation now says of the real machine on that day
    let twin = run(&["--add", &path("gap/addition.toml")], &path("twin"));
    let (before, after) = (apart_um(&real, &plain), apart_um(&real, &twin));
    println!(
        "real machine beside the plain twin {before:.2} um RMS, beside the twin with the addition {after:.2} um"
    );
    assert!(before > 1.0, "the truth is to be felt: {before} um");
    assert!(after < 0.35 * before, "{before} -> {after} um");
    // an addition that is none, and of another machine
    let refused = campaign(&["--out", &path("x"), "--add", &path("twin.toml")]);
    assert_ne!(refused.status.code(), Some(0));
    let message = String::from_utf8(refused.stderr).unwrap();
    assert!(message.contains("twin.toml"), "{message}");
}
