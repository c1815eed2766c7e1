//! Orders to a running `volcompd`: another model, back again, gain, shadow mode, and what speaks against enabling.

#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test program: it fails by panicking")]

use std::fs;
use std::process::Output;

use crate::support::{Daemon, EXX_MM, Port, STEP_MM_MAX, Session, Setup, eventually};
use rustix::process::Signal;
use serde_json::Value;

const KEPT: &str = "[state]\ndirectory = \"state\"\n";

/// EXX = `um` everywhere.
fn model(um: f64) -> String {
    format!(
        "format = \"volcomp-model/1\"\nmachine = \"test-mill\"\nchain = \"[w X' b Y Z t]\"\n\
         [axes.x]\ntravel-mm = [0, 400]\n[errors.exx.constant]\nvalue-um = {um}\n"
    )
}

fn setup(more: &'static str) -> Setup {
    Setup { more, ..Setup::default() }
}

/// Writes a model beside the daemon's files and gives its path.
fn file(daemon: &Daemon, name: &str, text: &str) -> String {
    let path = daemon.dir.path().join(name);
    fs::write(&path, text).expect("written");
    path.display().to_string()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn json(output: &Output) -> Value {
    assert!(output.status.success(), "{}", stderr(output));
    serde_json::from_slice(&output.stdout).expect("JSON")
}

/// Cycles while an order is given from another thread; no step is larger than allowed. Ends with the offset of X.
fn cycle_while(session: &mut Session, cycles: u32, order: impl FnOnce() -> Output + Send) -> Output {
    std::thread::scope(|scope| {
        let order = scope.spawn(order);
        let mut left = cycles;
        while !order.is_finished() || left > 0 {
            let before = session.applied[0];
            let _ = session.cycle();
            let step = (session.applied[0] - before).abs();
            assert!(step <= STEP_MM_MAX * 1.001, "a step of {step} mm");
            left = left.saturating_sub(1);
        }
        order.join().expect("the order")
    })
}

#[test]
fn another_model_comes_in_smoothly_and_goes_back_and_stays_over_a_restart() {
    let port = Port::open();
    let mut daemon = Daemon::start(&port.address(), setup(KEPT));
    let mut session = port.link();
    session.run_until_corrected();
    assert!((session.applied[0] + EXX_MM).abs() < 1e-9);

    let new = file(&daemon, "new.toml", &model(40.0));
    let answer = json(&cycle_while(&mut session, 400, || {
        daemon.volcomp(&["load", &new, "--json", "--reason", "a new survey"])
    }));
    assert!((answer["change"]["largest_um"].as_f64().expect("a size") - 30.0).abs() < 1e-6, "{answer}");
    assert!((session.applied[0] + 0.040).abs() < 1e-9, "{}", session.applied[0]);
    let status = daemon.status();
    assert_eq!(status["model_hash"], answer["change"]["new_hash"]);
    assert_eq!(status["model_choice"]["why"], "a new survey");

    // too large a change: refused, and nothing moves
    let large = file(&daemon, "large.toml", &model(120.0));
    let refused = cycle_while(&mut session, 200, || daemon.volcomp(&["load", &large]));
    assert!(!refused.status.success());
    let text = stderr(&refused);
    assert!(text.contains("VC-5006") && text.contains("80.0 µm") && text.contains("--confirm"), "{text}");
    assert!((session.applied[0] + 0.040).abs() < 1e-9);
    let confirmed = cycle_while(&mut session, 400, || {
        daemon.volcomp(&["load", &large, "--confirm", "A. Smith", "--reason", "new screw"])
    });
    assert!(confirmed.status.success(), "{}", stderr(&confirmed));
    assert!((session.applied[0] + 0.120).abs() < 1e-9);

    // the choice outlives the daemon; the way back, too
    let audit = daemon.dir.path().join("state/audit.jsonl");
    let written = || fs::read_to_string(&audit).is_ok_and(|text| text.contains("new screw"));
    assert!(eventually(written), "an order does not wait for the audit log, but the log is not far behind");
    daemon.signal(Signal::KILL);
    let _ = daemon.wait();
    daemon.restart();
    let mut session = port.link();
    let _ = cycle_while(&mut session, 600, || daemon.volcomp(&["status"]));
    assert!((session.applied[0] + 0.120).abs() < 1e-9, "{}", session.applied[0]);
    let back = cycle_while(&mut session, 400, || daemon.volcomp(&["rollback", "--reason", "worse"]));
    assert!(back.status.success(), "{}", stderr(&back));
    assert!((session.applied[0] + 0.040).abs() < 1e-9);

    // the log is written beside all else, and the disk of a busy computer takes its time
    let audit = || fs::read_to_string(daemon.dir.path().join("state/audit.jsonl")).unwrap_or_default();
    for word in ["\"load\"", "\"rollback\"", "A. Smith", "new screw", "VC-5006"] {
        assert!(eventually(|| audit().contains(word)), "no {word} in\n{}", audit());
    }
}

#[test]
fn nonsense_is_no_model_and_the_one_in_use_stays() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), setup(KEPT));
    let mut session = port.link();
    session.run_until_corrected();
    let foreign = model(20.0).replace("test-mill", "other-mill");
    for (name, text, says) in [
        ("damaged.toml", "format = \"volcomp-model/1\"\nmachine = \"test-mill\"\nchain = ", "damaged.toml:3"),
        ("foreign.toml", foreign.as_str(), "other-mill"),
        ("empty.toml", "", "format"),
    ] {
        let path = file(&daemon, name, text);
        let refused = cycle_while(&mut session, 50, || daemon.volcomp(&["load", &path]));
        assert_eq!(refused.status.code(), Some(65), "{}", stderr(&refused));
        assert!(
            stderr(&refused).contains("VC-5007") && stderr(&refused).contains(says),
            "{}",
            stderr(&refused)
        );
    }
    let again = cycle_while(&mut session, 50, || daemon.volcomp(&["rollback"]));
    assert!(stderr(&again).contains("no previous model"), "{}", stderr(&again));
    assert!((session.applied[0] + EXX_MM).abs() < 1e-9);
}

#[test]
fn the_gain_is_ramped_and_told() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), setup(""));
    let mut session = port.link();
    session.run_until_corrected();
    for (gain, offset) in [("0.5", -0.005), ("0", 0.0), ("1", -0.010)] {
        let done = cycle_while(&mut session, 400, || daemon.volcomp(&["gain", gain]));
        assert!(done.status.success(), "{}", stderr(&done));
        assert!((session.applied[0] - offset).abs() < 1e-9, "{gain}: {}", session.applied[0]);
    }
    let wrong = daemon.volcomp(&["gain", "1.5"]);
    assert_eq!(wrong.status.code(), Some(64));
    assert_eq!(daemon.status()["gain"], 1.0);
}

#[test]
fn shadow_mode_scores_and_moves_nothing() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), Setup { start: "on-command", ..setup("") });
    let mut session = port.link();
    let done = cycle_while(&mut session, 2500, || daemon.volcomp(&["enable", "--shadow"]));
    assert!(done.status.success(), "{}", stderr(&done));
    assert_eq!(session.applied[0], 0.0);
    let status = daemon.status();
    let shadow = &status["shadow"];
    assert_eq!((shadow["state"].as_str(), status["state"].as_str()), (Some("active"), Some("off")));
    let x = &shadow["axes"]["x"];
    assert!((x["before_rms"].as_f64().expect("a figure") - 10.0).abs() < 1e-6, "{shadow}");
    assert!(x["after_rms"].as_f64().expect("a figure") < 1e-6, "{shadow}");
    // enabling ends it
    let done = cycle_while(&mut session, 600, || daemon.volcomp(&["enable"]));
    assert!(done.status.success(), "{}", stderr(&done));
    assert!((session.applied[0] + EXX_MM).abs() < 1e-9);
    assert_eq!(daemon.status()["shadow"], Value::Null);
    let refused = cycle_while(&mut session, 20, || daemon.volcomp(&["enable", "--shadow"]));
    assert!(stderr(&refused).contains("disable"), "{}", stderr(&refused));
}

#[test]
fn an_expired_model_and_an_unknown_temperature_keep_it_off() {
    let port = Port::open();
    let expired = format!("{}[provenance]\nexpiry = 2020-01-31\n", model(10.0));
    let more = "[guard]\ntemperature-degc = [18.0, 24.0]\n";
    let daemon = Daemon::start(&port.address(), Setup { model: expired, ..setup(more) });
    let mut session = port.link();
    let mut enable = |more: &[&str]| {
        let arguments: Vec<&str> = ["enable"].iter().chain(more).copied().collect();
        cycle_while(&mut session, 400, || daemon.volcomp(&arguments))
    };
    // on-connect stays off
    assert_eq!(daemon.status()["enabled"], false);
    let refused = enable(&[]);
    assert!(stderr(&refused).contains("VC-5003"), "{}", stderr(&refused));
    let refused = enable(&["--accept-expired", "--reason", "survey tomorrow"]);
    assert!(
        stderr(&refused).contains("VC-5004") && stderr(&refused).contains("not known"),
        "{}",
        stderr(&refused)
    );
    let refused = enable(&["--accept-expired", "--reason", "x", "--temperature-degc", "30"]);
    assert!(stderr(&refused).contains("30 degC"), "{}", stderr(&refused));
    let done = enable(&["--accept-expired", "--reason", "survey tomorrow", "--temperature-degc", "20.5"]);
    assert!(done.status.success(), "{}", stderr(&done));
    assert!((session.applied[0] + 0.010).abs() < 1e-9);
}

#[test]
fn a_recording_across_a_switch_replays_bit_for_bit() {
    let port = Port::open();
    let more = "[recording]\ndirectory = \"rec\"\nflush-ms = 50.0\n[state]\ndirectory = \"state\"\n";
    let mut daemon = Daemon::start(&port.address(), setup(more));
    let mut session = port.link();
    session.run_until_corrected();
    let new = file(&daemon, "new.toml", &model(40.0));
    for order in [&["load", new.as_str()] as &[&str], &["gain", "0.4"], &["rollback"]] {
        let done = cycle_while(&mut session, 300, || daemon.volcomp(order));
        assert!(done.status.success(), "{}", stderr(&done));
    }
    session.close();
    daemon.signal(Signal::TERM);
    assert!(daemon.wait().success());
    let folder = fs::read_dir(daemon.dir.path().join("rec")).expect("recordings");
    let files: Vec<_> = folder.filter_map(Result::ok).map(|e| e.path()).collect();
    let replay = std::process::Command::new(env!("CARGO_BIN_EXE_volcomp"))
        .args(["replay", "--json"])
        .args(&files)
        .output()
        .expect("volcomp runs");
    let report = json(&replay);
    assert!(!daemon.log().contains("cannot be replayed"), "{}", daemon.log());
    assert_eq!(report["differing"], 0, "{report}");
    assert!(report["compared"].as_u64() > Some(900), "{report}");
}

/// A model that takes a while to be compared: tables on every axis.
fn large_model(um: f64) -> String {
    let positions: Vec<String> = (0..400).map(|k| k.to_string()).collect();
    let mut text = "format = \"volcomp-model/1\"\nmachine = \"test-mill\"\nchain = \"[w X' b Y Z t]\"\n\
        [axes.x]\ntravel-mm = [0, 399]\n[axes.y]\ntravel-mm = [0, 399]\n[axes.z]\ntravel-mm = [0, 399]\n\
        [errors.exx.constant]\nvalue-um = "
        .to_owned();
    text.push_str(&format!("{um}\n"));
    for symbol in ["eyx", "ezx", "exy", "ezy", "exz", "eyz"] {
        let values: Vec<String> = (0..400).map(|k| format!("{}", (k * 7 % 13) as f64 * 0.01)).collect();
        text.push_str(&format!(
            "[errors.{symbol}.table]\nposition-mm = [{}]\nvalue-um = [{}]\n",
            positions.join(","),
            values.join(",")
        ));
    }
    text
}

#[test]
fn loads_that_overlap_are_refused_one_by_one_and_everything_goes_on() {
    let port = Port::open();
    let mut daemon = Daemon::start(&port.address(), setup(KEPT));
    let mut session = port.link();
    session.run_until_corrected();
    let files: Vec<String> =
        (0..4).map(|k| file(&daemon, &format!("m{k}.toml"), &large_model(11.0 + f64::from(k)))).collect();
    let answers: Vec<Output> = std::thread::scope(|scope| {
        let loads: Vec<_> =
            files.iter().map(|file| scope.spawn(|| daemon.volcomp(&["load", file]))).collect();
        while !loads.iter().all(|load| load.is_finished()) {
            let _ = session.cycle();
        }
        loads.into_iter().map(|load| load.join().expect("an answer")).collect()
    });
    let done = answers.iter().filter(|answer| answer.status.success()).count();
    let refused = answers.iter().filter(|answer| stderr(answer).contains("another model is being looked at"));
    assert!(done >= 1 && done + refused.count() == 4, "{answers:?}");
    assert_eq!(daemon.status()["state"], "active");
    let disabled = cycle_while(&mut session, 600, || daemon.volcomp(&["disable"]));
    assert!(disabled.status.success(), "{}", stderr(&disabled));
    assert_eq!(session.applied[0], 0.0);
    daemon.signal(Signal::TERM);
    drop(session);
    assert_eq!(daemon.wait().code(), Some(0));
}

#[test]
fn a_refused_load_leaves_nothing_of_the_file_behind() {
    let port = Port::open();
    let more = "[state]\ndirectory = \"state\"\n[recording]\ndirectory = \"state/rec\"\nflush-ms = 20.0\n";
    let mut daemon = Daemon::start(&port.address(), setup(more));
    let mut session = port.link();
    session.run_until_corrected();
    let secret = "root:$6$abcdefgh:19000:0:99999:7:::";
    let refused = [
        file(&daemon, "shadow", &format!("{secret}\n")),
        file(&daemon, "large.toml", &format!("{}# {secret}\n", model(120.0))),
        file(&daemon, "foreign.toml", &format!("{}# {secret}\n", model(11.0)).replace("test-mill", "other")),
        file(
            &daemon,
            "axes.toml",
            &format!("{}# {secret}\n", model(11.0)).replace("[w X' b Y Z t]", "[w X' b Y t]"),
        ),
    ];
    for path in &refused {
        let answer = cycle_while(&mut session, 20, || daemon.volcomp(&["load", path]));
        assert!(!answer.status.success(), "{path}");
        let audit = daemon.dir.path().join("state/audit.jsonl");
        let hash = blake3::hash(&fs::read(path).expect("there")).to_hex().to_string();
        let told =
            || fs::read_to_string(&audit).is_ok_and(|text| text.contains(&hash) && text.contains(path));
        assert!(eventually(told), "path and hash are in the audit log");
    }
    daemon.signal(Signal::TERM);
    drop(session);
    assert_eq!(daemon.wait().code(), Some(0));
    assert!(!daemon.log().contains("root:"), "{}", daemon.log());
    let mut folders = vec![daemon.dir.path().join("state")];
    let mut files = 0;
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("folder") {
            let path = entry.expect("entry").path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            files += 1;
            let bytes = fs::read(&path).expect("file");
            assert!(!bytes.windows(5).any(|window| window == b"root:"), "{}", path.display());
        }
    }
    assert!(files >= 4, "{files} files were searched");
}
