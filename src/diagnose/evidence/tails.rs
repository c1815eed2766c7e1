//! Points out of the tails of the noise: the coordinates of a point are one observation and are judged jointly.

use nalgebra::{DMatrix, DVector};
use volcomp_model::statistics::{f_limit, normal_two_sided};

use super::super::constants::{LITTLE, NEARLY, SIGNIFICANT, SURE};
use super::super::orthonormal::orthonormal;
use super::super::session::Session;
use super::covariance::Covariance;
use super::gram::{Gram, Member};
use super::posterior::Search;
use super::scales::{self, Rungs};

/// Singular value below which a direction is one of rounding, relative to the largest.
const DEPENDENT: f64 = 1e-8;

/// Groups of readings that are coordinates of one point: single readings that follow each other, taken at one time and place
/// along different directions, such as x and y of a hole.
pub(super) fn points(session: &Session, groups: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let mut all: Vec<Vec<usize>> = Vec::new();
    for (k, rows) in groups.iter().enumerate() {
        let joins = |point: &Vec<usize>| {
            rows.len() == 1
                && point
                    .iter()
                    .all(|l| groups[*l].len() == 1 && is_same_point(session, rows[0], groups[*l][0]))
        };
        match all.last_mut().filter(|p| joins(p)) {
            Some(point) => point.push(k),
            None => all.push(vec![k]),
        }
    }
    all
}

fn is_same_point(session: &Session, i: usize, j: usize) -> bool {
    let ((a, b), (m, n)) =
        ((&session.readings[i], &session.readings[j]), (&session.moments[i], &session.moments[j]));
    a.setup == b.setup
        && (a.run, a.repeat, a.instrument) == (b.run, b.repeat, b.instrument)
        && m.t_s == n.t_s
        && m.position == n.position
        && m.u.dot(&n.u).abs() < NEARLY
}

impl Search {
    /// Groups of readings out of the tails, with the weight of their variance that makes them ordinary. The residuals of a point
    /// from what all others predict are judged jointly against a noise estimated without it (F test with the probability of
    /// [`SURE`] standard deviations): an outlying point must not hide in the noise that it makes itself.
    pub(super) fn tails(
        &self,
        rungs: &Rungs,
        members: &[Member],
        points: &[Vec<usize>],
    ) -> Option<Vec<(usize, f64)>> {
        let covariance = Covariance::new(&self.structure, &scales::values(rungs), &self.weights)?;
        let gram = Gram::new(&covariance, &self.columns, &self.y);
        let set = gram.condition(&self.columns, members);
        let (at, mean, _) = gram.coefficients(&set);
        let columns: Vec<DVector<f64>> =
            at.iter().map(|c| self.columns.values.column(*c).into_owned()).collect();
        let mut left = self.y.clone();
        for (c, b) in columns.iter().zip(mean.iter()) {
            left.axpy(-b, c, 1.0);
        }
        let n = left.len();
        let beside = basis(&covariance, &columns)?;
        let freedom = covariance.freedom().saturating_sub(beside.ncols());
        let whitened = covariance.whiten(&DMatrix::from_column_slice(n, 1, left.as_slice()));
        let pulled = covariance.back(&whitened.column(0).into_owned());
        let w = covariance.precision(&beside);
        let limits: Vec<f64> = (0..=3)
            .map(|k| k as f64 * f_limit(normal_two_sided(SURE), k, freedom.saturating_sub(k)))
            .collect();
        let mut out: Vec<(&Vec<usize>, f64, f64)> = Vec::new();
        for point in points.iter().filter(|p| p.len() < limits.len()) {
            let k = point.len();
            let own = DMatrix::from_fn(k, k, |i, j| w.column(point[i]).dot(&w.column(point[j])));
            let Some(inverse) = own.cholesky().map(|c| c.inverse()).filter(|v| v.amax() < 1e9) else {
                continue;
            };
            let pull = DVector::from_fn(k, |i, _| pulled[point[i]]);
            let residual = &inverse * &pull;
            let others = (set.left - pull.dot(&residual)).max(1e-12 * set.left)
                / freedom.saturating_sub(k).max(1) as f64;
            // residuals scatter with the ordinary noise of the readings, whatever weight they have now
            let extra = DVector::from_fn(k, |i, _| self.weights[point[i]] - self.structure.white[point[i]]);
            let ordinary = inverse - DMatrix::from_diagonal(&extra);
            let Some(square) = ordinary.cholesky().map(|c| residual.dot(&c.solve(&residual)) / others) else {
                continue;
            };
            if square > limits[k] {
                out.push((point, square, limits[k]));
            }
        }
        // so many are the tails of the noise itself
        if out.len() > (LITTLE * points.len() as f64).ceil() as usize {
            return Some(Vec::new());
        }
        let weight = |(point, square, limit): &(&Vec<usize>, f64, f64)| {
            // what is left out must not count as noise either
            let is_left_out = square / limit > (SIGNIFICANT / SURE).powi(2);
            if is_left_out { square / point.len() as f64 } else { square / limit }
        };
        Some(out.iter().flat_map(|p| p.0.iter().map(|k| (*k, weight(p)))).collect())
    }
}

/// Orthonormal basis of the whitened columns.
fn basis(covariance: &Covariance, columns: &[DVector<f64>]) -> Option<DMatrix<f64>> {
    if columns.is_empty() {
        return Some(DMatrix::zeros(covariance.rows(), 0));
    }
    orthonormal(covariance.whiten(&DMatrix::from_columns(columns)), DEPENDENT)
}
