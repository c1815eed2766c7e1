//! Frames, rigid transforms and small rotations. Vectors are `nalgebra::Vector3<f64>` in mm.

mod rigid;

pub use rigid::{Rigid, small_rotation};

/// A vector in three-space, mm (or rad for a small rotation vector).
pub type Vec3 = nalgebra::Vector3<f64>;
/// A rotation matrix.
pub type Mat3 = nalgebra::Matrix3<f64>;

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
