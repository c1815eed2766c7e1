//! The control over real TCP on loopback, against a tiny daemon.

#![expect(clippy::disallowed_methods, reason = "a test of sockets and threads")]
#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::io::Write;
use std::time::{Duration, Instant};

use crate::support::{Client, MACHINE, Reply, axes, config, control, daemon, keep, middle};
use simulator::control::{
    Absent, Control, ControlError, CycleRecord, Happening, IdealMachine, Pacing, ScriptedEvent, TraceWriter,
};
use simulator::motion::gcode::interpret;
use simulator::motion::recorded::{self, Description, Interpolation, Replay};
use simulator::motion::{Dynamics, MotionSource, Trajectory};
use simulator::truth::{TruthMachine, VMC_850};
use volcomp::protocol::{Close, CloseReason, Correction, ErrorCode, MachineState, Message, Position, Tool};

const WAIT: Duration = Duration::from_secs(5);
const CYCLE_S: f64 = 0.001;

fn program(text: &str) -> Trajectory {
    let parsed = interpret(text, &axes(), middle()).unwrap();
    Trajectory::new(middle(), &parsed.segments, &axes(), &Dynamics::default(), CYCLE_S).unwrap()
}

fn short() -> Trajectory {
    program("F6000 G1 X445 Y260\nG2 X455 Y250 I0 J-10\nG1 X425")
}

/// A smooth offset that depends on the commanded position alone, as a real correction does.
fn curve(p: &Position) -> f64 {
    0.01 * ((p.commanded[0] - 425.0) * 0.05).sin()
}

fn settle(control: &mut Control, cycles: u32) -> Vec<CycleRecord> {
    let mut records = Vec::new();
    control
        .run_until(&mut IdealMachine, f64::from(cycles) * CYCLE_S - 1e-9, &mut keep(&mut records))
        .unwrap();
    records
}

#[test]
fn in_lock_step_every_answer_acts_one_cycle_later() {
    let mut control = control(config());
    let daemon = daemon(control.address(), |p| Reply::Offset(curve(p)));
    control.wait_for_daemon(WAIT).unwrap();
    let mut records = Vec::new();
    let summary = control.run(&mut short(), &mut IdealMachine, &mut keep(&mut records)).unwrap();
    assert_eq!(summary.cycles as usize, records.len());
    assert_eq!(summary.corrections, summary.cycles);
    assert_eq!((summary.unanswered, summary.rejected, summary.limited), (0, 0, 0));
    assert!(records.len() > 300);
    for pair in records.windows(2) {
        let answer = pair[0].correction.unwrap();
        assert_eq!(answer.sequence, pair[0].sequence);
        assert_eq!(pair[1].applied[0], answer.offset[0], "cycle {}", pair[1].cycle);
        // commanded is free of the offset, actual has it
        let sum = pair[1].commanded[0] + pair[1].applied[0];
        assert_eq!(pair[1].sample.encoder[0], sum);
    }
    assert!(summary.largest_offset[0] > 0.005);
    control.close();
    assert!(matches!(daemon.join().unwrap(), Some(Message::Close(Close { reason: CloseReason::Shutdown }))));
}

#[test]
fn the_daemon_sees_what_the_control_did() {
    let mut cfg = config();
    cfg.offset.delay_cycles = 2;
    let mut control = control(cfg);
    let (sender, seen) = std::sync::mpsc::channel();
    let daemon = daemon(control.address(), move |p| {
        sender.send(*p).unwrap();
        Reply::Offset(curve(p))
    });
    control.wait_for_daemon(WAIT).unwrap();
    let mut records = Vec::new();
    control.run(&mut short(), &mut IdealMachine, &mut keep(&mut records)).unwrap();
    drop(control);
    daemon.join().unwrap();
    let seen: Vec<Position> = seen.iter().collect();
    assert_eq!(seen.len(), records.len());
    for (k, (p, r)) in seen.iter().zip(&records).enumerate() {
        assert_eq!((p.sequence, p.commanded, p.applied), (r.sequence, r.commanded, r.applied));
        assert_eq!(p.actual, r.sample.encoder);
        assert_eq!(p.control_ns, k as i64 * 1_000_000);
        assert!(p.state.is_ready());
        assert_eq!(p.applied[0], if k < 2 { 0.0 } else { curve(&seen[k - 2]) });
    }
    assert!(seen.iter().any(|p| p.state.has(MachineState::MOVING) && p.feed_mm_per_min > 5000.0));
    assert!(!seen.last().unwrap().state.has(MachineState::MOVING));
}

#[test]
fn the_same_seed_gives_the_same_trace() {
    let trace = |seed: u64| {
        let mut machine = TruthMachine::from_toml(VMC_850).unwrap();
        machine.reset(seed, &middle());
        let mut control = control(config());
        let daemon = daemon(control.address(), |p| Reply::Offset(curve(p)));
        control.wait_for_daemon(WAIT).unwrap();
        let mut out = TraceWriter::new(Vec::new(), &axes()).unwrap();
        let mut records = Vec::new();
        control.run(&mut short(), &mut machine, &mut keep(&mut records)).unwrap();
        records.iter().for_each(|r| out.write(r).unwrap());
        drop(control);
        daemon.join().unwrap();
        records
    };
    let (a, b, c) = (trace(7), trace(7), trace(8));
    assert_eq!(a, b);
    assert_ne!(a, c);
}

#[test]
fn a_second_daemon_is_told_busy_and_the_first_goes_on() {
    let mut control = control(config());
    let address = control.address();
    let daemon = daemon(address, |_| Reply::Offset(0.0));
    control.wait_for_daemon(WAIT).unwrap();
    let second = std::thread::spawn(move || {
        let mut client = Client::connect(address);
        client.send(&Client::hello(1, MACHINE));
        let first = client.receive();
        (first, client.receive())
    });
    let records = settle(&mut control, 200);
    match second.join().unwrap() {
        (Some(Message::Error(e)), None) => assert_eq!(e.code, ErrorCode::Busy),
        other => panic!("{other:?}"),
    }
    assert!(records.iter().all(|r| r.connected && r.correction.is_some()));
    control.close();
    assert!(matches!(daemon.join().unwrap(), Some(Message::Close(_))));
}

#[test]
fn what_does_not_fit_is_told_why() {
    let mut cfg = config();
    cfg.tool = None;
    let control = control(cfg);
    let position = Message::Position(Position::default());
    for (first, code) in [
        (Client::hello(2, MACHINE), ErrorCode::Version),
        (Client::hello(1, "another machine"), ErrorCode::WrongMachine),
        (position, ErrorCode::Unexpected),
    ] {
        let mut client = Client::connect(control.address());
        client.send(&first);
        match client.receive() {
            Some(Message::Error(e)) => assert_eq!(e.code, code, "{e:?}"),
            other => panic!("{other:?}"),
        }
        assert_eq!(client.receive(), None, "closed afterwards");
    }
    let mut client = Client::connect(control.address());
    client.stream.write_all(b"GET / HTTP/1.1\r\n\r\n").unwrap();
    assert!(matches!(client.receive(), Some(Message::Error(e)) if e.code == ErrorCode::BadFrame));
    // silence: the hello has a second
    let begin = Instant::now();
    let mut client = Client::connect(control.address());
    assert!(matches!(client.receive(), Some(Message::Error(e)) if e.code == ErrorCode::Unexpected));
    assert!(begin.elapsed() >= Duration::from_millis(900), "{:?}", begin.elapsed());
    // and the place is still free
    let (_, hello) = Client::handshake(control.address());
    assert_eq!((hello.axis_count, hello.cycle_ns, hello.machine.as_str()), (3, 1_000_000, MACHINE));
}

/// Brings the offset to 20 um, lets the daemon do something, runs on without corrections.
fn after(what: impl FnOnce(&mut Client) + Send + 'static) -> (Vec<CycleRecord>, usize) {
    let mut control = control(config());
    let address = control.address();
    let daemon = std::thread::spawn(move || {
        let mut client = Client::handshake(address).0;
        let mut n = 0.0_f64;
        client.serve(|p| {
            n += 1.0;
            let share = (n / 200.0).min(1.0);
            if p.sequence >= 400 { Reply::Stop } else { Reply::Offset(0.02 * share) }
        });
        what(&mut client);
    });
    control.wait_for_daemon(WAIT).unwrap();
    let records = settle(&mut control, 1500);
    let last = records.iter().rposition(|r| r.correction.is_some()).unwrap();
    drop(control);
    daemon.join().unwrap();
    (records, last)
}

fn assert_held_and_ramped(records: &[CycleRecord], last: usize) {
    assert!(records.iter().all(|r| r.sample.axis[0].is_finite()));
    let mut rate_before = 0.0_f64;
    for pair in records[last..].windows(2) {
        let rate = (pair[1].applied[0] - pair[0].applied[0]) / CYCLE_S;
        assert!(rate.abs() <= 0.1 + 1e-9, "{rate} mm/s");
        assert!((rate - rate_before).abs() <= 1.0 * CYCLE_S + 1e-9);
        rate_before = rate;
    }
    assert_eq!(records[last + 90].applied[0], 0.02, "held");
    assert!(!records[last + 90].state.has(MachineState::OFFSET_RAMPING_OUT));
    assert!(records[last + 200].state.has(MachineState::OFFSET_RAMPING_OUT));
    let end = records.last().unwrap();
    assert_eq!(end.applied, [0.0; 8], "ramped out");
    assert!(!end.state.has(MachineState::OFFSET_RAMPING_OUT));
}

#[test]
fn garbage_ends_the_link_and_the_offset_is_held_then_ramped_out() {
    let (sender, told) = std::sync::mpsc::channel();
    let (records, last) = after(move |client| {
        client.stream.write_all(&[0x5a; 100]).unwrap();
        let mut heard = Vec::new();
        while let Some(message) = client.receive() {
            heard.push(message);
        }
        sender.send(heard).unwrap();
    });
    assert_held_and_ramped(&records, last);
    let heard = told.recv().unwrap();
    assert!(
        matches!(heard.last(), Some(Message::Error(e)) if e.code == ErrorCode::BadFrame),
        "{:?}",
        heard.last()
    );
    assert!(!records.last().unwrap().connected);
}

#[test]
fn a_daemon_that_vanishes_leaves_an_offset_that_is_held_then_ramped_out() {
    let (records, last) = after(|client| client.stream.shutdown(std::net::Shutdown::Both).unwrap());
    assert_held_and_ramped(&records, last);
}

#[test]
fn a_message_in_the_wrong_direction_ends_the_link() {
    let (sender, told) = std::sync::mpsc::channel();
    let (records, last) = after(move |client| {
        client.send(&Message::Position(Position::default()));
        let mut heard = None;
        while let Some(message) = client.receive() {
            heard = Some(message);
        }
        sender.send(heard).unwrap();
    });
    assert_held_and_ramped(&records, last);
    assert!(matches!(told.recv().unwrap(), Some(Message::Error(e)) if e.code == ErrorCode::Unexpected));
}

#[test]
fn an_orderly_close_leaves_the_offset_where_the_daemon_left_it() {
    let (records, last) = after(|client| {
        client.send(&Message::Close(Close { reason: CloseReason::Shutdown }));
        while client.receive().is_some() {}
    });
    assert!(records[last + 2..].iter().all(|r| r.applied[0] == 0.02 && !r.connected));
}

#[test]
fn corrections_that_are_not_finite_count_as_missing() {
    let (records, last) = after(|client| {
        while let Some(message) = client.receive() {
            if let Message::Position(p) = message {
                let mut c = Correction { sequence: p.sequence, ..Correction::default() };
                c.offset[0] = f64::NAN;
                client.send(&Message::Correction(c));
            }
        }
    });
    // they are recorded, so the last good one is the last finite one
    assert!(last > 1400);
    let last = records.iter().rposition(|r| r.correction.is_some_and(|c| c.offset[0].is_finite())).unwrap();
    assert_held_and_ramped(&records, last);
}

#[test]
fn a_daemon_that_returns_goes_on_from_the_present_offset() {
    let mut control = control(config());
    let address = control.address();
    let daemon = std::thread::spawn(move || {
        let mut n = 0.0_f64;
        Client::handshake(address).0.serve(|p| {
            n += 1.0;
            if p.sequence >= 400 { Reply::Stop } else { Reply::Offset(0.02 * (n / 200.0).min(1.0)) }
        });
    });
    control.wait_for_daemon(WAIT).unwrap();
    let mut records = settle(&mut control, 650);
    daemon.join().unwrap();
    let present = records.last().unwrap().applied[0];
    assert!(present > 0.001 && present < 0.019, "{present}");
    let daemon = crate::support::daemon(address, {
        let mut start = None;
        move |p| Reply::Offset(*start.get_or_insert(p.applied[0]))
    });
    control.wait_for_daemon(WAIT).unwrap();
    records.extend(settle(&mut control, 300));
    let end = records.last().unwrap();
    assert!((end.applied[0] - present).abs() < 0.001 && end.applied[0] > 0.0);
    assert!(!end.state.has(MachineState::OFFSET_RAMPING_OUT));
    for pair in records.windows(2) {
        assert!((pair[1].applied[0] - pair[0].applied[0]).abs() <= 0.2 * CYCLE_S + 1e-9);
    }
    drop(control);
    daemon.join().unwrap();
}

#[test]
fn a_daemon_that_stops_answering_does_not_stop_the_machine() {
    let mut control = control(config());
    let daemon =
        daemon(control.address(), |p| if p.sequence < 50 { Reply::Offset(0.0) } else { Reply::Silence });
    control.wait_for_daemon(WAIT).unwrap();
    let begin = Instant::now();
    let mut records = Vec::new();
    let summary = control.run_until(&mut IdealMachine, 0.4, &mut keep(&mut records)).unwrap();
    assert_eq!(summary.cycles, 400);
    // one answer is waited for 0.2 s, the others a cycle; after a second of silence the link is given up
    assert!(summary.unanswered >= 20 && summary.links_ended <= 1, "{summary:?}");
    let waited_for_each = Duration::from_millis(200) * summary.unanswered.try_into().unwrap();
    assert!(begin.elapsed() < waited_for_each / 2, "{:?} of {waited_for_each:?}", begin.elapsed());
    drop(control);
    daemon.join().unwrap();
}

#[test]
fn without_a_daemon_the_machine_runs_uncompensated() {
    let mut control = control(config());
    let mut records = Vec::new();
    let summary = control.run(&mut short(), &mut IdealMachine, &mut keep(&mut records)).unwrap();
    assert_eq!((summary.corrections, summary.largest_offset), (0, [0.0; 8]));
    assert!(records.iter().all(|r| !r.connected && r.correction.is_none()));
    assert_eq!(control.position()[..2], [425.0, 250.0]);
}

#[test]
fn corrections_may_be_received_without_being_applied() {
    let mut control = control(config());
    control.set_apply(false);
    let daemon = daemon(control.address(), |p| Reply::Offset(curve(p)));
    control.wait_for_daemon(WAIT).unwrap();
    let mut records = Vec::new();
    let summary = control.run(&mut short(), &mut IdealMachine, &mut keep(&mut records)).unwrap();
    assert_eq!(summary.corrections, summary.cycles);
    assert!(records.iter().all(|r| r.applied == [0.0; 8] && r.sample.axis == r.commanded));
    drop(control);
    daemon.join().unwrap();
}

#[test]
fn waiting_for_a_daemon_ends_with_a_clear_error() {
    let mut cfg = config();
    cfg.pacing = Pacing::LockStep {
        answer_timeout: Duration::from_millis(50),
        absent: Absent::Wait(Duration::from_millis(50)),
    };
    let mut control = control(cfg);
    let e = control.dwell(&mut IdealMachine, 1.0).unwrap_err();
    assert!(matches!(e, ControlError::NoDaemon { .. }), "{e}");
}

#[test]
fn a_port_in_use_is_named() {
    let first = control(config());
    let mut cfg = config();
    cfg.listen = first.address();
    let e = Control::bind(cfg).err().unwrap();
    assert!(matches!(e, ControlError::InUse { .. }));
    assert!(e.to_string().contains(&first.address().to_string()));
    // and it is free when the first is gone: a process that a test beside this one starts holds the listener until it runs
    let mut cfg = config();
    cfg.listen = first.address();
    drop(first);
    let until = Instant::now() + WAIT;
    while let Err(e) = Control::bind(cfg.clone()) {
        assert!(matches!(e, ControlError::InUse { .. }) && Instant::now() < until, "{e}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn an_emergency_stop_halts_the_motion_and_freezes_the_offset() {
    let mut cfg = config();
    cfg.script = vec![
        ScriptedEvent { cycle: 300, what: Happening::ESTOP_RELEASED },
        ScriptedEvent { cycle: 200, what: Happening::ESTOP },
    ];
    let mut control = control(cfg);
    let daemon = daemon(control.address(), |p| Reply::Offset(curve(p)));
    control.wait_for_daemon(WAIT).unwrap();
    let mut records = Vec::new();
    control.run(&mut short(), &mut IdealMachine, &mut keep(&mut records)).unwrap();
    for r in &records[200..300] {
        assert!(r.state.has(MachineState::ESTOP) && !r.state.has(MachineState::MOVING) && !r.scored);
        assert_eq!((r.commanded, r.applied), (records[200].commanded, records[200].applied));
    }
    assert!(!records[300].state.has(MachineState::ESTOP));
    let last = records.last().unwrap();
    assert_eq!(last.commanded[..2], [425.0, 250.0]);
    drop(control);
    daemon.join().unwrap();
}

#[test]
fn the_tool_is_told_after_the_hello_and_on_every_change() {
    let mut cfg = config();
    let tool = |number| Tool { number, tip: [0.0, 0.0, -100.0 - f64::from(number)] };
    cfg.tool = Some(tool(1));
    cfg.script = vec![ScriptedEvent { cycle: 5, what: Happening::Tool(tool(2)) }];
    let mut control = control(cfg);
    let address = control.address();
    let daemon = std::thread::spawn(move || {
        let mut client = Client::handshake(address).0;
        let mut heard = Vec::new();
        while let Some(message) = client.receive() {
            heard.push(message);
        }
        heard
    });
    control.wait_for_daemon(WAIT).unwrap();
    settle(&mut control, 10);
    drop(control);
    let heard = daemon.join().unwrap();
    assert_eq!(heard[0], Message::Tool(tool(1)));
    let second = heard.iter().position(|m| *m == Message::Tool(tool(2))).unwrap();
    assert!(matches!(heard[second - 1], Message::Position(p) if p.sequence == 4));
    assert!(matches!(heard[second + 1], Message::Position(p) if p.sequence == 5));
}

#[test]
fn heartbeats_keep_an_idle_link_alive() {
    let mut control = control(config());
    let address = control.address();
    let daemon = std::thread::spawn(move || {
        let mut client = Client::handshake(address).0;
        let mut heartbeats = 0;
        while let Some(message) = client.receive() {
            if let Message::Heartbeat(beat) = message {
                heartbeats += 1;
                assert_eq!(beat.count, heartbeats);
                client.send(&Message::Heartbeat(beat));
            }
        }
        heartbeats
    });
    control.wait_for_daemon(WAIT).unwrap();
    control.idle(Duration::from_millis(550));
    assert!(control.is_connected());
    drop(control);
    assert!((3..=6).contains(&daemon.join().unwrap()));
}

#[test]
fn real_time_keeps_its_deadlines_and_applies_corrections() {
    let mut cfg = config();
    cfg.pacing = Pacing::RealTime;
    cfg.cycle_s = 0.002;
    let mut control = control(cfg);
    let daemon = daemon(control.address(), |p| Reply::Offset(f64::from(p.sequence.min(100)) * 1e-5));
    control.wait_for_daemon(WAIT).unwrap();
    let begin = Instant::now();
    let mut records = Vec::new();
    let summary = control.run_until(&mut IdealMachine, 0.5, &mut keep(&mut records)).unwrap();
    let took = begin.elapsed().as_secs_f64();
    assert_eq!(summary.cycles, 250);
    assert!(took > 0.49, "{took} s");
    // 250 sleeps of a cycle each, the wake-ups late as everything is on this computer
    let bare = Instant::now();
    (0..250).for_each(|_| std::thread::sleep(Duration::from_millis(2)));
    let bare = bare.elapsed().as_secs_f64();
    assert!(took < 2.0 * bare, "{took} s, bare sleeps {bare} s");
    // a busy test machine may be late now and then, but the offset arrives
    assert!(summary.corrections > 100, "{summary:?}");
    assert_eq!(records.last().unwrap().applied[0], 1e-3);
    drop(control);
    daemon.join().unwrap();
}

#[test]
fn a_motion_that_starts_elsewhere_is_refused() {
    let mut control = Control::bind(config()).unwrap();
    let e = control.run(&mut short(), &mut IdealMachine, &mut keep(&mut Vec::new())).unwrap_err();
    assert!(e.to_string().contains("axis X at 425"), "{e}");
}

#[test]
fn in_a_replay_the_axes_are_where_the_recording_says_plus_the_offset() {
    let description = Description::from_toml(recorded::SHIPPED_DESCRIPTION).unwrap();
    let mut replay =
        Replay::new(recorded::SHIPPED_DATA, &description, &axes(), middle(), CYCLE_S, Interpolation::Cubic)
            .unwrap();
    let mut again = replay.clone();
    let mut control = Control::bind(config()).unwrap();
    control.set_position(replay.start());
    let mut machine = TruthMachine::from_toml(VMC_850).unwrap();
    machine.reset(1, &replay.start());
    let daemon = daemon(control.address(), |p| Reply::Offset(curve(p)));
    control.wait_for_daemon(WAIT).unwrap();
    let mut count = 0;
    let summary = control
        .run(&mut replay, &mut machine, &mut |r| {
            let motion = again.next_cycle().unwrap();
            assert_eq!(motion.commanded, r.commanded);
            let expected = motion.measured.unwrap()[0] + r.applied[0];
            assert!((r.sample.encoder[0] - expected).abs() < 1e-12);
            count += 1;
            Ok(if count == 3000 { simulator::control::Flow::Stop } else { simulator::control::Flow::GoOn })
        })
        .unwrap();
    assert_eq!(summary.cycles, 3000);
    assert!(summary.largest_offset[0] > 0.005);
    drop(control);
    daemon.join().unwrap();
}

#[test]
fn the_trace_has_the_contracts_columns() {
    let mut control = control(config());
    let records = settle(&mut control, 3);
    let mut bytes = Vec::new();
    let mut out = TraceWriter::new(&mut bytes, &axes()).unwrap();
    records.iter().for_each(|r| out.write(r).unwrap());
    out.finish().unwrap();
    let text = String::from_utf8(bytes).unwrap();
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    for column in ["t_s", "x_mm", "y_mm", "z_mm", "x_actual_mm", "x_offset_mm", "tip_x_mm", "feed_mm_per_min"]
    {
        assert!(header.contains(&column), "{column}");
    }
    assert_eq!(lines.clone().count(), 3);
    assert!(lines.all(|l| l.split(',').count() == header.len()));
}
