//! Where the monitor listens: in the control, and at the daemon's end of a relay that damages frames.

#![expect(clippy::disallowed_methods, reason = "a test of sockets and threads")]
#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::time::Duration;

use crate::support::{Client, Reply, axes, config, control};
use simulator::control::{Flow, IdealMachine};
use simulator::monitor::{Invariant, Report, Settings, SharedMonitor};
use simulator::scenarios::fault::{Direction, FaultKind, LinkFault};
use simulator::scenarios::relay::Relay;
use volcomp::protocol::{CorrectionState, Message, Position};

const WAIT: Duration = Duration::from_secs(5);
const CYCLES: usize = 200;

fn monitor() -> SharedMonitor {
    let file = include_str!("../../../config/examples/vmc-850/machine.toml");
    let names: Vec<_> = axes().as_slice().iter().map(|a| a.name).collect();
    SharedMonitor::new(Settings::from_machine_file(file, &names).unwrap())
}

/// A control and a daemon that answers so, with or without a relay and its fault between them.
fn run(
    fault: Option<LinkFault>,
    answer: impl FnMut(&Position) -> Reply + Send + 'static,
) -> (Report, Option<LinkFault>) {
    let monitor = monitor();
    let mut control = control(config());
    let relay = fault.map(|fault| {
        let relay = Relay::open(control.address(), 3, Some(monitor.clone())).unwrap();
        relay.set(fault);
        relay
    });
    if relay.is_none() {
        control.set_monitor(monitor.clone());
    }
    let address = relay.as_ref().map_or(control.address(), Relay::address);
    let daemon = std::thread::spawn(move || Client::handshake(address).0.serve(answer));
    control.wait_for_daemon(WAIT).unwrap();
    let mut left = CYCLES;
    let mut observer = |_: &simulator::control::CycleRecord| {
        left -= 1;
        Ok(if left == 0 { Flow::Stop } else { Flow::GoOn })
    };
    control.run_until(&mut IdealMachine, 1e3, &mut observer).unwrap();
    control.close();
    daemon.join().unwrap();
    let idle = relay.and_then(|relay| relay.clear());
    (monitor.report(), idle)
}

fn found(report: &Report, invariant: Invariant) -> Option<f64> {
    report.violations.iter().rev().find(|v| v.invariant == invariant).map(|v| v.value)
}

/// All frames of one direction.
fn always(kind: FaultKind, direction: Direction) -> Option<LinkFault> {
    Some(LinkFault { kind, direction, every: 1, frames: None })
}

#[test]
fn the_monitor_in_the_control_sees_every_correction() {
    // a slow ramp to beyond the limit of 0.15 mm
    let (report, _) = run(None, |p| Reply::Offset(1e-3 * f64::from(p.sequence)));
    assert_eq!(report.figures.answers as usize, CYCLES);
    assert_eq!(report.figures.links, 1);
    let largest = found(&report, Invariant::Size).unwrap();
    assert!((largest - 1e-3 * (CYCLES - 1) as f64).abs() < 1e-9, "{largest}");
    assert_eq!(found(&report, Invariant::Step), None, "{report:?}");
}

#[test]
fn a_slow_ramp_within_the_limits_breaks_nothing_but_the_order_of_states() {
    // the tiny daemon says active from its first answer on
    let (report, _) = run(None, |p| Reply::Offset(1e-5 * f64::from(p.sequence)));
    assert!(report.violations.iter().all(|v| v.invariant == Invariant::State), "{report:?}");
    assert_eq!(report.total, 1, "{report:?}");
}

#[test]
fn the_monitor_at_a_relay_sees_what_the_daemon_sends_and_not_the_damage() {
    let fault = always(FaultKind::Jump { mm: 20.0 }, Direction::ToControl);
    let (report, idle) = run(fault, |_| Reply::Offset(0.0));
    assert_eq!((report.figures.answers as usize, idle), (CYCLES, None));
    assert!(report.violations.iter().all(|v| v.invariant == Invariant::State), "{report:?}");
}

#[test]
fn the_monitor_at_a_relay_sees_a_daemon_that_believes_a_false_read_back() {
    let fault = always(FaultKind::ReadBackIs { mm: 5.0 }, Direction::ToDaemon);
    let (report, idle) = run(fault, |p| Reply::Offset(p.applied[0]));
    assert_eq!(idle, None);
    assert_eq!(found(&report, Invariant::Size), Some(5.0), "{report:?}");
    assert_eq!(found(&report, Invariant::Step), None, "the read-back was the first answer: {report:?}");
}

#[test]
fn positive_feedback_grows_by_its_factor_with_every_answer() {
    let fault = always(FaultKind::ReadBackFeedback { by: 10.0 }, Direction::ToDaemon);
    let (report, _) = run(fault, |p| Reply::Offset(p.applied[0].clamp(1e-6, 1e300)));
    let largest = found(&report, Invariant::Size).unwrap();
    assert!(largest > 1e150, "{largest}: {report:?}");
}

/// `cncsim serve --monitor` with a daemon that asks for this offset; its exit code and what it said.
fn served(offset: f64) -> (Option<i32>, String) {
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("p.nc");
    std::fs::write(&program, "F6000 G1 X435\n").unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_cncsim"))
        .args([
            "serve",
            "--listen",
            "127.0.0.1:0",
            "--as-fast-as-possible",
            "--wait-s",
            "20",
            "--settle-s",
            "0.1",
        ])
        .args(["--monitor", concat!(env!("CARGO_MANIFEST_DIR"), "/../config/examples/vmc-850/machine.toml")])
        .arg("--program")
        .arg(&program)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
    let address = lines.find_map(|l| l.strip_prefix("listening on ").map(str::to_owned)).unwrap();
    let mut client = Client::connect(address.parse().unwrap());
    assert!(client.send(&Client::hello(1, "vmc-850")));
    assert!(matches!(client.receive(), Some(Message::ControlHello(_))));
    client.serve(|_| Reply::Correction(CorrectionState::Off, offset));
    let said = lines.collect::<Vec<_>>().join("\n");
    (child.wait().unwrap().code(), said)
}

#[test]
fn serve_fails_where_the_monitor_finds_a_violation() {
    let (code, said) = served(0.2);
    assert_eq!(code, Some(70), "{said}");
    assert!(said.contains("I1 size: offset beyond the limit: X 2.000000e-1"), "{said}");
    let (code, said) = served(0.0);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains(" 0 violations"), "{said}");
}
