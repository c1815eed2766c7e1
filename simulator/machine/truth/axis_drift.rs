//! Linear axes that are no longer as they were surveyed: error motions that depend on the position and grow with time.
//!
//! A guideway that warms up bows and twists, a screw grows. Each of the six motions of an axis is a bow, a wave and a mean
//! of seeded sizes over the travel; it approaches its final size exponentially.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use volcomp_units::axes::MAX_AXES;

/// Size and course of the change.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisDriftSize {
    /// Final RMS of the straightnesses, mm, and of the angles, rad.
    pub rms: [f64; 2],
    /// Final RMS of the positioning, mm.
    pub positioning_mm: f64,
    /// Time at which the change begins, s.
    pub start_s: f64,
    /// Its time constant, s; 0 is a step.
    pub time_constant_s: f64,
}

/// Bow, wave, phase of the wave, mean; of RMS 1 together about.
type Shape = [f64; 4];

/// The change of all axes.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisDrift {
    size: AxisDriftSize,
    shapes: [[Shape; 6]; MAX_AXES],
}

impl AxisDrift {
    /// A drift; the same seed is the same drift.
    #[must_use]
    pub fn new(size: AxisDriftSize, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0xA1_5D);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let mut shape = || [1.4 * normal(), 0.5 * normal(), 3.0 * normal(), 0.3 * normal()];
        Self { size, shapes: std::array::from_fn(|_| std::array::from_fn(|_| shape())) }
    }

    /// What is added to EX EY EZ (mm) EA EB EC (rad) of axis `k`, whose direction is `along` (0, 1, 2), at share `s` of its
    /// travel (0 to 1) and at time `t_s`.
    #[must_use]
    pub fn motion(&self, k: usize, along: usize, s: f64, t_s: f64) -> [f64; 6] {
        let since = t_s - self.size.start_s;
        if since < 0.0 {
            return [0.0; 6];
        }
        let tau = self.size.time_constant_s;
        let share = if tau > 0.0 { 1.0 - (-since / tau).exp() } else { 1.0 };
        let shapes = self.shapes.get(k).copied().unwrap_or_default();
        std::array::from_fn(|c| {
            let [bow, wave, phase, mean] = shapes[c];
            let size = match c {
                c if c == along => self.size.positioning_mm,
                0..=2 => self.size.rms[0],
                _ => self.size.rms[1],
            };
            let centred = 4.0 * s * (1.0 - s) - 2.0 / 3.0;
            share * size * (bow * centred + wave * (std::f64::consts::TAU * s + phase).sin() + mean)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_begins_when_it_is_told_to_and_approaches_its_size() {
        let size =
            AxisDriftSize { rms: [0.01, 2e-5], positioning_mm: 0.0, start_s: 5.0, time_constant_s: 2.0 };
        let drift = AxisDrift::new(size, 3);
        assert_eq!(drift.motion(1, 1, 0.3, 4.9), [0.0; 6]);
        let (early, late) = (drift.motion(1, 1, 0.3, 7.0), drift.motion(1, 1, 0.3, 1e3));
        for c in [0, 2, 3, 4, 5] {
            assert!((early[c] / late[c] - (1.0 - (-1f64).exp())).abs() < 1e-9);
        }
        assert_eq!(late[1], 0.0);
        let squares: f64 = (0..200)
            .flat_map(|seed| (0..=10).map(move |i| (seed, f64::from(i) / 10.0)))
            .map(|(seed, s)| AxisDrift::new(size, seed).motion(0, 0, s, 1e3)[1].powi(2))
            .sum();
        assert!(((squares / 2200.0).sqrt() / 0.01 - 0.75).abs() < 0.3, "{}", (squares / 2200.0).sqrt());
    }
}
