//! What sensors have taught, on the disk of a real `volcompd`: forgotten for good, and reported where it cannot be saved.
//! And a sensor that has taught nothing, for none of its messages can be read.

#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test program: it fails by panicking")]

use std::fs;
use std::io::Write;
use std::net::TcpStream;
use std::path::PathBuf;
use std::time::Instant;

use crate::sensors::{Shop, is_counted, named, setup, tables};
use crate::support::{Daemon, PATIENCE, Port, eventually};
use rustix::process::Signal;

/// A daemon whose map has learned and is on the disk; its sensors are gone.
fn learned(port: &Port, keep_s: u32) -> Daemon {
    let (address, more) = tables();
    let more = more.replace("keep-s = 1", &format!("keep-s = {keep_s}"));
    let mut daemon = Daemon::start(&port.address(), setup(Box::leak(more.into_boxed_str())));
    let mut shop = Shop::open(port, &address);
    shop.until("the map has learned", |_| weight(&daemon) > 0.5);
    drop(shop);
    daemon.signal(Signal::TERM);
    assert!(daemon.wait().success());
    daemon.restart();
    daemon.wait_for_log("the map saved at");
    assert!(eventually(|| weight(&daemon) > 0.5), "{}", daemon.status());
    daemon
}

/// Whether a warning of the last minute lasts.
fn is_present(status: &serde_json::Value, code: &str) -> bool {
    let warnings = status["recent"]["warnings"].as_array().expect("warnings");
    warnings.iter().any(|warning| warning["code"] == code && warning["present"] == true)
}

fn weight(daemon: &Daemon) -> f64 {
    daemon.status()["maps"][0]["weight"].as_f64().unwrap_or_default()
}

/// Makes that `live.json` cannot be written: a folder in the place of its temporary file.
fn block(daemon: &Daemon) -> PathBuf {
    let obstacle = daemon.dir.path().join("state/live.json.tmp");
    fs::create_dir(&obstacle).expect("made");
    obstacle
}

#[test]
fn a_map_that_was_forgotten_does_not_come_back_with_a_restart() {
    let port = Port::open();
    let mut daemon = learned(&port, 3600);
    let done = daemon.volcomp(&["filter", "forget", "ram", "--reason", "set up anew"]);
    daemon.signal(Signal::KILL);
    let _ = daemon.wait();
    let said = [&done.stdout, &done.stderr].map(|text| String::from_utf8_lossy(text).into_owned());
    assert!(done.status.success() && !said.concat().contains("not kept"), "{said:?}");
    daemon.restart();
    assert!(eventually(|| daemon.status()["maps"][0]["state"] == "held"));
    assert!(weight(&daemon).abs() < 1e-12, "{}", daemon.status());

    // where the disk does not take it the answer says so
    let _obstacle = block(&daemon);
    let done = daemon.volcomp(&["filter", "forget", "ram"]);
    let said = String::from_utf8_lossy(&done.stderr);
    assert!(
        said.contains("note: not kept, so a restart may undo this: ") && said.contains("live.json"),
        "{said}"
    );
    let done = daemon.volcomp(&["filter", "forget", "ram", "--json"]);
    let answer: serde_json::Value = serde_json::from_slice(&done.stdout).expect("JSON");
    assert!(answer["notes"][0].as_str().expect("a note").starts_with("not kept"), "{answer}");
    // and a name that no map has is answered with those that there are
    let done = daemon.volcomp(&["filter", "forget", "rom"]);
    let said = String::from_utf8_lossy(&done.stderr);
    assert!(!done.status.success() && said.contains("\"rom\"; expected one of ram"), "{said}");
}

#[test]
fn maps_that_cannot_be_saved_are_a_warning_for_as_long_as_it_lasts() {
    let port = Port::open();
    let daemon = learned(&port, 1);
    let obstacle = block(&daemon);
    assert!(eventually(|| is_counted(&daemon.status(), "VC-7006")), "{}", daemon.status());
    let status = daemon.status();
    assert!(status["sensor_notes"].to_string().contains("VC-7006: maps are not saved: "), "{status}");
    assert!(is_present(&status, "VC-7006"), "{status}");
    daemon.wait_for_log("maps are not saved");
    fs::remove_dir(&obstacle).expect("removed");
    daemon.wait_for_log("maps are saved again");
    assert!(eventually(|| {
        let status = daemon.status();
        !is_present(&status, "VC-7006") && !status["sensor_notes"].to_string().contains("VC-7006")
    }));
}

#[test]
fn a_sensor_none_of_whose_messages_can_be_used_is_silent_and_they_are_counted() {
    let port = Port::open();
    let (address, more) = tables();
    let daemon = Daemon::start(&port.address(), setup(more));
    let mut shop = Shop::open(&port, &address);
    shop.tracker = false;
    let mut nonsense = TcpStream::connect(&address).expect("connects");
    let begin = Instant::now();
    let mut sent = 0_u64;
    while !is_counted(&daemon.status(), "VC-8002") {
        assert!(begin.elapsed() < 4 * PATIENCE, "{}", daemon.status());
        // a pose of two numbers
        let line = b"{\"sensor\": \"tracker\", \"t_s\": 1, \"pose\": {\"tip_mm\": [1, 2]}}\n";
        nonsense.write_all(line).expect("sent");
        sent += 1;
        shop.work(std::time::Duration::from_millis(200));
    }
    assert!(
        begin.elapsed().as_secs_f64() > 8.0,
        "a sensor may connect some time after the daemon has started"
    );
    // health of sensors is shown every 200 ms
    shop.until("the status names it", |_| {
        let status = daemon.status();
        named(&status, "sensors", "tracker")["cause"] == "silent" && is_present(&status, "VC-8002")
    });
    let status = daemon.status();
    assert_ne!(status["health"]["verdict"], "ok", "{status}");
    assert!(status["readings_refused"].as_u64().expect("a count") >= sent - 1, "{status}");
    for sensor in ["growth", "air"] {
        assert_eq!(named(&status, "sensors", sensor)["state"], "good", "{status}");
    }
    // it is believed as soon as it says something that can be used
    shop.tracker = true;
    shop.until("it is believed", |_| named(&daemon.status(), "sensors", "tracker")["state"] == "good");
}
