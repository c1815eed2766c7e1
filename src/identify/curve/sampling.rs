//! What the distance of the targets hides: errors that repeat with the pitch of a screw.
//!
//! Targets at a multiple of the pitch meet the screw at the same angle every time: its error looks like an
//! offset (alias at zero). Targets farther apart than half a pitch show it as a slower wave (equations 5.9), unless their
//! distances are unequal.

use std::collections::HashSet;

use crate::Reading;
use volcomp_estimate::SpectralWindow;

/// Pitches of ball screws in machine tools, mm.
pub const COMMON_PITCHES: [f64; 7] = [5.0, 6.0, 8.0, 10.0, 12.0, 16.0, 20.0];

/// Coherence above which all targets meet the screw at the same angle.
const SAME_ANGLE: f64 = 0.95;

/// What a set of targets hides.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Hidden {
    /// Middle distance between neighbouring targets.
    pub spacing: f64,
    /// Pitches whose error looks like an offset here.
    pub constant: Vec<f64>,
    /// Pitches whose error looks like another wave here.
    pub slower: Vec<f64>,
}

/// Targets of a positioning test are far fewer.
const TARGETS_MAX: usize = 1 << 16;

/// The distinct positions in any order; `None` where there are so many that they hide nothing.
#[must_use]
pub fn few_positions(readings: &[Reading]) -> Option<Vec<f64>> {
    let mut seen = HashSet::new();
    for reading in readings {
        if seen.insert(reading.position.to_bits()) && seen.len() > TARGETS_MAX {
            return None;
        }
    }
    Some(seen.into_iter().map(f64::from_bits).collect())
}

/// Which of these pitches the targets cannot show; positions in any order, repeated ones count once.
#[must_use]
pub fn hidden(positions: &[f64], pitches: &[f64]) -> Hidden {
    let mut x = positions.to_vec();
    x.sort_by(f64::total_cmp);
    let span = x.last().zip(x.first()).map_or(0.0, |(b, a)| b - a);
    x.dedup_by(|b, a| *b - *a <= 1e-9 * span);
    if x.len() < 2 {
        return Hidden::default();
    }
    let mut gaps: Vec<f64> = x.windows(2).map(|w| w[1] - w[0]).collect();
    let middle = gaps.len() / 2;
    let spacing = *gaps.select_nth_unstable_by(middle, f64::total_cmp).1;
    let mut found = Hidden { spacing, ..Hidden::default() };
    let window = SpectralWindow::new(&x);
    for &pitch in pitches.iter().filter(|p| **p > 0.0) {
        let (c, s) = x.iter().fold((0.0, 0.0), |(c, s), x| {
            let (sin, cos) = (core::f64::consts::TAU * (x / pitch).fract()).sin_cos();
            (c + cos, s + sin)
        });
        // over less than one pitch the targets are near each other, which is another matter
        if f64::hypot(c, s) / x.len() as f64 > SAME_ANGLE && span >= pitch * (1.0 - 1e-9) {
            found.constant.push(pitch);
        } else if spacing >= 0.5 * pitch * (1.0 - 1e-9) && window.is_aliased(pitch) {
            found.slower.push(pitch);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn multiples_coarse_and_fine_targets() {
        let every = |step: f64| (0..21).map(|i| f64::from(i) * step + 3.3).collect::<Vec<_>>();
        let at_20 = hidden(&every(20.0), &COMMON_PITCHES);
        assert_eq!(at_20.constant, [5.0, 10.0, 20.0]);
        assert_eq!(at_20.slower, [6.0, 8.0, 12.0, 16.0]);
        assert_eq!(at_20.spacing, 20.0);
        let at_3 = hidden(&every(3.0), &COMMON_PITCHES);
        assert_eq!((at_3.constant, at_3.slower), (vec![], vec![5.0, 6.0]));
        let at_2 = hidden(&every(2.0), &COMMON_PITCHES);
        assert_eq!((at_2.constant, at_2.slower), (vec![], vec![]));
        // repeats do not make targets closer
        assert_eq!(hidden(&[every(20.0), every(20.0)].concat(), &[10.0]).constant, [10.0]);
        assert_eq!(hidden(&[1.0], &COMMON_PITCHES), Hidden::default());
    }

    #[test]
    fn uneven_targets_are_coarse_but_not_blind() {
        let targets = |pitch: f64| -> Vec<f64> {
            (0..21).map(|i| f64::from(i) * 20.0 + pitch * f64::from(i * i * 7919 % 1009) / 1009.0).collect()
        };
        let found = hidden(&targets(10.0), &COMMON_PITCHES);
        assert_eq!((found.constant, found.slower), (vec![], vec![20.0]));
        // over a small part of the pitch they are equal
        assert_eq!(hidden(&targets(0.5), &[10.0]).constant, [10.0]);
        assert_eq!(hidden(&targets(2.0), &[10.0]).slower, [10.0]);
    }
}
