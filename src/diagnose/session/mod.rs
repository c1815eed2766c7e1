//! Session files (`docs/reference/session-files.md`): rows to readings with their full state.
//!
//! Pure: the caller reads the files. Several files have a clock, setups and runs of their own each. What is missing is
//! derived where the sampling allows ([`motion`]) and said in the notes; what looks wrong is refused ([`check`]).

mod ball_zero;
mod build;
mod channels;
mod check;
mod circle;
mod copies;
mod history;
mod logs;
mod motion;
mod motion_notes;
mod pairs;
mod plausibility_warnings;
mod reflector_location;
#[cfg(test)]
mod tests;
mod times;

use super::constants::{MOVES, ROWS, SEES};
use super::moment::{Axis, Machine, Moment, SLOTS, Signal};
use volcomp_model::geometry::Vec3;

pub use ball_zero::BallZero;
pub use history::History;
pub use logs::{Log, Logs, Series};
pub use times::Times;

/// A session file as it was read: a number per row and column, NaN where a field is empty.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Raw {
    /// Its name, for messages.
    pub file: String,
    /// Names of the columns of numbers.
    pub names: Vec<String>,
    /// One vector per column.
    pub columns: Vec<Vec<f64>>,
    /// The word in `instrument` of every row.
    pub instruments: Vec<String>,
    /// Line of every row in the file.
    pub lines: Vec<u64>,
    /// Meaning of `t_s` where the format states it; without it the steps decide.
    pub times: Option<Times>,
}

impl Raw {
    /// A column by name.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.names.iter().position(|n| n == name).map(|i| self.columns[i].as_slice())
    }

    /// Number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.lines.len()
    }

    /// True without rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.lines.is_empty()
    }
}

#[cfg(test)]
impl Raw {
    /// A file made up for a test, without rows.
    pub(crate) fn made_up(file: &str, names: &[&str]) -> Self {
        Self {
            file: file.to_owned(),
            names: names.iter().map(|n| (*n).to_owned()).collect(),
            columns: vec![Vec::new(); names.len()],
            ..Self::default()
        }
    }

    /// A further row, of a line of the file.
    pub(crate) fn push(&mut self, instrument: &str, line: u64, row: &[f64]) {
        self.columns.iter_mut().zip(row).for_each(|(c, v)| c.push(*v));
        self.instruments.push(instrument.to_owned());
        self.lines.push(line);
    }
}

/// What is wrong with a session; the caller adds nothing.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SessionError {
    /// Two logs say different things at the same times.
    #[error(
        "{log}: {source_name} at the same times as in {other}, with other values, beside the readings of {file}; each seems to have a clock of its own: give those of --fresh files with --fresh-history, diagnose the sessions one by one, or write the values into the columns of their files"
    )]
    OtherClock {
        /// The log.
        log: String,
        /// What it tells of.
        source_name: String,
        /// The log before.
        other: String,
        /// The session file.
        file: String,
    },
    /// A column that every session needs.
    #[error("{file}: column {column} is missing; {remedy}")]
    Missing {
        /// The file.
        file: String,
        /// The column.
        column: &'static str,
        /// What to do.
        remedy: &'static str,
    },
    /// A field that must not be empty.
    #[error(
        "{file}:{line}: {column} is empty; write a number, or leave deviation_um empty where a reading was lost"
    )]
    Empty {
        /// The file.
        file: String,
        /// The line.
        line: u64,
        /// The column.
        column: String,
    },
    /// Time runs backwards.
    #[error(
        "{file}:{line}: t_s goes back from {before} s to {after} s{place}; rows stand in the order they were taken, on one clock per file: sort them, or give each clock a file"
    )]
    Unsorted {
        /// The file.
        file: String,
        /// The line.
        line: u64,
        /// The time before.
        before: f64,
        /// The time of the line.
        after: f64,
        /// Where it happens, in words.
        place: &'static str,
    },
    /// Two clocks in one file.
    #[error(
        "{file}:{line}: t_s jumps from {before} s to {after} s, more than a year; there seem to be two clocks: one clock per file, give each a file of its own"
    )]
    Clock {
        /// The file.
        file: String,
        /// The line.
        line: u64,
        /// The time before, s.
        before: f64,
        /// The time of the line, s.
        after: f64,
    },
    /// A value that its column cannot hold.
    #[error("{file}:{line}: {column} is {value}; it {what}")]
    Value {
        /// The file.
        file: String,
        /// The line.
        line: u64,
        /// The column.
        column: String,
        /// The value.
        value: f64,
        /// What the column holds, and what to do.
        what: &'static str,
    },
    /// Not a direction.
    #[error("{file}:{line}: u_x u_y u_z has length {length:.4}; it is a unit vector, limit 0.95 to 1.05")]
    NotUnit {
        /// The file.
        file: String,
        /// The line.
        line: u64,
        /// Its length.
        length: f64,
    },
    /// Not enough to say anything.
    #[error(
        "{rows} usable readings, at least {limit} are needed; measure more or give more files with --data"
    )]
    TooFew {
        /// Usable rows.
        rows: usize,
        /// The least.
        limit: usize,
    },
    /// The same readings under two names.
    #[error(
        "{file}: all of its {rows} readings stand in {other}, too; readings given twice look like repeats without noise: leave {file} out"
    )]
    Twice {
        /// The file.
        file: String,
        /// The file that holds the same.
        other: String,
        /// Number of its readings.
        rows: usize,
    },
    /// Nothing was measured.
    #[error(
        "{file}: every deviation_um is {value}; nothing was measured, the resolution is coarser than all errors, or the column was lost on the way"
    )]
    Constant {
        /// The file.
        file: String,
        /// The value.
        value: f64,
    },
    /// A unit that cannot be right.
    #[error("{file}: {column} {what}; {remedy}")]
    Unit {
        /// The file.
        file: String,
        /// The column.
        column: String,
        /// What was found, with value and limit.
        what: String,
        /// What to do.
        remedy: &'static str,
    },
}

/// What was derived, dropped or is missing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Note {
    /// In words.
    pub text: String,
    /// Effects that become unidentifiable, as `effect:subject`.
    pub unidentifiable: Vec<String>,
}

impl Note {
    /// A note without consequence for effects.
    #[must_use]
    pub fn new(text: impl Into<String>) -> Self {
        Self { text: text.into(), unidentifiable: Vec::new() }
    }
}

/// One reading: where it belongs and what it says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Index of the instrument class.
    pub instrument: usize,
    /// Index of the setup, over all files.
    pub setup: usize,
    /// Index of the run, over all files.
    pub run: usize,
    /// Repetition of the program.
    pub repeat: i64,
    /// Rows of the same programmed point in different repeats share it; none where there is no partner.
    pub pair: Option<usize>,
    /// Deviation measured, um.
    pub deviation_um: f64,
    /// Displacement predicted, in machine axes, um.
    pub prediction_um: Vec3,
    /// Line in the file.
    pub line: u64,
    /// Marked as an outlier in the file (column `outlier`), such as a start-up outlier of a positioning test.
    pub is_marked: bool,
}

/// Columns that are not understood, kept for localisation.
#[derive(Debug, Clone, PartialEq)]
pub struct Extra {
    /// Name of the column.
    pub name: String,
    /// Value per reading.
    pub values: Vec<f64>,
}

/// Least and largest position of each axis, mm or rad.
pub(crate) type Spans = [[f64; 2]; SLOTS];

/// Of no reading.
const NO_SPAN: Spans = [[f64::INFINITY, f64::NEG_INFINITY]; SLOTS];

/// Takes the position of a reading in.
fn widen(spans: &mut Spans, m: &Moment) {
    for ([low, high], p) in spans.iter_mut().zip(m.position) {
        (*low, *high) = (low.min(p), high.max(p));
    }
}

/// The only axis that moves, by its place; `None` where none does or several do.
fn only_axis(spans: &[[f64; 2]]) -> Option<usize> {
    let moves = |k: &usize| spans[*k][1] - spans[*k][0] > MOVES[usize::from(*k > 2)];
    let mut moved = (0..spans.len()).filter(moves);
    moved.next().filter(|_| moved.next().is_none())
}

/// Readings ready for the diagnosis.
#[derive(Debug, Clone, PartialEq)]
pub struct Session {
    /// One per usable row, in order.
    pub readings: Vec<Reading>,
    /// The state at each.
    pub moments: Vec<Moment>,
    /// Names of the files.
    pub files: Vec<String>,
    /// Meaning of the times of each file.
    pub times: Vec<Times>,
    /// Names of the instrument classes.
    pub instruments: Vec<String>,
    /// Name of each setup, `file:setup`.
    pub setups: Vec<String>,
    /// Set-ups that are straightness tests of one axis: their reference line has an unknown slope against the axis.
    pub reference_lines: Vec<bool>,
    /// Readings of an R-test count from the zero of the ball; none where they count as at the row, as far as known.
    pub ball_zero: Option<BallZero>,
    /// Number of runs.
    pub runs: usize,
    /// The axes that have a column.
    pub axes: Vec<Axis>,
    /// The chain.
    pub machine: Machine,
    /// Names of the temperatures in rows or history.
    pub temperatures: Vec<String>,
    /// The lagged signals in [`Moment::signals`].
    pub signals: Vec<Signal>,
    /// Revolutions of the spindle are known.
    pub has_spindle: bool,
    /// Columns for localisation only.
    pub extra: Vec<Extra>,
    /// What was derived, dropped or is missing.
    pub notes: Vec<Note>,
    /// Rows in the files, with those that could not be used.
    pub rows_read: usize,
    /// Logs and columns behind the signals.
    pub history: History,
}

/// Readings used at most; beyond it whole points are left out, with all their repeats.
pub const ROWS_MAX: usize = 3 * ROWS;
/// Readings needed at least.
pub const ROWS_MIN: usize = 20;

/// True for the control's own encoders: they share its clock and do not drift against the machine. A grid encoder is an
/// instrument that is mounted like others.
#[must_use]
pub fn is_encoder(instrument: &str) -> bool {
    let name = instrument.to_ascii_lowercase();
    name.contains("encoder") && !name.contains("grid")
}

/// True for an instrument that measures its own length between two balls.
#[must_use]
pub fn is_ballbar(instrument: &str) -> bool {
    let name = instrument.to_ascii_lowercase();
    name.contains("ballbar") || name.contains("ball bar")
}

/// True for a file of angles: they are given as displacement at the end of a lever.
pub(crate) fn is_angular(raw: &Raw) -> bool {
    raw.column("lever_x_mm").is_some()
}

/// True for instruments whose mounting is turned by a small unknown angle, not only shifted.
#[must_use]
pub fn has_rotation(instrument: &str) -> bool {
    let name = instrument.to_ascii_lowercase();
    name.contains("tracker") || name.contains("cmm")
}

impl Session {
    /// True where the set-up of a reading is turned by a small unknown angle, too: that of a reference line, and that of a tracker
    /// or CMM unless all of it looks along `one_line`.
    #[must_use]
    pub(crate) fn rotates(&self, reading: usize, one_line: bool) -> bool {
        let turned = || has_rotation(&self.instruments[self.readings[reading].instrument]);
        self.reference_lines[self.readings[reading].setup] || !one_line && turned()
    }

    /// The linear axes along which some reading looks.
    #[must_use]
    pub(crate) fn axes_seen(&self) -> Vec<Axis> {
        let is_seen = |a: &Axis| self.moments.iter().any(|m| m.u[a.direction()] != 0.0);
        Axis::LINEAR.into_iter().filter(is_seen).collect()
    }

    /// The range of each axis in each set-up, mm or rad; empty where nothing was read.
    pub(crate) fn spans(&self) -> Vec<Spans> {
        let mut spans = vec![NO_SPAN; self.setups.len()];
        self.moments.iter().for_each(|m| widen(&mut spans[m.setup], m));
        spans
    }

    /// Set-ups that look across the only linear axis that moves in them, from which the slope of the reference line is not known
    /// (ISO 230-1, straightness).
    fn straightness_tests(&self) -> Vec<bool> {
        let axes: Vec<Option<usize>> = self.spans().iter().map(|spans| only_axis(&spans[..3])).collect();
        let mut is_test: Vec<bool> = axes.iter().map(Option::is_some).collect();
        for (r, m) in self.readings.iter().zip(&self.moments) {
            let looks_across = axes[r.setup].is_some_and(|axis| m.u[axis].abs() < SEES);
            is_test[r.setup] &=
                looks_across && !m.is_angular() && !is_encoder(&self.instruments[r.instrument]);
        }
        is_test
    }

    /// Measured minus predicted, um.
    #[must_use]
    pub fn gap(&self) -> Vec<f64> {
        let predicted = |i: usize| self.readings[i].prediction_um;
        let counted = |i: usize| match &self.ball_zero {
            Some(zero) => zero.counted(i, predicted),
            None => predicted(i),
        };
        let of = |i: usize| self.readings[i].deviation_um - counted(i).dot(&self.moments[i].u);
        (0..self.readings.len()).map(of).collect()
    }

    /// Meaning of the time of a reading.
    #[must_use]
    pub fn times_of(&self, reading: usize) -> Times {
        self.times.get(self.moments[reading].file).copied().unwrap_or_default()
    }

    /// True where no time was read from a clock or a schedule: the times are the order of the readings.
    #[must_use]
    pub fn is_ordinal(&self) -> bool {
        self.times.iter().all(|t| *t == Times::Ordinal)
    }

    /// The distinct times of the readings, s, in order.
    #[must_use]
    pub fn distinct_times(&self) -> Vec<f64> {
        let mut times: Vec<f64> = self.moments.iter().map(|m| m.t_s).collect();
        times.sort_by(f64::total_cmp);
        times.dedup();
        times
    }

    /// A span of time in words; of ordinal times, which have no duration, as places in the order of the readings.
    #[must_use]
    pub fn span(&self, seconds: f64) -> String {
        if !self.is_ordinal() {
            return format!("{seconds:.0} s");
        }
        let times = self.distinct_times();
        let extent = times.last().zip(times.first()).map_or(0.0, |(last, first)| last - first);
        let places = times.len().saturating_sub(1) as f64;
        let step = if places > 0.0 { extent / places } else { 1.0 };
        format!("about {:.0} points in the order measured", (seconds / step.max(1e-9)).min(places).max(1.0))
    }

    /// Place of a signal in [`Moment::signals`].
    #[must_use]
    pub fn signal(&self, wanted: &Signal) -> Option<usize> {
        self.signals.iter().position(|s| s == wanted)
    }

    /// Adds a lagged signal to every moment, where its source is known.
    pub fn add_signal(&mut self, signal: &Signal) -> bool {
        if self.signal(signal).is_some() {
            return true;
        }
        let Some(values) = self.history.lagged(signal, &self.moments) else {
            return false;
        };
        for (m, v) in self.moments.iter_mut().zip(values) {
            m.signals.push(v);
        }
        self.signals.push(signal.clone());
        true
    }
}
