//! How well a fitted curve is known: its standard deviation at every position, and that of its numbers.
//!
//! Assumptions: errors of the readings are independent and of equal size, the family of curves holds the truth.
//! Errors that readings share (offsets of the cycles, what a subtracted drift leaves) add to the band.
//! A fitted period counts as a parameter (derivative of the curve by the period). With a ridge or a smoothed
//! table the band is that of the Bayesian reading (`sigma^2 H_ii`), which covers the penalised bias on average.

use crate::prelude::*;

use super::basis::Shape;
use super::solve::Design;

/// Confidence band of a curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// Standard deviation of a reading.
    sigma: f64,
    dof: usize,
    kind: Kind,
}

#[derive(Debug, Clone, PartialEq)]
enum Kind {
    /// The triangular factor of the design, with the columns that it had.
    Linear {
        r: DMatrix<f64>,
        shape: Shape,
        reversal: usize,
        coefficients: Vec<f64>,
        fitted: Option<usize>,
        /// How shared errors change the coefficients, a row per column of the design.
        shared: DMatrix<f64>,
    },
    /// Standard deviation per unit of sigma, and of shared errors, at support points, forward and reverse.
    Nodes { positions: Vec<f64>, forward: Vec<[f64; 2]>, reverse: Option<Vec<[f64; 2]>> },
}

impl Band {
    pub(super) fn linear(
        sigma: f64,
        dof: usize,
        r: DMatrix<f64>,
        (shape, reversal): (&Shape, usize),
        coefficients: &[f64],
        fitted: Option<usize>,
    ) -> Self {
        let (shape, coefficients) = (shape.clone(), coefficients.to_vec());
        let shared = DMatrix::zeros(r.nrows(), 0);
        Self { sigma, dof, kind: Kind::Linear { r, shape, reversal, coefficients, fitted, shared } }
    }

    /// With what shared errors change in the coefficients.
    pub(super) fn with_shared(mut self, of_coefficients: DMatrix<f64>) -> Self {
        if let Kind::Linear { shared, .. } = &mut self.kind {
            *shared = of_coefficients;
        }
        self
    }

    pub(super) fn nodes(
        sigma: f64,
        dof: usize,
        positions: Vec<f64>,
        forward: Vec<[f64; 2]>,
        reverse: Option<Vec<[f64; 2]>>,
    ) -> Self {
        Self { sigma, dof, kind: Kind::Nodes { positions, forward, reverse } }
    }

    /// Standard deviation of a reading (k = 1), mm or rad.
    #[must_use]
    pub const fn sigma(&self) -> f64 {
        self.sigma
    }

    /// The curve plus and minus this many standard deviations holds the truth at a position with 95 %.
    #[must_use]
    pub fn factor_95(&self) -> f64 {
        student_95(self.dof.max(1))
    }

    /// Standard deviation of the curve (k = 1) at `position`, mm or rad; beyond the ends that of the end.
    #[must_use]
    pub fn std_at(&self, position: f64, travel: Travel) -> f64 {
        match &self.kind {
            Kind::Linear { r, shape, reversal, coefficients, fitted, shared } => {
                let design = Design {
                    shape,
                    reversal: *reversal,
                    reversal_first: false,
                    slopes: fitted.map(|first| (coefficients.as_slice(), first)),
                };
                let sign = if travel == Travel::Reverse { -1.0 } else { 1.0 };
                let mut row = DVector::zeros(design.len());
                let x = position.clamp(shape.range[0], shape.range[1]);
                design.row(x, sign, row.as_mut_slice());
                let common = shared.tr_mul(&row).norm();
                r.tr_solve_upper_triangular(&row)
                    .map_or(f64::INFINITY, |q| (self.sigma * q.norm()).hypot(common))
            }
            Kind::Nodes { positions, forward, reverse } => {
                let values = match (reverse, travel) {
                    (Some(reverse), Travel::Reverse) => reverse,
                    _ => forward,
                };
                let last = positions.len() - 1;
                let x = position.clamp(positions[0], positions[last]);
                let i = positions.partition_point(|&p| p <= x).saturating_sub(1).min(last - 1);
                let share = (x - positions[i]) / (positions[i + 1] - positions[i]);
                let [(a, common_a), (b, common_b)] =
                    [values[i], values[i + 1]].map(|[own, c]| (self.sigma * own, c));
                // between two means with independent errors, beside those that they share
                let own = ((1.0 - share) * a).hypot(share * b);
                own.hypot((1.0 - share) * common_a + share * common_b)
            }
        }
    }

    /// Standard deviations of the coefficients, of those of the reversal and of the fitted periods, in this order;
    /// of the values for a table.
    #[must_use]
    pub fn parameter_std(&self) -> Vec<f64> {
        match &self.kind {
            Kind::Linear { r, shared, .. } => {
                let n = r.nrows();
                match r.solve_upper_triangular(&DMatrix::identity(n, n)) {
                    Some(inverse) => (0..n)
                        .map(|i| (self.sigma * inverse.row(i).norm()).hypot(shared.row(i).norm()))
                        .collect(),
                    None => vec![f64::INFINITY; n],
                }
            }
            Kind::Nodes { forward, reverse, .. } => forward
                .iter()
                .chain(reverse.iter().flatten())
                .map(|[own, c]| (self.sigma * own).hypot(*c))
                .collect(),
        }
    }
}
