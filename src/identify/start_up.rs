//! Start-up outliers of a positioning test: readings of the first cycle far outside of the scatter of the other cycles at the
//! same target and direction.
//!
//! A stage that was switched on, referenced or clamped shortly before the test often shows its first readings tens of
//! standard deviations away. They are measurements: they are reported and never removed silently.

use crate::prelude::*;

/// A reading of the first cycle that the other cycles contradict; mm or rad as the test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StartUpOutlier {
    /// Index of the reading.
    pub reading: usize,
    /// Reading minus the median of the other cycles at the same target and direction.
    pub apart: f64,
    /// Limit of `apart` for this reading.
    pub limit: f64,
}

/// Fewest other cycles that show a scatter.
const OTHERS_MIN: usize = 3;
/// Standard deviations of the repeatability, pooled over targets and directions, below which a reading is ordinary.
const SIGMAS: f64 = 6.0;
/// Ranges of the other cycles at the same target and direction below which a reading is ordinary.
const RANGES: f64 = 2.0;
/// Display steps below which a reading is ordinary.
const STEPS: f64 = 3.0;

/// The start-up outliers of a test, in the order of its readings. What the first cycle has in common with all targets is drift
/// and no outlier.
#[must_use]
pub fn start_up_outliers(readings: &[Reading]) -> Vec<StartUpOutlier> {
    let Some(first) = readings.iter().map(|r| r.cycle).min() else { return Vec::new() };
    let (_, group) = group_by_position(readings);
    let key = |i: usize| (group[i], readings[i].travel == Travel::Reverse);
    let mut others: BTreeMap<(usize, bool), Vec<f64>> = BTreeMap::new();
    for (i, r) in readings.iter().enumerate().filter(|(_, r)| r.cycle != first) {
        others.entry(key(i)).or_default().push(r.value);
    }
    others.retain(|_, values| values.len() >= OTHERS_MIN);
    for values in others.values_mut() {
        values.sort_by(f64::total_cmp);
    }
    let Some(sigma) = pooled(others.values()) else { return Vec::new() };
    let middle: BTreeMap<(usize, bool), f64> =
        others.iter().filter_map(|(key, values)| Some((*key, median(values.clone())?))).collect();
    let apart = |(i, r): (usize, &Reading)| Some((i, r.value - middle.get(&key(i))?));
    let first_cycle: Vec<(usize, f64)> =
        readings.iter().enumerate().filter(|(_, r)| r.cycle == first).filter_map(apart).collect();
    let drift = median(first_cycle.iter().map(|(_, d)| *d).collect()).unwrap_or(0.0);
    let step = step_of(readings);
    let outlier = |(reading, apart): (usize, f64)| {
        let values = others.get(&key(reading))?;
        let range = values.last()? - values.first()?;
        let limit = (SIGMAS * sigma).max(RANGES * range).max(STEPS * step);
        (apart.abs().min((apart - drift).abs()) > limit).then_some(StartUpOutlier { reading, apart, limit })
    };
    first_cycle.into_iter().filter_map(outlier).collect()
}

/// Standard deviation from the median of the variances of all groups, which single groups do not move; `None` without one.
fn pooled<'a>(groups: impl Iterator<Item = &'a Vec<f64>>) -> Option<f64> {
    let variance = |values: &Vec<f64>| {
        let free = values.len() as f64 - 1.0;
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let sum: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
        // median of a chi-square variable, by Wilson and Hilferty
        sum / (free * (1.0 - 2.0 / (9.0 * free)).powi(3))
    };
    median(groups.map(variance).collect()).map(f64::sqrt)
}

/// Smallest difference between two values: the display step of a coarse instrument.
fn step_of(readings: &[Reading]) -> f64 {
    let mut values: Vec<f64> = readings.iter().map(|r| r.value).collect();
    values.sort_by(f64::total_cmp);
    let scale = values.last().zip(values.first()).map_or(0.0, |(high, low)| high - low);
    let steps = values.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > 1e-9 * scale);
    let smallest = steps.fold(f64::INFINITY, f64::min);
    if smallest.is_finite() { smallest } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Five cycles over five targets in both directions with a repeatability of 1 um, and a change.
    fn cycles(change: impl Fn(u32, usize, bool) -> f64) -> Vec<Reading> {
        let mut all = Vec::new();
        for cycle in 1..=5u32 {
            for back in [false, true] {
                for target in 0..5usize {
                    let n = all.len() as f64;
                    let noise = 1e-3 * ((n * 2.399).sin() + (n * 1.37).cos());
                    all.push(Reading {
                        cycle,
                        travel: if back { Travel::Reverse } else { Travel::Forward },
                        position: 10.0 * target as f64,
                        value: 0.02 * target as f64 + noise + change(cycle, target, back),
                    });
                }
            }
        }
        all
    }

    #[test]
    fn the_first_readings_of_a_cold_stage_are_found() {
        let all = cycles(|cycle, target, back| match (cycle, target, back) {
            (1, 0, false) => 0.114,
            (1, 1, false) => 0.050,
            _ => 0.0,
        });
        let found = start_up_outliers(&all);
        assert_eq!(found.iter().map(|o| o.reading).collect::<Vec<_>>(), [0, 1]);
        assert!((found[0].apart - 0.114).abs() < 0.004 && found[0].limit < 0.02, "{found:?}");
    }

    #[test]
    fn noise_drift_and_later_readings_are_none() {
        assert!(start_up_outliers(&cycles(|_, _, _| 0.0)).is_empty());
        // the first cycle 30 um off everywhere: drift
        assert!(start_up_outliers(&cycles(|cycle, _, _| -0.03 * f64::from(cycle == 1))).is_empty());
        assert!(start_up_outliers(&cycles(|cycle, _, _| -0.011 * f64::from(cycle))).is_empty());
        // an outlier of another cycle is none of the start
        assert!(
            start_up_outliers(&cycles(|cycle, target, _| 0.1 * f64::from(cycle == 3 && target == 2)))
                .is_empty()
        );
        assert!(start_up_outliers(&[]).is_empty());
    }

    #[test]
    fn too_few_cycles_show_no_scatter() {
        let mut all = cycles(|cycle, target, _| 0.1 * f64::from(cycle == 1 && target == 0));
        all.retain(|r| r.cycle <= 3);
        assert!(start_up_outliers(&all).is_empty());
    }

    #[test]
    fn a_display_step_is_no_outlier() {
        let mut all = cycles(|_, _, _| 0.0);
        for r in &mut all {
            r.value = f64::from(u8::from(r.cycle == 1 && r.position == 20.0)) * 1e-3;
        }
        assert!(start_up_outliers(&all).is_empty(), "one step of 1 um above constant readings");
    }
}
