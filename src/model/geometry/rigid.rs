//! A rigid transform `v -> R v + p`.

use super::{Mat3, Vec3, rotation_about};

/// A rigid transform; `a.then_inner(b)` maps a point through `b` first, then `a` (matrix product `A B`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rigid {
    /// Rotation matrix.
    pub rotation: Mat3,
    /// Translation, mm.
    pub translation: Vec3,
}

impl Rigid {
    /// A pure translation, mm.
    #[must_use]
    pub fn shift(translation: Vec3) -> Self {
        Self { rotation: Mat3::identity(), translation }
    }

    /// A rotation about the line through `point` (mm).
    #[must_use]
    pub fn turn_about(rotation: Mat3, point: Vec3) -> Self {
        Self { rotation, translation: point - rotation * point }
    }

    /// The matrix product `self * inner`: `inner` acts first.
    #[must_use]
    pub fn then_inner(&self, inner: &Self) -> Self {
        Self {
            rotation: self.rotation * inner.rotation,
            translation: self.rotation * inner.translation + self.translation,
        }
    }

    /// The inverse, `[R^T, -R^T p]`.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rt = self.rotation.transpose();
        Self { rotation: rt, translation: -(rt * self.translation) }
    }

    /// The image of a point, mm.
    #[must_use]
    pub fn apply(&self, point: &Vec3) -> Vec3 {
        self.rotation * point + self.translation
    }
}

/// `R(eps) = Rz(eC) Ry(eB) Rx(eA)`, exact.
///
/// # Source  equations 1.6.
#[must_use]
pub fn small_rotation(eps: &Vec3) -> Mat3 {
    rotation_about(2, eps.z) * rotation_about(1, eps.y) * rotation_about(0, eps.x)
}

#[cfg(test)]
mod tests {
    use super::super::rotation_vector;
    use super::*;

    #[test]
    fn inverse_undoes() {
        let t = Rigid {
            rotation: small_rotation(&Vec3::new(0.3, -1.1, 2.0)),
            translation: Vec3::new(1.0, -2.0, 3.0),
        };
        let p = Vec3::new(-4.0, 5.5, 0.25);
        assert!((t.inverse().apply(&t.apply(&p)) - p).norm() < 1e-14);
    }

    #[test]
    fn rotation_vector_of_an_axis_turn() {
        for angle in [-3.0, -1e-9, 0.0, 1e-12, 1e-4, 1.0, 3.0] {
            let v = rotation_vector(&rotation_about(1, angle));
            assert!((v - Vec3::new(0.0, angle, 0.0)).norm() < 1e-12, "{angle}: {v}");
        }
    }
}
