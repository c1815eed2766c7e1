//! The driver for controls without frames: positions are read and offsets written by separate calls
//! (`docs/reference/read-write.md`).
//!
//! The daemon asks, the control replies, in order. Positions are read at an interval of the daemon's own; a sample that was
//! read before carries no message. How long a call takes is measured and told; the time from a sample to the effect of
//! its offset is measured by the engine from the offsets that the control reports as applied, and looked ahead over.

use std::io;
use std::time::Duration;

use super::connection::Connection;
use super::link::{CallTimes, ControlLink, LifeSigns, Received};
use volcomp_protocol::read_write::{HOLD_MAX_MS, LINE_MAX, LineError, LineReader, Machine, Reply, Request};
use volcomp_protocol::{
    Axis, CloseReason, ControlHello, Correction, CorrectionState, ErrorCode, ErrorReport, FrameError,
    Message, Name, PROTOCOL_VERSION,
};
use volcomp_units::{MonoTime, NS_PER_S};

/// Share of a new call time in the mean.
const MEAN_OF: i64 = 64;

/// A link of calls.
#[derive(Debug)]
pub(super) struct ReadWriteLink {
    connection: Connection,
    lines: LineReader,
    out: [u8; LINE_MAX],
    /// Axes of the control; none before it has said which.
    axes: usize,
    poll_ns: i64,
    next_read: MonoTime,
    /// Since when the reply to a read is due.
    reading: Option<MonoTime>,
    /// Since when the confirmation of a write is due, and of how many.
    writing: Option<MonoTime>,
    unconfirmed: u32,
    /// State sent to the control last.
    state: Option<CorrectionState>,
    machine_due: bool,
    tool: ToolKnown,
    last_sequence: Option<u32>,
    times: CallTimes,
    skipped: u64,
    life_signs: LifeSigns,
}

/// What is known of the tool in the spindle: positions count only once it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ToolKnown {
    /// To be asked for, once the control has said who it is.
    No,
    /// Asked for.
    Asked,
    /// Its number; `None` where the control does not know its tools.
    Yes(Option<u32>),
}

impl ReadWriteLink {
    pub(super) fn new(connection: Connection, poll_s: f64) -> Self {
        let now = connection.now();
        Self {
            connection,
            lines: LineReader::default(),
            out: [0; LINE_MAX],
            axes: 0,
            poll_ns: (poll_s * NS_PER_S) as i64,
            next_read: now,
            reading: None,
            writing: None,
            unconfirmed: 0,
            state: None,
            machine_due: false,
            tool: ToolKnown::No,
            last_sequence: None,
            times: CallTimes::default(),
            skipped: 0,
            life_signs: LifeSigns { received: now, sent: now },
        }
    }

    fn request(&mut self, request: &Request) -> io::Result<()> {
        let length = request.write(self.axes, &mut self.out);
        self.connection.send(&self.out[..length])?;
        self.life_signs.sent = self.connection.now();
        Ok(())
    }

    /// Asks for the tool where it is not known, and for positions where they are due.
    fn ask(&mut self) -> io::Result<()> {
        if self.axes == 0 || self.reading.is_some() {
            return Ok(());
        }
        match self.tool {
            ToolKnown::No => {
                self.tool = ToolKnown::Asked;
                self.request(&Request::Tool)
            }
            ToolKnown::Asked => Ok(()),
            ToolKnown::Yes(_) => {
                let now = self.connection.now();
                if now < self.next_read {
                    return Ok(());
                }
                // a late read does not make the next ones follow each other without a pause
                let next = self.next_read.ns.saturating_add(self.poll_ns).max(now.ns);
                self.next_read = MonoTime::from_ns(next);
                self.reading = Some(now);
                self.request(&Request::Position)
            }
        }
    }

    fn write(&mut self, correction: &Correction) -> io::Result<()> {
        self.show(correction.state)?;
        self.write_one(&Request::Offset(correction.offset))
    }

    fn write_one(&mut self, request: &Request) -> io::Result<()> {
        self.request(request)?;
        self.unconfirmed = self.unconfirmed.saturating_add(1);
        self.writing.get_or_insert(self.life_signs.sent);
        Ok(())
    }

    /// The message that a reply stands for, if any.
    fn take(&mut self, reply: &Reply) -> Result<Option<Message>, LineError> {
        let unexpected = |expected| Err(LineError::Unexpected { expected });
        match reply {
            Reply::Machine(machine) => {
                if !core::mem::take(&mut self.machine_due) {
                    return unexpected("a reply that was asked for");
                }
                if !(1..=HOLD_MAX_MS).contains(&machine.hold_ms) {
                    return Err(LineError::Watchdog { hold_ms: machine.hold_ms });
                }
                let poll_ms = self.poll_ns as f64 / NS_PER_S * 1e3;
                if poll_ms >= f64::from(machine.hold_ms) {
                    return Err(LineError::Poll { hold_ms: machine.hold_ms, poll_ms: poll_ms.ceil() as u32 });
                }
                self.axes = machine.axis_count;
                Ok(Some(Message::ControlHello(hello(machine))))
            }
            Reply::Tool(tool) => {
                if self.tool != ToolKnown::Asked {
                    return unexpected("a reply that was asked for");
                }
                self.tool = ToolKnown::Yes(tool.map(|t| t.number));
                Ok(tool.map(Message::Tool))
            }
            Reply::Position(position, tool) => {
                let Some(since) = self.reading.take() else {
                    return unexpected("a reply that was asked for");
                };
                mean(&mut self.times.read_ns, self.connection.now().ns - since.ns);
                if self.tool != ToolKnown::Yes(*tool) {
                    // the tip of another tool: nothing is computed before it is known
                    self.tool = ToolKnown::No;
                    return Ok(None);
                }
                let is_known = self.last_sequence.replace(position.sequence) == Some(position.sequence);
                Ok((!is_known).then_some(Message::Position(*position)))
            }
            Reply::Done => {
                self.unconfirmed = match self.unconfirmed.checked_sub(1) {
                    Some(left) => left,
                    None => return unexpected("a reply that was asked for"),
                };
                if let Some(since) = self.writing.take() {
                    let now = self.connection.now();
                    mean(&mut self.times.write_ns, now.ns - since.ns);
                    self.writing = (self.unconfirmed > 0).then_some(now);
                }
                Ok(None)
            }
            Reply::Error { is_busy, detail } => {
                let code = if *is_busy { ErrorCode::Busy } else { ErrorCode::Unexpected };
                Ok(Some(Message::Error(ErrorReport { code, detail: *detail })))
            }
        }
    }
}

impl ControlLink for ReadWriteLink {
    fn receive(&mut self, wait: Duration) -> io::Result<Received> {
        self.ask()?;
        let mut wait = wait;
        if self.reading.is_none() && matches!(self.tool, ToolKnown::Yes(_)) {
            let left = self.next_read.ns.saturating_sub(self.connection.now().ns);
            wait = wait.min(Duration::from_nanos(u64::try_from(left).unwrap_or(0)));
        }
        let received = self.connection.receive(wait, self.lines.space())?;
        if let Received::Bytes { count, .. } = received {
            self.lines.advance(count);
        }
        Ok(received)
    }

    fn next_message(&mut self) -> Result<Option<Message>, FrameError> {
        loop {
            let Some(line) = self.lines.next_line()? else { return Ok(None) };
            let reply = Reply::parse(line, self.axes)?;
            match self.take(&reply)? {
                Some(message) => return Ok(Some(message)),
                None => self.skipped = self.skipped.wrapping_add(1),
            }
        }
    }

    fn skipped(&self) -> u64 {
        self.skipped
    }

    fn send(&mut self, message: &Message) -> io::Result<()> {
        match message {
            Message::DaemonHello(_) => {
                self.machine_due = true;
                self.request(&Request::Machine)
            }
            Message::Correction(correction) => self.write(correction),
            // the calls themselves are the life sign, and there is nobody to tell anything else
            _ => {
                self.life_signs.sent = self.connection.now();
                Ok(())
            }
        }
    }

    fn show(&mut self, state: CorrectionState) -> io::Result<()> {
        if self.last_sequence.is_none() || self.state.replace(state) == Some(state) {
            return Ok(());
        }
        self.write_one(&Request::State(state))
    }

    fn send_heartbeat(&mut self) -> io::Result<()> {
        self.life_signs.sent = self.connection.now();
        Ok(())
    }

    fn life_signs(&mut self) -> &mut LifeSigns {
        &mut self.life_signs
    }

    fn call_times(&self) -> Option<CallTimes> {
        Some(self.times)
    }

    fn close(mut self: Box<Self>, error: Option<(ErrorCode, &str)>, reason: CloseReason) {
        // a control that was refused is not told to do anything with its offset
        if self.last_sequence.is_some() {
            let keep = error.is_none() && reason == CloseReason::Shutdown;
            // the link ends either way, and the control's watchdog takes out what is left
            let _ = self.request(&Request::Release { keep });
        }
        self.connection.close();
    }
}

fn mean(mean: &mut i64, value: i64) {
    *mean = if *mean == 0 { value } else { *mean + (value - *mean) / MEAN_OF };
}

fn hello(machine: &Machine) -> ControlHello {
    let axis = |k: usize| Axis::new(machine.axes[if k < machine.axis_count { k } else { 0 }]);
    ControlHello {
        version: PROTOCOL_VERSION,
        machine: machine.machine,
        software: Name::new("read and write"),
        cycle_ns: machine.cycle_ns,
        axis_count: machine.axis_count as u8,
        axes: core::array::from_fn(axis),
    }
}
