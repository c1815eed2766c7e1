//! A whole file, whatever happened to it: torn at the end, damaged in the middle, or with entries missing.

use super::block::{self, Block, BlockKind, FILE_HEADER, Found};
use super::codec::{Decoded, Decoder};
use super::entry::{Context, Entry};
use super::error::RecordError;
use super::meta::Meta;

/// Something about a file that its reader should know.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Note {
    /// The last block is not whole: the file was being written when it ended.
    #[error("byte {at}: the last block is torn, {bytes} bytes left out (power loss, or still being written)")]
    Torn {
        /// Where it begins.
        at: u64,
        /// Bytes left out.
        bytes: u64,
    },
    /// Bytes that are no block were passed over.
    #[error("byte {at}: {bytes} bytes are not a block and were skipped")]
    Damaged {
        /// Where they begin.
        at: u64,
        /// How many.
        bytes: u64,
    },
    /// The content of a block is damaged.
    #[error(
        "byte {at}: the block of records {first_record} to {} is damaged",
        first_record.saturating_add(u64::from(*records)).saturating_sub(1)
    )]
    Content {
        /// Where the block begins.
        at: u64,
        /// Number of its first entry.
        first_record: u64,
        /// Entries lost, at most.
        records: u32,
    },
    /// A report of live estimation is damaged: it costs no entry.
    #[error("byte {at}: a report of live estimation is damaged and left out; no record is missing")]
    Health {
        /// Where its block begins.
        at: u64,
    },
    /// A block of a later version that may be passed over.
    #[error("byte {at}: a block of kind {kind} of a later version was passed over")]
    UnknownBlock {
        /// Where it begins.
        at: u64,
        /// Its kind.
        kind: u8,
    },
}

/// A file with its blocks found.
#[derive(Debug, Clone, Default)]
pub struct Recording<'a> {
    /// What the file says about itself.
    pub meta: Meta,
    /// Hash and text of the models that the engine used, the first one first.
    pub models: Vec<([u8; 32], String)>,
    /// Hash and text of the machine file.
    pub machine: Option<([u8; 32], String)>,
    /// How live estimation went: time (ns, on the daemon's clock) and JSON text, the oldest first.
    pub health: Vec<(i64, String)>,
    /// What its reader should know.
    pub notes: Vec<Note>,
    /// True where the file was closed in order.
    pub closed: bool,
    /// Number behind the last entry by the index; `None` without a sound one.
    pub index_end: Option<u64>,
    entries: Vec<(u64, Block<'a>)>,
}

impl Note {
    /// True where it is about entries, or about what is needed to repeat them.
    #[must_use]
    pub const fn is_damage(&self) -> bool {
        !matches!(self, Self::Health { .. } | Self::UnknownBlock { .. })
    }

    /// Number behind the last entry of the damaged blocks.
    #[must_use]
    pub fn known_end<'n>(notes: impl Iterator<Item = &'n Self>) -> u64 {
        let end = |note: &Self| match note {
            Self::Content { first_record, records, .. } => first_record.saturating_add(u64::from(*records)),
            _ => 0,
        };
        notes.map(end).max().unwrap_or_default()
    }
}

impl<'a> Recording<'a> {
    /// Number behind the last entry of the file, from its index and the notes of its reader.
    ///
    /// # Errors
    /// In words: why it is not known.
    pub fn end<'n>(&self, notes: impl Iterator<Item = &'n Note>) -> Result<u64, &'static str> {
        if !self.closed {
            return Err("it was not closed: its end is missing, or it is still being written");
        }
        let last = self.index_end.ok_or("its index is damaged, so its end is not known")?;
        Ok(last.max(Note::known_end(notes)))
    }

    /// Finds the blocks of a file.
    ///
    /// # Errors
    /// No recording, one of a later version, or one without a description.
    pub fn parse(file: &'a [u8]) -> Result<Self, RecordError> {
        block::check_file_header(file)?;
        let mut meta = None;
        let mut found = Self::default();
        let mut at = FILE_HEADER;
        while at < file.len() {
            let rest = &file[at..];
            match block::look(rest) {
                Found::Block(block, length) => {
                    found.take(&block, at as u64, &mut meta)?;
                    at += length;
                }
                _ if block::is_trailer(rest) => break,
                Found::Torn | Found::Nothing => {
                    // a torn block has no sound block behind it; a damaged length only looks torn
                    let next = next_block(rest);
                    let bytes = next.unwrap_or(rest.len()) as u64;
                    found.notes.push(match next {
                        None => Note::Torn { at: at as u64, bytes },
                        Some(_) => Note::Damaged { at: at as u64, bytes },
                    });
                    at += next.unwrap_or(rest.len());
                }
            }
        }
        found.meta = meta.ok_or(RecordError::NoMeta)?;
        Ok(found)
    }

    fn take(&mut self, block: &Block<'a>, at: u64, meta: &mut Option<Meta>) -> Result<(), RecordError> {
        let damaged = Note::Content { at, first_record: block.first_record, records: block.records };
        match block.kind {
            BlockKind::Entries => self.entries.push((at, *block)),
            BlockKind::Index => {
                self.closed = true;
                let rows = block.content().ok().and_then(|content| block::index_rows(&content));
                let end = |row: &block::IndexRow| row.first_record.saturating_add(row.records.into());
                self.index_end = rows.map(|rows| rows.last().map_or(0, end));
            }
            BlockKind::Other(kind) if kind >= 128 => return Err(RecordError::BlockKind { at, kind }),
            BlockKind::Other(kind) => self.notes.push(Note::UnknownBlock { at, kind }),
            BlockKind::Meta => match block.content() {
                Ok(text) => *meta = Some(Meta::parse(&text)?),
                Err(_) => self.notes.push(damaged),
            },
            BlockKind::Health => match block.content().ok().and_then(|c| String::from_utf8(c).ok()) {
                Some(text) => self.health.push((block.first_ns, text)),
                None => self.notes.push(Note::Health { at }),
            },
            BlockKind::Model | BlockKind::Machine => match block.content().ok().and_then(|c| hashed_text(&c))
            {
                Some(text) if block.kind == BlockKind::Machine => self.machine = Some(text),
                Some(text) => self.models.push(text),
                None => self.notes.push(damaged),
            },
        }
        Ok(())
    }

    /// Entries, were every block sound.
    #[must_use]
    pub fn records(&self) -> u64 {
        self.entries.iter().map(|(_, block)| u64::from(block.records)).sum()
    }

    /// Reads the entries; `expected` is the number that the first one would have without a gap: 0 at the beginning of
    /// a run, [`Reader::next_record`] of the file before in the middle of one.
    #[must_use]
    pub fn reader(&self, expected: u64) -> Reader<'_, 'a> {
        Reader { blocks: self.entries.iter(), open: None, expected, notes: Vec::new() }
    }
}

/// Where the next sound block header stands.
fn next_block(bytes: &[u8]) -> Option<usize> {
    let mut at = 0;
    loop {
        at += block::next_magic(&bytes[at..])?;
        if matches!(block::look(&bytes[at..]), Found::Block(..)) {
            return Some(at);
        }
    }
}

fn hashed_text(content: &[u8]) -> Option<([u8; 32], String)> {
    let (hash, text) = content.split_first_chunk::<32>()?;
    Some((*hash, core::str::from_utf8(text).ok()?.to_owned()))
}

/// The content of a block with a text and its hash.
#[must_use]
pub fn hashed(hash: &[u8; 32], text: &str) -> Vec<u8> {
    [hash.as_slice(), text.as_bytes()].concat()
}

/// One step through a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Item {
    /// An entry with its number.
    Entry {
        /// Its number in the run.
        record: u64,
        /// The entry.
        entry: Entry,
    },
    /// Entries are missing here.
    Gap {
        /// Number of the next entry.
        record: u64,
        /// How many are missing.
        dropped: u64,
        /// How things stand after the gap.
        context: Context,
    },
    /// An entry of a later version.
    Unknown {
        /// Its number in the run.
        record: u64,
        /// Its tag; from 128 on it was an input of the engine.
        tag: u8,
    },
}

/// Goes through the entries of a file in their order.
#[derive(Debug)]
pub struct Reader<'r, 'a> {
    blocks: core::slice::Iter<'r, (u64, Block<'a>)>,
    open: Option<Open>,
    expected: u64,
    /// Damage found in the content of blocks.
    pub notes: Vec<Note>,
}

/// The block being read.
#[derive(Debug)]
struct Open {
    decoder: Decoder,
    at: u64,
    /// Number of the next entry.
    record: u64,
    /// Number of the first entry of the next block.
    end: u64,
}

impl Reader<'_, '_> {
    /// Number of the next entry without a gap.
    #[must_use]
    pub const fn next_record(&self) -> u64 {
        self.expected
    }

    /// Opens a block; a gap in front of it is the first item.
    fn start(&mut self, at: u64, block: &Block<'_>) -> Option<Item> {
        let record = block.first_record;
        let end = record.saturating_add(u64::from(block.records));
        match block.content().and_then(Decoder::new) {
            Ok(decoder) => {
                let dropped = record.saturating_sub(self.expected);
                let context = *decoder.context();
                let gap = (record != self.expected).then_some(Item::Gap { record, dropped, context });
                self.expected = record;
                self.open = Some(Open { decoder, at, record, end });
                gap
            }
            Err(_) => {
                self.notes.push(Note::Content { at, first_record: record, records: block.records });
                None
            }
        }
    }

    fn step(&mut self) -> Option<Item> {
        let open = self.open.as_mut()?;
        let record = open.record;
        let item = match open.decoder.next_entry() {
            Ok(Some(Decoded::Entry(Entry::Gap { dropped, context, .. }))) => {
                Item::Gap { record, dropped, context }
            }
            Ok(Some(Decoded::Entry(entry))) => Item::Entry { record, entry },
            Ok(Some(Decoded::Unknown { tag })) => Item::Unknown { record, tag },
            Ok(None) => {
                self.open = None;
                return None;
            }
            Err(_) => {
                let records = u32::try_from(open.end.saturating_sub(record)).unwrap_or(u32::MAX);
                self.notes.push(Note::Content { at: open.at, first_record: record, records });
                self.open = None;
                return None;
            }
        };
        open.record = record.saturating_add(1);
        self.expected = open.record;
        Some(item)
    }
}

impl Iterator for Reader<'_, '_> {
    type Item = Item;

    fn next(&mut self) -> Option<Item> {
        loop {
            if let Some(item) = self.step() {
                return Some(item);
            }
            let (at, block) = *self.blocks.next()?;
            if let Some(gap) = self.start(at, &block) {
                return Some(gap);
            }
        }
    }
}
