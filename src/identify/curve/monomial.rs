//! Polynomials as others write them, `SUM b_k x^k`, with the standard deviations of their coefficients.
//!
//! Powers of x in mm have condition numbers beyond 1e15 (equations 5.9), so the fit is made in Chebyshev
//! polynomials over the range of the data, and only the result is written in powers, in double-double arithmetic.
//! Residuals in the same arithmetic then take the rounding of the first solution out.

use nalgebra::{DMatrix, DVector};

use super::basis::chebyshev;

/// Steps of refinement.
const REFINEMENTS: usize = 4;

/// A polynomial fit in powers of x.
#[derive(Debug, Clone, PartialEq)]
pub struct PolynomialFit {
    /// Coefficients of `x^0` (`x^1` without intercept) and up.
    pub coefficients: Vec<f64>,
    /// Their standard deviations; `None` without degrees of freedom.
    pub std: Option<Vec<f64>>,
    /// Residuals.
    pub residuals: Vec<f64>,
    /// Sum of their squares.
    pub sse: f64,
    /// Residual standard deviation; `None` without degrees of freedom.
    pub sigma: Option<f64>,
}

/// Why there is no polynomial.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PolynomialError {
    /// Points and values must pair up and be numbers.
    #[error("point {row} has no finite x and y")]
    NotFinite {
        /// 1-based row.
        row: usize,
    },
    /// The points do not carry that many terms.
    #[error("{positions} distinct positions cannot determine {terms} coefficients; take a lower order")]
    TooFewPositions {
        /// Distinct x.
        positions: usize,
        /// Coefficients asked for.
        terms: usize,
    },
}

/// Least squares of `SUM b_k x^k`, `k = 0` (1 without `intercept`) to `order`.
///
/// # Errors
/// Numbers that are not finite, fewer distinct positions than coefficients.
pub fn polynomial(
    x: &[f64],
    y: &[f64],
    order: usize,
    intercept: bool,
) -> Result<PolynomialFit, PolynomialError> {
    let n = x.len().min(y.len());
    if let Some(i) = (0..x.len().max(y.len())).find(|&i| i >= n || !(x[i].is_finite() && y[i].is_finite())) {
        return Err(PolynomialError::NotFinite { row: i + 1 });
    }
    let terms = order + usize::from(intercept);
    let mut distinct = x.to_vec();
    distinct.sort_by(f64::total_cmp);
    distinct.dedup();
    // a line through the origin says nothing at the origin
    let positions = distinct.iter().filter(|v| intercept || **v != 0.0).count();
    if terms == 0 || positions < terms {
        return Err(PolynomialError::TooFewPositions { positions, terms });
    }
    let (low, high) = (distinct[0], distinct[distinct.len() - 1]);
    let middle = 0.5 * (low + high);
    let half = if high > low { 0.5 * (high - low) } else { 1.0 };
    let mut design = DMatrix::zeros(n, terms);
    let mut row = vec![0.0; terms];
    for (i, x) in x.iter().enumerate() {
        chebyshev((x - middle) / half, &mut row);
        let factor = if intercept { 1.0 } else { *x };
        row.iter().enumerate().for_each(|(j, v)| design[(i, j)] = v * factor);
    }
    let too_few = PolynomialError::TooFewPositions { positions, terms };
    let (q, r) = design.qr().unpack();
    let convert = powers(terms, middle, half);
    let mut coefficients = vec![Double::ZERO; terms];
    let mut residuals = DVector::from_column_slice(y);
    for _ in 0..=REFINEMENTS {
        let step = r.solve_upper_triangular(&q.tr_mul(&residuals)).ok_or(too_few)?;
        for (k, b) in coefficients.iter_mut().enumerate() {
            *b = (k..terms).fold(*b, |sum, j| sum + convert[j][k] * Double::from(step[j]));
        }
        for (i, residual) in residuals.iter_mut().enumerate() {
            let value = horner(&coefficients, x[i], intercept);
            *residual = (Double::from(y[i]) + value * Double::from(-1.0)).high;
        }
    }
    let sse = residuals.norm_squared();
    let sigma = (n > terms).then(|| (sse / (n - terms) as f64).sqrt());
    let inverse = r.solve_upper_triangular(&DMatrix::identity(terms, terms)).ok_or(too_few)?;
    let matrix = DMatrix::from_fn(terms, terms, |k, j| convert[j][k].high);
    let std = sigma.map(|s| (matrix * inverse).row_iter().map(|row| s * row.norm()).collect());
    Ok(PolynomialFit {
        coefficients: coefficients.iter().map(|b| b.high).collect(),
        std,
        residuals: residuals.iter().copied().collect(),
        sse,
        sigma,
    })
}

fn horner(b: &[Double], x: f64, intercept: bool) -> Double {
    let x = Double::from(x);
    let sum = b.iter().rev().fold(Double::ZERO, |sum, b| sum * x + *b);
    if intercept { sum } else { sum * x }
}

/// `T_j((x - middle)/half)` in powers of x: row j holds its coefficients.
fn powers(terms: usize, middle: f64, half: f64) -> Vec<Vec<Double>> {
    let zero = || vec![Double::ZERO; terms];
    let inverse = Double::from(1.0) / Double::from(half);
    let shift = Double::from(middle) * inverse * Double::from(-1.0);
    let mut rows: Vec<Vec<Double>> = Vec::with_capacity(terms);
    for j in 0..terms {
        let mut row = zero();
        if j == 0 {
            row[0] = Double::from(1.0);
        } else {
            // s T_(j-1), twice of it minus T_(j-2) from the second on
            let times = if j == 1 { 1.0 } else { 2.0 };
            for k in 0..j {
                let value = rows[j - 1][k] * Double::from(times);
                row[k] = row[k] + value * shift;
                row[k + 1] = row[k + 1] + value * inverse;
            }
            if j > 1 {
                for k in 0..j - 1 {
                    row[k] = row[k] + rows[j - 2][k] * Double::from(-1.0);
                }
            }
        }
        rows.push(row);
    }
    rows
}

/// A number of about 32 digits: the unevaluated sum of two.
///
/// # Source  Dekker 1971, Knuth 1969 (error-free transformations)
#[derive(Debug, Clone, Copy)]
struct Double {
    high: f64,
    low: f64,
}

impl Double {
    const ZERO: Self = Self { high: 0.0, low: 0.0 };

    const fn from(high: f64) -> Self {
        Self { high, low: 0.0 }
    }

    fn sum(a: f64, b: f64) -> Self {
        let high = a + b;
        let part = high - a;
        Self { high, low: (a - (high - part)) + (b - part) }
    }
}

impl core::ops::Add for Double {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        let s = Self::sum(self.high, other.high);
        let t = Self::sum(self.low, other.low);
        let s = Self::sum(s.high, s.low + t.high);
        Self::sum(s.high, s.low + t.low)
    }
}

impl core::ops::Mul for Double {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        let high = self.high * other.high;
        let low = self.high.mul_add(other.high, -high) + self.high * other.low + self.low * other.high;
        Self::sum(high, low)
    }
}

impl core::ops::Div for Double {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        let first = self.high / other.high;
        let rest = self + other * Self::from(-first);
        let second = rest.high / other.high;
        let rest = rest + other * Self::from(-second);
        Self::sum(first, second) + Self::from(rest.high / other.high)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_powers_come_back() {
        let b = [3.0, -0.25, 0.5, 0.125];
        let x: Vec<f64> = (0..12).map(|i| 100.0 + f64::from(i)).collect();
        let y: Vec<f64> = x.iter().map(|x| b[0] + x * (b[1] + x * (b[2] + x * b[3]))).collect();
        let fit = polynomial(&x, &y, 3, true).unwrap();
        for (got, want) in fit.coefficients.iter().zip(&b) {
            assert!((got / want - 1.0).abs() < 1e-9, "{got} {want}");
        }
        let origin = polynomial(&x, &x, 1, false).unwrap();
        assert_eq!(origin.coefficients, [1.0]);
        assert_eq!(origin.sse, 0.0);
    }

    #[test]
    fn a_third_is_a_third_to_thirty_digits() {
        let third = Double::from(1.0) / Double::from(3.0);
        let back = third * Double::from(3.0) + Double::from(-1.0);
        assert!(back.high.abs() < 1e-31);
    }

    #[test]
    fn too_few_points_are_refused() {
        assert_eq!(
            polynomial(&[1.0, 1.0, 2.0], &[0.0; 3], 2, true),
            Err(PolynomialError::TooFewPositions { positions: 2, terms: 3 })
        );
        assert_eq!(
            polynomial(&[0.0, 0.0], &[0.0; 2], 1, false),
            Err(PolynomialError::TooFewPositions { positions: 0, terms: 1 })
        );
        assert_eq!(
            polynomial(&[1.0, f64::NAN], &[0.0; 2], 1, true),
            Err(PolynomialError::NotFinite { row: 2 })
        );
        assert_eq!(polynomial(&[1.0], &[0.0; 2], 0, true), Err(PolynomialError::NotFinite { row: 2 }));
    }
}
