//! What is recorded: every input of the engine with its exact time, and what the engine answered.

use crate::{ControlHello, CorrectionState, Position, Tool};
use volcomp_units::MonoTime;
use volcomp_units::axes::AxisArray;

/// Channels of live values that an entry can carry.
pub const LIVE_MAX: usize = 32;

/// One thing that went into the engine, or that belongs to it. Fixed size, `Copy`: it crosses the queue as it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Entry {
    /// A position frame and its answer.
    Cycle(Cycle),
    /// No position came in time: the engine's deadline, and its answer.
    Deadline {
        /// When the engine was called.
        now: MonoTime,
        /// Whether compensation is wanted after it.
        enabled: bool,
        /// What it answered, if anything.
        answer: Option<Answer>,
    },
    /// The tool changed.
    Tool {
        /// When the engine received it.
        now: MonoTime,
        /// The tool.
        tool: Tool,
    },
    /// A command of the operator or the service.
    Request {
        /// When the engine received it.
        now: MonoTime,
        /// The command.
        request: Request,
    },
    /// A link came up.
    LinkUp {
        /// When the engine received it.
        now: MonoTime,
    },
    /// The link went down.
    LinkDown {
        /// When the engine received it.
        now: MonoTime,
    },
    /// A new engine for the control that said this hello.
    Engine {
        /// When it was made.
        now: MonoTime,
        /// The hello.
        hello: ControlHello,
    },
    /// The engine goes on with another model.
    Model {
        /// When it was received.
        now: MonoTime,
        /// BLAKE3 of the model file.
        hash: [u8; 32],
    },
    /// Entries found no place in the queue or on the disk.
    Gap {
        /// When the first entry after the gap came.
        now: MonoTime,
        /// How many.
        dropped: u64,
        /// How things stand after the gap.
        context: Context,
    },
    /// Live values of the sensors that the model names, in its order; mm or rad.
    Live {
        /// When the engine received it.
        now: MonoTime,
        /// Bit k: channel k was received.
        told: u32,
        /// The values; 0 where none was received.
        values: [f64; LIVE_MAX],
    },
}

/// A position frame and its answer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cycle {
    /// When the engine got the frame, on the daemon's clock.
    pub now: MonoTime,
    /// The frame as it came: mm or deg.
    pub frame: Position,
    /// Whether compensation is wanted after it.
    pub enabled: bool,
    /// The answer; none before the control has told which offset it holds.
    pub answer: Option<Answer>,
}

/// What the engine answered.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Answer {
    /// The frame that is answered.
    pub sequence: u32,
    /// State after it.
    pub state: CorrectionState,
    /// Bit k: axis k is limited in size, rate or acceleration.
    pub limited: u8,
    /// Bit k: axis k is above its warning limit.
    pub warning: u8,
    /// Bit k: axis k is outside the travel or a curve's range of the model.
    pub out_of_range: u8,
    /// Bit k: harmonics of axis k have faded at this feed.
    pub faded: u8,
    /// Control cycles from a position to the effect of its correction; 0 before it was measured.
    pub lag_cycles: u8,
    /// A stop has been carried out.
    pub stopped: bool,
    /// Offset asked for, as it was sent: mm or deg.
    pub offset: AxisArray,
    /// The model's correction times the gain, before ramps and limits: mm or deg.
    pub wanted: AxisArray,
    /// The change of state in this cycle.
    pub change: Option<Change>,
}

/// A change of state; the one entered stands in the [`Answer`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Change {
    /// The state left.
    pub from: CorrectionState,
    /// Number of the cause in the catalogue of faults (`volcomp explain`).
    pub cause: u16,
}

/// A command with its argument. The codes stand in [`request`]; one that a reader does not know is an input that it
/// cannot repeat, and it says so.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Request {
    /// Which command.
    pub code: u8,
    /// Its argument; 0 where it has none.
    pub value: f64,
}

/// Codes of commands in recordings. Codes are never given to another command.
pub mod request {
    /// Compensate as soon as the machine is ready.
    pub const ENABLE: u8 = 1;
    /// Ramp out and stay off.
    pub const DISABLE: u8 = 2;
    /// Change the share of the correction; the argument is the share.
    pub const SET_GAIN: u8 = 3;
    /// Ramp to the rest offset and be done.
    pub const STOP: u8 = 4;
    /// Leave the faulted state.
    pub const CLEAR_FAULT: u8 = 5;
    /// The engine before this one was faulted: so is this one.
    pub const KEEP_FAULT: u8 = 6;
}

/// How things stand where a block begins or a gap ends: enough to let an engine catch up.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Context {
    /// Hello of the control that the engine was made for; `None` before the first.
    pub hello: Option<ControlHello>,
    /// Whether the link is up.
    pub link: bool,
    /// Whether compensation is wanted.
    pub enabled: bool,
    /// Share of the correction asked for, where a command set one.
    pub gain: Option<f64>,
    /// The tool that the control told last.
    pub tool: Option<Tool>,
    /// Model of the engine, where it is not the one of the file's beginning.
    pub model: Option<[u8; 32]>,
}

impl Entry {
    /// When it happened, on the daemon's clock.
    #[must_use]
    pub const fn now(&self) -> MonoTime {
        match self {
            Self::Cycle(Cycle { now, .. })
            | Self::Deadline { now, .. }
            | Self::Tool { now, .. }
            | Self::Request { now, .. }
            | Self::LinkUp { now }
            | Self::LinkDown { now }
            | Self::Engine { now, .. }
            | Self::Model { now, .. }
            | Self::Gap { now, .. }
            | Self::Live { now, .. } => *now,
        }
    }
}

impl Context {
    /// Number of axes on the link; 0 before the first hello.
    #[must_use]
    pub fn axes(&self) -> usize {
        self.hello.as_ref().map_or(0, |hello| hello.used_axes().len())
    }

    /// Takes over what an entry changes.
    ///
    /// # Cycle   no allocation, no panic, bounded time
    pub fn follow(&mut self, entry: &Entry) {
        match entry {
            Entry::Cycle(cycle) => self.enabled = cycle.enabled,
            Entry::Deadline { enabled, .. } => self.enabled = *enabled,
            Entry::Tool { tool, .. } => self.tool = Some(*tool),
            Entry::Request { request, .. } => match request.code {
                request::ENABLE => self.enabled = true,
                request::DISABLE | request::STOP | request::CLEAR_FAULT | request::KEEP_FAULT => {
                    self.enabled = false;
                }
                request::SET_GAIN => self.gain = Some(request.value),
                _ => {}
            },
            Entry::LinkUp { .. } => {
                self.link = true;
                self.tool = None;
            }
            Entry::LinkDown { .. } => {
                self.link = false;
                self.tool = None;
            }
            Entry::Engine { hello, .. } => {
                *self = Self { hello: Some(*hello), model: self.model, ..Self::default() }
            }
            Entry::Model { hash, .. } => self.model = Some(*hash),
            Entry::Gap { context, .. } => *self = *context,
            Entry::Live { .. } => {}
        }
    }
}
