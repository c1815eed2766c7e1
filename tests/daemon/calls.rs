//! Controls that are read and written by calls, line by line: what is written to them, and which are refused.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test is the control")]

use std::io::{BufRead, BufReader, Write};
use std::net::TcpListener;
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use super::support::{Daemon, Setup, eventually};

/// A control that says `machine` of itself, answers every read, and applies every offset twice.
struct Control {
    address: String,
    /// Every line of the daemon that writes something, of all links.
    written: Arc<Mutex<Vec<String>>>,
}

impl Control {
    fn open(machine: &'static str) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap().to_string();
        let written: Arc<Mutex<Vec<String>>> = Arc::default();
        let (log, start) = (Arc::clone(&written), Instant::now());
        // the thread ends with the process of the test
        thread::spawn(move || {
            for stream in listener.incoming() {
                let stream = stream.unwrap();
                stream.set_nodelay(true).unwrap();
                let mut reply = stream.try_clone().unwrap();
                let mut x_mm = 0.0;
                for line in BufReader::new(stream).lines() {
                    let Ok(line) = line else { break };
                    let cycle = start.elapsed().as_millis();
                    let answer = match line.trim() {
                        "READ machine" => format!("machine 1000000 {machine}"),
                        "READ tool" => "tool none".to_owned(),
                        "READ position" => format!(
                            "position {cycle} {cycle}000000 3 0 none 100 100 100 100 100 100 {} 0 0",
                            2.0 * x_mm
                        ),
                        _ => {
                            if let Some(offset) = line.strip_prefix("WRITE offset ") {
                                x_mm = offset.split(' ').next().unwrap().parse().unwrap();
                            }
                            log.lock().unwrap().push(line.trim().to_owned());
                            "ok".to_owned()
                        }
                    };
                    if reply.write_all(format!("{answer}\n").as_bytes()).is_err() {
                        break;
                    }
                }
            }
        });
        Self { address, written }
    }

    fn was_told(&self, start: &str) -> bool {
        self.written.lock().unwrap().iter().any(|line| line.starts_with(start))
    }
}

const CALLS: &str = "interface = \"read-write\"\n";
const SLOW: &str = "interface = \"read-write\"\npoll-ms = 60\n";

#[test]
fn a_control_of_another_machine_is_told_nothing() {
    let control = Control::open("100 XYZ other-mill");
    let daemon = Daemon::start(&control.address, Setup { link: CALLS, ..Setup::default() });
    daemon.wait_for_log("other-mill");
    thread::sleep(Duration::from_millis(300));
    assert!(control.written.lock().unwrap().is_empty(), "{:?}", control.written.lock().unwrap());
}

#[test]
fn a_hold_time_below_the_interval_of_the_calls_is_refused() {
    let control = Control::open("50 XYZ test-mill");
    let daemon = Daemon::start(&control.address, Setup { link: SLOW, ..Setup::default() });
    daemon.wait_for_log("for 50 ms without a write, link.poll-ms is 60");
    assert!(control.written.lock().unwrap().is_empty(), "{:?}", control.written.lock().unwrap());
}

#[test]
fn a_fault_is_shown_though_nothing_is_corrected_any_more() {
    let control = Control::open("100 XYZ test-mill");
    let daemon = Daemon::start(&control.address, Setup { link: CALLS, ..Setup::default() });
    assert!(eventually(|| control.was_told("WRITE state 2")), "{}", daemon.log());
    assert!(eventually(|| control.was_told("WRITE state 6")), "{}", daemon.log());
}
