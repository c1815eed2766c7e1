//! The columns of the design matrix, and coefficients back to a curve.

use core::f64::consts::PI;

use nalgebra::DMatrix;

use super::{Basis, FitError};
use crate::core::model::Curve;
use crate::core::model::curve::{Chebyshev, Fourier, HalfRange};

/// One member of a family: everything but the coefficients.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shape {
    pub(super) basis: Basis,
    pub(super) order: usize,
    pub(super) range: [f64; 2],
    /// Period of a Fourier series; unused otherwise.
    pub(super) period: f64,
    /// Linear part of a Fourier series; unused otherwise.
    pub(super) linear: bool,
}

impl Shape {
    /// Number of coefficients.
    pub(super) fn len(&self) -> usize {
        match self.basis {
            Basis::HalfRange => 2 + self.order,
            Basis::Chebyshev => 1 + self.order,
            Basis::Fourier => 1 + usize::from(self.linear) + 2 * self.order,
            Basis::Table => 0,
        }
    }

    /// The order of each coefficient: 0 for mean and linear part.
    pub(super) fn orders(&self) -> Vec<usize> {
        let low = match self.basis {
            Basis::HalfRange => 2,
            Basis::Chebyshev | Basis::Table => 0,
            Basis::Fourier => 1 + usize::from(self.linear),
        };
        (0..self.len())
            .map(|i| match self.basis {
                Basis::HalfRange => (i + 1).saturating_sub(low),
                // the straight line carries no wave
                Basis::Chebyshev | Basis::Table => i.saturating_sub(1),
                Basis::Fourier => (i + 2).saturating_sub(low) / 2,
            })
            .collect()
    }

    /// The design matrix: one row per position.
    pub(super) fn design(&self, positions: impl ExactSizeIterator<Item = f64>) -> DMatrix<f64> {
        let columns = self.len();
        let mut matrix = DMatrix::zeros(positions.len(), columns);
        let mut row = vec![0.0; columns];
        for (i, x) in positions.enumerate() {
            self.row(x, &mut row);
            for (j, value) in row.iter().enumerate() {
                matrix[(i, j)] = *value;
            }
        }
        matrix
    }

    fn row(&self, x: f64, row: &mut [f64]) {
        let [low, high] = self.range;
        let u = (x - low) / (high - low);
        let s = 2.0 * u - 1.0;
        match self.basis {
            Basis::HalfRange => {
                row[0] = 1.0;
                row[1] = s;
                for (k, value) in row[2..].iter_mut().enumerate() {
                    *value = ((k + 1) as f64 * PI * u).sin();
                }
            }
            Basis::Chebyshev => {
                for k in 0..row.len() {
                    row[k] = match k {
                        0 => 1.0,
                        1 => s,
                        _ => 2.0 * s * row[k - 1] - row[k - 2],
                    };
                }
            }
            Basis::Fourier => {
                row[0] = 1.0;
                let first = if self.linear {
                    row[1] = s;
                    2
                } else {
                    1
                };
                let phase = 2.0 * PI * (x - low) / self.period;
                for (n, pair) in row[first..].chunks_exact_mut(2).enumerate() {
                    let (sin, cos) = ((n + 1) as f64 * phase).sin_cos();
                    pair.copy_from_slice(&[cos, sin]);
                }
            }
            Basis::Table => {}
        }
    }

    /// The curve of these coefficients.
    pub(super) fn curve(&self, c: &[f64]) -> Result<Curve, FitError> {
        let [low, high] = self.range;
        Ok(match self.basis {
            Basis::HalfRange => Curve::HalfRange(HalfRange::new(low, high, c[0], c[1], &c[2..])?),
            Basis::Chebyshev | Basis::Table => Curve::Chebyshev(Chebyshev::new(low, high, c.to_vec())?),
            Basis::Fourier => {
                let (linear, harmonics) = if self.linear { (c[1], &c[2..]) } else { (0.0, &c[1..]) };
                let cos: Vec<f64> = harmonics.iter().copied().step_by(2).collect();
                let sin: Vec<f64> = harmonics.iter().copied().skip(1).step_by(2).collect();
                Curve::Fourier(Fourier::new(low, high - low, self.period, c[0], linear, &cos, &sin)?)
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::core::axes::Travel;

    #[test]
    fn the_design_row_and_the_curve_of_the_model_are_the_same_function() {
        for basis in [Basis::HalfRange, Basis::Chebyshev, Basis::Fourier] {
            for linear in [false, true] {
                let shape = Shape { basis, order: 5, range: [-30.0, 270.0], period: 111.0, linear };
                let c: Vec<f64> = (0..shape.len()).map(|i| 1e-3 * (i as f64 * 1.7).cos()).collect();
                let curve = shape.curve(&c).unwrap();
                for x in [-30.0, 0.0, 77.7, 269.0, 270.0] {
                    let row = shape.design([x].into_iter());
                    let direct: f64 = row.iter().zip(&c).map(|(a, b)| a * b).sum();
                    assert!((curve.value(x, Travel::Forward) - direct).abs() < 1e-15, "{basis:?} {x}");
                }
            }
        }
    }

    #[test]
    fn orders_of_the_coefficients() {
        let shape = |basis, linear| Shape { basis, order: 2, range: [0.0, 1.0], period: 1.0, linear };
        assert_eq!(shape(Basis::HalfRange, false).orders(), [0, 0, 1, 2]);
        assert_eq!(shape(Basis::Chebyshev, false).orders(), [0, 0, 1]);
        assert_eq!(shape(Basis::Fourier, true).orders(), [0, 0, 1, 1, 2, 2]);
        assert_eq!(shape(Basis::Fourier, false).orders(), [0, 1, 1, 2, 2]);
    }
}
