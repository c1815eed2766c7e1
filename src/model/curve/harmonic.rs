//! Fourier series and half-range sine series.

use core::f64::consts::PI;

use super::{CurveError, MAX_TERMS, all_finite, positive};

/// `mean + linear*s + SUM_n cos_n cos(n w (x-origin)) + sin_n sin(n w (x-origin))`,
/// `w = 2 pi / period`, `s = (2 (x-origin) - span) / span`, for `x` in `[origin, origin + span]`.
///
/// # Source  `docs/reference/model-files.md`; equations 5.9 (B3).
#[derive(Debug, Clone, PartialEq)]
pub struct Fourier {
    origin: f64,
    span: f64,
    period: f64,
    mean: f64,
    linear: f64,
    /// (cos, sin) of harmonic 1, 2, ..
    harmonics: Vec<[f64; 2]>,
}

impl Fourier {
    /// A series from its coefficient lists, of which the shorter is filled with zeros.
    ///
    /// # Errors
    /// Span or period not positive, a number not finite, more than [`MAX_TERMS`] harmonics.
    pub fn new(
        origin: f64,
        span: f64,
        period: f64,
        mean: f64,
        linear: f64,
        cos: &[f64],
        sin: &[f64],
    ) -> Result<Self, CurveError> {
        positive("span", span)?;
        positive("period", period)?;
        all_finite(&[origin, mean, linear])?;
        all_finite(cos)?;
        all_finite(sin)?;
        let order = cos.len().max(sin.len());
        if order > MAX_TERMS {
            return Err(CurveError::TooManyTerms { found: order, limit: MAX_TERMS });
        }
        let at = |list: &[f64], i: usize| list.get(i).copied().unwrap_or(0.0);
        let harmonics = (0..order).map(|i| [at(cos, i), at(sin, i)]).collect();
        Ok(Self { origin, span, period, mean, linear, harmonics })
    }

    /// The value at `x`; beyond the span the end value is held.
    #[must_use]
    pub fn value(&self, x: f64) -> f64 {
        let d = (x - self.origin).clamp(0.0, self.span);
        let s = (2.0 * d - self.span) / self.span;
        self.mean + self.linear * s + harmonic_sum(&self.harmonics, 2.0 * PI / self.period * d)
    }

    /// Start and end of the span.
    #[must_use]
    pub fn range(&self) -> [f64; 2] {
        [self.origin, self.origin + self.span]
    }

    /// The span, exactly as given.
    #[must_use]
    pub const fn span(&self) -> f64 {
        self.span
    }

    /// The period.
    #[must_use]
    pub const fn period(&self) -> f64 {
        self.period
    }

    /// Mean and linear coefficient.
    #[must_use]
    pub const fn mean_and_linear(&self) -> (f64, f64) {
        (self.mean, self.linear)
    }

    /// (cos, sin) of harmonic 1, 2, ..
    #[must_use]
    pub fn harmonics(&self) -> &[[f64; 2]] {
        &self.harmonics
    }
}

/// `mean + linear*s + SUM_k sin_k sin(k pi u)`, `u = (x - x0)/T`, `s = 2u - 1`, over the range `[x0, x0 + T]`.
///
/// # Source  equations 5.9 (B1): the linear part carries the ends, the sines vanish there.
#[derive(Debug, Clone, PartialEq)]
pub struct HalfRange {
    low: f64,
    high: f64,
    mean: f64,
    linear: f64,
    /// (0, sin) of half wave 1, 2, .. in the layout of the shared recurrence.
    harmonics: Vec<[f64; 2]>,
}

impl HalfRange {
    /// A series over `[low, high]`.
    ///
    /// # Errors
    /// An empty range, a number not finite, more than [`MAX_TERMS`] sines.
    pub fn new(low: f64, high: f64, mean: f64, linear: f64, sin: &[f64]) -> Result<Self, CurveError> {
        all_finite(&[low, high, mean, linear])?;
        positive("range", high - low)?;
        all_finite(sin)?;
        if sin.len() > MAX_TERMS {
            return Err(CurveError::TooManyTerms { found: sin.len(), limit: MAX_TERMS });
        }
        Ok(Self { low, high, mean, linear, harmonics: sin.iter().map(|&b| [0.0, b]).collect() })
    }

    /// The value at `x`; beyond the range the end value is held.
    #[must_use]
    pub fn value(&self, x: f64) -> f64 {
        let u = (x.clamp(self.low, self.high) - self.low) / (self.high - self.low);
        self.mean + self.linear * (2.0 * u - 1.0) + harmonic_sum(&self.harmonics, PI * u)
    }

    /// Start and end.
    #[must_use]
    pub const fn range(&self) -> [f64; 2] {
        [self.low, self.high]
    }

    /// Mean, linear coefficient and sine coefficients.
    pub fn coefficients(&self) -> (f64, f64, impl Iterator<Item = f64> + '_) {
        (self.mean, self.linear, self.harmonics.iter().map(|h| h[1]))
    }
}

/// `SUM_n cos_n cos(n phase) + sin_n sin(n phase)` by the angle-addition recurrence: one sine/cosine pair in all.
fn harmonic_sum(harmonics: &[[f64; 2]], phase: f64) -> f64 {
    let (s1, c1) = phase.sin_cos();
    let (mut s, mut c) = (s1, c1);
    let mut sum = 0.0;
    for [a, b] in harmonics {
        sum += a * c + b * s;
        (s, c) = (s * c1 + c * s1, c * c1 - s * s1);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fourier_repeats_after_a_period_and_holds_beyond_the_span() {
        let f = Fourier::new(10.0, 500.0, 100.0, 0.2, 0.0, &[0.3, 0.1], &[0.5, -0.3, 0.7]).unwrap();
        for x in [10.0, 33.3, 250.0, 409.9] {
            assert!((f.value(x) - f.value(x + 100.0)).abs() < 1e-12);
        }
        assert_eq!(f.value(-50.0), f.value(10.0));
        assert_eq!(f.value(1000.0), f.value(510.0));
    }

    #[test]
    fn fourier_matches_its_formula() {
        let f = Fourier::new(0.0, 500.0, 1000.0, 0.2, 1.1, &[], &[0.5, -0.3]).unwrap();
        let x = 123.0;
        let w = 2.0 * PI / 1000.0;
        let direct = 0.2 + 1.1 * (2.0 * x - 500.0) / 500.0 + 0.5 * (w * x).sin() - 0.3 * (2.0 * w * x).sin();
        assert!((f.value(x) - direct).abs() < 1e-14);
    }

    #[test]
    fn the_recurrence_stays_exact_to_the_highest_harmonic() {
        let mut sin = vec![0.0; MAX_TERMS];
        sin[MAX_TERMS - 1] = 1.0;
        let f = Fourier::new(0.0, 1000.0, 200.0, 0.0, 0.0, &[], &sin).unwrap();
        for i in 0..1000 {
            let x = f64::from(i);
            let direct = (MAX_TERMS as f64 * 2.0 * PI / 200.0 * x).sin();
            assert!((f.value(x) - direct).abs() < 1e-11);
        }
    }

    #[test]
    fn half_range_ends_are_carried_by_the_linear_part() {
        let h = HalfRange::new(-100.0, 300.0, 1.0, 2.0, &[5.0, -7.0, 3.0]).unwrap();
        assert!((h.value(-100.0) + 1.0).abs() < 1e-14);
        assert!((h.value(300.0) - 3.0).abs() < 1e-13);
        assert!((h.value(100.0) - (1.0 + 5.0 - 3.0)).abs() < 1e-13);
    }

    #[test]
    fn impossible_series_are_refused() {
        assert!(Fourier::new(0.0, 0.0, 1.0, 0.0, 0.0, &[], &[]).is_err());
        assert!(Fourier::new(0.0, 1.0, -1.0, 0.0, 0.0, &[], &[]).is_err());
        assert!(Fourier::new(0.0, 1.0, f64::NAN, 0.0, 0.0, &[], &[]).is_err());
        assert!(Fourier::new(0.0, 1.0, 1.0, 0.0, 0.0, &[], &[0.0; MAX_TERMS + 1]).is_err());
        assert!(HalfRange::new(1.0, 1.0, 0.0, 0.0, &[]).is_err());
    }
}
