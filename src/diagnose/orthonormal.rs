//! Orthonormal bases.

use nalgebra::DMatrix;

/// Orthonormal columns with the span of some others but for directions whose singular value is `least` of the largest or less;
/// no column where all are.
pub(super) fn orthonormal(columns: DMatrix<f64>, least: f64) -> Option<DMatrix<f64>> {
    let svd = columns.svd(true, false);
    let limit = least * svd.singular_values.max();
    let kept: Vec<usize> =
        (0..svd.singular_values.len()).filter(|k| svd.singular_values[*k] > limit).collect();
    Some(svd.u?.select_columns(&kept))
}
