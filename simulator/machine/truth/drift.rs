//! A ram that is no longer as it was surveyed: six motions that depend on where it is and change with time.
//!
//! Each motion is a mean and a few long waves through the working volume, of seeded amplitude, direction and phase: a
//! part that was there from the beginning, a part that grows with time, as a ram does that warms up, and a part that
//! comes and goes, as with doors, coolant and loads.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Waves of one motion.
const WAVES: usize = 3;

/// One motion as a function of position, of RMS 1 about.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Field {
    mean: f64,
    /// Wave vector (rad per mm), phase, amplitude.
    waves: [([f64; 3], f64, f64); WAVES],
}

/// How large a drift is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriftSize {
    /// Difference from the survey at the beginning: mm, rad.
    pub from_survey: [f64; 2],
    /// What is added in an hour: mm, rad.
    pub per_h: [f64; 2],
    /// Amplitude of what comes and goes: mm, rad.
    pub swing: [f64; 2],
    /// Its period, s.
    pub swing_s: f64,
    /// Shortest wave, mm.
    pub wave_mm: f64,
}

impl Default for DriftSize {
    /// Nothing drifts.
    fn default() -> Self {
        Self { from_survey: [0.0; 2], per_h: [0.0; 2], swing: [0.0; 2], swing_s: 600.0, wave_mm: 4000.0 }
    }
}

/// EX EY EZ (mm) and EA EB EC (rad) of the ram over position and time.
#[derive(Debug, Clone, PartialEq)]
pub struct RamDrift {
    size: DriftSize,
    fields: [[Field; 6]; 3],
}

impl RamDrift {
    /// A drift; the same seed is the same drift.
    #[must_use]
    pub fn new(size: DriftSize, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let mut field = || Field {
            mean: 0.7 * normal(),
            waves: std::array::from_fn(|_| {
                let direction: [f64; 3] = std::array::from_fn(|_| normal());
                let length = direction.iter().map(|v| v * v).sum::<f64>().sqrt().max(1e-9);
                let k = std::f64::consts::TAU / (size.wave_mm * (1.0 + normal().abs()));
                (direction.map(|v| k * v / length), 3.0 * normal(), normal() / f64::from(WAVES as u32).sqrt())
            }),
        };
        let fields = std::array::from_fn(|_| std::array::from_fn(|_| field()));
        Self { size, fields }
    }

    /// The six motions with the axes X, Y, Z at `at` (mm), `t_s` after the beginning.
    #[must_use]
    pub fn motion(&self, at: [f64; 3], t_s: f64) -> [f64; 6] {
        std::array::from_fn(|c| {
            let unit = usize::from(c >= 3);
            let [survey, hour] = [self.size.from_survey[unit], self.size.per_h[unit]];
            let value = |f: &Field| {
                let wave = |(k, phase, a): &([f64; 3], f64, f64)| {
                    a * (k.iter().zip(at).map(|(k, x)| k * x).sum::<f64>() + phase).cos()
                };
                f.mean + f.waves.iter().map(wave).sum::<f64>()
            };
            let phase = std::f64::consts::TAU * t_s / self.size.swing_s.max(1e-3);
            survey * value(&self.fields[0][c])
                + hour * t_s / 3600.0 * value(&self.fields[1][c])
                + self.size.swing[unit] * phase.sin() * value(&self.fields[2][c])
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_smooth_seeded_and_grows_with_time() {
        let size = DriftSize { from_survey: [0.002, 2e-6], per_h: [0.02, 2e-5], ..DriftSize::default() };
        let drift = RamDrift::new(size, 7);
        assert_eq!(drift, RamDrift::new(size, 7));
        let rms = |t_s: f64| {
            let seeds = 200;
            let sum: f64 = (0..seeds)
                .map(|s| RamDrift::new(size, s).motion([100.0, 900.0, -300.0], t_s)[4].powi(2))
                .sum();
            (sum / seeds as f64).sqrt()
        };
        assert!((rms(0.0) / 2e-6 - 1.0).abs() < 0.3, "{}", rms(0.0));
        assert!((rms(7200.0) / 4e-5 - 1.0).abs() < 0.3, "{}", rms(7200.0));
        let (a, b) = (drift.motion([100.0, 0.0, 0.0], 3600.0), drift.motion([110.0, 0.0, 0.0], 3600.0));
        assert!((a[3] - b[3]).abs() < 1e-6);
        let swings = RamDrift::new(DriftSize { swing: [0.01, 1e-5], swing_s: 100.0, ..size }, 7);
        let of =
            |t_s: f64| swings.motion([100.0, 0.0, 0.0], t_s)[0] - drift.motion([100.0, 0.0, 0.0], t_s)[0];
        assert!(of(100.0).abs() < 1e-12 && (of(25.0) + of(75.0)).abs() < 1e-12 && of(25.0).abs() > 1e-4);
    }
}
