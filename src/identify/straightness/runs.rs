//! Runs in both directions: one curve where they agree, two where the axis comes back differently.
//!
//! Whether they differ is decided by the F test of the mean reversals at the targets against the scatter of repeated
//! readings, at the 1 % level. Without repeated readings nothing can be decided and both directions are kept.
//!
//! Source: analysis of variance.

use crate::Reading;
use crate::reading::{group_by_position, repeatability};
use volcomp_model::statistics::f_upper;
use volcomp_units::axes::Travel;

/// Probability of a scatter like the reversal below which both directions are kept.
const SIGNIFICANCE: f64 = 0.01;

/// What both directions say about the reversal of one component.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reversal {
    /// Measured in one direction only.
    OneDirection,
    /// Both directions, not repeated: cannot be judged.
    NotRepeated {
        /// RMS of forward minus reverse over the targets.
        rms: f64,
    },
    /// Within the scatter.
    Insignificant {
        /// RMS of forward minus reverse over the targets.
        rms: f64,
        /// Standard deviation of repeated readings.
        repeatability: f64,
    },
    /// Above the scatter.
    Significant {
        /// RMS of forward minus reverse over the targets.
        rms: f64,
        /// Standard deviation of repeated readings.
        repeatability: f64,
    },
}

impl Reversal {
    /// True where forward and reverse must be kept apart.
    #[must_use]
    pub const fn keeps_both(self) -> bool {
        matches!(self, Self::Significant { .. } | Self::NotRepeated { .. })
    }
}

/// Judges the reversal of the readings of one component.
#[must_use]
pub fn reversal(readings: &[Reading]) -> Reversal {
    let pairs = pairs(readings);
    if pairs.is_empty() {
        return Reversal::OneDirection;
    }
    let m = pairs.len() as f64;
    let rms = (pairs.iter().map(|p| p.0 * p.0).sum::<f64>() / m).sqrt();
    let Some(scatter) = repeatability(readings).filter(|s| *s > 0.0) else {
        return Reversal::NotRepeated { rms };
    };
    let ratio = pairs.iter().map(|(b, share)| b * b / (scatter * scatter * share)).sum::<f64>() / m;
    let (targets, _) = group_by_position(readings);
    let directions = 2 * targets.len();
    let dof = readings.len().saturating_sub(directions).max(1);
    if f_upper(ratio, pairs.len(), dof) < SIGNIFICANCE {
        Reversal::Significant { rms, repeatability: scatter }
    } else {
        Reversal::Insignificant { rms, repeatability: scatter }
    }
}

/// Forward minus reverse at every target that has both, and its variance for readings of variance 1.
fn pairs(readings: &[Reading]) -> Vec<(f64, f64)> {
    let (positions, group) = group_by_position(readings);
    let mut sums = vec![[(0.0, 0usize); 2]; positions.len()];
    for (r, &g) in readings.iter().zip(&group) {
        let slot = &mut sums[g][usize::from(r.travel == Travel::Reverse)];
        slot.0 += r.value;
        slot.1 += 1;
    }
    sums.iter()
        .filter(|[f, r]| f.1 > 0 && r.1 > 0)
        .map(|[f, r]| {
            let (nf, nr) = (f.1 as f64, r.1 as f64);
            (f.0 / nf - r.0 / nr, 1.0 / nf + 1.0 / nr)
        })
        .collect()
}

/// The readings with both directions as one, where the reversal is within the scatter.
#[must_use]
pub fn as_one_direction(readings: &[Reading]) -> Vec<Reading> {
    readings.iter().map(|r| Reading { travel: Travel::Forward, ..*r }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    fn data(seed: u64, reversal: f64, cycles: u32) -> Vec<Reading> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut all = Vec::new();
        for cycle in 1..=cycles {
            for travel in [Travel::Forward, Travel::Reverse] {
                for i in 0..11 {
                    let noise: f64 = StandardNormal.sample(&mut random);
                    let back = if travel == Travel::Reverse { reversal } else { 0.0 };
                    let position = f64::from(i) * 50.0;
                    all.push(Reading {
                        cycle,
                        travel,
                        position,
                        value: position * 1e-5 - back + 1e-3 * noise,
                    });
                }
            }
        }
        all
    }

    #[test]
    fn reversal_is_seen_where_it_is_and_rarely_where_it_is_not() {
        let share = |reversal_mm: f64| {
            let found = (0..2000).filter(|seed| reversal(&data(*seed, reversal_mm, 3)).keeps_both()).count();
            found as f64 / 2000.0
        };
        let false_alarms = share(0.0);
        assert!((0.003..0.02).contains(&false_alarms), "{false_alarms}");
        assert!(share(3e-3) > 0.99);
    }

    #[test]
    fn without_repetition_or_return_nothing_is_averaged_away() {
        assert!(matches!(reversal(&data(1, 5e-3, 1)), Reversal::NotRepeated { .. }));
        let mut one = data(1, 0.0, 2);
        one.retain(|r| r.travel == Travel::Forward);
        assert_eq!(reversal(&one), Reversal::OneDirection);
        let Reversal::Significant { rms, .. } = reversal(&data(1, 5e-3, 5)) else {
            panic!("5 um of reversal")
        };
        assert!((rms - 5e-3).abs() < 1e-3);
        assert!(as_one_direction(&data(1, 0.0, 2)).iter().all(|r| r.travel == Travel::Forward));
    }
}
