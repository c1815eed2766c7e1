//! Model files in, whole files out. A file is replaced only when its new content is complete.

#![expect(clippy::disallowed_methods, reason = "the one place that creates and replaces files")]

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Write};

use crate::prelude::*;

/// What a description in TOML holds.
pub(super) fn from_toml<T: serde::de::DeserializeOwned>(path: &Path, text: &str) -> Result<T> {
    toml::from_str(text.strip_prefix('\u{feff}').unwrap_or(text)).map_err(|e| mistake!(path, "{e}"))
}

/// Reads a model file with what it says about its origin.
pub(super) fn read_model_file(path: &Path) -> Result<ModelFile> {
    read_hashed_model_file(path).map(|(file, _)| file)
}

/// The same, with the BLAKE3 of the file as hexadecimal digits.
pub(super) fn read_hashed_model_file(path: &Path) -> Result<(ModelFile, String)> {
    let text = input::read_text(path, InputKind::Model)?;
    let file = config::model::parse_file(&path.display().to_string(), &text)?;
    Ok((file, blake3::hash(text.as_bytes()).to_hex().to_string()))
}

/// Reads and compiles a model file.
pub(super) fn read_model(path: &Path) -> Result<(ModelSpec, Model)> {
    read_hashed_model(path).map(|(spec, model, _)| (spec, model))
}

/// Reads and compiles a model file; with the BLAKE3 of the file as hexadecimal digits.
pub(super) fn read_hashed_model(path: &Path) -> Result<(ModelSpec, Model, String)> {
    let (ModelFile { spec, .. }, hash) = read_hashed_model_file(path)?;
    let model = Model::new(&spec).map_err(|e| mistake!(path, "{e}"))?;
    Ok((spec, model, hash))
}

/// An output that appears under its name only when finished; `-` is standard output, as is anything written
/// straight through (a pipe, a device).
pub(super) enum Output {
    /// A temporary file beside the target.
    Beside { file: File, temporary: PathBuf, target: PathBuf, finished: bool },
    /// Straight through.
    Through(Box<dyn Write>, PathBuf),
}

impl Output {
    /// Opens the output; refuses a file that the command has read.
    pub(super) fn create(path: &Path) -> Result<Self> {
        super::targets::check(path)?;
        Self::replace(path)
    }

    /// The same for a file that the command may replace with its successor.
    fn replace(path: &Path) -> Result<Self> {
        if path.as_os_str() == "-" {
            return Ok(Self::Through(Box::new(io::stdout().lock()), PathBuf::from("<stdout>")));
        }
        let special = fs::metadata(path).is_ok_and(|m| !m.is_file());
        if special {
            let file = File::options().write(true).open(path).map_err(|e| Failure::io(path, &e))?;
            return Ok(Self::Through(Box::new(file), path.to_owned()));
        }
        let mut name = OsString::from(".");
        name.push(path.file_name().unwrap_or_default());
        name.push(format!(".{}.tmp", std::process::id()));
        let temporary = path.with_file_name(name);
        let file = File::create(&temporary).map_err(|e| Failure::io(path, &e))?;
        Ok(Self::Beside { file, temporary, target: path.to_owned(), finished: false })
    }

    /// Puts the finished output in its place.
    pub(super) fn finish(mut self) -> Result<()> {
        match &mut self {
            Self::Through(out, path) => out.flush().map_err(|e| Failure::io(path, &e)),
            Self::Beside { file, temporary, target, finished } => {
                let done = file.sync_all().and_then(|()| fs::rename(&temporary, &target));
                *finished = done.is_ok();
                done.map_err(|e| Failure::io(target, &e))
            }
        }
    }

    /// The name to report errors under.
    pub(super) fn path(&self) -> &Path {
        match self {
            Self::Beside { target, .. } => target,
            Self::Through(_, path) => path,
        }
    }
}

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Beside { file, .. } => file.write(bytes),
            Self::Through(out, _) => out.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Beside { file, .. } => file.flush(),
            Self::Through(out, _) => out.flush(),
        }
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        if let Self::Beside { temporary, finished: false, .. } = self {
            // an unfinished file is worth nothing; where it cannot be removed there is nobody to tell
            let _ = fs::remove_file(temporary);
        }
    }
}

/// Writes a whole file; refuses one that the command has read.
pub(super) fn write_text(path: &Path, text: &str) -> Result<()> {
    write_whole(Output::create(path)?, path, text)
}

/// Writes the continuation of the file `before`, which it may replace.
pub(super) fn continue_text(before: Option<&Path>, path: &Path, text: &str) -> Result<()> {
    if before == Some(path) {
        write_whole(Output::replace(path)?, path, text)
    } else {
        write_text(path, text)
    }
}

/// Writes a model file; refuses to replace a file that is none.
pub(super) fn write_model(path: &Path, text: &str) -> Result<()> {
    super::targets::check_model(path)?;
    write_whole(Output::replace(path)?, path, text)
}

fn write_whole(mut output: Output, path: &Path, text: &str) -> Result<()> {
    output.write_all(text.as_bytes()).map_err(|e| Failure::io(path, &e))?;
    output.finish()
}

/// Rows of a table that go to an output in blocks, so that memory is bounded whatever the input is.
pub(super) struct Rows {
    output: Output,
    /// What is not written yet.
    pub(super) block: Vec<u8>,
    is_begun: bool,
}

impl Rows {
    /// Bytes gathered before they are written.
    const BLOCK: usize = 1 << 16;

    /// Opens the output.
    pub(super) fn create(path: &Path) -> Result<Self> {
        Ok(Self {
            output: Output::create(path)?,
            block: Vec::with_capacity(Self::BLOCK + 4096),
            is_begun: false,
        })
    }

    /// True where there is no row yet.
    pub(super) const fn is_empty(&self) -> bool {
        !self.is_begun
    }

    /// Ends a row.
    pub(super) fn row_end(&mut self) -> Result<()> {
        self.is_begun = true;
        self.block.push(b'\n');
        if self.block.len() >= Self::BLOCK { self.flush() } else { Ok(()) }
    }

    /// Writes what is gathered; where the reader of a pipe has gone, the work ends quietly.
    pub(super) fn flush(&mut self) -> Result<()> {
        let done = self.output.write_all(&self.block);
        self.block.clear();
        done.map_err(|e| match e.kind() {
            io::ErrorKind::BrokenPipe => Failure::new(0, ""),
            _ => Failure::io(self.output.path(), &e),
        })
    }

    /// Writes the rest and puts the output in its place.
    pub(super) fn finish(mut self) -> Result<()> {
        self.flush()?;
        self.output.finish()
    }
}
