//! ISO 230-2: accuracy and repeatability of positioning.
//!
//! With `x_ij` the deviations at target `i`, mean and standard deviation `s` (over `n - 1`) per direction:
//! `B_i = mean+ - mean-`, `R_i+ = 4 s+`, `R_i = max(2 s+ + 2 s- + |B_i|, R_i+, R_i-)`,
//! `E` = range of all directional means, `M` = range of the means of both directions,
//! `A = max(mean + 2 s) - min(mean - 2 s)` over both directions.
//!
//! Source: ISO 230-2:2014, clauses 3 and 7; contract section 6.

use crate::core::axes::Travel;
use crate::identify::Reading;
use crate::identify::reading::group_by_position;

/// One direction of approach.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unidirectional {
    /// Systematic deviation E.
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
    /// Systematic deviation E.
    pub e: f64,
    /// Mean systematic deviation M.
    pub m: f64,
    /// Accuracy A.
    pub a: f64,
}

/// The result of a positioning test.
#[derive(Debug, Clone, PartialEq)]
pub struct Positioning {
    /// Target positions.
    pub targets: Vec<f64>,
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
    #[error("{found} targets; a positioning test needs at least 2")]
    TooFewTargets {
        /// Targets found.
        found: usize,
    },
    /// A target without enough repetitions.
    #[error("target {target} has {found} readings in the {} direction; the standard deviation needs at least 2 (the standard asks for 5)", if matches!(travel, Travel::Forward) { "forward" } else { "backward" })]
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
#[derive(Clone, Copy)]
struct Spread {
    mean: f64,
    s: f64,
}

impl Positioning {
    /// Evaluates a test; the order of the readings does not matter.
    ///
    /// # Errors
    /// Fewer than two targets, fewer than two readings at a target in a direction that was measured.
    pub fn evaluate(readings: &[Reading]) -> Result<Self, PositioningError> {
        if let Some(i) = readings.iter().position(|r| !(r.position.is_finite() && r.value.is_finite())) {
            return Err(PositioningError::NotFinite { row: i + 1 });
        }
        let (targets, group) = group_by_position(readings);
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
                values[g].push(r.value);
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

impl Spread {
    fn of(values: &[f64]) -> Self {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let s = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
        Self { mean, s }
    }
}

fn unidirectional(spreads: &[Spread]) -> Unidirectional {
    Unidirectional {
        e: range(spreads.iter().map(|p| p.mean)),
        a: accuracy(spreads.iter()),
        r: largest(spreads.iter().map(|p| 4.0 * p.s)),
    }
}

fn bidirectional(forward: &[Spread], backward: &[Spread]) -> Bidirectional {
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

    fn reading(cycle: u32, travel: Travel, position: f64, value: f64) -> Reading {
        Reading { cycle, travel, position, value }
    }

    #[test]
    fn two_targets_by_hand() {
        use Travel::{Forward, Reverse};
        // mean 1, s sqrt(2); mean 5, s 0; mean -2, s sqrt(2)/2; mean 4, s 0
        let all = [
            reading(1, Forward, 0.0, 0.0),
            reading(2, Forward, 0.0, 2.0),
            reading(1, Forward, 10.0, 5.0),
            reading(2, Forward, 10.0, 5.0),
            reading(1, Reverse, 0.0, -2.5),
            reading(2, Reverse, 0.0, -1.5),
            reading(1, Reverse, 10.0, 4.0),
            reading(2, Reverse, 10.0, 4.0),
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
        let all: Vec<Reading> =
            (0..6).map(|i| reading(i / 3, Travel::Reverse, f64::from(i % 3), f64::from(i))).collect();
        let p = Positioning::evaluate(&all).unwrap();
        assert!(p.forward.is_none() && p.both.is_none() && p.backward.is_some());
    }

    #[test]
    fn an_incomplete_test_is_refused() {
        let mut all = vec![
            reading(1, Travel::Forward, 0.0, 0.0),
            reading(2, Travel::Forward, 0.0, 0.0),
            reading(1, Travel::Forward, 5.0, 0.0),
        ];
        assert_eq!(
            Positioning::evaluate(&all).unwrap_err(),
            PositioningError::TooFewReadings { target: 5.0, travel: Travel::Forward, found: 1 }
        );
        all.truncate(2);
        assert_eq!(Positioning::evaluate(&all).unwrap_err(), PositioningError::TooFewTargets { found: 1 });
        all[1].value = f64::NAN;
        assert_eq!(Positioning::evaluate(&all).unwrap_err(), PositioningError::NotFinite { row: 2 });
    }
}
