//! Whole files in and out. A file is replaced only when its new content is complete.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use super::{EX_CONFIG, EX_DATAERR, Failure};
use crate::config;
use crate::core::model::{Model, ModelSpec};

/// A whole file, or standard input for `-`.
pub(super) fn read_bytes(path: &Path) -> Result<Vec<u8>, Failure> {
    let mut bytes = Vec::new();
    let read = if path.as_os_str() == "-" {
        io::stdin().lock().read_to_end(&mut bytes)
    } else {
        File::open(path).and_then(|mut f| f.read_to_end(&mut bytes))
    };
    read.map_err(|e| Failure::io(path, &e))?;
    Ok(bytes)
}

/// A text file, or standard input for `-`.
pub(super) fn read_text(path: &Path) -> Result<String, Failure> {
    text_of(path, read_bytes(path)?)
}

/// The text of a file that was read.
pub(super) fn text_of(path: &Path, bytes: Vec<u8>) -> Result<String, Failure> {
    String::from_utf8(bytes).map_err(|e| {
        let line = e.as_bytes()[..e.utf8_error().valid_up_to()].iter().filter(|b| **b == b'\n').count() + 1;
        Failure::new(
            EX_DATAERR,
            format_args!("error: {}:{line}: not UTF-8 text; save the file as UTF-8", path.display()),
        )
    })
}

/// Reads and compiles a model file.
pub(super) fn read_model(path: &Path) -> Result<(ModelSpec, Model), Failure> {
    let text = read_text(path)?;
    let spec =
        config::model::parse(&path.display().to_string(), &text).map_err(|e| Failure::new(EX_CONFIG, e))?;
    let model = Model::new(&spec)
        .map_err(|e| Failure::new(EX_CONFIG, format_args!("error: {}: {e}", path.display())))?;
    Ok((spec, model))
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
    /// Opens the output.
    pub(super) fn create(path: &Path) -> Result<Self, Failure> {
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
    pub(super) fn finish(mut self) -> Result<(), Failure> {
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

/// Writes a whole file.
pub(super) fn write_text(path: &Path, text: &str) -> Result<(), Failure> {
    let mut output = Output::create(path)?;
    output.write_all(text.as_bytes()).map_err(|e| Failure::io(path, &e))?;
    output.finish()
}
