//! Plane of least squared distances: centroid and direction of least spread.
//!
//! Source: equations 5.4.

use crate::prelude::*;

/// A plane `normal . x = distance`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Mean of the points; lies in the plane.
    pub centroid: Vec3,
    /// Unit normal; the sign is that of its largest component.
    pub normal: Vec3,
    /// Distance of the origin along the normal.
    pub distance: f64,
    /// Root of the mean squared distance of the points.
    pub rms: f64,
    /// Two unit vectors in the plane, the longer spread first; with the normal right-handed.
    pub axes: [Vec3; 2],
    /// Root of the mean square of the points along the two axes.
    pub spread: [f64; 2],
}

/// Why no plane can be found.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PlaneError {
    /// Fewer than three points.
    #[error("{found} points; a plane needs at least 3")]
    TooFewPoints {
        /// Points given.
        found: usize,
    },
    /// A coordinate that is no number.
    #[error("point {point} is not finite")]
    NotFinite {
        /// 1-based point.
        point: usize,
    },
    /// The points lie on a line or in one place.
    #[error(
        "the points lie on a line (they spread {across:.3e} mm across it and {along:.3e} mm along it); measure beside it"
    )]
    Collinear {
        /// Spread along the line, rms, mm.
        along: f64,
        /// Spread across the line, rms, mm.
        across: f64,
    },
}

/// Spread across a line, as a share of that along it, below which the plane about the line is not determined.
const COLLINEAR: f64 = 1e-6;

/// The plane of least squared distances.
///
/// # Errors
/// Fewer than three points, numbers that are not finite, points on a line.
pub fn plane(points: &[Vec3]) -> Result<Plane, PlaneError> {
    if points.len() < 3 {
        return Err(PlaneError::TooFewPoints { found: points.len() });
    }
    if let Some(i) = points.iter().position(|p| p.iter().any(|v| !v.is_finite())) {
        return Err(PlaneError::NotFinite { point: i + 1 });
    }
    let n = points.len() as f64;
    let centroid = points.iter().sum::<Vec3>() / n;
    let (directions, spread) = spread(points, &centroid);
    if spread[1] <= COLLINEAR * spread[0] {
        return Err(PlaneError::Collinear { along: spread[0], across: spread[1] });
    }
    let largest = directions[2].iter().fold(0.0f64, |m, v| if v.abs() > m.abs() { *v } else { m });
    let normal = directions[2] * largest.signum();
    let first = directions[0];
    Ok(Plane {
        centroid,
        normal,
        distance: normal.dot(&centroid),
        rms: spread[2],
        axes: [first, normal.cross(&first)],
        spread: [spread[0], spread[1]],
    })
}

/// Directions of largest to smallest spread about a centre, and the rms spread along each.
///
/// By SVD of the coordinates, not of their squares: half of the digits would be lost.
pub(crate) fn spread(points: &[Vec3], centre: &Vec3) -> ([Vec3; 3], [f64; 3]) {
    let matrix = nalgebra::DMatrix::from_fn(points.len(), 3, |i, j| points[i][j] - centre[j]);
    let svd = jacobi::svd(&matrix);
    let n = (points.len().max(1) as f64).sqrt();
    (
        core::array::from_fn(|k| Vec3::from_fn(|i, _| svd.v[(i, k)])),
        core::array::from_fn(|k| svd.values[k] / n),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tilted_plane_far_away() {
        let normal = Vec3::new(2.0, -3.0, 6.0) / 7.0;
        let u = Vec3::new(3.0, 6.0, 2.0) / 7.0;
        let v = normal.cross(&u);
        let points: Vec<Vec3> = (0..12)
            .map(|i| normal * 5000.0 + u * f64::from(i % 4) * 30.0 + v * f64::from(i / 4) * 20.0)
            .collect();
        let p = plane(&points).unwrap();
        assert!((p.normal - normal).norm() < 1e-12 && (p.distance - 5000.0).abs() < 1e-9, "{p:?}");
        assert!(p.rms < 1e-11);
        assert!((p.axes[0].cross(&p.axes[1]) - p.normal).norm() < 1e-14);
        assert!((p.axes[0] - u).norm().min((p.axes[0] + u).norm()) < 1e-9);
    }

    #[test]
    fn a_line_has_no_plane() {
        let line: Vec<Vec3> = (0..5).map(|i| Vec3::new(1.0, 2.0, 3.0) * f64::from(i)).collect();
        assert!(matches!(plane(&line), Err(PlaneError::Collinear { .. })));
        assert!(matches!(plane(&line[..2]), Err(PlaneError::TooFewPoints { found: 2 })));
        assert!(matches!(plane(&[Vec3::zeros(); 4]), Err(PlaneError::Collinear { .. })));
    }
}
