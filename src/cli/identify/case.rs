//! A case of the reference vectors: one JSON object with inputs in mm and rad; `expect` and `truth` are ignored.

use std::path::Path;

use serde::de::DeserializeOwned;

use crate::cli::files::read_text;
use crate::cli::{EX_DATAERR, Failure};

/// Reads a case file.
pub(super) fn read<T: DeserializeOwned>(path: &Path) -> Result<T, Failure> {
    let text = read_text(path)?;
    let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
    serde_json::from_str(text).map_err(|e| fail(path, e.line(), e.column(), &e))
}

/// A message about a place in a case file.
fn fail(path: &Path, line: usize, column: usize, what: &serde_json::Error) -> Failure {
    let text = what.to_string();
    // the place stands in front already
    let text = text.rsplit_once(" at line ").map_or(text.as_str(), |(text, _)| text);
    Failure::new(EX_DATAERR, format_args!("error: {}:{line}:{column}: {text}", path.display()))
}

/// Prints a result as one JSON object.
pub(super) fn print_json(result: &serde_json::Value) {
    say!("{result:#}");
}
