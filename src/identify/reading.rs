//! One measured value of an error along one axis, and the grouping of readings by position.

use volcomp_units::axes::Travel;

/// One reading. Positions and values are mm or rad: the axis and the symbol decide.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Which repetition of the program; 0 where the data do not say.
    pub cycle: u32,
    /// Direction in which the position was approached.
    pub travel: Travel,
    /// Programmed coordinate of the axis.
    pub position: f64,
    /// Actual minus nominal.
    pub value: f64,
}

/// Two positions closer than this share of the covered range are the same target.
const SAME_TARGET: f64 = 1e-9;

/// The distinct positions, increasing, and for each reading the index of its position.
#[must_use]
pub fn group_by_position(readings: &[Reading]) -> (Vec<f64>, Vec<usize>) {
    let mut order: Vec<usize> = (0..readings.len()).collect();
    order.sort_by(|&a, &b| readings[a].position.total_cmp(&readings[b].position));
    let span = match (order.first(), order.last()) {
        (Some(&a), Some(&b)) => readings[b].position - readings[a].position,
        _ => 0.0,
    };
    let mut positions: Vec<f64> = Vec::new();
    let mut group = vec![0; readings.len()];
    for i in order {
        let x = readings[i].position;
        if positions.last().is_none_or(|&last| x - last > SAME_TARGET * span) {
            positions.push(x);
        }
        group[i] = positions.len() - 1;
    }
    (positions, group)
}

/// Standard deviation of the readings about the mean of their own target and direction, pooled: what no static
/// map can remove. `None` where no target was repeated.
#[must_use]
pub fn repeatability(readings: &[Reading]) -> Option<f64> {
    let (positions, group) = group_by_position(readings);
    let mut sums = vec![(0.0, 0usize); 2 * positions.len()];
    let slot = |r: &Reading, g: usize| 2 * g + usize::from(r.travel == Travel::Reverse);
    for (r, &g) in readings.iter().zip(&group) {
        let sum = &mut sums[slot(r, g)];
        sum.0 += r.value;
        sum.1 += 1;
    }
    let free: usize = sums.iter().map(|(_, n)| n.saturating_sub(1)).sum();
    let squares: f64 = readings
        .iter()
        .zip(&group)
        .map(|(r, &g)| {
            let (sum, n) = sums[slot(r, g)];
            (r.value - sum / n as f64).powi(2)
        })
        .sum();
    (free > 0).then(|| (squares / free as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_does_not_split_a_target() {
        let at = |position| Reading { cycle: 0, travel: Travel::Forward, position, value: 0.0 };
        let (positions, group) = group_by_position(&[at(10.0), at(0.1 + 0.2), at(0.3), at(-5.0)]);
        assert_eq!(positions.len(), 3);
        assert_eq!(group, [2, 1, 1, 0]);
        assert_eq!(group_by_position(&[]), (Vec::new(), Vec::new()));
    }

    #[test]
    fn repeatability_ignores_what_a_map_with_reversal_can_hold() {
        let mut all = Vec::new();
        for (cycle, noise) in [(1, 1.0), (2, -1.0)] {
            for position in [0.0, 10.0, 20.0] {
                for (travel, reversal) in [(Travel::Forward, 5.0), (Travel::Reverse, -7.0)] {
                    all.push(Reading { cycle, travel, position, value: position + reversal + noise });
                }
            }
        }
        assert!((repeatability(&all).unwrap() - 2f64.sqrt()).abs() < 1e-15);
        assert_eq!(repeatability(&all[..6]), None);
    }
}
