//! Seeded chance of this generator.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;

/// Chance with a seed and a purpose; equal ones draw equal numbers.
#[derive(Debug, Clone)]
pub struct Chance {
    source: ChaCha12Rng,
    spare: Option<f64>,
}

impl Chance {
    /// Chance for a purpose.
    #[must_use]
    pub fn new(seed: u64, purpose: &str) -> Self {
        // a polynomial hash of the purpose: every part has a stream of its own
        let stream =
            purpose.bytes().fold(17_u64, |h, b| h.wrapping_mul(1_000_003).wrapping_add(u64::from(b)));
        let mut source = ChaCha12Rng::seed_from_u64(seed);
        source.set_stream(stream);
        Self { source, spare: None }
    }

    /// Even between 0 and 1.
    pub fn unit(&mut self) -> f64 {
        self.source.random::<f64>()
    }

    /// Even between two limits.
    pub fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Even in the logarithm between two limits.
    pub fn around(&mut self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.unit())
    }

    /// One of some.
    pub fn pick(&mut self, of: &[f64]) -> f64 {
        let at = (self.unit() * of.len() as f64) as usize;
        of.get(at.min(of.len().saturating_sub(1))).copied().unwrap_or_default()
    }

    /// +1 or -1.
    pub fn either(&mut self) -> f64 {
        if self.unit() < 0.5 { -1.0 } else { 1.0 }
    }

    /// An angle, rad.
    pub fn angle(&mut self) -> f64 {
        self.within(0.0, TAU)
    }

    /// Normal, mean 0, standard deviation 1 (Box and Muller).
    pub fn normal(&mut self) -> f64 {
        if let Some(v) = self.spare.take() {
            return v;
        }
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        let (sin, cos) = self.angle().sin_cos();
        self.spare = Some(radius * sin);
        radius * cos
    }

    /// Student's t with four degrees of freedom over its standard deviation.
    pub fn heavy(&mut self) -> f64 {
        let square: f64 = (0..4).map(|_| self.normal().powi(2)).sum();
        self.normal() / (square / 4.0).sqrt() / 2f64.sqrt()
    }

    /// Three normal numbers.
    pub fn normals(&mut self) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal())
    }

    /// A direction, even over the sphere.
    pub fn direction(&mut self) -> Vector3<f64> {
        let v = self.normals();
        v / v.norm().max(1e-9)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_the_moments_that_they_should() {
        let mut chance = Chance::new(5, "moments");
        for of in [Chance::normal, Chance::heavy] {
            let all: Vec<f64> = (0..40_000).map(|_| of(&mut chance)).collect();
            let mean = all.iter().sum::<f64>() / 4e4;
            let square = all.iter().map(|v| v * v).sum::<f64>() / 4e4;
            assert!(mean.abs() < 0.03 && (square - 1.0).abs() < 0.15, "{mean} {square}");
        }
        assert_ne!(Chance::new(5, "a").unit().to_bits(), Chance::new(5, "b").unit().to_bits());
    }
}
