//! One link as the measuring control sees it: a frame out, the answer in, the time between.

use core::net::SocketAddr;
use core::time::Duration;
use std::io::ErrorKind;
use std::net::TcpListener;
use std::time::Instant;

use hdrhistogram::Histogram;
use volcomp_protocol::{
    Axis, Close, CloseReason, ControlHello, Correction, FrameReader, MAX_FRAME, MachineState, Message, Name,
    PROTOCOL_VERSION, Position, encode,
};
use volcomp_units::axes::{AxisArray, MAX_AXES};

use super::error::BenchError;
use super::files::Axes;
use crate::control::{ControlIdentity, Wire};

/// Patience with everything that must happen.
const PATIENCE: Duration = Duration::from_secs(10);
/// Largest time that the histograms hold, ns.
const LONGEST_NS: u64 = 60_000_000_000;

/// Round trips of one side in one mode.
#[derive(Debug, Clone)]
pub struct Times {
    /// From before the write of a frame to after the read of its answer, ns.
    pub roundtrip: Histogram<u64>,
    /// Answers later than one cycle after the nominal start of theirs.
    pub late: u64,
    /// Cycles that were over before their frame could be sent.
    pub skipped: u64,
}

impl Times {
    /// Nothing measured.
    ///
    /// # Errors
    /// The histogram cannot be made.
    pub fn new() -> Result<Self, BenchError> {
        Ok(Self { roundtrip: Histogram::new_with_bounds(1, LONGEST_NS, 3)?, late: 0, skipped: 0 })
    }

    /// Share of late and skipped cycles in all that there should have been.
    #[must_use]
    pub fn late_share(&self) -> f64 {
        let all = self.roundtrip.len() + self.skipped;
        if all == 0 { 0.0 } else { (self.late + self.skipped) as f64 / all as f64 }
    }
}

/// A waiting place for one side.
#[derive(Debug)]
pub struct Place {
    listener: TcpListener,
    name: &'static str,
}

/// A connected side.
#[derive(Debug)]
pub struct Partner {
    name: &'static str,
    wire: Wire,
    reader: FrameReader,
    axes: Axes,
    origin: Instant,
    frame: [u8; MAX_FRAME],
    frame_bytes: usize,
    sequence: u32,
    /// When the last frame was made ready, and how long a cycle is.
    prepared: Duration,
    cycle: Duration,
    applied: AxisArray,
    /// The newest answer.
    pub answer: Correction,
}

impl Place {
    /// Listens on a free port of loopback.
    ///
    /// # Errors
    /// The socket's.
    pub fn open(name: &'static str) -> Result<Self, BenchError> {
        let link = |source| BenchError::Link { peer: name, source };
        let listener = TcpListener::bind(("127.0.0.1", 0)).map_err(link)?;
        listener.set_nonblocking(true).map_err(link)?;
        Ok(Self { listener, name })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// The socket's.
    pub fn address(&self) -> Result<SocketAddr, BenchError> {
        self.listener.local_addr().map_err(|source| BenchError::Link { peer: self.name, source })
    }

    /// Waits for the side to connect, over TLS where there is an identity.
    ///
    /// # Errors
    /// It does not, or the socket's.
    pub fn accept(
        &self,
        axes: Axes,
        origin: Instant,
        identity: Option<&ControlIdentity>,
    ) -> Result<Partner, BenchError> {
        let name = self.name;
        let link = |source| BenchError::Link { peer: name, source };
        let deadline = Instant::now() + PATIENCE;
        let stream = loop {
            match self.listener.accept() {
                Ok((stream, _)) => break stream,
                Err(e) if e.kind() == ErrorKind::WouldBlock => {}
                Err(e) => return Err(link(e)),
            }
            if Instant::now() > deadline {
                return Err(BenchError::Timeout {
                    peer: name,
                    what: "connect",
                    limit_s: PATIENCE.as_secs_f64(),
                });
            }
            std::thread::sleep(Duration::from_millis(1));
        };
        stream.set_nonblocking(false).map_err(link)?;
        stream.set_nodelay(true).map_err(link)?;
        let wire = match identity {
            None => Wire::plain(stream),
            Some(identity) => Wire::secure(stream, identity, deadline)
                .map_err(|(why, _)| BenchError::Ended { peer: name, said: why.to_string() })?,
        };
        wire.stream().set_read_timeout(Some(PATIENCE)).map_err(link)?;
        Ok(Partner {
            name,
            wire,
            reader: FrameReader::default(),
            axes,
            origin,
            frame: [0; MAX_FRAME],
            frame_bytes: 0,
            sequence: 0,
            prepared: Duration::ZERO,
            cycle: Duration::from_millis(1),
            applied: [0.0; MAX_AXES],
            answer: Correction::default(),
        })
    }
}

impl Partner {
    /// Exchanges hellos.
    ///
    /// # Errors
    /// The other side does not handshake.
    pub fn handshake(&mut self, cycle: Duration) -> Result<(), BenchError> {
        loop {
            self.read()?;
            match self.next()? {
                None => {}
                Some(Message::DaemonHello(_)) => break,
                Some(other) => return Err(self.ended(&other)),
            }
        }
        let names = self.axes.names();
        let axis = |k: usize| Axis::new(names[k.min(names.len() - 1)]);
        self.cycle = cycle;
        let hello = ControlHello {
            version: PROTOCOL_VERSION,
            machine: Name::new(self.axes.machine()),
            software: Name::new(concat!("cncsim bench-link ", env!("CARGO_PKG_VERSION"))),
            cycle_ns: u64::try_from(cycle.as_nanos()).unwrap_or(u64::MAX),
            axis_count: u8::try_from(names.len()).unwrap_or(u8::MAX),
            axes: core::array::from_fn(axis),
        };
        self.frame_bytes = encode(&Message::ControlHello(hello), &mut self.frame);
        self.write()
    }

    /// Makes the next position frame; not part of the round trip, as a control makes it before its cycle begins.
    pub fn prepare(&mut self) {
        let now = self.origin.elapsed();
        let commanded = self.axes.position(now.as_secs_f64());
        let mut actual = commanded;
        for (actual, applied) in actual.iter_mut().zip(&self.applied) {
            *actual += applied;
        }
        // a control counts its cycles also while the other side has its turn
        let pause = now.saturating_sub(self.prepared);
        let cycles = (pause.as_secs_f64() / self.cycle.as_secs_f64()).round().clamp(1.0, f64::from(u16::MAX));
        self.sequence = self.sequence.wrapping_add(cycles as u32);
        self.prepared = now;
        let position = Position {
            sequence: self.sequence,
            control_ns: i64::try_from(now.as_nanos()).unwrap_or(i64::MAX),
            state: MachineState::from_bits(
                MachineState::HOMED | MachineState::ENABLED | MachineState::MOVING,
            ),
            feed_mm_per_min: 1000.0,
            commanded,
            actual,
            applied: self.applied,
        };
        self.frame_bytes = encode(&Message::Position(position), &mut self.frame);
    }

    /// Sends the frame that was made ready and waits for its answer; gives when the answer was there and how long it
    /// took, ns.
    ///
    /// # Errors
    /// The link has ended.
    pub fn exchange(&mut self) -> Result<(Instant, u64), BenchError> {
        let start = Instant::now();
        self.write()?;
        loop {
            let end = self.read()?;
            while let Some(message) = self.next()? {
                match message {
                    Message::Correction(correction) => {
                        self.answer = correction;
                        self.applied = correction.offset;
                        let took = end.saturating_duration_since(start).as_nanos();
                        return Ok((end, u64::try_from(took).unwrap_or(u64::MAX)));
                    }
                    Message::Heartbeat(_) => {}
                    other => return Err(self.ended(&other)),
                }
            }
        }
    }

    /// Says goodbye.
    pub fn close(mut self) {
        self.frame_bytes = encode(&Message::Close(Close { reason: CloseReason::Shutdown }), &mut self.frame);
        // the other side may be gone already
        let _ = self.write();
    }

    /// Bytes of a frame out.
    #[must_use]
    pub const fn frame_bytes(&self) -> usize {
        self.frame_bytes
    }

    fn write(&mut self) -> Result<(), BenchError> {
        let peer = self.name;
        self.wire
            .write_all(&self.frame[..self.frame_bytes])
            .map_err(|source| BenchError::Link { peer, source })
    }

    fn read(&mut self) -> Result<Instant, BenchError> {
        let peer = self.name;
        match self.wire.read(self.reader.space()) {
            Ok(0) => Err(BenchError::Ended { peer, said: "connection closed".to_owned() }),
            Ok(count) => {
                let end = Instant::now();
                self.reader.advance(count);
                Ok(end)
            }
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                Err(BenchError::Timeout { peer, what: "answer", limit_s: PATIENCE.as_secs_f64() })
            }
            Err(source) => Err(BenchError::Link { peer, source }),
        }
    }

    fn next(&mut self) -> Result<Option<Message>, BenchError> {
        self.reader.next().map_err(|source| BenchError::Frame { peer: self.name, source })
    }

    fn ended(&self, message: &Message) -> BenchError {
        BenchError::Ended { peer: self.name, said: format!("{message:?}") }
    }
}
