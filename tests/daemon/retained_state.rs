//! What an operator has ordered stays ordered: over restarts, and against models that could not be enabled.

#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test program: it fails by panicking")]

use std::fs;
use std::time::{Duration, Instant};

use crate::support::{Daemon, EXX_MM, Port, STEP_MM_MAX, Session, Setup, eventually};
use rustix::process::Signal;
use volcomp::protocol::{CorrectionState, Message};

const KEPT: &str = "[state]\ndirectory = \"state\"\n";

fn setup() -> Setup {
    Setup { more: KEPT, ..Setup::default() }
}

/// So many cycles; gives the last state.
fn run(session: &mut Session, cycles: u32) -> CorrectionState {
    (0..cycles).map(|_| session.cycle().state).last().expect("a cycle")
}

/// Gives an order while the control goes on.
fn order(session: &mut Session, daemon: &Daemon, words: &[&str]) -> (bool, String) {
    let output = std::thread::scope(|scope| {
        let order = scope.spawn(|| daemon.volcomp(words));
        while !order.is_finished() {
            let _ = session.cycle();
        }
        order.join().expect("the order")
    });
    (output.status.success(), String::from_utf8_lossy(&output.stderr).into_owned())
}

/// Waits until the state directory knows, then takes the power away and gives it back.
fn power_cut(daemon: &mut Daemon, port: &Port, known: &str) -> Session {
    let counters = daemon.dir.path().join("state/counters.json");
    let written = || fs::read_to_string(&counters).is_ok_and(|text| text.contains(known));
    assert!(eventually(written), "{known} not in {}", fs::read_to_string(&counters).unwrap_or_default());
    daemon.signal(Signal::KILL);
    let _ = daemon.wait();
    daemon.restart();
    port.link()
}

#[test]
fn a_restart_undoes_neither_disable_nor_gain() {
    let port = Port::open();
    let mut daemon = Daemon::start(&port.address(), setup());
    let mut session = port.link();
    session.run_until_corrected();
    assert!(order(&mut session, &daemon, &["disable", "--reason", "parts get worse"]).0);
    let mut session = power_cut(&mut daemon, &port, "\"off\": true");
    assert_eq!(run(&mut session, 600), CorrectionState::Off);
    daemon.wait_for_log("switched off before the restart");
    assert!(order(&mut session, &daemon, &["enable"]).0);
    assert!(order(&mut session, &daemon, &["gain", "0.5"]).0);
    let mut session = power_cut(&mut daemon, &port, "\"gain\": 0.5");
    assert_eq!(run(&mut session, 1500), CorrectionState::Active);
    assert!((session.applied[0] + 0.5 * EXX_MM).abs() < 1e-9, "{}", session.applied[0]);
}

#[test]
fn after_a_restart_no_larger_share_is_applied_than_the_machine_file_says() {
    let port = Port::open();
    let mut daemon = Daemon::start(&port.address(), setup());
    let mut session = port.link();
    session.run_until_corrected();
    assert!(order(&mut session, &daemon, &["gain", "0.9"]).0);
    // an engineer lowers the share in the machine file meanwhile
    let file = daemon.dir.path().join("machine.toml");
    let text = fs::read_to_string(&file).expect("readable");
    fs::write(&file, text.replace("[engine]\n", "[engine]\ngain = 0.25\n")).expect("written");
    let mut session = power_cut(&mut daemon, &port, "\"gain\": 0.9");
    assert_eq!(run(&mut session, 1500), CorrectionState::Active);
    assert!((session.applied[0] + 0.25 * EXX_MM).abs() < 1e-9, "{}", session.applied[0]);
    assert_eq!(daemon.status()["gain"], 0.25);
    daemon.wait_for_log("is above [engine] gain");
    // a smaller one outlives the restart
    assert!(order(&mut session, &daemon, &["gain", "0.125"]).0);
    let mut session = power_cut(&mut daemon, &port, "\"gain\": 0.125");
    assert_eq!(run(&mut session, 1500), CorrectionState::Active);
    assert!((session.applied[0] + 0.125 * EXX_MM).abs() < 1e-9, "{}", session.applied[0]);
}

#[test]
fn a_restart_does_not_clear_a_fault() {
    let port = Port::open();
    let mut daemon = Daemon::start(&port.address(), setup());
    let mut session = port.link();
    session.run_until_corrected();
    // somebody else writes the offset
    session.deceive(0.005);
    daemon.wait_for_log("VC-4001");
    let numbers = daemon.status()["faults"][0]["numbers"].clone();
    assert!(numbers.as_str().is_some_and(|numbers| numbers.starts_with("x: ")), "{numbers}");
    let mut session = power_cut(&mut daemon, &port, "VC-4001");
    session.run_unanswered(100);
    assert_eq!(daemon.status()["state"], "faulted");
    daemon.wait_for_log("VC-4001 was latched before the restart");
    let fault = daemon.status()["faults"][0].clone();
    assert_eq!((&fault["code"], &fault["numbers"]), (&"VC-4001".into(), &numbers), "{fault}");
    // a restart is no acknowledgement: neither is a plain enable
    let refused = daemon.volcomp(&["enable"]);
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(
        !refused.status.success() && said.contains("VC-4001") && said.contains("--clear-fault"),
        "{said}"
    );
    session.run_unanswered(100);
    assert!(daemon.volcomp(&["enable", "--clear-fault"]).status.success());
    assert_eq!(run(&mut session, 600), CorrectionState::Active);
    let mut session = power_cut(&mut daemon, &port, "\"off\": false");
    assert!(!counters(&daemon).contains("fault_numbers"), "{}", counters(&daemon));
    assert_eq!(run(&mut session, 600), CorrectionState::Active, "what was acknowledged stays so");
}

#[test]
fn a_fault_of_before_is_told_and_not_cleared_without_a_link() {
    let dead = Port::open();
    let mut daemon = Daemon::start(&dead.address(), setup());
    assert!(eventually(|| counters(&daemon).contains("\"fault\": null")));
    daemon.signal(Signal::KILL);
    let _ = daemon.wait();
    let text = counters(&daemon).replace("\"fault\": null", "\"fault\": \"VC-4004\"");
    fs::write(daemon.dir.path().join("state/counters.json"), text).expect("written");
    fs::remove_file(daemon.socket()).expect("the socket of the one before");
    daemon.restart();
    let status = daemon.status();
    assert_eq!(status["faults"][0]["reason"], "stop-limit", "{status}");
    assert!(status["start_inhibit"].as_str().expect("told").contains("VC-4004"), "{status}");
    let refused = daemon.volcomp(&["enable"]);
    assert!(!refused.status.success());
    // what the control holds is not known without a link
    let clear = || daemon.volcomp(&["enable", "--clear-fault", "--reason", "looked"]);
    let refused = clear();
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success() && said.contains("with the link up"), "{said}");
    assert_eq!(daemon.status()["faults"][0]["reason"], "stop-limit");
    dead.close_pending();
    let mut session = dead.link();
    session.run_unanswered(50);
    assert!(clear().status.success());
    let status = daemon.status();
    assert_eq!((&status["enabled"], status["faults"].as_array().map(Vec::len)), (&true.into(), Some(0)));
    assert!(counters(&daemon).contains("\"fault\": null"), "durable before the answer");
    assert_eq!(run(&mut session, 600), CorrectionState::Active);
}

fn counters(daemon: &Daemon) -> String {
    fs::read_to_string(daemon.dir.path().join("state/counters.json")).unwrap_or_default()
}

#[test]
fn an_order_is_durable_before_it_is_answered() {
    let port = Port::open();
    let mut daemon = Daemon::start(&port.address(), setup());
    let mut session = port.link();
    session.run_until_corrected();
    for (words, known) in
        [(["disable"], "\"off\": true"), (["enable"], "\"off\": false"), (["disable"], "\"off\": true")]
    {
        assert!(order(&mut session, &daemon, &words).0);
        assert!(counters(&daemon).contains(known), "{words:?}: {}", counters(&daemon));
    }
    daemon.signal(Signal::KILL);
    let _ = daemon.wait();
    daemon.restart();
    assert_eq!(run(&mut port.link(), 600), CorrectionState::Off);
}

#[test]
fn an_unknown_state_means_off_until_somebody_enables() {
    type Damage = fn(&std::path::Path);
    let cases: [(&str, Damage); 7] = [
        ("EOF", |path| fs::write(path, &fs::read(path).expect("there")[..100]).expect("written")),
        ("EOF", |path| fs::write(path, "").expect("written")),
        ("expected value", |path| fs::write(path, [0; 300]).expect("written")),
        ("is missing", |path| fs::remove_file(path).expect("removed")),
        ("of machine", |path| {
            let text = fs::read_to_string(path).expect("there").replace("test-mill", "test-lathe");
            fs::write(path, text).expect("written");
        }),
        ("not a regular file", |path| {
            fs::remove_file(path).expect("removed");
            fs::create_dir(path).expect("made");
        }),
        ("names no model in use", |path| {
            fs::remove_file(path.with_file_name("models.json")).expect("removed");
        }),
    ];
    for (why, damage) in cases {
        let port = Port::open();
        let mut daemon = Daemon::start(&port.address(), setup());
        port.link().run_until_corrected();
        assert!(eventually(|| daemon.dir.path().join("state/models.json").exists()));
        daemon.signal(Signal::KILL);
        let _ = daemon.wait();
        let path = daemon.dir.path().join("state/counters.json");
        damage(&path);
        // not at the first restart, and not at the next one either
        for _ in 0..2 {
            daemon.restart();
            let mut session = port.link();
            assert_eq!(run(&mut session, 300), CorrectionState::Off, "{why}");
            let status = daemon.status();
            let told = status["start_inhibit"].as_str().unwrap_or_default();
            assert!(told.starts_with("state unknown: ") && told.contains(why), "{why}: {told}");
            daemon.wait_for_log("compensation stays off until an operator enables it: state unknown");
            let audit = daemon.dir.path().join("state/audit.jsonl");
            assert!(eventually(
                || fs::read_to_string(&audit).is_ok_and(|text| text.contains("state unknown"))
            ));
            if path.is_dir() {
                // nothing can be kept there: the answer to an order says so
                let (done, said) = order(&mut session, &daemon, &["disable"]);
                assert!(done && said.contains("not kept"), "{said}");
                fs::remove_dir(&path).expect("removed");
                assert!(order(&mut session, &daemon, &["disable"]).0);
            }
            daemon.signal(Signal::KILL);
            let _ = daemon.wait();
        }
        daemon.restart();
        let mut session = port.link();
        assert!(order(&mut session, &daemon, &["enable", "--reason", "looked at it"]).0, "{why}");
        assert_eq!(run(&mut session, 600), CorrectionState::Active, "{why}");
        assert!(daemon.status()["start_inhibit"].is_null(), "{why}");
        daemon.signal(Signal::KILL);
        let _ = daemon.wait();
        daemon.restart();
        assert_eq!(run(&mut port.link(), 600), CorrectionState::Active, "{why}: lifted for good");
    }
}

#[test]
fn a_state_directory_that_cannot_be_used_is_an_unknown_state() {
    let port = Port::open();
    let more = "[state]\ndirectory = \"machine.toml/state\"\n";
    let daemon = Daemon::start(&port.address(), Setup { more, ..Setup::default() });
    let mut session = port.link();
    assert_eq!(run(&mut session, 300), CorrectionState::Off);
    daemon.wait_for_log("VC-7006");
    let (done, said) = order(&mut session, &daemon, &["enable"]);
    assert!(done && said.contains("not kept"), "{said}");
    assert_eq!(run(&mut session, 600), CorrectionState::Active);
}

#[test]
fn an_expired_model_does_not_slip_in_while_the_machine_is_compensated() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), setup());
    let mut session = port.link();
    session.run_until_corrected();
    let text = "format = \"volcomp-model/1\"\nmachine = \"test-mill\"\nchain = \"[w X' b Y Z t]\"\n\
        [provenance]\nexpiry = 2020-03-12\n[axes.x]\ntravel-mm = [0, 400]\n[errors.exx.constant]\nvalue-um = 12\n";
    let path = daemon.dir.path().join("expired.toml");
    fs::write(&path, text).expect("written");
    let path = path.display().to_string();
    let (done, said) = order(&mut session, &daemon, &["load", &path]);
    assert!(!done && said.contains("VC-5003") && said.contains("2020-03-12"), "{said}");
    run(&mut session, 300);
    assert!((session.applied[0] + EXX_MM).abs() < 1e-9);
    // switched off it may be loaded; enabling then refuses
    assert!(order(&mut session, &daemon, &["disable"]).0);
    let (done, said) = order(&mut session, &daemon, &["load", &path]);
    assert!(done, "{said}");
    let (done, said) = order(&mut session, &daemon, &["enable"]);
    assert!(!done && said.contains("VC-5003"), "{said}");
}

#[test]
fn without_positions_the_way_to_zero_goes_by_the_clock() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), setup());
    let mut session = port.link();
    session.run_until_corrected();
    let (mut begin, mut words) = (None, 0);
    loop {
        let Some(Message::Correction(correction)) = session.next_word() else { panic!("the link has ended") };
        let begin = *begin.get_or_insert_with(Instant::now);
        words += 1;
        let step = (correction.offset[0] - session.applied[0]).abs();
        assert!(step <= STEP_MM_MAX * 1.000_001, "a step of {step} mm");
        session.applied[0] = correction.offset[0];
        if session.applied[0] == 0.0 {
            // hold-s and ramp-s are 0.3 s together; counted in wake-ups of 10 ms it would be ten times as long
            let took = begin.elapsed();
            let bare = Instant::now();
            (0..words).for_each(|_| std::thread::sleep(Duration::from_millis(1)));
            assert!(took < 5 * bare.elapsed(), "{took:?}, as many bare sleeps {:?}", bare.elapsed());
            break;
        }
    }
    drop(daemon);
}
