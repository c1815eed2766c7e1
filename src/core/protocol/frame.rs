//! Packing and unpacking of one frame.

use super::message::Message;

/// The most bytes of a frame, header and check sum included.
pub const MAX_FRAME: usize = 512;

/// Why bytes are no frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// placeholder
    #[error("placeholder")]
    Placeholder,
}

/// Packs a message into `buffer` and returns the number of bytes used.
#[must_use]
pub fn encode(_message: &Message, _buffer: &mut [u8; MAX_FRAME]) -> usize {
    0
}

/// Unpacks one whole frame.
///
/// # Errors
/// What is wrong with it.
pub fn decode(_frame: &[u8]) -> Result<Message, FrameError> {
    Err(FrameError::Placeholder)
}
