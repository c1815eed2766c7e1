//! Mistakes in a text file, with their place.

use core::fmt;
use core::ops::Range;

/// One mistake.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Diagnostic {
    /// Byte range in the text; `None` where the mistake has no place (something is missing altogether).
    pub span: Option<Range<usize>>,
    /// What is wrong, with value and limit.
    pub message: String,
    /// What to do about it.
    pub remedy: Option<String>,
}

/// All mistakes found in one file. `Display` shows each with file, line, caret and remedy.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConfigErrors {
    /// The file, as the user named it.
    pub file: String,
    /// Its text.
    pub source: String,
    /// The mistakes, in the order of the text.
    pub diagnostics: Vec<Diagnostic>,
}

impl fmt::Display for ConfigErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {} mistakes", self.file, self.diagnostics.len())
    }
}

impl core::error::Error for ConfigErrors {}
