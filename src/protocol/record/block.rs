//! Frames around the bytes: kind, lengths, numbers, check sums.
//!
//! A block header has a check sum of its own, so that after damage the next block is found by its magic without
//! being fooled by data that look like one.

use super::FORMAT_VERSION;
use super::bytes::Cursor;
use super::error::RecordError;
use crc32c::crc32c;

/// The first bytes of every recording.
pub const FILE_MAGIC: &[u8; 8] = b"VCRECORD";
const BLOCK_MAGIC: &[u8; 4] = b"VCBK";
const TRAILER_MAGIC: &[u8; 8] = b"VCINDEX1";

/// Bytes of the file header.
pub const FILE_HEADER: usize = 16;
/// Bytes of a block header.
pub const BLOCK_HEADER: usize = 44;
/// Bytes behind the index that say where it begins.
pub const TRAILER: usize = 16;
/// Longest content of a block, unpacked; nothing longer is written or believed.
pub const CONTENT_MAX: usize = 8 << 20;

/// What is in a block. Kinds from 128 on must be understood, others may be passed over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BlockKind {
    /// The description of the file ([`super::Meta`]).
    Meta,
    /// 32 bytes BLAKE3, then the text of a model file.
    Model,
    /// 32 bytes BLAKE3, then the text of the machine file.
    Machine,
    /// Entries.
    Entries,
    /// How live estimation went at a moment: JSON text, as `volcomp filter show --json` prints it.
    Health,
    /// Where the blocks of entries stand; last block of a file that was closed in order.
    Index,
    /// Of a later version.
    Other(u8),
}

impl BlockKind {
    /// Its code.
    #[must_use]
    pub const fn code(self) -> u8 {
        match self {
            Self::Meta => 1,
            Self::Model => 2,
            Self::Machine => 3,
            Self::Entries => 128,
            Self::Index => 4,
            Self::Health => 5,
            Self::Other(code) => code,
        }
    }

    /// The kind of a code.
    #[must_use]
    pub const fn from_code(code: u8) -> Self {
        match code {
            1 => Self::Meta,
            2 => Self::Model,
            3 => Self::Machine,
            4 => Self::Index,
            5 => Self::Health,
            128 => Self::Entries,
            _ => Self::Other(code),
        }
    }
}

/// A block in a file, found and framed; its content is checked when it is unpacked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Block<'a> {
    /// What is in it.
    pub kind: BlockKind,
    /// Number of its first entry.
    pub first_record: u64,
    /// Entries in it.
    pub records: u32,
    /// Time of its first entry, ns.
    pub first_ns: i64,
    packed: bool,
    content_length: usize,
    stored: &'a [u8],
    crc: u32,
}

/// What stands at a place of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Found<'a> {
    /// A block with its header intact, and its length in the file.
    Block(Block<'a>, usize),
    /// A block whose bytes are not all there.
    Torn,
    /// No block.
    Nothing,
}

/// One row of the index.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct IndexRow {
    /// Where the block begins in the file.
    pub at: u64,
    /// Number of its first entry.
    pub first_record: u64,
    /// Time of its first entry, ns.
    pub first_ns: i64,
    /// Entries in it.
    pub records: u32,
}

/// The first bytes of a file.
#[must_use]
pub fn file_header() -> [u8; FILE_HEADER] {
    let mut bytes = [0; FILE_HEADER];
    bytes[..8].copy_from_slice(FILE_MAGIC);
    bytes[8..10].copy_from_slice(&FORMAT_VERSION.to_le_bytes());
    let crc = crc32c(&bytes[..12]);
    bytes[12..].copy_from_slice(&crc.to_le_bytes());
    bytes
}

/// Checks the first bytes of a file.
///
/// # Errors
/// Not a recording, damaged, or of a later version.
pub fn check_file_header(file: &[u8]) -> Result<(), RecordError> {
    if !file.starts_with(FILE_MAGIC) {
        return Err(RecordError::NotARecording);
    }
    let header = file.get(..FILE_HEADER).ok_or(RecordError::Header)?;
    let mut cursor = Cursor::new(&header[8..]);
    let version = cursor.u16()?;
    let _reserved = cursor.u16()?;
    if cursor.u32()? != crc32c(&header[..12]) {
        return Err(RecordError::Header);
    }
    if version == 0 || version > FORMAT_VERSION {
        return Err(RecordError::Version { found: version, known: FORMAT_VERSION });
    }
    Ok(())
}

/// A whole block as bytes; `content` is packed where that makes it shorter. `None` above [`CONTENT_MAX`].
#[must_use]
pub fn seal(
    kind: BlockKind,
    first_record: u64,
    records: u32,
    first_ns: i64,
    content: &[u8],
) -> Option<Vec<u8>> {
    if content.len() > CONTENT_MAX {
        return None;
    }
    let squeezed = lz4_flex::block::compress(content);
    let packed = squeezed.len() < content.len();
    let stored = if packed { squeezed.as_slice() } else { content };
    let mut out = Vec::with_capacity(BLOCK_HEADER + stored.len());
    out.extend_from_slice(BLOCK_MAGIC);
    out.extend_from_slice(&[kind.code(), u8::from(packed), 0, 0]);
    for length in [content.len(), stored.len()] {
        out.extend_from_slice(&u32::try_from(length).ok()?.to_le_bytes());
    }
    out.extend_from_slice(&records.to_le_bytes());
    out.extend_from_slice(&first_record.to_le_bytes());
    out.extend_from_slice(&first_ns.to_le_bytes());
    out.extend_from_slice(&crc32c(stored).to_le_bytes());
    out.extend_from_slice(&crc32c(&out).to_le_bytes());
    out.extend_from_slice(stored);
    Some(out)
}

/// What stands at the beginning of `bytes`.
#[must_use]
pub fn look(bytes: &[u8]) -> Found<'_> {
    let Some(header) = bytes.get(..BLOCK_HEADER) else {
        return if BLOCK_MAGIC.starts_with(&bytes[..bytes.len().min(4)]) {
            Found::Torn
        } else {
            Found::Nothing
        };
    };
    let Ok(Some((block, stored))) = parse(header) else { return Found::Nothing };
    match bytes.get(BLOCK_HEADER..BLOCK_HEADER + stored) {
        Some(content) => Found::Block(Block { stored: content, ..block }, BLOCK_HEADER + stored),
        None => Found::Torn,
    }
}

/// A block header, and the length of what follows it.
fn parse(header: &[u8]) -> Result<Option<(Block<'static>, usize)>, RecordError> {
    let mut cursor = Cursor::new(header);
    if cursor.take(4)? != BLOCK_MAGIC {
        return Ok(None);
    }
    let (kind, packing, reserved) = (cursor.u8()?, cursor.u8()?, cursor.u16()?);
    let (content_length, stored) = (cursor.u32()? as usize, cursor.u32()? as usize);
    let block = Block {
        kind: BlockKind::from_code(kind),
        records: cursor.u32()?,
        first_record: cursor.u64()?,
        first_ns: cursor.i64()?,
        packed: packing == 1,
        content_length,
        stored: &[],
        crc: cursor.u32()?,
    };
    let sound = cursor.u32()? == crc32c(&header[..BLOCK_HEADER - 4])
        && packing <= 1
        && reserved == 0
        && content_length <= CONTENT_MAX
        && stored <= content_length;
    Ok(sound.then_some((block, stored)))
}

/// Where the next block may begin in `bytes` after its first byte.
#[must_use]
pub fn next_magic(bytes: &[u8]) -> Option<usize> {
    let rest = bytes.get(1..)?;
    rest.windows(4).position(|w| w == BLOCK_MAGIC).map(|at| at + 1)
}

impl Block<'_> {
    /// The content, checked and unpacked.
    ///
    /// # Errors
    /// Damaged.
    pub fn content(&self) -> Result<Vec<u8>, RecordError> {
        if crc32c(self.stored) != self.crc {
            return Err(RecordError::Packed);
        }
        if !self.packed {
            return Ok(self.stored.to_vec());
        }
        let mut content = vec![0; self.content_length];
        let length =
            lz4_flex::block::decompress_into(self.stored, &mut content).map_err(|_| RecordError::Packed)?;
        if length == self.content_length { Ok(content) } else { Err(RecordError::Packed) }
    }
}

/// The index block and the trailer that finds it; `at` is where it will begin in the file.
#[must_use]
pub fn index(rows: &[IndexRow], at: u64) -> Option<Vec<u8>> {
    let mut content = Vec::with_capacity(rows.len() * 28);
    for row in rows {
        content.extend_from_slice(&row.at.to_le_bytes());
        content.extend_from_slice(&row.first_record.to_le_bytes());
        content.extend_from_slice(&row.first_ns.to_le_bytes());
        content.extend_from_slice(&row.records.to_le_bytes());
    }
    let mut out = seal(BlockKind::Index, 0, 0, 0, &content)?;
    out.extend_from_slice(&at.to_le_bytes());
    out.extend_from_slice(TRAILER_MAGIC);
    Some(out)
}

/// True where `bytes` are the trailer.
#[must_use]
pub fn is_trailer(bytes: &[u8]) -> bool {
    bytes.len() == TRAILER && bytes.ends_with(TRAILER_MAGIC)
}

/// The index of a file that was closed in order, found from its end.
#[must_use]
pub fn read_index(file: &[u8]) -> Option<Vec<IndexRow>> {
    let trailer = file.get(file.len().checked_sub(TRAILER)?..)?;
    if !is_trailer(trailer) {
        return None;
    }
    let at = usize::try_from(Cursor::new(trailer).u64().ok()?).ok()?;
    let Found::Block(block, _) = look(file.get(at..)?) else { return None };
    if block.kind != BlockKind::Index {
        return None;
    }
    index_rows(&block.content().ok()?)
}

/// The rows of an index block.
pub(super) fn index_rows(content: &[u8]) -> Option<Vec<IndexRow>> {
    let mut cursor = Cursor::new(content);
    let mut rows = Vec::new();
    while !cursor.is_empty() {
        rows.push(IndexRow {
            at: cursor.u64().ok()?,
            first_record: cursor.u64().ok()?,
            first_ns: cursor.i64().ok()?,
            records: cursor.u32().ok()?,
        });
    }
    Some(rows)
}
