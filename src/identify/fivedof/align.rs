//! Alignment of a run by its end points: the beams are never exactly parallel to the axis, nor to each other.
//!
//! The lines through the end points are taken out of the sideways motions of both corner cubes. What two beams that are
//! not parallel add to roll is a line, too; only a level that reads the true roll at both ends tells it from roll that
//! grows. Without a level, roll has no slope: it is either left out or stated about its end points. The straightnesses are
//! about the end points in any case.
//!
//! Source: equations 5.2 (alignment), 4.2 ((6) and (11)).

use super::{FiveDof, Head, Readings};
use crate::straightness::{Line, Rule};
use volcomp_model::statistics::hull;

/// What fixes the slope of roll.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Level {
    /// Change of roll from the lowest to the highest position as a level read it, rad, about the axis.
    Read(f64),
    /// No level: roll is stated about its end points.
    None,
}

/// An aligned run.
#[derive(Debug, Clone, PartialEq)]
pub struct Aligned {
    /// EY EZ EA EB EC at each position, straightness and roll aligned, in laser coordinates.
    pub motion: Vec<[f64; 5]>,
    /// Slopes (y, z) taken out of beam 1 and beam 2, mm per mm.
    pub slopes: [[f64; 2]; 2],
    /// Slope of roll that the beams alone would have shown, minus the true one, rad per mm.
    pub roll_slope: f64,
}

/// Why a run cannot be aligned.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum AlignError {
    /// Nothing to draw a line through.
    #[error("{found} positions between different ends; an alignment needs at least 3")]
    TooFew {
        /// Positions.
        found: usize,
    },
}

/// The stretch between the corner cubes over a run: beyond the noise the carriage bends, or the drift correction is wrong.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    /// RMS about a straight line, mm.
    pub rms: f64,
    /// What the noise explains of it, mm; 0 where that is not known.
    pub expected: f64,
    /// True where it is within the noise, or that is not known.
    pub is_rigid: bool,
}

impl Stretch {
    /// Of a run; positions mm.
    #[must_use]
    pub fn of(positions: &[f64], reduced: &[FiveDof], head: &Head, readings: &[Readings]) -> Self {
        let stretch: Vec<f64> = reduced.iter().map(|r| r.stretch).collect();
        let Ok(line) = Line::fit(positions, &stretch, Rule::LeastSquares) else {
            return Self { rms: 0.0, expected: 0.0, is_rigid: true };
        };
        let dof = (positions.len() as f64 - 2.0).max(1.0);
        let rms = (line.deviations(positions, &stretch).iter().map(|v| v * v).sum::<f64>() / dof).sqrt();
        let n = readings.len() as f64;
        let expected =
            (readings.iter().map(|r| head.stretch_std(r.distance).powi(2)).sum::<f64>() / n).sqrt();
        let limit = expected * (1.0 + 3.0 / (2.0 * reduced.len() as f64).sqrt());
        Self { rms, expected, is_rigid: expected == 0.0 || rms <= limit }
    }
}

/// Takes the lines through the end points out of a run; positions in any order, the reference is the lowest one.
///
/// # Errors
/// Fewer than three positions.
///
/// # Source  equations 5.2
pub fn align(head: &Head, positions: &[f64], run: &[FiveDof], level: Level) -> Result<Aligned, AlignError> {
    let [low, high] = hull(positions.iter().copied());
    if positions.len() < 3 || positions.len() != run.len() || high <= low {
        return Err(AlignError::TooFew { found: positions.len() });
    }
    let mean_at = |x: f64| -> [[f64; 2]; 2] {
        let there: Vec<&FiveDof> =
            positions.iter().zip(run).filter(|(p, _)| **p == x).map(|(_, r)| r).collect();
        let n = there.len() as f64;
        std::array::from_fn(|j| std::array::from_fn(|i| there.iter().map(|r| r.beams[j][i]).sum::<f64>() / n))
    };
    let (first, last) = (mean_at(low), mean_at(high));
    let [[y1, z1], [y2, z2]] = head.beams;
    let true_roll = match level {
        Level::Read(roll) => roll,
        Level::None => 0.0,
    };
    // beam 2 gets no slope; beam 1 keeps what the true roll moves it against beam 2
    let kept = [[-true_roll * (z1 - z2), true_roll * (y1 - y2)], [0.0; 2]];
    let slopes: [[f64; 2]; 2] = std::array::from_fn(|j| {
        std::array::from_fn(|i| (last[j][i] - first[j][i] - kept[j][i]) / (high - low))
    });
    let motion: Vec<[f64; 5]> = positions
        .iter()
        .zip(run)
        .map(|(x, r)| {
            let beams: [[f64; 2]; 2] = std::array::from_fn(|j| {
                std::array::from_fn(|i| r.beams[j][i] - first[j][i] - slopes[j][i] * (x - low))
            });
            let roll = head.roll(&beams);
            // the straightness of the point itself is stated about its own end points
            let bow = roll - true_roll * (x - low) / (high - low);
            [beams[1][0] + bow * z2, beams[1][1] - bow * y2, roll, r.motion[3], r.motion[4]]
        })
        .collect();
    let seen = head.roll(&last) - head.roll(&first);
    Ok(Aligned { motion, slopes, roll_slope: (seen - true_roll) / (high - low) })
}
