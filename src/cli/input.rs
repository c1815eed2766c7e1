//! Files and standard input, read within a documented largest size (docs/reference/limits.md).
//!
//! Every file that a program of this package reads comes through [`open`], [`read`], [`read_text`] or [`hash`]. A
//! regular file is refused by its length before it is read; a device, a pipe or a file of `/proc` has no length and is
//! refused at the first byte beyond the limit.

use std::fs::{File, OpenOptions};
use std::io::{self, BufReader, Cursor, ErrorKind, Read};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::time::{Duration, Instant};

use rustix::fs::OFlags;

use crate::prelude::*;

/// Longest wait for the writer of a FIFO.
const WRITER_TIMEOUT: Duration = Duration::from_secs(5);
/// Pause between two looks for the writer of a FIFO.
const WRITER_POLL: Duration = Duration::from_millis(10);
/// Bytes read at a time.
const CHUNK: usize = 1 << 16;
/// Most rows of a table whose rows are kept in memory.
pub(crate) const ROWS_MAX: u64 = 4_000_000;

const KIB: u64 = 1 << 10;
const MIB: u64 = 1 << 20;
const GIB: u64 = 1 << 30;

/// Kind of an input, which has a largest size. An argument of no command: the derive lists all kinds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum InputKind {
    /// A machine file of the daemon.
    Machine,
    /// A model file, or an addition of a diagnosis.
    Model,
    /// A TOML description of a set-up, a test, a machine of the simulator or a column map.
    Description,
    /// A case of the reference vectors in JSON.
    Case,
    /// A CSV table whose rows are kept in memory.
    Table,
    /// A file that is read row by row or block by block in bounded memory.
    Stream,
    /// A file of an instrument or a compensation table of a control.
    Instrument,
    /// A JSON capture of SINUMERIK Edge.
    Capture,
    /// A recording of the daemon.
    Recording,
    /// The audit log of the daemon.
    AuditLog,
    /// A part program.
    PartProgram,
}

impl InputKind {
    /// The kind in words with its article, its largest size in bytes, and what to do about a larger one.
    const fn about(self) -> (&'static str, u64, &'static str) {
        use volcomp_state::bounded_read::{MACHINE_BYTES_MAX, MODEL_BYTES_MAX};
        const FEWER_ROWS: &str = "split the table, or keep every n-th row";
        match self {
            Self::Machine => ("a machine file", MACHINE_BYTES_MAX, "name the machine file of volcompd"),
            // a parsed TOML text takes up to 80 times its length
            Self::Model => ("a model file", MODEL_BYTES_MAX, "name a model file, or fit it with fewer knots"),
            Self::Description => ("a description in TOML", MIB, "name the TOML text that --help describes"),
            Self::Case => ("a case of the reference vectors", 16 * MIB, "keep one case in the file"),
            Self::Table => ("a table", 256 * MIB, FEWER_ROWS),
            Self::Stream => ("a table or series read row by row", 64 * GIB, FEWER_ROWS),
            Self::Instrument => (
                "an instrument file or control table",
                64 * MIB,
                "export it again with fewer points, or split it",
            ),
            Self::Capture => ("a capture of SINUMERIK Edge", 512 * MIB, "capture a shorter time"),
            // the largest `file-max-mb` is 4000
            Self::Recording => {
                ("a recording", 4 * GIB, "lower file-max-mb in [recording] of the machine file")
            }
            Self::AuditLog => ("an audit log", 256 * MIB, "name one segment of the log"),
            Self::PartProgram => ("a part program", 64 * MIB, "split the program"),
        }
    }

    /// Largest size, bytes.
    #[must_use]
    pub const fn limit(self) -> u64 {
        self.about().1
    }

    /// Largest size in words.
    #[must_use]
    pub fn size(self) -> String {
        size(self.limit())
    }

    /// The kind in words, with its article.
    #[must_use]
    pub const fn name(self) -> &'static str {
        self.about().0
    }

    /// Refuses a text that turned out to be of this kind and is larger than the kind allows.
    ///
    /// # Errors
    /// The text is too large.
    pub(super) fn check_length(self, path: &Path, bytes: usize) -> Result<()> {
        let bytes = bytes as u64;
        if bytes <= self.limit() {
            return Ok(());
        }
        Err(Failure::data(path, TooLarge { bytes: Some(bytes), kind: self }))
    }

    const fn remedy(self) -> &'static str {
        self.about().2
    }
}

/// A size in bytes with the unit that divides it.
fn size(bytes: u64) -> String {
    for (unit, name) in [(GIB, "GiB"), (MIB, "MiB"), (KIB, "KiB")] {
        if bytes >= unit && bytes.is_multiple_of(unit) {
            return format!("{} {name}", bytes / unit);
        }
    }
    match bytes {
        1 => "1 byte".to_owned(),
        _ => format!("{bytes} bytes"),
    }
}

/// An input beyond its limit.
#[derive(Debug, thiserror::Error)]
#[error("{}; the limit for {} is {}\n  hint: {}", found(*.bytes, *.kind), kind.name(), size(kind.limit()), kind.remedy())]
struct TooLarge {
    /// Length, where it is known.
    bytes: Option<u64>,
    kind: InputKind,
}

fn found(bytes: Option<u64>, kind: InputKind) -> String {
    bytes.map_or_else(|| format!("more than {}", size(kind.limit())), size)
}

/// True for the error of an input beyond its limit; a file system's own limit on writing is another error.
pub(super) fn is_too_large(error: &io::Error) -> bool {
    error.get_ref().is_some_and(|inner| inner.is::<TooLarge>())
}

/// An open input that ends with an error beyond its limit.
pub struct Input {
    source: Box<dyn Read>,
    kind: InputKind,
    left: u64,
    length: Option<u64>,
}

impl core::fmt::Debug for Input {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Input").field("kind", &self.kind).field("left", &self.left).finish_non_exhaustive()
    }
}

impl Input {
    fn new(source: Box<dyn Read>, kind: InputKind, length: Option<u64>) -> Self {
        Self { source, kind, left: kind.limit(), length }
    }

    /// With a buffer.
    #[must_use]
    pub fn buffered(self) -> BufReader<Self> {
        BufReader::with_capacity(CHUNK, self)
    }
}

impl Read for Input {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.left == 0 && !buffer.is_empty() {
            // one more byte decides
            return match self.source.read(&mut buffer[..1])? {
                0 => Ok(0),
                _ => Err(io::Error::new(ErrorKind::FileTooLarge, TooLarge { bytes: None, kind: self.kind })),
            };
        }
        let room = usize::try_from(self.left).unwrap_or(usize::MAX).min(buffer.len());
        let read = self.source.read(&mut buffer[..room])?;
        self.left -= read as u64;
        Ok(read)
    }
}

/// Opens a file, or standard input for `-`.
///
/// # Errors
/// The file cannot be opened, is a directory, is a FIFO that nobody writes, or is larger than its kind allows.
#[expect(clippy::disallowed_methods, reason = "the one place that opens files to read")]
pub fn open(path: &Path, kind: InputKind) -> Result<Input> {
    if path.as_os_str() == "-" {
        return Ok(Input::new(Box::new(io::stdin().lock()), kind, None));
    }
    let io = |e: io::Error| Failure::io(path, &e);
    // without O_NONBLOCK the opening of a FIFO waits for its writer for ever
    let flags = i32::try_from(OFlags::NONBLOCK.bits()).unwrap_or_default();
    let file = OpenOptions::new().read(true).custom_flags(flags).open(path).map_err(io)?;
    super::targets::record_input(path);
    let metadata = file.metadata().map_err(io)?;
    if metadata.is_dir() {
        return Err(failure!(EX_IOERR, "{}: is a directory; expected {}", path.display(), kind.name()));
    }
    let length = metadata.is_file().then_some(metadata.len());
    if let Some(bytes) = length.filter(|bytes| *bytes > kind.limit()) {
        return Err(Failure::data(path, TooLarge { bytes: Some(bytes), kind }));
    }
    let first = if metadata.file_type().is_fifo() { first_bytes(path, &file)? } else { Vec::new() };
    rustix::io::ioctl_fionbio(&file, false).map_err(|e| io(e.into()))?;
    let source: Box<dyn Read> =
        if first.is_empty() { Box::new(file) } else { Box::new(Cursor::new(first).chain(file)) };
    Ok(Input::new(source, kind, length))
}

/// Waits until a FIFO has a writer; gives what has been read meanwhile.
#[expect(clippy::disallowed_methods, reason = "the wait for the writer of a FIFO takes real time")]
fn first_bytes(path: &Path, mut file: &File) -> Result<Vec<u8>> {
    // a pipe of the shell, `<(...)`, has no path of its own: its end is an end
    let is_anonymous = path.canonicalize().is_err();
    let begun = Instant::now();
    let mut bytes = vec![0; CHUNK];
    loop {
        match file.read(&mut bytes) {
            Ok(0) if is_anonymous => return Ok(Vec::new()),
            Ok(0) if begun.elapsed() >= WRITER_TIMEOUT => {
                let (path, seconds) = (path.display(), WRITER_TIMEOUT.as_secs());
                return Err(failure!(
                    EX_IOERR,
                    "{path}: nothing was written into this FIFO for {seconds} s\n  hint: start the program that writes it, then try again"
                ));
            }
            Ok(0) => std::thread::sleep(WRITER_POLL),
            Ok(read) => {
                bytes.truncate(read);
                return Ok(bytes);
            }
            // there is a writer, and nothing to read yet
            Err(e) if e.kind() == ErrorKind::WouldBlock => return Ok(Vec::new()),
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Err(e) => return Err(Failure::io(path, &e)),
        }
    }
}

/// A whole file, or standard input for `-`.
///
/// # Errors
/// See [`open`]; or the file cannot be read.
pub fn read(path: &Path, kind: InputKind) -> Result<Vec<u8>> {
    read_rest(path, open(path, kind)?, Vec::new())
}

/// What is left of an input behind `bytes`.
pub(super) fn read_rest(path: &Path, mut input: Input, mut bytes: Vec<u8>) -> Result<Vec<u8>> {
    let io = |e: &io::Error| Failure::io(path, e);
    let missing = usize::try_from(input.length.unwrap_or_default()).unwrap_or(usize::MAX);
    reserve(path, &mut bytes, missing.saturating_add(1))?;
    loop {
        if bytes.capacity() == bytes.len() {
            let more = bytes.len().max(CHUNK);
            reserve(path, &mut bytes, more)?;
        }
        let room = (bytes.capacity() - bytes.len()) as u64;
        // never beyond what has been reserved
        match (&mut input).take(room.min(CHUNK as u64 * 16)).read_to_end(&mut bytes) {
            Ok(0) => return Ok(bytes),
            Ok(_) => {}
            Err(e) => return Err(io(&e)),
        }
    }
}

/// Makes room without ending the program where there is none.
fn reserve(path: &Path, bytes: &mut Vec<u8>, more: usize) -> Result<()> {
    bytes.try_reserve_exact(more).map_err(|_| {
        failure!(
            EX_IOERR,
            "{}: not enough memory for {} bytes\n  hint: read it on a computer with more memory",
            path.display(),
            bytes.len().saturating_add(more)
        )
    })
}

/// A text file, or standard input for `-`.
///
/// # Errors
/// See [`read`]; or the file is not UTF-8, which is a mistake in a configuration and bad data elsewhere.
pub fn read_text(path: &Path, kind: InputKind) -> Result<String> {
    text_of(path, read(path, kind)?).map_err(|e| match kind {
        InputKind::Machine | InputKind::Model | InputKind::Description => Failure { code: EX_CONFIG, ..e },
        _ => e,
    })
}

/// The text of a file that was read.
pub(super) fn text_of(path: &Path, bytes: Vec<u8>) -> Result<String> {
    String::from_utf8(bytes).map_err(|e| {
        let line = e.as_bytes()[..e.utf8_error().valid_up_to()].iter().filter(|b| **b == b'\n').count() + 1;
        failure!(EX_DATAERR, "{}:{line}: not UTF-8 text; save the file as UTF-8", path.display())
    })
}

/// The first bytes of a file, at most `most`.
///
/// # Errors
/// See [`read`].
pub(super) fn head(path: &Path, kind: InputKind, most: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open(path, kind)?.take(most).read_to_end(&mut bytes).map_err(|e| Failure::io(path, &e))?;
    Ok(bytes)
}

/// True for what can be read twice: a regular file.
#[expect(clippy::disallowed_methods, reason = "metadata distinguish regular files from streams")]
pub(super) fn is_regular(path: &Path) -> bool {
    path.as_os_str() != "-" && std::fs::metadata(path).is_ok_and(|m| m.is_file())
}

/// Refuses what is no regular file within its limit, for a file that another part of the program reads.
pub(super) fn check(path: &Path, kind: InputKind) -> Result<()> {
    open(path, kind)?;
    if is_regular(path) {
        return Ok(());
    }
    Err(data!(path, "not a regular file; expected {}", kind.name()))
}

/// BLAKE3 of a regular file as hexadecimal digits; `None` for what cannot be read twice, such as a pipe.
pub(super) fn hash(path: &Path, kind: InputKind) -> Option<String> {
    if !is_regular(path) {
        return None;
    }
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(open(path, kind).ok()?).ok()?;
    Some(hasher.finalize().to_hex().to_string())
}
