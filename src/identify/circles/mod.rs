//! Tool axis and tip from two circles in space, which a target on the turning tool draws at two heights.
//!
//! Per circle: plane and circle by orthogonal distance. `a = (O1 - O2)/D`, `tip = O2 - a t`; circle 1 is the one farther
//! from the tip. Uncertainty: the full covariance of both centres, an uncertainty g between the frames of two trackers
//! adds `g/D` to the axis. Beside it, one joint fit of two coaxial circles (8 parameters), which also uses the planes;
//! it is better where `r > D/sqrt(2)`.
//!
//! Assumptions: the spindle turns truly within the noise; noise is isotropic and equal for all points of a circle.
//! Source: equations 5.4, 4.3.

use crate::prelude::*;

use super::primitives::{SpaceCircle, SpaceCircleError, space_circle};
use volcomp_model::statistics::ChiSquare;

/// What is measured and known.
#[derive(Debug, Clone, PartialEq)]
pub struct CirclesInput<'a> {
    /// Points of the circle farther from the tip, mm.
    pub points_1: &'a [Vec3],
    /// Points of the circle nearer to the tip, mm.
    pub points_2: &'a [Vec3],
    /// Direction of the axis as it should be, from the tip to the spindle.
    pub nominal_axis: Vec3,
    /// Distance of the tip beyond the second centre, mm.
    pub tip_beyond_centre_2: f64,
    /// Standard deviation of a coordinate, mm; `None` where unknown.
    pub sigma: Option<f64>,
    /// Standard deviation per direction of the offset between the frames of the two circles, mm.
    pub registration: f64,
}

/// Tool axis and tip.
#[derive(Debug, Clone, PartialEq)]
pub struct ToolAxis {
    /// Both circles, normals on the side of the axis.
    pub circles: [SpaceCircle; 2],
    /// Unit vector from the tip to the spindle.
    pub direction: Vec3,
    /// Tool tip, mm.
    pub tip: Vec3,
    /// `nominal x actual` direction: rotation vector of the direction error, rad.
    pub direction_error: Vec3,
    /// Distance of the centres, mm.
    pub distance: f64,
    /// Standard deviation of a coordinate taken for the covariances, mm: the stated one, else (and where these are significantly
    /// larger) from the residuals.
    pub sigma: f64,
    /// The residuals of both circles against the stated noise.
    pub residual_test: Option<ChiSquare>,
    /// Covariance of the direction (a vector across it), registration included.
    pub direction_covariance: Mat3,
    /// Covariance of the tip, mm2, registration included.
    pub tip_covariance: Mat3,
    /// Share of the direction's standard deviation that the registration makes, rad: g/D.
    pub registration_share: f64,
    /// Standard deviations of the closed formulas, where both circles are full.
    pub predicted: Option<Predicted>,
    /// The joint fit, where it converged.
    pub coaxial: Option<Coaxial>,
}

/// Closed formulas for full circles, without registration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Predicted {
    /// A coordinate of a centre in its plane, mm (the less certain circle).
    pub centre_in_plane: f64,
    /// A component of the direction across it, rad.
    pub direction: f64,
    /// The tip across the axis, mm.
    pub tip_lateral: f64,
}

/// Two coaxial circles fitted together.
#[derive(Debug, Clone, PartialEq)]
pub struct Coaxial {
    /// Unit vector of the axis.
    pub direction: Vec3,
    /// Tip, mm.
    pub tip: Vec3,
    /// Radii, mm.
    pub radii: [f64; 2],
    /// Standard deviation of a component of the direction across it, rad (the larger of two).
    pub direction_std: f64,
    /// Standard deviation of the tip across the axis, mm (the larger of two).
    pub tip_lateral_std: f64,
    /// Noise of a coordinate from the residuals, mm.
    pub sigma: f64,
    /// Probability that noise of the stated size makes the extra misfit of one common axis; `None` without stated noise.
    pub p_value: Option<f64>,
}

/// Why no axis results.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CirclesError {
    /// One of the circles.
    #[error("circle {circle}: {reason}")]
    Circle {
        /// 1 or 2.
        circle: usize,
        /// Why.
        reason: SpaceCircleError,
    },
    /// The centres are in one place.
    #[error(
        "the centres are {distance:.4} mm apart, not more than {limit:.1} times their uncertainty of {sigma:.4} mm: they have no line through them; measure the circles farther apart"
    )]
    CentresTogether {
        /// Distance, mm.
        distance: f64,
        /// Standard deviation of a centre, mm.
        sigma: f64,
        /// How many times it must be.
        limit: f64,
    },
    /// The axis found points away from the nominal one.
    #[error(
        "the axis is {angle_deg:.1} deg from the nominal one, more than {limit_deg} deg: are the circles exchanged (1 is farther from the tip), or is the nominal axis in another frame?"
    )]
    Direction {
        /// Angle between them, deg.
        angle_deg: f64,
        /// Largest taken for real, deg.
        limit_deg: f64,
    },
    /// A nominal axis without direction, a negative noise.
    #[error("{what} {value} is out of range")]
    Input {
        /// What.
        what: &'static str,
        /// Its value.
        value: f64,
    },
}

/// Centres must be this many standard deviations apart.
const APART: f64 = 10.0;
/// Angle to the nominal axis above which something is exchanged, deg.
const LARGEST_ANGLE_DEG: f64 = 45.0;

/// Finds the tool axis and the tip.
///
/// # Errors
/// Points that determine no circle, centres too close together, an axis far from the nominal one.
///
/// # Source  equations 5.4
pub fn solve(input: &CirclesInput<'_>) -> Result<ToolAxis, CirclesError> {
    let nominal = check(input)?;
    let fit = |circle: usize, points: &[Vec3]| {
        space_circle(points).map_err(|reason| CirclesError::Circle { circle, reason })
    };
    let (one, two) = (fit(1, input.points_1)?, fit(2, input.points_2)?);
    let scatter = pooled(&one, &two);
    let against = |(stated, (std, dof)): (f64, (f64, usize))| ChiSquare::of_scatter(std, stated, dof);
    let residual_test = input.sigma.filter(|s| *s > 0.0).zip(scatter).map(against);
    let stated = input.sigma.filter(|_| !residual_test.is_some_and(ChiSquare::has_failed));
    let sigma = stated.or(scatter.map(|s| s.0)).unwrap_or(0.0);
    let input = &CirclesInput { sigma: stated, ..input.clone() };
    let between = one.centre - two.centre;
    let distance = between.norm();
    let of_centres = sigma * (one.centre_cofactor.trace().max(two.centre_cofactor.trace()) / 3.0).sqrt();
    let resolution = 1e-12 * one.centre.norm().max(two.centre.norm());
    if distance <= APART * of_centres.max(resolution) {
        return Err(CirclesError::CentresTogether { distance, sigma: of_centres, limit: APART });
    }
    let direction = between / distance;
    let angle_deg = direction.dot(&nominal).clamp(-1.0, 1.0).acos().to_degrees();
    if angle_deg > LARGEST_ANGLE_DEG {
        return Err(CirclesError::Direction { angle_deg, limit_deg: LARGEST_ANGLE_DEG });
    }
    let t = input.tip_beyond_centre_2;
    let across = Mat3::identity() - direction * direction.transpose();
    let offset = Mat3::identity() * input.registration.powi(2);
    let centres = [&one, &two].map(|c| c.centre_cofactor * sigma.powi(2));
    // tip = O2 - t a, and d a = across (dO1 - dO2)/D
    let of_two = Mat3::identity() + across * (t / distance);
    let of_one = across * (t / distance);
    let tip_covariance =
        of_two * centres[1] * of_two.transpose() + of_one * (centres[0] + offset) * of_one.transpose();
    let direction_covariance = across * (centres[0] + centres[1] + offset) * across / distance.powi(2);
    let predicted = (one.is_full() && two.is_full()).then(|| predicted(&one, &two, sigma, distance, t));
    Ok(ToolAxis {
        tip: two.centre - direction * t,
        direction_error: nominal.cross(&direction),
        coaxial: coaxial(input, &one, &two, &direction),
        circles: [one.facing(&direction), two.facing(&direction)],
        registration_share: input.registration / distance,
        direction,
        distance,
        sigma,
        residual_test,
        direction_covariance,
        tip_covariance,
        predicted,
    })
}

fn check(input: &CirclesInput<'_>) -> Result<Vec3, CirclesError> {
    for (what, value) in [("sigma", input.sigma.unwrap_or(0.0)), ("registration", input.registration)] {
        if !(value.is_finite() && value >= 0.0) {
            return Err(CirclesError::Input { what, value });
        }
    }
    if !input.tip_beyond_centre_2.is_finite() {
        return Err(CirclesError::Input { what: "tip distance", value: input.tip_beyond_centre_2 });
    }
    input
        .nominal_axis
        .try_normalize(1e-9)
        .filter(|v| v.iter().all(|c| c.is_finite()))
        .ok_or(CirclesError::Input { what: "length of the nominal axis", value: input.nominal_axis.norm() })
}

/// Noise of a coordinate from both circles, with its degrees of freedom.
fn pooled(one: &SpaceCircle, two: &SpaceCircle) -> Option<(f64, usize)> {
    let free = |c: &SpaceCircle| 2 * c.points - 6;
    let part = |c: &SpaceCircle| c.sigma.map_or((0.0, 0), |s| (free(c) as f64 * s * s, free(c)));
    let ((a, m), (b, n)) = (part(one), part(two));
    (m + n > 0).then(|| (((a + b) / (m + n) as f64).sqrt(), m + n))
}

fn predicted(one: &SpaceCircle, two: &SpaceCircle, sigma: f64, distance: f64, t: f64) -> Predicted {
    let centre = |c: &SpaceCircle| sigma * (2.0 / c.points as f64).sqrt();
    let (s1, s2) = (centre(one), centre(two));
    Predicted {
        centre_in_plane: s1.max(s2),
        direction: s1.hypot(s2) / distance,
        tip_lateral: (s2 * (1.0 + t / distance)).hypot(s1 * t / distance),
    }
}

impl ToolAxis {
    /// Standard deviations of the direction in its two least and most certain directions across it, rad.
    #[must_use]
    pub fn direction_std(&self) -> [f64; 2] {
        across_std(&self.direction_covariance, &self.direction)
    }

    /// Standard deviations of the tip across the axis, mm.
    #[must_use]
    pub fn tip_lateral_std(&self) -> [f64; 2] {
        let across = Mat3::identity() - self.direction * self.direction.transpose();
        across_std(&(across * self.tip_covariance * across), &self.direction)
    }
}

/// The two standard deviations across an axis, rising.
fn across_std(covariance: &Mat3, axis: &Vec3) -> [f64; 2] {
    let u = perpendicular(axis);
    let v = axis.cross(&u);
    let entry = |a: &Vec3, b: &Vec3| (a.transpose() * covariance * b)[0];
    let (p, q, r) = (entry(&u, &u), entry(&u, &v), entry(&v, &v));
    let (mean, half) = ((p + r) / 2.0, ((p - r) / 2.0).hypot(q));
    [(mean - half).max(0.0).sqrt(), (mean + half).max(0.0).sqrt()]
}

fn perpendicular(axis: &Vec3) -> Vec3 {
    let other = if axis.x.abs() < 0.6 { Vec3::x() } else { Vec3::y() };
    axis.cross(&other).normalize()
}

/// Gauss-Newton over axis direction (2), a point of the axis (2), positions along it (2) and radii (2).
fn coaxial(input: &CirclesInput<'_>, one: &SpaceCircle, two: &SpaceCircle, start: &Vec3) -> Option<Coaxial> {
    let mut direction = *start;
    let mut centres = [one.centre, two.centre];
    let mut radii = [one.radius, two.radius];
    let total = input.points_1.len() + input.points_2.len();
    let free = 2 * total - 8;
    if 2 * total <= 8 {
        return None;
    }
    let mut last = None;
    for _ in 0..50 {
        let (u, v) = (perpendicular(&direction), direction.cross(&perpendicular(&direction)));
        let origin = (centres[0] + centres[1]) / 2.0;
        let (design, misfit) = coaxial_rows(input, &centres, &radii, [&direction, &u, &v], &origin);
        let svd = jacobi::svd(&design);
        if svd.condition().is_nan() || svd.condition() > 1e9 {
            return None;
        }
        let step = svd.solve(&misfit, 0.0);
        let turned = (direction + u * step[0] + v * step[1]).normalize();
        for (k, c) in centres.iter_mut().enumerate() {
            let along = (*c - origin).dot(&direction) + step[4 + k];
            *c = origin + u * step[2] + v * step[3] + turned * along;
            radii[k] += step[6 + k];
        }
        direction = turned;
        let small = step[0].hypot(step[1]) < 1e-13 && step.rows_range(2..).amax() < 1e-10;
        last = Some((svd, misfit.norm_squared(), origin));
        if small {
            break;
        }
    }
    let (svd, sum, origin) = last?;
    let noise = (sum / free as f64).sqrt();
    let sigma = input.sigma.filter(|s| *s > 0.0);
    let taken = sigma.unwrap_or(noise);
    // the tip hangs on the axis at this distance from the origin of the parameters
    let lever = (centres[1] - origin).dot(&direction) - input.tip_beyond_centre_2;
    let direction_std = svd.cofactor(0, 0).max(svd.cofactor(1, 1)).sqrt();
    let lateral = |i: usize, j: usize| {
        (svd.cofactor(j, j) + 2.0 * lever * svd.cofactor(i, j) + lever * lever * svd.cofactor(i, i))
            .max(0.0)
            .sqrt()
    };
    let separate = |c: &SpaceCircle| c.points as f64 * (c.rms_radial.powi(2) + c.rms_axial.powi(2));
    Some(Coaxial {
        tip: centres[1] - direction * input.tip_beyond_centre_2,
        radii,
        direction_std: taken * direction_std,
        tip_lateral_std: taken * lateral(0, 2).max(lateral(1, 3)),
        sigma: noise,
        // two circles have 12 parameters, the coaxial pair 8
        p_value: sigma.map(|s| chi_square_upper((sum - separate(one) - separate(two)).max(0.0) / (s * s), 4)),
        direction,
    })
}

/// Two rows per point: distance from the plane, and from the circle within it.
fn coaxial_rows(
    input: &CirclesInput<'_>,
    centres: &[Vec3; 2],
    radii: &[f64; 2],
    [direction, u, v]: [&Vec3; 3],
    origin: &Vec3,
) -> (DMatrix<f64>, DVector<f64>) {
    let n = input.points_1.len() + input.points_2.len();
    let mut design = DMatrix::zeros(2 * n, 8);
    let mut misfit = DVector::zeros(2 * n);
    let all = input.points_1.iter().map(|p| (p, 0)).chain(input.points_2.iter().map(|p| (p, 1)));
    for (row, (p, k)) in all.enumerate() {
        let arm = p - centres[k];
        let along = arm.dot(direction);
        let (x, y) = (arm.dot(u), arm.dot(v));
        let radius = x.hypot(y);
        let (cosine, sine) = (x / radius, y / radius);
        let height = (centres[k] - origin).dot(direction);
        // the plane: distance along the axis; turning the axis carries the centre sideways and tilts the plane
        misfit[2 * row] = along;
        design.fixed_view_mut::<1, 2>(2 * row, 0).copy_from_slice(&[-x, -y]);
        design[(2 * row, 4 + k)] = 1.0;
        // the circle: outwards
        misfit[2 * row + 1] = radius - radii[k];
        let outwards = [cosine * (height + along), sine * (height + along), cosine, sine];
        design.fixed_view_mut::<1, 4>(2 * row + 1, 0).copy_from_slice(&outwards);
        design[(2 * row + 1, 6 + k)] = 1.0;
    }
    (design, misfit)
}

#[cfg(test)]
mod tests;
