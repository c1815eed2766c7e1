//! Circle in space: plane by orthogonal distance, projection, circle by orthogonal distance.
//!
//! Source: equations 5.4.

use crate::prelude::*;

use super::ball::{Ball, BallError, circle_2d};
use super::plane::{Plane, PlaneError, plane};

/// A circle in space. Lengths in mm.
#[derive(Debug, Clone, PartialEq)]
pub struct SpaceCircle {
    /// Centre.
    pub centre: Vec3,
    /// Unit normal of its plane.
    pub normal: Vec3,
    /// Radius.
    pub radius: f64,
    /// Covariance of the centre for coordinates of unit variance.
    pub centre_cofactor: Mat3,
    /// Covariance of the normal (a rotation vector in the plane) for coordinates of unit variance.
    pub normal_cofactor: Mat3,
    /// Standard deviation of the radius for coordinates of unit standard deviation.
    pub radius_std: f64,
    /// Root of the mean squared distance from the circle within the plane.
    pub rms_radial: f64,
    /// Root of the mean squared distance from the plane.
    pub rms_axial: f64,
    /// Noise of a coordinate estimated from both distances; `None` without redundancy.
    pub sigma: Option<f64>,
    /// Angle that the points cover, rad: a full turn minus the largest gap between neighbours.
    pub arc: f64,
    /// Number of points.
    pub points: usize,
    /// Condition number of the circle.
    pub condition: f64,
}

/// Why no circle in space can be found.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum SpaceCircleError {
    /// No plane.
    #[error(transparent)]
    Plane(#[from] PlaneError),
    /// No circle in the plane.
    #[error(transparent)]
    Circle(#[from] BallError),
}

impl SpaceCircle {
    /// The same circle with its normal on the side of `direction`.
    #[must_use]
    pub fn facing(mut self, direction: &Vec3) -> Self {
        if self.normal.dot(direction) < 0.0 {
            self.normal = -self.normal;
        }
        self
    }

    /// True where the points go all around evenly: no gap is three times the mean one; of three or four, none is half as wide again.
    #[must_use]
    pub fn is_full(&self) -> bool {
        let turn = core::f64::consts::TAU;
        let widest = if self.points < 5 { 1.5 } else { 3.0 };
        turn - self.arc < widest * turn / self.points as f64
    }
}

/// Fits a circle in space.
///
/// # Errors
/// Fewer than three points, points on a line, an arc too short to have a centre.
///
/// # Source  equations 5.4
pub fn space_circle(points: &[Vec3]) -> Result<SpaceCircle, SpaceCircleError> {
    let p = plane(points)?;
    let flat: Vec<[f64; 2]> = points.iter().map(|x| p.axes.map(|a| a.dot(&(x - p.centroid)))).collect();
    let circle = circle_2d(&flat)?;
    let [u, v] = p.axes;
    let centre = p.centroid + u * circle.centre[0] + v * circle.centre[1];
    let n = points.len();
    let sum = n as f64 * (circle.rms.powi(2) + p.rms.powi(2));
    let redundancy = 2 * n - 6;
    Ok(SpaceCircle {
        centre,
        normal: p.normal,
        radius: circle.radius,
        centre_cofactor: centre_cofactor(&p, &circle, n),
        // a tilt about one axis is seen by the spread along the other
        normal_cofactor: (u * u.transpose() / p.spread[1].powi(2) + v * v.transpose() / p.spread[0].powi(2))
            / n as f64,
        radius_std: circle.radius_std(1.0),
        rms_radial: circle.rms,
        rms_axial: p.rms,
        sigma: (redundancy > 0).then(|| (sum / redundancy as f64).sqrt()),
        arc: covered(&flat, &circle),
        points: n,
        condition: circle.condition,
    })
}

/// In the plane as the circle says; along the normal as the plane is known at the centre.
fn centre_cofactor(p: &Plane, circle: &Ball<2>, n: usize) -> Mat3 {
    let [u, v] = p.axes;
    let c = &circle.centre_cofactor;
    let axial = (1.0 + (circle.centre[0] / p.spread[0]).powi(2) + (circle.centre[1] / p.spread[1]).powi(2))
        / n as f64;
    u * u.transpose() * c[(0, 0)]
        + (u * v.transpose() + v * u.transpose()) * c[(0, 1)]
        + v * v.transpose() * c[(1, 1)]
        + p.normal * p.normal.transpose() * axial
}

/// A full turn minus the largest gap.
fn covered(flat: &[[f64; 2]], circle: &Ball<2>) -> f64 {
    let [x, y] = [circle.centre[0], circle.centre[1]];
    TAU - largest_gap(flat.iter().map(|p| (p[1] - y).atan2(p[0] - x)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arc(turn: f64, n: usize) -> Vec<Vec3> {
        let axis = Vec3::new(0.3, -0.2, 0.9).normalize();
        let u = axis.cross(&Vec3::x()).normalize();
        let v = axis.cross(&u);
        (0..n)
            .map(|i| {
                let (s, c) = (turn * i as f64 / n as f64).sin_cos();
                Vec3::new(2000.0, -300.0, 40.0) + (u * c + v * s) * 45.0
            })
            .collect()
    }

    #[test]
    fn centre_normal_and_arc() {
        let full = space_circle(&arc(core::f64::consts::TAU, 36)).unwrap();
        assert!((full.centre - Vec3::new(2000.0, -300.0, 40.0)).norm() < 1e-10);
        assert!((full.radius - 45.0).abs() < 1e-10 && full.is_full());
        let axis = Vec3::new(0.3, -0.2, 0.9).normalize();
        assert!((full.clone().facing(&axis).normal - axis).norm() < 1e-12);
        assert!((full.facing(&-axis).normal + axis).norm() < 1e-12);
        let half = space_circle(&arc(core::f64::consts::PI, 36)).unwrap();
        assert!(!half.is_full() && (half.arc - core::f64::consts::PI * 35.0 / 36.0).abs() < 1e-9);
    }

    #[test]
    fn uncertainty_of_a_full_circle() {
        let n = 36.0;
        let full = space_circle(&arc(core::f64::consts::TAU, 36)).unwrap();
        let [u, _] = [full.normal.cross(&Vec3::x()).normalize(), Vec3::zeros()];
        let in_plane: f64 = (u.transpose() * full.centre_cofactor * u)[0];
        assert!((in_plane.sqrt() - (2.0f64 / n).sqrt()).abs() < 1e-9, "{in_plane}");
        let along: f64 = (full.normal.transpose() * full.centre_cofactor * full.normal)[0];
        assert!((along - 1.0 / n).abs() < 1e-9, "{along}");
        let tilt: f64 = (u.transpose() * full.normal_cofactor * u)[0];
        assert!((tilt.sqrt() - (2.0f64 / n).sqrt() / 45.0).abs() < 1e-9);
    }

    #[test]
    fn a_line_and_a_short_arc_are_refused() {
        assert!(space_circle(&arc(1e-5, 20)).is_err());
        assert!(matches!(
            space_circle(&arc(1.0, 2)),
            Err(SpaceCircleError::Plane(PlaneError::TooFewPoints { found: 2 }))
        ));
    }
}
