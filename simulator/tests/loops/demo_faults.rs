//! Faults in the middle of the demo: daemon, control and machine fail at any moment, and the offset is left as
//! `docs/explanation/safety.md` says; what comes back goes on from there.
//!
//! The real daemon runs as a process of its own, on the shipped machine with its own model, over TCP on loopback.

#![expect(clippy::disallowed_methods, reason = "a test of processes and sockets")]
#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::io::BufRead;

use crate::support::rules::*;
use crate::support::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::process::Signal;
use simulator::control::{Happening, LinkEnd, LinkEvent, Pacing, ScriptedEvent};
use volcomp::protocol::{CloseReason, CorrectionState, MachineState};

/// When the daemon is killed.
#[derive(Debug, Clone, Copy)]
enum Phase {
    RampingIn,
    Active,
    RampingOut,
}

/// When the next one is started.
#[derive(Debug, Clone, Copy)]
enum Return {
    WhileHeld,
    WhileTakenBack,
    AtZero,
}

fn run_to(bench: &mut Bench, phase: Phase, process: u32) {
    match phase {
        Phase::RampingIn => bench.run_until("a third of the ramp", |r| largest(&r.applied) > 0.005),
        Phase::Active => {
            bench.run_until_state(CorrectionState::Active);
            bench.run_cycles(700);
        }
        Phase::RampingOut => {
            bench.run_until_state(CorrectionState::Active);
            bench.run_cycles(100);
            signal(process, Signal::TERM);
            bench.files.wait_for_log("stopping: the offset is taken to its rest value", 1);
            bench.run_until_state(CorrectionState::RampingOut);
            bench.run_cycles(200);
        }
    }
    let state = bench.last().correction.map(|c| format!("{:?}", c.state));
    assert_eq!(state, Some(format!("{phase:?}")));
    assert!(largest(&bench.last().applied) > 0.004, "{:?}", bench.last().applied);
}

fn killed_and_started_again(phase: Phase) {
    let undisturbed = undisturbed_um(2);
    for comes_back in [Return::WhileHeld, Return::WhileTakenBack, Return::AtZero] {
        let mut bench = Bench::new(Setup::default(), 2);
        let mut daemon = bench.connected_daemon();
        run_to(&mut bench, phase, daemon.id());
        daemon.kill().unwrap();
        let killed = bench.records.len();
        let held = largest(&bench.last().applied);
        match comes_back {
            Return::WhileHeld => bench.run_cycles(HOLD_CYCLES / 2),
            Return::WhileTakenBack => {
                bench.run_until("half of it taken back", |r| largest(&r.applied) < 0.5 * held);
                assert!(ramping_out(bench.last()) && largest(&bench.last().applied) > 0.3 * held);
            }
            Return::AtZero => bench.run_until("all of it taken back", |r| r.applied == [0.0; 8]),
        }
        assert_held_then_taken_back(&bench.records[killed - 1..]);
        let back = bench.records.len();
        let _daemon = bench.connected_daemon();
        bench.run_to_end();
        assert_taken_over(&bench.records[back..]);
        assert_smooth(&bench.records);
        assert_motion(&bench.records, bench.motion.clone());
        assert_accurate(&bench, undisturbed);
    }
}

#[test]
fn killed_while_it_ramps_in() {
    killed_and_started_again(Phase::RampingIn);
}

#[test]
fn killed_in_mid_circle() {
    killed_and_started_again(Phase::Active);
}

#[test]
fn killed_while_it_ramps_out() {
    killed_and_started_again(Phase::RampingOut);
}

#[test]
fn stopped_in_order_it_leaves_zero() {
    let mut bench = Bench::new(Setup::default(), 2);
    let mut daemon = bench.connected_daemon();
    bench.run_until_state(CorrectionState::Active);
    bench.run_cycles(300);
    signal(daemon.id(), Signal::TERM);
    bench.files.wait_for_log("stopping: the offset is taken to its rest value", 1);
    bench.run_until("the link closed", |r| !r.connected);
    let closed = bench.records.len() - 1;
    assert_eq!(bench.last().applied, [0.0; 8]);
    assert_eq!(daemon.wait().unwrap().code(), Some(0), "{}", bench.files.log());
    assert!(bench.events.borrow().contains(&LinkEvent::Closed { reason: CloseReason::Shutdown }));
    bench.run_to_end();
    assert!(bench.records[closed..].iter().all(|r| r.applied == [0.0; 8]));
    assert!(!bench.records.iter().any(ramping_out), "the control had nothing to take back");
    assert_smooth(&bench.records);
    assert_motion(&bench.records, bench.motion.clone());
}

#[test]
fn stopped_in_order_it_keeps_the_offset_where_that_is_configured() {
    let setup = Setup { edit: |file| set(file, "engine", "rest", "hold"), ..Setup::default() };
    let mut bench = Bench::new(setup, 2);
    let mut daemon = bench.connected_daemon();
    bench.run_until_state(CorrectionState::Active);
    bench.run_cycles(300);
    signal(daemon.id(), Signal::TERM);
    bench.run_until("the link closed", |r| !r.connected);
    assert_eq!(daemon.wait().unwrap().code(), Some(0), "{}", bench.files.log());
    let closed = bench.records.len() - 1;
    assert!(largest(&bench.last().applied) > 0.004);
    bench.run_cycles(1000);
    assert_frozen(&bench.records[closed..]);
    let back = bench.records.len();
    let _daemon = bench.connected_daemon();
    bench.run_to_end();
    assert_taken_over(&bench.records[back..]);
    assert_smooth(&bench.records);
    assert_motion(&bench.records, bench.motion.clone());
    assert!(!bench.records.iter().any(ramping_out));
}

#[test]
fn hung_for_a_while_it_goes_on() {
    let _alone = crate::processors();
    // 0.3 s: the control takes the offset back; 3 s: it gives the link up, too. So slow that a late answer is no step
    let mut bench = Bench::new(Setup { pacing: Pacing::RealTime, feed: FEED / 4, ..Setup::default() }, 2);
    let daemon = bench.connected_daemon();
    bench.run_until_state(CorrectionState::Active);
    for cycles in [300, 3000] {
        bench.run_cycles(100);
        assert!(largest(&bench.last().applied) > 0.004);
        signal(daemon.id(), Signal::STOP);
        bench.run_cycles(cycles);
        let r = bench.last();
        assert!(ramping_out(r) || r.applied == [0.0; 8], "{r:?}");
        signal(daemon.id(), Signal::CONT);
        // an answer that was stopped on its way out comes first; then it is blended in again
        bench.run_until_state(CorrectionState::RampingIn);
        bench.run_until_state(CorrectionState::Active);
    }
    let lost = LinkEvent::Ended(LinkEnd::Silence);
    assert!(bench.events.borrow().contains(&lost), "{:?}", bench.events.borrow());
    bench.run_cycles(1200);
    assert_smooth_in_real_time(&bench.records);
    assert_motion(&bench.records, bench.motion.clone());
    let [without, _] = undisturbed_um(2);
    assert!(radial_um(&bench) < 0.2 * without, "{} um, without {without} um", radial_um(&bench));
}

/// The pauses that a log names, s.
fn pauses(log: &str) -> Vec<f64> {
    log.lines()
        .filter(|l| l.contains("no link: "))
        .filter_map(|l| l.split("retry_s=").nth(1)?.split_whitespace().next()?.parse().ok())
        .collect()
}

/// `bench`: a new control without offset, to which the old daemon has come back.
fn assert_starts_from_zero(mut bench: Bench, undisturbed: [f64; 2]) {
    bench.run_to_end();
    assert_eq!(bench.records[0].applied, [0.0; 8]);
    assert_taken_over(&bench.records);
    assert_accurate(&bench, undisturbed);
    let log = bench.files.log();
    assert_eq!(log.matches("volcompd starts").count(), 1, "the same daemon");
    let pauses = pauses(&log);
    assert!(pauses.len() >= 2 && pauses[1] == 2.0 * pauses[0], "{pauses:?} s in:\n{log}");
}

#[test]
fn control_restarted_in_mid_circle() {
    let mut bench = Bench::new(Setup::default(), 2);
    let mut daemon = bench.connected_daemon();
    bench.run_until_state(CorrectionState::Active);
    bench.run_cycles(1000);
    let planned = bench.motion.clone();
    assert_motion(&bench.records, planned);
    let bench = bench.with_new_control(|files, _| files.wait_for_log("no link: ", 2));
    assert!(daemon.is_running());
    assert!(bench.files.log().contains("link down: the control closed the link: Shutdown"));
    assert_starts_from_zero(bench, undisturbed_um(2));
}

#[test]
fn control_killed_in_mid_circle() {
    // the control is a process here, in real time, that runs one circle after another
    let mut daemon = None;
    let bench = Bench::new(Setup::default(), 2).with_new_control(|files, port| {
        let program = files.path().join("circles.nc");
        std::fs::write(&program, circles(3, FEED)).unwrap();
        let mut control = std::process::Command::new(CNCSIM)
            .args(["serve", "--settle-s", "0", "--loop", "--listen", &format!("127.0.0.1:{port}")])
            .arg("--program")
            .arg(&program)
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        // it listens once it says so
        let mut said = std::io::BufReader::new(control.stderr.take().unwrap());
        said.read_line(&mut String::new()).unwrap();
        daemon = Some(files.daemon());
        files.wait_for_log("to=\"active\"", 1);
        control.kill().unwrap();
        control.wait().unwrap();
        files.wait_for_log("no link: ", 2);
    });
    assert!(daemon.as_mut().unwrap().is_running());
    assert!(bench.files.log().contains("link down: "), "{}", bench.files.log());
    assert_starts_from_zero(bench, undisturbed_um(2));
}

fn script(events: &[(u64, Happening)]) -> Setup {
    let script = events.iter().map(|&(cycle, what)| ScriptedEvent { cycle, what }).collect();
    Setup { script, ..Setup::default() }
}

#[test]
fn emergency_stop_freezes_the_offset_in_the_ramp_and_in_mid_circle() {
    let undisturbed = undisturbed_um(2);
    let off = Happening::Clear(MachineState::ENABLED);
    let on = Happening::Set(MachineState::ENABLED);
    for (stop, release) in [(Happening::ESTOP, Happening::ESTOP_RELEASED), (off, on)] {
        let mut bench = Bench::new(script(&[(250, stop), (450, release), (2500, stop), (2900, release)]), 2);
        let _daemon = bench.connected_daemon();
        bench.run_to_end();
        let state = |cycle: usize| bench.records[cycle].correction.map(|c| c.state);
        assert_eq!(state(249), Some(CorrectionState::RampingIn));
        assert_eq!(state(2499), Some(CorrectionState::Active));
        for (from, to) in [(250, 450), (2500, 2900)] {
            assert!(largest(&bench.records[from].applied) > 0.002);
            assert_frozen(&bench.records[from - 1..to]);
            assert_eq!(state(to - 1), Some(CorrectionState::Holding));
            assert_eq!(state(to + 100), Some(CorrectionState::RampingIn));
            assert_eq!(state(to + 700), Some(CorrectionState::Active));
        }
        assert!(!bench.records.iter().any(ramping_out));
        assert_smooth(&bench.records);
        assert_motion(&bench.records, bench.motion.clone());
        assert_accurate(&bench, undisturbed);
    }
}

#[test]
fn a_daemon_that_dies_or_starts_during_an_emergency_stop_moves_nothing() {
    let undisturbed = undisturbed_um(2);
    for comes_back in [Return::WhileHeld, Return::AtZero] {
        let mut bench = Bench::new(script(&[(1500, Happening::ESTOP), (2100, Happening::ESTOP_RELEASED)]), 2);
        let mut daemon = bench.connected_daemon();
        bench.run_cycles(1600);
        daemon.kill().unwrap();
        match comes_back {
            Return::WhileHeld => bench.run_cycles(300),
            _ => bench.run_until("all of it taken back", |r| r.applied == [0.0; 8]),
        }
        let back = bench.records.len();
        let _daemon = bench.connected_daemon();
        bench.run_to_end();
        assert!(largest(&bench.records[1500].applied) > 0.004);
        assert_frozen(&bench.records[1499..2100]);
        let first = &bench.records[back];
        assert_same(
            &first.correction.unwrap().offset,
            &first.applied,
            "the first offset sent is the one held",
        );
        assert_smooth(&bench.records);
        assert_motion(&bench.records, bench.motion.clone());
        assert_accurate(&bench, undisturbed);
    }
}

#[test]
fn a_machine_that_is_not_ready_is_waited_for() {
    for missing in [MachineState::HOMED, MachineState::ENABLED] {
        let mut bench = Bench::new(Setup::default(), 2);
        bench.control().happen(Happening::Clear(missing));
        let _daemon = bench.connected_daemon();
        bench.stand(1000);
        for r in &bench.records {
            assert_eq!(r.applied, [0.0; 8]);
            assert_eq!(r.correction.map(|c| (c.state, c.offset)), Some((CorrectionState::Armed, [0.0; 8])));
        }
        let ready = bench.records.len();
        bench.control().happen(Happening::Set(missing));
        bench.run_to_end();
        assert_taken_over(&bench.records[ready..]);
    }
}

/// The motion with a daemon that does not fit is, to the last bit, the motion without any.
fn assert_untouched(bench: &mut Bench, alone: Setup) {
    let mut reference = Bench::new(alone, 1);
    reference.run_to_end();
    bench.run_to_end();
    assert_eq!(bench.records.len(), reference.records.len());
    for (a, b) in bench.records.iter().zip(&reference.records) {
        assert_eq!(a.applied, [0.0; 8]);
        assert_eq!((a.commanded, a.sample), (b.commanded, b.sample), "cycle {}", a.cycle);
    }
}

/// A daemon that connects in vain says why in one line of its log, with both values.
fn refused(setup: fn() -> Setup, model_of: Option<&str>, words: &[&str]) {
    let mut bench = Bench::new(setup(), 1);
    if let Some(machine) = model_of {
        bench.files.write_model_of(machine);
    }
    let mut daemon = bench.files.daemon();
    bench.files.wait_for_log("no link: ", 1);
    let log = bench.files.log();
    let line = log.lines().find(|l| l.contains("no link: ")).unwrap();
    for word in words {
        assert!(line.contains(word), "no `{word}` in: {line}");
    }
    assert_untouched(&mut bench, setup());
    assert!(daemon.is_running(), "it tries again: somebody may put it right at the control");
}

#[test]
fn a_daemon_of_another_machine_is_refused() {
    let lathe =
        || Setup { edit: |file| drop(file.insert("machine".into(), "lathe-2".into())), ..Setup::default() };
    refused(lathe, Some("lathe-2"), &["WrongMachine", "vmc-850", "lathe-2"]);
}

#[test]
fn a_control_with_another_cycle_is_refused() {
    let slow = || Setup { cycle_s: 0.002, ..Setup::default() };
    refused(slow, None, &["cycle is 2 ms", "cycle-ms = 1"]);
}

#[test]
fn a_control_without_an_axis_is_refused() {
    let flat = || Setup { axes: Some(2), ..Setup::default() };
    refused(flat, None, &["no axis Z", "it has X Y"]);
}

#[test]
fn a_model_of_another_machine_is_refused() {
    let mut bench = Bench::new(Setup::default(), 1);
    bench.files.write_model_of("lathe-2");
    let mut daemon = bench.files.daemon();
    assert_eq!(daemon.wait().unwrap().code(), Some(78));
    let log = bench.files.log();
    for word in ["machine.toml", "\"lathe-2\"", "\"vmc-850\""] {
        assert!(log.contains(word), "no `{word}` in:\n{log}");
    }
    assert_untouched(&mut bench, Setup::default());
    assert!(bench.events.borrow().is_empty(), "it never connected");
}

#[test]
fn killed_twenty_times_it_ends_active_and_accurate() {
    let mut random = ChaCha8Rng::seed_from_u64(20);
    let mut bench = Bench::new(Setup::default(), 8);
    for round in 0..20 {
        let mut daemon = bench.connected_daemon();
        let back = bench.records.len();
        bench.run_cycles(random.random_range(1..900));
        let first = &bench.records[back];
        let sent = first.correction.unwrap().offset;
        assert_same(&sent, &first.applied, "the first offset sent is the one held");
        if round % 2 == 0 {
            daemon.kill().unwrap();
        } else {
            // in the middle of some later cycle, while the control goes on
            signal(daemon.id(), Signal::KILL);
            bench.run_until("the link lost", |r| !r.connected);
            daemon.wait().unwrap();
        }
        bench.run_cycles(random.random_range(1..450));
    }
    let _daemon = bench.connected_daemon();
    bench.run_to_end();
    assert_smooth(&bench.records);
    assert_motion(&bench.records, bench.motion.clone());
    assert_accurate(&bench, undisturbed_um(8));
    assert_eq!(bench.files.log().matches("volcompd starts").count(), 21);
}
