//! Commands by HTTP: the token, what is refused, and that they go the way of the status socket.

#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test program: it fails by panicking")]

use std::fs;
use std::io::Write;
use std::net::SocketAddr;
use std::os::unix::fs::PermissionsExt;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tempfile::TempDir;

use crate::http::{connect, exchange, get, served_with};
use crate::support::{Daemon, EXX_MM, Port, Session, Setup, eventually};

pub(crate) const TOKEN: &str = "5f2d-a-token-of-a-test-that-is-long-enough";
/// Counters and the audit log.
pub(crate) const KEPT: &str = "[state]\ndirectory = \"state\"\n";

/// A token file, and the key of the machine file that names it.
pub(crate) fn token_file() -> (TempDir, String) {
    let folder = tempfile::tempdir().expect("directory");
    let path = folder.path().join("token");
    fs::write(&path, format!("{TOKEN}\n")).expect("written");
    fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).expect("set");
    let key = format!("token-file = \"{}\"\n", path.display());
    (folder, key)
}

fn served(port: &Port, setup: Setup) -> (Daemon, SocketAddr) {
    let (_folder, key) = token_file();
    served_with(port, Setup { more: KEPT, ..setup }, &key)
}

/// Sends a request with these header lines; gives code and object of the answer.
fn post(address: SocketAddr, headers: &str, body: &str) -> (u16, Value) {
    let request = format!(
        "POST /api/v1/command HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\nContent-Length: {}\r\n{headers}\r\n{body}",
        body.len()
    );
    let answer = exchange(address, &request);
    let code = answer.split(' ').nth(1).and_then(|code| code.parse().ok()).unwrap_or(0);
    let object = answer.split_once("\r\n\r\n").and_then(|(_, body)| serde_json::from_str(body).ok());
    (code, object.unwrap_or_default())
}

/// A command with the token.
fn order(address: SocketAddr, ask: &Value) -> (u16, Value) {
    let headers = format!("Authorization: Bearer {TOKEN}\r\nContent-Type: application/json\r\n");
    post(address, &headers, &ask.to_string())
}

/// Cycles while a command is given; ends with its answer.
fn cycle_while(session: &mut Session, address: SocketAddr, ask: &Value) -> (u16, Value) {
    std::thread::scope(|scope| {
        let order = scope.spawn(|| order(address, ask));
        while !order.is_finished() {
            let _ = session.cycle();
        }
        order.join().expect("an answer")
    })
}

fn model(um: f64) -> String {
    format!(
        "format = \"volcomp-model/1\"\nmachine = \"test-mill\"\nchain = \"[w X' b Y Z t]\"\n[errors.exx.constant]\n\
         value-um = {um}\n"
    )
}

fn audit(daemon: &Daemon) -> String {
    fs::read_to_string(daemon.dir.path().join("state/audit.jsonl")).unwrap_or_default()
}

#[test]
fn commands_do_what_the_socket_does_and_stand_in_the_audit_log() {
    let port = Port::open();
    let (daemon, address) = served(&port, Setup { start: "on-command", ..Setup::default() });
    assert_eq!(get(address, "/api/v1/about", "").1, "{\"commands\":true}");
    let mut session = port.link();
    for _ in 0..50 {
        let _ = session.cycle();
    }
    let enable = json!({"command": "enable", "reason": "warm-up done", "name": "A. Smith"});
    let (code, answer) = cycle_while(&mut session, address, &enable);
    assert_eq!((code, &answer["ok"]), (200, &json!(true)), "{answer}");
    session.run_until_corrected();
    let (code, _) =
        cycle_while(&mut session, address, &json!({"command": "gain", "gain": 0.5, "reason": "test cut"}));
    assert_eq!(code, 200);
    for _ in 0..400 {
        let _ = session.cycle();
    }
    assert!((session.applied[0] + EXX_MM / 2.0).abs() < 1e-9, "{}", session.applied[0]);

    // another model: the picture first, then the load of what the picture showed
    let sent = json!({"origin": "new.toml", "text": model(40.0)});
    let (code, seen) = cycle_while(&mut session, address, &json!({"command": "compare", "model": sent}));
    let found = &seen["comparison"];
    assert!(
        code == 200 && found["confirmation"].is_null() && found["errors"][0]["symbol"] == "EXX",
        "{seen}"
    );
    assert_eq!((&found["errors"][0]["old"][0], &found["errors"][0]["new"][0]), (&json!(10.0), &json!(40.0)));
    assert_eq!(daemon.status()["model_hash"], found["change"]["old_hash"], "nothing has changed");
    let stale = json!({"command": "load", "model": sent, "reason": "survey", "old_hash": "0".repeat(64)});
    let (code, answer) = cycle_while(&mut session, address, &stale);
    assert!(code == 409 && answer["error"].as_str().is_some_and(|e| e.contains("compare again")), "{answer}");
    let load = json!({
        "command": "load", "model": sent, "reason": "survey", "name": "A. Smith", "old_hash": found["change"]["old_hash"],
    });
    let (code, answer) = cycle_while(&mut session, address, &load);
    assert_eq!(code, 200, "{answer}");
    assert_eq!(daemon.status()["model_hash"], found["change"]["new_hash"]);
    assert_eq!(daemon.status()["model_choice"]["who"], "A. Smith (HTTP, 127.0.0.1)");
    // a large change asks for a person
    let large = json!({"origin": "large.toml", "text": model(120.0)});
    let (_, seen) = cycle_while(&mut session, address, &json!({"command": "compare", "model": large}));
    assert!(seen["comparison"]["confirmation"].as_str().is_some_and(|why| why.contains("80.0 um")), "{seen}");
    let (code, answer) =
        cycle_while(&mut session, address, &json!({"command": "load", "model": large, "reason": "screw"}));
    assert!(code == 409 && answer["error"].as_str().is_some_and(|e| e.contains("VC-5006")), "{answer}");
    let (code, back) = cycle_while(&mut session, address, &json!({"command": "compare"}));
    assert!(code == 200 && back["comparison"]["errors"][0]["new"][0] == json!(10.0), "{back}");
    let change = &back["comparison"]["change"];
    let rollback = json!({
        "command": "rollback", "reason": "worse", "old_hash": change["old_hash"], "new_hash": change["new_hash"],
    });
    assert_eq!(cycle_while(&mut session, address, &rollback).0, 200);

    // a fault is cleared, and compensation can be taken out
    session.deceive(0.05);
    let faulted =
        eventually(|| daemon.status()["state"] == "faulted" || daemon.status()["health"]["exit_code"] == 4);
    assert!(faulted, "{}", daemon.status());
    drop(session);
    let mut session = port.link();
    session.run_unanswered(50);
    let (code, answer) = order(address, &json!({"command": "enable", "reason": "too early"}));
    assert!(code == 409 && answer["error"].as_str().is_some_and(|e| e.contains("VC-4001")), "{answer}");
    let (code, answer) =
        order(address, &json!({"command": "clear-fault", "reason": "second daemon removed"}));
    assert!(code == 200 && daemon.status()["faults"] == json!([]), "{answer}");
    let (code, answer) = order(address, &json!({"command": "disable", "reason": "end of shift"}));
    assert_eq!(code, 200, "{answer}");
    let words = [
        "\"enable\"",
        "warm-up done",
        "A. Smith (HTTP, 127.0.0.1)",
        "unnamed (HTTP",
        "test cut",
        "\"load\"",
        "survey",
        "\"rollback\"",
        "worse",
        "second daemon removed",
        "\"disable\"",
        "end of shift",
    ];
    for word in words {
        assert!(eventually(|| audit(&daemon).contains(word)), "no {word} in\n{}", audit(&daemon));
    }
    assert!(!audit(&daemon).contains("\"compare\"") && !audit(&daemon).contains(TOKEN));
    assert!(!daemon.log().contains(TOKEN) && !get(address, "/api/v1/status", "").1.contains(TOKEN));
}

#[test]
fn nothing_is_done_without_the_token_a_reason_and_json() {
    let port = Port::open();
    let (daemon, address) = served(&port, Setup { start: "on-command", ..Setup::default() });
    let enable = json!({"command": "enable", "reason": "x"}).to_string();
    let kind = "Content-Type: application/json\r\n";
    let good = format!("Authorization: Bearer {TOKEN}\r\n");
    for (headers, body, code) in [
        (kind.to_owned(), enable.as_str(), 401),
        (format!("{kind}Cookie: token={TOKEN}\r\n"), &enable, 401),
        // a page of another site can send this kind of body without asking
        (format!("{good}Content-Type: text/plain\r\n"), &enable, 415),
        (good.clone(), &enable, 415),
        (format!("{good}{kind}"), "{\"command\": \"enable\"}", 400),
        (format!("{good}{kind}"), "{\"command\": \"enable\", \"reason\": \" \"}", 400),
        (format!("{good}{kind}"), "{\"command\": \"enable\", \"reason\": \"x\", \"force\": true}", 400),
        (format!("{good}{kind}"), "[", 400),
        // wrong tokens, and the right one said twice or otherwise
        (format!("{kind}Authorization: Bearer {TOKEN}x\r\n"), &enable, 401),
        (format!("{kind}Authorization: Basic {TOKEN}\r\n"), &enable, 401),
        (format!("{good}{good}{kind}"), &enable, 401),
    ] {
        let (found, answer) = post(address, &headers, body);
        assert_eq!(found, code, "{headers}{body}: {answer}");
        assert!(code == 415 || answer["ok"] == false && answer["error"].is_string(), "{answer}");
    }
    // the token in the address is none
    let request = format!(
        "POST /api/v1/command?token={TOKEN} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n{kind}Content-Length: {}\r\n\r\n{enable}",
        enable.len()
    );
    assert!(exchange(address, &request).starts_with("HTTP/1.1 401"));
    // another site's name for this service
    let request = format!(
        "POST /api/v1/command HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n{good}{kind}Content-Length: {}\r\n\r\n{enable}",
        enable.len()
    );
    assert!(exchange(address, &request).starts_with("HTTP/1.1 421"));
    assert_eq!(daemon.status()["enabled"], false, "{}", audit(&daemon));
    // a browser that asks whether another site may: no permission is given
    let request = format!(
        "OPTIONS /api/v1/command HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\nOrigin: http://evil.example\r\n\
         Access-Control-Request-Method: POST\r\nAccess-Control-Request-Headers: authorization\r\n\r\n"
    );
    let answer = exchange(address, &request).to_ascii_lowercase();
    assert!(answer.starts_with("http/1.1 405") && !answer.contains("access-control-allow"), "{answer}");

    // after some wrong ones nobody at this address is listened to for a while, not even with the right one
    let wrong = format!("{kind}Authorization: Bearer {}\r\n", "0".repeat(40));
    let codes: Vec<u16> = (0..6).map(|_| post(address, &wrong, &enable).0).collect();
    assert_eq!(codes.last(), Some(&429), "{codes:?}");
    let (code, answer) = order(address, &json!({"command": "enable", "reason": "x"}));
    assert!(code == 429 && answer["error"].as_str().is_some_and(|e| e.contains("try again in")), "{answer}");
    assert!(get(address, "/metrics", "").0.starts_with("http/1.1 200"), "reading goes on");
    assert_eq!(daemon.status()["enabled"], false);
    daemon.wait_for_log("a wrong token on the HTTP service");
    assert!(daemon.volcomp(&["enable"]).status.success(), "the socket is a way of its own");
}

#[test]
fn a_request_that_is_long_or_does_not_arrive_is_given_up() {
    let port = Port::open();
    let (_daemon, address) = served(&port, Setup::default());
    let head = format!(
        "POST /api/v1/command HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\nAuthorization: Bearer {TOKEN}\r\n\
         Content-Type: application/json\r\n"
    );
    let long = exchange(address, &format!("{head}Content-Length: 900000000\r\n\r\n{{"));
    assert!(long.starts_with("HTTP/1.1 413"), "{long}");
    // bodies that never end take all places for a while, and then none
    let slow: Vec<_> = (0..4)
        .map(|_| {
            let mut stream = connect(address);
            write!(stream, "{head}Content-Length: 100\r\n\r\n{{").expect("sent");
            stream
        })
        .collect();
    let status = json!({"command": "status"});
    assert!(eventually(|| order(address, &status).0 == 503), "bounded");
    let deadline = Instant::now() + Duration::from_secs(40);
    while order(address, &status).0 != 200 {
        assert!(Instant::now() < deadline, "the places are not given back");
        std::thread::sleep(Duration::from_millis(200));
    }
    drop(slow);
}

#[test]
fn a_token_that_others_may_read_ends_the_start_and_is_found_by_check() {
    let (folder, key) = token_file();
    let path = folder.path().join("token");
    fs::set_permissions(&path, fs::Permissions::from_mode(0o644)).expect("set");
    let port = Port::open();
    let more: &'static str = format!("[http]\nlisten = \"127.0.0.1:7870\"\n{key}").leak();
    let mut daemon = Daemon::start(&port.address(), Setup { more, ..Setup::default() });
    assert_eq!(daemon.wait().code(), Some(78));
    let log = daemon.log();
    assert!(log.contains("http.token-file") && log.contains("0644") && log.contains("chmod 06"), "{log}");
    let machine = daemon.dir.path().join("machine.toml").display().to_string();
    let check = std::process::Command::new(env!("CARGO_BIN_EXE_volcomp")).args(["check", &machine]).output();
    let check = check.expect("runs");
    let said = String::from_utf8_lossy(&check.stderr);
    assert!(
        check.status.code() == Some(78) && said.contains("token-file") && said.contains("0644"),
        "{said}"
    );
    fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).expect("set");
    fs::write(&path, "short\n").expect("written");
    daemon.restart();
    assert_eq!(daemon.wait().code(), Some(78));
    assert!(daemon.log().contains("5 characters") && !daemon.log().contains("short\n"), "{}", daemon.log());
}
