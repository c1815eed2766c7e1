//! `volcompd` against a control that is broken or hostile: wrong read-backs, backlogs, values that are not allowed.

#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test program: it fails by panicking")]

use std::io::Write;

use crate::support::{Daemon, Port, Session, Setup, eventually};
use volcomp::model::axes::MAX_AXES;
use volcomp::protocol::{CloseReason, Correction, ErrorCode, MAX_FRAME, MachineState, Message, Tool, encode};

/// Limit of every axis of the machine file of these tests, mm.
const LIMIT_MM: f64 = 0.15;
/// The largest step from one answer to the next: two cycles of 1 ms at 2 mm/s.
const STEP_MM: f64 = 0.004;

fn linked() -> (Port, Daemon, Session) {
    let port = Port::open();
    // after a silence the engine would follow the read-back, and what is wrong with it would have another number
    let setup = Setup { stale_ms: 10_000.0, silence_s: 30.0, ..Setup::default() };
    let daemon = Daemon::start(&port.address(), setup);
    let session = port.link();
    (port, daemon, session)
}

/// What is reported instead of the offset sent, mm.
type Lie = fn(f64) -> f64;

/// Sends positions that report `lie` of what was sent, until the daemon ends the link; every answer is held against the
/// limits. Gives the reason of the Close.
fn deceive(session: &mut Session, lie: impl Fn(f64) -> f64) -> CloseReason {
    let mut last: Option<Correction> = None;
    let mut held = session.applied;
    for _ in 0..200 {
        let mut position = session.position();
        position.applied = held.map(&lie);
        session.send(&Message::Position(position));
        match session.next_word() {
            Some(Message::Correction(correction)) => {
                for k in 0..MAX_AXES {
                    let offset = correction.offset[k];
                    assert!(offset.abs() <= LIMIT_MM, "{offset} mm in {correction:?}");
                    let step = last.map_or(0.0, |last| (offset - last.offset[k]).abs());
                    assert!(step <= STEP_MM * 1.000_001, "a step of {step} mm");
                }
                held = correction.offset;
                last = Some(correction);
            }
            Some(Message::Close(close)) => return close.reason,
            other => panic!("unexpected {other:?}"),
        }
    }
    panic!("the daemon goes on with a control that does not hold what it is sent");
}

#[test]
fn a_wrong_read_back_ends_the_link_without_a_step_and_stays_latched() {
    let lies: [(&str, Lie); 4] =
        [("um for mm", |v| v * 1e3), ("sign", |v| -v), ("zero", |_| 0.0), ("5 mm", |_| 5.0)];
    for (name, lie) in lies {
        let (port, daemon, mut session) = linked();
        session.run_until_corrected();
        assert_eq!(deceive(&mut session, lie), CloseReason::Error, "{name}");
        daemon.wait_for_log("VC-4001");
        // on the next link nothing is sent while the fault is latched
        let mut session = port.link();
        session.applied = [0.0; MAX_AXES];
        session.run_unanswered(200);
        // disconnected until the daemon has read the hello
        let mut status = daemon.status();
        let faulted = eventually(|| {
            status = daemon.status();
            status["state"] == "faulted"
        });
        assert!(faulted, "{name}: {status}");
        // what answered the frames of before would be here by now
        session.run_unanswered(200);
        assert_eq!(daemon.status()["state"], "faulted", "{name}");
    }
}

#[test]
fn an_offset_far_beyond_the_limit_on_a_new_link_is_a_fault_of_its_own() {
    for found in [5.0, -0.31, 1e308] {
        let (port, daemon, mut session) = linked();
        session.applied[1] = found;
        let position = session.position();
        session.send(&Message::Position(position));
        daemon.wait_for_log("VC-4007");
        // nothing was sent on this link, so it goes on in silence; once the control has nothing left a person may clear
        session.applied[1] = 0.0;
        let position = session.position();
        session.send(&Message::Position(position));
        let cleared = daemon.volcomp(&["enable", "--clear-fault"]);
        assert!(cleared.status.success(), "{cleared:?}");
        session.run_until_corrected();
        drop(port);
    }
}

#[test]
fn a_fault_that_has_ended_the_link_is_not_cleared_before_the_control_reports_zero() {
    let (port, daemon, mut session) = linked();
    session.run_until_corrected();
    session.deceive(0.03);
    daemon.wait_for_log("VC-4001");
    let held = session.applied;
    drop(session);
    // between the links, and on the next one while the control still holds its offset
    let refused = || {
        let answer = daemon.volcomp(&["enable", "--clear-fault"]);
        let said = String::from_utf8_lossy(&answer.stderr).into_owned();
        assert!(!answer.status.success() && said.contains("at zero offset only, with the link up"), "{said}");
        assert_eq!(daemon.status()["faults"][0]["code"], "VC-4001");
    };
    refused();
    let mut session = port.link();
    session.applied = held;
    session.run_unanswered(20);
    refused();
    session.applied.fill(0.0);
    session.run_unanswered(20);
    assert!(daemon.volcomp(&["enable", "--clear-fault"]).status.success());
    session.run_until_corrected();
}

#[test]
fn a_backlog_larger_than_one_turn_is_worked_off_on_the_same_link() {
    let (_port, daemon, mut session) = linked();
    session.run_until_corrected();
    // 700 positions, then optional frames of unknown type: each more than 64 buffers of 2048 bytes
    let mut backlog = Vec::new();
    let mut buffer = [0; MAX_FRAME];
    let mut last = 0;
    for _ in 0..700 {
        let position = session.position();
        last = position.sequence;
        let length = encode(&Message::Position(position), &mut buffer);
        backlog.extend_from_slice(&buffer[..length]);
    }
    let mut optional = [0_u8; MAX_FRAME];
    optional[..4].copy_from_slice(b"VCMP");
    optional[4] = 1;
    optional[5] = 0x90;
    optional[6..8].copy_from_slice(&512_u16.to_le_bytes());
    let sum = crc32c::crc32c(&optional[..MAX_FRAME - 4]);
    optional[MAX_FRAME - 4..].copy_from_slice(&sum.to_le_bytes());
    for _ in 0..400 {
        backlog.extend_from_slice(&optional);
    }
    session.stream.write_all(&backlog).expect("sent");
    loop {
        match session.next_word() {
            Some(Message::Correction(correction)) if correction.sequence == last => break,
            Some(Message::Correction(_)) => {}
            other => panic!("the link ended: {other:?}\n{}", daemon.log()),
        }
    }
    assert!(!daemon.log().contains("link down"), "{}", daemon.log());
}

#[test]
fn frames_that_show_the_machine_not_ready_are_answered_within_the_step() {
    let (_port, _daemon, mut session) = linked();
    session.run_until_corrected();
    let mut burst = Vec::new();
    let mut buffer = [0; MAX_FRAME];
    for k in 0..40 {
        let mut position = session.position();
        if k % 2 == 0 {
            position.state.bits |= MachineState::ESTOP;
            // what the control says it holds meanwhile
            position.applied[0] = if k % 4 == 0 { 0.04 } else { -0.04 };
        }
        let length = encode(&Message::Position(position), &mut buffer);
        burst.extend_from_slice(&buffer[..length]);
    }
    session.stream.write_all(&burst).expect("sent");
    let mut last = session.applied;
    loop {
        match session.next_word() {
            Some(Message::Correction(correction)) => {
                let step = (correction.offset[0] - last[0]).abs();
                assert!(step <= STEP_MM * 1.000_001, "a step of {step} mm");
                last = correction.offset;
                if correction.sequence == session.sequence {
                    break;
                }
            }
            // or the daemon prefers a new link
            Some(Message::Close(_)) => break,
            other => panic!("unexpected {other:?}"),
        }
    }
}

#[test]
fn a_tool_that_is_not_finite_is_refused_with_error_and_log() {
    for value in [f64::NAN, f64::INFINITY] {
        let (port, daemon, mut session) = linked();
        session.run_until_corrected();
        session.send(&Message::Tool(Tool { number: 3, tip: [0.0, value, -120.0] }));
        let mut said = None;
        while let Some(word) = session.next_word() {
            if let Message::Error(report) = word {
                said = Some(report.code);
            }
        }
        assert_eq!(said, Some(ErrorCode::BadFrame));
        daemon.wait_for_log("tool tip not finite");
        drop(port.link());
    }
}
