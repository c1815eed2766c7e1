//! Frames out of a byte stream: split, merged and hostile bytes.
//!
//! A header is judged as soon as its bytes are there, the magic byte by byte, so that a peer that speaks
//! something else is noticed at its first wrong byte and nobody waits for a length that was never meant.

use super::FrameError;
use super::frame::{Frame, Header, MAX_FRAME};
use super::message::Message;

/// Bytes held: room for one frame that is still incomplete and several that came together.
const CAPACITY: usize = 4 * MAX_FRAME;

/// Collects bytes and hands out whole messages; a fixed buffer, nothing allocated.
///
/// ```text
/// loop {
///     let n = socket.read(reader.space())?;    // 0 = end of stream; reader.pending() > 0 = in mid-frame
///     reader.advance(n);
///     while let Some(message) = reader.next()? { .. }
/// }
/// ```
#[derive(Debug, Clone)]
pub struct FrameReader {
    buffer: [u8; CAPACITY],
    start: usize,
    end: usize,
    skipped: u64,
    failed: Option<FrameError>,
}

impl Default for FrameReader {
    fn default() -> Self {
        Self { buffer: [0; CAPACITY], start: 0, end: 0, skipped: 0, failed: None }
    }
}

impl FrameReader {
    /// The free space to read socket bytes into; never empty after [`FrameReader::next`] returned `Ok(None)`.
    pub fn space(&mut self) -> &mut [u8] {
        // What is left over moves to the front only when the tail runs short: once in several frames at most.
        if CAPACITY - self.end < MAX_FRAME && self.start > 0 {
            self.buffer.copy_within(self.start..self.end, 0);
            self.end -= self.start;
            self.start = 0;
        }
        &mut self.buffer[self.end..]
    }

    /// Says that `count` bytes were written into [`FrameReader::space`]; more than fit count as what fits.
    pub fn advance(&mut self, count: usize) {
        self.end = self.end.saturating_add(count).min(CAPACITY);
    }

    /// The next whole message, `None` where more bytes are needed. Unknown types that may be skipped are
    /// skipped and counted.
    ///
    /// # Errors
    /// The bytes are no frame; the stream cannot be trusted any more and the link must be closed. The same
    /// error is returned, and all bytes are dropped, until [`FrameReader::clear`].
    #[expect(clippy::should_implement_trait, reason = "an iterator would end at the first None")]
    pub fn next(&mut self) -> Result<Option<Message>, FrameError> {
        let result = match self.failed {
            Some(error) => Err(error),
            None => self.take(),
        };
        if let Err(error) = result {
            self.failed = Some(error);
            self.start = self.end;
        }
        if self.start == self.end {
            self.start = 0;
            self.end = 0;
        }
        result
    }

    /// Bytes that wait for the rest of their frame, or for [`FrameReader::next`].
    #[must_use]
    pub const fn pending(&self) -> usize {
        self.end - self.start
    }

    /// Frames skipped because their type is unknown and may be skipped.
    #[must_use]
    pub const fn skipped(&self) -> u64 {
        self.skipped
    }

    /// Forgets everything, for a new connection.
    pub fn clear(&mut self) {
        self.start = 0;
        self.end = 0;
        self.skipped = 0;
        self.failed = None;
    }

    fn take(&mut self) -> Result<Option<Message>, FrameError> {
        loop {
            let bytes = &self.buffer[self.start..self.end];
            let Some(header) = Header::parse(bytes)? else { return Ok(None) };
            let Some(bytes) = bytes.get(..header.length) else { return Ok(None) };
            let frame = Frame::new_unchecked(bytes);
            frame.check_crc()?;
            if header.kind.is_some() {
                let message = frame.message()?;
                self.start += header.length;
                return Ok(Some(message));
            }
            self.start += header.length;
            self.skipped += 1;
        }
    }
}
