//! What a set of points on a carriage can determine.
//!
//! Source: equations 5.1.

use crate::prelude::*;

use super::ThreePointError;
use crate::primitives::plane;
use crate::twist;

/// Rank, conditioning and shape of a set of points.
#[derive(Debug, Clone, PartialEq)]
pub struct Geometry {
    /// Mean of the points, platform coordinates, mm.
    pub centroid: Vec3,
    /// Root mean square distance of the points from it, mm.
    pub rms_radius: f64,
    /// Singular values of the unweighted design about the platform origin, angle columns divided by `rms_radius`.
    pub singular_values: [f64; 6],
    /// Largest over smallest of these.
    pub condition_scaled: f64,
    /// The same condition with EX EY EZ at the centroid: a matter of the shape of the points alone.
    pub condition_centroid: f64,
    /// Combinations of the six that are determined.
    pub rank: usize,
    /// Unit vector along the longest extent, from the first point towards the last.
    pub line: Vec3,
    /// Root mean square distance of the points from the line through their centroid, mm.
    pub off_line_rms: f64,
    /// Standard deviation of the rotation about `line` over the smaller of the other two; 1 for an even set.
    pub roll_growth: f64,
}

/// Condition number (about the centroid) above which points count as lying on a line.
pub const CONDITION_LIMIT: f64 = 1e3;
/// Condition number above which the loss of certainty is worth a warning.
pub(super) const CONDITION_NOTE: f64 = 20.0;
/// Singular values below this share of the largest count as zero.
const RANK_TOLERANCE: f64 = 1e-9;

/// Looks at a set of points (platform coordinates, mm). Any number of points, any shape.
#[must_use]
pub fn geometry(points: &[Vec3]) -> Geometry {
    let n = points.len().max(1) as f64;
    let centroid = points.iter().sum::<Vec3>() / n;
    let (directions, spread) = plane::spread(points, &centroid);
    let rms_radius = spread.iter().map(|s| s * s).sum::<f64>().sqrt();
    let scale = if rms_radius > 0.0 { rms_radius } else { 1.0 };
    let values_about = |origin: Vec3| {
        let design = DMatrix::from_fn(3 * points.len().max(2), 6, |i, j| {
            let Some(p) = points.get(i / 3) else { return 0.0 };
            let row = twist::design(&unit(i % 3), &(p - origin));
            if j < 3 { row[j] } else { row[j] / scale }
        });
        jacobi::svd(&design).values
    };
    let about_origin = values_about(Vec3::zeros());
    let about_centroid = values_about(centroid);
    let clean = |v: f64, largest: f64| if v > RANK_TOLERANCE * largest { v } else { 0.0 };
    let singular_values = core::array::from_fn(|k| clean(about_origin[k], about_origin[0]));
    let shape: [f64; 6] = core::array::from_fn(|k| clean(about_centroid[k], about_centroid[0]));
    // rank of shape: a far platform origin must not hide what the points can do
    let rank = shape.iter().filter(|v| **v > 0.0).count();
    let ends = match points {
        [first, .., last] => last - first,
        _ => Vec3::zeros(),
    };
    let line = if directions[0].dot(&ends) < 0.0 { -directions[0] } else { directions[0] };
    let off_line_rms = spread[1].hypot(spread[2]);
    Geometry {
        centroid,
        rms_radius,
        singular_values,
        condition_scaled: singular_values[0] / singular_values[5],
        condition_centroid: shape[0] / shape[5],
        rank,
        line,
        off_line_rms,
        // sigma of a rotation goes with 1 over the spread across its axis
        roll_growth: spread[0].hypot(spread[1]) / off_line_rms,
    }
}

impl Geometry {
    /// Refuses points that determine less than six, or the sixth hardly.
    pub(super) fn check(&self, points: usize) -> Result<(), ThreePointError> {
        if self.rank < 6 {
            let line = (self.rank == 5).then_some(self.line);
            return Err(ThreePointError::Deficient { points, rank: self.rank, line });
        }
        if self.condition_centroid > CONDITION_LIMIT {
            return Err(ThreePointError::IllConditioned {
                condition: self.condition_centroid,
                off_line_mm: self.off_line_rms,
                roll_growth: self.roll_growth,
                line: self.line,
            });
        }
        Ok(())
    }

    /// What the shape costs, in words, where it costs much.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        (self.condition_centroid > CONDITION_NOTE).then(|| {
            format!(
                "the points lie close to a line (rms {:.1} mm off it, condition {:.0}): the rotation about ({:.2} {:.2} {:.2}) is {:.1} times less certain than the others",
                self.off_line_rms, self.condition_centroid, self.line.x, self.line.y, self.line.z, self.roll_growth
            )
        })
    }
}
