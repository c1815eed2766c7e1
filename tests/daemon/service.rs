//! `volcompd` seen by its operator: status, commands, systemd, and mistakes at the start.

#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test program: it fails by panicking")]

use std::io::{BufRead, BufReader, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::{UnixDatagram, UnixListener, UnixStream};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::support::{Daemon, EXX_MM, PATIENCE, Port, Setup, eventually, hello, is_answer};
use rustix::process::Signal;
use volcomp::model::axes::AxisName;
use volcomp::protocol::{Axis, AxisUnit, CloseReason, Message};

/// Keys that scripts may rely on (`docs/reference/json-output.md` 1).
const KEYS: [&str; 13] = [
    "state",
    "model_hash",
    "machine",
    "cycles",
    "late_cycles",
    "age_us_p50",
    "age_us_p99",
    "roundtrip_us_p50",
    "roundtrip_us_p99",
    "correction_um",
    "limited",
    "faults",
    "sensors",
];

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn status_has_the_promised_keys_and_true_values() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), Setup::default());
    let before = daemon.status();
    for key in KEYS {
        assert!(before.get(key).is_some(), "no {key} without a link: {before}");
    }
    let mut session = port.link();
    session.run_until_corrected();
    for _ in 0..200 {
        let _ = session.cycle();
    }
    let sent = u64::from(session.sequence);
    let mut status = daemon.status();
    assert!(eventually(|| {
        status = daemon.status();
        status["cycles"] == sent
    }));
    for key in KEYS {
        assert!(status.get(key).is_some(), "no {key}: {status}");
    }
    assert_eq!(status["state"], "active");
    assert_eq!(status["machine"], "test-mill");
    let model = std::fs::read(daemon.dir.path().join("model.toml")).expect("model");
    assert_eq!(status["model_hash"], blake3::hash(&model).to_hex().as_str());
    let x_um = status["correction_um"]["x"].as_f64().expect("number");
    assert!((x_um + EXX_MM * 1e3).abs() < 1e-6, "{x_um} um");
    assert_eq!(status["correction_um"].as_object().expect("object").len(), 3);
    assert_eq!(status["faults"], serde_json::json!([]));
    let figure = |key: &str| status[key].as_f64().expect("number");
    assert!(figure("roundtrip_us_p50") > 0.0);
    assert!(figure("roundtrip_us_p50") <= figure("roundtrip_us_p99"));
    assert!(figure("compute_us_p50") <= figure("roundtrip_us_p50"));
    // the same cycles once more, as full histograms
    let out = daemon.volcomp(&["status", "--histograms"]);
    let full: serde_json::Value = serde_json::from_slice(&out.stdout).expect("JSON");
    for name in ["age", "roundtrip", "compute"] {
        let bins = full[name]["bins"].as_array().expect("bins");
        let cycles: u64 = bins.iter().map(|bin| bin[1].as_u64().expect("count")).sum();
        assert_eq!((cycles, &full[name]["count"]), (sent, &sent.into()), "{name}");
    }
    let late = full["lateness"]["count"].as_u64().expect("count");
    assert_eq!(
        late,
        status["late_cycles"].as_u64().expect("count") - status["skipped_cycles"].as_u64().expect("count")
    );
    // the human form names state, axis and figures
    let human = text(&daemon.volcomp(&["status"]).stdout);
    for word in ["test-mill: active", "-10.000 µm", "round trip", "faults      none"] {
        assert!(human.contains(word), "no `{word}` in:\n{human}");
    }
}

#[test]
fn off_until_enabled_and_off_again_when_disabled() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), Setup { start: "on-command", ..Setup::default() });
    let mut session = port.link();
    for _ in 0..300 {
        assert_eq!(session.cycle().offset[0], 0.0, "default off");
    }
    let enabled = daemon.volcomp(&["enable", "--json"]);
    assert!(enabled.status.success(), "{}", text(&enabled.stderr));
    assert_eq!(text(&enabled.stdout).trim(), r#"{"state":"armed"}"#);
    session.run_until_corrected();
    let disabled = daemon.volcomp(&["disable"]);
    assert!(disabled.status.success(), "{}", text(&disabled.stderr));
    for _ in 0..1000 {
        let _ = session.cycle();
    }
    assert_eq!(session.applied[0], 0.0);
    assert_eq!(daemon.status()["state"], "off");
}

#[test]
fn enabling_without_a_link_is_remembered() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), Setup { start: "on-command", ..Setup::default() });
    assert!(eventually(|| daemon.socket().exists()));
    let answer = daemon.volcomp(&["enable"]);
    assert_eq!(text(&answer.stdout).trim(), "disconnected", "{}", text(&answer.stderr));
    assert_eq!(daemon.status()["enabled"], true);
    let mut session = port.link();
    session.run_until_corrected();
}

#[test]
fn a_foreign_offset_is_a_fault_that_has_to_be_acknowledged() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), Setup::default());
    let mut session = port.link();
    session.run_until_corrected();
    // the control claims another offset than it was sent, for longer than the read-back may take
    session.deceive(0.05);
    assert!(eventually(|| daemon.status()["state"] == "faulted"), "{}", daemon.status());
    let fault = daemon.status()["faults"][0].clone();
    assert_eq!(fault["reason"], "read-back");
    assert_eq!(fault["numbers"], "x: 60 um, limit 0.5 um", "axis, value and limit");
    daemon.wait_for_log("x: 60 um, limit 0.5 um");
    refused_as_faulted(&daemon);
    // a control that comes back with another axis is a new engine: the fault stays
    drop(session);
    let mut larger = hello();
    larger.axes[3] = Axis { name: AxisName::U, unit: AxisUnit::Millimetre };
    larger.axis_count = 4;
    let mut session = port.accept();
    session.handshake(&larger);
    session.run_unanswered(50);
    assert_eq!(daemon.status()["state"], "faulted");
    refused_as_faulted(&daemon);
    assert_eq!(text(&daemon.volcomp(&["enable", "--clear-fault"]).stdout).trim(), "armed");
    assert_eq!(daemon.status()["faults"], serde_json::json!([]));
}

#[test]
fn a_fault_that_comes_back_at_once_is_a_refusal_that_names_it() {
    let port = Port::open();
    let (daemon, mut session) = port.latched();
    session.run_unanswered(50);
    let command =
        daemon.command(&["enable", "--clear-fault"]).stderr(Stdio::piped()).stdout(Stdio::piped()).spawn();
    let command = command.expect("volcomp runs");
    std::thread::scope(|scope| {
        scope.spawn(|| {
            // at zero, so that the fault can be cleared; another offset as soon as one is sent again
            let mut lies = false;
            loop {
                let mut position = session.position();
                position.applied[0] = if lies { 0.05 } else { 0.0 };
                session.send(&Message::Position(position));
                std::thread::sleep(Duration::from_millis(1));
                match session.poll() {
                    Some(Message::Correction(_)) => lies = true,
                    Some(Message::Close(_)) => return,
                    _ => {}
                }
            }
        });
    });
    let output = command.wait_with_output().expect("ends");
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(65), "{said}");
    assert!(said.contains("at once: faulted: VC-4001"), "{said}");
}

#[test]
fn an_axis_that_is_not_listed_keeps_its_offset_and_that_is_told() {
    let port = Port::open();
    let mut daemon = Daemon::start(&port.address(), Setup::default());
    let mut larger = hello();
    larger.axes[3] = Axis { name: AxisName::U, unit: AxisUnit::Millimetre };
    larger.axis_count = 4;
    let mut session = port.accept();
    session.handshake(&larger);
    // left from a time when the machine file had [axes.u]
    session.applied[3] = 0.05;
    let mut seen = serde_json::Value::Null;
    let told = eventually(|| {
        let _ = session.cycle();
        seen = daemon.status();
        seen["unlisted"] == serde_json::json!(["u"])
            && seen["recent"]["warnings"]
                .as_array()
                .is_some_and(|all| all.iter().any(|w| w["code"] == "VC-4010"))
    });
    assert!(told, "{seen}");
    let shown = text(&daemon.volcomp(&["status"]).stdout);
    assert!(
        shown.lines().any(|l| l.contains("+50.000 µm") && l.contains("NOT IN THE MACHINE FILE")),
        "{shown}"
    );
    daemon.signal(Signal::TERM);
    while let Message::Correction(_) = session.try_cycle() {}
    let _ = daemon.wait();
    let log = daemon.log();
    assert!(log.contains("the control keeps those of others: u: 50 um"), "{log}");
    assert!(!log.contains("INFO the offset is at its rest value"), "{log}");
}

#[test]
fn a_stop_with_a_fault_at_zero_does_not_warn() {
    let port = Port::open();
    let (mut daemon, mut session) = port.latched();
    session.run_unanswered(50);
    daemon.signal(Signal::TERM);
    let _ = daemon.wait();
    let log = daemon.log();
    assert!(log.contains("nothing was sent, and the control reports no offset"), "{log}");
    assert!(!log.contains("stopped before the offset was at its rest value"), "{log}");
}

#[test]
fn half_open_clients_do_not_shut_out_an_operator() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), Setup::default());
    let mut session = port.link();
    session.run_until_corrected();
    let held: Vec<UnixStream> = (0..16)
        .map(|k| {
            let mut client = UnixStream::connect(daemon.socket()).expect("connects");
            // every second one has begun a request
            if k % 2 == 0 {
                client.write_all(b"{\"command\":").expect("sent");
            }
            client
        })
        .collect();
    let answer = daemon.volcomp(&["disable"]);
    assert!(answer.status.success(), "{}", text(&answer.stderr));
    let answer = daemon.volcomp(&["status", "--json"]);
    assert!(is_answer(&answer), "{}", text(&answer.stderr));
    drop(held);
}

/// Enabling says which fault is latched, and how to go on.
fn refused_as_faulted(daemon: &Daemon) {
    let answer = daemon.volcomp(&["enable"]);
    assert_ne!(answer.status.code(), Some(0));
    let said = text(&answer.stderr);
    assert!(said.contains("VC-4001") && said.contains("--clear-fault") && said.contains("60 µm"), "{said}");
}

#[test]
fn the_socket_refuses_what_it_does_not_know_and_is_not_for_everybody() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), Setup::default());
    let _ = daemon.status();
    let mode = std::fs::metadata(daemon.socket()).expect("socket").permissions().mode();
    assert_eq!(mode & 0o777, 0o660);
    for wrong in ["{\"command\": \"format-disk\"}\n", "\u{0}\n", &format!("{}\n", "x".repeat(5000))] {
        let mut stream = UnixStream::connect(daemon.socket()).expect("connected");
        // the daemon may close before it has read everything
        let _ = stream.write_all(wrong.as_bytes());
        let mut answer = String::new();
        let _ = BufReader::new(stream).read_line(&mut answer);
        assert!(answer.is_empty() || answer.contains("\"ok\":false"), "{answer}");
    }
    // silent clients up to the limit do not keep the next one out for long
    let silent: Vec<_> = (0..8).map(|_| UnixStream::connect(daemon.socket()).expect("connected")).collect();
    assert!(eventually(|| is_answer(&daemon.volcomp(&["status", "--json"]))));
    drop(silent);
}

#[test]
fn without_a_daemon_the_tool_says_so() {
    let dir = tempfile::tempdir().expect("directory");
    let socket = dir.path().join("nobody");
    for verb in ["status", "enable", "disable"] {
        let output = Command::new(env!("CARGO_BIN_EXE_volcomp"))
            .arg(verb)
            .arg("--socket")
            .arg(&socket)
            .output()
            .expect("volcomp runs");
        assert_eq!(output.status.code(), Some(74));
        assert!(text(&output.stderr).contains("volcompd is not running"), "{}", text(&output.stderr));
        assert!(output.stdout.is_empty());
    }
}

#[test]
fn a_daemon_that_ends_during_a_request_is_said_to_have_ended() {
    let dir = tempfile::tempdir().expect("directory");
    let socket = dir.path().join("sock");
    let listener = UnixListener::bind(&socket).expect("bound");
    // nothing, and half an answer
    for said in ["", "{\"ok\": tr"] {
        let asked = Command::new(env!("CARGO_BIN_EXE_volcomp"))
            .args(["gain", "0.5", "--socket"])
            .arg(&socket)
            .stderr(Stdio::piped())
            .spawn()
            .expect("volcomp runs");
        let (mut client, _) = listener.accept().expect("a client");
        let mut request = String::new();
        BufReader::new(client.try_clone().expect("a stream")).read_line(&mut request).expect("a request");
        client.write_all(said.as_bytes()).expect("sent");
        drop(client);
        let output = asked.wait_with_output().expect("it ends");
        let words = text(&output.stderr);
        assert_eq!(output.status.code(), Some(74), "{words}");
        assert!(words.contains("before it answered") && !words.contains("same version"), "{words}");
    }
}

#[test]
fn a_second_daemon_on_the_same_socket_is_refused() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), Setup::default());
    let _ = daemon.status();
    let second = volcompd(&daemon.dir.path().join("machine.toml"));
    assert_eq!(second.status.code(), Some(74));
    assert!(text(&second.stderr).contains("already running"), "{}", text(&second.stderr));
    assert_eq!(daemon.status()["state"], "disconnected", "the first one is not disturbed");
}

#[test]
fn a_socket_left_by_a_killed_daemon_is_replaced() {
    let port = Port::open();
    let mut daemon = Daemon::start(&port.address(), Setup::default());
    let _ = daemon.status();
    daemon.signal(Signal::KILL);
    let _ = daemon.wait();
    assert!(daemon.socket().exists());
    daemon.restart();
    assert!(eventually(|| is_answer(&daemon.volcomp(&["status", "--json"]))), "{}", daemon.log());
}

fn volcompd(config: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcompd")).arg("--config").arg(config).output().expect("volcompd runs")
}

#[test]
fn mistakes_at_the_start_have_their_exit_codes() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), Setup::default());
    let dir = daemon.dir.path();
    let machine = std::fs::read_to_string(dir.join("machine.toml")).expect("machine file");
    let try_with = |machine: &str| {
        std::fs::write(dir.join("other.toml"), machine).expect("written");
        let output = volcompd(&dir.join("other.toml"));
        (output.status.code(), text(&output.stderr))
    };
    let output = volcompd(&dir.join("absent.toml"));
    assert_eq!(output.status.code(), Some(74));
    assert!(text(&output.stderr).contains("absent.toml"));
    let (code, words) = try_with(&machine.replace("model.toml", "absent-model.toml"));
    assert_eq!(code, Some(74), "{words}");
    assert!(words.contains("absent-model.toml"), "{words}");
    let (code, words) = try_with(&machine.replace("ramp-s", "rampe-s"));
    assert_eq!(code, Some(78), "{words}");
    assert!(words.contains("rampe-s") && words.contains("other.toml"), "{words}");
    let (code, words) = try_with(&machine.replace("\"test-mill\"", "\"lathe\""));
    assert_eq!(code, Some(78), "{words}");
    assert!(words.contains("the model is of machine \"test-mill\""), "{words}");
    let usage = Command::new(env!("CARGO_BIN_EXE_volcompd")).output().expect("volcompd runs");
    assert_eq!(usage.status.code(), Some(64));
}

#[test]
fn systemd_hears_ready_status_watchdog_and_stopping() {
    let dir = tempfile::tempdir().expect("directory");
    let path = dir.path().join("notify");
    let socket = UnixDatagram::bind(&path).expect("socket");
    socket.set_read_timeout(Some(PATIENCE)).expect("option");
    let environment = vec![
        ("NOTIFY_SOCKET", path.display().to_string()),
        // half of it is 100 ms
        ("WATCHDOG_USEC", "200000".to_owned()),
    ];
    let port = Port::open();
    let mut daemon = Daemon::start(&port.address(), Setup { environment, ..Setup::default() });
    let heard_until = |words: &str| {
        let mut heard = Vec::new();
        let mut buffer = [0; 1024];
        let deadline = Instant::now() + PATIENCE;
        loop {
            assert!(Instant::now() < deadline, "no `{words}`: {heard:?}");
            let length = socket.recv(&mut buffer).unwrap_or_else(|e| panic!("no `{words}`: {e}: {heard:?}"));
            heard.push(text(&buffer[..length]));
            if heard.last().is_some_and(|h| h.contains(words)) {
                return heard;
            }
        }
    };
    // ready although the control has not answered yet, and alive while it connects
    let heard = heard_until("READY=1");
    assert!(!heard.iter().any(|h| h.contains("WATCHDOG=1")), "{heard:?}");
    heard_until("WATCHDOG=1");
    let mut session = port.accept();
    session.handshake(&hello());
    session.run_until_corrected();
    for _ in 0..200 {
        let _ = session.cycle();
    }
    heard_until("STATUS=active");
    heard_until("WATCHDOG=1");
    // alive on a link without positions, too
    heard_until("WATCHDOG=1");
    session.close();
    daemon.signal(Signal::TERM);
    heard_until("STOPPING=1");
    assert_eq!(daemon.wait().code(), Some(0));
}

#[test]
fn the_watchdog_is_not_fed_by_a_stopped_process() {
    let dir = tempfile::tempdir().expect("directory");
    let path = dir.path().join("notify");
    let socket = UnixDatagram::bind(&path).expect("socket");
    socket.set_read_timeout(Some(std::time::Duration::from_millis(500))).expect("option");
    let environment =
        vec![("NOTIFY_SOCKET", path.display().to_string()), ("WATCHDOG_USEC", "200000".to_owned())];
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), Setup { environment, ..Setup::default() });
    let mut buffer = [0; 1024];
    let mut fed = || socket.recv(&mut buffer).is_ok();
    assert!(eventually(&mut fed));
    daemon.signal(Signal::STOP);
    // what was sent before
    while fed() {}
    assert!(!fed(), "fed while stopped");
    daemon.signal(Signal::CONT);
    assert!(fed(), "fed again");
}

#[test]
fn requests_beyond_their_limits_are_refused_by_tool_and_daemon() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), Setup::default());
    assert!(eventually(|| daemon.socket().exists()));
    let ask = |request: &str| {
        let mut stream = UnixStream::connect(daemon.socket()).expect("connected");
        stream.write_all(request.as_bytes()).expect("sent");
        stream.write_all(b"\n").expect("sent");
        let mut answer = String::new();
        BufReader::new(stream).read_line(&mut answer).expect("answered");
        answer
    };
    let long = "x".repeat(1 << 20);
    let answer = ask(&format!("{{\"command\":\"disable\",\"reason\":\"{long}\"}}"));
    assert!(answer.contains("1048576 bytes, the limit is 1024"), "{answer}");
    for degc in ["1e308", "-500"] {
        let answer = ask(&format!("{{\"command\":\"enable\",\"temperature_degc\":{degc}}}"));
        assert!(answer.contains("-50 to 150 degC"), "{answer}");
        let refused = daemon.volcomp(&["enable", "--temperature-degc", degc]);
        assert_eq!(refused.status.code(), Some(64), "{}", text(&refused.stderr));
    }
    let refused = daemon.volcomp(&["disable", "--reason", &long[..1025]]);
    assert_eq!(refused.status.code(), Some(64), "{}", text(&refused.stderr));
    assert!(daemon.status()["temperature_degc"].is_null());
    // a request without an end is cut off at the limit of a line
    let mut stream = UnixStream::connect(daemon.socket()).expect("connected");
    let block = vec![b' '; 1 << 20];
    let sent = (0..40).take_while(|_| stream.write_all(&block).is_ok()).count();
    assert!((8..40).contains(&sent), "{sent} MiB taken");
}

#[test]
fn the_socket_is_relative_to_the_machine_file() {
    let port = Port::open();
    let mut daemon = Daemon::start(&port.address(), Setup::default());
    daemon.signal(Signal::KILL);
    let _ = daemon.wait();
    let config = daemon.dir.path().join("machine.toml");
    let absolute = daemon.socket().display().to_string();
    let machine = std::fs::read_to_string(&config).expect("there").replace(&absolute, "run/here.sock");
    std::fs::write(&config, machine).expect("written");
    daemon.restart();
    assert!(eventually(|| daemon.dir.path().join("run/here.sock").exists()), "{}", daemon.log());
    let status = Command::new(env!("CARGO_BIN_EXE_volcomp"))
        .args(["status", "--json", "--config"])
        .arg(&config)
        .current_dir("/")
        .output()
        .expect("runs");
    assert!(is_answer(&status), "{}", text(&status.stderr));
}

#[test]
fn a_service_that_hangs_is_seen_by_the_cycle_and_sigterm_works_all_the_same() {
    // systemd's socket, which nobody reads: soon the service waits in it for ever
    let folder = tempfile::tempdir().expect("directory");
    let path = folder.path().join("notify");
    let socket = std::os::unix::net::UnixDatagram::bind(&path).expect("socket");
    let port = Port::open();
    let environment =
        vec![("NOTIFY_SOCKET", path.display().to_string()), ("WATCHDOG_USEC", "40000".to_owned())];
    let more = "[state]\ndirectory = \"state\"\n";
    let mut daemon = Daemon::start(&port.address(), Setup { environment, more, ..Setup::default() });
    let mut session = port.link();
    session.run_until_corrected();
    // the limit counts the daemon's time, so a control of a loaded computer gives it that
    let mut cycles = 0;
    while session.applied[0] != 0.0 {
        let _ = session.cycle();
        std::thread::sleep(std::time::Duration::from_millis(1));
        cycles += 1;
        assert!(cycles < 100_000, "the offset stays although the service hangs");
    }
    assert!(cycles > 1000, "{cycles}: not before the service hangs");
    daemon.signal(Signal::TERM);
    loop {
        match session.try_cycle() {
            Message::Correction(_) => {}
            Message::Close(close) => break assert_eq!(close.reason, CloseReason::Shutdown),
            other => panic!("{other:?}"),
        }
    }
    // the cycle thread has ended; the process goes when the service has had its time
    let deadline = Instant::now() + std::time::Duration::from_secs(60);
    let status = loop {
        if let Some(status) = daemon.child.try_wait().expect("child") {
            break status;
        }
        assert!(Instant::now() < deadline, "the process does not end:\n{}", daemon.log());
        std::thread::sleep(std::time::Duration::from_millis(20));
    };
    assert_eq!(status.code(), Some(70), "{}", daemon.log());
    drop(socket);
    assert!(daemon.log().contains("the service does not end by itself"), "{}", daemon.log());
}

#[test]
fn a_mistake_in_the_machine_file_keeps_nobody_from_switching_off() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), Setup::default());
    let mut session = port.link();
    session.run_until_corrected();
    let path = daemon.dir.path().join("machine.toml");
    let good = std::fs::read_to_string(&path).expect("read");
    let broken = [
        good.replace("limit-um", "limmit-um"),
        format!("{good}\n= no TOML"),
        good.replace("[status]", "[status] # where"),
    ];
    for text in broken {
        std::fs::write(&path, text).expect("written");
        let done = std::process::Command::new(env!("CARGO_BIN_EXE_volcomp"))
            .args(["disable", "--config"])
            .arg(&path)
            .output()
            .expect("volcomp runs");
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(done.status.success(), "{said}");
    }
    assert_eq!(daemon.status()["enabled"], false);
}

#[test]
fn a_daemon_that_does_not_start_has_no_start_in_its_audit_log() {
    let port = Port::open();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let more = format!(
        "[state]\ndirectory = \"state\"\n[sensors]\nlisten = \"{}\"\n[[sensor]]\nname = \"air\"\nkind = \"temperature\"\n",
        taken.local_addr().expect("address")
    );
    let more: &'static str = Box::leak(more.into_boxed_str());
    let mut daemon = Daemon::start(&port.address(), Setup { more, ..Setup::default() });
    assert_eq!(daemon.wait().code(), Some(74), "{}", daemon.log());
    assert!(daemon.log().contains("sensors.listen"), "{}", daemon.log());
    let audit = daemon.dir.path().join("state/audit.jsonl");
    let starts = || std::fs::read_to_string(&audit).unwrap_or_default().matches("\"what\":\"start\"").count();
    assert_eq!(starts(), 0);
    drop(taken);
    daemon.restart();
    assert!(eventually(|| starts() == 1), "{}", daemon.log());
}
