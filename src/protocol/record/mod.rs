//! Recordings: everything that went into the engine and everything that came out, as bytes.
//!
//! Pure: bytes in, entries out, and back; the shell reads and writes the files. Byte by byte in `docs/reference/recording.md`.
//! A file is a [`header`](block::file_header), then framed [`block`]s, each with its own check sums, so that a torn or
//! damaged one costs itself and nothing else. Blocks of entries start from nothing but their own [`Context`].
//!
//! Not on the cycle: encoding allocates. What crosses from the cycle is an [`Entry`], which is `Copy`.
//!
//! Reading order: [`entry`] (what is recorded), [`codec`] (how it becomes few bytes), [`block`] (frames around that),
//! [`meta`] (what a file says about itself), [`reader`] (a whole file, whatever happened to it).

pub mod block;
mod bytes;
pub mod codec;
pub mod entry;
pub mod error;
pub mod meta;
pub mod reader;

#[cfg(test)]
mod tests;

pub use block::{Block, BlockKind, IndexRow};
pub use codec::{Decoded, Decoder, Encoder};
pub use entry::{Answer, Change, Context, Cycle, Entry, LIVE_MAX, Request, request};
pub use error::RecordError;
pub use meta::Meta;
pub use reader::{Item, Note, Reader, Recording};

/// Version of the format that this code writes; it reads every version up to this one.
pub const FORMAT_VERSION: u16 = 1;
/// Ending of the names of recordings.
pub const EXTENSION: &str = "vcrec";
