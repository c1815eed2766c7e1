//! The truth file of a twin, `volcomp-twin/1` (TOML): which physics is switched on, and how large.
//!
//! A diagnosis never reads it. Sizes are what the effect does typically over the volume, in um, or the quantity that a
//! measurement states ([`Quantity`]); what is not given of an effect's other constants is drawn from the seed.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::catalogue::{self, Subjects};
use super::quantity::Quantity;

/// The name of the format.
pub const FORMAT: &str = "volcomp-twin/1";

/// A machine and its instruments as they really are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct TwinTruth {
    /// `volcomp-twin/1`.
    pub format: String,
    /// Draws the constants of the effects that are not given. Noise and weather have the seed of the campaign.
    #[serde(default)]
    pub seed: u64,
    /// Share (RMS) by which the machine's effects vary over the working volume.
    #[serde(default)]
    pub variation: f64,
    /// The instruments.
    #[serde(default)]
    pub instruments: InstrumentTruth,
    /// What is wrong.
    #[serde(default, rename = "effect", skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<Effect>,
}

/// How the instruments err.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case", default)]
pub struct InstrumentTruth {
    /// White noise, as a multiple of what each instrument has.
    pub noise: f64,
    /// Drift of a mounting that forgets itself, as a multiple of the noise.
    pub drift: f64,
    /// Its correlation time, s.
    pub drift_s: f64,
    /// Unknown offset of each mounting, as a multiple of the noise.
    pub mounting: f64,
    /// Noise with heavy tails (Student's t, four degrees of freedom) instead of normal noise.
    pub heavy_tails: bool,
    /// Waves in the drift of a mounting, as a multiple of the noise.
    pub waves: f64,
    /// Trend of a mounting in an hour, as a multiple of the noise.
    pub trend_per_h: f64,
    /// Share of readings that are lost.
    pub dropouts: f64,
}

impl Default for InstrumentTruth {
    fn default() -> Self {
        Self {
            noise: 1.0,
            drift: 0.5,
            drift_s: 600.0,
            mounting: 5.0,
            heavy_tails: false,
            waves: 0.0,
            trend_per_h: 0.0,
            dropouts: 0.0,
        }
    }
}

/// One effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Given", rename_all = "kebab-case")]
pub struct Effect {
    /// Its name, `cncsim campaign --list-effects` has them.
    pub name: String,
    /// Axis, pair or symbol.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub subject: String,
    /// What it does typically, um; the sign counts.
    pub size_um: f64,
    /// Constants of its physics, by the names of the list.
    #[serde(rename = "with", skip_serializing_if = "BTreeMap::is_empty")]
    pub constants: BTreeMap<String, f64>,
}

/// An effect as it stands in a file: its size once, in one of its keys.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct Given {
    name: String,
    #[serde(default)]
    subject: String,
    size_um: Option<f64>,
    width_um: Option<f64>,
    angle_arcsec: Option<f64>,
    #[serde(default)]
    with: BTreeMap<String, f64>,
}

impl TryFrom<Given> for Effect {
    type Error = String;

    fn try_from(given: Given) -> Result<Self, String> {
        let mut effect =
            Self { name: given.name, subject: given.subject, size_um: 0.0, constants: given.with };
        if catalogue::entry(&effect.name).is_none() {
            return Err(unknown_effect(&effect.name));
        }
        let quantity = Quantity::of(&effect.name, &effect.subject);
        let of = |key: &str| quantity.as_ref().filter(|q| q.key == key).map(|q| 1.0 / q.per_um);
        let sizes = [
            (given.size_um, Some(1.0)),
            (given.width_um, of("width-um")),
            (given.angle_arcsec, of("angle-arcsec")),
        ];
        let mut sizes = sizes.into_iter().filter_map(|(value, um)| value.map(|v| um.map(|um| v * um)));
        match (sizes.next(), sizes.next()) {
            (Some(Some(size_um)), None) => effect.size_um = size_um,
            _ => {
                let or = quantity.map_or_else(String::new, |q| format!(", or {} in its place", q.key));
                return Err(format!("effect {}: give its size once, as size-um{or}", effect.label()));
            }
        }
        Ok(effect)
    }
}

impl Effect {
    /// An effect whose constants are drawn.
    #[must_use]
    pub fn new(name: &str, subject: &str, size_um: f64) -> Self {
        Self { name: name.to_owned(), subject: subject.to_owned(), size_um, constants: BTreeMap::new() }
    }

    /// `name:subject` (`docs/reference/session-files.md` 4.1).
    #[must_use]
    pub fn label(&self) -> String {
        if self.subject.is_empty() { self.name.clone() } else { format!("{}:{}", self.name, self.subject) }
    }

    /// A constant, or what is drawn for it.
    #[must_use]
    pub fn constant(&self, name: &str, drawn: f64) -> f64 {
        self.constants.get(name).copied().unwrap_or(drawn)
    }
}

/// Why a truth file is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TwinError {
    /// Not TOML, an unknown key, or a value of the wrong kind; says line and column.
    #[error("twin file: {}", volcomp_cli::with_nearest(&.0.to_string()))]
    Toml(#[from] toml::de::Error),
    /// Another format.
    #[error("twin file: format {found:?} is not known; this program reads \"{FORMAT}\"")]
    Format {
        /// What the file says.
        found: String,
    },
    /// An effect that the twin has no physics for.
    #[error(
        "twin file: effect {label}: {what}; cncsim campaign --list-effects has names, subjects and constants"
    )]
    Effect {
        /// The effect.
        label: String,
        /// What is wrong.
        what: String,
    },
    /// A number that makes no sense.
    #[error("twin file: {key} is {value}; it must be a finite number from {least} up")]
    Number {
        /// The key.
        key: &'static str,
        /// The value.
        value: f64,
        /// The least.
        least: f64,
    },
    /// The geometric chain is refused; a fault of the program.
    #[error("twin: {0}")]
    Chain(String),
}

impl TwinTruth {
    /// A twin without any effect.
    #[must_use]
    pub fn perfect(seed: u64) -> Self {
        Self {
            format: FORMAT.to_owned(),
            seed,
            variation: 0.0,
            instruments: InstrumentTruth::default(),
            effects: Vec::new(),
        }
    }

    /// Reads and checks a truth file.
    ///
    /// # Errors
    /// [`TwinError`] says what is wrong.
    pub fn read(text: &str) -> Result<Self, TwinError> {
        let truth: Self = toml::from_str(text)?;
        truth.check()?;
        Ok(truth)
    }

    /// Checks names and numbers.
    ///
    /// # Errors
    /// [`TwinError`] says what is wrong.
    pub fn check(&self) -> Result<(), TwinError> {
        if self.format != FORMAT {
            return Err(TwinError::Format { found: self.format.clone() });
        }
        let i = &self.instruments;
        let numbers = [
            ("variation", self.variation, 0.0),
            ("instruments.noise", i.noise, 1e-3),
            ("instruments.drift", i.drift, 0.0),
            ("instruments.drift-s", i.drift_s, 1.0),
            ("instruments.mounting", i.mounting, 0.0),
            ("instruments.waves", i.waves, 0.0),
            ("instruments.trend-per-h", i.trend_per_h, 0.0),
            ("instruments.dropouts", i.dropouts, 0.0),
        ];
        for (key, value, least) in numbers {
            if !value.is_finite() || value < least {
                return Err(TwinError::Number { key, value, least });
            }
        }
        self.effects.iter().try_for_each(check_effect)
    }
}

/// What is wrong with a name, with the nearest known one.
fn unknown_effect(name: &str) -> String {
    let known: Vec<&str> = catalogue::CATALOGUE.iter().map(|entry| entry.name).collect();
    format!("unknown effect `{name}`; {}", volcomp_cli::suggestion(name, &known, "expected one of "))
}

fn check_effect(effect: &Effect) -> Result<(), TwinError> {
    let wrong = |what: String| TwinError::Effect { label: effect.label(), what };
    let entry = catalogue::entry(&effect.name).ok_or_else(|| wrong(unknown_effect(&effect.name)))?;
    if !entry.subjects.list().contains(&effect.subject.as_str()) {
        let known = match entry.subjects {
            Subjects::None => "it has no subject".to_owned(),
            subjects => format!("its subject is one of {}", subjects.list().join(" ")),
        };
        return Err(wrong(known));
    }
    if let Some(name) = effect.constants.keys().find(|k| !entry.constants.contains(&k.as_str())) {
        return Err(wrong(format!("it has no constant {name}; it has: {}", entry.constants.join(" "))));
    }
    if !effect.size_um.is_finite() || effect.constants.values().any(|v| !v.is_finite()) {
        return Err(wrong("size and constants must be finite numbers".to_owned()));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_names_get_the_nearest_one() {
        let head = format!("format = \"{FORMAT}\"\nseed = 1\nvariation = 0.0\n");
        for (text, expected) in [
            (
                "[[effect]]\nname = \"backlsh\"\nsubject = \"x\"\nwidth-um = 3\n",
                "unknown effect `backlsh`; did you mean backlash?",
            ),
            ("[[effects]]\nname = \"backlash\"\n", "did you mean effect?"),
            ("[[effect]]\nname = \"backlash\"\nsubject = \"x\"\n", "give its size once, as size-um"),
        ] {
            let said = TwinTruth::read(&(head.clone() + text)).unwrap_err().to_string();
            assert!(said.contains(expected), "{said}");
        }
    }
}
