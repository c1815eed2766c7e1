//! Exit codes, and how a failure becomes one.

#![expect(clippy::disallowed_methods, reason = "the one place that writes to stdout and stderr")]

use core::fmt;
use core::sync::atomic::{AtomicBool, Ordering};
use std::ffi::OsString;
use std::io::{ErrorKind, Write};
use std::path::Path;
use std::process::ExitCode;

use clap::Parser;
use volcomp_config::ConfigErrors;
use volcomp_state::bounded_read::in_words;

use super::Result;
use super::numerals::{micro, printable};

/// Wrong usage.
pub const EX_USAGE: u8 = 64;
/// Bad data.
pub const EX_DATAERR: u8 = 65;
/// An error of this program.
pub const EX_SOFTWARE: u8 = 70;
/// A file or socket could not be used.
pub const EX_IOERR: u8 = 74;
/// Bad configuration or model.
pub const EX_CONFIG: u8 = 78;

/// Why a program ends without having done its work.
#[derive(Debug)]
pub struct Failure {
    /// Exit code.
    pub code: u8,
    /// What to tell the user; may have several lines.
    pub message: String,
}

impl Failure {
    /// A failure with its exit code.
    pub fn new(code: u8, message: impl fmt::Display) -> Self {
        Self { code, message: message.to_string() }
    }

    /// A wrong command line.
    pub fn usage(what: impl fmt::Display) -> Self {
        Self::new(EX_USAGE, format_args!("error: {what}"))
    }

    /// Bad data in a file.
    pub fn data(path: impl AsRef<Path>, what: impl fmt::Display) -> Self {
        Self::new(EX_DATAERR, format_args!("error: {}: {what}", path.as_ref().display()))
    }

    /// A mistake in a machine or model file.
    pub fn mistake(path: impl AsRef<Path>, what: impl fmt::Display) -> Self {
        Self::new(EX_CONFIG, format_args!("error: {}: {what}", path.as_ref().display()))
    }

    /// A file that could not be read or written; one that is too large is bad data.
    pub fn io(path: &Path, error: &std::io::Error) -> Self {
        if super::input::is_too_large(error) {
            return Self::data(path, error);
        }
        if error.kind() == ErrorKind::BrokenPipe && STDOUT_NAMES.iter().any(|name| path.as_os_str() == *name)
        {
            // `| head`: the work ends quietly
            return Self::new(0, "");
        }
        Self::new(EX_IOERR, format_args!("error: {}: {}", path.display(), in_words(path, error)))
    }
}

impl From<ConfigErrors> for Failure {
    fn from(errors: ConfigErrors) -> Self {
        Self::new(EX_CONFIG, errors)
    }
}

/// What a drawing library could not draw.
impl From<Box<dyn core::error::Error>> for Failure {
    fn from(error: Box<dyn core::error::Error>) -> Self {
        Self::new(EX_SOFTWARE, format_args!("error: picture: {error}"))
    }
}

/// Something could not be written to stdout.
static OUTPUT_LOST: AtomicBool = AtomicBool::new(false);
/// The reader of stdout has ended.
static READER_GONE: AtomicBool = AtomicBool::new(false);

const OUTPUT_INCOMPLETE: &str = "error: stdout could not be written; the output is incomplete";
/// Names that stand for stdout in errors.
const STDOUT_NAMES: [&str; 3] = ["-", "<stdout>", "stdout"];

/// True where the reader of stdout has ended (`| head`), so that further output is in vain.
pub(super) fn reader_gone() -> bool {
    READER_GONE.load(Ordering::Relaxed)
}

/// Writes text to stdout; a reader that has seen enough (`| head`) is no failure.
pub(super) fn print(text: &str) -> Result<()> {
    match std::io::stdout().lock().write_all(text.as_bytes()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(Failure::io(Path::new("stdout"), &e)),
        _ => Ok(()),
    }
}

/// Writes a line to stdout. A reader that has seen enough (`| head`) is no failure; a full disk is, and is reported at
/// the end of the program.
pub fn line(text: fmt::Arguments<'_>) {
    match writeln!(std::io::stdout().lock(), "{text}") {
        Ok(()) => {}
        Err(e) if e.kind() == ErrorKind::BrokenPipe => READER_GONE.store(true, Ordering::Relaxed),
        Err(_) => OUTPUT_LOST.store(true, Ordering::Relaxed),
    }
}

/// Writes a line to stderr, units as a person writes them. A reader that has seen enough, or a full disk, is no failure: the exit code still tells.
pub fn note(text: fmt::Arguments<'_>) {
    note_text(format_args!("{}\n", printable(&micro(&text.to_string()))));
}

/// Writes text to stderr without an end of line; see [`note!`].
pub fn note_text(text: fmt::Arguments<'_>) {
    // there is nowhere left to say that stderr cannot be written
    let _ = std::io::stderr().lock().write_fmt(text);
}

/// The failure of a program that could not write all it had to say.
///
/// # Errors
/// Something was lost.
pub fn output_complete() -> Result<()> {
    let flushed = std::io::stdout().lock().flush();
    let lost = flushed.is_err_and(|e| e.kind() != ErrorKind::BrokenPipe);
    if lost || OUTPUT_LOST.load(Ordering::Relaxed) {
        return Err(Failure::new(EX_IOERR, OUTPUT_INCOMPLETE));
    }
    Ok(())
}

/// Prints what the parser of the command line has to say: a mistake to stderr, the help to stdout.
pub fn not_parsed(error: &clap::Error) -> ExitCode {
    let printed = error.print();
    if error.use_stderr() {
        // a message that cannot be written is lost; the exit code still tells
        return ExitCode::from(EX_USAGE);
    }
    let lost = printed.is_err_and(|e| e.kind() != ErrorKind::BrokenPipe);
    if lost || output_complete().is_err() {
        note(format_args!("{OUTPUT_INCOMPLETE}"));
        return ExitCode::from(EX_IOERR);
    }
    ExitCode::SUCCESS
}

/// Parses arguments, runs, prints what went wrong, and turns it into an exit code.
pub(super) fn run<A: Parser>(
    command: clap::Command,
    args: impl IntoIterator<Item = OsString>,
    body: impl FnOnce(A) -> Result<()>,
) -> ExitCode {
    let parsed = match super::ranges::parse_with::<A>(command, args) {
        Ok(parsed) => parsed,
        Err(e) => return not_parsed(&e),
    };
    match body(parsed).and_then(|()| output_complete()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            // an exit code alone can be the answer, as of `diff`
            if !failure.message.is_empty() {
                note(format_args!("{}", failure.message.trim_end()));
            }
            ExitCode::from(failure.code)
        }
    }
}
