//! All positions of an axis: six error motions at each, and one test of rigidity over all.
//!
//! Source: equations 5.1 per position; 1.2 for the displacement of a carriage on the workpiece side.

use super::{PoseErrors, Seen, ThreePointError, solve as solve_pose, suspect};
use crate::motion::MotionRow;
use crate::prelude::*;
use volcomp_model::statistics::SIGNIFICANT;

/// The points seen once at one position.
#[derive(Debug, Clone, PartialEq)]
pub struct Shot {
    /// Programmed coordinate, mm.
    pub position: f64,
    /// Which repetition.
    pub cycle: u32,
    /// Direction of approach.
    pub travel: Travel,
    /// Which point of the carriage each of `seen` is.
    pub ids: Vec<usize>,
    /// The points, in M.
    pub seen: Vec<Seen>,
}

/// How the axis carries the points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Series {
    /// The axis that moves.
    pub axis: AxisName,
    /// True where its carriage is on the workpiece side and moves by minus the programmed coordinate.
    pub workpiece_side: bool,
    /// Platform origin in M at home, mm.
    pub origin: Vec3,
    /// The platform point at which EX EY EZ are wanted, platform coordinates, mm.
    pub reference: Vec3,
}

/// All positions solved.
#[derive(Debug, Clone, PartialEq)]
pub struct SeriesFit {
    /// The carriage's own motion at the reference, in the order of the shots.
    pub rows: Vec<MotionRow>,
    /// Each position on its own, at the platform origin.
    pub poses: Vec<PoseErrors>,
    /// Sum of squared weighted residuals over all.
    pub chi2: f64,
    /// Its degrees of freedom.
    pub dof: usize,
    /// Probability that noise alone exceeds it.
    pub p_value: f64,
    /// Root of `chi2/dof`: true noise over stated noise; `None` without redundancy.
    pub noise_factor: Option<f64>,
    /// The carriage point that explains most of the misfit, and by what factor less is left than with the next one.
    pub suspect: Option<(usize, f64)>,
}

impl SeriesFit {
    /// Where the residuals are larger than the stated noise, or none was stated, the covariances follow the residuals.
    pub fn scale_by_misfit(&mut self, noise_is_stated: bool) {
        let Some(factor) = self.noise_factor else { return };
        let factor = if noise_is_stated { factor.max(1.0) } else { factor };
        for row in &mut self.rows {
            row.covariance *= factor * factor;
        }
    }

    /// Positions that fail the test on their own, with their rows.
    fn failures(&self) -> impl Iterator<Item = (usize, &PoseErrors)> {
        self.poses.iter().enumerate().filter(|(_, p)| p.p_value < SIGNIFICANT)
    }

    /// Number of positions that fail the test on their own.
    #[must_use]
    pub fn failing(&self) -> usize {
        self.failures().count()
    }

    /// Index of the row that fails most.
    #[must_use]
    pub fn worst_row(&self) -> Option<usize> {
        self.failures().max_by(|a, b| a.1.chi2.total_cmp(&b.1.chi2)).map(|(i, _)| i)
    }

    /// Largest difference of the linear and the rigid model, mm and rad. On unweighted data it has no meaning where weights
    /// differ; here it bounds both causes together.
    #[must_use]
    pub fn linear_against_rigid(&self) -> (f64, f64) {
        self.poses.iter().fold((0.0, 0.0), |(d, e), p| {
            let difference = p.motion - p.rigid;
            (d.max(difference.fixed_rows::<3>(0).amax()), e.max(difference.fixed_rows::<3>(3).amax()))
        })
    }
}

/// A position that cannot be solved.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("position {position} mm (row {row}): {reason}")]
pub struct SeriesError {
    /// 1-based shot.
    pub row: usize,
    /// Its position, mm.
    pub position: f64,
    /// Why.
    pub reason: ThreePointError,
}

/// Solves all positions of an axis.
///
/// # Errors
/// The first position at which the points do not determine the motion.
pub fn solve(shots: &[Shot], series: &Series) -> Result<SeriesFit, SeriesError> {
    let sign = if series.workpiece_side { -1.0 } else { 1.0 };
    let direction = unit(series.axis.direction());
    let points = shots.iter().flat_map(|s| &s.ids).max().map_or(0, |i| i + 1);
    let mut fit = SeriesFit {
        rows: Vec::with_capacity(shots.len()),
        poses: Vec::with_capacity(shots.len()),
        chi2: 0.0,
        dof: 0,
        p_value: 1.0,
        noise_factor: None,
        suspect: None,
    };
    let mut relief = vec![0.0; points];
    for (i, shot) in shots.iter().enumerate() {
        let origin = series.origin + direction * (sign * shot.position);
        let pose = solve_pose(&shot.seen, &origin).map_err(|reason| SeriesError {
            row: i + 1,
            position: shot.position,
            reason,
        })?;
        let (motion, covariance) = pose.at(&series.reference);
        fit.rows.push(MotionRow {
            position: shot.position,
            cycle: shot.cycle,
            travel: shot.travel,
            motion,
            covariance,
        });
        for (id, r) in shot.ids.iter().zip(&pose.relief) {
            relief[*id] += r;
        }
        fit.chi2 += pose.chi2;
        fit.dof += pose.dof;
        fit.poses.push(pose);
    }
    fit.p_value = chi_square_upper(fit.chi2, fit.dof);
    fit.noise_factor = (fit.dof > 0).then(|| (fit.chi2 / fit.dof as f64).sqrt());
    fit.suspect = suspect(&relief, fit.chi2);
    Ok(fit)
}
