//! Frames, rigid transforms and small rotations. Vectors are `nalgebra::Vector3<f64>` in mm.

mod rigid;

use core::f64::consts::TAU;

pub use rigid::{Rigid, small_rotation};

/// A vector in three-space, mm (or rad for a small rotation vector).
pub type Vec3 = nalgebra::Vector3<f64>;
/// A rotation matrix.
pub type Mat3 = nalgebra::Matrix3<f64>;

/// Largest angle between neighbours around a circle, rad; a full turn without any.
pub fn largest_gap(angles: impl IntoIterator<Item = f64>) -> f64 {
    let mut angles: Vec<f64> = angles.into_iter().map(|a| a.rem_euclid(TAU)).collect();
    angles.sort_by(f64::total_cmp);
    let inner = angles.windows(2).map(|w| w[1] - w[0]).fold(0.0, f64::max);
    match (angles.first(), angles.last()) {
        (Some(first), Some(last)) => inner.max(TAU - (last - first)),
        _ => TAU,
    }
}

/// The unit vector of a direction index (0 = x, 1 = y, 2 = z).
///
/// # Panics
/// Where `direction` is above 2.
#[must_use]
pub fn unit(direction: usize) -> Vec3 {
    let mut v = Vec3::zeros();
    v[direction] = 1.0;
    v
}

/// The exact rotation by `angle_rad` about a coordinate direction, right-handed.
#[must_use]
pub fn rotation_about(direction: usize, angle_rad: f64) -> Mat3 {
    let (s, c) = angle_rad.sin_cos();
    match direction {
        0 => Mat3::new(1.0, 0.0, 0.0, 0.0, c, -s, 0.0, s, c),
        1 => Mat3::new(c, 0.0, s, 0.0, 1.0, 0.0, -s, 0.0, c),
        _ => Mat3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0),
    }
}

/// The rotation vector of a rotation matrix: axis times angle, rad.
///
/// # Source  Rodrigues; exact for angles below pi, series below 1e-8.
#[must_use]
pub fn rotation_vector(r: &Mat3) -> Vec3 {
    let w = Vec3::new(r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)]) * 0.5;
    let sine = w.norm();
    let cosine = (r.trace() - 1.0) * 0.5;
    if sine < 1e-8 && cosine > 0.0 {
        return w;
    }
    w * (sine.atan2(cosine) / sine)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_reach_over_the_end_of_the_turn() {
        let gap = |deg: &[f64]| largest_gap(deg.iter().map(|d| d.to_radians())).to_degrees();
        assert!((gap(&[10.0, -20.0, 350.0, 100.0]) - 240.0).abs() < 1e-9);
        assert!((gap(&[0.0, 90.0, 180.0, 270.0]) - 90.0).abs() < 1e-9);
        assert!((gap(&[45.0]) - 360.0).abs() < 1e-9 && (gap(&[]) - 360.0).abs() < 1e-9);
    }
}
