//! Cholesky decomposition and forward substitution in blocks: their products run several times faster than columns one by one.

use nalgebra::{Cholesky, DMatrix, DVector, SymmetricTridiagonal};

/// Columns of a block.
const BLOCK: usize = 32;

/// The lower factor of a symmetric matrix, of which the lower half is read; `None` where it is not positive definite.
pub(crate) fn cholesky(mut a: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = a.nrows();
    for at in (0..n).step_by(BLOCK) {
        let width = BLOCK.min(n - at);
        let (next, rest) = (at + width, n - at - width);
        let own = Cholesky::new(a.view((at, at), (width, width)).into_owned())?.unpack();
        a.view_mut((at, at), (width, width)).copy_from(&own);
        let across = inverse(&own) * a.view((next, at), (rest, width)).transpose();
        let below = across.transpose();
        a.view_mut((next, at), (rest, width)).copy_from(&below);
        for column in (0..rest).step_by(BLOCK) {
            let own = BLOCK.min(rest - column);
            let mut left = a.view_mut((next + column, next + column), (rest - column, own));
            left.gemm(-1.0, &below.rows(column, rest - column), &across.columns(column, own), 1.0);
        }
    }
    a.fill_upper_triangle(0.0, 1);
    Some(a)
}

/// Solves `L X = B` in place for a lower Cholesky factor.
pub(crate) fn solve_lower(l: &DMatrix<f64>, b: &mut DMatrix<f64>) {
    let width = b.ncols();
    substitute(l, b, |_| width);
}

/// The inverse of a lower Cholesky factor.
pub(crate) fn inverse_lower(l: &DMatrix<f64>) -> DMatrix<f64> {
    let mut inverse = DMatrix::identity(l.nrows(), l.nrows());
    substitute(l, &mut inverse, |below| below);
    inverse
}

/// Forward substitution; of the first `n` rows only the first `columns(n)` columns are not zero.
fn substitute(l: &DMatrix<f64>, b: &mut DMatrix<f64>, columns: impl Fn(usize) -> usize) {
    let n = l.nrows();
    for at in (0..n).step_by(BLOCK) {
        let width = BLOCK.min(n - at);
        let (next, rest) = (at + width, n - at - width);
        let mut full = b.columns_mut(0, columns(next));
        let own = inverse(&l.view((at, at), (width, width)).into_owned()) * full.rows(at, width);
        full.rows_mut(at, width).copy_from(&own);
        full.rows_mut(next, rest).gemm(-1.0, &l.view((next, at), (rest, width)), &own, 1.0);
    }
}

/// The inverse of a block of a lower factor, whose diagonal is positive.
fn inverse(block: &DMatrix<f64>) -> DMatrix<f64> {
    let mut inverse = DMatrix::identity(block.nrows(), block.nrows());
    block.solve_lower_triangular_unchecked_mut(&mut inverse);
    inverse
}

/// `A'B` of tall matrices.
pub(crate) fn product(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    a.transpose() * b
}

/// A positive semidefinite matrix `A` reduced to tridiagonal form by an orthogonal similarity transformation, and a vector `b` in the
/// same basis: for the evidence of `1 + f A` at many `f`.
pub(crate) struct Tridiagonal {
    diagonal: DVector<f64>,
    off_diagonal: DVector<f64>,
    rotated: DVector<f64>,
}

impl Tridiagonal {
    pub(crate) fn new(a: DMatrix<f64>, b: DVector<f64>) -> Self {
        if a.nrows() == 1 {
            let diagonal = a.column(0).into_owned();
            return Self { diagonal, off_diagonal: DVector::zeros(0), rotated: b };
        }
        let (basis, diagonal, off_diagonal) = SymmetricTridiagonal::new(a).unpack();
        Self { diagonal, off_diagonal, rotated: basis.tr_mul(&b) }
    }

    /// `f b' (1 + f A)^-1 b` and `ln |1 + f A|`.
    pub(crate) fn evidence(&self, f: f64) -> (f64, f64) {
        let (mut square, mut determinant, mut pivot, mut along) = (0.0, 0.0, 1.0, 0.0);
        let mut pivots = 1.0;
        for (k, d) in self.diagonal.iter().enumerate() {
            let off = if k > 0 { f * self.off_diagonal[k - 1] } else { 0.0 };
            along = self.rotated[k] - off / pivot * along;
            // every Schur complement of 1 + f A is at least 1
            pivot = (1.0 + f * d - off * off / pivot).max(1.0);
            square += along * along / pivot;
            pivots *= pivot;
            if pivots > 1e150 {
                determinant += f64::ln(pivots);
                pivots = 1.0;
            }
        }
        (f * square, determinant + f64::ln(pivots))
    }
}

#[cfg(test)]
mod tests {
    use super::{Cholesky, DMatrix, DVector, Tridiagonal, cholesky, inverse_lower, solve_lower};
    use crate::noise::Random;

    fn symmetric(n: usize, rank: usize) -> DMatrix<f64> {
        let mut random = Random::new(n as u64);
        let half = DMatrix::from_fn(n, rank, |_, _| random.normal());
        &half * half.transpose()
    }

    #[test]
    fn blocks_are_what_columns_one_by_one_are() {
        for n in [0, 1, 31, 32, 33, 100] {
            let a = symmetric(n, n) + DMatrix::identity(n, n);
            let plain = Cholesky::new(a.clone()).unwrap();
            let l = cholesky(a.clone()).unwrap();
            let size = a.amax().max(1.0);
            assert!((&l - plain.l()).amax() <= 1e-12 * size, "{n}");
            let mut b = DMatrix::from_fn(n, 3, |i, j| (i + 7 * j) as f64);
            let right = b.clone();
            solve_lower(&l, &mut b);
            assert!((&l * &b - right).amax() <= 1e-11 * size, "{n}");
            assert!((&l * inverse_lower(&l) - DMatrix::identity(n, n)).amax() <= 1e-11, "{n}");
        }
        assert!(cholesky(symmetric(40, 40) - DMatrix::identity(40, 40) * 1e3).is_none());
        assert!(cholesky(DMatrix::from_element(40, 40, f64::NAN)).is_none());
    }

    #[test]
    fn evidence_of_a_tridiagonal_is_that_of_the_matrix() {
        for (n, rank) in [(1, 1), (2, 1), (5, 3), (20, 20)] {
            let a = symmetric(n, rank);
            let b = &a * DVector::from_fn(n, |i, _| i as f64 - 1.5);
            let tridiagonal = Tridiagonal::new(a.clone(), b.clone());
            for f in [1e-6, 1.0, 1e4] {
                let whole = Cholesky::new(DMatrix::identity(n, n) + &a * f).unwrap();
                let (square, determinant) = tridiagonal.evidence(f);
                let wanted = f * b.dot(&whole.solve(&b));
                assert!((square - wanted).abs() < 1e-7 * wanted.max(1e-6), "{n} {f}: {square} {wanted}");
                let wanted = whole.determinant().ln();
                assert!((determinant - wanted).abs() < 1e-7 * wanted.max(1e-6), "{n} {f}");
            }
        }
    }
}
