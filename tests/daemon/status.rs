//! `volcomp status`: health, its exit code, the last minute, the benefit, and `--watch` over a restart.

#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test program: it fails by panicking")]

use std::io::{BufRead, BufReader};
use std::process::Stdio;
use std::time::{Duration, Instant};

use rustix::process::Signal;
use serde_json::Value;
use volcomp::protocol::MachineState;

use crate::support::{Daemon, EXX_MM, Port, Setup, eventually};

/// Exit code and object of one call.
fn status(daemon: &Daemon) -> (i32, Value) {
    let output = daemon.volcomp(&["status", "--json"]);
    let object = serde_json::from_slice(&output.stdout).unwrap_or_default();
    (output.status.code().expect("ended by itself"), object)
}

/// Text and exit code of the form for people.
fn shown(daemon: &Daemon) -> (i32, String) {
    let output = daemon.volcomp(&["status"]);
    (output.status.code().expect("ended by itself"), String::from_utf8_lossy(&output.stdout).into_owned())
}

fn has_warning(status: &Value, code: &str) -> bool {
    let warnings = status["recent"]["warnings"].as_array();
    warnings.is_some_and(|all| all.iter().any(|w| w["code"] == code && w["count"].as_u64() > Some(0)))
}

#[test]
fn the_last_minute_the_benefit_and_the_coverage_are_told() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), Setup::default());
    let mut session = port.link();
    session.run_until_corrected();
    // the benefit is looked at once a second
    let mut seen = Value::Null;
    let told = eventually(|| {
        for _ in 0..50 {
            let _ = session.cycle();
        }
        (_, seen) = status(&daemon);
        let with = seen["benefit"]["with_um"].as_f64();
        with.is_some_and(|um| um.abs() < 1e-6)
    });
    assert!(told, "{seen}");
    let number = |value: &Value| value.as_f64().expect("a number");
    assert!((number(&seen["benefit"]["without_um"]) - EXX_MM * 1e3).abs() < 1e-6, "{seen}");
    let recent = &seen["recent"];
    assert!(
        number(&recent["cycles"]) > 100.0 && number(&recent["age_us_p99"]) >= number(&recent["age_us_p50"])
    );
    assert_eq!(
        (&seen["model_errors"]["covered"], &seen["model_errors"]["possible"]),
        (&1.into(), &21.into())
    );
    assert_eq!((&seen["limits"]["x"]["limit"], &seen["limits"]["x"]["unit"]), (&150.0.into(), &"um".into()));
    // a busy computer may make cycles late: the exit code says what the object says
    let (code, object) = status(&daemon);
    assert_eq!(i64::from(code), object["health"]["exit_code"].as_i64().expect("a code"), "{object}");
    assert_eq!(code == 0, object["health"]["verdict"] == "ok");
    let (code, text) = shown(&daemon);
    assert!(matches!(code, 0 | 1), "{text}");
    for word in [
        "health      ",
        "benefit     predicted tool-tip error 10.0 µm without",
        "1 of 21 error motions",
        "last ",
    ] {
        assert!(text.contains(word), "no `{word}` in:\n{text}");
    }
    assert!(!text.contains('\x1b'), "colour only on a terminal:\n{text}");
}

#[test]
fn exit_codes_tell_disconnected_held_and_faulted() {
    let port = Port::open();
    let address = port.address();
    drop(port);
    let daemon = Daemon::start(&address, Setup::default());
    assert!(eventually(|| has_warning(&status(&daemon).1, "VC-6001")), "{}", daemon.log());
    let (code, text) = shown(&daemon);
    assert!(code == 3 && text.contains("VC-6001") && text.contains("remedy"), "{code}\n{text}");

    let port = Port::open_at(&address);
    let mut session = port.link();
    session.run_until_corrected();
    // nothing comes any more: stale after 1 s
    let held = eventually(|| {
        let (code, object) = status(&daemon);
        code == 2 && object["state"] == "holding" && has_warning(&object, "VC-3001")
    });
    assert!(held, "{}\n{}", status(&daemon).1, daemon.log());
    drop(session);
    assert!(eventually(|| status(&daemon).1["recent"]["drop_outs"] == 1), "{}", status(&daemon).1);

    let mut session = port.link();
    session.run_until_corrected();
    session.deceive(0.05);
    let faulted = eventually(|| {
        let (code, object) = status(&daemon);
        code == 4 && has_warning(&object, "VC-4001")
    });
    assert!(faulted, "{}", status(&daemon).1);
    let (code, text) = shown(&daemon);
    assert!(code == 4 && text.contains("FAULTED") && text.contains("VC-4001"), "{text}");
    let events = status(&daemon).1["events"].clone();
    let codes: Vec<&str> =
        events.as_array().expect("events").iter().filter_map(|e| e["code"].as_str()).collect();
    assert!(codes.contains(&"VC-4001") && codes.contains(&"VC-6001"), "{codes:?}");
}

#[test]
fn an_emergency_stop_names_itself() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), Setup::default());
    let mut session = port.link();
    session.run_until_corrected();
    session.state |= MachineState::ESTOP;
    for _ in 0..50 {
        let _ = session.cycle();
    }
    let mut seen = Value::Null;
    let told = eventually(|| {
        let _ = session.cycle();
        (_, seen) = status(&daemon);
        seen["state_reason"]["code"] == "VC-2003"
    });
    assert!(told, "{seen}");
    assert_eq!(seen["health"]["code"], "VC-2003", "{seen}");
}

#[test]
fn an_enabled_compensation_that_waits_says_for_what() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), Setup::default());
    let mut session = port.link();
    for (state, code) in [
        (MachineState::ENABLED, "VC-2001"),
        (MachineState::HOMED, "VC-2002"),
        (MachineState::HOMED | MachineState::ENABLED | MachineState::ESTOP, "VC-2003"),
    ] {
        session.state = state;
        let mut seen = (0, Value::Null);
        let told = eventually(|| {
            let _ = session.cycle();
            seen = status(&daemon);
            seen.1["health"]["code"] == code
        });
        assert!(told, "{seen:?}");
        let (exit_code, object) = seen;
        assert_eq!(exit_code, 2, "{object}");
        assert_eq!((&object["state"], &object["health"]["verdict"]), (&"armed".into(), &"held".into()));
        assert_eq!(object["waits_for"]["code"], code, "{object}");
    }
    let (_, text) = shown(&daemon);
    assert!(
        text.contains("VC-2003: compensation waits: emergency stop") && text.contains("remedy"),
        "{text}"
    );
    session.state = MachineState::HOMED | MachineState::ENABLED;
    session.run_until_corrected();
    let goes_on = eventually(|| {
        let _ = session.cycle();
        let object = status(&daemon).1;
        object["waits_for"].is_null() && object["health"]["verdict"] != "held"
    });
    assert!(goes_on, "{}", status(&daemon).1);
}

#[test]
fn a_control_at_another_cycle_than_it_announces_is_a_warning_until_it_is_right() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), Setup::default());
    let mut session = port.link();
    session.run_until_corrected();
    // announced: 1 ms; its time stamps are those of 1 ms, too, but it goes by the clock
    let mut run_until = |pause: Duration, wanted: &dyn Fn(&Value) -> bool| {
        let deadline = Instant::now() + Duration::from_secs(60);
        let mut next = Instant::now();
        loop {
            for _ in 0..200 {
                let _ = session.cycle();
                next += pause;
                std::thread::sleep(next.saturating_duration_since(Instant::now()));
            }
            let (exit_code, object) = status(&daemon);
            if wanted(&object) {
                return (exit_code, object);
            }
            assert!(Instant::now() < deadline, "{object}");
        }
    };
    let present = |status: &Value| {
        let warnings = status["recent"]["warnings"].as_array();
        warnings.and_then(|all| all.iter().find(|w| w["code"] == "VC-6008")?["present"].as_bool())
    };
    let (exit_code, object) = run_until(Duration::from_millis(4), &|status| present(status) == Some(true));
    assert_eq!((exit_code, &object["state"]), (1, &"active".into()), "a warning, no fault: {object}");
    let event = object["events"].as_array().and_then(|all| all.iter().find(|e| e["code"] == "VC-6008"));
    let numbers = event.and_then(|event| event["numbers"].as_str()).unwrap_or_default();
    assert!(numbers.ends_with("ms between position frames"), "{object}");
    daemon.wait_for_log("VC-6008");
    run_until(Duration::from_millis(1), &|status| present(status) == Some(false));
}

#[test]
fn what_limits_the_correction_is_a_warning_while_it_lasts() {
    const TRAVEL: &str = "format = \"volcomp-model/1\"\nmachine = \"test-mill\"\nchain = \"[w X' b Y Z t]\"\n\
        [axes.x]\ntravel-mm = [10, 500]\n[errors.exx.constant]\nvalue-um = 10.0\n";
    let port = Port::open();
    let setup = Setup { model: TRAVEL.to_owned(), ..Setup::default() };
    let daemon = Daemon::start(&port.address(), setup);
    let mut session = port.link();
    session.run_until_corrected();
    session.state |= MachineState::OFFSET_LIMITED;
    let present = |status: &Value, code: &str, wanted: bool| {
        let warnings = status["recent"]["warnings"].as_array();
        warnings.is_some_and(|all| all.iter().any(|w| w["code"] == code && w["present"] == wanted))
    };
    let mut seen = (0, Value::Null);
    let both = |seen: &Value, wanted| ["VC-3007", "VC-4008"].iter().all(|code| present(seen, code, wanted));
    let told = eventually(|| {
        let _ = session.cycle();
        seen = status(&daemon);
        both(&seen.1, true)
    });
    assert!(
        told && seen.0 == 1,
        "outside the travel with out-of-travel = \"hold\", and limited by the control: {seen:?}"
    );
    session.state = MachineState::HOMED | MachineState::ENABLED;
    for _ in 0..20 {
        session.commanded[0] += 1.0;
        let _ = session.cycle();
    }
    let over = eventually(|| {
        let _ = session.cycle();
        seen = status(&daemon);
        both(&seen.1, false)
    });
    assert!(over, "{seen:?}");
    let (_, text) = shown(&daemon);
    assert!(text.lines().any(|line| line.contains("VC-3007") && line.contains("ago, over:")), "{text}");
}

#[test]
fn a_latched_fault_shows_what_the_control_holds_and_what_keeps_it_from_being_cleared() {
    let port = Port::open();
    let (daemon, mut session) = port.latched();
    session.applied[0] = 0.05;
    session.run_unanswered(20);
    let mut seen = Value::Null;
    let told = eventually(|| {
        session.run_unanswered(1);
        (_, seen) = status(&daemon);
        seen["applied_um"]["x"].as_f64().is_some_and(|um| (um - 50.0).abs() < 1e-9)
    });
    assert!(told, "{seen}");
    assert_eq!(seen["machine_state"], serde_json::json!(["homed", "enabled"]), "{seen}");
    assert_eq!(seen["correction_um"], serde_json::json!({}), "nothing is sent: {seen}");
    let (_, text) = shown(&daemon);
    assert!(text.contains("nothing is sent   applied    +50.000 µm"), "{text}");
    let refused = daemon.volcomp(&["enable", "--clear-fault"]);
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(65), "{said}");
    assert!(said.contains("the control reports an offset, x: 50 µm, limit 0.5 µm"), "{said}");
}

#[test]
fn numbers_that_are_not_finite_do_not_break_the_status() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), Setup::default());
    let mut session = port.link();
    session.run_until_corrected();
    session.commanded[1] = f64::NAN;
    let mut seen = (0, Value::Null);
    let told = eventually(|| {
        let _ = session.cycle();
        seen = status(&daemon);
        seen.1["waits_for"]["code"] == "VC-3002"
    });
    assert!(told, "{seen:?}");
    let (code, text) = shown(&daemon);
    assert!(matches!(code, 2 | 4) && text.contains("VC-3002"), "{text}");
}

#[test]
fn watch_goes_on_over_a_restart_of_the_daemon() {
    let port = Port::open();
    let mut daemon = Daemon::start(&port.address(), Setup::default());
    let _ = daemon.status();
    let mut watch = daemon
        .command(&["watch"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("volcomp runs");
    let (sender, lines) = std::sync::mpsc::channel();
    let stdout = BufReader::new(watch.stdout.take().expect("piped"));
    let reader = std::thread::spawn(move || {
        for line in stdout.lines().map_while(Result::ok) {
            if sender.send(line).is_err() {
                return;
            }
        }
    });
    let saw = |words: &str| eventually(|| lines.try_iter().any(|line| line.contains(words)));
    let first = format!("pid {},", daemon.child.id());
    assert!(saw(&first), "no {first}");
    daemon.signal(Signal::KILL);
    let _ = daemon.wait();
    assert!(saw("waiting for it"));
    daemon.restart();
    let second = format!("pid {},", daemon.child.id());
    assert!(saw(&second), "no {second}");
    watch.kill().expect("ended");
    let _ = watch.wait();
    drop(lines);
    reader.join().expect("ends");
}
