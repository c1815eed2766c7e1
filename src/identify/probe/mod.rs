//! Calibration of a touch probe on a gauge bar: the circle that the ball's centre draws while it touches the bar.
//!
//! The probe sits on an arm of length `L_R` that swings about B: `Z_i = L_R sin(B_i - B_c)`. While it touches a bar of
//! radius `R_bar` along x at the places `(Y_i, Z_i)`, its centre lies on a circle of radius `R_c`; the effective radius
//! of the ball is `r_c = R_c - R_bar`, whatever its nominal radius is.
//!
//! Two fits: algebraic (Kasa, on centred data) and geometric (least distances, which counts). The uncertainty follows
//! from the distances of the points from the circle, taken as independent and equal along the normal of contact. Where
//! the probe reaches one side of the bar only, centre and radius are correlated: 1 um of noise becomes 4 um and more,
//! which the covariance says and a note repeats.
//!
//! Source: equations 4.1 ((4) to (9), the arc), 5.4.

use crate::prelude::*;

use nalgebra::{Matrix3, Vector3};

use super::primitives::{BallError, Circle2, circle_2d};
use volcomp_model::statistics::SIGNIFICANT;

/// The arm and the bar. Lengths mm, angles rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arm {
    /// Distance of the ball's centre from the B axis.
    pub length: f64,
    /// Angle of B at which the ball stands level with the B axis.
    pub zero: f64,
}

/// A place of contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Coordinate of Y, mm.
    pub y: f64,
    /// Height of the ball's centre over the B axis, mm.
    pub z: f64,
}

/// What is asked of the calibration.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Request {
    /// Noise of a contact along its normal, mm, where known; tested against the distances found.
    pub sigma: Option<f64>,
    /// Take out contacts that lie off the circle by more than the noise allows.
    pub reject_outliers: bool,
}

/// A circle in the plane of Y and Z, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    /// Centre, Y.
    pub y0: f64,
    /// Centre, Z.
    pub z0: f64,
    /// Radius `R_c`.
    pub radius: f64,
}

/// Whether the distances suit the noise that was stated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitTest {
    /// Sum of squared distances over the variance stated.
    pub chi2: f64,
    /// Probability of this or more.
    pub p_value: f64,
}

/// What the user should know.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Note {
    /// The contacts cover little of the circle: centre and radius are far less sure than the noise.
    OneSided {
        /// Arc that holds all contacts, rad.
        arc: f64,
        /// Standard deviation of the radius over that of a full circle with as many contacts.
        amplification: f64,
    },
    /// The distances are larger than the stated noise explains.
    MoreThanNoise {
        /// Probability of such distances.
        p_value: f64,
    },
}

/// A calibrated probe. Lengths mm, k = 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Algebraic circle through the contacts that were kept.
    pub kasa: Circle,
    /// Geometric circle through the contacts that were kept.
    pub geometric: Circle,
    /// Effective radius of the ball from the geometric circle.
    pub probe_radius: f64,
    /// The same from the algebraic circle.
    pub probe_radius_kasa: f64,
    /// Root of the mean squared distance from the geometric circle, over n.
    pub rms_radial: f64,
    /// Noise of a contact: the stated one, else (and where these are significantly larger) from the distances over n - 3; `None`
    /// without redundancy.
    pub sigma: Option<f64>,
    /// Covariance of Y0, Z0, R_c for a noise of 1 mm.
    pub cofactor: Matrix3<f64>,
    /// Degrees of freedom behind `sigma`; `None` where it was stated.
    pub dof: Option<usize>,
    /// Test against the stated noise.
    pub test: Option<FitTest>,
    /// Arc that holds all contacts, rad.
    pub arc: f64,
    /// Condition number of the normal matrix of `[Y Z 1]` before centring: why the data are centred.
    pub condition_raw_normal: f64,
    /// Distance of every contact given from the geometric circle, also of those taken out.
    pub residuals: Vec<f64>,
    /// Contacts off the circle by more than noise, 0-based; taken out where asked for.
    pub outliers: Vec<usize>,
    /// What the user should know.
    pub notes: Vec<Note>,
}

/// Why a probe cannot be calibrated.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ProbeError {
    /// A length that must be above zero.
    #[error("{what} is {value} mm; it must be above 0")]
    NotPositive {
        /// Which length.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// The circle is not determined.
    #[error(transparent)]
    Circle(#[from] BallError),
    /// The contacts cover so little of the bar that noise decides.
    #[error(
        "the contacts cover {arc_deg:.1} deg of the bar; noise in the radius is {amplification:.0} times that of a full circle, the limit is {limit:.0}: touch the bar from both sides"
    )]
    ArcTooShort {
        /// Arc that holds all contacts.
        arc_deg: f64,
        /// Standard deviation of the radius over that of a full circle with as many contacts.
        amplification: f64,
        /// Largest amplification accepted.
        limit: f64,
    },
    /// The circle of contact is smaller than the bar.
    #[error(
        "the circle of contact has a radius of {radius:.4} mm, not more than the bar with {bar} mm; is the bar's radius (not its diameter) given, and the arm's length right?"
    )]
    SmallerThanBar {
        /// Radius found.
        radius: f64,
        /// Radius of the bar.
        bar: f64,
    },
    /// Too many contacts would have to be taken out.
    #[error(
        "{found} of {contacts} contacts lie off the circle, the limit is {limit}; something is loose or the shape is not a circle"
    )]
    TooManyOutliers {
        /// Contacts off the circle.
        found: usize,
        /// Contacts given.
        contacts: usize,
        /// Most that may be taken out.
        limit: usize,
    },
}

/// Standard deviation of the radius over that of a full circle, above which the contacts are called one-sided.
const ONE_SIDED: f64 = 2.5;
/// Above this the calibration is refused: an arc of about 20 degrees.
const AMPLIFICATION_LIMIT: f64 = 300.0;
/// Distance in standard deviations beyond which a contact is no noise: 7 in a million.
const OUTLIER: f64 = 4.5;
/// Redundancy below which outliers are not distinguishable from noise.
const OUTLIER_DOF: usize = 15;
/// Largest share of contacts that may be taken out.
const OUTLIER_SHARE: f64 = 0.1;

impl Arm {
    /// The place of the ball's centre at contact, from the readings of Y (mm) and B (rad).
    ///
    /// # Source  equations 4.1, (4): B right-handed about +y, arm towards -x
    #[must_use]
    pub fn contact(&self, y: f64, b: f64) -> Contact {
        Contact { y, z: self.length * (b - self.zero).sin() }
    }
}

impl Calibration {
    /// Covariance of Y0, Z0, R_c, mm^2; `None` without redundancy or stated noise.
    #[must_use]
    pub fn covariance(&self) -> Option<Matrix3<f64>> {
        self.sigma.map(|s| self.cofactor * (s * s))
    }

    /// Half width of a 95 % interval in standard deviations.
    #[must_use]
    pub fn coverage_95(&self) -> f64 {
        self.dof.map_or(1.96, student_95)
    }
}

/// Calibrates a probe.
///
/// # Errors
/// Fewer than three contacts, contacts on too short an arc, a bar that is larger than the circle of contact.
///
/// # Source  equations 4.1, 5.4
pub fn calibrate(
    contacts: &[Contact],
    bar_radius: f64,
    request: &Request,
) -> Result<Calibration, ProbeError> {
    if !(bar_radius.is_finite() && bar_radius > 0.0) {
        return Err(ProbeError::NotPositive { what: "the radius of the bar", value: bar_radius });
    }
    if let Some(value) = request.sigma.filter(|s| !(s.is_finite() && *s > 0.0)) {
        return Err(ProbeError::NotPositive { what: "the noise", value });
    }
    let mut kept: Vec<usize> = (0..contacts.len()).collect();
    let mut outliers = Vec::new();
    let (circle, points) = loop {
        let points: Vec<[f64; 2]> = kept.iter().map(|&i| [contacts[i].y, contacts[i].z]).collect();
        let circle = circle_2d(&points)?;
        let found = worst(&circle, &points, request.sigma);
        match found {
            Some(worst) if request.reject_outliers => outliers.push(kept.remove(worst)),
            _ => break (circle, points),
        }
        let limit = (contacts.len() as f64 * OUTLIER_SHARE) as usize;
        if outliers.len() > limit {
            return Err(ProbeError::TooManyOutliers {
                found: outliers.len(),
                contacts: contacts.len(),
                limit,
            });
        }
    };
    if !request.reject_outliers {
        outliers = all_outliers(&circle, &points, request.sigma);
    }
    outliers.sort_unstable();
    finish(contacts, &circle, &points, bar_radius, request, outliers)
}

fn finish(
    contacts: &[Contact],
    circle: &Circle2,
    points: &[[f64; 2]],
    bar_radius: f64,
    request: &Request,
    outliers: Vec<usize>,
) -> Result<Calibration, ProbeError> {
    let n = points.len() as f64;
    let [y0, z0] = [circle.centre[0], circle.centre[1]];
    let arc = TAU - largest_gap(points.iter().map(|[y, z]| (z - z0).atan2(y - y0)));
    let amplification = (circle.radius_cofactor * n).sqrt();
    if amplification > AMPLIFICATION_LIMIT {
        let (arc_deg, limit) = (arc.to_degrees(), AMPLIFICATION_LIMIT);
        return Err(ProbeError::ArcTooShort { arc_deg, amplification, limit });
    }
    let geometric = Circle { y0: circle.centre[0], z0: circle.centre[1], radius: circle.radius };
    if geometric.radius <= bar_radius {
        return Err(ProbeError::SmallerThanBar { radius: geometric.radius, bar: bar_radius });
    }
    let kasa = kasa(points).ok_or(BallError::Degenerate { dimensions: 2, condition: f64::INFINITY })?;
    let dof = points.len() - 3;
    let test = request.sigma.map(|s| {
        let chi2 = n * (circle.rms / s).powi(2);
        FitTest { chi2, p_value: chi_square_upper(chi2, dof) }
    });
    let failed = test.filter(|t| t.p_value < SIGNIFICANT);
    let stated = request.sigma.filter(|_| failed.is_none());
    let mut notes = Vec::new();
    if amplification > ONE_SIDED {
        notes.push(Note::OneSided { arc, amplification });
    }
    if let Some(FitTest { p_value, .. }) = failed {
        notes.push(Note::MoreThanNoise { p_value });
    }
    Ok(Calibration {
        kasa,
        geometric,
        probe_radius: geometric.radius - bar_radius,
        probe_radius_kasa: kasa.radius - bar_radius,
        rms_radial: circle.rms,
        sigma: stated.or(circle.sigma),
        cofactor: cofactor(circle),
        dof: stated.is_none().then_some(dof),
        test,
        arc,
        condition_raw_normal: condition_raw_normal(contacts),
        residuals: contacts.iter().map(|c| distance(circle, &[c.y, c.z])).collect(),
        outliers,
        notes,
    })
}

/// Centre and radius in one matrix.
fn cofactor(circle: &Circle2) -> Matrix3<f64> {
    let (c, cr) = (&circle.centre_cofactor, &circle.centre_radius_cofactor);
    Matrix3::from_fn(|i, j| match (i, j) {
        (2, 2) => circle.radius_cofactor,
        (2, k) | (k, 2) => cr[k],
        at => c[at],
    })
}

/// Distance of a point from the circle.
fn distance(circle: &Circle2, p: &[f64; 2]) -> f64 {
    (p[0] - circle.centre[0]).hypot(p[1] - circle.centre[1]) - circle.radius
}

/// Externally studentised distances: each over what it would be expected to be from all others.
fn studentised(circle: &Circle2, points: &[[f64; 2]], sigma: Option<f64>) -> Vec<f64> {
    let (cofactor, n) = (cofactor(circle), points.len());
    let sum: f64 = points.iter().map(|p| distance(circle, p).powi(2)).sum();
    let one = |p: &[f64; 2]| {
        let d = distance(circle, p);
        let (dy, dz) = (p[0] - circle.centre[0], p[1] - circle.centre[1]);
        let row = Vector3::new(dy, dz, dy.hypot(dz)) / dy.hypot(dz);
        let free = (1.0 - (row.transpose() * cofactor * row)[0]).max(1e-12);
        let variance = sigma.map_or_else(|| (sum - d * d / free) / (n - 4) as f64, |s| s * s);
        d / (variance * free).sqrt()
    };
    points.iter().map(one).collect()
}

/// The contact farthest off, where it is off by more than noise.
fn worst(circle: &Circle2, points: &[[f64; 2]], sigma: Option<f64>) -> Option<usize> {
    if points.len() < OUTLIER_DOF + 3
        || circle.rms <= f64::EPSILON * (circle.centre.norm() + circle.radius) * 4.0
    {
        return None;
    }
    let off = studentised(circle, points, sigma);
    let (index, largest) = off.iter().enumerate().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
    (largest.abs() > OUTLIER).then_some(index)
}

fn all_outliers(circle: &Circle2, points: &[[f64; 2]], sigma: Option<f64>) -> Vec<usize> {
    if worst(circle, points, sigma).is_none() {
        return Vec::new();
    }
    let off = studentised(circle, points, sigma);
    (0..points.len()).filter(|&i| off[i].abs() > OUTLIER).collect()
}

/// Algebraic circle: least squares of `y^2 + z^2 - 2 y Y0 - 2 z Z0 - k` on centred and scaled data.
fn kasa(points: &[[f64; 2]]) -> Option<Circle> {
    let n = points.len() as f64;
    let mean = [0, 1].map(|k| points.iter().map(|p| p[k]).sum::<f64>() / n);
    let spread = points.iter().map(|p| (p[0] - mean[0]).powi(2) + (p[1] - mean[1]).powi(2)).sum::<f64>();
    let scale = (spread / n).sqrt();
    let at = |i: usize, k: usize| (points[i][k] - mean[k]) / scale;
    let design = DMatrix::from_fn(points.len(), 3, |i, j| if j < 2 { 2.0 * at(i, j) } else { 1.0 });
    let squares = DVector::from_fn(points.len(), |i, _| at(i, 0).powi(2) + at(i, 1).powi(2));
    let (q, r) = design.qr().unpack();
    let found = r.solve_upper_triangular(&q.tr_mul(&squares))?;
    let (y, z) = (found[0], found[1]);
    let radius = (found[2] + y * y + z * z).sqrt() * scale;
    let circle = Circle { y0: mean[0] + y * scale, z0: mean[1] + z * scale, radius };
    (circle.radius.is_finite() && circle.y0.is_finite() && circle.z0.is_finite()).then_some(circle)
}

/// Square of the condition number of `[Y Z 1]`: that of its normal matrix, without forming it.
fn condition_raw_normal(contacts: &[Contact]) -> f64 {
    let design = DMatrix::from_fn(contacts.len(), 3, |i, j| [contacts[i].y, contacts[i].z, 1.0][j]);
    jacobi::svd(&design).condition().powi(2)
}

#[cfg(test)]
mod tests;
