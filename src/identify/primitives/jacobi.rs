//! Singular values by one-sided Jacobi rotations: for tall matrices of a few columns, accurate to the last digits of
//! the small values, and certain to end. (The iteration behind nalgebra's SVD can run for ever on columns that are
//! nearly parallel, which is just what degenerate measurements give.)
//!
//! Source: Hestenes 1958; Demmel, Veselic 1992 for the accuracy.

use nalgebra::{DMatrix, DVector};

/// `A = U diag(s) V^T`, values falling, `U` with as many columns as `A`.
pub(crate) struct Svd {
    /// Columns of unit length; zero where the value is zero.
    pub(crate) u: DMatrix<f64>,
    /// Falling.
    pub(crate) values: DVector<f64>,
    /// Orthogonal.
    pub(crate) v: DMatrix<f64>,
}

/// Sweeps after which the rotation stops; four to eight are usual.
const SWEEPS: usize = 60;

/// Decomposes a finite matrix.
pub(crate) fn svd(a: &DMatrix<f64>) -> Svd {
    let n = a.ncols();
    let mut w = a.clone();
    let mut v = DMatrix::identity(n, n);
    for _ in 0..SWEEPS {
        let mut turned = false;
        for p in 0..n {
            for q in p + 1..n {
                turned |= orthogonalise(&mut w, &mut v, p, q);
            }
        }
        if !turned {
            break;
        }
    }
    let norms: Vec<f64> = (0..n).map(|j| w.column(j).norm()).collect();
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|i, j| norms[*j].total_cmp(&norms[*i]));
    Svd {
        u: DMatrix::from_fn(w.nrows(), n, |i, j| {
            let k = order[j];
            if norms[k] > 0.0 { w[(i, k)] / norms[k] } else { 0.0 }
        }),
        values: DVector::from_fn(n, |j, _| norms[order[j]]),
        v: DMatrix::from_fn(n, n, |i, j| v[(i, order[j])]),
    }
}

/// Makes two columns orthogonal; false where they were.
fn orthogonalise(w: &mut DMatrix<f64>, v: &mut DMatrix<f64>, p: usize, q: usize) -> bool {
    let (alpha, beta) = (w.column(p).norm_squared(), w.column(q).norm_squared());
    let gamma = w.column(p).dot(&w.column(q));
    let small = f64::EPSILON * (alpha * beta).sqrt();
    if gamma.is_nan() || gamma.abs() <= small {
        return false;
    }
    let zeta = (beta - alpha) / (2.0 * gamma);
    let t = zeta.signum() / (zeta.abs() + zeta.hypot(1.0));
    let cosine = 1.0 / t.hypot(1.0);
    let sine = cosine * t;
    for m in [w, v] {
        for i in 0..m.nrows() {
            let (x, y) = (m[(i, p)], m[(i, q)]);
            m[(i, p)] = cosine * x - sine * y;
            m[(i, q)] = sine * x + cosine * y;
        }
    }
    true
}

impl Svd {
    /// Largest over smallest value.
    pub(crate) fn condition(&self) -> f64 {
        let n = self.values.len();
        if n == 0 { 1.0 } else { self.values[0] / self.values[n - 1] }
    }

    /// Least-squares solution; directions below `tolerance` times the largest value are left at zero.
    pub(crate) fn solve(&self, right: &DVector<f64>, tolerance: f64) -> DVector<f64> {
        let limit = tolerance * self.values.iter().fold(0.0f64, |m, s| m.max(*s));
        let mut turned = self.u.tr_mul(right);
        for (t, s) in turned.iter_mut().zip(self.values.iter()) {
            *t = if *s > limit { *t / s } else { 0.0 };
        }
        &self.v * turned
    }

    /// `(A^T A)^-1`, entry by entry.
    pub(crate) fn cofactor(&self, i: usize, j: usize) -> f64 {
        (0..self.values.len()).map(|k| self.v[(i, k)] * self.v[(j, k)] / self.values[k].powi(2)).sum()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_factors_multiply_back(entries in proptest::collection::vec(-10.0..10.0f64, 24), shrink in 0..12i32) {
            let mut a = DMatrix::from_vec(8, 3, entries);
            let near = a.column(0) + a.column(1) * 10f64.powi(-shrink);
            a.set_column(2, &near);
            let Svd { u, values, v } = svd(&a);
            let back = &u * DMatrix::from_diagonal(&values) * v.transpose();
            prop_assert!((back - &a).norm() < 1e-13 * a.norm());
            prop_assert!((v.tr_mul(&v) - DMatrix::identity(3, 3)).norm() < 1e-13);
            prop_assert!(values[0] >= values[1] && values[1] >= values[2]);
        }
    }

    #[test]
    fn parallel_and_zero_columns_end() {
        let x: Vec<f64> = (0..20).map(|i| (1e-5 * f64::from(i)).cos()).collect();
        let a = DMatrix::from_fn(20, 3, |i, j| [x[i], 1.0, 0.0][j]);
        let s = svd(&a);
        assert_eq!(s.values[2], 0.0);
        assert!(s.values[1] < 1e-7 && s.condition() == f64::INFINITY);
        let right = DVector::from_element(20, 2.0);
        let solution = s.solve(&right, 1e-12);
        assert!((&a * solution - right).norm() < 1e-12);
    }
}
