//! A control that is read and written by separate calls: lines of text, one request, one reply (`docs/reference/read-write.md`).
//!
//! Nothing here allocates: lines are parsed and written in fixed buffers. Numbers are printed so that they are read back
//! bit by bit.

use core::fmt::{self, Write as _};
use core::str::FromStr;

use super::message::{CorrectionState, MachineState, Name, Position, Tool};
use volcomp_units::axes::{AxisArray, AxisName, MAX_AXES};

/// Longest line with its line feed, bytes: a position of eight axes has at most some 700.
pub const LINE_MAX: usize = 1024;
/// Longest time for which a control may hold an offset without being written to, ms.
pub const HOLD_MAX_MS: u32 = 1000;

/// Why a line is no request or reply. The stream has lost its meaning: close the link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum LineError {
    /// No line feed within [`LINE_MAX`].
    #[error("line: no line feed within {LINE_MAX} bytes")]
    Length,
    /// Bytes beyond ASCII.
    #[error("line: byte {at} is not ASCII")]
    NotText {
        /// Offset in the line.
        at: usize,
    },
    /// A first word that is no call, or one that is not due.
    #[error("line: not {expected}")]
    Unexpected {
        /// What was due.
        expected: &'static str,
    },
    /// A field that is missing or no number of its kind.
    #[error("line: {field} is missing or no number")]
    Field {
        /// The field.
        field: &'static str,
    },
    /// More fields than the call has.
    #[error("line: {call} has more than {fields} fields")]
    Excess {
        /// The call.
        call: &'static str,
        /// Number of its fields.
        fields: usize,
    },
    /// A control that would keep an offset for ever when the daemon is gone.
    #[error(
        "the control holds an offset for {hold_ms} ms without a write, must be 1 to {HOLD_MAX_MS}: set its watchdog"
    )]
    Watchdog {
        /// What the control says.
        hold_ms: u32,
    },
    /// A control that takes the offset out between two writes.
    #[error(
        "the control holds an offset for {hold_ms} ms without a write, link.poll-ms is {poll_ms}: the hold time must be longer; \
         raise it in the control, or lower poll-ms"
    )]
    Poll {
        /// What the control says.
        hold_ms: u32,
        /// Interval between two writes, ms, rounded up.
        poll_ms: u32,
    },
}

/// What the daemon asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Request {
    /// Who is there.
    Machine,
    /// The tool in the spindle.
    Tool,
    /// The newest sample of the positions.
    Position,
    /// Origin offset to apply, mm or deg.
    Offset(AxisArray),
    /// What the daemon is doing, for the control's own display; written where it has changed.
    State(CorrectionState),
    /// The daemon leaves; `keep`: the offset stays, else the control takes it out.
    Release {
        /// The offset stays.
        keep: bool,
    },
}

/// What a control says of itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Machine {
    /// Interval between samples, ns.
    pub cycle_ns: u64,
    /// The control takes an offset out by itself when it has not been written for this long, ms.
    pub hold_ms: u32,
    /// Axes in the order of their values.
    pub axes: [AxisName; MAX_AXES],
    /// Number of axes.
    pub axis_count: usize,
    /// Machine id.
    pub machine: Name,
}

/// What the control replies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reply {
    /// To [`Request::Machine`].
    Machine(Machine),
    /// To [`Request::Tool`]; `None`: the control does not know its tools.
    Tool(Option<Tool>),
    /// To [`Request::Position`], with the number of the tool in the spindle.
    Position(Position, Option<u32>),
    /// To every write.
    Done,
    /// The call failed, or the control has another daemon already.
    Error {
        /// Another daemon is connected.
        is_busy: bool,
        /// A word about it, for logs.
        detail: Name,
    },
}

impl Request {
    /// Writes the line; returns its length.
    pub fn write(&self, axes: usize, out: &mut [u8; LINE_MAX]) -> usize {
        let mut line = Line { out, length: 0 };
        match self {
            Self::Machine => line.word("READ machine"),
            Self::Tool => line.word("READ tool"),
            Self::Position => line.word("READ position"),
            Self::Offset(offset) => {
                line.word("WRITE offset");
                line.values(&offset[..axes.min(MAX_AXES)]);
            }
            Self::State(state) => {
                line.word("WRITE state");
                line.item(state.code());
            }
            Self::Release { keep: true } => line.word("WRITE release keep"),
            Self::Release { keep: false } => line.word("WRITE release remove"),
        }
        line.end()
    }

    /// Reads a line without its line feed.
    ///
    /// # Errors
    /// It is no request.
    pub fn parse(line: &[u8], axes: usize) -> Result<Self, LineError> {
        let text = ascii(line)?;
        match text {
            "READ machine" => Ok(Self::Machine),
            "READ tool" => Ok(Self::Tool),
            "READ position" => Ok(Self::Position),
            "WRITE release keep" => Ok(Self::Release { keep: true }),
            "WRITE release remove" => Ok(Self::Release { keep: false }),
            _ => {
                if let Some(code) = text.strip_prefix("WRITE state ") {
                    let state = CorrectionState::from_code(number(code, "state")?);
                    return state.map(Self::State).ok_or(LineError::Field { field: "state" });
                }
                let rest = text.strip_prefix("WRITE offset ").ok_or(LineError::Unexpected {
                    expected: "READ machine|tool|position or WRITE offset|state|release",
                })?;
                let mut fields = Fields::new("WRITE offset", rest, axes);
                let offset = fields.values("offset", axes)?;
                fields.end()?;
                Ok(Self::Offset(offset))
            }
        }
    }
}

impl Reply {
    /// Writes the line; returns its length.
    pub fn write(&self, axes: usize, out: &mut [u8; LINE_MAX]) -> usize {
        let mut line = Line { out, length: 0 };
        match self {
            Self::Machine(m) => {
                line.word("machine");
                line.item(m.cycle_ns);
                line.item(m.hold_ms);
                line.word(" ");
                for axis in &m.axes[..m.axis_count.min(MAX_AXES)] {
                    line.letter(*axis);
                }
                line.item(m.machine);
            }
            Self::Tool(None) => line.word("tool none"),
            Self::Tool(Some(tool)) => {
                line.word("tool");
                line.item(tool.number);
                line.values(&tool.tip);
            }
            Self::Position(p, tool) => {
                line.word("position");
                line.item(p.sequence);
                line.item(p.control_ns);
                line.item(p.state.bits);
                line.number(p.feed_mm_per_min);
                match tool {
                    Some(number) => line.item(number),
                    None => line.word(" none"),
                }
                for values in [&p.commanded, &p.actual, &p.applied] {
                    line.values(&values[..axes.min(MAX_AXES)]);
                }
            }
            Self::Done => line.word("ok"),
            Self::Error { is_busy, detail } => {
                line.word(if *is_busy { "busy" } else { "error" });
                line.item(detail);
            }
        }
        line.end()
    }

    /// Reads a line without its line feed.
    ///
    /// # Errors
    /// It is no reply.
    pub fn parse(line: &[u8], axes: usize) -> Result<Self, LineError> {
        let text = ascii(line)?;
        let (call, rest) = text.split_once(' ').unwrap_or((text, ""));
        match call {
            "machine" => machine(rest).map(Self::Machine),
            "tool" if rest == "none" => Ok(Self::Tool(None)),
            "tool" => {
                let mut fields = Fields::new("tool", rest, 4);
                let number = fields.item("tool number")?;
                let tip = fields.values("tool tip", 3)?;
                fields.end()?;
                Ok(Self::Tool(Some(Tool { number, tip: [tip[0], tip[1], tip[2]] })))
            }
            "position" => position(rest, axes),
            "ok" if rest.is_empty() => Ok(Self::Done),
            "error" | "busy" => Ok(Self::Error { is_busy: call == "busy", detail: Name::new(rest) }),
            _ => Err(LineError::Unexpected { expected: "machine, tool, position, ok, error or busy" }),
        }
    }
}

fn machine(rest: &str) -> Result<Machine, LineError> {
    let mut parts = rest.splitn(4, ' ');
    let mut next = |field| parts.next().ok_or(LineError::Field { field });
    let cycle_ns = number(next("cycle")?, "cycle")?;
    let hold_ms = number(next("hold time")?, "hold time")?;
    let letters = next("axes")?;
    let id = next("machine id")?;
    let mut axes = [AxisName::X; MAX_AXES];
    let mut axis_count = 0;
    for letter in letters.chars() {
        let name = AxisName::from_letter(letter).ok_or(LineError::Field { field: "axis letter" })?;
        *axes.get_mut(axis_count).ok_or(LineError::Excess { call: "machine", fields: MAX_AXES })? = name;
        axis_count += 1;
    }
    if id.is_empty() || id.len() > Name::MAX {
        return Err(LineError::Field { field: "machine id" });
    }
    if axis_count == 0 {
        return Err(LineError::Field { field: "axes" });
    }
    Ok(Machine { cycle_ns, hold_ms, axes, axis_count, machine: Name::new(id) })
}

fn position(rest: &str, axes: usize) -> Result<Reply, LineError> {
    let mut fields = Fields::new("position", rest, 5 + 3 * axes);
    let sequence = fields.item("sequence")?;
    let control_ns = fields.item("time")?;
    let bits: u16 = fields.item("state")?;
    let feed_mm_per_min = fields.item("feed")?;
    let tool = match fields.word("tool number")? {
        "none" => None,
        text => Some(number(text, "tool number")?),
    };
    let commanded = fields.values("commanded position", axes)?;
    let actual = fields.values("actual position", axes)?;
    let applied = fields.values("applied offset", axes)?;
    fields.end()?;
    let state = MachineState::from_bits(bits);
    Ok(Reply::Position(
        Position { sequence, control_ns, state, feed_mm_per_min, commanded, actual, applied },
        tool,
    ))
}

fn ascii(line: &[u8]) -> Result<&str, LineError> {
    let line = line.strip_suffix(b"\r").unwrap_or(line);
    match line.iter().position(|b| !b.is_ascii()) {
        Some(at) => Err(LineError::NotText { at }),
        None => core::str::from_utf8(line).map_err(|e| LineError::NotText { at: e.valid_up_to() }),
    }
}

fn number<T: FromStr>(text: &str, field: &'static str) -> Result<T, LineError> {
    text.parse().map_err(|_| LineError::Field { field })
}

/// Fields separated by single spaces.
struct Fields<'a> {
    call: &'static str,
    count: usize,
    rest: core::str::Split<'a, char>,
}

impl<'a> Fields<'a> {
    fn new(call: &'static str, rest: &'a str, count: usize) -> Self {
        Self { call, count, rest: rest.split(' ') }
    }

    fn word(&mut self, field: &'static str) -> Result<&'a str, LineError> {
        self.rest.next().ok_or(LineError::Field { field })
    }

    fn item<T: FromStr>(&mut self, field: &'static str) -> Result<T, LineError> {
        number(self.word(field)?, field)
    }

    fn values(&mut self, field: &'static str, count: usize) -> Result<AxisArray, LineError> {
        let mut values = AxisArray::default();
        for value in values.iter_mut().take(count) {
            *value = self.item(field)?;
        }
        Ok(values)
    }

    fn end(mut self) -> Result<(), LineError> {
        match self.rest.next() {
            None => Ok(()),
            Some(_) => Err(LineError::Excess { call: self.call, fields: self.count }),
        }
    }
}

/// A line that is being written; what does not fit is cut, and the reader finds too few fields.
struct Line<'a> {
    out: &'a mut [u8; LINE_MAX],
    length: usize,
}

impl fmt::Write for Line<'_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        // the last byte is that of the line feed
        let room = LINE_MAX - 1 - self.length;
        let bytes = &text.as_bytes()[..text.len().min(room)];
        self.out[self.length..self.length + bytes.len()].copy_from_slice(bytes);
        self.length += bytes.len();
        Ok(())
    }
}

impl Line<'_> {
    fn word(&mut self, word: &str) {
        // a line takes whatever fits
        let _ = self.write_str(word);
    }

    fn letter(&mut self, axis: AxisName) {
        let _ = write!(self, "{axis}");
    }

    fn item(&mut self, value: impl fmt::Display) {
        let _ = write!(self, " {value}");
    }

    fn number(&mut self, value: f64) {
        // either way the shortest digits that are read back as the same number
        if value == 0.0 || (1e-6..1e9).contains(&value.abs()) {
            self.item(value);
        } else {
            self.item(format_args!("{value:e}"));
        }
    }

    fn values(&mut self, values: &[f64]) {
        values.iter().for_each(|v| self.number(*v));
    }

    const fn end(self) -> usize {
        self.out[self.length] = b'\n';
        self.length + 1
    }
}

/// Lines out of a byte stream; a fixed buffer, nothing allocated.
#[derive(Debug, Clone)]
pub struct LineReader {
    buffer: [u8; 4 * LINE_MAX],
    start: usize,
    end: usize,
    /// Up to here there is no line feed.
    searched: usize,
}

impl Default for LineReader {
    fn default() -> Self {
        Self { buffer: [0; 4 * LINE_MAX], start: 0, end: 0, searched: 0 }
    }
}

impl LineReader {
    /// The free space to read socket bytes into; never empty after [`LineReader::next_line`] returned `Ok(None)`.
    pub fn space(&mut self) -> &mut [u8] {
        if self.buffer.len() - self.end < LINE_MAX && self.start > 0 {
            self.buffer.copy_within(self.start..self.end, 0);
            self.end -= self.start;
            self.searched -= self.start;
            self.start = 0;
        }
        &mut self.buffer[self.end..]
    }

    /// Says that `count` bytes were written into [`LineReader::space`].
    pub fn advance(&mut self, count: usize) {
        self.end = self.end.saturating_add(count).min(self.buffer.len());
    }

    /// The next line without its line feed, `None` where more bytes are needed.
    ///
    /// # Errors
    /// No line feed within [`LINE_MAX`].
    pub fn next_line(&mut self) -> Result<Option<&[u8]>, LineError> {
        let fresh = &self.buffer[self.searched..self.end];
        let Some(at) = fresh.iter().position(|b| *b == b'\n').map(|at| self.searched + at) else {
            self.searched = self.end;
            if self.end - self.start >= LINE_MAX {
                return Err(LineError::Length);
            }
            return Ok(None);
        };
        let line = self.start..at;
        self.start = at + 1;
        self.searched = self.start;
        if line.len() >= LINE_MAX {
            return Err(LineError::Length);
        }
        Ok(Some(&self.buffer[line]))
    }
}
