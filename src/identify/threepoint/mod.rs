//! Six error motions of a linear axis from three or more points on its carriage, found in space by a laser tracker.
//!
//! A point with platform coordinates p_i is found at P_i; nominally it would be at o + p_i, o the platform origin at
//! this position of the axis. `D_i = P_i - o - p_i = d + eps x p_i` is solved by least squares with the inverse
//! covariances as weights; all 3n equations are used, the 3n - 6 redundant ones test whether the body is rigid.
//!
//! Frames: everything in M (axes of the machine). Platform coordinates are parallel to M.
//! Assumptions: the error motion is small (first order; [`PoseErrors::rigid`] is exact), noise is normal.
//!
//! Source: equations 5.1. Reading order: this file, `geometry` (can the points determine it), `series` (positions of
//! an axis), `rigidity` (rigidity without any nominal geometry), `tracker` (observations to points), `plan` (points and runs).

mod geometry;
mod plan;
mod rigidity;
mod series;
mod tracker;

use crate::prelude::*;

pub use geometry::{CONDITION_LIMIT, Geometry, geometry};
pub use plan::{POINTS_MAX, Plan, PlanError, PlanRequest, PlanRow, plan};
pub use rigidity::{Side, Sides, sides};
pub use series::{Series, SeriesError, SeriesFit, Shot, solve as solve_series};
pub use tracker::{Observation, TrackerNoise};

use super::primitives::{procrustes, rigid};
use super::twist::{self, Sighting};

/// One point seen once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Platform coordinates, mm.
    pub platform: Vec3,
    /// Where it was found, in M, mm.
    pub measured: Vec3,
    /// Covariance of that, mm2.
    pub covariance: Mat3,
}

/// The error motions at one position.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseErrors {
    /// EX EY EZ (mm, at the platform origin) EA EB EC (rad); linear model, weighted.
    pub motion: Vector6<f64>,
    /// Covariance of these.
    pub covariance: Matrix6<f64>,
    /// Sum of squared weighted residuals.
    pub chi2: f64,
    /// 3n - 6.
    pub dof: usize,
    /// Probability that noise alone exceeds `chi2`.
    pub p_value: f64,
    /// The same six by the best rigid motion (orthogonal Procrustes, unweighted, angles of Rz Ry Rx).
    pub rigid: Vector6<f64>,
    /// Measured minus fitted position of every point, mm.
    pub residuals: Vec<Vec3>,
    /// How much `chi2` falls where a point may be anywhere, for every point.
    pub relief: Vec<f64>,
    /// What the points can determine.
    pub geometry: Geometry,
}

/// Why the points give no six error motions.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ThreePointError {
    /// Too few points, or points on a line.
    #[error("{}", deficient(*points, *rank, line.as_ref()))]
    Deficient {
        /// Points given.
        points: usize,
        /// Combinations that they determine.
        rank: usize,
        /// Direction of the line through the points, where there is one.
        line: Option<Vec3>,
    },
    /// The points lie nearly on a line.
    #[error(
        "the points lie nearly on a line: condition {condition:.0} exceeds the limit of {limit:.0}; rms distance from the line {off_line_mm:.3} mm, the rotation about ({:.3} {:.3} {:.3}) is {roll_growth:.0} times less certain than the others; move a point away from the line",
        line.x, line.y, line.z, limit = CONDITION_LIMIT
    )]
    IllConditioned {
        /// Condition number about the centroid.
        condition: f64,
        /// Rms distance of the points from their line, mm.
        off_line_mm: f64,
        /// Standard deviation of the rotation about the line over that of the others.
        roll_growth: f64,
        /// Direction of the line.
        line: Vec3,
    },
    /// A covariance that cannot be inverted.
    #[error("the covariance of point {point} is not positive definite; standard deviations must be above 0")]
    Covariance {
        /// 1-based point.
        point: usize,
    },
    /// A coordinate that is no number.
    #[error("point {point} is not finite")]
    NotFinite {
        /// 1-based point.
        point: usize,
    },
}

fn deficient(points: usize, rank: usize, line: Option<&Vec3>) -> String {
    match line {
        Some(l) => format!(
            "{points} points on one line determine {rank} of six error motions; the rotation about the line ({:.3} {:.3} {:.3}) is not observable; add a point beside it",
            l.x, l.y, l.z
        ),
        None => format!(
            "{points} points in one place determine {rank} of six error motions; three points that are not on a line are needed"
        ),
    }
}

/// Solves one position; EX EY EZ hold at the platform origin, which nominally is at `origin` (M, mm).
///
/// # Errors
/// Fewer than three points, points (nearly) on a line, covariances that cannot be inverted.
///
/// # Source  equations 5.1
pub fn solve(points: &[Seen], origin: &Vec3) -> Result<PoseErrors, ThreePointError> {
    if let Some(i) = points.iter().position(|p| !p.platform.iter().chain(&p.measured).all(|v| v.is_finite()))
    {
        return Err(ThreePointError::NotFinite { point: i + 1 });
    }
    let platform: Vec<Vec3> = points.iter().map(|p| p.platform).collect();
    let geometry = geometry(&platform);
    geometry.check(points.len())?;
    // about the centroid displacement and rotation decouple, which keeps all digits
    let centroid = geometry.centroid;
    let sightings: Vec<Sighting> = points
        .iter()
        .map(|p| Sighting {
            point: p.platform - centroid,
            displacement: p.measured - origin - p.platform,
            covariance: p.covariance,
        })
        .collect();
    let rows = twist::rows_of(&sightings).map_err(|i| ThreePointError::Covariance { point: i + 1 })?;
    let fit = twist::solve(&rows).map_err(|d| ThreePointError::Deficient {
        points: points.len(),
        rank: d.rank,
        line: Some(geometry.line),
    })?;
    let (motion, covariance) = twist::moved(&fit.value, &fit.covariance, &-centroid);
    let residuals = sightings.iter().map(|s| s.displacement - displacement(&fit.value, &s.point)).collect();
    let measured: Vec<Vec3> = points.iter().map(|p| p.measured - origin).collect();
    let rigid = rigid_errors(&platform, &measured).ok_or(ThreePointError::Deficient {
        points: points.len(),
        rank: geometry.rank,
        line: Some(geometry.line),
    })?;
    Ok(PoseErrors {
        motion,
        covariance,
        chi2: fit.chi2,
        dof: fit.dof,
        p_value: chi_square_upper(fit.chi2, fit.dof),
        rigid,
        residuals,
        relief: relief(&rows, &fit),
        geometry,
    })
}

/// `d + eps x p`.
fn displacement(motion: &Vector6<f64>, point: &Vec3) -> Vec3 {
    let eps = Vec3::new(motion[3], motion[4], motion[5]);
    Vec3::new(motion[0], motion[1], motion[2]) + eps.cross(point)
}

/// The best rigid motion as six numbers.
fn rigid_errors(platform: &[Vec3], measured: &[Vec3]) -> Option<Vector6<f64>> {
    let (rotation, translation) = procrustes(platform, measured)?;
    let angles = rigid::angles_of(&rotation);
    Some(Vector6::new(translation.x, translation.y, translation.z, angles.x, angles.y, angles.z))
}

/// By how much the sum of squares falls when one point is set free: the mean-shift test, three rows at a time.
///
/// With w the whitened residuals and H the hat matrix, it is `w_i^T (I - H_ii)^+ w_i`; with three points two directions
/// of it are left, with more three.
fn relief(rows: &[twist::Row], fit: &twist::TwistFit) -> Vec<f64> {
    let residual = |i: usize| Vec3::from_fn(|k, _| fit.residuals[3 * i + k]);
    (0..rows.len() / 3)
        .map(|i| {
            let free = nalgebra::DMatrix::from_fn(3, 3, |a, b| {
                let (ra, rb) = (&rows[3 * i + a], &rows[3 * i + b]);
                f64::from(u8::from(a == b)) - (ra.design.transpose() * fit.covariance * rb.design)[0]
            });
            let svd = super::primitives::jacobi::svd(&free);
            let w = residual(i);
            let solution = svd.solve(&nalgebra::DVector::from_column_slice(w.as_slice()), 1e-9);
            (0..3).map(|k| w[k] * solution[k]).sum()
        })
        .collect()
}

impl PoseErrors {
    /// The motion with EX EY EZ at another point of the platform (platform coordinates, mm).
    #[must_use]
    pub fn at(&self, reference: &Vec3) -> (Vector6<f64>, Matrix6<f64>) {
        twist::moved(&self.motion, &self.covariance, reference)
    }

    /// The point whose freedom would explain most of the misfit: its index, and by what factor less misfit is left
    /// than with the next one set free.
    #[must_use]
    pub fn suspect(&self) -> Option<(usize, f64)> {
        suspect(&self.relief, self.chi2)
    }
}

/// The point with the largest relief; its lead is the misfit left with the next one free over that left with it free.
fn suspect(relief: &[f64], chi2: f64) -> Option<(usize, f64)> {
    let mut order: Vec<usize> = (0..relief.len()).collect();
    order.sort_by(|a, b| relief[*b].total_cmp(&relief[*a]));
    match order.as_slice() {
        [first, second, ..] => {
            // rounding must not make a lead infinite
            let left = |i: usize| (chi2 - relief[i]).max(1e-9 * chi2);
            let lead = if chi2 > 0.0 { left(*second) / left(*first) } else { 1.0 };
            Some((*first, lead))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests;
