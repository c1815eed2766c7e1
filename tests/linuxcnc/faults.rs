//! The same circle under faults: each ends in the state that `docs/explanation/safety.md` says.

use std::process::Command;
use std::time::Duration;

use crate::control::{Cnc, Rsh, Wiring};
use crate::daemon::Daemon;
use crate::namespaces::{in_namespaces, load_component, must_hold, run};
use crate::trace::{Row, Trace};

const START: &str = "G0 X100 Y0 Z0";
const CIRCLE: &str = "G2 X100 Y0 I-100 J0 F2000";
/// The same circle where it touches the soft limit at Y 250: there the correction would carry the axis over it.
const CIRCLE_AT_THE_LIMIT: &str = "G2 X0 Y50 I0 J100 F2000";
/// The bridge moves no offset faster: 1 mm/s, so many um per cycle of 1 ms.
const RATE_UM: f64 = 1.0;
/// What the bridge moves in one cycle where it comes late, in cycles that it has missed.
const STEP_UM_MAX: f64 = 6.0 * RATE_UM;
/// Cycles after the drives are on again in which a motor that was let go would jump, and what it may move in them, um: the
/// beginning of the blend.
const START_CYCLES: usize = 50;
const START_UM_MAX: f64 = 1.0;
/// The bridge takes an offset back at 0.1 mm/s.
const RAMP_UM: f64 = 0.1;
const ZERO_MM: f64 = 2e-6;

fn no_step(trace: &Trace, what: &str) {
    let step = trace.largest_step_um();
    println!("{what}: largest step of the offset {step:.3} um");
    must_hold(step <= STEP_UM_MAX, format_args!("{what}: the offset was stepped by {step} um"));
}

fn is_zero(row: &Row) -> bool {
    row.applied.iter().all(|v| v.abs() <= ZERO_MM)
}

fn ready(wiring: Wiring) -> (Cnc, Daemon) {
    let mut cnc = Cnc::start(wiring, |_| {});
    let daemon = Daemon::start(wiring, |text| text);
    daemon.wait_for_state("active");
    cnc.mdi(START);
    (cnc, daemon)
}

fn daemon_killed(wiring: Wiring) {
    let (mut cnc, mut daemon) = ready(wiring);
    cnc.mdi_while(CIRCLE, Duration::from_secs(4), |cnc| {
        cnc.mark(1);
        daemon.kill();
        // a whole second without it is over
        std::thread::sleep(Duration::from_millis(2500));
        cnc.mark(2);
        assert_eq!(cnc.pin("volcomp.compensated").parse(), Ok(0.0));
        daemon.restart();
        daemon.wait_for_state("active");
        cnc.mark(3);
    });
    let trace = cnc.trace();
    let gone = trace.marked(1);
    no_step(&trace, "daemon killed and restarted");
    let ramp: Vec<&Row> = gone.rows.iter().skip_while(|r| !r.ramping_out).collect();
    assert!(!ramp.is_empty(), "the bridge has not taken the offset back");
    let held = gone.rows.len() - ramp.len();
    println!("held for at most {held} cycles, then taken back");
    assert!(held >= 100, "held for {held} cycles only");
    let rate = ramp
        .windows(11)
        .map(|r| (0..3).map(|k| (r[10].applied[k] - r[0].applied[k]).abs()).fold(0.0, f64::max));
    let rate = rate.fold(0.0, f64::max) * 100.0;
    must_hold(rate <= 2.0 * RAMP_UM, format_args!("taken back at {rate} um per cycle"));
    assert!(is_zero(gone.last()), "the offset is not zero: {:?}", gone.last());
    assert!(trace.marked(3).rows.iter().any(|r| !is_zero(r)), "compensates again");
    assert!(daemon.log().contains("VC-1003"), "blended in again");
}

#[test]
#[ignore = "needs LinuxCNC and the right to make namespaces"]
fn daemon_killed_and_restarted_on_external_offsets() {
    in_namespaces("faults::daemon_killed_and_restarted_on_external_offsets", || {
        daemon_killed(Wiring::ExternalOffsets)
    });
}

#[test]
#[ignore = "needs LinuxCNC and the right to make namespaces"]
fn daemon_killed_and_restarted_behind_the_motion_controller() {
    in_namespaces("faults::daemon_killed_and_restarted_behind_the_motion_controller", || {
        daemon_killed(Wiring::Injection)
    });
}

fn emergency_stop(wiring: Wiring) {
    let (mut cnc, mut daemon) = ready(wiring);
    let mut panel = Rsh::connect("received").expect("a second panel");
    cnc.mdi_while(CIRCLE, Duration::from_secs(4), |cnc| {
        cnc.mark(1);
        panel.order("set estop on");
        std::thread::sleep(Duration::from_secs(1));
        cnc.mark(2);
        std::thread::sleep(Duration::from_secs(1));
        cnc.mark(3);
    });
    daemon.wait_for_state("holding");
    cnc.machine_on();
    daemon.wait_for_state("active");
    cnc.mark(4);
    cnc.order("set mode mdi");
    cnc.mdi("G1 X-50 Y20 F2000");
    let trace = cnc.trace();
    let stopped = trace.marked(2);
    assert!(stopped.rows.iter().all(|r| !r.enabled && !r.estop_released), "the emergency stop was told");
    let (first, last) = (stopped.rows[0], stopped.last());
    assert!(!is_zero(&first), "an offset was in force");
    must_hold(first.motor == last.motor, format_args!("nothing moves in an emergency stop"));
    // LinuxCNC may make the offset part of the axis position: the motor stays where it is, and is blended from there
    let on = trace.marked(3);
    let mut largest = 0.0_f64;
    for pair in on.rows.windows(2) {
        for k in 0..3 {
            largest = largest.max((pair[1].motor[k] - pair[0].motor[k]).abs() * 1000.0);
        }
    }
    println!("largest step of a motor from the stop to active again: {largest:.3} um");
    no_step(&on, "emergency stop");
    let start: Vec<Row> = on.rows.iter().skip_while(|r| !r.enabled).take(START_CYCLES).copied().collect();
    assert_eq!(start.len(), START_CYCLES, "the machine was switched on");
    let away = Trace { rows: start }.farthest_um(last);
    println!("a motor goes {away:.3} um in the first {START_CYCLES} cycles");
    must_hold(away <= START_UM_MAX, format_args!("what was held is put back at once: {away} um"));
    must_hold(largest <= STEP_UM_MAX, format_args!("a motor was stepped by {largest} um"));
    assert!(trace.marked(4).rows.iter().any(|r| !is_zero(r)), "compensates again");
    daemon.wait_for_state("active");
    // in order: ramped to zero, then gone
    cnc.mark(5);
    daemon.stop();
    let after = cnc.trace().marked(5);
    no_step(&after, "daemon stopped");
    assert!(
        is_zero(after.last()) && !after.last().ramping_out,
        "taken back by the daemon: {:?}",
        after.last()
    );
    let log = daemon.log();
    assert!(log.contains("VC-2003") || log.contains("VC-2002"), "{log}");
}

#[test]
#[ignore = "needs LinuxCNC and the right to make namespaces"]
fn emergency_stop_in_mid_circle_on_external_offsets() {
    in_namespaces("faults::emergency_stop_in_mid_circle_on_external_offsets", || {
        emergency_stop(Wiring::ExternalOffsets)
    });
}

#[test]
#[ignore = "needs LinuxCNC and the right to make namespaces"]
fn emergency_stop_in_mid_circle_behind_the_motion_controller() {
    in_namespaces("faults::emergency_stop_in_mid_circle_behind_the_motion_controller", || {
        emergency_stop(Wiring::Injection)
    });
}

/// Switched on again with nobody to steer: what LinuxCNC has made part of the position stays there.
fn emergency_stop_without_daemon(wiring: Wiring) {
    let (mut cnc, mut daemon) = ready(wiring);
    cnc.mdi("G1 X-80 Y30 F4000");
    cnc.order("set estop on");
    daemon.wait_for_state("holding");
    cnc.mark(1);
    daemon.kill();
    std::thread::sleep(Duration::from_secs(1));
    cnc.mark(2);
    cnc.machine_on();
    std::thread::sleep(Duration::from_secs(2));
    cnc.mark(3);
    let trace = cnc.trace();
    let stopped = *trace.marked(1).last();
    assert!(!stopped.enabled && !is_zero(&stopped), "stopped with an offset in force: {stopped:?}");
    let on = trace.marked(2);
    assert!(on.last().enabled && is_zero(on.last()), "{:?}", on.last());
    no_step(&on, "emergency stop without a daemon");
    let moved =
        |pair: &[Row]| (0..3).map(|k| (pair[1].motor[k] - pair[0].motor[k]).abs()).fold(0.0, f64::max);
    let fastest = on.rows.windows(11).map(|rows| moved(&[rows[0], rows[10]])).fold(0.0, f64::max) * 100.0;
    println!("fastest motor {fastest:.3} um per cycle");
    must_hold(fastest <= 2.0 * RAMP_UM, format_args!("a motor was moved by {fastest} um per cycle"));
    if wiring == Wiring::ExternalOffsets {
        let away = on.farthest_um(&stopped);
        assert!(away < 0.01, "the offset has become part of the position, yet a motor goes {away} um");
    }
}

#[test]
#[ignore = "needs LinuxCNC and the right to make namespaces"]
fn emergency_stop_without_daemon_on_external_offsets() {
    in_namespaces("faults::emergency_stop_without_daemon_on_external_offsets", || {
        emergency_stop_without_daemon(Wiring::ExternalOffsets)
    });
}

#[test]
#[ignore = "needs LinuxCNC and the right to make namespaces"]
fn emergency_stop_without_daemon_behind_the_motion_controller() {
    in_namespaces("faults::emergency_stop_without_daemon_behind_the_motion_controller", || {
        emergency_stop_without_daemon(Wiring::Injection)
    });
}

fn soft_limit_known_to_the_daemon(wiring: Wiring) {
    let (mut cnc, daemon) = ready(wiring);
    cnc.mdi("G0 X0 Y50");
    cnc.mark(1);
    cnc.mdi(CIRCLE_AT_THE_LIMIT);
    std::thread::sleep(Duration::from_millis(500));
    let trace = cnc.trace().marked(1);
    no_step(&trace, "soft limit");
    let highest = trace.rows.iter().map(|r| r.motor[1]).fold(f64::MIN, f64::max);
    let approach = trace.rows.iter().map(|r| r.applied[1]).fold(f64::MIN, f64::max);
    println!("highest motor position {highest:.6} mm, largest offset on the way {:.3} um", approach * 1000.0);
    must_hold(highest <= 250.0 + 1e-5, format_args!("carried over the soft limit: {highest} mm"));
    assert!(approach > 0.005, "there was an offset to be taken back");
    let farthest = trace.rows.iter().map(|r| r.nominal[1]).fold(f64::MIN, f64::max);
    assert!((farthest - 250.0).abs() < 1e-6, "the axis gets to its limit: {farthest}");
    assert!((trace.last().nominal[1] - 50.0).abs() < 1e-6, "the circle goes on to its end");
    daemon.wait_for_state("active");
    assert!(daemon.log().contains("VC-4006"), "{}", daemon.log());
}

#[test]
#[ignore = "needs LinuxCNC and the right to make namespaces"]
fn soft_limit_known_to_the_daemon_on_external_offsets() {
    in_namespaces("faults::soft_limit_known_to_the_daemon_on_external_offsets", || {
        soft_limit_known_to_the_daemon(Wiring::ExternalOffsets);
    });
}

#[test]
#[ignore = "needs LinuxCNC and the right to make namespaces"]
fn soft_limit_known_to_the_daemon_behind_the_motion_controller() {
    in_namespaces("faults::soft_limit_known_to_the_daemon_behind_the_motion_controller", || {
        soft_limit_known_to_the_daemon(Wiring::Injection);
    });
}

/// LinuxCNC holds the offset back without a word; the read-back shows it.
#[test]
#[ignore = "needs LinuxCNC and the right to make namespaces"]
fn soft_limit_that_only_the_control_knows() {
    in_namespaces("faults::soft_limit_that_only_the_control_knows", || {
        let mut cnc = Cnc::start(Wiring::ExternalOffsets, |_| {});
        let without = |text: String| -> String {
            text.lines().filter(|l| !l.starts_with("soft-limit-mm")).map(|l| format!("{l}\n")).collect()
        };
        let daemon = Daemon::start(Wiring::ExternalOffsets, without);
        daemon.wait_for_state("active");
        cnc.mdi("G0 X0 Y50");
        cnc.mark(1);
        cnc.mdi(CIRCLE_AT_THE_LIMIT);
        daemon.wait_for_state("faulted");
        std::thread::sleep(Duration::from_secs(3));
        let trace = cnc.trace().marked(1);
        no_step(&trace, "soft limit of the control alone");
        let highest = trace.rows.iter().map(|r| r.motor[1]).fold(f64::MIN, f64::max);
        must_hold(highest <= 250.0 + 1e-5, format_args!("LinuxCNC keeps its limit: {highest} mm"));
        assert!(is_zero(trace.last()), "taken back: {:?}", trace.last());
        assert!(daemon.log().contains("VC-4001"), "{}", daemon.log());
    });
}

/// Arguments of the bridge as the HAL file of the wiring gives them.
fn arguments(wiring: Wiring) -> Vec<&'static str> {
    let wiring = if wiring == Wiring::ExternalOffsets { "eoffset" } else { "inject" };
    let machine = ["--machine", "linuxcnc-mill", "--port", "7878", "--cycle-ns", "1000000", "X", "Y", "Z"];
    [&["--wiring", wiring, "--units", "mm"][..], &machine[..]].concat()
}

/// The bridge's own pins, once more connected to the signals that are there.
fn connect_bridge(wiring: Wiring, name: &str) {
    let mut nets: Vec<[String; 2]> = vec![
        ["volcomp-state".into(), format!("{name}.state")],
        ["volcomp-ramping".into(), format!("{name}.ramping-out")],
    ];
    let kind = if wiring == Wiring::ExternalOffsets { "count" } else { "corr" };
    for axis in ["x", "y", "z"] {
        nets.push([format!("volcomp-{kind}-{axis}"), format!("{name}.{kind}-{axis}")]);
    }
    match wiring {
        Wiring::ExternalOffsets => nets.push(["volcomp-enable".into(), format!("{name}.enable")]),
        Wiring::Injection => nets.push(["volcomp-beat".into(), format!("{name}.alive")]),
    }
    for [signal, pin] in &nets {
        run("halcmd", &["net", signal, pin]);
    }
}

fn bridge_restarted(wiring: Wiring) {
    let (mut cnc, daemon) = ready(wiring);
    let bridge = cnc.dir.path().join("volcomp_bridge").display().to_string();
    cnc.mdi_while(CIRCLE, Duration::from_secs(3), |cnc| {
        // a second one of the same name is refused and disturbs nobody
        let second = Command::new(&bridge).args(arguments(wiring)).output().expect("bridge runs");
        assert_eq!(second.status.code(), Some(1), "{}", String::from_utf8_lossy(&second.stderr));
        assert!(String::from_utf8_lossy(&second.stderr).contains("HAL refuses this name"));
        cnc.mark(1);
        run("halcmd", &["unloadusr", "volcomp"]);
        std::thread::sleep(Duration::from_millis(1500));
        cnc.mark(2);
        load_component(&[&["volcomp", &bridge][..], &arguments(wiring)].concat());
        connect_bridge(wiring, "volcomp");
        daemon.wait_for_state("active");
        cnc.mark(3);
    });
    let trace = cnc.trace();
    no_step(&trace, "bridge restarted");
    let gone = trace.marked(1);
    let last = gone.last();
    match wiring {
        Wiring::ExternalOffsets => assert!(!is_zero(last), "without a bridge LinuxCNC keeps the offset"),
        Wiring::Injection => assert!(is_zero(last), "the watchdog in HAL takes it back: {last:?}"),
    }
    assert!(trace.marked(3).rows.iter().any(|r| !is_zero(r)), "compensates again");
    daemon.wait_for_state("active");
}

#[test]
#[ignore = "needs LinuxCNC and the right to make namespaces"]
fn bridge_restarted_on_external_offsets() {
    in_namespaces("faults::bridge_restarted_on_external_offsets", || {
        bridge_restarted(Wiring::ExternalOffsets)
    });
}

#[test]
#[ignore = "needs LinuxCNC and the right to make namespaces"]
fn bridge_restarted_behind_the_motion_controller() {
    in_namespaces("faults::bridge_restarted_behind_the_motion_controller", || {
        bridge_restarted(Wiring::Injection)
    });
}

/// What a killed bridge leaves in HAL keeps its name: another name takes over its signals.
#[test]
#[ignore = "needs LinuxCNC and the right to make namespaces"]
fn bridge_killed() {
    in_namespaces("faults::bridge_killed", || {
        let wiring = Wiring::ExternalOffsets;
        let (cnc, daemon) = ready(wiring);
        let bridge = cnc.dir.path().join("volcomp_bridge").display().to_string();
        cnc.mark(1);
        run("pkill", &["-KILL", "-x", "volcomp_bridge"]);
        std::thread::sleep(Duration::from_millis(500));
        // nobody is left to take it back: standing still, the motors stay where they are
        let alone = cnc.trace().marked(1);
        let away_um = alone.farthest_um(&alone.rows[0]);
        assert!(!is_zero(alone.last()) && away_um < 0.01, "the offset has moved the motors by {away_um} um");
        let again = Command::new(&bridge).args(arguments(wiring)).output().expect("bridge runs");
        assert_eq!(again.status.code(), Some(1), "the name is taken");
        for pin in ["state", "ramping-out", "count-x", "count-y", "count-z", "enable"] {
            run("halcmd", &["unlinkp", &format!("volcomp.{pin}")]);
        }
        load_component(&[&["volcomp2", &bridge, "--name", "volcomp2"][..], &arguments(wiring)].concat());
        connect_bridge(wiring, "volcomp2");
        daemon.wait_for_state("active");
        cnc.mark(2);
        let trace = cnc.trace();
        no_step(&trace, "bridge killed and replaced");
        assert!(!is_zero(trace.last()), "compensates again");
    });
}
