//! What is wrong with a machine of this generator; a diagnosis never reads it.

use serde::{Deserialize, Serialize};

use super::catalogue;

/// The name of the format.
pub const FORMAT: &str = "volcomp-formulas/1";

/// A machine and its instruments as they are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct FormulaTruth {
    /// `volcomp-formulas/1`.
    pub format: String,
    /// Draws the constants of the formulas.
    pub seed: u64,
    /// White noise, as a multiple of what each instrument has.
    pub noise: f64,
    /// Drift of a mounting, as a multiple of the noise.
    pub drift: f64,
    /// Its correlation time, s.
    pub drift_s: f64,
    /// Heavy tails, mountings with waves and trends, effects that vary over the volume.
    pub hard: bool,
    /// What is wrong.
    #[serde(default, rename = "fault", skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<Fault>,
}

/// One effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Fault {
    /// Its name.
    pub name: String,
    /// Axis, pair or symbol.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub subject: String,
    /// What it does typically, um; the sign counts.
    pub size_um: f64,
}

impl Fault {
    /// `name:subject` (`docs/reference/session-files.md` 4.1).
    #[must_use]
    pub fn label(&self) -> String {
        if self.subject.is_empty() { self.name.clone() } else { format!("{}:{}", self.name, self.subject) }
    }
}

/// Why a truth is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FormulaError {
    /// Another format.
    #[error("format {found:?} is not known; this generator reads \"{FORMAT}\"")]
    Format {
        /// What was found.
        found: String,
    },
    /// No formula.
    #[error("there is no formula for the effect {label}")]
    Effect {
        /// Its label.
        label: String,
    },
    /// A number that makes no sense.
    #[error("{key} is {value}; it must be a finite number above {least}")]
    Number {
        /// The key.
        key: String,
        /// The value.
        value: f64,
        /// The limit.
        least: f64,
    },
}

impl FormulaTruth {
    /// A machine without effects.
    #[must_use]
    pub fn perfect(seed: u64) -> Self {
        Self {
            format: FORMAT.to_owned(),
            seed,
            noise: 1.0,
            drift: 0.5,
            drift_s: 700.0,
            hard: false,
            faults: Vec::new(),
        }
    }

    /// The same machine with this effect and no other.
    #[must_use]
    pub fn only(&self, name: &str, subject: &str, size_um: f64) -> Self {
        let fault = Fault { name: name.to_owned(), subject: subject.to_owned(), size_um };
        Self { faults: vec![fault], ..self.clone() }
    }

    /// Checks names and numbers.
    ///
    /// # Errors
    /// [`FormulaError`] says what is wrong.
    pub fn check(&self) -> Result<(), FormulaError> {
        if self.format != FORMAT {
            return Err(FormulaError::Format { found: self.format.clone() });
        }
        for fault in &self.faults {
            let known =
                catalogue::entry(&fault.name).is_some_and(|e| e.subjects.contains(&fault.subject.as_str()));
            if !known {
                return Err(FormulaError::Effect { label: fault.label() });
            }
        }
        let sizes = self.faults.iter().map(|f| (f.label(), f.size_um, f64::NEG_INFINITY));
        let numbers = [("noise", self.noise), ("drift", self.drift), ("drift-s", self.drift_s)];
        let numbers = numbers.map(|(key, value)| (key.to_owned(), value, 0.0));
        for (key, value, least) in numbers.into_iter().chain(sizes) {
            if !(value.is_finite() && value > least) {
                return Err(FormulaError::Number { key, value, least });
            }
        }
        Ok(())
    }
}
