//! Seeded random numbers, the same on every machine: SplitMix64 and the polar method.

use volcomp_model::random::SplitMix64;

/// A generator.
#[derive(Debug, Clone)]
pub struct Random {
    source: SplitMix64,
    spare: Option<f64>,
}

impl Random {
    /// Starts from a seed.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        Self { source: SplitMix64(seed ^ 0x9E37_79B9_7F4A_7C15), spare: None }
    }

    /// Uniform in 0 to 1, without 1.
    pub fn uniform(&mut self) -> f64 {
        (self.source.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A whole number below `n`.
    pub fn below(&mut self, n: usize) -> usize {
        ((self.uniform() * n as f64) as usize).min(n.saturating_sub(1))
    }

    /// Normal with mean 0 and standard deviation 1.
    pub fn normal(&mut self) -> f64 {
        if let Some(v) = self.spare.take() {
            return v;
        }
        loop {
            let (a, b) = (2.0 * self.uniform() - 1.0, 2.0 * self.uniform() - 1.0);
            let s = a * a + b * b;
            if s > 0.0 && s < 1.0 {
                let f = (-2.0 * s.ln() / s).sqrt();
                self.spare = Some(b * f);
                return a * f;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_variance_and_kurtosis_are_normal() {
        let mut r = Random::new(7);
        let values: Vec<f64> = (0..200_000).map(|_| r.normal()).collect();
        let moment = |p: i32| values.iter().map(|v| v.powi(p)).sum::<f64>() / values.len() as f64;
        assert!(moment(1).abs() < 0.01 && (moment(2) - 1.0).abs() < 0.02 && (moment(4) - 3.0).abs() < 0.1);
    }
}
