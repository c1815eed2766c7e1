//! ISO 230-2: accuracy and repeatability of positioning.
//!
//! With `x_ij` the deviations at target `i`, mean and standard deviation `s` (over `n - 1`) per direction:
//! `B_i = mean+ - mean-`, `R_i+ = 4 s+`, `R_i = max(2 s+ + 2 s- + |B_i|, R_i+, R_i-)`,
//! `E` = range of all directional means, `M` = range of the means of both directions,
//! `A = max(mean + 2 s) - min(mean - 2 s)` over both directions.
//!
//! Source: ISO 230-2:2014, clauses 3 and 7; `docs/reference/json-output.md` 3.

use volcomp_units::axes::Travel;

/// One reading at a target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositioningReading {
    /// Direction in which the target was approached.
    pub travel: Travel,
    /// Target position.
    pub target: f64,
    /// Actual minus target.
    pub deviation: f64,
}

/// One direction of approach.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unidirectional {
    /// Systematic positioning error E.
    pub e: f64,
    /// Accuracy A.
    pub a: f64,
    /// Repeatability R.
    pub r: f64,
}

/// Figures that need both directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bidirectional {
    /// Reversal error B: the largest `|B_i|`.
    pub b: f64,
    /// Mean of the `B_i`, with sign.
    pub b_mean: f64,
    /// Repeatability R.
    pub r: f64,
    /// Systematic positioning error E.
    pub e: f64,
    /// Mean bidirectional positioning error M.
    pub m: f64,
    /// Accuracy A.
    pub a: f64,
}

/// The result of a positioning test.
#[derive(Debug, Clone, PartialEq)]
pub struct Positioning {
    /// Targets in increasing order, with mean and spread of each direction.
    pub targets: Vec<AtTarget>,
    /// Fewest readings of any target in any direction.
    pub cycles: usize,
    /// Approached forward, where measured.
    pub forward: Option<Unidirectional>,
    /// Approached backward, where measured.
    pub backward: Option<Unidirectional>,
    /// Both together, where both were measured.
    pub both: Option<Bidirectional>,
}

/// Why a test cannot be evaluated.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PositioningError {
    /// Fewer than two targets.
    #[error("{found} of at least 2 targets that a positioning test needs")]
    TooFewTargets {
        /// Targets found.
        found: usize,
    },
    /// A target without enough repetitions.
    #[error("target {target}: {found} of at least 2 readings in the {} direction that a standard deviation needs (the standard asks for 5)", if matches!(travel, Travel::Forward) { "forward" } else { "backward" })]
    TooFewReadings {
        /// The target.
        target: f64,
        /// The direction.
        travel: Travel,
        /// Readings found.
        found: usize,
    },
    /// A number that is none.
    #[error("reading {row} is not finite")]
    NotFinite {
        /// 1-based reading.
        row: usize,
    },
}

/// Mean and standard deviation at one target in one direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// Mean of the deviations.
    pub mean: f64,
    /// Their standard deviation.
    pub s: f64,
    /// How many there are.
    pub n: usize,
}

/// One target with what was measured there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AtTarget {
    /// The target.
    pub target: f64,
    /// Approached forward.
    pub forward: Option<Spread>,
    /// Approached backward.
    pub backward: Option<Spread>,
}

impl AtTarget {
    /// Reversal `B_i` with its sign.
    #[must_use]
    pub fn reversal(&self) -> Option<f64> {
        Some(self.forward?.mean - self.backward?.mean)
    }

    /// Mean of both directions.
    #[must_use]
    pub fn mean(&self) -> Option<f64> {
        Some(0.5 * (self.forward?.mean + self.backward?.mean))
    }

    /// Bidirectional repeatability `R_i`: the largest of `2 s+ + 2 s- + |B_i|`, `4 s+`, `4 s-`.
    #[must_use]
    pub fn repeatability(&self) -> Option<f64> {
        let (f, b) = (self.forward?, self.backward?);
        Some((2.0 * (f.s + b.s) + self.reversal()?.abs()).max(4.0 * f.s).max(4.0 * b.s))
    }

    /// The spreads of the directions that were measured.
    pub fn spreads(&self) -> impl Iterator<Item = Spread> + Clone + '_ {
        self.forward.iter().chain(&self.backward).copied()
    }
}

impl Positioning {
    /// Range of the targets.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.targets.first().zip(self.targets.last()).map_or(0.0, |(a, b)| b.target - a.target)
    }

    /// Evaluates a test; the order of the readings does not matter.
    ///
    /// # Errors
    /// Fewer than two targets, fewer than two readings at a target in a direction that was measured.
    pub fn evaluate(readings: &[PositioningReading]) -> Result<Self, PositioningError> {
        if let Some(i) = readings.iter().position(|r| !(r.target.is_finite() && r.deviation.is_finite())) {
            return Err(PositioningError::NotFinite { row: i + 1 });
        }
        let (targets, group) = group_by_target(readings);
        if targets.len() < 2 {
            return Err(PositioningError::TooFewTargets { found: targets.len() });
        }
        let mut cycles = usize::MAX;
        let mut spreads = |travel: Travel| -> Result<Option<Vec<Spread>>, PositioningError> {
            if readings.iter().all(|r| r.travel != travel) {
                return Ok(None);
            }
            let mut values = vec![Vec::new(); targets.len()];
            for (r, &g) in readings.iter().zip(&group).filter(|(r, _)| r.travel == travel) {
                values[g].push(r.deviation);
            }
            for (target, v) in targets.iter().zip(&values) {
                if v.len() < 2 {
                    let (target, found) = (*target, v.len());
                    return Err(PositioningError::TooFewReadings { target, travel, found });
                }
                cycles = cycles.min(v.len());
            }
            Ok(Some(values.iter().map(|v| Spread::of(v)).collect()))
        };
        let (forward, backward) = (spreads(Travel::Forward)?, spreads(Travel::Reverse)?);
        let both = forward.as_ref().zip(backward.as_ref()).map(|(f, b)| bidirectional(f, b));
        let at = |side: &Option<Vec<Spread>>, i: usize| side.as_ref().map(|s| s[i]);
        let targets = targets
            .iter()
            .enumerate()
            .map(|(i, t)| AtTarget { target: *t, forward: at(&forward, i), backward: at(&backward, i) })
            .collect();
        let unidirectional = |s: Vec<Spread>| unidirectional(&s);
        Ok(Self {
            targets,
            cycles,
            forward: forward.map(unidirectional),
            backward: backward.map(unidirectional),
            both,
        })
    }
}

/// The distinct targets, increasing, and for each reading the index of its target. Targets closer than 1e-9 of the
/// range are the same.
fn group_by_target(readings: &[PositioningReading]) -> (Vec<f64>, Vec<usize>) {
    let mut sorted: Vec<f64> = readings.iter().map(|r| r.target).collect();
    sorted.sort_by(f64::total_cmp);
    let same = match (sorted.first(), sorted.last()) {
        (Some(first), Some(last)) => 1e-9 * (last - first),
        _ => 0.0,
    };
    sorted.dedup_by(|later, earlier| *later - *earlier <= same);
    let group = |r: &PositioningReading| sorted.partition_point(|t| *t <= r.target).saturating_sub(1);
    let groups = readings.iter().map(group).collect();
    (sorted, groups)
}

impl Spread {
    fn of(values: &[f64]) -> Self {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let s = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
        Self { mean, s, n: values.len() }
    }
}

pub(super) fn unidirectional(spreads: &[Spread]) -> Unidirectional {
    Unidirectional {
        e: range(spreads.iter().map(|p| p.mean)),
        a: accuracy(spreads.iter()),
        r: largest(spreads.iter().map(|p| 4.0 * p.s)),
    }
}

pub(super) fn bidirectional(forward: &[Spread], backward: &[Spread]) -> Bidirectional {
    let pairs = || forward.iter().zip(backward);
    let reversal = |(f, b): (&Spread, &Spread)| f.mean - b.mean;
    Bidirectional {
        b: largest(pairs().map(|p| reversal(p).abs())),
        b_mean: pairs().map(reversal).sum::<f64>() / forward.len() as f64,
        r: largest(
            pairs().map(|(f, b)| (2.0 * (f.s + b.s) + reversal((f, b)).abs()).max(4.0 * f.s).max(4.0 * b.s)),
        ),
        e: range(forward.iter().chain(backward).map(|p| p.mean)),
        m: range(pairs().map(|(f, b)| 0.5 * (f.mean + b.mean))),
        a: accuracy(forward.iter().chain(backward)),
    }
}

fn accuracy<'a>(spreads: impl Iterator<Item = &'a Spread> + Clone) -> f64 {
    largest(spreads.clone().map(|p| p.mean + 2.0 * p.s)) + largest(spreads.map(|p| 2.0 * p.s - p.mean))
}

fn range(values: impl Iterator<Item = f64> + Clone) -> f64 {
    largest(values.clone()) + largest(values.map(|v| -v))
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(f64::NEG_INFINITY, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reading(travel: Travel, target: f64, deviation: f64) -> PositioningReading {
        PositioningReading { travel, target, deviation }
    }

    #[test]
    fn two_targets_by_hand() {
        use Travel::{Forward, Reverse};
        // mean 1, s sqrt(2); mean 5, s 0; mean -2, s sqrt(2)/2; mean 4, s 0
        let all = [
            reading(Forward, 0.0, 0.0),
            reading(Forward, 0.0, 2.0),
            reading(Forward, 10.0, 5.0),
            reading(Forward, 10.0, 5.0),
            reading(Reverse, 0.0, -2.5),
            reading(Reverse, 0.0, -1.5),
            reading(Reverse, 10.0, 4.0),
            reading(Reverse, 10.0, 4.0),
        ];
        let p = Positioning::evaluate(&all).unwrap();
        let root = 2f64.sqrt();
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-14, "{a} instead of {b}");
        let (f, b, both) = (p.forward.unwrap(), p.backward.unwrap(), p.both.unwrap());
        close(f.e, 4.0);
        close(f.r, 4.0 * root);
        close(f.a, 5.0 - (1.0 - 2.0 * root));
        close(b.e, 6.0);
        close(b.r, 2.0 * root);
        close(b.a, 4.0 + 2.0 + root);
        close(both.b, 3.0);
        close(both.b_mean, 2.0);
        close(both.r, 3.0 * root + 3.0);
        close(both.e, 7.0);
        close(both.m, 5.0);
        close(both.a, 5.0 + 2.0 + root);
        assert_eq!((p.cycles, p.targets.len()), (2, 2));
    }

    #[test]
    fn one_direction_has_no_bidirectional_figures() {
        let all: Vec<PositioningReading> =
            (0..6).map(|i| reading(Travel::Reverse, f64::from(i % 3), f64::from(i))).collect();
        let p = Positioning::evaluate(&all).unwrap();
        assert!(p.forward.is_none() && p.both.is_none() && p.backward.is_some());
    }

    #[test]
    fn an_incomplete_test_is_refused() {
        let mut all = vec![
            reading(Travel::Forward, 0.0, 0.0),
            reading(Travel::Forward, 0.0, 0.0),
            reading(Travel::Forward, 5.0, 0.0),
        ];
        assert_eq!(
            Positioning::evaluate(&all).unwrap_err(),
            PositioningError::TooFewReadings { target: 5.0, travel: Travel::Forward, found: 1 }
        );
        all.truncate(2);
        assert_eq!(Positioning::evaluate(&all).unwrap_err(), PositioningError::TooFewTargets { found: 1 });
        all[1].deviation = f64::NAN;
        assert_eq!(Positioning::evaluate(&all).unwrap_err(), PositioningError::NotFinite { row: 2 });
    }
}
