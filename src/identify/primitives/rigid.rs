//! Rigid motion that carries one set of points onto another, of any size of rotation.
//!
//! Unweighted: orthogonal Procrustes (Kabsch), exact. Weighted: Gauss-Newton from there; rotation is updated from the
//! left, so the covariance belongs to (translation of the centroid's image, small rotation vector in the target frame).
//!
//! Source: equations 5.1 (exact alternative); registration of a tracker to the machine: equations 4.0.

use crate::prelude::*;

use super::twist::{self, Deficient, Sighting, cross_matrix};
use volcomp_model::statistics::ChiSquare;

/// A rigid motion `x -> rotation x + translation` found from points.
#[derive(Debug, Clone, PartialEq)]
pub struct RigidFit {
    /// Rotation.
    pub rotation: Mat3,
    /// Translation, mm.
    pub translation: Vec3,
    /// The point of the target frame at which the translation part of `covariance` holds: the centroid, mm.
    pub centre: Vec3,
    /// Covariance of displacement of the centre (mm) and rotation vector (rad), both in the target frame.
    pub covariance: Matrix6<f64>,
    /// Target minus image of each point, mm.
    pub residuals: Vec<Vec3>,
    /// Sum of squared whitened residuals.
    pub chi2: f64,
    /// Its degrees of freedom, 3n - 6.
    pub dof: usize,
}

/// Why no rigid motion can be found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RigidError {
    /// Different numbers of points.
    #[error("{from} points in one frame, {to} in the other; every reference point needs both")]
    Counts {
        /// Points of the first frame.
        from: usize,
        /// Points of the second.
        to: usize,
    },
    /// Fewer than three points, or points on a line.
    #[error("{points} reference points {}: the registration is not determined; add points away from {}", if *points < 3 { "are too few" } else { "lie nearly on a line" }, if *points < 3 { "each other" } else { "that line" })]
    Singular {
        /// Points given.
        points: usize,
    },
    /// A covariance that cannot be inverted.
    #[error("the covariance of reference point {point} is not positive definite")]
    Covariance {
        /// 1-based point.
        point: usize,
    },
}

impl RigidFit {
    /// The image of a point, mm.
    #[must_use]
    pub fn apply(&self, point: &Vec3) -> Vec3 {
        self.rotation * point + self.translation
    }

    /// The covariance of a point after the motion, from that before (mm2); the registration's own is not in it.
    #[must_use]
    pub fn turn(&self, covariance: &Mat3) -> Mat3 {
        self.rotation * covariance * self.rotation.transpose()
    }

    /// Root mean square of a residual coordinate, mm.
    #[must_use]
    pub fn rms(&self) -> f64 {
        let sum: f64 = self.residuals.iter().map(Vec3::norm_squared).sum();
        (sum / (3.0 * self.residuals.len() as f64)).sqrt()
    }

    /// The point with the largest residual, and its length, mm.
    #[must_use]
    pub fn worst(&self) -> (usize, f64) {
        let lengths = self.residuals.iter().map(Vec3::norm).enumerate();
        lengths.fold((0, 0.0), |m, r| if r.1 > m.1 { r } else { m })
    }

    /// The test of the residuals against the noise that went in.
    #[must_use]
    pub const fn test(&self) -> ChiSquare {
        ChiSquare { sum: self.chi2, dof: self.dof }
    }

    /// Noise of the residuals over the one that went in where that was exceeded, or where it was not stated.
    fn scale(&self, is_stated: bool) -> f64 {
        let factor = self.test().noise_factor().unwrap_or(1.0);
        if is_stated { factor.max(1.0) } else { factor }
    }

    /// Standard deviations: of the centre (mm) and of the three rotations (rad), by stated noise or by the residuals.
    #[must_use]
    pub fn std(&self, is_stated: bool) -> [f64; 6] {
        core::array::from_fn(|i| self.scale(is_stated) * self.covariance[(i, i)].sqrt())
    }

    /// What the registration does to the image of a point: standard deviation of its largest direction, mm, as in [`Self::std`].
    #[must_use]
    pub fn std_at(&self, image: &Vec3, is_stated: bool) -> f64 {
        self.scale(is_stated) * self.covariance_at(image).symmetric_eigenvalues().max().sqrt()
    }

    /// What the uncertainty of the registration does to the image of a point: covariance, mm2.
    #[must_use]
    pub fn covariance_at(&self, image: &Vec3) -> Mat3 {
        let lever = cross_matrix(&(image - self.centre));
        let c = &self.covariance;
        let (tt, tr, rr) = (
            c.fixed_view::<3, 3>(0, 0).into_owned(),
            c.fixed_view::<3, 3>(0, 3).into_owned(),
            c.fixed_view::<3, 3>(3, 3).into_owned(),
        );
        // displacement = d + eps x r = d - [r]x eps
        tt - tr * lever.transpose() - lever * tr.transpose() + lever * rr * lever.transpose()
    }
}

/// Best rigid motion without weights: orthogonal Procrustes. `None` where the points do not determine the rotation.
///
/// # Source  equations 5.1; Kabsch 1976, with the determinant kept at +1
#[must_use]
pub fn procrustes(from: &[Vec3], to: &[Vec3]) -> Option<(Mat3, Vec3)> {
    let n = from.len().min(to.len());
    if n < 3 {
        return None;
    }
    let mean = |p: &[Vec3]| p[..n].iter().sum::<Vec3>() / n as f64;
    let (a, b) = (mean(from), mean(to));
    let (_, spread) = super::plane::spread(&from[..n], &a);
    if spread[1] <= SINGULAR * spread[0] || spread[0] == 0.0 {
        return None;
    }
    let cross: Mat3 = from.iter().zip(to).map(|(p, q)| (q - b) * (p - a).transpose()).sum();
    let svd = jacobi::svd(&nalgebra::DMatrix::from_fn(3, 3, |i, j| cross[(i, j)]));
    if svd.values[1] <= SINGULAR * SINGULAR * svd.values[0] {
        return None;
    }
    let column = |m: &nalgebra::DMatrix<f64>, k: usize| Vec3::from_fn(|i, _| m[(i, k)]);
    // the third pair follows from the first two, right-handed: no mirror image, and flat sets need no third value
    let [u, v] = [&svd.u, &svd.v].map(|m| {
        let (first, second) = (column(m, 0), column(m, 1));
        Mat3::from_columns(&[first, second, first.cross(&second)])
    });
    let start = u * v.transpose();
    // the SVD of squares is good to 1e-12 or so; one linear step takes out the rest
    let rotation = polish(from, to, &start, &a, &b);
    Some((rotation, b - rotation * a))
}

/// One Gauss-Newton step of the unweighted rotation about the centroids.
fn polish(from: &[Vec3], to: &[Vec3], rotation: &Mat3, a: &Vec3, b: &Vec3) -> Mat3 {
    let (mut normal, mut right) = (Mat3::zeros(), Vec3::zeros());
    for (p, q) in from.iter().zip(to) {
        let arm = rotation * (p - a);
        normal += Mat3::identity() * arm.norm_squared() - arm * arm.transpose();
        right += arm.cross(&((q - b) - arm));
    }
    normal.try_inverse().map_or(*rotation, |inverse| turned(&(inverse * right), rotation))
}

/// A rotation followed by a small one, kept orthogonal.
fn turned(step: &Vec3, rotation: &Mat3) -> Mat3 {
    nalgebra::Rotation3::from_scaled_axis(*step).into_inner() * rotation
}

/// Weighted registration: `to = R from + t`, with the covariance of each residual (mm2).
///
/// # Errors
/// Fewer than three points, points on a line, a covariance that cannot be inverted.
///
/// # Source  equations 5.1 applied to large rotations
pub fn register(from: &[Vec3], to: &[Vec3], covariance: &[Mat3]) -> Result<RigidFit, RigidError> {
    if from.len() != to.len() || from.len() != covariance.len() {
        return Err(RigidError::Counts { from: from.len(), to: to.len() });
    }
    let points = from.len();
    let singular = RigidError::Singular { points };
    let (mut rotation, mut translation) = procrustes(from, to).ok_or(singular.clone())?;
    let centre = to.iter().sum::<Vec3>() / points as f64;
    let mut fit = None;
    for _ in 0..ITERATIONS {
        let sightings: Vec<Sighting> = from
            .iter()
            .zip(to)
            .zip(covariance)
            .map(|((p, q), c)| {
                let image = rotation * p + translation;
                Sighting { point: image - centre, displacement: q - image, covariance: *c }
            })
            .collect();
        let rows = twist::rows_of(&sightings).map_err(|point| RigidError::Covariance { point: point + 1 })?;
        let step = twist::solve(&rows).map_err(|_: Deficient| singular.clone())?;
        let (shift, turn) = split(&step.value);
        rotation = turned(&turn, &rotation);
        // the step turns about the centre of the target
        translation = nalgebra::Rotation3::from_scaled_axis(turn) * (translation - centre) + centre + shift;
        let done = turn.norm() < 1e-15 && shift.norm() < 1e-13;
        fit = Some(step);
        if done {
            break;
        }
    }
    let Some(step) = fit else { return Err(singular) };
    let residuals: Vec<Vec3> = from.iter().zip(to).map(|(p, q)| q - (rotation * p + translation)).collect();
    Ok(RigidFit {
        rotation,
        translation,
        centre,
        covariance: step.covariance,
        residuals,
        chi2: step.chi2,
        dof: step.dof,
    })
}

/// Displacement and rotation of a six-vector.
fn split(v: &Vector6<f64>) -> (Vec3, Vec3) {
    (v.fixed_rows::<3>(0).into_owned(), v.fixed_rows::<3>(3).into_owned())
}

/// The angles of `Rz(C) Ry(B) Rx(A)`, rad.
///
/// # Source  equations 1.6
#[must_use]
pub fn angles_of(rotation: &Mat3) -> Vec3 {
    let r = rotation;
    let cosine = r[(0, 0)].hypot(r[(1, 0)]);
    Vec3::new(r[(2, 1)].atan2(r[(2, 2)]), (-r[(2, 0)]).atan2(cosine), r[(1, 0)].atan2(r[(0, 0)]))
}

/// Spread across a line, as a share of that along it, below which the turn about it is not determined.
const SINGULAR: f64 = 1e-6;
/// Steps of the weighted fit; it converges in four.
const ITERATIONS: usize = 12;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use volcomp_model::geometry::small_rotation;

    fn corners() -> Vec<Vec3> {
        [[0.0, 0.0, 0.0], [900.0, 20.0, 0.0], [30.0, 700.0, -5.0], [10.0, 40.0, 650.0], [800.0, 600.0, 20.0]]
            .map(Vec3::from)
            .to_vec()
    }

    proptest! {
        #[test]
        fn any_rotation_comes_back(a in -3.1..3.1f64, b in -1.5..1.5f64, c in -3.1..3.1f64, t in -5e3..5e3f64) {
            let angles = Vec3::new(a, b, c);
            let (rotation, shift) = (small_rotation(&angles), Vec3::new(t, -t, 0.3 * t));
            let to: Vec<Vec3> = corners().iter().map(|p| rotation * p + shift).collect();
            let weights: Vec<Mat3> = (1..=5).map(|k| Mat3::identity() * f64::from(k)).collect();
            let fit = register(&corners(), &to, &weights).unwrap();
            prop_assert!((fit.rotation - rotation).norm() < 1e-13);
            prop_assert!((fit.translation - shift).norm() < 1e-8);
            prop_assert!(fit.chi2 < 1e-20);
            prop_assert!((angles_of(&rotation) - angles).norm() < 1e-12);
        }
    }

    #[test]
    fn a_flat_triangle_is_not_mirrored() {
        let from = corners()[..3].to_vec();
        let rotation = small_rotation(&Vec3::new(2.9, 0.1, -1.0));
        let to: Vec<Vec3> = from.iter().map(|p| rotation * p).collect();
        let (found, _) = procrustes(&from, &to).unwrap();
        assert!((found - rotation).norm() < 1e-13 && (found.determinant() - 1.0).abs() < 1e-13);
    }

    #[test]
    fn a_bad_point_counts_by_its_weight() {
        let mut to = corners();
        to[4] += Vec3::new(1.0, 0.0, 0.0);
        let mut covariance = vec![Mat3::identity() * 1e-6; 5];
        covariance[4] = Mat3::identity() * 1e6;
        let fit = register(&corners(), &to, &covariance).unwrap();
        assert!((fit.residuals[4] - Vec3::new(1.0, 0.0, 0.0)).norm() < 1e-9, "{fit:?}");
        assert_eq!(fit.dof, 9);
    }

    #[test]
    fn uncertainty_grows_with_the_lever() {
        let covariance = vec![Mat3::identity() * 1e-6; 5];
        let fit = register(&corners(), &corners(), &covariance).unwrap();
        let near = fit.covariance_at(&fit.centre);
        assert!((near - Mat3::identity() * 1e-6 / 5.0).norm() < 1e-15);
        let far = fit.covariance_at(&(fit.centre + Vec3::new(0.0, 0.0, 1e4)));
        assert!(far[(0, 0)] > 50.0 * near[(0, 0)] && (far[(2, 2)] - near[(2, 2)]).abs() < 1e-12);
    }

    #[test]
    fn too_little_is_refused() {
        let identity = vec![Mat3::identity(); 5];
        let line: Vec<Vec3> = (0..5).map(|i| Vec3::new(100.0, 50.0, 1.0) * f64::from(i)).collect();
        assert_eq!(register(&line, &line, &identity), Err(RigidError::Singular { points: 5 }));
        let two = corners()[..2].to_vec();
        let error = register(&two, &two, &identity[..2]).unwrap_err();
        assert!(error.to_string().contains("2 reference points are too few"), "{error}");
        assert!(matches!(register(&two, &line, &identity), Err(RigidError::Counts { from: 2, to: 5 })));
    }
}
