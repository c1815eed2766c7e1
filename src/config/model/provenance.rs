//! Where the numbers of a model come from.

use toml::de::DeValue;
use toml::value::Datetime;

use crate::prelude::*;

/// Where numbers come from; everything is optional.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Provenance {
    /// Measuring instrument.
    pub instrument: Option<String>,
    /// Day (or instant) of the measurement, as in RFC 3339.
    pub date: Option<String>,
    /// Who measured.
    pub operator: Option<String>,
    /// Temperature of the machine, degrees Celsius.
    pub temperature_degc: Option<f64>,
    /// Day after which the numbers should not be used any more, as in RFC 3339.
    pub expiry: Option<String>,
    /// The data they were made from, for example a file name.
    pub source: Option<String>,
    /// Hash of these data.
    pub source_hash: Option<String>,
    /// The measurements that went in, where there were several (assembled models).
    pub sources: Vec<SourceEntry>,
    /// Anything else.
    pub note: Option<String>,
}

/// One of several measurements that went into a file or an error.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SourceEntry {
    /// The file.
    pub source: Option<String>,
    /// Hash of its content.
    pub source_hash: Option<String>,
    /// Measuring instrument.
    pub instrument: Option<String>,
    /// Day (or instant) of the measurement, as in RFC 3339.
    pub date: Option<String>,
}

/// When and with what a model was measured.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Measured {
    /// Newest day (or instant), as in RFC 3339.
    pub date: Option<String>,
    /// Instruments, each once.
    pub instruments: Vec<String>,
}

impl core::fmt::Display for SourceEntry {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let words = [&self.source, &self.instrument, &self.date, &self.source_hash];
        let words: Vec<&str> = words.into_iter().flatten().map(String::as_str).collect();
        write!(f, "{}", words.join(", "))
    }
}

impl Provenance {
    /// True where nothing is stated.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// The sources of both; all else is that of `self`.
    #[must_use]
    pub fn joined(&self, other: &Self) -> Self {
        let sources = [self.entries(), other.entries()].concat();
        Self { source: None, source_hash: None, sources, ..self.clone() }
    }

    /// Its sources, or itself as one.
    fn entries(&self) -> Vec<SourceEntry> {
        if !self.sources.is_empty() || (self.source.is_none() && self.source_hash.is_none()) {
            return self.sources.clone();
        }
        vec![SourceEntry {
            source: self.source.clone(),
            source_hash: self.source_hash.clone(),
            instrument: self.instrument.clone(),
            date: self.date.clone(),
        }]
    }
}

/// Temperatures at which a machine tool is measured, degrees Celsius.
const TEMPERATURE: Allowed = Allowed::Within { low: -40.0, high: 100.0 };

/// Reads the keys of provenance; other keys of the section are left to its owner.
pub(super) fn read(section: &Section<'_>) -> Provenance {
    let text = |key| section.text(key).map(|t| t.value.to_owned());
    Provenance {
        instrument: text("instrument"),
        date: date(section, "date"),
        operator: text("operator"),
        temperature_degc: section.number("temperature-degc", TEMPERATURE).map(|n| n.value),
        expiry: date(section, "expiry"),
        source: text("source"),
        source_hash: text("source-hash"),
        sources: section.read_all("sources", read_source),
        note: text("note"),
    }
}

fn read_source(section: &Section<'_>) -> SourceEntry {
    let text = |key| section.text(key).map(|t| t.value.to_owned());
    SourceEntry {
        source: text("source"),
        source_hash: text("source-hash"),
        instrument: text("instrument"),
        date: date(section, "date"),
    }
}

/// A date, with or without quotes.
fn date(section: &Section<'_>, key: &'static str) -> Option<String> {
    let value = section.value(key)?;
    match value.value {
        DeValue::Datetime(date) => Some(date.to_string()),
        DeValue::String(text) if text.parse::<Datetime>().is_ok_and(|d| d.date.is_some()) => {
            Some(text.to_string())
        }
        DeValue::String(text) => section.refuse(
            value.place,
            format!("{} is not a date: \"{text}\"", section.named_key(key)),
            "write year-month-day, for example 2026-01-31",
        ),
        _ => section.wrong_shape(key, &value, "a date"),
    }
}
