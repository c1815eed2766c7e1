//! One frame: a zero-copy view of its bytes, and packing and unpacking of messages.
//!
//! A frame is a header of 8 bytes, the payload of its type and a CRC-32C of everything before it; all
//! numbers are little-endian, every type has one fixed length. Header, check sum and the types of version 0
//! (hello, error, close) never change, so that any two versions can at least tell each other that they do
//! not fit. After [`Frame::new_checked`] no accessor can panic.
//! Source: the style of `src/wire` in smoltcp; CRC-32C (Castagnoli) finds every error of up to five bits in
//! frames of this size (Koopman 2002). It is computed by the processor's own instruction where there is one: tables
//! would have to come back into the cache after every pause between two cycles.

use super::field::{self, Field, Value};
use super::layout::Payload;
use super::message::{
    Close, ControlHello, Correction, DaemonHello, ErrorReport, Heartbeat, Message, Position, Tool,
};
use super::{FrameError, PROTOCOL_VERSION};

/// The most bytes of a frame, header and check sum included.
pub const MAX_FRAME: usize = 512;
/// The fewest bytes of a frame: header and check sum.
pub const MIN_FRAME: usize = HEADER_LEN + CRC_LEN;
/// Bytes of the header.
pub const HEADER_LEN: usize = 8;
/// Bytes of the check sum.
pub const CRC_LEN: usize = 4;
/// The first bytes of every frame.
pub const MAGIC: [u8; 4] = *b"VCMP";
/// Version of the frames that never change.
pub const FROZEN_VERSION: u8 = 0;
/// Types from here on may be skipped by who does not know them.
pub const FIRST_OPTIONAL_TYPE: u8 = 0x80;

/// Type of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "each is described at the message of the same name")]
pub enum Kind {
    DaemonHello = 0x01,
    ControlHello = 0x02,
    Error = 0x03,
    Close = 0x04,
    Position = 0x10,
    Correction = 0x11,
    Heartbeat = 0x12,
    Tool = 0x13,
}

impl Kind {
    /// Every type, in the order of the documentation.
    pub const ALL: [Self; 8] = [
        Self::DaemonHello,
        Self::ControlHello,
        Self::Error,
        Self::Close,
        Self::Position,
        Self::Correction,
        Self::Heartbeat,
        Self::Tool,
    ];

    /// The code in the header.
    #[must_use]
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The type of a code.
    #[must_use]
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.code() == code)
    }

    /// The version that its header carries.
    #[must_use]
    pub const fn version(self) -> u8 {
        match self {
            Self::DaemonHello | Self::ControlHello | Self::Error | Self::Close => FROZEN_VERSION,
            Self::Position | Self::Correction | Self::Heartbeat | Self::Tool => PROTOCOL_VERSION,
        }
    }

    /// Bytes of the whole frame.
    #[must_use]
    pub const fn length(self) -> usize {
        match self {
            Self::DaemonHello | Self::Correction => 84,
            Self::ControlHello => 108,
            Self::Error => 52,
            Self::Close => 16,
            Self::Position => 228,
            Self::Heartbeat => 28,
            Self::Tool => 44,
        }
    }
}

/// What the first eight bytes say, checked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Header {
    /// Type code.
    pub code: u8,
    /// Bytes of the whole frame, [`MIN_FRAME`] to [`MAX_FRAME`].
    pub length: usize,
    /// The type; `None` for one that is unknown and may be skipped.
    pub kind: Option<Kind>,
}

impl Header {
    /// Reads and checks a header; `None` where more bytes are needed and those that are there may be the
    /// beginning of one.
    ///
    /// # Errors
    /// No frame can begin like this, whatever follows.
    pub fn parse(bytes: &[u8]) -> Result<Option<Self>, FrameError> {
        for (at, (&found, expected)) in bytes.iter().zip(MAGIC).enumerate() {
            if found != expected {
                return Err(FrameError::Magic { at, found, expected });
            }
        }
        if bytes.len() < HEADER_LEN {
            return Ok(None);
        }
        let version = field::header::VERSION.get(bytes);
        let code = field::header::TYPE.get(bytes);
        let length = field::header::LENGTH.get(bytes);
        let kind = Kind::from_code(code);
        let expected = kind.map_or(PROTOCOL_VERSION, Kind::version);
        let fits = if kind.is_some() { version == expected } else { version <= PROTOCOL_VERSION };
        if !fits {
            return Err(FrameError::Version { code, found: version, expected });
        }
        match kind {
            Some(kind) if usize::from(length) != kind.length() => {
                Err(FrameError::Length { code, found: length, expected: bounded(kind.length()) })
            }
            None if code < FIRST_OPTIONAL_TYPE => Err(FrameError::UnknownType { code }),
            None if !(MIN_FRAME..=MAX_FRAME).contains(&usize::from(length)) => {
                let (min, max) = (bounded(MIN_FRAME), bounded(MAX_FRAME));
                Err(FrameError::LengthRange { code, found: length, min, max })
            }
            _ => Ok(Some(Self { code, length: usize::from(length), kind })),
        }
    }
}

/// A frame in a buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame<T> {
    buffer: T,
}

impl<T: AsRef<[u8]>> Frame<T> {
    /// A view of a buffer whose content is not looked at.
    pub const fn new_unchecked(buffer: T) -> Self {
        Self { buffer }
    }

    /// A view of a buffer that begins with a whole frame, its header and check sum verified.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn new_checked(buffer: T) -> Result<Self, FrameError> {
        let frame = Self::new_unchecked(buffer);
        frame.check_len()?;
        frame.check_crc()?;
        Ok(frame)
    }

    /// Verifies the header and that the whole frame is there.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn check_len(&self) -> Result<(), FrameError> {
        let bytes = self.buffer.as_ref();
        let found = bytes.len();
        match Header::parse(bytes)? {
            None => Err(FrameError::Truncated { needed: HEADER_LEN, found }),
            Some(h) if h.length > found => Err(FrameError::Truncated { needed: h.length, found }),
            Some(_) => Ok(()),
        }
    }

    /// Verifies the check sum.
    ///
    /// # Errors
    /// It does not fit the bytes before it.
    pub fn check_crc(&self) -> Result<(), FrameError> {
        let (expected, found) = (crc32c::crc32c(self.covered()), self.crc());
        if expected == found { Ok(()) } else { Err(FrameError::Crc { expected, found }) }
    }

    /// Version in the header.
    #[must_use]
    pub fn version(&self) -> u8 {
        self.get(field::header::VERSION)
    }

    /// Type code in the header.
    #[must_use]
    pub fn code(&self) -> u8 {
        self.get(field::header::TYPE)
    }

    /// The type, where it is known.
    #[must_use]
    pub fn kind(&self) -> Option<Kind> {
        Kind::from_code(self.code())
    }

    /// Bytes of the whole frame, as its header says.
    #[must_use]
    pub fn length(&self) -> usize {
        usize::from(self.get(field::header::LENGTH))
    }

    /// The bytes between header and check sum.
    #[must_use]
    pub fn payload(&self) -> &[u8] {
        self.covered().get(HEADER_LEN..).unwrap_or(&[])
    }

    /// The check sum as sent.
    #[must_use]
    pub fn crc(&self) -> u32 {
        let at = self.length().saturating_sub(CRC_LEN);
        Field::<u32>::new("crc", at).get(self.buffer.as_ref())
    }

    /// A field of the frame; meaningful where the field belongs to the frame's type.
    #[must_use]
    pub fn get<V: Value>(&self, field: Field<V>) -> V {
        field.get(self.buffer.as_ref())
    }

    /// The message.
    ///
    /// # Errors
    /// A field breaks a rule, or the type is unknown.
    pub fn message(&self) -> Result<Message, FrameError> {
        Ok(match self.kind() {
            Some(Kind::DaemonHello) => Message::DaemonHello(DaemonHello::parse(self)?),
            Some(Kind::ControlHello) => Message::ControlHello(ControlHello::parse(self)?),
            Some(Kind::Error) => Message::Error(ErrorReport::parse(self)?),
            Some(Kind::Close) => Message::Close(Close::parse(self)?),
            Some(Kind::Position) => Message::Position(Position::parse(self)?),
            Some(Kind::Correction) => Message::Correction(Correction::parse(self)?),
            Some(Kind::Heartbeat) => Message::Heartbeat(Heartbeat::parse(self)?),
            Some(Kind::Tool) => Message::Tool(Tool::parse(self)?),
            None => return Err(FrameError::UnknownType { code: self.code() }),
        })
    }

    /// The bytes that the check sum covers.
    fn covered(&self) -> &[u8] {
        self.buffer.as_ref().get(..self.length().saturating_sub(CRC_LEN)).unwrap_or(&[])
    }
}

impl<T: AsRef<[u8]> + AsMut<[u8]>> Frame<T> {
    /// Clears the frame and writes the header of a type.
    pub fn start(&mut self, kind: Kind) {
        let length = kind.length();
        if let Some(bytes) = self.buffer.as_mut().get_mut(..length) {
            bytes.fill(0);
        }
        self.set(field::header::MAGIC, MAGIC);
        self.set(field::header::VERSION, kind.version());
        self.set(field::header::TYPE, kind.code());
        self.set(field::header::LENGTH, bounded(length));
    }

    /// Writes a field.
    pub fn set<V: Value>(&mut self, field: Field<V>, value: V) {
        field.set(self.buffer.as_mut(), value);
    }

    /// Writes the check sum; the last step.
    pub fn fill_crc(&mut self) {
        let crc = crc32c::crc32c(self.covered());
        let at = self.length().saturating_sub(CRC_LEN);
        Field::<u32>::new("crc", at).set(self.buffer.as_mut(), crc);
    }
}

/// Packs a message into `buffer` and returns the number of bytes used.
///
/// A message that breaks a rule of its own (nine axes, an empty range of versions) is packed as it is; the
/// receiver refuses it.
#[must_use]
pub fn encode(message: &Message, buffer: &mut [u8; MAX_FRAME]) -> usize {
    match message {
        Message::DaemonHello(m) => pack(m, buffer),
        Message::ControlHello(m) => pack(m, buffer),
        Message::Position(m) => pack(m, buffer),
        Message::Correction(m) => pack(m, buffer),
        Message::Heartbeat(m) => pack(m, buffer),
        Message::Tool(m) => pack(m, buffer),
        Message::Close(m) => pack(m, buffer),
        Message::Error(m) => pack(m, buffer),
    }
}

/// Unpacks one whole frame, no byte more or less.
///
/// # Errors
/// What is wrong with it. An unknown type that may be skipped is reported once its check sum is right;
/// [`FrameReader`](super::FrameReader) skips it.
pub fn decode(frame: &[u8]) -> Result<Message, FrameError> {
    let view = Frame::new_checked(frame)?;
    let (length, found) = (view.length(), frame.len());
    if found > length { Err(FrameError::Excess { length, found }) } else { view.message() }
}

fn pack<P: Payload>(message: &P, buffer: &mut [u8; MAX_FRAME]) -> usize {
    let mut frame = Frame::new_unchecked(buffer.as_mut_slice());
    frame.start(P::KIND);
    message.emit(&mut frame);
    frame.fill_crc();
    message.buffer_len()
}

/// A length as the header holds it; lengths never exceed [`MAX_FRAME`].
#[expect(clippy::cast_possible_truncation, reason = "MAX_FRAME fits 16 bits")]
const fn bounded(length: usize) -> u16 {
    if length > MAX_FRAME { MAX_FRAME as u16 } else { length as u16 }
}
