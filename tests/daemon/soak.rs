//! A long run: one frame every millisecond, with everything that a working day brings, and memory that stays flat.
//!
//! `cargo test --test daemon -- --ignored soak --nocapture` takes an hour; `SOAK_S` sets another time. A short run of
//! the same is part of the ordinary tests.

#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test program: it fails by panicking")]
#![allow(clippy::print_stdout, reason = "progress of an hour")]

use std::fs;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use crate::support::{Daemon, Port, STEP_MM_MAX, Session, Setup};
use volcomp::protocol::{MachineState, Message, Tool};

const CYCLE: Duration = Duration::from_millis(1);
/// What a day brings comes round in so many cycles.
const ROUND: u64 = 10_000;
const KEPT: &str = "[recording]\ndirectory = \"rec\"\nfile-max-mb = 1\ntotal-max-mb = 4\nwhen-full = \"delete-oldest\"\n\
    [state]\ndirectory = \"state\"\n";

/// What a process holds.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Held {
    resident_kib: u64,
    threads: u64,
    files: usize,
}

fn held(daemon: &Daemon) -> Held {
    let process = format!("/proc/{}", daemon.child.id());
    let status = fs::read_to_string(format!("{process}/status")).expect("a running daemon");
    let figure = |key: &str| {
        let line = status.lines().find(|l| l.starts_with(key)).expect("a line of /proc");
        line.split_whitespace().nth(1).and_then(|w| w.parse().ok()).expect("a number")
    };
    let files = fs::read_dir(format!("{process}/fd")).expect("open files").count();
    Held { resident_kib: figure("VmRSS:"), threads: figure("Threads:"), files }
}

/// One cycle of the round: motion all the time, now and then a tool, an emergency stop, an order.
fn cycle(session: &mut Session, daemon: &Daemon, k: u64, order_due: &mut Option<Child>) {
    let at = k % ROUND;
    let t = k as f64 * 1e-3;
    session.commanded[0] = 200.0 + 150.0 * (0.7 * t).sin();
    session.commanded[1] = 150.0 + 100.0 * (1.1 * t).cos();
    session.state = MachineState::HOMED | MachineState::ENABLED;
    match at {
        1_500 => session.send(&Message::Tool(Tool {
            tip: [0.0, 0.0, -100.0 - (k / ROUND % 7) as f64],
            ..Tool::default()
        })),
        2_500..2_800 => session.state |= MachineState::ESTOP,
        4_000..4_100 => session.state &= !MachineState::ENABLED,
        _ => {}
    }
    let before = session.applied[0];
    let _ = session.cycle();
    assert!((session.applied[0] - before).abs() <= STEP_MM_MAX * 1.001, "a step in cycle {k}");
    let order: &[&str] = match at {
        5_500 => &["gain", "0.5"],
        6_500 => &["gain", "1"],
        7_500 => &["disable"],
        8_000 => &["enable"],
        9_000 if (k / ROUND).is_multiple_of(2) => &["load"],
        9_000 => &["rollback"],
        _ => return,
    };
    let model = daemon.dir.path().join("other.toml").display().to_string();
    let mut order = order.to_vec();
    if order == ["load"] {
        order.push(&model);
    }
    // an order waits for the disk; the control goes on meanwhile
    finish(order_due.take());
    let child = daemon.command(&order).stderr(Stdio::piped()).stdout(Stdio::null()).spawn();
    *order_due = Some(child.expect("volcomp runs"));
}

/// Waits for the end of an order, which must have been carried out.
fn finish(order: Option<Child>) {
    let Some(order) = order else { return };
    let done = order.wait_with_output().expect("volcomp ends");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
}

fn soak(seconds: f64) {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), Setup { more: KEPT, ..Setup::default() });
    let other = "format = \"volcomp-model/1\"\nmachine = \"test-mill\"\nchain = \"[w X' b Y Z t]\"\n\
        [errors.exx.constant]\nvalue-um = 20.0\n";
    fs::write(daemon.dir.path().join("other.toml"), other).expect("written");
    let mut session = port.link();
    let mut order_due = None;
    let start = Instant::now();
    let cycles = (seconds / CYCLE.as_secs_f64()) as u64;
    // until then queues, histograms and the first files have found their size
    let settled = cycles / 6;
    let mut reference = None;
    let mut largest = 0;
    let mut due = start;
    for k in 0..cycles {
        due += CYCLE;
        // after a pause the control catches up, as a control does not: these frames are early, never lost
        if let Some(wait) = due.checked_duration_since(Instant::now()) {
            std::thread::sleep(wait);
        }
        cycle(&mut session, &daemon, k, &mut order_due);
        if k == settled {
            reference = Some(held(&daemon));
        }
        if k > settled && k.is_multiple_of(5_000) {
            let now = held(&daemon);
            largest = largest.max(now.resident_kib);
            if k.is_multiple_of(60_000) {
                println!("{:>6.0} s: {now:?}", start.elapsed().as_secs_f64());
            }
        }
    }
    finish(order_due);
    let (reference, end) = (reference.expect("long enough"), held(&daemon));
    let status = daemon.status();
    println!(
        "settled {reference:?}, end {end:?}, largest {largest} KiB, {} cycles, {} late",
        status["cycles"], status["late_cycles"]
    );
    assert_eq!(status["cycles"], cycles, "every frame was answered");
    // the thread that compares models waits a while for more of them before it ends
    assert!(
        end.threads <= reference.threads + 1 && end.files <= reference.files + 1,
        "{reference:?} {end:?}"
    );
    let grown = end.resident_kib.saturating_sub(reference.resident_kib);
    assert!(grown <= 1024, "memory grew by {grown} KiB: {reference:?} {end:?}");
    assert_eq!(status["recording"]["error"], serde_json::Value::Null, "{status}");
}

#[test]
fn twelve_seconds_of_everything() {
    soak(12.0);
}

#[test]
#[ignore = "takes an hour: cargo test --test daemon -- --ignored soak --nocapture"]
fn an_hour_of_everything() {
    soak(std::env::var("SOAK_S").ok().and_then(|s| s.parse().ok()).unwrap_or(3600.0));
}
