//! A disk in memory whose operations fail as a test asks for it: full, torn, hanging, without power. Tests of the state
//! directory and of the daemon include this file; it is no part of a program.

#![allow(dead_code, reason = "each test uses its share")]

use std::collections::BTreeMap;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use volcomp_state::disk::{Append, Disk};

/// One operation that changes the disk.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Change {
    /// A file was written as a whole.
    Write(PathBuf, Vec<u8>),
    /// A file was renamed.
    Rename(PathBuf, PathBuf),
    /// A file grew.
    Append(PathBuf, Vec<u8>),
    /// A file was cut off.
    Cut(PathBuf, u64),
}

/// What happens to the next operation that writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Health {
    /// It succeeds.
    #[default]
    Well,
    /// It fails without effect.
    Full,
    /// It writes so many bytes and fails.
    Torn(usize),
    /// The power is off: it fails without effect.
    Off,
}

/// An operation that a disk may refuse for a path; see [`MemoryDisk::refuse`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Operation {
    /// Reading a file.
    Read,
    /// Renaming a file that has this name.
    Rename,
    /// Making the names in a folder durable.
    SyncFolder,
    /// Listing a folder.
    List,
}

#[derive(Debug, Default)]
struct Inner {
    files: BTreeMap<PathBuf, Vec<u8>>,
    changes: Vec<Change>,
    refused: BTreeMap<(Operation, PathBuf), ErrorKind>,
}

/// Called before every operation that writes: a test may wait here, and says what happens.
type Gate = Arc<dyn Fn() -> Health + Send + Sync>;

/// A disk in memory. Clones share their files.
#[derive(Clone, Default)]
pub(crate) struct MemoryDisk {
    inner: Arc<Mutex<Inner>>,
    gate: Option<Gate>,
}

impl core::fmt::Debug for MemoryDisk {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("MemoryDisk").field("files", &self.lock().files.keys()).finish_non_exhaustive()
    }
}

impl MemoryDisk {
    /// An empty disk.
    #[must_use]
    pub(crate) fn new() -> Self {
        Self::default()
    }

    /// The same files behind a gate that is passed before every operation that writes.
    #[must_use]
    pub(crate) fn behind(&self, gate: impl Fn() -> Health + Send + Sync + 'static) -> Self {
        Self { inner: Arc::clone(&self.inner), gate: Some(Arc::new(gate)) }
    }

    /// A disk with these files.
    #[must_use]
    pub(crate) fn with(files: BTreeMap<PathBuf, Vec<u8>>) -> Self {
        let disk = Self::default();
        disk.lock().files = files;
        disk
    }

    /// From now on `operation` on `path` fails with an error of this kind and without effect.
    pub(crate) fn refuse(&self, operation: Operation, path: &Path, kind: ErrorKind) {
        self.lock().refused.insert((operation, path.to_owned()), kind);
    }

    fn permit(&self, operation: Operation, path: &Path) -> io::Result<()> {
        match self.lock().refused.get(&(operation, path.to_owned())) {
            Some(kind) => Err(io::Error::from(*kind)),
            None => Ok(()),
        }
    }

    /// Every file.
    #[must_use]
    pub(crate) fn files(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        self.lock().files.clone()
    }

    /// Every change so far, in order.
    #[must_use]
    pub(crate) fn changes(&self) -> Vec<Change> {
        self.lock().changes.clone()
    }

    /// Applies a change.
    pub(crate) fn apply(&self, change: Change) {
        let mut inner = self.lock();
        match change.clone() {
            Change::Write(path, bytes) => {
                inner.files.insert(path, bytes);
            }
            Change::Rename(from, to) => {
                if let Some(bytes) = inner.files.remove(&from) {
                    inner.files.insert(to, bytes);
                }
            }
            Change::Append(path, bytes) => inner.files.entry(path).or_default().extend(bytes),
            Change::Cut(path, length) => {
                let file = inner.files.entry(path).or_default();
                file.truncate(usize::try_from(length).unwrap_or(usize::MAX));
            }
        }
        inner.changes.push(change);
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Passes the gate; gives how many of `length` bytes are written, `None` for no effect at all, and the result.
    fn admit(&self, length: usize) -> (Option<usize>, io::Result<()>) {
        let full = || Err(io::Error::new(ErrorKind::StorageFull, "no space left on device"));
        match self.gate.as_ref().map_or(Health::Well, |gate| gate()) {
            Health::Well => (Some(length), Ok(())),
            Health::Full => (Some(0), full()),
            Health::Torn(bytes) => (Some(bytes.min(length)), full()),
            Health::Off => (None, full()),
        }
    }
}

fn missing() -> io::Error {
    io::Error::new(ErrorKind::NotFound, "no such file or directory")
}

impl Disk for MemoryDisk {
    fn read(&self, path: &Path, limit_bytes: u64) -> io::Result<Vec<u8>> {
        self.permit(Operation::Read, path)?;
        let bytes = self.lock().files.get(path).cloned().ok_or_else(missing)?;
        if bytes.len() as u64 > limit_bytes {
            return Err(io::Error::new(ErrorKind::FileTooLarge, format!("{} bytes", bytes.len())));
        }
        Ok(bytes)
    }

    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let (count, result) = self.admit(bytes.len());
        if let Some(count) = count {
            self.apply(Change::Write(path.to_owned(), bytes[..count].to_vec()));
        }
        result
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.permit(Operation::Rename, from)?;
        if !self.lock().files.contains_key(from) {
            return Err(missing());
        }
        self.admit(0).1?;
        self.apply(Change::Rename(from.to_owned(), to.to_owned()));
        Ok(())
    }

    fn sync_folder(&self, folder: &Path) -> io::Result<()> {
        self.permit(Operation::SyncFolder, folder)
    }

    fn create_folder(&self, _folder: &Path) -> io::Result<()> {
        Ok(())
    }

    fn list(&self, folder: &Path) -> io::Result<Vec<String>> {
        self.permit(Operation::List, folder)?;
        let inner = self.lock();
        let mut names: Vec<String> = inner
            .files
            .keys()
            .filter_map(|path| path.strip_prefix(folder).ok()?.components().next())
            .map(|name| name.as_os_str().to_string_lossy().into_owned())
            .collect();
        names.dedup();
        Ok(names)
    }

    fn open_append(&self, path: &Path) -> io::Result<Box<dyn Append>> {
        if !self.lock().files.contains_key(path) {
            self.admit(0).1?;
            self.apply(Change::Write(path.to_owned(), Vec::new()));
        }
        Ok(Box::new(MemoryFile { disk: self.clone(), path: path.to_owned() }))
    }

    fn hash(&self, path: &Path) -> io::Result<String> {
        let bytes = self.read(path, u64::MAX)?;
        Ok(blake3::hash(&bytes).to_hex().to_string())
    }
}

/// An open file of a [`MemoryDisk`].
#[derive(Debug)]
struct MemoryFile {
    disk: MemoryDisk,
    path: PathBuf,
}

impl Append for MemoryFile {
    fn length(&self) -> io::Result<u64> {
        self.disk.lock().files.get(&self.path).map(|bytes| bytes.len() as u64).ok_or_else(missing)
    }

    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        let (count, result) = self.disk.admit(bytes.len());
        if let Some(count) = count {
            self.disk.apply(Change::Append(self.path.clone(), bytes[..count].to_vec()));
        }
        result
    }

    fn cut(&mut self, length: u64) -> io::Result<()> {
        self.disk.admit(0).1?;
        self.disk.apply(Change::Cut(self.path.clone(), length));
        Ok(())
    }
}
