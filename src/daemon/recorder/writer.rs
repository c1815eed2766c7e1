//! Entries to blocks to files: when to write, when to begin anew, and what to do while the disk refuses.
//!
//! A file only ever grows by whole blocks, each followed by a sync; a block that did not make it is cut off again, or,
//! where even that fails, the file is left and a new one begun. While the disk refuses, entries are counted and let
//! go, and it is tried again every second. A file that was deleted is left and a new one begun, in a new folder where
//! that is gone, too.

use std::io;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;

use tracing::{info, warn};

use super::Stats;
use volcomp_engine::fault::Code;
use volcomp_protocol::record::{BlockKind, Encoder, Entry, IndexRow, block};
use volcomp_units::MonoTime;

/// Bytes of entries after which a block is written before its time.
const BLOCK_BYTES: usize = 256 << 10;
/// Bytes of health that wait for the next entries at most.
const HEALTH_BYTES: usize = 1 << 20;
/// Pause after which a disk that refused is tried again, s.
const RETRY_S: f64 = 1.0;

/// Where files are begun.
pub(super) trait Disk {
    /// A file of it.
    type File: DiskFile;
    /// Begins a file whose first entry has the number `first_record`; gives it with the bytes it already has.
    fn begin(&mut self, first_record: u64, continues: &str) -> io::Result<NewFile<Self::File>>;
    /// The engine goes on with another model, and so do files that are begun from now on; gives the block that tells
    /// the file that is open, `None` where the model is not known.
    fn switch(&mut self, hash: &[u8; 32]) -> Option<Vec<u8>>;
}

/// A file that only grows.
pub(super) trait DiskFile {
    /// Adds bytes at the end.
    fn append(&mut self, bytes: &[u8]) -> io::Result<()>;
    /// Returns when everything added is safe.
    fn sync(&mut self) -> io::Result<()>;
    /// Takes off what was added behind `length` and never became safe.
    fn cut(&mut self, length: u64) -> io::Result<()>;
    /// Whether the file has been deleted: what is written to it is lost when it is closed.
    fn is_deleted(&self) -> io::Result<bool>;
}

/// A file just begun.
#[derive(Debug)]
pub(super) struct NewFile<F> {
    pub(super) file: F,
    pub(super) name: String,
    /// Bytes in it.
    pub(super) length: u64,
}

/// When to write and when to begin a new file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    pub(super) flush_s: f64,
    pub(super) file_bytes: u64,
    pub(super) file_s: f64,
}

#[derive(Debug)]
struct Open<F> {
    file: F,
    name: String,
    length: u64,
    begun: MonoTime,
    rows: Vec<IndexRow>,
}

/// Packs and writes.
#[derive(Debug)]
pub(super) struct Writer<D: Disk> {
    disk: D,
    limits: Limits,
    stats: Arc<Stats>,
    encoder: Encoder,
    /// Blocks of models that go in front of the next entries.
    models: Vec<u8>,
    /// Blocks of health that go in front of the next entries.
    health: Vec<u8>,
    open: Option<Open<D::File>>,
    /// Name of the file before.
    before: String,
    flushed: MonoTime,
    /// The disk refused; nothing is tried before then.
    retry: Option<MonoTime>,
    refused: bool,
}

impl<D: Disk> Writer<D> {
    pub(super) fn new(disk: D, limits: Limits, stats: Arc<Stats>) -> Self {
        Self {
            disk,
            limits,
            stats,
            encoder: Encoder::new(),
            models: Vec::new(),
            health: Vec::new(),
            open: None,
            before: String::new(),
            flushed: MonoTime::ZERO,
            retry: None,
            refused: false,
        }
    }

    /// Takes an entry from the queue.
    pub(super) fn take(&mut self, entry: &Entry, now: MonoTime) {
        if let Entry::Model { hash, .. } = entry {
            // what was done with the old model must not get into a file that begins with the new one
            self.flush(now);
            let block = self.disk.switch(hash);
            self.models.extend(block.unwrap_or_default());
        }
        if self.retry.is_some_and(|at| now < at) {
            self.encoder.skip(entry);
            self.stats.dropped.fetch_add(1, Relaxed);
            return;
        }
        self.retry = None;
        if self.encoder.is_empty() {
            self.flushed = now;
        }
        self.encoder.push(entry);
        if self.encoder.len() >= BLOCK_BYTES {
            self.flush(now);
        }
    }

    /// Takes a word about live estimation; while the disk refuses, it is let go.
    pub(super) fn note_health(&mut self, at: MonoTime, text: &str) {
        let block = block::seal(BlockKind::Health, 0, 0, at.ns, text.as_bytes()).unwrap_or_default();
        if self.health.len() + block.len() <= HEALTH_BYTES {
            self.health.extend(block);
        }
    }

    /// Looks whether something is due.
    pub(super) fn tick(&mut self, now: MonoTime) {
        if !self.encoder.is_empty() && now.seconds_since(self.flushed) >= self.limits.flush_s {
            self.flush(now);
        }
    }

    /// Writes what is left and closes the file.
    pub(super) fn finish(&mut self, now: MonoTime) {
        self.flush(now);
        self.close();
        self.stats.set_file(None);
    }

    fn flush(&mut self, now: MonoTime) {
        let (first_record, first_ns, records) = self.encoder.pending();
        let Some(bytes) = self.encoder.seal() else { return };
        self.flushed = now;
        match self.write(&bytes, IndexRow { at: 0, first_record, first_ns, records }, now) {
            Ok(()) => {
                self.stats.records.fetch_add(records.into(), Relaxed);
                self.stats.bytes.fetch_add(bytes.len() as u64, Relaxed);
                if std::mem::take(&mut self.refused) {
                    info!(dropped = self.stats.dropped.load(Relaxed), "recording again");
                    self.stats.set_error(None);
                }
            }
            Err(error) => {
                self.stats.dropped.fetch_add(records.into(), Relaxed);
                self.retry = Some(now.plus_seconds(RETRY_S));
                // one line per refusal, not one per attempt
                if !std::mem::replace(&mut self.refused, true) {
                    warn!(%error, code = %Code::RECORDING_STOPPED, "recording stops until there is room; records are counted and dropped");
                }
                self.stats.set_error(Some(error.to_string()));
            }
        }
    }

    fn write(&mut self, bytes: &[u8], row: IndexRow, now: MonoTime) -> io::Result<()> {
        let health = std::mem::take(&mut self.health);
        let length = (self.models.len() + health.len() + bytes.len()) as u64;
        let full = self.open.as_ref().is_some_and(|open| {
            !open.rows.is_empty()
                && (open.length.saturating_add(length) > self.limits.file_bytes
                    || now.seconds_since(open.begun) >= self.limits.file_s)
        });
        if full {
            self.close();
        }
        if self.open.is_none() {
            let NewFile { file, name, length } = self.disk.begin(row.first_record, &self.before)?;
            self.stats.set_file(Some(name.clone()));
            self.open = Some(Open { file, name, length, begun: now, rows: Vec::new() });
            // the file begins with the newest model
            self.models.clear();
        }
        let Some(open) = &mut self.open else { return Ok(()) };
        let models = self.models.len() as u64;
        let before = models + health.len() as u64;
        self.models.extend_from_slice(&health);
        self.models.extend_from_slice(bytes);
        let written = open.file.append(&self.models).and_then(|()| open.file.sync());
        self.models.truncate(models as usize);
        if open.file.is_deleted()? {
            let text = format!("{} was deleted while it was written", open.name);
            self.leave();
            self.stats.set_file(None);
            return Err(io::Error::new(io::ErrorKind::NotFound, text));
        }
        match written {
            Ok(()) => {
                open.rows.push(IndexRow { at: open.length + before, ..row });
                open.length += before + bytes.len() as u64;
                self.models.clear();
            }
            Err(_) => {
                // what never became safe goes, what was there stays
                if open.file.cut(open.length).is_err() {
                    self.leave();
                }
            }
        }
        written
    }

    /// Closes the file with its index; one without an index is as good, it only takes longer to read.
    fn close(&mut self) {
        let Some(mut open) = self.open.take() else { return };
        if let Some(index) = block::index(&open.rows, open.length) {
            let written = open.file.append(&index).and_then(|()| open.file.sync());
            if written.is_err() {
                let _ = open.file.cut(open.length);
            }
        }
        self.before = open.name;
    }

    fn leave(&mut self) {
        if let Some(open) = self.open.take() {
            self.before = open.name;
        }
    }
}

#[cfg(test)]
mod tests;
