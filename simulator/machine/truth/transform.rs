//! Rigid motions as full 4x4 homogeneous matrices, in mm and rad.
//!
//! Nothing here is linearised: every angle goes through sine and cosine. Convention: column vectors, a matrix maps
//! coordinates of the frame on its right to the frame on its left.

use nalgebra::{Matrix3, Matrix4, Vector3};

/// A motion without rotation.
#[must_use]
pub fn translation(mm: [f64; 3]) -> Matrix4<f64> {
    Matrix4::new_translation(&Vector3::from(mm))
}

/// Right-handed rotation about the direction x (0), y (1) or z (2) through the origin.
#[must_use]
pub fn rotation_about(direction: usize, angle_rad: f64) -> Matrix4<f64> {
    let (s, c) = angle_rad.sin_cos();
    match direction {
        0 => Matrix4::new(1., 0., 0., 0., 0., c, -s, 0., 0., s, c, 0., 0., 0., 0., 1.),
        1 => Matrix4::new(c, 0., s, 0., 0., 1., 0., 0., -s, 0., c, 0., 0., 0., 0., 1.),
        _ => Matrix4::new(c, -s, 0., 0., s, c, 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.),
    }
}

/// `Rz(c) Ry(b) Rx(a)` of a small rotation (a, b, c).
#[must_use]
pub fn rotation_zyx(angles_rad: [f64; 3]) -> Matrix4<f64> {
    let [a, b, c] = angles_rad;
    rotation_about(2, c) * rotation_about(1, b) * rotation_about(0, a)
}

/// The motion seen from a frame moved to `point_mm`: Trans(P) M Trans(-P).
#[must_use]
pub fn about_point(point_mm: [f64; 3], motion: &Matrix4<f64>) -> Matrix4<f64> {
    translation(point_mm) * motion * translation(point_mm.map(|v| -v))
}

/// Inverse of a rigid motion: [R^T, -R^T p].
#[must_use]
pub fn inverse(motion: &Matrix4<f64>) -> Matrix4<f64> {
    let transposed = rotation_part(motion).transpose();
    let shift = -(transposed * translation_part(motion));
    let mut result = transposed.to_homogeneous();
    result.fixed_view_mut::<3, 1>(0, 3).copy_from(&shift);
    result
}

/// The rotation of a rigid motion.
#[must_use]
pub fn rotation_part(motion: &Matrix4<f64>) -> Matrix3<f64> {
    motion.fixed_view::<3, 3>(0, 0).into_owned()
}

/// Where a rigid motion takes the origin.
#[must_use]
pub fn translation_part(motion: &Matrix4<f64>) -> Vector3<f64> {
    motion.fixed_view::<3, 1>(0, 3).into_owned()
}

/// The rotation vector (axis times angle) of a rotation below half a turn.
#[must_use]
pub fn rotation_vector(rotation: &Matrix3<f64>) -> [f64; 3] {
    let r = rotation;
    let twice = Vector3::new(r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)]);
    let sine = twice.norm() / 2.0;
    let angle = sine.atan2((r.trace() - 1.0) / 2.0);
    let scale = if sine > 0.0 { angle / sine } else { 1.0 };
    (twice * (scale / 2.0)).into()
}

/// The angles (a, b, c) of a rotation written as `Rz(c) Ry(b) Rx(a)`, for b below a quarter turn.
#[must_use]
pub fn angles_zyx(rotation: &Matrix3<f64>) -> [f64; 3] {
    let r = rotation;
    let a = r[(2, 1)].atan2(r[(2, 2)]);
    let b = (-r[(2, 0)]).atan2(r[(2, 1)].hypot(r[(2, 2)]));
    let c = r[(1, 0)].atan2(r[(0, 0)]);
    [a, b, c]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn angles_and_vector_undo_the_rotation(a in -1.2..1.2f64, b in -1.2..1.2f64, c in -1.2..1.2f64) {
            let r = rotation_part(&rotation_zyx([a, b, c]));
            let back = angles_zyx(&r);
            prop_assert!((back[0] - a).abs() + (back[1] - b).abs() + (back[2] - c).abs() < 1e-13);
            let vector = Vector3::from(rotation_vector(&r));
            let again = nalgebra::Rotation3::new(vector);
            prop_assert!((again.matrix() - r).norm() < 1e-12);
        }

        #[test]
        fn inverse_undoes_the_motion(a in -3.0..3.0f64, b in -3.0..3.0f64, x in -900.0..900.0f64) {
            let m = translation([x, -2.0 * x, 3.0]) * rotation_zyx([a, b, -a]);
            prop_assert!((m * inverse(&m) - Matrix4::identity()).norm() < 1e-11);
        }
    }

    #[test]
    fn rotations_are_right_handed() {
        let quarter = std::f64::consts::FRAC_PI_2;
        for (direction, from, to) in [(0, 1, 2), (1, 2, 0), (2, 0, 1)] {
            let turned = rotation_part(&rotation_about(direction, quarter)) * Vector3::ith(from, 1.0);
            assert!((turned - Vector3::ith(to, 1.0)).norm() < 1e-15);
        }
    }

    #[test]
    fn a_point_on_the_axis_stays() {
        let turned = about_point([10.0, 20.0, 5.0], &rotation_about(2, 1.0));
        let kept = turned * nalgebra::Vector4::new(10.0, 20.0, -70.0, 1.0);
        assert!((kept - nalgebra::Vector4::new(10.0, 20.0, -70.0, 1.0)).norm() < 1e-12);
    }
}
