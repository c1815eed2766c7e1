//! A small control and a daemon to test against each other: the real `volcompd`, real TCP on loopback, lock step.

#![expect(clippy::disallowed_methods, reason = "helpers of tests with processes, sockets and files")]
#![expect(clippy::expect_used, reason = "helpers of tests")]
#![allow(clippy::print_stdout, reason = "the log of a daemon that failed a test")]

use std::fs;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use tempfile::TempDir;
use volcomp::model::axes::{AxisArray, AxisName, MAX_AXES};
use volcomp::protocol::{
    Axis, AxisUnit, Close, CloseReason, ControlHello, Correction, DaemonHello, FrameReader, MAX_FRAME,
    MachineState, Message, Name, PROTOCOL_VERSION, Position, encode,
};

/// Patience with anything that must happen.
pub(crate) const PATIENCE: Duration = Duration::from_secs(5);
/// Cycle of the control, ns.
pub(crate) const CYCLE_NS: u64 = 1_000_000;
/// The model's positioning error of X, mm: constant, so that the correction is known.
pub(crate) const EXX_MM: f64 = 0.010;
/// Largest step per cycle that the machine file below allows, mm: 2 mm/s for 1 ms.
pub(crate) const STEP_MM_MAX: f64 = 0.002;

const MODEL: &str = r#"
format = "volcomp-model/1"
machine = "test-mill"
chain = "[w X' b Y Z t]"
[errors.exx.constant]
value-um = 10.0
"#;

/// Everything a test may want to change about the machine file.
pub(crate) struct Setup {
    pub(crate) start: &'static str,
    /// Longer than this test may be kept from running, where what it proves is not about time.
    pub(crate) stale_ms: f64,
    pub(crate) live_max_age_ms: f64,
    pub(crate) heartbeat_s: f64,
    pub(crate) silence_s: f64,
    pub(crate) connect_timeout_s: f64,
    pub(crate) reconnect_max_s: f64,
    /// More lines of the table `[link]`.
    pub(crate) link: &'static str,
    /// Lines of the table `[realtime]`.
    pub(crate) realtime: &'static str,
    /// More tables.
    pub(crate) more: &'static str,
    pub(crate) model: String,
    pub(crate) environment: Vec<(&'static str, String)>,
}

impl Default for Setup {
    fn default() -> Self {
        Self {
            start: "on-connect",
            stale_ms: 1000.0,
            live_max_age_ms: 500.0,
            heartbeat_s: 0.2,
            silence_s: 3.0,
            connect_timeout_s: 2.0,
            reconnect_max_s: 0.4,
            link: "",
            realtime: "priority = 0\nlock-memory = false\n",
            more: "",
            model: MODEL.to_owned(),
            environment: Vec::new(),
        }
    }
}

impl Setup {
    fn machine_file(&self, address: &str, socket: &str) -> String {
        let Self {
            start,
            stale_ms,
            live_max_age_ms,
            heartbeat_s,
            silence_s,
            connect_timeout_s,
            reconnect_max_s,
            link,
            realtime,
            more,
            ..
        } = self;
        let axes: String = ["x", "y", "z"]
            .iter()
            .map(|a| {
                format!(
                    "[axes.{a}]\nlimit-um = 150.0\nrate-um-per-s = 2000.0\nacceleration-um-per-s2 = 40000.0\n"
                )
            })
            .collect();
        format!(
            "format = \"volcomp-machine/1\"\nmachine = \"test-mill\"\nmodel = \"model.toml\"\n\
             [link]\naddress = \"{address}\"\ncycle-ms = 1.0\nconnect-timeout-s = {connect_timeout_s:?}\n\
             reconnect-min-s = 0.05\nreconnect-max-s = {reconnect_max_s:?}\n\
             heartbeat-s = {heartbeat_s:?}\nsilence-s = {silence_s:?}\n{link}\
             [engine]\nstart = \"{start}\"\nramp-s = 0.1\nstale-ms = {stale_ms:?}\nlive-max-age-ms = {live_max_age_ms:?}\n{axes}\
             [realtime]\n{realtime}\
             [status]\nsocket = \"{socket}\"\n[log]\ntarget = \"stderr\"\n{more}"
        )
    }
}

/// A running `volcompd` with its files; killed when dropped.
pub(crate) struct Daemon {
    pub(crate) dir: TempDir,
    pub(crate) child: Child,
    setup: Setup,
}

impl Daemon {
    pub(crate) fn start(address: &str, setup: Setup) -> Self {
        let dir = tempfile::tempdir().expect("directory");
        let socket = dir.path().join("sock").display().to_string();
        fs::write(dir.path().join("machine.toml"), setup.machine_file(address, &socket)).expect("written");
        fs::write(dir.path().join("model.toml"), &setup.model).expect("written");
        let child = spawn(&dir, &setup);
        Self { dir, child, setup }
    }

    /// The same files once more, in a new process.
    pub(crate) fn restart(&mut self) {
        self.child = spawn(&self.dir, &self.setup);
    }

    pub(crate) fn socket(&self) -> PathBuf {
        self.dir.path().join("sock")
    }

    pub(crate) fn log(&self) -> String {
        fs::read_to_string(self.dir.path().join("log")).expect("log")
    }

    pub(crate) fn signal(&self, signal: Signal) {
        let pid = Pid::from_child(&self.child);
        kill_process(pid, signal).expect("signal sent");
    }

    pub(crate) fn wait(&mut self) -> ExitStatus {
        let deadline = Instant::now() + PATIENCE;
        loop {
            if let Some(status) = self.child.try_wait().expect("child") {
                return status;
            }
            assert!(Instant::now() < deadline, "volcompd did not end:\n{}", self.log());
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    pub(crate) fn wait_for_log(&self, text: &str) {
        let found = eventually(|| self.log().contains(text));
        assert!(found, "no `{text}` in the log:\n{}", self.log());
    }

    /// `volcomp VERB --socket ..`.
    pub(crate) fn volcomp(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().expect("volcomp runs")
    }

    /// The same, to be started by the caller.
    pub(crate) fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_volcomp"));
        command.args(arguments).arg("--socket").arg(self.socket());
        command
    }

    pub(crate) fn status(&self) -> serde_json::Value {
        let mut output = self.volcomp(&["status", "--json"]);
        // the socket appears, and refuses connections until the daemon listens
        let runs = eventually(|| {
            let running = !String::from_utf8_lossy(&output.stderr).contains("is not running");
            if !running {
                output = self.volcomp(&["status", "--json"]);
            }
            running
        });
        assert!(runs, "no socket:\n{}", self.log());
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(is_answer(&output), "{text}{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_str(&text).expect("JSON")
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        // already gone where the test ended it
        let _ = self.child.kill();
        let _ = self.child.wait();
        if std::thread::panicking() {
            println!("log of volcompd:\n{}", self.log());
        }
    }
}

fn spawn(dir: &TempDir, setup: &Setup) -> Child {
    let log = fs::File::options().create(true).append(true).open(dir.path().join("log")).expect("log");
    Command::new(env!("CARGO_BIN_EXE_volcompd"))
        .arg("--config")
        .arg(dir.path().join("machine.toml"))
        .env_remove("STATE_DIRECTORY")
        .env_remove("NOTIFY_SOCKET")
        .env_remove("WATCHDOG_USEC")
        .env_remove("WATCHDOG_PID")
        .envs(setup.environment.iter().map(|(key, value)| (*key, value.as_str())))
        .stdout(Stdio::null())
        .stderr(log)
        .spawn()
        .expect("volcompd starts")
}

/// The control's port.
pub(crate) struct Port {
    listener: TcpListener,
}

impl Port {
    /// A daemon with a latched fault of the read-back, and a new link to it.
    pub(crate) fn latched(&self) -> (Daemon, Session) {
        let daemon = Daemon::start(&self.address(), Setup::default());
        let mut session = self.link();
        session.run_until_corrected();
        session.deceive(0.05);
        (daemon, self.link())
    }

    pub(crate) fn open() -> Self {
        Self::open_at("127.0.0.1:0")
    }

    pub(crate) fn open_at(address: &str) -> Self {
        let listener = TcpListener::bind(address).expect("port");
        listener.set_nonblocking(true).expect("option");
        Self { listener }
    }

    pub(crate) fn address(&self) -> String {
        self.listener.local_addr().expect("address").to_string()
    }

    /// A connection, or `None` within `limit`.
    pub(crate) fn accept_within(&self, limit: Duration) -> Option<Session> {
        let deadline = Instant::now() + limit;
        loop {
            match self.listener.accept() {
                Ok((stream, _)) => return Some(Session::new(stream)),
                Err(e) if e.kind() == ErrorKind::WouldBlock => {}
                Err(e) => panic!("accept: {e}"),
            }
            if Instant::now() >= deadline {
                return None;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    pub(crate) fn accept(&self) -> Session {
        self.accept_within(PATIENCE).expect("the daemon connects")
    }

    /// Closes what waits to be accepted: a killed daemon leaves its connections behind.
    pub(crate) fn close_pending(&self) {
        while self.accept_within(Duration::ZERO).is_some() {}
    }

    /// A connection with the hellos exchanged.
    pub(crate) fn link(&self) -> Session {
        let mut session = self.accept();
        session.handshake(&hello());
        session
    }
}

/// What the control of these tests says of itself.
pub(crate) fn hello() -> ControlHello {
    let axis = |name| Axis { name, unit: AxisUnit::Millimetre };
    let mut axes = [axis(AxisName::X); MAX_AXES];
    axes[1] = axis(AxisName::Y);
    axes[2] = axis(AxisName::Z);
    ControlHello {
        version: PROTOCOL_VERSION,
        machine: Name::new("test-mill"),
        software: Name::new("test control"),
        cycle_ns: CYCLE_NS,
        axis_count: 3,
        axes,
    }
}

/// One connection, seen from the control.
pub(crate) struct Session {
    pub(crate) stream: TcpStream,
    reader: FrameReader,
    pub(crate) sequence: u32,
    pub(crate) control_ns: i64,
    /// Where the program is, mm.
    pub(crate) commanded: AxisArray,
    /// Cycles of the program so far.
    pub(crate) program: u32,
    /// The offset that the control has applied, mm.
    pub(crate) applied: AxisArray,
    pub(crate) state: u16,
}

impl Session {
    fn new(stream: TcpStream) -> Self {
        stream.set_nonblocking(false).expect("option");
        stream.set_nodelay(true).expect("option");
        stream.set_read_timeout(Some(PATIENCE)).expect("option");
        Self {
            stream,
            reader: FrameReader::default(),
            sequence: 0,
            control_ns: 1_000_000_000,
            commanded: [0.0; MAX_AXES],
            program: 0,
            applied: [0.0; MAX_AXES],
            state: MachineState::HOMED | MachineState::ENABLED,
        }
    }

    pub(crate) fn send(&mut self, message: &Message) {
        let mut buffer = [0; MAX_FRAME];
        let length = encode(message, &mut buffer);
        self.stream.write_all(&buffer[..length]).expect("sent");
    }

    /// The next message; `None` at the end of the connection.
    pub(crate) fn next(&mut self) -> Option<Message> {
        loop {
            if let Some(message) = self.reader.next().expect("the daemon sends frames") {
                return Some(message);
            }
            match self.stream.read(self.reader.space()) {
                Ok(0) => return None,
                Ok(count) => self.reader.advance(count),
                Err(e) if e.kind() == ErrorKind::ConnectionReset => return None,
                Err(e) => panic!("nothing from the daemon: {e}"),
            }
        }
    }

    /// The next message that is no life sign.
    pub(crate) fn next_word(&mut self) -> Option<Message> {
        loop {
            match self.next() {
                Some(Message::Heartbeat(_)) => {}
                other => return other,
            }
        }
    }

    pub(crate) fn read_hello(&mut self) -> DaemonHello {
        match self.next() {
            Some(Message::DaemonHello(hello)) => hello,
            other => panic!("expected the daemon's hello, found {other:?}"),
        }
    }

    pub(crate) fn handshake(&mut self, hello: &ControlHello) {
        let _ = self.read_hello();
        self.send(&Message::ControlHello(*hello));
    }

    /// The position frame of the next cycle.
    pub(crate) fn position(&mut self) -> Position {
        self.sequence = self.sequence.wrapping_add(1);
        self.control_ns += i64::try_from(CYCLE_NS).expect("fits");
        Position {
            sequence: self.sequence,
            control_ns: self.control_ns,
            state: MachineState::from_bits(self.state),
            feed_mm_per_min: 1000.0,
            commanded: self.commanded,
            actual: core::array::from_fn(|k| self.commanded[k] + self.applied[k]),
            applied: self.applied,
        }
    }

    /// One cycle in lock step: position out, correction in and applied.
    pub(crate) fn cycle(&mut self) -> Correction {
        match self.try_cycle() {
            Message::Correction(correction) => correction,
            other => panic!("expected a correction, found {other:?}"),
        }
    }

    /// One cycle; gives whatever the daemon says to it.
    pub(crate) fn try_cycle(&mut self) -> Message {
        let position = self.position();
        self.send(&Message::Position(position));
        loop {
            let word = self.next_word().expect("the daemon answers");
            let Message::Correction(correction) = &word else { return word };
            self.apply(correction);
            // while this test was kept from running the daemon may have held the last one
            if correction.sequence.wrapping_add(1) != position.sequence {
                assert_eq!(correction.sequence, position.sequence, "answers another frame");
                return word;
            }
        }
    }

    fn apply(&mut self, correction: &Correction) {
        for (applied, offset) in self.applied.iter_mut().zip(correction.offset) {
            let step = (offset - *applied).abs();
            assert!(step <= STEP_MM_MAX * 1.000_001, "step of {step} mm in one cycle");
            *applied = offset;
        }
    }

    /// Cycles until the offset of X is the full correction.
    pub(crate) fn run_until_corrected(&mut self) {
        for _ in 0..2000 {
            let _ = self.cycle();
            if (self.applied[0] + EXX_MM).abs() < 1e-9 {
                return;
            }
        }
        panic!("no full correction after 2000 cycles: {} mm", self.applied[0]);
    }

    /// Reports an offset of X that was never sent, mm, until the daemon closes the link.
    #[allow(dead_code, reason = "each test program uses a part of this module")]
    pub(crate) fn deceive(&mut self, x_mm: f64) {
        for _ in 0..400 {
            let mut position = self.position();
            position.applied[0] = x_mm;
            self.send(&Message::Position(position));
            match self.next_word() {
                Some(Message::Correction(_)) => {}
                Some(Message::Close(close)) => {
                    assert_eq!(close.reason, CloseReason::Error);
                    return;
                }
                other => panic!("expected a correction or the end, found {other:?}"),
            }
        }
        panic!("the daemon goes on with a control that does not hold what it is sent");
    }

    /// Cycles of which none may be answered: a latched fault sends nothing.
    #[allow(dead_code, reason = "each test program uses a part of this module")]
    pub(crate) fn run_unanswered(&mut self, cycles: u32) {
        for _ in 0..cycles {
            let position = self.position();
            self.send(&Message::Position(position));
            std::thread::sleep(Duration::from_millis(1));
        }
        while let Some(message) = self.poll() {
            assert!(matches!(message, Message::Heartbeat(_)), "{message:?}");
        }
    }

    /// The next message that is there already.
    #[allow(dead_code, reason = "each test program uses a part of this module")]
    pub(crate) fn poll(&mut self) -> Option<Message> {
        if let Some(message) = self.reader.next().expect("frames") {
            return Some(message);
        }
        self.stream.set_nonblocking(true).expect("option");
        let count = self.stream.read(self.reader.space()).map_or(0, |count| count);
        self.stream.set_nonblocking(false).expect("option");
        self.reader.advance(count);
        self.reader.next().expect("frames")
    }

    pub(crate) fn close(mut self) {
        self.send(&Message::Close(Close { reason: CloseReason::Shutdown }));
    }
}

/// Tries until it is true or patience ends.
/// Whether the daemon has answered `volcomp status`, whatever its health: exit codes 0 to 4.
pub(crate) fn is_answer(output: &Output) -> bool {
    matches!(output.status.code(), Some(0..=4))
}

pub(crate) fn eventually(mut condition: impl FnMut() -> bool) -> bool {
    let deadline = Instant::now() + PATIENCE;
    while Instant::now() < deadline {
        if condition() {
            return true;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    false
}
