//! Runs in both directions: one curve where they agree, two where the axis comes back differently.
//!
//! Whether they differ is decided by the F test of the mean reversals at the targets against the scatter of repeated
//! readings, at the 1 % level. Without repeated readings nothing can be decided and both directions are kept.
//!
//! Source: analysis of variance.

use super::{Line, Rule};
use crate::prelude::*;
use crate::reading::repeatability;
use volcomp_model::Sense;

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

/// The targets, and at each sum and number of the readings forward and reverse.
fn sums(readings: &[Reading]) -> (Vec<f64>, Vec<[(f64, usize); 2]>) {
    let (positions, group) = group_by_position(readings);
    let mut sums = vec![[(0.0, 0usize); 2]; positions.len()];
    for (r, &g) in readings.iter().zip(&group) {
        let slot = &mut sums[g][usize::from(r.travel == Travel::Reverse)];
        slot.0 += r.value;
        slot.1 += 1;
    }
    (positions, sums)
}

/// The targets and the mean of the readings at each, both directions alike.
#[must_use]
pub fn means(readings: &[Reading]) -> (Vec<f64>, Vec<f64>) {
    let (positions, sums) = sums(readings);
    let mean = |both: [(f64, usize); 2]| {
        let there: Vec<f64> = both.iter().filter(|(_, n)| *n > 0).map(|(s, n)| s / *n as f64).collect();
        there.iter().sum::<f64>() / there.len() as f64
    };
    (positions, sums.into_iter().map(mean).collect())
}

/// The readings of a straightness about their reference line; every other component as it is. All are zero at the position
/// nearest to home.
#[must_use]
pub fn gauged(mut readings: Vec<Reading>, component: Component, axis: AxisName, rule: Rule) -> Vec<Reading> {
    let (x, mut y) = means(&readings);
    let is_straightness = !component.is_angle() && component.index() != axis.direction();
    if is_straightness && let Ok(line) = Line::fit(&x, &y, rule) {
        y = line.deviations(&x, &y);
        for r in &mut readings {
            r.value -= line.intercept + line.slope * r.position;
        }
    }
    let home = x.iter().zip(&y).min_by(|a, b| a.0.abs().total_cmp(&b.0.abs())).map_or(0.0, |(_, v)| *v);
    for r in &mut readings {
        r.value -= home;
    }
    readings
}

/// The readings of an axis that carries the workpiece in the sense in which they are stored (equations 1.4).
#[must_use]
pub fn in_stored_sense(readings: Vec<Reading>, measured: Sense, stored: Sense) -> Vec<Reading> {
    let sign = if measured == stored { 1.0 } else { -1.0 };
    let one = |r: Reading| match stored {
        Sense::Relative => Reading { value: sign * r.value, ..r },
        Sense::Carriage => {
            Reading { value: sign * r.value, position: -r.position, travel: r.travel.reversed(), ..r }
        }
    };
    readings.into_iter().map(one).collect()
}

/// Forward minus reverse at every target that has both, and its variance for readings of variance 1.
fn pairs(readings: &[Reading]) -> Vec<(f64, f64)> {
    let (_, sums) = sums(readings);
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

    fn at(position: f64, value: f64, travel: Travel) -> Reading {
        Reading { cycle: 1, travel, position, value }
    }

    #[test]
    fn senses_of_an_axis_that_carries_the_workpiece() {
        let readings = vec![at(100.0, 0.01, Travel::Forward)];
        let of = |m, s| in_stored_sense(readings.clone(), m, s)[0];
        assert_eq!(of(Sense::Carriage, Sense::Relative), at(100.0, -0.01, Travel::Forward));
        assert_eq!(of(Sense::Carriage, Sense::Carriage), at(-100.0, 0.01, Travel::Reverse));
        assert_eq!(of(Sense::Relative, Sense::Carriage), at(-100.0, -0.01, Travel::Reverse));
        assert_eq!(of(Sense::Relative, Sense::Relative), at(100.0, 0.01, Travel::Forward));
    }

    #[test]
    fn the_gauge_takes_slope_and_value_at_home() {
        let line: Vec<Reading> =
            [-100.0, 0.0, 100.0].map(|x| at(x, 0.5 + 1e-4 * x + x.abs() * 1e-3, Travel::Forward)).to_vec();
        let straight = gauged(line.clone(), Component::Y, AxisName::X, Rule::EndPoint);
        let expected = [0.1, 0.0, 0.1];
        assert!(straight.iter().zip(expected).all(|(r, e)| (r.value - e).abs() < 1e-12), "{straight:?}");
        let scale = gauged(line, Component::X, AxisName::X, Rule::EndPoint);
        assert!((scale[2].value - 0.11).abs() < 1e-12 && scale[1].value == 0.0);
    }
}
