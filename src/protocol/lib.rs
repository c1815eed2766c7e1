//! The link between a control and the daemon: messages, frames, and the stream reader.
//!
//! Byte by byte in `docs/protocol.md`. The control listens, the daemon connects. Little-endian, fixed layouts,
//! at most [`MAX_FRAME`] bytes a frame. Reading order: [`message`] (what is said), [`field`] (where it
//! stands), [`layout`] (struct to bytes and back), [`frame`] (header and check sum around it), [`stream`]
//! (frames out of a byte stream), [`error`] (why bytes are no frame); [`read_write`] (the same messages as calls in lines
//! of text, for controls that know no frames).

#![forbid(unsafe_code)]
#![cfg_attr(not(test), forbid(clippy::disallowed_methods))]

pub mod error;
pub mod field;
pub mod frame;
pub mod layout;
pub mod message;
pub mod read_write;
pub mod record;
pub mod stream;

#[cfg(test)]
mod tests;

pub use error::{FrameError, NameFault};
pub use frame::{Frame, Kind, MAX_FRAME, decode, encode};
pub use layout::Payload;
pub use message::{
    Axis, AxisUnit, Close, CloseReason, ControlHello, Correction, CorrectionState, DaemonHello, ErrorCode,
    ErrorReport, Heartbeat, MachineState, Message, Name, Position, Tool,
};
pub use stream::FrameReader;

/// The protocol version that this code speaks.
pub const PROTOCOL_VERSION: u8 = 1;
/// The port on which a control listens unless told otherwise.
pub const DEFAULT_PORT: u16 = 7878;
