//! One measured value of an error along one axis, and the grouping of readings by position.

use crate::core::axes::Travel;

/// One reading. Positions and values are mm or rad: the axis and the symbol decide.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Which repetition of the programme; 0 where the data do not say.
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
}
