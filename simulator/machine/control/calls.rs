//! A control without frames: it replies to calls that read its positions and write its offsets (`docs/reference/read-write.md`).
//!
//! A read gets the sample of the present cycle, once; a second read within the cycle waits for the next one. An offset that is
//! written answers the newest sample that was read.

use volcomp_protocol::read_write::{LINE_MAX, LineReader, Machine, Reply, Request};
use volcomp_protocol::{
    Close, CloseReason, ControlHello, Correction, CorrectionState, FrameError, Message, Position, Tool,
};

/// Calls that have come in, and what the control replies.
#[derive(Debug)]
pub(super) struct Calls {
    lines: LineReader,
    machine: Machine,
    tool: Option<Tool>,
    sample: Position,
    /// The sample has not been read yet.
    is_fresh: bool,
    /// A read waits for the next sample.
    is_asked: bool,
    /// What the daemon says that it is doing.
    state: CorrectionState,
    /// Number of the newest sample that was read.
    read: u32,
    out: [u8; LINE_MAX],
}

impl Calls {
    /// A daemon that has not asked for anything.
    pub(super) fn new(hello: &ControlHello, hold_ms: u32, tool: Option<Tool>) -> Self {
        let machine = Machine {
            cycle_ns: hello.cycle_ns,
            hold_ms,
            axes: hello.axes.map(|a| a.name),
            axis_count: usize::from(hello.axis_count),
            machine: hello.machine,
        };
        Self {
            lines: LineReader::default(),
            machine,
            tool,
            sample: Position::default(),
            is_fresh: false,
            is_asked: false,
            state: CorrectionState::Off,
            read: 0,
            out: [0; LINE_MAX],
        }
    }

    pub(super) fn space(&mut self) -> &mut [u8] {
        self.lines.space()
    }

    pub(super) fn advance(&mut self, count: usize) {
        self.lines.advance(count);
    }

    /// The sample of the last cycle is old: a read waits for the next one.
    pub(super) const fn age(&mut self) {
        self.is_fresh = false;
    }

    /// What the next call asks for: a line to reply with, or a message to the cycle.
    pub(super) fn next(&mut self) -> Result<Option<Call>, FrameError> {
        let axes = self.machine.axis_count;
        let Some(line) = self.lines.next_line()? else { return Ok(None) };
        Ok(Some(match Request::parse(line, axes)? {
            Request::Machine => self.reply(Reply::Machine(self.machine), None),
            Request::Tool => self.reply(Reply::Tool(self.tool), None),
            Request::Position => {
                self.is_asked = true;
                if self.is_fresh { self.answer() } else { Call { length: 0, message: None } }
            }
            Request::Offset(offset) => {
                let correction = Correction { sequence: self.read, state: self.state, limited: 0, offset };
                self.reply(Reply::Done, Some(Message::Correction(correction)))
            }
            Request::State(state) => {
                self.state = state;
                self.reply(Reply::Done, None)
            }
            Request::Release { keep } => {
                let reason = if keep { CloseReason::Shutdown } else { CloseReason::Error };
                self.reply(Reply::Done, Some(Message::Close(Close { reason })))
            }
        }))
    }

    /// Length of the line that a message of the cycle becomes, if any.
    pub(super) fn line_for(&mut self, message: &Message) -> Option<usize> {
        let call = match message {
            Message::Position(sample) => {
                (self.sample, self.is_fresh) = (*sample, true);
                if !self.is_asked {
                    return None;
                }
                self.answer()
            }
            Message::Tool(tool) => {
                self.tool = Some(*tool);
                return None;
            }
            Message::Error(error) => self.reply(Reply::Error { is_busy: false, detail: error.detail }, None),
            // a control that stands still still replies
            Message::Heartbeat(_) if self.is_asked => self.answer(),
            _ => return None,
        };
        Some(call.length)
    }

    /// The line that is ready.
    pub(super) fn line(&self, length: usize) -> &[u8] {
        &self.out[..length]
    }

    fn answer(&mut self) -> Call {
        (self.is_asked, self.is_fresh) = (false, false);
        self.read = self.sample.sequence;
        self.reply(Reply::Position(self.sample, self.tool.map(|t| t.number)), None)
    }

    fn reply(&mut self, reply: Reply, message: Option<Message>) -> Call {
        Call { length: reply.write(self.machine.axis_count, &mut self.out), message }
    }
}

/// What a call leads to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Call {
    /// Bytes of [`Calls::line`] to reply with; 0: the reply has to wait.
    pub(super) length: usize,
    /// For the cycle.
    pub(super) message: Option<Message>,
}
