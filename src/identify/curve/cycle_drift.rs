//! Drift from cycle to cycle, which a curve of both directions takes for reversal.
//!
//! Over a pass out and back a reading at share `s` of the way comes `s/2` of a cycle after its begin, and `1 - s/2` on the way back:
//! a drift of `d` per cycle adds `d (1 - s)` to the difference of the directions.

use std::collections::BTreeMap;

use volcomp_model::statistics::f_upper;
use volcomp_units::axes::Travel;

use crate::reading::{Reading, group_by_position};

/// Probability below which the trend of the cycles is no chance.
const TREND: f64 = 0.01;
/// Fewest cycles that show a trend.
const CYCLES_MIN: usize = 3;

/// The trend of the readings over the cycles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CycleDrift {
    /// Change from one cycle to the next, in the unit of the readings.
    pub(super) per_cycle: f64,
    /// Probability of such a trend without drift.
    pub(super) p_value: f64,
}

/// The trend, where both directions were measured in three cycles or more and it is significant.
pub(super) fn find(readings: &[Reading]) -> Option<CycleDrift> {
    let is_reverse = |r: &Reading| usize::from(r.travel == Travel::Reverse);
    if readings.iter().all(|r| is_reverse(r) == 0) || readings.iter().all(|r| is_reverse(r) == 1) {
        return None;
    }
    let (positions, group) = group_by_position(readings);
    let mut means = vec![(0.0, 0.0); 2 * positions.len()];
    for (r, g) in readings.iter().zip(&group) {
        let mean = &mut means[2 * g + is_reverse(r)];
        mean.1 += 1.0;
        mean.0 += (r.value - mean.0) / mean.1;
    }
    let mut cycles: BTreeMap<u32, (f64, f64)> = BTreeMap::new();
    for (r, g) in readings.iter().zip(&group) {
        let cycle = cycles.entry(r.cycle).or_default();
        cycle.1 += 1.0;
        cycle.0 += (r.value - means[2 * g + is_reverse(r)].0 - cycle.0) / cycle.1;
    }
    let count = cycles.len() as f64;
    if cycles.len() < CYCLES_MIN {
        return None;
    }
    let centre = cycles.keys().map(|c| f64::from(*c)).sum::<f64>() / count;
    let mean = cycles.values().map(|c| c.0).sum::<f64>() / count;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for (cycle, (value, _)) in &cycles {
        let (x, y) = (f64::from(*cycle) - centre, value - mean);
        xx += x * x;
        xy += x * y;
        yy += y * y;
    }
    let per_cycle = xy / xx;
    let dof = cycles.len() - 2;
    let explained = per_cycle * xy;
    let p_value = f_upper(explained * dof as f64 / (yy - explained).max(f64::MIN_POSITIVE), 1, dof);
    (p_value < TREND).then_some(CycleDrift { per_cycle, p_value })
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Five cycles out and back over eleven targets, the drift going on all the time.
    fn readings(per_cycle: f64, noise: f64, seed: u64) -> Vec<Reading> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut all = Vec::new();
        for cycle in 1..=5u32 {
            for k in 0..22u32 {
                let (travel, target) = if k < 11 { (Travel::Forward, k) } else { (Travel::Reverse, 21 - k) };
                let time = f64::from(cycle) + f64::from(k) / 22.0;
                let value =
                    0.01 * f64::from(target) + per_cycle * time + noise * random.random_range(-1.0..1.0);
                all.push(Reading { cycle, travel, position: 50.0 * f64::from(target), value });
            }
        }
        all
    }

    #[test]
    fn a_drift_is_found_and_chance_is_not() {
        let found = find(&readings(1.2, 0.5, 1)).unwrap();
        assert!((found.per_cycle - 1.2).abs() < 0.1 && found.p_value < 1e-3, "{found:?}");
        let false_alarms = (0..1000).filter(|seed| find(&readings(0.0, 0.5, *seed)).is_some()).count();
        assert!((2..25).contains(&false_alarms), "{false_alarms}");
    }

    #[test]
    fn one_direction_or_two_cycles_say_nothing() {
        let all = readings(1.2, 0.1, 1);
        let of = |keep: fn(&Reading) -> bool| find(&all.iter().copied().filter(keep).collect::<Vec<_>>());
        assert_eq!(of(|r| r.travel == Travel::Forward), None);
        assert_eq!(of(|r| r.cycle < 3), None);
        assert_eq!(find(&[]), None);
    }
}
