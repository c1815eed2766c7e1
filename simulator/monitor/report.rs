//! What is checked, and what was found.

use core::fmt;

use serde::Serialize;
use volcomp_protocol::CorrectionState;

/// Violations of one invariant that are kept: the first ones, and the largest. Further ones are counted.
const KEPT_EACH: usize = 8;

/// What must hold for every correction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Invariant {
    /// No offset beyond `limit-um`, except one found on a new link (at most [`super::Settings::found_factor`] limits), which
    /// never grows and is led back in time.
    Size,
    /// No change from one answer to the next on a link beyond `step-um`, whatever the control reports.
    Step,
    /// No change faster than `rate-um-per-s` in control time, of which one answer uses at most two cycles.
    Rate,
    /// Every used axis finite, every unused entry zero.
    Finite,
    /// Permitted changes of state only; no growth while off, armed or faulted; at rest while holding.
    State,
    /// Answers name a position that was sent, none older than that of the answer before.
    Sequence,
    /// Zero is reached in time after ramping out or a fault has begun.
    TimeToZero,
    /// No answer before a finite read-back; with drives off or emergency stop no offset moves except to the read-back.
    ReadBack,
}

impl fmt::Display for Invariant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Size => "I1 size",
            Self::Step => "I2 step",
            Self::Rate => "I3 rate",
            Self::Finite => "I4 finite",
            Self::State => "I5 state",
            Self::Sequence => "I6 sequence",
            Self::TimeToZero => "I7 time to zero",
            Self::ReadBack => "I8 read-back",
        })
    }
}

/// A correction that breaks an invariant.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Violation {
    /// The invariant.
    pub invariant: Invariant,
    /// Sequence number that the correction names.
    pub sequence: u32,
    /// State that the correction tells.
    #[serde(serialize_with = "as_debug")]
    pub state: CorrectionState,
    /// Axis letter; `None` where the correction as a whole is wrong.
    pub axis: Option<char>,
    /// What was found: mm or deg, per s for the rate, s for the time to zero.
    pub value: f64,
    /// Its limit, same unit.
    pub limit: f64,
    /// What exactly is wrong.
    pub what: &'static str,
}

/// Figures of everything that was seen. mm or deg, the largest over all axes with limits.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Figures {
    /// Links.
    pub links: u64,
    /// Positions sent to the daemon.
    pub positions: u64,
    /// Corrections of the daemon.
    pub answers: u64,
    /// Positions without an answer of their own.
    pub unanswered: u64,
    /// Largest offset.
    pub size: f64,
    /// Largest change between consecutive answers.
    pub step: f64,
    /// Largest rate of change, per s.
    pub rate: f64,
}

/// What the monitor has found.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Report {
    /// Of each invariant the first violations and the largest.
    pub violations: Vec<Violation>,
    /// All violations, those not kept included.
    pub total: u64,
    /// Largest values seen.
    pub figures: Figures,
}

impl Report {
    /// Counts a violation and keeps it where it is one of the first of its invariant, or the largest.
    pub(super) fn add(&mut self, found: Violation) {
        self.total += 1;
        // of each invariant some, so that many of one do not hide another
        let same = self.violations.iter().filter(|v| v.invariant == found.invariant).count();
        if same < KEPT_EACH {
            self.violations.push(found);
        } else if let Some(last) = self.violations.iter_mut().rfind(|v| v.invariant == found.invariant)
            && found.value.abs() > last.value.abs()
        {
            *last = found;
        }
    }

    /// True where every invariant held.
    #[must_use]
    pub const fn is_clean(&self) -> bool {
        self.total == 0
    }

    /// One line per invariant that did not hold: its first violation, and its largest value.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let mut lines: Vec<String> = Vec::new();
        let mut told: Vec<Invariant> = Vec::new();
        for first in &self.violations {
            if told.contains(&first.invariant) {
                continue;
            }
            told.push(first.invariant);
            let same = self.violations.iter().filter(|v| v.invariant == first.invariant);
            let largest = same.map(|v| v.value.abs()).fold(0.0, f64::max);
            lines.push(format!("{first}; largest {largest:.6e}"));
        }
        if self.total > 0 {
            lines.push(format!("{} violations in {} answers", self.total, self.figures.answers));
        }
        lines
    }
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { invariant, sequence, state, axis, value, limit, what } = self;
        write!(f, "{invariant}: {what}: ")?;
        if let Some(axis) = axis {
            write!(f, "{axis} ")?;
        }
        write!(f, "{value:.6e}, limit {limit:.6e} (answer to {sequence}, {state:?})")
    }
}

fn as_debug<S: serde::Serializer>(state: &CorrectionState, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&format_args!("{state:?}"))
}
