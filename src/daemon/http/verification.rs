//! The last verification of the machine: the file of `volcomp verify --record`, read again while the service runs.

use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::json;
use volcomp_state::bounded_read::read_regular;

/// The `format` of the file.
const FORMAT: &str = "volcomp-verification/1";
/// Largest file, bytes.
const BYTES_MAX: u64 = 64 << 10;

/// Two measurements of a machine, without and with compensation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Verification {
    /// `volcomp-verification/1`.
    pub format: String,
    /// Day of the measurement, RFC 3339.
    pub date: String,
    /// Measuring instrument.
    pub instrument: String,
    /// What was measured: the test, or its heading.
    pub title: String,
    /// `iso230-2 iso230-4 iso230-6 straightness`.
    pub test: String,
    /// `um` or `arcsec`.
    pub unit: String,
    /// Range of the deviations without and with compensation, in the unit.
    pub range: [f64; 2],
    /// RMS of the same, in the unit.
    pub rms: [f64; 2],
    /// 1 - with / without of the RMS; `null` where it was zero.
    pub reduction: Option<f64>,
    /// Its expanded uncertainty (k = 2); `null` where it is not known.
    pub reduction_u95: Option<f64>,
    /// BLAKE3 of the model with which the machine was compensated, where stated.
    pub model_hash: Option<String>,
}

impl Verification {
    /// The `format` of a file that is written.
    #[must_use]
    pub fn format() -> String {
        FORMAT.to_owned()
    }

    /// Reads a file.
    ///
    /// # Errors
    /// In words.
    fn read(path: &Path) -> Result<Self, String> {
        let place = |why: &dyn core::fmt::Display| format!("{}: {why}", path.display());
        let bytes = read_regular(path, BYTES_MAX).map_err(|e| place(&e))?;
        let found: Self = serde_json::from_slice(&bytes).map_err(|e| place(&e))?;
        if found.format == FORMAT { Ok(found) } else { Err(place(&format!("format is not {FORMAT}"))) }
    }
}

/// What the page shows: `verification`, or `problem` why there is none; both `null` without a file.
pub(super) fn shown(path: Option<&Path>) -> String {
    let found = path.map(Verification::read).transpose();
    let (verification, problem) = match found {
        Ok(found) => (found, None),
        Err(why) => (None, Some(why)),
    };
    json!({ "configured": path.is_some(), "verification": verification, "problem": problem }).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_shown_and_a_mistake_is_told() {
        let dir = tempfile::tempdir().expect("directory");
        let path = dir.path().join("v.json");
        let text = r#"{"format": "volcomp-verification/1", "date": "2026-05-03", "instrument": "laser", "title": "X",
            "test": "iso230-2", "unit": "um", "range": [40.0, 4.0], "rms": [20.0, 2.0], "reduction": 0.9,
            "reduction_u95": null, "model_hash": null}"#;
        std::fs::write(&path, text).expect("written");
        let found = Verification::read(&path).expect("read");
        assert_eq!((found.date.as_str(), found.rms, found.reduction), ("2026-05-03", [20.0, 2.0], Some(0.9)));
        assert!(shown(Some(&path)).contains("\"instrument\":\"laser\""));
        assert!(shown(None).contains("\"configured\":false"));
        for (wrong, words) in
            [("{}", "missing field"), (&*text.replace("tion/1", "tion/2"), "format is not"), ("", "EOF")]
        {
            std::fs::write(&path, wrong).expect("written");
            assert!(shown(Some(&path)).contains(words), "{wrong}");
        }
        assert!(shown(Some(&dir.path().join("none"))).contains("No such file"));
        std::fs::write(&path, "x".repeat(70_000)).expect("written");
        assert!(shown(Some(&path)).contains("the limit is 65536 bytes"));
    }
}
