//! Why bytes are no frame: the reason is kept, typed, and small enough to travel through the cycle.

use super::message::{ErrorCode, ErrorReport, Name};
use super::read_write::LineError;
use volcomp_units::axes::{AxisName, MAX_AXES};

/// Why bytes are no frame. After any of these the byte stream has lost its meaning: close the link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// The bytes end before the frame does.
    #[error("frame: {found} bytes where {needed} are needed; wait for the rest")]
    Truncated {
        /// Bytes that the frame (or its header) has.
        needed: usize,
        /// Bytes that are there.
        found: usize,
    },
    /// More bytes than the frame has.
    #[error("frame: {found} bytes for a frame of {length}; hand over one frame at a time")]
    Excess {
        /// Bytes that the frame has.
        length: usize,
        /// Bytes that are there.
        found: usize,
    },
    /// The first bytes are not those of a frame: another protocol, or a lost byte.
    #[error(
        "frame: byte {at} is {found:#04x}, must be {expected:#04x}: the peer does not speak this protocol"
    )]
    Magic {
        /// Offset of the first wrong byte.
        at: usize,
        /// The byte.
        found: u8,
        /// What it must be.
        expected: u8,
    },
    /// The version in the header is not the one that this type of frame has.
    #[error("frame: version {found}, must be {expected} for type {code:#04x}: update the older side")]
    Version {
        /// Type code.
        code: u8,
        /// Version in the header.
        found: u8,
        /// Version of that type here.
        expected: u8,
    },
    /// A type that is not known here. One with the top bit set may be skipped, any other may not.
    #[error("frame: unknown type {code:#04x}: the peer uses what this version does not have")]
    UnknownType {
        /// Type code.
        code: u8,
    },
    /// The length in the header is not the one of this type.
    #[error("frame: length {found} for type {code:#04x}, must be {expected} bytes")]
    Length {
        /// Type code.
        code: u8,
        /// Length in the header.
        found: u16,
        /// Length of that type.
        expected: u16,
    },
    /// The length of a frame that may be skipped is impossible.
    #[error("frame: length {found} for type {code:#04x}, must be {min} to {max} bytes")]
    LengthRange {
        /// Type code.
        code: u8,
        /// Length in the header.
        found: u16,
        /// Least length.
        min: u16,
        /// Largest length.
        max: u16,
    },
    /// The check sum does not fit the bytes: damage on the way, or a sender with another check sum.
    #[error("frame: check sum {found:#010x}, computed {expected:#010x}: damaged on the way or not CRC-32C")]
    Crc {
        /// Computed from the bytes.
        expected: u32,
        /// Sent with the bytes.
        found: u32,
    },
    /// A byte that must be zero is not: most often memory that the sender did not clear.
    #[error("frame: reserved byte {offset} is {found:#04x}, must be zero; the sender must clear it")]
    Reserved {
        /// Offset in the frame.
        offset: usize,
        /// The byte.
        found: u8,
    },
    /// A code without a meaning.
    #[error("{field}: code {found} has no meaning in this version")]
    Value {
        /// The field.
        field: &'static str,
        /// The code.
        found: u8,
    },
    /// A name that breaks the rules.
    #[error("{field}: byte {at} {fault}; a name is UTF-8 without control characters, padded with zeros")]
    Name {
        /// The field.
        field: &'static str,
        /// Offset in the name.
        at: usize,
        /// What is wrong.
        fault: NameFault,
    },
    /// The range of versions is empty or begins at zero.
    #[error("hello: versions {min} to {max} are not a range; the least is 1")]
    VersionRange {
        /// Lowest version.
        min: u8,
        /// Highest version.
        max: u8,
    },
    /// A line of a control that is read and written by calls.
    #[error(transparent)]
    Line(#[from] LineError),
    /// No axis, or more than the link carries.
    #[error("hello: {found} axes, must be 1 to {limit}", limit = MAX_AXES)]
    AxisCount {
        /// Number of axes.
        found: u8,
    },
    /// An axis stands twice in the hello.
    #[error("hello: axis {axis} stands twice; every axis has its own letter")]
    AxisTwice {
        /// The axis.
        axis: AxisName,
    },
}

/// What is wrong with a name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NameFault {
    /// Not UTF-8.
    #[error("is not UTF-8")]
    NotUtf8,
    /// A control character.
    #[error("is a control character")]
    Control,
    /// Something after the first zero.
    #[error("follows the end of the name")]
    AfterEnd,
}

impl FrameError {
    /// A word about it that fits an error frame.
    #[must_use]
    pub const fn word(&self) -> &'static str {
        match self {
            Self::Truncated { .. } => "truncated",
            Self::Excess { .. } => "excess bytes",
            Self::Magic { .. } => "magic",
            Self::Version { .. } => "version in header",
            Self::UnknownType { .. } => "unknown type",
            Self::Length { .. } | Self::LengthRange { .. } => "length",
            Self::Crc { .. } => "check sum",
            Self::Reserved { .. } => "reserved byte not zero",
            Self::Value { field, .. } | Self::Name { field, .. } => field,
            Self::VersionRange { .. } => "version range",
            Self::AxisCount { .. } => "axis count",
            Self::AxisTwice { .. } => "axis twice",
            Self::Line(LineError::Watchdog { .. }) => "no watchdog on the offset",
            Self::Line(LineError::Poll { .. }) => "hold time below poll-ms",
            Self::Line(_) => "line",
        }
    }
}

/// The error frame to send to a peer whose bytes were not understood.
impl From<FrameError> for ErrorReport {
    fn from(error: FrameError) -> Self {
        let code = match error {
            FrameError::Version { .. } | FrameError::VersionRange { .. } => ErrorCode::Version,
            FrameError::AxisCount { .. } | FrameError::AxisTwice { .. } => ErrorCode::WrongAxes,
            FrameError::Line(LineError::Watchdog { .. } | LineError::Poll { .. }) => ErrorCode::Unexpected,
            _ => ErrorCode::BadFrame,
        };
        Self { code, detail: Name::new(error.word()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_frame_names_the_reason() {
        let report = ErrorReport::from(FrameError::Crc { expected: 1, found: 2 });
        assert_eq!((report.code, report.detail.as_str()), (ErrorCode::BadFrame, "check sum"));
        let report = ErrorReport::from(FrameError::Version { code: 0x10, found: 2, expected: 1 });
        assert_eq!((report.code, report.detail.as_str()), (ErrorCode::Version, "version in header"));
        let report = ErrorReport::from(FrameError::AxisTwice { axis: AxisName::C });
        assert_eq!((report.code, report.detail.as_str()), (ErrorCode::WrongAxes, "axis twice"));
    }

    #[test]
    fn messages_say_what_where_value_and_remedy() {
        let text = FrameError::Length { code: 0x10, found: 64, expected: 228 }.to_string();
        assert_eq!(text, "frame: length 64 for type 0x10, must be 228 bytes");
        let text = FrameError::Name { field: "machine", at: 3, fault: NameFault::Control }.to_string();
        assert!(text.starts_with("machine: byte 3 is a control character;"), "{text}");
        assert_eq!(FrameError::AxisCount { found: 9 }.to_string(), "hello: 9 axes, must be 1 to 8");
    }

    #[test]
    fn an_error_stays_small() {
        assert!(size_of::<FrameError>() <= 40, "{} bytes", size_of::<FrameError>());
    }
}
