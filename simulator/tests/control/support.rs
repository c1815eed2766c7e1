//! A tiny daemon for the tests of the control: real sockets, no model.

#![expect(clippy::disallowed_methods, reason = "helpers of tests with processes, sockets and files")]
#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::thread::JoinHandle;
use std::time::Duration;

use simulator::control::{Control, ControlConfig, CycleRecord, Flow, Pacing};
use simulator::motion::MachineAxes;
use volcomp::model::axes::AxisArray;
use volcomp::protocol::{
    ControlHello, Correction, CorrectionState, DaemonHello, FrameReader, MAX_FRAME, Message, Name, Position,
    encode,
};

pub(crate) const MACHINE: &str = "vmc-test";

pub(crate) fn axes() -> MachineAxes {
    MachineAxes::three_axis([0.0, 850.0], [0.0, 500.0], [-500.0, 0.0]).unwrap()
}

pub(crate) fn config() -> ControlConfig {
    let mut config = ControlConfig::new(MACHINE, axes());
    config.listen = SocketAddr::from(([127, 0, 0, 1], 0));
    config.pacing = Pacing::lock_step();
    config
}

pub(crate) fn middle() -> AxisArray {
    axes().middle()
}

pub(crate) fn control(config: ControlConfig) -> Control {
    let mut control = Control::bind(config).unwrap();
    control.set_position(middle());
    control
}

/// An observer that keeps every record.
pub(crate) fn keep(records: &mut Vec<CycleRecord>) -> impl FnMut(&CycleRecord) -> std::io::Result<Flow> {
    |r| {
        records.push(*r);
        Ok(Flow::GoOn)
    }
}

pub(crate) struct Client {
    pub(crate) stream: TcpStream,
    reader: FrameReader,
}

impl Client {
    pub(crate) fn connect(address: SocketAddr) -> Self {
        let stream = TcpStream::connect(address).unwrap();
        stream.set_nodelay(true).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        Self { stream, reader: FrameReader::default() }
    }

    pub(crate) fn send(&mut self, message: &Message) -> bool {
        let mut buffer = [0; MAX_FRAME];
        let n = encode(message, &mut buffer);
        self.stream.write_all(&buffer[..n]).is_ok()
    }

    /// `None` at the end of the stream.
    pub(crate) fn receive(&mut self) -> Option<Message> {
        loop {
            if let Some(message) = self.reader.next().unwrap() {
                return Some(message);
            }
            match self.stream.read(self.reader.space()) {
                Ok(0) => return None,
                Ok(n) => self.reader.advance(n),
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(e) if e.kind() == ErrorKind::ConnectionReset => return None,
                Err(e) => panic!("nothing came: {e}"),
            }
        }
    }

    pub(crate) fn hello(version: u8, machine: &str) -> Message {
        Message::DaemonHello(DaemonHello {
            version_min: version,
            version_max: version,
            machine: Name::new(machine),
            software: Name::new("test daemon"),
        })
    }

    pub(crate) fn handshake(address: SocketAddr) -> (Self, ControlHello) {
        let mut client = Self::connect(address);
        assert!(client.send(&Self::hello(1, MACHINE)));
        match client.receive() {
            Some(Message::ControlHello(hello)) => (client, hello),
            other => panic!("no ControlHello but {other:?}"),
        }
    }

    /// Answers positions until the function says stop or the control leaves; what the control said last.
    pub(crate) fn serve(&mut self, mut answer: impl FnMut(&Position) -> Reply) -> Option<Message> {
        loop {
            let message = self.receive()?;
            match message {
                Message::Position(position) => {
                    let (state, x) = match answer(&position) {
                        Reply::Offset(x) => (CorrectionState::Active, x),
                        Reply::Correction(state, x) => (state, x),
                        Reply::Silence => continue,
                        Reply::Stop => return None,
                    };
                    let mut c = Correction { sequence: position.sequence, state, ..Correction::default() };
                    c.offset[0] = x;
                    if !self.send(&Message::Correction(c)) {
                        return None;
                    }
                }
                Message::Tool(_) | Message::Heartbeat(_) => {}
                other => return Some(other),
            }
        }
    }
}

/// What the test daemon does with a position.
pub(crate) enum Reply {
    /// An offset of the first axis, active.
    Offset(f64),
    /// An offset of the first axis in any state.
    #[allow(dead_code, reason = "only the tests of the monitor say another state")]
    Correction(CorrectionState, f64),
    Silence,
    Stop,
}

/// A daemon in a thread that lives as long as its control.
pub(crate) fn daemon(
    address: SocketAddr,
    answer: impl FnMut(&Position) -> Reply + Send + 'static,
) -> JoinHandle<Option<Message>> {
    std::thread::spawn(move || Client::handshake(address).0.serve(answer))
}
