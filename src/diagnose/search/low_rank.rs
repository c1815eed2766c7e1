//! Noise of low rank beside what the filter whitens: variances along some orthonormal directions.

use nalgebra::{DMatrix, DMatrixView, DMatrixViewMut, DVector, DVectorView, Dyn, SymmetricEigen};
use rayon::prelude::*;

use super::super::dense;

/// Least variance of a direction that changes anything, 1 is the noise.
pub(super) const TELLS: f64 = 0.01;

/// Fewest rows whose products one processor sums, and most parts that have sums of their own.
const ROWS: usize = 256;
const PARTS: usize = 32;

/// Noise along some directions; whitening is `(1 + U U')^-1/2`.
#[derive(Debug, Clone, PartialEq)]
pub struct LowRank {
    /// Orthonormal, one matrix row per row of the problem.
    basis: DMatrix<f64>,
    /// Variance along each, 1 is the noise.
    variance: DVector<f64>,
}

impl LowRank {
    /// The noise of columns whose coefficients are independent with standard deviations `sizes`.
    pub(super) fn of(columns: &DMatrix<f64>, sizes: &[f64]) -> Self {
        let mut columns = columns.clone();
        columns.column_iter_mut().zip(sizes).for_each(|(mut column, size)| column *= *size);
        let eigen = SymmetricEigen::new(dense::product(&columns, &columns));
        let all = eigen.eigenvalues;
        let kept: Vec<usize> = (0..all.len()).filter(|k| all[*k] > TELLS).collect();
        let mut basis = columns * eigen.eigenvectors.select_columns(&kept);
        for (mut column, k) in basis.column_iter_mut().zip(&kept) {
            column /= all[*k].sqrt();
        }
        Self { basis, variance: all.select_rows(&kept) }
    }

    /// Logarithm of the determinant of what joins the noise.
    #[must_use]
    pub fn log_variance(&self) -> f64 {
        self.variance.iter().map(|v| v.ln_1p()).sum()
    }

    /// The product of its covariance with a value per row.
    #[must_use]
    pub fn times(&self, rows: &DVector<f64>) -> DVector<f64> {
        &self.basis * self.basis.tr_mul(rows).component_mul(&self.variance)
    }

    fn change(&self, back: bool) -> DVector<f64> {
        self.variance.map(|v| if back { (1.0 + v).sqrt() - 1.0 } else { 1.0 / (1.0 + v).sqrt() - 1.0 })
    }

    /// Whitens columns in place, or back: a row of values, one of each column, per row of the problem.
    pub(crate) fn turn(&self, data: &mut [f64], back: bool) {
        let (rows, rank) = self.basis.shape();
        let width = data.len() / rows.max(1);
        let change = self.change(back);
        if width <= NARROW {
            // the products of few columns run along the basis as it lies
            let mut columns = DMatrixView::from_slice(data, width, rows).transpose();
            let mut along = self.basis.tr_mul(&columns);
            along.column_iter_mut().for_each(|mut a| a.component_mul_assign(&change));
            for (mut column, along) in columns.column_iter_mut().zip(along.column_iter()) {
                column.gemv(1.0, &self.basis, &along, 1.0);
            }
            data.copy_from_slice(columns.transpose().as_slice());
            return;
        }
        let mut columns = DMatrixViewMut::from_slice(data, width, rows);
        let mut along = &columns * &self.basis;
        along.column_iter_mut().zip(change.iter()).for_each(|(mut a, change)| a *= *change);
        let transposed =
            DMatrixView::<f64, Dyn, Dyn>::from_slice_with_strides(self.basis.as_slice(), rank, rows, rows, 1);
        columns.gemm(1.0, &along, &transposed, 1.0);
    }

    /// The directions, each by the root of the share that whitening takes along it, a matrix row each.
    fn taken(&self) -> DMatrix<f64> {
        let mut taken = self.basis.transpose();
        for (mut row, v) in taken.row_iter_mut().zip(self.variance.iter()) {
            row *= (v / (1.0 + v)).sqrt();
        }
        taken
    }
}

/// Noise that joined, and what it takes of columns that stay as they are: whitened by it too, their products are those before less the
/// products of what lies along its directions (Woodbury). So it joins at the price of these, and leaves at none.
pub(super) struct Joined {
    noise: LowRank,
    /// The directions among columns that no noise has whitened, a matrix column each.
    directions: DMatrix<f64>,
    /// What of each column lies along them, a matrix column each.
    along: DMatrix<f64>,
    /// What of the gap does.
    of_gap: DVector<f64>,
}

impl Joined {
    /// Noise that joins after some other for columns (a matrix row each) and a gap that no noise has whitened.
    pub(super) fn new(noise: LowRank, before: &[Self], w: &DMatrix<f64>, y: &DVector<f64>) -> Self {
        let mut directions = noise.taken();
        before.iter().rev().for_each(|b| b.turn(directions.as_mut_slice()));
        let directions = directions.transpose();
        let along = product(&w.as_view(), &directions).transpose();
        let of_gap = directions.tr_mul(y);
        Self { noise, directions, along, of_gap }
    }

    pub(super) const fn noise(&self) -> &LowRank {
        &self.noise
    }

    /// Whitens columns by it in place.
    pub(super) fn turn(&self, data: &mut [f64]) {
        self.noise.turn(data, false);
    }

    /// Takes a column for another one, a value per row of the problem.
    pub(super) fn replace(&mut self, column: usize, values: &DVectorView<'_, f64>) {
        self.along.set_column(column, &self.directions.tr_mul(values));
    }

    /// What of some columns that no noise has whitened lies along its directions, a row each; the columns lie as those of `w` in [`Self::new`].
    pub(super) fn along(&self, columns: &DMatrixView<'_, f64>) -> DMatrix<f64> {
        product(columns, &self.directions)
    }

    /// What of some columns of the problem and of the gap, the last, does, a row each.
    pub(super) fn along_of(&self, columns: &[usize]) -> DMatrix<f64> {
        let mut along = self.along.select_columns(columns).transpose().insert_row(columns.len(), 0.0);
        along.row_mut(columns.len()).copy_from(&self.of_gap.transpose());
        along
    }

    /// What it takes of the product of two columns.
    pub(super) fn of_columns(&self, [a, b]: [usize; 2]) -> f64 {
        self.along.column(a).dot(&self.along.column(b))
    }

    /// What it takes of the product of a column with the gap.
    pub(super) fn of_gap(&self, column: usize) -> f64 {
        self.along.column(column).dot(&self.of_gap)
    }
}

/// Most vectors whose products are summed row by row, in one pass over the columns.
const NARROW: usize = 8;

/// `w` (a matrix column per row of the problem) times some vectors, a value per row of the problem each.
pub(super) fn product(w: &DMatrixView<'_, f64>, some: &DMatrix<f64>) -> DMatrix<f64> {
    let (width, rows) = w.shape();
    // sums over the same rows whatever the number of processors, and in the order in which `w` lies
    let each = ROWS.max(rows.div_ceil(PARTS));
    let chunks = (0..rows).step_by(each).map(|at| (at, each.min(rows - at)));
    // most effects act in some of the programs
    let acts = |(at, n): &(usize, usize)| some.rows(*at, *n).iter().any(|v| *v != 0.0);
    let chunks: Vec<(usize, usize)> = chunks.filter(acts).collect();
    let of_chunk = |(at, n): &(usize, usize)| {
        if some.ncols() > NARROW {
            return w.columns(*at, *n) * some.rows(*at, *n);
        }
        let mut sums = DMatrix::zeros(width, some.ncols());
        for i in *at..at + n {
            for (mut sum, value) in sums.column_iter_mut().zip(some.row(i).iter()).filter(|s| *s.1 != 0.0) {
                sum.axpy(*value, &w.column(i), 1.0);
            }
        }
        sums
    };
    let parts: Vec<DMatrix<f64>> = chunks.par_iter().map(of_chunk).collect();
    parts.iter().fold(DMatrix::zeros(width, some.ncols()), |all, part| all + part)
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
        assert!((v.times(&before) - DVector::from_column_slice(&[3.6, 4.8, 0.0])).norm() < 1e-12);
    }
}
