//! Seeded chance, and smooth curves and fields drawn from it.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal, StudentT};

/// Chance with a seed; the same seed and salt give the same draws.
#[derive(Debug, Clone)]
pub struct Dice(ChaCha8Rng);

impl Dice {
    /// Chance of a seed, apart from that of another salt.
    #[must_use]
    pub fn new(seed: u64, salt: &str) -> Self {
        // FNV-1a, so that every part of the twin has chance of its own
        let hash = salt
            .bytes()
            .fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3));
        Self(ChaCha8Rng::seed_from_u64(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ hash))
    }

    /// Normal with mean 0 and standard deviation 1.
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    /// Student's t with four degrees of freedom, scaled to standard deviation 1: outliers without being any.
    pub fn heavy(&mut self) -> f64 {
        StudentT::new(4.0).map_or(0.0, |t| t.sample(&mut self.0)) / std::f64::consts::SQRT_2
    }

    /// Even between two limits.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }

    /// +1 or -1.
    pub fn sign(&mut self) -> f64 {
        if self.0.random::<bool>() { 1.0 } else { -1.0 }
    }

    /// A whole number below `n`.
    pub fn below(&mut self, n: usize) -> usize {
        ((self.0.random::<f64>() * n as f64) as usize).min(n.saturating_sub(1))
    }

    /// One of some values.
    pub fn one_of(&mut self, values: &[f64]) -> f64 {
        values.get(self.below(values.len())).copied().unwrap_or_default()
    }
}

/// A curve over the travel of an axis, as a table of equal steps.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    low: f64,
    step: f64,
    values: Vec<f64>,
}

impl Table {
    /// The integral, from `zero` on, of a rate that forgets itself over `length`: how the errors of a screw's thread, the
    /// twist or the bend of a guideway add up while it is ground.
    #[must_use]
    pub fn integrated(dice: &mut Dice, [low, high]: [f64; 2], zero: f64, length: f64, times: usize) -> Self {
        let step = 2.0;
        let margin = 20.0;
        let low = low - margin;
        let n = ((high + margin - low) / step).ceil() as usize + 1;
        let keep = (-step / length).exp();
        let mut rate = dice.normal();
        let mut values: Vec<f64> = (0..n)
            .map(|_| {
                rate = keep * rate + (1.0 - keep * keep).sqrt() * dice.normal();
                rate
            })
            .collect();
        for _ in 0..times {
            let mut sum = 0.0;
            for v in &mut values {
                sum += *v * step;
                *v = sum;
            }
        }
        let mut table = Self { low, step, values };
        let at_zero = table.at(zero);
        table.values.iter_mut().for_each(|v| *v -= at_zero);
        table
    }

    /// A function as a table.
    #[must_use]
    pub fn of(low: f64, high: f64, f: impl Fn(f64) -> f64) -> Self {
        let step = 2.0;
        let n = ((high - low) / step).ceil() as usize + 1;
        Self { low, step, values: (0..n).map(|k| f(low + step * k as f64)).collect() }
    }

    /// All values times a factor.
    #[must_use]
    pub fn times(mut self, factor: f64) -> Self {
        self.values.iter_mut().for_each(|v| *v *= factor);
        self
    }

    /// Without the line through its two ends.
    #[must_use]
    pub fn without_line(mut self, [low, high]: [f64; 2]) -> Self {
        let (a, b) = (self.at(low), self.at(high));
        let (first, step) = (self.low, self.step);
        for (i, v) in self.values.iter_mut().enumerate() {
            let x = first + step * i as f64;
            *v -= a + (b - a) * (x - low) / (high - low);
        }
        self
    }

    /// Scaled so that its standard deviation over the travel is `rms`.
    #[must_use]
    pub fn scaled(mut self, [low, high]: [f64; 2], rms: f64) -> Self {
        let all: Vec<f64> = (0..200).map(|k| self.at(low + (high - low) * f64::from(k) / 199.0)).collect();
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        let own = (all.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / all.len() as f64).sqrt();
        let factor = rms / own.max(1e-300);
        self.values.iter_mut().for_each(|v| *v *= factor);
        self
    }

    /// The value at `x`, linear between the steps, held beyond the ends.
    #[must_use]
    pub fn at(&self, x: f64) -> f64 {
        let last = self.values.len().saturating_sub(1);
        let place = ((x - self.low) / self.step).clamp(0.0, last as f64);
        let i = (place as usize).min(last.saturating_sub(1));
        let (a, b) = (self.values.get(i), self.values.get(i + 1));
        let (a, b) = (a.copied().unwrap_or_default(), b.copied().unwrap_or_default());
        a + (b - a) * (place - i as f64)
    }
}

/// A smooth field over the working volume of RMS 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    waves: [([f64; 3], f64); 4],
}

impl Field {
    /// A field whose waves are about `length` long, mm.
    #[must_use]
    pub fn new(dice: &mut Dice, length: f64) -> Self {
        Self {
            waves: std::array::from_fn(|_| {
                let direction: [f64; 3] = std::array::from_fn(|_| dice.normal());
                let norm = direction.iter().map(|v| v * v).sum::<f64>().sqrt().max(1e-9);
                let k = std::f64::consts::TAU / (length * dice.between(0.8, 1.3));
                (direction.map(|v| k * v / norm), dice.between(0.0, std::f64::consts::TAU))
            }),
        }
    }

    /// The value at a point, mm.
    #[must_use]
    pub fn at(&self, p: [f64; 3]) -> f64 {
        let sum: f64 =
            self.waves.iter().map(|(k, phase)| (k[0] * p[0] + k[1] * p[1] + k[2] * p[2] + phase).sin()).sum();
        sum / std::f64::consts::SQRT_2
    }
}
