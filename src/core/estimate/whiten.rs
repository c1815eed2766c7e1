//! Readings with a covariance to rows of unit variance that are independent of each other.
//!
//! With `C = L L^T` the rows `L^-1 H x = L^-1 z` have the identity as covariance, so that a filter of scalar updates
//! may take them one after the other (equations 5.8; a batch of scalar updates is the vector update).

use nalgebra::{DMatrix, DVector};

use super::filter::COMPONENTS_MAX;
use super::map::Row;

/// Rows of unit variance from values, their weights (one row each), what a second of delay adds to each, and their
/// covariance; `None` where it is none.
#[must_use]
pub fn whiten(
    values: &[f64],
    weights: &[[f64; COMPONENTS_MAX]],
    delays: &[f64],
    covariance: &DMatrix<f64>,
) -> Option<Vec<Row>> {
    let n = values.len();
    if weights.len() != n
        || delays.len() != n
        || covariance.shape() != (n, n)
        || covariance.iter().any(|v| !v.is_finite())
    {
        return None;
    }
    let l = covariance.clone().cholesky()?.l();
    let h = DMatrix::from_fn(n, COMPONENTS_MAX, |i, j| weights[i][j]);
    let z = l.solve_lower_triangular(&DVector::from_column_slice(values))?;
    let h = l.solve_lower_triangular(&h)?;
    let late = l.solve_lower_triangular(&DVector::from_column_slice(delays))?;
    Some(
        (0..n)
            .map(|i| Row { weights: core::array::from_fn(|j| h[(i, j)]), value: z[i], delay: late[i] })
            .collect(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_carry_the_information_of_the_covariance() {
        let c = DMatrix::from_row_slice(2, 2, &[4.0, 1.0, 1.0, 9.0]);
        let mut weights = [[0.0; COMPONENTS_MAX]; 2];
        weights[0][0] = 1.0;
        weights[1][0] = 0.5;
        weights[1][3] = 2.0;
        let rows = whiten(&[3.0, -1.0], &weights, &[0.0; 2], &c).unwrap();
        // H^T C^-1 H and H^T C^-1 z are what a filter learns
        let inverse = c.clone().try_inverse().unwrap();
        for a in [0, 3] {
            for b in [0, 3] {
                let found: f64 = rows.iter().map(|r| r.weights[a] * r.weights[b]).sum();
                let wanted: f64 =
                    (0..4).map(|k| weights[k / 2][a] * inverse[(k / 2, k % 2)] * weights[k % 2][b]).sum();
                assert!((found - wanted).abs() < 1e-14, "{a} {b}");
            }
            let found: f64 = rows.iter().map(|r| r.weights[a] * r.value).sum();
            let z = [3.0, -1.0];
            let wanted: f64 = (0..4).map(|k| weights[k / 2][a] * inverse[(k / 2, k % 2)] * z[k % 2]).sum();
            assert!((found - wanted).abs() < 1e-14);
        }
        let singular = DMatrix::from_row_slice(2, 2, &[1.0, 1.0, 1.0, 1.0]);
        assert!(whiten(&[1.0, 1.0], &weights, &[0.0; 2], &singular).is_none());
        assert!(whiten(&[1.0], &weights, &[0.0; 2], &c).is_none());
        assert!(
            whiten(&[1.0, f64::NAN], &weights, &[0.0; 2], &DMatrix::from_element(2, 2, f64::NAN)).is_none()
        );
    }
}
