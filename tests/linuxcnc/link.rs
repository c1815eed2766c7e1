//! The bridge's manners on the link: who is refused and how, and what a daemon that is out of its mind can do.

use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use volcomp::model::axes::MAX_AXES;
use volcomp::protocol::{
    Correction, CorrectionState, DaemonHello, ErrorCode, FrameReader, Heartbeat, MAX_FRAME, Message, Name,
    Position, encode,
};

use crate::control::{Cnc, Wiring};
use crate::namespaces::{in_namespaces, run};

const PATIENCE: Duration = Duration::from_secs(5);
/// Cycles without a position that are a stall of the computer, and for how many cycles the offset feels it.
const STALL_CYCLES: f64 = 4.0;
const STALL_FELT_CYCLES: f64 = 40.0;

struct Peer {
    stream: TcpStream,
    reader: FrameReader,
}

impl Peer {
    fn connect() -> Self {
        let stream = TcpStream::connect("127.0.0.1:7878").expect("the bridge listens");
        stream.set_nodelay(true).expect("option");
        stream.set_read_timeout(Some(PATIENCE)).expect("option");
        Self { stream, reader: FrameReader::default() }
    }

    fn greeted() -> Self {
        let mut peer = Self::connect();
        peer.send(&hello("linuxcnc-mill", 1, 1));
        match peer.next() {
            Some(Message::ControlHello(hello)) => {
                assert_eq!((hello.axis_count, hello.cycle_ns), (3, 1_000_000))
            }
            other => panic!("expected a hello, found {other:?}"),
        }
        peer
    }

    fn send(&mut self, message: &Message) {
        let mut buffer = [0; MAX_FRAME];
        let length = encode(message, &mut buffer);
        self.stream.write_all(&buffer[..length]).expect("sent");
    }

    fn next(&mut self) -> Option<Message> {
        loop {
            if let Some(message) = self.reader.next().expect("the bridge sends frames") {
                return Some(message);
            }
            match self.stream.read(self.reader.space()) {
                Ok(0) => return None,
                Ok(count) => self.reader.advance(count),
                Err(e) if e.kind() == ErrorKind::ConnectionReset => return None,
                Err(e) => panic!("nothing from the bridge: {e}"),
            }
        }
    }

    /// The error the bridge ends the link with.
    fn refusal(&mut self) -> ErrorCode {
        loop {
            match self.next() {
                Some(Message::Error(error)) => {
                    assert!(self.next().is_none(), "nothing follows an error");
                    return error.code;
                }
                Some(Message::Position(_) | Message::Heartbeat(_)) => {}
                other => panic!("expected an error, found {other:?}"),
            }
        }
    }

    fn position(&mut self) -> Position {
        loop {
            match self.next() {
                Some(Message::Position(position)) => return position,
                Some(Message::Heartbeat(_)) => {}
                other => panic!("expected a position, found {other:?}"),
            }
        }
    }

    /// The newest position, however many have come meanwhile.
    fn newest(&mut self) -> Position {
        let mut newest = self.position();
        self.stream.set_nonblocking(true).expect("option");
        loop {
            match self.reader.next().expect("the bridge sends frames") {
                Some(Message::Position(position)) => newest = position,
                Some(_) => {}
                None => match self.stream.read(self.reader.space()) {
                    Ok(count) if count > 0 => self.reader.advance(count),
                    _ => break,
                },
            }
        }
        self.stream.set_nonblocking(false).expect("option");
        newest
    }

    /// Answers with a wish for X for so many positions; gives the last one.
    fn demand(&mut self, x: f64, cycles: u32) -> Position {
        let mut last = self.newest();
        let mut stalled: f64 = 0.0;
        for _ in 0..cycles {
            let mut offset = [0.0; MAX_AXES];
            offset[0] = x;
            let state = CorrectionState::Active;
            self.send(&Message::Correction(Correction {
                sequence: last.sequence,
                state,
                limited: 0,
                offset,
            }));
            let next = self.newest();
            let cycles = f64::from(next.sequence.wrapping_sub(last.sequence));
            let step = (next.applied[0] - last.applied[0]).abs();
            // LinuxCNC's planner may take two cycles' worth in one; after a stall of the computer it runs after the ten that
            // the bridge makes up for
            stalled = if cycles > STALL_CYCLES { STALL_FELT_CYCLES } else { (stalled - cycles).max(0.0) };
            let behind = if stalled > 0.0 { 14.0 } else { 4.0 };
            assert!(step <= 0.001 * (cycles + behind), "{step} mm in {cycles} cycles");
            last = next;
        }
        last
    }
}

fn hello(machine: &str, version_min: u8, version_max: u8) -> Message {
    let software = Name::new("test");
    Message::DaemonHello(DaemonHello { version_min, version_max, machine: Name::new(machine), software })
}

fn refusals() {
    let mut peer = Peer::connect();
    peer.send(&hello("another-mill", 1, 1));
    assert_eq!(peer.refusal(), ErrorCode::WrongMachine);
    let mut peer = Peer::connect();
    peer.send(&hello("linuxcnc-mill", 2, 3));
    assert_eq!(peer.refusal(), ErrorCode::Version);
    let mut peer = Peer::connect();
    peer.stream.write_all(b"GET / HTTP/1.1\r\n\r\n").expect("sent");
    assert_eq!(peer.refusal(), ErrorCode::BadFrame);
    // a check sum that does not fit
    let mut peer = Peer::connect();
    let mut buffer = [0; MAX_FRAME];
    let length = encode(&hello("linuxcnc-mill", 1, 1), &mut buffer);
    buffer[20] ^= 1;
    peer.stream.write_all(&buffer[..length]).expect("sent");
    assert_eq!(peer.refusal(), ErrorCode::BadFrame);
    // silence instead of a hello
    let asked = Instant::now();
    assert_eq!(Peer::connect().refusal(), ErrorCode::Unexpected);
    assert!(asked.elapsed() >= Duration::from_millis(900), "{:?}", asked.elapsed());
}

#[test]
#[ignore = "needs LinuxCNC and the right to make namespaces"]
fn the_bridge_keeps_to_the_protocol() {
    in_namespaces("link::the_bridge_keeps_to_the_protocol", || {
        let mut cnc = Cnc::start(Wiring::ExternalOffsets, |_| {});
        refusals();
        // a hello in two pieces; then a second daemon, which does not disturb the first
        let mut peer = Peer::connect();
        let mut buffer = [0; MAX_FRAME];
        let length = encode(&hello("linuxcnc-mill", 1, 1), &mut buffer);
        peer.stream.write_all(&buffer[..30]).expect("sent");
        std::thread::sleep(Duration::from_millis(50));
        peer.stream.write_all(&buffer[30..length]).expect("sent");
        assert!(matches!(peer.next(), Some(Message::ControlHello(_))), "greeted");
        assert_eq!(Peer::connect().refusal(), ErrorCode::Busy);
        let (first, second) = (peer.position(), peer.position());
        let cycles = second.sequence.wrapping_sub(first.sequence);
        assert!((1..1000).contains(&cycles), "{cycles} cycles apart");
        assert_eq!(second.control_ns - first.control_ns, i64::from(cycles) * 1_000_000);
        assert_eq!(second.state.bits & 0x7, 0x3, "homed, enabled, no emergency stop");
        // no number, and answers to a cycle that never was and to one of long ago
        let wrong = [
            (0, f64::NAN),
            (0, f64::INFINITY),
            (0, f64::NEG_INFINITY),
            (1000, 0.01),
            (0_u32.wrapping_sub(500), 0.01),
        ];
        for (sequence, x) in wrong {
            let mut offset = [0.0; MAX_AXES];
            offset[0] = x;
            let sequence = peer.position().sequence.wrapping_add(sequence);
            let state = CorrectionState::Active;
            peer.send(&Message::Correction(Correction { sequence, state, limited: 0, offset }));
        }
        for _ in 0..20 {
            assert_eq!(peer.position().applied[0], 0.0, "such corrections are not used");
        }
        assert_eq!(cnc.pin("volcomp.rejected"), wrong.len().to_string());
        // beyond all measure: at 1 mm/s, to 1 mm and no further
        let far = peer.demand(1e308, 1500);
        assert!((far.applied[0] - 1.0).abs() < 1e-5, "{} mm", far.applied[0]);
        assert_ne!(far.state.bits & 0x10, 0, "the bridge says that it holds something back");
        // parameters that are none count as the defaults
        for parameter in ["rate", "ramp-rate", "limit", "hold-time"] {
            for value in ["-1", "nan", "0"] {
                run("halcmd", &["setp", &format!("volcomp.{parameter}"), value]);
                peer.demand(far.applied[0], 5);
            }
        }
        let back = peer.demand(0.0, 1500);
        assert!(back.applied[0].abs() < 1e-5, "{} mm", back.applied[0]);
        // nothing said for a second: the place is free for another
        let silent = Instant::now();
        while peer.next().is_some() {}
        assert!(silent.elapsed() >= Duration::from_millis(800), "{:?}", silent.elapsed());
        // half a frame, and a check sum that does not fit, in mid-work
        let mut peer = Peer::greeted();
        peer.demand(0.05, 100);
        let mut buffer = [0; MAX_FRAME];
        let length = encode(&Message::Heartbeat(Heartbeat { count: 1, time_ns: 0 }), &mut buffer);
        peer.stream.write_all(&buffer[..10]).expect("sent");
        std::thread::sleep(Duration::from_millis(20));
        buffer[length - 1] ^= 1;
        peer.stream.write_all(&buffer[10..length]).expect("sent");
        assert_eq!(peer.refusal(), ErrorCode::BadFrame);
        cnc.wait_for("taken back", |cnc| {
            cnc.pin("axis.x.eoffset").parse::<f64>().is_ok_and(|v| v.abs() < 1e-5)
        });
        let _ = Peer::greeted();
    });
}

/// What the README tells to put into the INI file, as LinuxCNC reads it.
#[test]
#[ignore = "needs LinuxCNC and the right to make namespaces"]
fn the_lines_of_the_readme_are_read_as_they_are_meant() {
    in_namespaces("link::the_lines_of_the_readme_are_read_as_they_are_meant", || {
        let readme = concat!(env!("CARGO_MANIFEST_DIR"), "/adapters/linuxcnc/README.md");
        let text = std::fs::read_to_string(readme).expect("README");
        let block = text.split("```ini\n").nth(1).and_then(|rest| rest.split("```").next()).expect("a block");
        let folder = tempfile::tempdir().expect("directory");
        let ini = folder.path().join("machine.ini");
        std::fs::write(&ini, block).expect("INI file");
        let ini = ini.display().to_string();
        for (section, variable, value) in [
            ("VOLCOMP", "BRIDGE", "/opt/volcomp/volcomp_bridge"),
            ("VOLCOMP", "MACHINE", "linuxcnc-mill"),
            ("VOLCOMP", "PORT", "7878"),
            ("VOLCOMP", "SAMPLER_DEPTH", "1000"),
            ("VOLCOMP", "SAMPLER_LAYOUT", "ffffffffffffsssbbbbf"),
            ("HAL", "HALFILE", "eoffset.hal"),
            ("HAL", "HALCMD", "net estop-released => sampler.0.pin.18"),
            ("AXIS_X", "OFFSET_AV_RATIO", "0.3"),
        ] {
            assert_eq!(
                run("inivar", &["-ini", &ini, "-sec", section, "-var", variable]),
                value,
                "{variable}"
            );
        }
    });
}
