//! Linear least squares by QR, with ridge, leverages and condition number.

use nalgebra::{DMatrix, DVector};

/// Condition number above which the terms count as indistinguishable.
pub(super) const CONDITION_LIMIT: f64 = 1e10;

/// The solution of `min |y - A c|^2 + SUM p_j c_j^2`.
pub(super) struct Solution {
    pub(super) coefficients: Vec<f64>,
    /// `y - A c`.
    pub(super) residuals: Vec<f64>,
    /// Diagonal of the hat matrix.
    pub(super) leverage: Vec<f64>,
    pub(super) condition: f64,
}

/// Solves; `Err` holds the condition number where the terms cannot be told apart.
pub(super) fn solve(design: &DMatrix<f64>, y: &[f64], penalty: &[f64]) -> Result<Solution, f64> {
    let (n, m) = design.shape();
    let ridge = penalty.iter().filter(|p| **p > 0.0).count();
    if n + ridge < m || m == 0 {
        return Err(f64::INFINITY);
    }
    let (q, r) = factor(design, penalty, ridge);
    let values = r.clone().svd(false, false).singular_values;
    let condition = values.max() / values.min();
    if condition.is_nan() || condition > CONDITION_LIMIT {
        return Err(condition);
    }
    let observed = q.rows(0, n);
    let y = DVector::from_column_slice(y);
    let Some(mut c) = r.solve_upper_triangular(&observed.tr_mul(&y)) else { return Err(condition) };
    if ridge == 0
        && let Some(step) = r.solve_upper_triangular(&observed.tr_mul(&(&y - design * &c)))
    {
        // one refinement takes out the rounding of the first solution
        c += step;
    }
    let residuals = &y - design * &c;
    let leverage = (0..n).map(|i| observed.row(i).norm_squared()).collect();
    Ok(Solution {
        coefficients: c.iter().copied().collect(),
        residuals: residuals.iter().copied().collect(),
        leverage,
        condition,
    })
}

/// Thin QR of the design with one row `sqrt(p_j)` per penalty below it.
fn factor(design: &DMatrix<f64>, penalty: &[f64], ridge: usize) -> (DMatrix<f64>, DMatrix<f64>) {
    let (n, m) = design.shape();
    let mut augmented = design.clone().resize_vertically(n + ridge, 0.0);
    let mut row = n;
    for (j, p) in penalty.iter().enumerate().take(m) {
        if *p > 0.0 {
            augmented[(row, j)] = p.sqrt();
            row += 1;
        }
    }
    augmented.qr().unpack()
}

/// Sum of squared residuals only, for searches; infinite where the pivots spread by more than `limit`.
pub(super) fn sum_of_squares(design: DMatrix<f64>, y: &DVector<f64>, limit: f64) -> f64 {
    if design.nrows() < design.ncols() {
        return f64::INFINITY;
    }
    let columns = design.ncols();
    let qr = design.qr();
    let mut rotated = y.clone();
    qr.q_tr_mul(&mut rotated);
    let diagonal = qr.unpack_r().diagonal().abs();
    let (largest, smallest) = (diagonal.max(), diagonal.min());
    if largest.is_nan() || largest > limit * smallest {
        return f64::INFINITY;
    }
    rotated.rows_range(columns..).norm_squared()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_through_three_points() {
        let a = DMatrix::from_row_slice(3, 2, &[1.0, 0.0, 1.0, 1.0, 1.0, 2.0]);
        let s = solve(&a, &[1.0, 2.0, 4.0], &[]).unwrap();
        assert!((s.coefficients[0] - 5.0 / 6.0).abs() < 1e-15);
        assert!((s.coefficients[1] - 1.5).abs() < 1e-15);
        assert!((s.leverage.iter().sum::<f64>() - 2.0).abs() < 1e-14);
        let sse: f64 = s.residuals.iter().map(|r| r * r).sum();
        assert!((sum_of_squares(a, &DVector::from_column_slice(&[1.0, 2.0, 4.0]), 1e3) - sse).abs() < 1e-14);
    }

    #[test]
    fn equal_columns_are_refused_and_a_ridge_splits_them_evenly() {
        let a = DMatrix::from_row_slice(3, 2, &[1.0, 1.0, 2.0, 2.0, 3.0, 3.0]);
        assert!(solve(&a, &[1.0, 2.0, 3.0], &[]).is_err());
        let s = solve(&a, &[1.0, 2.0, 3.0], &[1e-6, 1e-6]).unwrap();
        assert!((s.coefficients[0] - 0.5).abs() < 1e-6);
        assert!((s.coefficients[0] - s.coefficients[1]).abs() < 1e-9);
    }

    #[test]
    fn a_huge_ridge_gives_zero() {
        let a = DMatrix::from_row_slice(3, 1, &[1.0, 2.0, 3.0]);
        assert!(solve(&a, &[1.0, 2.0, 3.0], &[1e12]).unwrap().coefficients[0].abs() < 1e-9);
    }
}
