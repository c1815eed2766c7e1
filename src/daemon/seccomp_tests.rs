//! The cycle under a seccomp filter: from link-up to link-down the thread may only read and write its own socket.
//!
//! A seccomp filter on the cycle thread kills the process at any other system call, so each case runs in a process
//! of its own: this test program started again for one test. Allowed are `recvfrom` and `sendto` on the link's
//! socket, its read timeout, `ppoll` (busy polling), the clock where the vDSO has none, and waking (never waiting)
//! on a futex. Deliberate offences show that the filter bites.

use std::collections::BTreeMap;
use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::os::fd::AsRawFd;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Command, ExitStatus};
use std::sync::{Arc, Mutex, OnceLock};
use std::time::{Duration, Instant};

use crossbeam_channel::Receiver;
use seccompiler::{
    BpfProgram, SeccompAction, SeccompCmpArgLen, SeccompCmpOp, SeccompCondition, SeccompFilter, SeccompRule,
    apply_filter,
};

use super::age::AgeEstimator;
use super::channels::{CycleChannels, ServiceChannels, channels};
use super::clock::Clock;
use super::connection::{Connecting, Connection};
use super::control::Control;
use super::cycle::Cycle;
use super::cycle_time::CycleTimeMonitor;
use super::link::{ControlLink, driver};
use super::link_end::LinkEnd;
use super::link_session::LinkSession;
use super::load::{Loaded, load};
use super::recorder::{Tap, tap};
use super::tls::test_identity::{Server, TestIdentity, Wire};
use volcomp_config::Interface;
use volcomp_engine::Command as EngineCommand;
use volcomp_protocol::read_write::{LINE_MAX, LineReader, Machine, Reply, Request};
use volcomp_protocol::record::Entry;
use volcomp_protocol::{
    Axis, AxisUnit, Close, CloseReason, ControlHello, Correction, CorrectionState, DaemonHello, FrameReader,
    MAX_FRAME, MachineState, Message, Name, PROTOCOL_VERSION, Position, Tool, encode,
};
use volcomp_units::axes::{AxisName, MAX_AXES};

/// Names the case to the process that runs it.
const CASE: &str = "VOLCOMP_SEALED_CASE";
/// 3,000 cycles take seconds; beside a compiler on two processors a minute.
const PATIENCE: Duration = Duration::from_secs(300);
const CYCLES: u32 = 3_000;
/// Room for entries of the recording: few, so that a full queue is met as well.
const ENTRIES: usize = 256;
const CYCLE_NS: u64 = 1_000_000;

/// What a process does under the filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Case {
    /// Nothing but the cycle.
    Cycle,
    /// The cycle with busy polling.
    BusyPolling,
    /// The cycle over TLS, after its handshake.
    #[cfg(feature = "tls")]
    Tls,
    /// The same with busy polling.
    #[cfg(feature = "tls")]
    TlsBusyPolling,
    /// The cycle with a control that is read and written by calls.
    ReadWrite,
    /// Writes a file.
    WriteFile,
    /// Sleeps.
    Sleep,
    /// Waits for a lock that somebody else holds.
    Lock,
    /// Writes to a socket that is not the link's.
    OtherSocket,
}

impl Case {
    const fn is_tls(self) -> bool {
        #[cfg(feature = "tls")]
        return matches!(self, Self::Tls | Self::TlsBusyPolling);
        #[cfg(not(feature = "tls"))]
        false
    }

    const fn polls_busily(self) -> bool {
        #[cfg(feature = "tls")]
        return matches!(self, Self::BusyPolling | Self::TlsBusyPolling);
        #[cfg(not(feature = "tls"))]
        matches!(self, Self::BusyPolling)
    }
}

const CASES: &[(&str, Case)] = &[
    ("cycle", Case::Cycle),
    ("busy-polling", Case::BusyPolling),
    #[cfg(feature = "tls")]
    ("tls", Case::Tls),
    #[cfg(feature = "tls")]
    ("tls-busy-polling", Case::TlsBusyPolling),
    ("read-write", Case::ReadWrite),
    ("write-file", Case::WriteFile),
    ("sleep", Case::Sleep),
    ("lock", Case::Lock),
    ("other-socket", Case::OtherSocket),
];

#[test]
fn a_cycle_makes_no_system_call_but_its_sockets() {
    for case in ["cycle", "busy-polling", "read-write"] {
        succeeds(case);
    }
}

#[cfg(feature = "tls")]
#[test]
fn a_cycle_over_tls_makes_no_system_call_but_its_sockets() {
    for case in ["tls", "tls-busy-polling"] {
        succeeds(case);
    }
}

#[test]
fn the_filter_kills_whoever_does_anything_else() {
    for case in ["write-file", "sleep", "lock", "other-socket"] {
        let (status, said) = run(case);
        assert_eq!(status.signal(), Some(libc::SIGSYS), "{case}: {status}\n{said}");
    }
}

fn succeeds(case: &str) {
    let (status, said) = run(case);
    assert!(status.success(), "{case}: {status}; 31 is SIGSYS: a forbidden system call\n{said}");
}

/// This test program again, for one test under the filter: how it ends and what it says.
fn run(case: &str) -> (ExitStatus, String) {
    let (_, module) = module_path!().split_once("::").expect("a module of the crate");
    let output = Command::new(std::env::current_exe().expect("own file"))
        .args(["--exact", &format!("{module}::under_the_filter"), "--ignored", "--test-threads=1"])
        .env(CASE, case)
        .output()
        .expect("starts");
    let said = [output.stdout, output.stderr].map(|s| String::from_utf8_lossy(&s).into_owned()).join("\n");
    assert!(said.contains("running 1 test"), "{case}: {said}");
    (output.status, said)
}

/// One case in a process of its own, started by [`run`].
#[test]
#[ignore = "started by the other tests of this module, one process per case"]
fn under_the_filter() {
    let name = std::env::var(CASE).expect("named by the test that starts this one");
    let case = CASES.iter().find(|(n, _)| *n == name).expect("a known case").1;
    let listener = TcpListener::bind("127.0.0.1:0").expect("port");
    let address = listener.local_addr().expect("address");
    let identity = case.is_tls().then(TestIdentity::new);
    let server = identity.as_ref().map(TestIdentity::server);
    let control = std::thread::spawn(move || match case {
        Case::ReadWrite => called_control(&listener),
        _ => control(&listener, server),
    });
    let (cycle_channels, service) = channels();
    let (tap, entries) = tap(ENTRIES);
    let ended = Arc::new(OnceLock::new());
    let sign = Arc::clone(&ended);
    let scratch = tempfile::tempfile().expect("file");
    let held = Arc::new(Mutex::new(()));
    let contended = Arc::clone(&held);
    let _guard = held.lock().expect("lock");
    std::thread::spawn(move || {
        let (mut stage, mut connection) = Stage::open(address, cycle_channels, tap, case);
        if let Some(identity) = identity {
            connection.secure(&identity.identity()).expect("TLS starts");
            while !connection.shake(Duration::from_millis(20)).expect("the handshake succeeds") {}
        }
        let socket = connection.socket().as_raw_fd();
        let mut link = driver(connection, &stage.loaded.config.link);
        if case == Case::ReadWrite {
            link.send(&Message::DaemonHello(DaemonHello::default())).expect("asked");
            while link.next_message().expect("lines").is_none() {
                link.receive(Duration::from_millis(20)).expect("a reply");
            }
        }
        apply_filter(&filter(socket)).expect("the filter is taken");
        let end = stage.cycle(&mut *link);
        match case {
            Case::Cycle | Case::BusyPolling | Case::ReadWrite => {}
            #[cfg(feature = "tls")]
            Case::Tls | Case::TlsBusyPolling => {}
            Case::WriteFile => drop((&scratch).write(b"record")),
            Case::Sleep => std::thread::sleep(Duration::from_micros(1)),
            Case::Lock => drop(contended.lock()),
            Case::OtherSocket => drop(rustix::net::send(&scratch, b"x", rustix::net::SendFlags::empty())),
        }
        sign.set(end).expect("ends once");
        // ending a thread takes system calls; the process ends it
        loop {
            core::hint::spin_loop();
        }
    });
    let (records, recorded, end) = drain_until(&service, &entries, &ended);
    let orderly = match case {
        Case::ReadWrite => LinkEnd::Closed,
        _ => LinkEnd::ClosedByControl(CloseReason::Shutdown),
    };
    assert_eq!(end, orderly);
    let (seen, _open) = control.join().expect("the control ends");
    // offsets of the silences are no answers, but a control of calls counts them as cycles
    let unanswered = if case == Case::ReadWrite { 400 } else { 100 };
    assert!(records > u64::from(CYCLES) - unanswered, "{records} records");
    assert!(recorded > u64::from(CYCLES) / 2, "{recorded} entries of the recording");
    assert!(seen.active > CYCLES / 2, "{} active answers: the model must have been at work", seen.active);
    let beats = seen.heartbeats > 0 || case == Case::ReadWrite;
    assert!(beats && seen.held > 0, "{seen:?}: silence must have been answered");
}

/// What the service and the recorder do, until the cycle has ended; counts the records and the entries.
fn drain_until(
    service: &ServiceChannels,
    entries: &Receiver<Entry>,
    end: &OnceLock<LinkEnd>,
) -> (u64, u64, LinkEnd) {
    let deadline = Instant::now() + PATIENCE;
    let (mut records, mut recorded) = (0, 0);
    loop {
        let ended = end.get().copied();
        records += service.records.try_iter().count() as u64;
        recorded += entries.try_iter().count() as u64;
        let _ = service.reports.try_iter().count();
        if let Some(end) = ended {
            return (records, recorded, end);
        }
        assert!(Instant::now() < deadline, "the cycle does not end");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Kills the process at any system call of this thread that is not on the list.
fn filter(link: i32) -> BpfProgram {
    let on_link = || vec![rule(vec![argument(0, link.unsigned_abs().into())])];
    let wakes = [libc::FUTEX_WAKE, libc::FUTEX_WAKE | libc::FUTEX_PRIVATE_FLAG];
    let allowed: BTreeMap<i64, Vec<SeccompRule>> = [
        (libc::SYS_recvfrom, on_link()),
        (libc::SYS_sendto, on_link()),
        (
            libc::SYS_setsockopt,
            vec![rule(vec![
                argument(0, link.unsigned_abs().into()),
                argument(1, libc::SOL_SOCKET.unsigned_abs().into()),
                argument(2, libc::SO_RCVTIMEO.unsigned_abs().into()),
            ])],
        ),
        (libc::SYS_ppoll, Vec::new()),
        (libc::SYS_clock_gettime, Vec::new()),
        (libc::SYS_futex, wakes.map(|op| rule(vec![argument(1, op.unsigned_abs().into())])).to_vec()),
    ]
    .into();
    let arch = std::env::consts::ARCH.try_into().expect("an architecture that the filter knows");
    SeccompFilter::new(allowed, SeccompAction::KillProcess, SeccompAction::Allow, arch)
        .expect("a filter")
        .try_into()
        .expect("a program")
}

fn rule(conditions: Vec<SeccompCondition>) -> SeccompRule {
    SeccompRule::new(conditions).expect("a rule")
}

fn argument(index: u8, value: u64) -> SeccompCondition {
    SeccompCondition::new(index, SeccompCmpArgLen::Dword, SeccompCmpOp::Eq, value).expect("a condition")
}

/// Everything that a link needs, as the cycle thread has it.
struct Stage {
    loaded: Loaded,
    control: Control,
    session: LinkSession,
    clock: Clock,
}

impl Stage {
    fn open(address: SocketAddr, channels: CycleChannels, tap: Tap, case: Case) -> (Self, Connection) {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/examples/vmc-850/machine.toml");
        let mut loaded = load(&file).expect("the example loads");
        loaded.config.link.address = address;
        loaded.config.link.heartbeat_s = 0.01;
        loaded.config.engine.ramp_s = 0.05;
        if case.polls_busily() {
            loaded.config.realtime.busy_poll_s = 200e-6;
        }
        if case == Case::ReadWrite {
            loaded.config.link.interface = Interface::ReadWrite { poll_s: 0.0 };
        }
        let hello = hello(&loaded.config.machine);
        let config = loaded.config.engine_config(&hello).expect("the hello fits");
        let mut session = LinkSession::new(&config, Arc::clone(&loaded.model.model)).expect("an engine");
        let control = {
            let start = super::control::Start {
                model: Arc::clone(&loaded.model.model),
                permitted: true,
                kept_fault: false,
                service_silent_s: 0.0,
                live: None,
            };
            Control::new(channels, &loaded.config, start)
        };
        let clock = Clock::start();
        session.record_to(tap, clock.now(), &hello);
        session.link_up(clock.now());
        session.command(clock.now(), EngineCommand::Enable);
        let connecting = Connecting::start(address).expect("a socket");
        while !connecting.poll().expect("connects") {
            std::thread::sleep(Duration::from_millis(1));
        }
        let link = connecting
            .finish(&loaded.config.link, &loaded.config.realtime, clock)
            .expect("the options are taken");
        (Self { loaded, control, session, clock }, link)
    }

    fn cycle(&mut self, link: &mut dyn ControlLink) -> LinkEnd {
        Cycle {
            control: &mut self.control,
            session: &mut self.session,
            clock: self.clock,
            limits: &self.loaded.config.link,
            ages: AgeEstimator::new(),
            cycle_time: CycleTimeMonitor::new(1e-3),
            cycles: 0,
        }
        .run(link)
    }
}

fn hello(machine: &str) -> ControlHello {
    let axis = |name| Axis { name, unit: AxisUnit::Millimetre };
    let mut axes = [axis(AxisName::X); MAX_AXES];
    (axes[1], axes[2]) = (axis(AxisName::Y), axis(AxisName::Z));
    ControlHello {
        version: PROTOCOL_VERSION,
        machine: Name::new(machine),
        software: Name::new("test"),
        cycle_ns: CYCLE_NS,
        axis_count: 3,
        axes,
    }
}

/// What the control has been told.
#[derive(Debug, Default)]
struct Seen {
    active: u32,
    held: u32,
    heartbeats: u32,
}

/// A control in lock step, with an emergency stop, tool changes, silences and bursts now and then.
///
/// The socket is returned open: closing it before everything has been read resets the connection.
fn control(listener: &TcpListener, server: Option<Server>) -> (Seen, TcpStream) {
    let (stream, _) = listener.accept().expect("the daemon connects");
    let mut peer = Peer {
        wire: Wire::new(stream, server),
        reader: FrameReader::default(),
        applied: [0.0; MAX_AXES],
        seen: Seen::default(),
    };
    let mut sequence = 0;
    for cycle in 1..=CYCLES {
        if cycle % 700 == 0 {
            peer.silence(Duration::from_millis(60));
        }
        if cycle % 300 == 0 {
            peer.send(&[Message::Tool(Tool { number: cycle, tip: [0.0, 0.0, f64::from(cycle % 7)] })]);
        }
        let frames = if cycle % 100 == 0 { 3 } else { 1 };
        let burst: Vec<Message> = (0..frames)
            .map(|k| Message::Position(position(sequence + k + 1, cycle, &peer.applied)))
            .collect();
        sequence += frames;
        peer.send(&burst);
        peer.answer(sequence);
    }
    peer.send(&[Message::Close(Close { reason: CloseReason::Shutdown })]);
    let open = peer.wire.stream().try_clone().expect("a second handle");
    (peer.seen, open)
}

struct Peer {
    wire: Wire,
    reader: FrameReader,
    applied: [f64; MAX_AXES],
    seen: Seen,
}

fn position(sequence: u32, cycle: u32, applied: &[f64; MAX_AXES]) -> Position {
    let phase = f64::from(sequence) * 1e-3;
    let mut commanded = [0.0; MAX_AXES];
    commanded[0] = 200.0 + 150.0 * phase.sin();
    commanded[1] = 200.0 + 150.0 * (0.7 * phase).sin();
    commanded[2] = -250.0 + 150.0 * (0.3 * phase).sin();
    let mut bits = MachineState::HOMED | MachineState::ENABLED;
    if cycle % 1_000 < 20 {
        bits |= MachineState::ESTOP;
    }
    Position {
        sequence,
        control_ns: i64::from(sequence) * CYCLE_NS.cast_signed(),
        state: MachineState::from_bits(bits),
        feed_mm_per_min: 1000.0,
        commanded,
        actual: commanded,
        applied: *applied,
    }
}

impl Peer {
    fn send(&mut self, messages: &[Message]) {
        let mut bytes = Vec::new();
        for message in messages {
            let mut buffer = [0; MAX_FRAME];
            let length = encode(message, &mut buffer);
            bytes.extend_from_slice(&buffer[..length]);
        }
        self.wire.write_all(&bytes).expect("sent");
    }

    /// Waits for the answer to a frame.
    fn answer(&mut self, sequence: u32) {
        self.wire.stream().set_read_timeout(Some(PATIENCE)).expect("option");
        while self.take(false).is_none_or(|c| c.sequence != sequence) {
            let count = self.wire.read(self.reader.space()).expect("an answer");
            assert!(count > 0, "the daemon has closed the link");
            self.reader.advance(count);
        }
    }

    /// Says nothing and listens to what the daemon does about it.
    fn silence(&mut self, length: Duration) {
        let end = Instant::now() + length;
        while Instant::now() < end {
            self.wire.stream().set_read_timeout(Some(Duration::from_millis(5))).expect("option");
            match self.wire.read(self.reader.space()) {
                Ok(count) => self.reader.advance(count),
                Err(e) if e.kind() == ErrorKind::WouldBlock => {}
                Err(e) => panic!("{e}"),
            }
            while self.take(true).is_some() {}
        }
    }

    /// The next correction that has arrived.
    fn take(&mut self, silent: bool) -> Option<Correction> {
        loop {
            match self.reader.next().expect("frames")? {
                Message::Correction(correction) => {
                    self.applied = correction.offset;
                    self.seen.active += u32::from(correction.state == CorrectionState::Active);
                    self.seen.held += u32::from(silent);
                    return Some(correction);
                }
                Message::Heartbeat(_) => self.seen.heartbeats += 1,
                other => panic!("{other:?}"),
            }
        }
    }
}

/// A control that is read and written by calls, with an emergency stop, tool changes and silences now and then.
///
/// The socket is returned open in one direction, as by [`control`].
fn called_control(listener: &TcpListener) -> (Seen, TcpStream) {
    let (stream, _) = listener.accept().expect("the daemon connects");
    stream.set_nodelay(true).expect("option");
    let mut caller = Caller { stream, lines: LineReader::default(), held: false };
    let mut peer = Applied::default();
    for cycle in 1..=CYCLES {
        let tool = Tool { number: cycle / 300, tip: [0.0, 0.0, f64::from(cycle / 300 % 7)] };
        if cycle % 700 == 0 {
            std::thread::sleep(Duration::from_millis(60));
            caller.held = true;
        }
        loop {
            let reply = match caller.request() {
                Request::Machine => {
                    let hello = hello("vmc-850");
                    Reply::Machine(Machine {
                        cycle_ns: CYCLE_NS,
                        hold_ms: 100,
                        axes: hello.axes.map(|a| a.name),
                        axis_count: 3,
                        machine: hello.machine,
                    })
                }
                Request::Tool => Reply::Tool(Some(tool)),
                Request::Position => Reply::Position(position(cycle, cycle, &peer.offset), Some(tool.number)),
                Request::Offset(offset) => {
                    peer.seen.active += u32::from(offset != peer.offset);
                    peer.seen.held += u32::from(core::mem::take(&mut caller.held));
                    peer.offset = offset;
                    Reply::Done
                }
                Request::State(_) => {
                    caller.reply(&Reply::Done);
                    continue;
                }
                Request::Release { .. } => panic!("the daemon does not end"),
            };
            caller.reply(&reply);
            if reply == Reply::Done {
                break;
            }
        }
    }
    caller.stream.shutdown(Shutdown::Write).expect("half closed");
    (peer.seen, caller.stream)
}

#[derive(Default)]
struct Applied {
    offset: [f64; MAX_AXES],
    seen: Seen,
}

struct Caller {
    stream: TcpStream,
    lines: LineReader,
    held: bool,
}

impl Caller {
    fn request(&mut self) -> Request {
        loop {
            if let Some(line) = self.lines.next_line().expect("lines") {
                return Request::parse(line, 3).expect("a request");
            }
            let count = self.stream.read(self.lines.space()).expect("a request");
            assert!(count > 0, "the daemon has closed the link");
            self.lines.advance(count);
        }
    }

    fn reply(&mut self, reply: &Reply) {
        let mut out = [0; LINE_MAX];
        let length = reply.write(3, &mut out);
        self.stream.write_all(&out[..length]).expect("sent");
    }
}
