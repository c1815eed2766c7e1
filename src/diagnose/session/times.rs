//! What the times of a file mean: read from a clock, computed from a schedule, or the order of the readings only.
//!
//! Files say it themselves where an importer states it. The times of a session table are judged by what a clock cannot show:
//! equal steps whatever the distance between two readings. A comment in the file decides nothing.

use core::fmt;

use super::super::constants::{FAST_S, FEW};
use super::super::moment::Axis;
use super::{Note, Raw, motion};

/// Meaning of the times of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Times {
    /// Read from a clock.
    #[default]
    Measured,
    /// Computed from a schedule: durations hold approximately, intervals between single readings do not.
    Nominal,
    /// The order of the readings only: no duration holds.
    Ordinal,
}

impl fmt::Display for Times {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Measured => "measured",
            Self::Nominal => "nominal",
            Self::Ordinal => "ordinal",
        })
    }
}

/// Two steps that differ by less are equal, relative.
const EQUAL: f64 = 1e-6;
/// Equal steps over distances that vary by this factor were not measured.
const DISTANCES: f64 = 2.0;
/// A schedule has no more different steps: from target to target, at the turn, between cycles.
const SCHEDULE_STEPS: usize = 3;

/// The times of a file, and a note where they were not measured.
pub(super) fn of(raw: &Raw) -> (Times, Option<Note>) {
    let (times, why) = match raw.times {
        Some(times) => (times, "as stated by the format"),
        None => judged(raw),
    };
    let text = match times {
        Times::Measured => return (times, None),
        Times::Nominal => format!(
            "{}: times are nominal ({why}): durations hold approximately, vibration is not identifiable",
            raw.file
        ),
        Times::Ordinal => format!(
            "{}: times are ordinal ({why}): they give the order of the readings and no durations",
            raw.file
        ),
    };
    let unidentifiable = match times {
        Times::Ordinal => vec!["vibration".to_owned(), "clock-skew".to_owned()],
        _ => vec!["vibration".to_owned()],
    };
    (times, Some(Note { text, unidentifiable }))
}

/// What the steps of a table say.
fn judged(raw: &Raw) -> (Times, &'static str) {
    const CLOCK: (Times, &str) = (Times::Measured, "");
    let Some(t) = raw.column("t_s") else { return CLOCK };
    let moves = |name: &String| {
        name.starts_with('v') && (name.ends_with("_mm_per_s") || name.ends_with("_deg_per_s"))
    };
    let stated = raw.names.iter().zip(&raw.columns).filter(|(n, _)| moves(n) || *n == "moving");
    if stated.into_iter().any(|(_, values)| values.iter().any(|v| v.abs() > 0.0)) {
        return CLOCK;
    }
    let positions: Vec<&[f64]> = Axis::ALL.iter().filter_map(|a| raw.column(&a.column())).collect();
    let samples = motion::samples(t, 0, t.len());
    let distance = |a: usize, b: usize| positions.iter().map(|p| (p[b] - p[a]).abs()).fold(0.0, f64::max);
    let steps: Vec<(f64, f64)> =
        samples.windows(2).map(|w| (w[1].t - w[0].t, distance(w[0].first, w[1].first))).collect();
    let moved: Vec<(f64, f64)> = steps.iter().copied().filter(|(_, d)| *d > 1e-6).collect();
    // a log at one position is sampled evenly, and so are fast samples on the way
    let fast = |dt: f64| dt <= FAST_S;
    if steps.len() < FEW || 4 * moved.len() < steps.len() || steps.iter().any(|(dt, _)| fast(*dt)) {
        return CLOCK;
    }
    if steps.iter().all(|(dt, _)| *dt == 1.0) {
        return (Times::Ordinal, "t_s counts the readings");
    }
    let range = |of: &dyn Fn(&(f64, f64)) -> f64| {
        moved.iter().map(of).fold([f64::INFINITY, 0.0f64], |[l, h], v| [l.min(v), h.max(v)])
    };
    let ([dt_low, dt_high], [near, far]) = (range(&|s| s.0), range(&|s| s.1));
    if dt_high - dt_low <= EQUAL * dt_high && far > DISTANCES * near {
        return (Times::Ordinal, "equal steps between readings whatever the distance");
    }
    let mut different: Vec<f64> = Vec::new();
    for (dt, _) in &steps {
        if different.iter().all(|d| (d - dt).abs() > EQUAL * dt) {
            different.push(*dt);
        }
        if different.len() > SCHEDULE_STEPS {
            return CLOCK;
        }
    }
    (Times::Nominal, "exactly equal steps, as of a schedule")
}
