//! Chebyshev polynomials.

use super::{CurveError, MAX_TERMS, all_finite, positive};

/// `SUM_k c_k T_k(s)`, `s` in `[-1, 1]` over the range.
///
/// # Source  `docs/reference/model-files.md`; equations 5.9 (B2).
#[derive(Debug, Clone, PartialEq)]
pub struct Chebyshev {
    low: f64,
    high: f64,
    coefficients: Vec<f64>,
}

impl Chebyshev {
    /// A polynomial over `[low, high]`; no coefficients means zero.
    ///
    /// # Errors
    /// An empty range, a number not finite, more than [`MAX_TERMS`] coefficients.
    pub fn new(low: f64, high: f64, coefficients: Vec<f64>) -> Result<Self, CurveError> {
        all_finite(&[low, high])?;
        positive("range", high - low)?;
        all_finite(&coefficients)?;
        if coefficients.len() > MAX_TERMS {
            return Err(CurveError::TooManyTerms { found: coefficients.len(), limit: MAX_TERMS });
        }
        Ok(Self { low, high, coefficients })
    }

    /// The value at `x` (Clenshaw); beyond the range the end value is held.
    #[must_use]
    pub fn value(&self, x: f64) -> f64 {
        let s = (2.0 * x.clamp(self.low, self.high) - self.low - self.high) / (self.high - self.low);
        let (mut b1, mut b2) = (0.0, 0.0);
        for c in self.coefficients.iter().skip(1).rev() {
            (b1, b2) = (c + 2.0 * s * b1 - b2, b1);
        }
        self.coefficients.first().map_or(0.0, |c0| c0 + s * b1 - b2)
    }

    /// Start and end.
    #[must_use]
    pub const fn range(&self) -> [f64; 2] {
        [self.low, self.high]
    }

    /// The coefficients of `T_0`, `T_1`, ..
    #[must_use]
    pub fn coefficients(&self) -> &[f64] {
        &self.coefficients
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matches_cos_k_arccos() {
        let c = Chebyshev::new(0.0, 400.0, vec![0.1, 2.0, -0.4, 0.03]).unwrap();
        for x in [0.0, 17.0, 200.0, 399.0, 400.0] {
            let t = (x / 200.0 - 1.0f64).acos();
            let direct = 0.1 + 2.0 * t.cos() - 0.4 * (2.0 * t).cos() + 0.03 * (3.0 * t).cos();
            assert!((c.value(x) - direct).abs() < 1e-14);
        }
        assert_eq!(c.value(-1.0), c.value(0.0));
        assert_eq!(c.value(1e6), c.value(400.0));
    }

    #[test]
    fn no_coefficients_is_zero() {
        assert_eq!(Chebyshev::new(0.0, 1.0, vec![]).unwrap().value(0.3), 0.0);
    }
}
