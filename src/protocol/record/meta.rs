//! What a recording says about itself: readable text, so that a person with `strings` can tell what it is.

use serde::{Deserialize, Serialize};

use super::error::RecordError;

/// The `format` of the description.
pub const FORMAT: &str = "volcomp-recording/1";

/// Description of a recording. Keys may be added in later versions.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Meta {
    /// `volcomp-recording/1`.
    pub format: String,
    /// Program and version that wrote it.
    pub software: String,
    /// Machine id.
    pub machine: String,
    /// Path of the machine file on the machine that recorded.
    pub config: String,
    /// BLAKE3 of the machine file, hex.
    pub config_hash: String,
    /// Path of the model file on the machine that recorded.
    pub model: String,
    /// BLAKE3 of the model file, hex.
    pub model_hash: String,
    /// When the file was begun, UTC, RFC 3339.
    pub begun: String,
    /// The same moment on the daemon's clock, ns; entries carry times of that clock.
    pub begun_ns: i64,
    /// Number of the file's first entry in this run of the daemon; 0 for the first file of a run.
    pub first_record: u64,
    /// Identifies the run of the daemon: files with the same text continue each other.
    pub run: String,
    /// Name of the file that this one continues.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub continues: String,
}

impl Meta {
    /// The text of the block.
    ///
    /// # Errors
    /// Never for what can be in a [`Meta`]; the writer of TOML has the last word.
    pub fn to_text(&self) -> Result<String, RecordError> {
        toml::to_string(self).map_err(|_| RecordError::Meta)
    }

    /// From the text of the block; unknown keys are those of a later version and are passed over.
    ///
    /// # Errors
    /// No description, or one of another format.
    pub fn parse(text: &[u8]) -> Result<Self, RecordError> {
        let text = core::str::from_utf8(text).map_err(|_| RecordError::Meta)?;
        let meta: Self = toml::from_str(text).map_err(|_| RecordError::Meta)?;
        if meta.format == FORMAT { Ok(meta) } else { Err(RecordError::Meta) }
    }
}
