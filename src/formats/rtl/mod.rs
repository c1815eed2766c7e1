//! Renishaw `.rtl`: static laser tests of one axis, as text in sections.
//!
//! ```text
//! HEADER::                      keys
//! TARGET DATA::                 Filetype, Target-count, Targets : (several per line), Flags:
//! USER-TEXT::                   Machine, Serial No, Date, By, Axis, Location, TITLE
//! RUNS::                        Run-count
//! DEVIATIONS::                  Run Target Data: rows of run, target (both from 1), deviation
//! EQUIPMENT::  ENVIRONMENT::    keys, optional
//! EOF::                         optional
//! ```
//!
//! Deviation = measured - target, in um for a linear axis, over targets in mm. A run is one pass; the first goes from the
//! first to the last target, the second back, and so on. The second flag is 1 where every run goes the same way. The
//! index of a row says which target it belongs to, not its place in the file. For a rotary axis the file does not
//! state the unit of its deviations: it has to be given (one public reader takes mrad).
//!
//! Source: public readers and writers; no file of the instrument itself was at hand, so the reader is tolerant about
//! what is missing and strict about what is there.

mod of_model;
mod read;
mod write;

pub use of_model::of_model;
pub use read::{parse, recognises};
pub use write::write;

use super::columns::date_time_ticks;
use super::positioning_test::PositioningTest;
use crate::prelude::*;
use volcomp_units::{mm_from_um, rad_from_arcsec};

/// A file, section by section.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Rtl {
    /// `HEADER::`.
    pub header: Vec<Entry>,
    /// `Filetype` of the target data, such as `ISO`; empty where missing.
    pub filetype: String,
    /// Targets in the order of the first run, mm or deg.
    pub targets: Vec<f64>,
    /// `Flags:`; the second is 1 for runs that all go the same way.
    pub flags: Vec<i64>,
    /// `USER-TEXT::`.
    pub user_text: Vec<Entry>,
    /// Single passes announced.
    pub run_count: u32,
    /// The rows in their order.
    pub deviations: Vec<Deviation>,
    /// `EQUIPMENT::`.
    pub equipment: Vec<Entry>,
    /// `ENVIRONMENT::`.
    pub environment: Vec<Entry>,
}

/// A line `key : text`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entry {
    /// Its key.
    pub key: String,
    /// Its text.
    pub text: String,
}

/// A row of `DEVIATIONS::`. Equality ignores the line.
#[derive(Debug, Clone, Copy)]
pub struct Deviation {
    /// Run from 1 up.
    pub run: u32,
    /// Target from 1 up.
    pub target: u32,
    /// Measured - target, in the unit of the file.
    pub value: f64,
    /// Line in the file; 0 where there is none.
    pub line: u64,
}

impl PartialEq for Deviation {
    fn eq(&self, other: &Self) -> bool {
        (self.run, self.target, self.value) == (other.run, other.target, other.value)
    }
}

/// What is worth knowing about a file and its test.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Note {
    /// Even runs that hold nothing but zeros were left out: a one-way test in a two-way file.
    #[error("{runs} return runs hold zeros only and are left out: taken as a one-way test")]
    EmptyReturns {
        /// Runs left out.
        runs: usize,
    },
    /// Targets that runs do not have.
    #[error("{readings} readings are missing in the runs")]
    Missed {
        /// Readings missing.
        readings: usize,
    },
    /// Runs announced that have no reading at all.
    #[error("{announced} runs announced, {found} have readings")]
    RunsMissing {
        /// Runs announced.
        announced: u32,
        /// Runs with readings.
        found: usize,
    },
    /// No end mark.
    #[error("no EOF:: at the end")]
    NoEof,
    /// No environment section.
    #[error("no ENVIRONMENT:: section")]
    NoEnvironment,
}

/// The unit in which a file holds its deviations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeviationUnit {
    /// Micrometres, over targets in mm.
    Um,
    /// Milliradians, over targets in deg.
    Mrad,
    /// Microradians, over targets in deg.
    Urad,
    /// Seconds of arc, over targets in deg.
    Arcsec,
}

impl DeviationUnit {
    /// The kind of axis that has such deviations.
    #[must_use]
    pub const fn kind(self) -> AxisKind {
        match self {
            Self::Um => AxisKind::Linear,
            _ => AxisKind::Rotary,
        }
    }

    /// A deviation in mm or rad.
    #[must_use]
    pub fn to_inner(self, value: f64) -> f64 {
        match self {
            Self::Um => mm_from_um(value),
            Self::Mrad => value / 1e3,
            Self::Urad => value / 1e6,
            Self::Arcsec => rad_from_arcsec(value),
        }
    }
}

/// Start and end of a quantity during the test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    /// At the start.
    pub start: f64,
    /// At the end.
    pub end: f64,
}

/// A temperature of exactly this means that the sensor was not there.
const ABSENT_DEGC: f64 = -10.0;

impl Rtl {
    /// A text of `USER-TEXT::`, where it is not empty.
    #[must_use]
    pub fn user(&self, key: &str) -> Option<&str> {
        text_of(&self.user_text, key)
    }

    /// A quantity of `ENVIRONMENT::`; `None` where missing or where a temperature sensor was absent.
    #[must_use]
    pub fn environment(&self, key: &str) -> Option<Span> {
        let mut numbers = text_of(&self.environment, key)?.split_whitespace().map(str::parse::<f64>);
        let start = numbers.next()?.ok().filter(|v| v.is_finite())?;
        let end = numbers.next().and_then(Result::ok).filter(|v| v.is_finite()).unwrap_or(start);
        let absent = key.ends_with(|c: char| c.is_ascii_digit()) || key.contains("temp");
        (!absent || start != ABSENT_DEGC || end != ABSENT_DEGC).then_some(Span { start, end })
    }

    /// Time from the start to the end of the test by `Date Time`, s; `None` where it is missing or not above zero.
    #[must_use]
    pub fn duration_s(&self) -> Option<f64> {
        let text = text_of(&self.environment, "Date Time")?;
        let mut stamps = text.split('"').map(str::trim).filter(|t| !t.is_empty()).map(minutes);
        let (start, end) = (stamps.next()??, stamps.next()??);
        (end > start).then(|| 60.0 * (end - start) as f64)
    }

    /// Keys of temperature sensors that were absent.
    pub fn absent_sensors(&self) -> impl Iterator<Item = &str> {
        let temperature = self.environment.iter().filter(|e| e.key.contains("temp"));
        temperature.filter(|e| self.environment(&e.key).is_none()).map(|e| e.key.as_str())
    }

    /// True where every run goes the same way.
    #[must_use]
    pub fn is_one_way(&self) -> bool {
        self.flags.get(1) == Some(&1)
    }

    /// Runs that have readings.
    #[must_use]
    pub fn runs(&self) -> std::collections::BTreeSet<u32> {
        self.deviations.iter().map(|d| d.run).collect()
    }

    /// The test as readings with cycle and direction, and what was noticed on the way.
    #[must_use]
    pub fn test(&self, unit: DeviationUnit) -> (PositioningTest, Vec<Note>) {
        let mut notes = Vec::new();
        let runs = self.runs();
        let is_return = |run: u32| run.is_multiple_of(2);
        let only_zeros = |run: u32| self.deviations.iter().filter(|d| d.run == run).all(|d| d.value == 0.0);
        let returns: Vec<u32> = runs.iter().copied().filter(|r| is_return(*r)).collect();
        let forward_measured = runs.iter().any(|r| !is_return(*r) && !only_zeros(*r));
        let empty = forward_measured && !returns.is_empty() && returns.iter().all(|r| only_zeros(*r));
        if empty {
            notes.push(Note::EmptyReturns { runs: returns.len() });
        }
        // a one-way file that holds real readings in its even runs numbers them as cycles of their own
        let all_forward = self.is_one_way() && !empty;
        let upwards = match (self.targets.first(), self.targets.last()) {
            (Some(first), Some(last)) => last >= first,
            _ => true,
        };
        let (out, back) =
            if upwards { (Travel::Forward, Travel::Reverse) } else { (Travel::Reverse, Travel::Forward) };
        let kind = unit.kind();
        let mut readings = Vec::with_capacity(self.deviations.len());
        let mut lines = Vec::with_capacity(self.deviations.len());
        // runs follow each other, and the even ones go back: whatever the order of the rows, that is the order measured
        let mut measured: Vec<&Deviation> =
            self.deviations.iter().filter(|d| !(empty && is_return(d.run))).collect();
        let along = |d: &Deviation| {
            let target = i64::from(d.target);
            if all_forward || !is_return(d.run) { target } else { -target }
        };
        measured.sort_by_key(|d| (d.run, along(d)));
        for d in measured {
            let Some(target) = self.targets.get(d.target.saturating_sub(1) as usize) else { continue };
            readings.push(Reading {
                cycle: if all_forward { d.run } else { d.run.div_ceil(2) },
                travel: if all_forward || !is_return(d.run) { out } else { back },
                position: kind.position_in(*target),
                value: unit.to_inner(d.value),
            });
            lines.push(d.line);
        }
        self.count_missing(&runs, &mut notes);
        (PositioningTest::new(kind, readings, lines), notes)
    }

    fn count_missing(&self, runs: &std::collections::BTreeSet<u32>, notes: &mut Vec<Note>) {
        if runs.len() < self.run_count as usize {
            notes.push(Note::RunsMissing { announced: self.run_count, found: runs.len() });
        }
        let complete = runs.len() * self.targets.len();
        if self.deviations.len() < complete {
            notes.push(Note::Missed { readings: complete - self.deviations.len() });
        }
        if self.environment.is_empty() {
            notes.push(Note::NoEnvironment);
        }
    }
}

/// Minutes of a stamp such as `10:46 Dec 12 2016` since 1970.
fn minutes(stamp: &str) -> Option<i64> {
    const MONTHS: [&str; 12] =
        ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"];
    let mut words = stamp.split_whitespace();
    let (time, month, day, year) = (words.next()?, words.next()?, words.next()?, words.next()?);
    let name = month.get(..3)?.to_ascii_lowercase();
    let month = 1 + MONTHS.iter().position(|m| *m == name)?;
    let stamp = format!("{year}-{month}-{} {time}", day.trim_end_matches(','));
    // ticks of 100 ns
    i64::try_from(date_time_ticks(&stamp)? / 600_000_000).ok()
}

pub(super) fn text_of<'a>(entries: &'a [Entry], key: &str) -> Option<&'a str> {
    entries
        .iter()
        .find(|e| e.key.eq_ignore_ascii_case(key))
        .map(|e| e.text.as_str())
        .filter(|t| !t.is_empty())
}

#[cfg(test)]
mod tests;
