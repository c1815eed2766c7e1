//! Nine-line method: six error motions of a linear axis from displacement and straightness along lines parallel to it.
//!
//! Three lines with displacement, two with one straightness, one with the other are the classic nine readings of three
//! axes, 6 per axis. Here any set of (line, direction) readings is taken: with more than six the fit is tested.
//! For X: `dx_j = EX + EB z_j - EC y_j`, `dy_j = EY + EC x_t - EA z_j`, `dz_j = EZ - EB x_t + EA y_j`.
//!
//! Assumptions: targets ride on the carriage at fixed carriage coordinates; readings are actual minus nominal.
//! Source: equations 5.7.

use nalgebra::{Matrix6, Vector6};

use super::primitives::jacobi;
use super::twist::{self, Row};
use crate::core::geometry::{Vec3, unit};

/// One reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineReading {
    /// Carriage coordinates of the target, mm.
    pub target: Vec3,
    /// Direction of the reading: 0 = x, 1 = y, 2 = z.
    pub direction: usize,
    /// Actual minus nominal displacement, mm.
    pub value: f64,
    /// Standard deviation, mm.
    pub sigma: f64,
}

/// The six error motions at one position.
#[derive(Debug, Clone, PartialEq)]
pub struct NineLine {
    /// EX EY EZ (mm, at the carriage origin) EA EB EC (rad).
    pub motion: Vector6<f64>,
    /// Covariance of these.
    pub covariance: Matrix6<f64>,
    /// Sum of squared weighted residuals.
    pub chi2: f64,
    /// Readings minus six.
    pub dof: usize,
    /// Condition number of the unweighted equations, angles scaled by [`ANGLE_SCALE`].
    pub condition_scaled: f64,
    /// Weighted residuals, in units of their standard deviation.
    pub residuals: Vec<f64>,
}

/// Length by which angles become comparable to displacements in the condition number, mm.
pub const ANGLE_SCALE: f64 = 100.0;
/// Condition number above which the lines are refused.
pub const CONDITION_LIMIT: f64 = 1e4;

/// Why the readings give no six error motions.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NineLineError {
    /// A combination of the six stays free.
    #[error(
        "the readings determine {rank} of six error motions; free is {}: {readings} readings need displacement on three lines that are not in one plane with each other, one straightness on two lines apart in the other direction, and the second straightness on one",
        twist::words(unobservable)
    )]
    Deficient {
        /// Combinations that are determined.
        rank: usize,
        /// Readings given.
        readings: usize,
        /// A combination that is not.
        unobservable: Vector6<f64>,
    },
    /// The lines are nearly in one plane.
    #[error("condition {condition:.1e} exceeds the limit of {limit:.0e}: the three lines are nearly in one plane; move one away", limit = CONDITION_LIMIT)]
    IllConditioned {
        /// The condition number.
        condition: f64,
    },
    /// A standard deviation that is not above zero.
    #[error("reading {reading}: standard deviation {value} mm is not above 0")]
    Sigma {
        /// 1-based reading.
        reading: usize,
        /// The value.
        value: f64,
    },
}

/// Solves one position.
///
/// # Errors
/// Readings that leave a combination free, lines nearly in one plane.
///
/// # Source  equations 5.7
pub fn solve(readings: &[LineReading]) -> Result<NineLine, NineLineError> {
    if let Some(i) = readings.iter().position(|r| !(r.sigma.is_finite() && r.sigma > 0.0)) {
        return Err(NineLineError::Sigma { reading: i + 1, value: readings[i].sigma });
    }
    let rows: Vec<Row> =
        readings.iter().map(|r| Row::along(&unit(r.direction), &r.target, r.value, r.sigma)).collect();
    let fit = twist::solve(&rows).map_err(|d| NineLineError::Deficient {
        rank: d.rank,
        readings: readings.len(),
        unobservable: d.unobservable.first().copied().unwrap_or_else(Vector6::zeros),
    })?;
    let condition_scaled = condition(readings);
    if condition_scaled > CONDITION_LIMIT {
        return Err(NineLineError::IllConditioned { condition: condition_scaled });
    }
    Ok(NineLine {
        motion: fit.value,
        covariance: fit.covariance,
        chi2: fit.chi2,
        dof: fit.dof,
        condition_scaled,
        residuals: fit.residuals,
    })
}

/// Condition number of the unweighted design.
fn condition(readings: &[LineReading]) -> f64 {
    let design = nalgebra::DMatrix::from_fn(readings.len(), 6, |i, j| {
        let row = twist::design(&unit(readings[i].direction), &readings[i].target);
        if j < 3 { row[j] } else { row[j] / ANGLE_SCALE }
    });
    jacobi::svd(&design).condition()
}
