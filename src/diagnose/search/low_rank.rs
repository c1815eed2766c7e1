//! Noise of low rank beside what the filter whitens: variances along some orthonormal directions.

use nalgebra::{DMatrix, DMatrixView, DMatrixViewMut, DVector, SymmetricEigen};
use rayon::prelude::*;

/// Least variance of a direction that changes anything, 1 is the noise.
pub(super) const TELLS: f64 = 0.01;

/// Rows or columns that one processor takes at a time, and rows of the problem whose products are summed at a time.
const BLOCK: usize = 256;
const ROWS: usize = 512;

/// Noise along some directions; whitening is `(1 + U U')^-1/2`.
#[derive(Debug, Clone, PartialEq)]
pub struct LowRank {
    /// Orthonormal, one matrix row per row of the problem.
    basis: DMatrix<f64>,
    /// Variance along each, 1 is the noise.
    variance: DVector<f64>,
}

impl LowRank {
    /// The noise of columns whose coefficients are independent with the standard deviation `scale`.
    pub(super) fn of(columns: &DMatrix<f64>, scale: f64) -> Self {
        let eigen = SymmetricEigen::new(columns.tr_mul(columns));
        let size = eigen.eigenvalues.map(|l| l.max(0.0));
        let kept: Vec<usize> = (0..size.len()).filter(|k| size[*k] * scale * scale > TELLS).collect();
        let mut basis = columns * eigen.eigenvectors.select_columns(&kept);
        for (mut column, k) in basis.column_iter_mut().zip(&kept) {
            column /= size[*k].sqrt();
        }
        let variance = DVector::from_iterator(kept.len(), kept.iter().map(|k| size[*k] * scale * scale));
        Self { basis, variance }
    }

    /// Logarithm of the determinant of what joins the noise.
    #[must_use]
    pub fn log_variance(&self) -> f64 {
        self.variance.iter().map(|v| v.ln_1p()).sum()
    }

    /// Posterior mean square of what joined the noise, per row, of what is left beside all effects (not whitened by it).
    #[must_use]
    pub fn mean_square(&self, left: &DVector<f64>) -> f64 {
        let along = self.basis.tr_mul(left);
        let of = |(a, v): (&f64, &f64)| {
            let share = v / (1.0 + v);
            share * (share * a * a + 1.0)
        };
        along.iter().zip(self.variance.iter()).map(of).sum::<f64>() / left.len().max(1) as f64
    }

    fn change(&self, back: bool) -> DVector<f64> {
        self.variance.map(|v| if back { (1.0 + v).sqrt() - 1.0 } else { 1.0 / (1.0 + v).sqrt() - 1.0 })
    }

    /// Whitens columns in place, or back: a row of values, one of each column, per row of the problem.
    pub(crate) fn turn(&self, data: &mut [f64], back: bool) {
        let rows = self.basis.nrows();
        let width = data.len() / rows.max(1);
        if width == 0 {
            return;
        }
        let w = DMatrixView::from_slice(data, width, rows);
        let mut along = product(&w, &self.basis);
        for (mut column, c) in along.column_iter_mut().zip(self.change(back).iter()) {
            column *= *c;
        }
        data.par_chunks_mut(width * BLOCK).enumerate().for_each(|(k, data)| {
            let n = data.len() / width;
            let basis = self.basis.rows(k * BLOCK, n).transpose();
            DMatrixViewMut::from_slice(data, width, n).gemm(1.0, &along, &basis, 1.0);
        });
    }
}

/// `w` (a matrix column per row of the problem) times some vectors, a value per row of the problem each.
pub(super) fn product(w: &DMatrixView<'_, f64>, some: &DMatrix<f64>) -> DMatrix<f64> {
    let (width, rows) = w.shape();
    let chunks = (0..rows).step_by(ROWS).map(|at| (at, ROWS.min(rows - at)));
    // most effects act in some of the programs
    let acts = |(at, n): &(usize, usize)| some.rows(*at, *n).iter().any(|v| *v != 0.0);
    let chunks: Vec<(usize, usize)> = chunks.filter(acts).collect();
    let blocks: Vec<(usize, usize)> =
        (0..width).step_by(BLOCK).map(|at| (at, BLOCK.min(width - at))).collect();
    let of_block = |(first, wide): &(usize, usize)| {
        let mut sums = DMatrix::zeros(*wide, some.ncols());
        for (at, n) in &chunks {
            sums.gemm(1.0, &w.view((*first, *at), (*wide, *n)), &some.rows(*at, *n), 1.0);
        }
        sums
    };
    let parts: Vec<DMatrix<f64>> = blocks.par_iter().map(of_block).collect();
    let mut all = DMatrix::zeros(width, some.ncols());
    blocks.iter().zip(&parts).for_each(|((at, wide), part)| all.rows_mut(*at, *wide).copy_from(part));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_varies_is_shrunk_to_unit_variance_and_what_does_not_stays() {
        let v = LowRank {
            basis: DMatrix::from_column_slice(3, 1, &[0.6, 0.8, 0.0]),
            variance: DVector::from_element(1, 3.0),
        };
        let mut column = DVector::from_column_slice(&[0.6 * 2.0 - 0.8, 0.8 * 2.0 + 0.6, 5.0]);
        let before = column.clone();
        v.turn(column.as_mut_slice(), false);
        // standard deviation 2 becomes 1 along the basis
        let wanted = DVector::from_column_slice(&[0.6 - 0.8, 0.8 + 0.6, 5.0]);
        assert!((&column - wanted).norm() < 1e-12, "{column}");
        v.turn(column.as_mut_slice(), true);
        assert!((column - &before).norm() < 1e-12);
        assert!((v.log_variance() - 4f64.ln()).abs() < 1e-12);
        // mean 3/4 of 2, variance 3/4, over three rows
        assert!((v.mean_square(&before) - (1.5f64.powi(2) + 0.75) / 3.0).abs() < 1e-12);
    }
}
