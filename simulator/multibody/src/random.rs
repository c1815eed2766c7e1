//! Random numbers from a seed and a purpose.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal, StudentT};

/// A stream of random numbers.
#[derive(Debug, Clone)]
pub struct Stream(ChaCha8Rng);

impl Stream {
    /// Stream of a seed for one purpose; other purposes have other numbers.
    pub fn new(seed: u64, purpose: &str) -> Self {
        // FNV-1a
        let hash = purpose
            .bytes()
            .fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3));
        Self(ChaCha8Rng::seed_from_u64(seed ^ hash))
    }

    /// Uniform between two limits.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }

    /// Standard normal.
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    /// Three standard normal numbers.
    pub fn normals(&mut self) -> nalgebra::Vector3<f64> {
        nalgebra::Vector3::from_fn(|_, _| self.normal())
    }

    /// Student's t with four degrees of freedom, scaled to unit variance.
    pub fn heavy(&mut self) -> f64 {
        StudentT::new(4.0).map_or(0.0, |t: StudentT<f64>| t.sample(&mut self.0)) / 2.0_f64.sqrt()
    }
}
