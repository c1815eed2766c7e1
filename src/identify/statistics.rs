//! Probabilities for tests of fits.

use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Probability that a chi-square of `dof` degrees of freedom exceeds `value`; 1 without redundancy.
#[must_use]
pub fn chi2_exceeded(value: f64, dof: usize) -> f64 {
    if dof == 0 || value.is_nan() {
        return 1.0;
    }
    ChiSquared::new(dof as f64).map_or(1.0, |d| d.sf(value.max(0.0)))
}

/// Probability below which a fit test has failed.
pub const SIGNIFICANT: f64 = 1e-3;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_tables() {
        for (value, dof, p) in [(3.841_459, 1, 0.05), (16.266_236, 3, 0.001), (124.342_113, 100, 0.05)] {
            assert!((chi2_exceeded(value, dof) - p).abs() < 1e-7, "{value} {dof}");
        }
        assert_eq!(chi2_exceeded(5.0, 0), 1.0);
        assert_eq!(chi2_exceeded(0.0, 3), 1.0);
        assert!(chi2_exceeded(1e4, 3) < 1e-300);
    }
}
