//! The link between a control and the daemon: messages, frames, and the stream reader.
//!
//! Byte by byte in `docs/protocol.md`. The control listens, the daemon connects. Little-endian, fixed layouts,
//! at most [`MAX_FRAME`] bytes a frame. Reading order: [`message`] (what is said), [`frame`] (how it is
//! packed: zero-copy view and plain struct), [`stream`] (frames out of a byte stream).

pub mod frame;
pub mod message;
pub mod stream;

pub use frame::{FrameError, MAX_FRAME, decode, encode};
pub use message::{
    Axis, AxisUnit, Close, CloseReason, ControlHello, Correction, CorrectionState, DaemonHello, ErrorCode,
    ErrorReport, Heartbeat, MachineState, Message, Name, Position, Tool,
};
pub use stream::FrameReader;

/// The protocol version that this code speaks.
pub const PROTOCOL_VERSION: u8 = 1;
/// The port on which a control listens unless told otherwise.
pub const DEFAULT_PORT: u16 = 7878;
