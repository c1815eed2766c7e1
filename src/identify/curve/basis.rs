//! The columns of the design matrix, and coefficients back to curves.

use core::f64::consts::PI;

use super::error::FitError;
use super::request::Basis;
use volcomp_model::Curve;
use volcomp_model::curve::{Chebyshev, Fourier, HalfRange};

/// One member of a family: everything but the coefficients.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shape {
    pub(super) basis: Basis,
    pub(super) order: usize,
    pub(super) range: [f64; 2],
    /// Periods of a Fourier series, each with `order` harmonics; empty otherwise.
    pub(super) periods: Vec<f64>,
    /// Linear part of a Fourier series; unused otherwise.
    pub(super) linear: bool,
}

impl Shape {
    /// Number of coefficients.
    pub(super) fn len(&self) -> usize {
        match self.basis {
            Basis::HalfRange => 2 + self.order,
            Basis::Chebyshev => 1 + self.order,
            Basis::Fourier => self.low() + 2 * self.order * self.periods.len(),
            Basis::Table => 0,
        }
    }

    /// Columns of a Fourier series before its harmonics.
    const fn low(&self) -> usize {
        1 + self.linear as usize
    }

    /// The order of each coefficient: 0 for mean and linear part.
    pub(super) fn orders(&self) -> Vec<usize> {
        (0..self.len())
            .map(|i| match self.basis {
                Basis::HalfRange => (i + 1).saturating_sub(2),
                // the straight line carries no wave
                Basis::Chebyshev | Basis::Table => i.saturating_sub(1),
                Basis::Fourier if i < self.low() => 0,
                Basis::Fourier => (i - self.low()) % (2 * self.order) / 2 + 1,
            })
            .collect()
    }

    fn share(&self, x: f64) -> f64 {
        (x - self.range[0]) / (self.range[1] - self.range[0])
    }

    /// The columns at `x`.
    #[inline]
    pub(super) fn row(&self, x: f64, row: &mut [f64]) {
        let s = 2.0 * self.share(x) - 1.0;
        match self.basis {
            Basis::HalfRange => {
                row[0] = 1.0;
                row[1] = s;
                waves(PI * self.share(x), &mut row[2..], 1);
            }
            Basis::Chebyshev => chebyshev(s, row),
            Basis::Fourier => {
                row[0] = 1.0;
                if self.linear {
                    row[1] = s;
                }
                let waves_of = 2 * self.order;
                for (period, row) in self.periods.iter().zip(row[self.low()..].chunks_exact_mut(waves_of)) {
                    waves(2.0 * PI * (x - self.range[0]) / period, row, 2);
                }
            }
            Basis::Table => {}
        }
    }

    /// Derivative of the curve with coefficients `c` by its period number `which`.
    pub(super) fn by_period(&self, x: f64, c: &[f64], which: usize) -> f64 {
        let period = self.periods[which];
        let phase = 2.0 * PI * (x - self.range[0]) / period;
        let first = self.low() + 2 * self.order * which;
        c[first..first + 2 * self.order]
            .chunks_exact(2)
            .enumerate()
            .map(|(n, pair)| {
                let n = (n + 1) as f64;
                let (sin, cos) = (n * phase).sin_cos();
                // the phase falls as the period grows
                n * phase / period * (pair[0] * sin - pair[1] * cos)
            })
            .sum()
    }

    /// The curves of these coefficients, to add up: one, or one per period.
    pub(super) fn curves(&self, c: &[f64]) -> Result<Vec<Curve>, FitError> {
        let [low, high] = self.range;
        Ok(match self.basis {
            Basis::HalfRange => vec![Curve::HalfRange(HalfRange::new(low, high, c[0], c[1], &c[2..])?)],
            Basis::Chebyshev | Basis::Table => vec![Curve::Chebyshev(Chebyshev::new(low, high, c.to_vec())?)],
            Basis::Fourier => {
                let linear = if self.linear { c[1] } else { 0.0 };
                let waves_of = 2 * self.order;
                let mut curves = Vec::with_capacity(self.periods.len());
                for (period, pairs) in self.periods.iter().zip(c[self.low()..].chunks_exact(waves_of)) {
                    let cos: Vec<f64> = pairs.iter().copied().step_by(2).collect();
                    let sin: Vec<f64> = pairs.iter().copied().skip(1).step_by(2).collect();
                    // mean and linear part belong to the first
                    let (mean, linear) = if curves.is_empty() { (c[0], linear) } else { (0.0, 0.0) };
                    curves.push(Curve::Fourier(Fourier::new(
                        low,
                        high - low,
                        *period,
                        mean,
                        linear,
                        &cos,
                        &sin,
                    )?));
                }
                curves
            }
        })
    }
}

/// `T_0(s)`, `T_1(s)`, ..
#[inline]
pub(super) fn chebyshev(s: f64, row: &mut [f64]) {
    let (mut a, mut b) = (1.0, s);
    for value in row {
        *value = a;
        (a, b) = (b, 2.0 * s * b - a);
    }
}

/// Harmonics of `phase` by angle addition: sines (`stride` 1), or cosine and sine of each (`stride` 2).
#[inline]
fn waves(phase: f64, row: &mut [f64], stride: usize) {
    /// Harmonics after which the recurrence starts afresh, so that rounding stays at its first level.
    const FRESH: usize = 8;
    let (s1, c1) = phase.sin_cos();
    let (mut s, mut c) = (s1, c1);
    for (n, pair) in row.chunks_exact_mut(stride).enumerate() {
        if n > 0 {
            (s, c) = if n % FRESH == 0 {
                ((n + 1) as f64 * phase).sin_cos()
            } else {
                (s * c1 + c * s1, c * c1 - s * s1)
            };
        }
        pair[stride - 1] = s;
        if stride == 2 {
            pair[0] = c;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_units::axes::Travel;

    fn shape(basis: Basis, order: usize, linear: bool) -> Shape {
        Shape { basis, order, range: [-30.0, 270.0], periods: vec![111.0, 37.0], linear }
    }

    #[test]
    fn the_design_row_and_the_curve_of_the_model_are_the_same_function() {
        for basis in [Basis::HalfRange, Basis::Chebyshev, Basis::Fourier] {
            for linear in [false, true] {
                let shape = shape(basis, 20, linear);
                let c: Vec<f64> = (0..shape.len()).map(|i| 1e-3 * (i as f64 * 1.7).cos()).collect();
                let curves = shape.curves(&c).unwrap();
                assert_eq!(curves.len(), if basis == Basis::Fourier { 2 } else { 1 });
                let mut row = vec![0.0; shape.len()];
                for x in [-30.0, 0.0, 77.7, 269.0, 270.0] {
                    shape.row(x, &mut row);
                    let direct: f64 = row.iter().zip(&c).map(|(a, b)| a * b).sum();
                    let value: f64 = curves.iter().map(|c| c.value(x, Travel::Forward)).sum();
                    assert!((value - direct).abs() < 1e-15, "{basis:?} {x}");
                }
            }
        }
    }

    #[test]
    fn the_derivative_by_the_period_is_one() {
        let shape = shape(Basis::Fourier, 3, true);
        let c: Vec<f64> = (0..shape.len()).map(|i| (i as f64 * 1.7).cos()).collect();
        let value = |which: usize, change: f64, x: f64| {
            let mut moved = shape.clone();
            moved.periods[which] += change;
            let mut row = vec![0.0; moved.len()];
            moved.row(x, &mut row);
            row.iter().zip(&c).map(|(a, b)| a * b).sum::<f64>()
        };
        for x in [-30.0, 12.0, 180.0] {
            for which in 0..2 {
                let difference = (value(which, 1e-4, x) - value(which, -1e-4, x)) / 2e-4;
                assert!((shape.by_period(x, &c, which) - difference).abs() < 1e-7, "{x} {which}");
            }
        }
    }

    #[test]
    fn orders_of_the_coefficients() {
        let of = |basis, linear| Shape { periods: vec![1.0], ..shape(basis, 2, linear) }.orders();
        assert_eq!(of(Basis::HalfRange, false), [0, 0, 1, 2]);
        assert_eq!(of(Basis::Chebyshev, false), [0, 0, 1]);
        assert_eq!(of(Basis::Fourier, true), [0, 0, 1, 1, 2, 2]);
        assert_eq!(of(Basis::Fourier, false), [0, 1, 1, 2, 2]);
        assert_eq!(shape(Basis::Fourier, 1, false).orders(), [0, 1, 1, 1, 1]);
    }
}
