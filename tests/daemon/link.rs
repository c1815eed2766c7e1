//! `volcompd` against a small control over TCP: connecting, cycling, losing the link, and stopping.

#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test program: it fails by panicking")]

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::support::{Daemon, EXX_MM, PATIENCE, Port, Session, Setup, eventually, hello};
use rustix::process::Signal;
use volcomp::model::axes::{AxisName, MAX_AXES};
use volcomp::protocol::{
    CloseReason, ControlHello, CorrectionState, ErrorCode, MAX_FRAME, MachineState, Message, Name, encode,
};

fn linked() -> (Port, Daemon, Session) {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), Setup::default());
    let session = port.link();
    (port, daemon, session)
}

#[test]
fn answers_every_position_and_ramps_to_the_correction_without_a_step() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), Setup::default());
    let mut session = port.accept();
    assert_eq!(session.read_hello().machine, Name::new("test-mill"));
    session.send(&Message::ControlHello(hello()));
    let first = session.cycle();
    assert_eq!(first.offset, [0.0; MAX_AXES]);
    session.run_until_corrected();
    let mut last = session.cycle();
    for _ in 0..300 {
        last = session.cycle();
    }
    assert_eq!(last.state, CorrectionState::Active);
    assert!((last.offset[0] + EXX_MM).abs() < 1e-12, "answers +10 um by -10 um: {last:?}");
    assert_eq!(last.offset[1..], [0.0; MAX_AXES - 1]);
    daemon.wait_for_log("link up");
}

#[test]
fn busy_polling_answers_and_sleeps_alike() {
    let port = Port::open();
    let realtime = "priority = 0\nlock-memory = false\nbusy-poll-us = 2000.0\n";
    let daemon = Daemon::start(&port.address(), Setup { realtime, ..Setup::default() });
    let mut session = port.link();
    session.run_until_corrected();
    // longer than it polls: it sleeps in between, and polls again afterwards
    for _ in 0..5 {
        std::thread::sleep(Duration::from_millis(10));
        let _ = session.cycle();
    }
    assert_eq!(daemon.status()["skipped_cycles"], 0);
}

#[test]
fn what_real_time_is_refused_is_said_once_and_not_needed() {
    let port = Port::open();
    // processor 1000 does not exist here; priority and lock are granted or not, as this system permits
    let realtime = "priority = 5\ncpu = 1000\nlock-memory = true\n";
    let daemon = Daemon::start(&port.address(), Setup { realtime, ..Setup::default() });
    let mut session = port.link();
    session.run_until_corrected();
    daemon.wait_for_log("real-time settings not fully granted");
    let status = daemon.status();
    assert!(status["realtime"]["affinity"].as_str().is_some_and(|t| t.starts_with("refused: ")), "{status}");
    assert_eq!(daemon.log().matches("real-time settings").count(), 1);
}

#[test]
fn what_real_time_is_granted_is_in_force() {
    let port = Port::open();
    let realtime = "priority = 7\ncpu = 0\nlock-memory = true\n";
    let daemon = Daemon::start(&port.address(), Setup { realtime, ..Setup::default() });
    let mut session = port.link();
    session.run_until_corrected();
    let status = daemon.status();
    let process = PathBuf::from(format!("/proc/{}", daemon.child.id()));
    let thread = fs::read_dir(process.join("task"))
        .expect("threads")
        .map(|entry| entry.expect("thread").path())
        .find(|path| fs::read_to_string(path.join("comm")).is_ok_and(|name| name == "volcomp-cycle\n"))
        .expect("the cycle thread has a name");
    let told = |path: &Path, key: &str| -> String {
        let text = fs::read_to_string(path.join("status")).expect("status");
        let line = text.lines().find_map(|line| line.strip_prefix(key)).expect("key");
        line.trim().to_owned()
    };
    // each is granted or refused, as this system permits; what is said to be granted must be so
    let granted = |key: &str| status["realtime"][key] == "yes";
    let stat = fs::read_to_string(thread.join("stat")).expect("stat");
    // behind the name in brackets: state is field 3, the priority 40, the policy 41
    let fields: Vec<&str> = stat.rsplit(')').next().expect("fields").split_whitespace().collect();
    let scheduling = (fields[40 - 3], fields[41 - 3]);
    assert_eq!(scheduling, if granted("fifo") { ("7", "1") } else { ("0", "0") }, "{status}");
    if granted("affinity") {
        assert_eq!(told(&thread, "Cpus_allowed_list:"), "0");
    }
    assert_eq!(told(&process, "VmLck:") != "0 kB", granted("memory_lock"), "{status}");
    let asked =
        ["fifo", "affinity", "memory_lock"].map(|key| status["realtime"][key].as_str().expect("text"));
    assert!(asked.iter().all(|t| *t == "yes" || t.starts_with("refused: ")), "{status}");
}

#[test]
fn reconnects_after_the_control_has_died_and_starts_from_its_offset() {
    let (port, daemon, mut session) = linked();
    session.run_until_corrected();
    let applied = session.applied;
    drop(session);
    let mut session = port.link();
    // this control has kept the offset
    session.applied = applied;
    let first = session.cycle();
    assert!((first.offset[0] - applied[0]).abs() < 1e-9, "{} after {}", first.offset[0], applied[0]);
    session.run_until_corrected();
    assert!(daemon.log().contains("link down"), "{}", daemon.log());
}

#[test]
fn an_orderly_close_of_the_control_is_followed_by_a_new_connection() {
    let (port, daemon, mut session) = linked();
    let _ = session.cycle();
    session.close();
    let mut session = port.link();
    let _ = session.cycle();
    daemon.wait_for_log("the control closed the link");
}

/// The daemon refuses a hello: says why on the link and in the log, and tries again only after its longest pause.
fn refused(hello: &ControlHello, code: ErrorCode, words: &str) {
    let port = Port::open();
    let mut daemon = Daemon::start(&port.address(), Setup { reconnect_max_s: 30.0, ..Setup::default() });
    let mut session = port.accept();
    session.handshake(hello);
    match session.next_word() {
        Some(Message::Error(report)) => assert_eq!(report.code, code),
        other => panic!("expected an error frame, found {other:?}"),
    }
    daemon.wait_for_log(words);
    drop(session);
    assert!(port.accept_within(Duration::from_millis(400)).is_none(), "tried again at once");
    assert_eq!(daemon.status()["state"], "disconnected");
    daemon.signal(Signal::TERM);
    assert!(daemon.wait().success(), "stops in order without a link");
}

#[test]
fn a_control_of_another_version_is_refused() {
    let session_hello = ControlHello { version: 9, ..hello() };
    refused(&session_hello, ErrorCode::Version, "version 9");
}

#[test]
fn another_machine_is_refused() {
    let other = ControlHello { machine: Name::new("lathe"), ..hello() };
    refused(
        &other,
        ErrorCode::WrongMachine,
        "the control is machine \"lathe\", the machine file is for \"test-mill\"",
    );
}

#[test]
fn a_missing_axis_is_refused() {
    let mut other = hello();
    other.axes[2].name = AxisName::W;
    refused(&other, ErrorCode::WrongAxes, "the control has no axis Z");
}

#[test]
fn another_cycle_time_is_refused() {
    let other = ControlHello { cycle_ns: 2_000_000, ..hello() };
    refused(&other, ErrorCode::WrongCycle, "the control's cycle is 2 ms");
}

#[test]
fn bytes_that_are_no_frame_end_the_link_and_nothing_else() {
    let (port, daemon, mut session) = linked();
    session.run_until_corrected();
    session.stream.write_all(b"GET / HTTP/1.1\r\nHost: volcomp\r\n\r\n").expect("sent");
    let mut told = false;
    while let Some(word) = session.next_word() {
        told |= matches!(word, Message::Error(report) if report.code == ErrorCode::BadFrame);
    }
    assert!(told, "the control is told why");
    daemon.wait_for_log("not a frame");
    // the same before the hello
    let mut session = port.accept();
    session.stream.write_all(&[0xff; 300]).expect("sent");
    let _ = session.read_hello();
    drop(session);
    let mut session = port.link();
    let _ = session.cycle();
}

#[test]
fn a_position_in_one_piece_with_the_hello_is_answered() {
    let port = Port::open();
    let _daemon = Daemon::start(&port.address(), Setup::default());
    let mut session = port.accept();
    let _ = session.read_hello();
    let position = session.position();
    let mut bytes = Vec::new();
    for message in [Message::ControlHello(hello()), Message::Position(position)] {
        let mut buffer = [0; MAX_FRAME];
        let length = encode(&message, &mut buffer);
        bytes.extend_from_slice(&buffer[..length]);
    }
    session.stream.write_all(&bytes).expect("sent");
    assert!(matches!(session.next_word(), Some(Message::Correction(c)) if c.sequence == position.sequence));
}

#[test]
fn a_frame_in_single_bytes_is_a_frame() {
    let (_port, _daemon, mut session) = linked();
    let position = session.position();
    let mut buffer = [0; MAX_FRAME];
    let length = encode(&Message::Position(position), &mut buffer);
    for byte in &buffer[..length] {
        session.stream.write_all(&[*byte]).expect("sent");
    }
    match session.next_word() {
        Some(Message::Correction(correction)) => assert_eq!(correction.sequence, position.sequence),
        other => panic!("expected a correction, found {other:?}"),
    }
}

#[test]
fn of_frames_that_come_together_the_newest_is_answered() {
    let (_port, daemon, mut session) = linked();
    session.run_until_corrected();
    let mut bytes = Vec::new();
    let mut newest = 0;
    for _ in 0..5 {
        let position = session.position();
        let mut buffer = [0; MAX_FRAME];
        let length = encode(&Message::Position(position), &mut buffer);
        bytes.extend_from_slice(&buffer[..length]);
        newest = position.sequence;
    }
    session.stream.write_all(&bytes).expect("sent");
    let mut answers = 0;
    loop {
        match session.next_word() {
            Some(Message::Correction(correction)) => {
                answers += 1;
                if correction.sequence == newest {
                    break;
                }
            }
            other => panic!("expected a correction, found {other:?}"),
        }
    }
    let status = daemon.status();
    // the kernel may hand the bytes over in pieces, but every frame is either answered or counted
    let skipped = status["skipped_cycles"].as_u64().expect("number");
    assert_eq!(answers + skipped, 5, "{answers} answered, {skipped} skipped");
    assert!(status["late_cycles"].as_u64() >= Some(skipped));
    let _ = session.cycle();
}

#[test]
fn the_daemon_shows_life_and_gives_a_silent_control_up() {
    let port = Port::open();
    let setup = Setup { heartbeat_s: 0.1, silence_s: 0.5, ..Setup::default() };
    let daemon = Daemon::start(&port.address(), setup);
    let mut session = port.link();
    let since = Instant::now();
    let mut beats = 0;
    while let Some(message) = session.next() {
        beats += u32::from(matches!(message, Message::Heartbeat(_)));
    }
    let silence = since.elapsed();
    assert!(beats >= 2, "{beats} life signs");
    assert!(silence.as_secs_f64() > 0.4, "given up after {silence:?}");
    daemon.wait_for_log("nothing from the control for 0.5 s");
    let _ = port.link();
}

#[test]
fn a_control_that_never_says_hello_is_given_up() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), Setup { connect_timeout_s: 0.2, ..Setup::default() });
    let silent = port.accept();
    daemon.wait_for_log("no hello within 0.2 s");
    drop(silent);
    let mut session = port.link();
    let _ = session.cycle();
}

#[test]
fn sigterm_takes_the_offset_out_and_then_closes() {
    let (_port, mut daemon, mut session) = linked();
    session.run_until_corrected();
    daemon.signal(Signal::TERM);
    let mut cycles = 0;
    loop {
        match session.try_cycle() {
            Message::Correction(_) => cycles += 1,
            Message::Close(close) => {
                assert_eq!(close.reason, CloseReason::Shutdown);
                break;
            }
            other => panic!("expected corrections and then a close, found {other:?}"),
        }
        assert!(cycles < 5000, "no close frame");
    }
    // every step on the way was checked by the session
    assert!(session.applied[0].abs() < 1e-12, "{} mm left", session.applied[0]);
    assert!(cycles >= 50, "a ramp of 0.1 s takes more than {cycles} cycles");
    drop(session);
    let status = daemon.wait();
    assert_eq!(status.code(), Some(0), "{}", daemon.log());
    assert!(daemon.log().contains("the offset is at its rest value"), "{}", daemon.log());
    assert!(!daemon.socket().exists(), "the socket is removed");
}

/// The reason of the close frame at the end of what the daemon has sent.
fn close_reason(session: &mut Session) -> CloseReason {
    loop {
        match session.next_word() {
            Some(Message::Close(close)) => return close.reason,
            Some(_) => {}
            None => panic!("the link ended without a close frame"),
        }
    }
}

#[test]
fn a_stop_in_emergency_stop_leaves_the_offset_to_the_control() {
    let (_port, mut daemon, mut session) = linked();
    session.run_until_corrected();
    session.state = MachineState::HOMED | MachineState::ESTOP;
    for _ in 0..20 {
        let _ = session.cycle();
    }
    daemon.signal(Signal::TERM);
    daemon.wait_for_log("stopping: ");
    let position = session.position();
    session.send(&Message::Position(position));
    assert_eq!(close_reason(&mut session), CloseReason::Error);
    drop(session);
    assert_eq!(daemon.wait().code(), Some(0));
}

#[test]
fn a_stop_without_positions_leaves_the_offset_to_the_control() {
    // a control that has sent no position for its hold time refuses every answer: what it holds is not what was sent
    let (_port, mut daemon, mut session) = linked();
    session.run_until_corrected();
    daemon.signal(Signal::TERM);
    assert_eq!(close_reason(&mut session), CloseReason::Error);
    drop(session);
    assert_eq!(daemon.wait().code(), Some(0));
    assert!(!daemon.log().contains("the offset is at its rest value"), "{}", daemon.log());
}

#[test]
fn a_stop_before_the_first_position_leaves_the_offset_to_the_control() {
    let (_port, mut daemon, mut session) = linked();
    daemon.wait_for_log("link up");
    daemon.signal(Signal::TERM);
    assert_eq!(close_reason(&mut session), CloseReason::Error);
    drop(session);
    assert_eq!(daemon.wait().code(), Some(0));
}

#[test]
fn a_second_signal_stops_at_once() {
    let (_port, mut daemon, mut session) = linked();
    session.run_until_corrected();
    daemon.signal(Signal::INT);
    daemon.wait_for_log("stopping: ");
    daemon.signal(Signal::INT);
    assert_eq!(daemon.wait().code(), Some(0));
    assert!(daemon.log().contains("before the offset was at its rest value"), "{}", daemon.log());
    // told as an error, so that the control does not keep the offset for good
    assert_eq!(close_reason(&mut session), CloseReason::Error);
}

#[test]
fn sighup_changes_nothing_and_says_so() {
    let (_port, daemon, mut session) = linked();
    session.run_until_corrected();
    std::fs::write(daemon.dir.path().join("model.toml"), "nonsense").expect("written");
    daemon.signal(Signal::HUP);
    daemon.wait_for_log("SIGHUP: nothing is re-read");
    for _ in 0..50 {
        let correction = session.cycle();
        assert!((correction.offset[0] + EXX_MM).abs() < 1e-12, "{correction:?}");
        assert_eq!(correction.state, CorrectionState::Active);
    }
}

#[test]
fn killed_and_restarted_it_goes_on_from_the_offset_read_back() {
    let (port, mut daemon, mut session) = linked();
    session.run_until_corrected();
    daemon.signal(Signal::KILL);
    let _ = daemon.wait();
    // the control's watchdog has taken 40 % of the offset back meanwhile
    let mut applied = session.applied;
    applied[0] *= 0.6;
    drop(session);
    daemon.restart();
    let mut session = port.link();
    session.applied = applied;
    // every step from here on is checked by the session
    let first = session.cycle();
    assert!((first.offset[0] - applied[0]).abs() < 1e-9, "{} after {}", first.offset[0], applied[0]);
    session.run_until_corrected();
}

#[test]
fn an_emergency_stop_moves_nothing() {
    let (_port, _daemon, mut session) = linked();
    session.run_until_corrected();
    session.state = MachineState::HOMED | MachineState::ESTOP;
    for _ in 0..20 {
        let _ = session.cycle();
    }
    let held = session.applied[0];
    for _ in 0..100 {
        let _ = session.cycle();
    }
    assert_eq!(session.applied[0], held);
}

#[test]
fn a_refused_port_is_logged_a_few_times_only() {
    let port = Port::open();
    let address = port.address();
    drop(port);
    let setup = Setup { reconnect_max_s: 0.05, ..Setup::default() };
    let mut daemon = Daemon::start(&address, setup);
    daemon.wait_for_log("Connection refused");
    std::thread::sleep(Duration::from_millis(700));
    let log = daemon.log();
    let lines = log.lines().filter(|l| l.contains("no link: ")).count();
    assert!((1..=3).contains(&lines), "{lines} lines:\n{log}");
    assert!(daemon.status()["link"]["error"].as_str().is_some_and(|e| e.contains("refused")));
    let since = Instant::now();
    daemon.signal(Signal::TERM);
    assert_eq!(daemon.wait().code(), Some(0));
    assert!(since.elapsed() < PATIENCE / 5, "nothing to ramp out: stops at once");
}

#[test]
fn a_link_that_comes_up_late_is_taken() {
    let port = Port::open();
    let address = port.address();
    drop(port);
    let _daemon = Daemon::start(&address, Setup::default());
    std::thread::sleep(Duration::from_millis(200));
    let listener = Port::open_at(&address);
    let mut session = listener.link();
    assert!(eventually(|| session.cycle().state == CorrectionState::Active));
}
