//! A control that is read and written by calls (`docs/reference/read-write.md`): the same offsets as over frames, its delay looked ahead
//! over, and the offset out of the machine whatever happens to either side.

#![allow(clippy::print_stdout, reason = "the figures are what a long run is for")]

use rustix::process::Signal;
use simulator::control::{CycleRecord, Interface, LinkEvent, Pacing};
use volcomp::protocol::CloseReason;

use crate::support::{Bench, Setup, largest, ramping_out, set, signal};

/// Feed of the circles of these tests, mm/min.
const FEED: u32 = 6000;

/// As fast as the calls go: simulated time waits for them.
fn calls(file: &mut toml::Table) {
    set(file, "link", "interface", "read-write");
    set(file, "link", "poll-ms", 0.0);
}

/// The same, with offsets for the place where the axes were.
fn calls_without_look_ahead(file: &mut toml::Table) {
    calls(file);
    set(file, "engine", "lag-cycles", 0.0);
}

fn circle(setup: Setup) -> Bench {
    let mut bench = Bench::new(Setup { feed: FEED, ..setup }, 2);
    let _daemon = bench.connected_daemon();
    bench.run_to_end();
    bench
}

/// Largest difference of the offsets in force from those of the same cycle of `ideal`, second half, um.
fn apart_um(records: &[CycleRecord], ideal: &[CycleRecord]) -> f64 {
    let half = records.len() / 2;
    let apart = |a: &CycleRecord, b: &CycleRecord| {
        (0..3).map(|k| (a.applied[k] - b.applied[k]).powi(2)).sum::<f64>().sqrt() * 1e3
    };
    records
        .iter()
        .zip(ideal)
        .skip(half)
        .filter(|(r, _)| r.scored)
        .map(|(a, b)| apart(a, b))
        .fold(0.0, f64::max)
}

#[test]
fn offsets_are_those_of_frames() {
    let frames = circle(Setup::default());
    let called = circle(Setup { interface: Interface::CALLS, edit: calls, ..Setup::default() });
    assert_eq!(frames.records.len(), called.records.len());
    assert!(largest(&frames.records[frames.records.len() / 2].applied) > 0.005);
    for (n, (a, b)) in frames.records.iter().zip(&called.records).enumerate() {
        assert_eq!(a.applied, b.applied, "cycle {n}");
    }
}

#[test]
fn a_delay_of_the_calls_is_looked_ahead_over() {
    let setup = || Setup { interface: Interface::CALLS, edit: calls, ..Setup::default() };
    let at_once = circle(setup());
    let delayed = circle(Setup { delay_cycles: 8, ..setup() });
    let without = circle(Setup { delay_cycles: 8, edit: calls_without_look_ahead, ..setup() });
    let [ahead, behind] = [&delayed, &without].map(|b| apart_um(&b.records, &at_once.records));
    println!("8 ms at {FEED} mm/min: {behind:.3} um without, {ahead:.3} um with look-ahead");
    assert!(behind > 0.1, "{behind} um: the delay must show");
    assert!(ahead < 0.15 * behind, "{ahead} um of {behind} um");
}

#[test]
fn a_control_without_a_watchdog_is_refused() {
    let bench =
        Bench::new(Setup { interface: Interface::Calls { hold_ms: 0 }, edit: calls, ..Setup::default() }, 1);
    let _daemon = bench.files.daemon();
    bench
        .files
        .wait_for_log("holds an offset for 0 ms without a write, must be 1 to 1000: set its watchdog", 1);
}

#[test]
fn a_daemon_that_is_killed_leaves_no_offset() {
    let setup = Setup { interface: Interface::CALLS, edit: calls, ..Setup::default() };
    let mut bench = Bench::new(setup, 2);
    let mut daemon = bench.connected_daemon();
    bench.run_until("an offset", |r| largest(&r.applied) > 0.01);
    daemon.kill().unwrap();
    bench.run_until("the control takes it out", ramping_out);
    bench.run_until("no offset", |r| largest(&r.applied) == 0.0);
}

#[test]
fn a_daemon_that_stops_takes_its_offset_out_and_says_so() {
    let setup = Setup { interface: Interface::CALLS, edit: calls, ..Setup::default() };
    let mut bench = Bench::new(setup, 2);
    let daemon = bench.connected_daemon();
    bench.run_until("an offset", |r| largest(&r.applied) > 0.01);
    signal(daemon.id(), Signal::TERM);
    bench.run_until("the daemon has left", |r| !r.connected);
    assert_eq!(largest(&bench.last().applied), 0.0);
    let shutdown = LinkEvent::Closed { reason: CloseReason::Shutdown };
    assert!(bench.events.borrow().contains(&shutdown), "{:?}", bench.events.borrow());
}

#[test]
fn in_real_time_a_control_that_is_read_now_and_then_is_corrected() {
    let _alone = crate::processors();
    let every_5_ms = |file: &mut toml::Table| {
        set(file, "link", "interface", "read-write");
        set(file, "link", "poll-ms", 5.0);
        set(file, "engine", "stale-ms", 1000.0);
    };
    let mut bench = Bench::new(
        Setup { interface: Interface::CALLS, edit: every_5_ms, pacing: Pacing::RealTime, ..Setup::default() },
        1,
    );
    let _daemon = bench.connected_daemon();
    bench.run_until("an offset", |r| largest(&r.applied) > 0.01);
    let first = bench.records.len();
    bench.run_cycles(1000);
    let moved = bench.records[first..].windows(2).filter(|w| w[0].applied != w[1].applied).count();
    println!("{moved} of 1000 cycles with a new offset");
    assert!(moved > 50, "{moved}: offsets must go on changing");
    assert!(!bench.records[first..].iter().any(ramping_out), "{}", bench.files.log());
}
