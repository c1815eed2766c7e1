//! What control and daemon say to each other. Linear axes in mm, rotary axes in degrees on the wire.

use core::fmt;

use super::error::NameFault;
use volcomp_units::axes::{AxisArray, AxisName, MAX_AXES};

/// A short name on the wire: up to 32 bytes of UTF-8, padded with zeros.
#[derive(Clone, Copy, PartialEq, Eq, Default)]
pub struct Name {
    bytes: [u8; Name::MAX],
}

/// Unit of an axis on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AxisUnit {
    /// Linear axes.
    #[default]
    Millimetre = 1,
    /// Rotary axes.
    Degree = 2,
}

/// One axis as the control announces it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Axis {
    /// Its letter.
    pub name: AxisName,
    /// Its unit on the wire.
    pub unit: AxisUnit,
}

/// First frame of the daemon after connecting.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct DaemonHello {
    /// Lowest protocol version understood.
    pub version_min: u8,
    /// Highest protocol version understood.
    pub version_max: u8,
    /// The machine the daemon is configured for.
    pub machine: Name,
    /// Program and version, for logs.
    pub software: Name,
}

/// Answer of the control: what machine this is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControlHello {
    /// The protocol version chosen.
    pub version: u8,
    /// Machine id.
    pub machine: Name,
    /// Program and version, for logs.
    pub software: Name,
    /// Interval between position frames, ns.
    pub cycle_ns: u64,
    /// Number of axes.
    pub axis_count: u8,
    /// The axes in wire order; entries beyond the count repeat the first.
    pub axes: [Axis; MAX_AXES],
}

/// State of the machine, one bit each.
#[derive(Clone, Copy, PartialEq, Eq, Default)]
pub struct MachineState {
    /// The bits, as on the wire.
    pub bits: u16,
}

/// One control cycle.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Position {
    /// Counts control cycles, wraps at 2^32; a cycle that was not sent leaves a gap.
    pub sequence: u32,
    /// The control's own monotonic time of the sample, ns.
    pub control_ns: i64,
    /// State of the machine.
    pub state: MachineState,
    /// Feed along the path, mm/min.
    pub feed_mm_per_min: f64,
    /// Commanded positions without any offset, mm or deg.
    pub commanded: AxisArray,
    /// Actual positions (encoder), which include the applied offset, mm or deg.
    pub actual: AxisArray,
    /// Read-back: the origin offset that the control has applied, mm or deg.
    pub applied: AxisArray,
}

/// What the daemon is doing, for the control's own display and watchdog.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum CorrectionState {
    /// Not compensating; offsets are zero.
    #[default]
    Off = 0,
    /// Ready to compensate, waiting for the machine or for the command.
    Armed = 1,
    /// Ramping in.
    RampingIn = 2,
    /// Compensating.
    Active = 3,
    /// Holding the last offset for lack of fresh or plausible data.
    Holding = 4,
    /// Ramping out.
    RampingOut = 5,
    /// Stopped by a fault; offsets are being taken back or are zero.
    Faulted = 6,
    /// Compensating, while the part that came from a silent sensor is being taken back.
    FadingToStatic = 7,
}

/// The answer to one position frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Correction {
    /// The sequence of the position frame that is answered.
    pub sequence: u32,
    /// What the daemon is doing.
    pub state: CorrectionState,
    /// Bit k: the offset of axis k is limited (size, rate or acceleration).
    pub limited: u8,
    /// Origin offset to apply, mm or deg.
    pub offset: AxisArray,
}

/// Life sign, both ways, when nothing else is being sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Heartbeat {
    /// Counts heartbeats.
    pub count: u32,
    /// The sender's own monotonic time, ns.
    pub time_ns: i64,
}

/// The tool that is now in the spindle; sent by the control after hello and on every change.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tool {
    /// Tool number.
    pub number: u32,
    /// Tool tip in M at home, mm.
    pub tip: [f64; 3],
}

/// Why the link is being closed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CloseReason {
    /// The sender is shutting down in order.
    #[default]
    Shutdown,
    /// The operator asked for it.
    Operator,
    /// The sender found an error, reported in an error frame before.
    Error,
    /// A reason of a later version.
    Other(u8),
}

/// Orderly end of the link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Close {
    /// Why.
    pub reason: CloseReason,
}

/// What went wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ErrorCode {
    /// No common protocol version.
    Version,
    /// The frame was not understood.
    #[default]
    BadFrame,
    /// The other side is configured for another machine.
    WrongMachine,
    /// The axes do not fit.
    WrongAxes,
    /// The cycle time does not fit.
    WrongCycle,
    /// A message at a moment when it is not expected.
    Unexpected,
    /// Another daemon is already connected.
    Busy,
    /// An error of a later version.
    Other(u8),
}

/// An error, sent before closing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ErrorReport {
    /// What went wrong.
    pub code: ErrorCode,
    /// A word about it, for logs.
    pub detail: Name,
}

/// Every message.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(missing_docs, reason = "each variant carries its documented struct")]
pub enum Message {
    DaemonHello(DaemonHello),
    ControlHello(ControlHello),
    Position(Position),
    Correction(Correction),
    Heartbeat(Heartbeat),
    Tool(Tool),
    Close(Close),
    Error(ErrorReport),
}

impl Name {
    /// Longest name in bytes.
    pub const MAX: usize = 32;

    /// A name; text beyond [`Name::MAX`] bytes is cut at a character boundary, control characters are dropped.
    #[must_use]
    pub fn new(text: &str) -> Self {
        let mut bytes = [0; Self::MAX];
        let mut used = 0;
        for c in text.chars().filter(|c| !c.is_control()) {
            if used + c.len_utf8() > Self::MAX {
                break;
            }
            used += c.encode_utf8(&mut bytes[used..]).len();
        }
        Self { bytes }
    }

    /// The text; what is not UTF-8 ends it.
    #[must_use]
    pub fn as_str(&self) -> &str {
        let end = self.bytes.iter().position(|&b| b == 0).unwrap_or(Self::MAX);
        match core::str::from_utf8(&self.bytes[..end]) {
            Ok(text) => text,
            Err(e) => core::str::from_utf8(&self.bytes[..e.valid_up_to()]).unwrap_or(""),
        }
    }

    /// A name from its padded bytes.
    ///
    /// # Errors
    /// Where it breaks the rules, and how.
    pub fn from_bytes(bytes: [u8; Self::MAX]) -> Result<Self, (usize, NameFault)> {
        let end = bytes.iter().position(|&b| b == 0).unwrap_or(Self::MAX);
        let (text, padding) = bytes.split_at(end);
        if let Some(k) = padding.iter().position(|&b| b != 0) {
            return Err((end + k, NameFault::AfterEnd));
        }
        let text = core::str::from_utf8(text).map_err(|e| (e.valid_up_to(), NameFault::NotUtf8))?;
        match text.char_indices().find(|(_, c)| c.is_control()) {
            Some((at, _)) => Err((at, NameFault::Control)),
            None => Ok(Self { bytes }),
        }
    }

    /// The padded bytes.
    #[must_use]
    pub const fn bytes(&self) -> &[u8; Self::MAX] {
        &self.bytes
    }
}

impl fmt::Debug for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.as_str())
    }
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl Axis {
    /// An axis in the unit of its kind.
    #[must_use]
    pub const fn new(name: AxisName) -> Self {
        let unit = if name.kind().is_rotary() { AxisUnit::Degree } else { AxisUnit::Millimetre };
        Self { name, unit }
    }
}

impl AxisUnit {
    /// The code on the wire.
    #[must_use]
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The unit of a code.
    #[must_use]
    pub const fn from_code(code: u8) -> Option<Self> {
        match code {
            1 => Some(Self::Millimetre),
            2 => Some(Self::Degree),
            _ => None,
        }
    }
}

impl CorrectionState {
    /// Every state, by its code.
    pub const ALL: [Self; 8] = [
        Self::Off,
        Self::Armed,
        Self::RampingIn,
        Self::Active,
        Self::Holding,
        Self::RampingOut,
        Self::Faulted,
        Self::FadingToStatic,
    ];

    /// The code on the wire.
    #[must_use]
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The state of a code.
    #[must_use]
    pub const fn from_code(code: u8) -> Option<Self> {
        if code as usize >= Self::ALL.len() { None } else { Some(Self::ALL[code as usize]) }
    }

    /// Name of the state in status, log and recordings.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Armed => "armed",
            Self::RampingIn => "ramping-in",
            Self::Active => "active",
            Self::Holding => "holding",
            Self::RampingOut => "ramping-out",
            Self::Faulted => "faulted",
            Self::FadingToStatic => "fading-to-static",
        }
    }
}

impl CloseReason {
    /// The code on the wire.
    #[must_use]
    pub const fn code(self) -> u8 {
        match self {
            Self::Shutdown => 0,
            Self::Operator => 1,
            Self::Error => 2,
            Self::Other(code) => code,
        }
    }

    /// The reason of a code; every code has one, because a close is read by every version.
    #[must_use]
    pub const fn from_code(code: u8) -> Self {
        match code {
            0 => Self::Shutdown,
            1 => Self::Operator,
            2 => Self::Error,
            _ => Self::Other(code),
        }
    }
}

impl ErrorCode {
    /// The code on the wire.
    #[must_use]
    pub const fn code(self) -> u8 {
        match self {
            Self::Version => 1,
            Self::BadFrame => 2,
            Self::WrongMachine => 3,
            Self::WrongAxes => 4,
            Self::WrongCycle => 5,
            Self::Unexpected => 6,
            Self::Busy => 7,
            Self::Other(code) => code,
        }
    }

    /// The error of a code; every code has one, because an error is read by every version.
    #[must_use]
    pub const fn from_code(code: u8) -> Self {
        match code {
            1 => Self::Version,
            2 => Self::BadFrame,
            3 => Self::WrongMachine,
            4 => Self::WrongAxes,
            5 => Self::WrongCycle,
            6 => Self::Unexpected,
            7 => Self::Busy,
            _ => Self::Other(code),
        }
    }
}

impl fmt::Display for CloseReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Other(code) => write!(f, "reason {code}, which this version does not know"),
            known => write!(f, "{known:?}"),
        }
    }
}

impl fmt::Display for ErrorCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Other(code) => write!(f, "code {code}, which this version does not know"),
            known => write!(f, "{known:?}"),
        }
    }
}

impl ControlHello {
    /// The axes that the control has, in wire order.
    #[must_use]
    pub fn used_axes(&self) -> &[Axis] {
        &self.axes[..usize::from(self.axis_count).min(MAX_AXES)]
    }
}

impl MachineState {
    /// All axes are referenced.
    pub const HOMED: u16 = 1 << 0;
    /// Drives are on.
    pub const ENABLED: u16 = 1 << 1;
    /// Emergency stop is active.
    pub const ESTOP: u16 = 1 << 2;
    /// An axis is moving.
    pub const MOVING: u16 = 1 << 3;
    /// The control could not apply the whole offset (a limit of its own).
    pub const OFFSET_LIMITED: u16 = 1 << 4;
    /// The control is ramping the offset out by itself (its watchdog on the daemon).
    pub const OFFSET_RAMPING_OUT: u16 = 1 << 5;

    /// A state from its bits.
    #[must_use]
    pub const fn from_bits(bits: u16) -> Self {
        Self { bits }
    }

    /// True where all `bits` are set.
    #[must_use]
    pub const fn has(self, bits: u16) -> bool {
        self.bits & bits == bits
    }

    /// Homed, enabled and not in emergency stop: the machine may be compensated.
    #[must_use]
    pub const fn is_ready(self) -> bool {
        self.has(Self::HOMED | Self::ENABLED) && !self.has(Self::ESTOP)
    }
}

impl fmt::Debug for MachineState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = [
            (Self::HOMED, "homed"),
            (Self::ENABLED, "enabled"),
            (Self::ESTOP, "estop"),
            (Self::MOVING, "moving"),
            (Self::OFFSET_LIMITED, "offset-limited"),
            (Self::OFFSET_RAMPING_OUT, "offset-ramping-out"),
        ];
        f.debug_list().entries(names.iter().filter(|(bit, _)| self.has(*bit)).map(|(_, name)| name)).finish()
    }
}
