//! Straightness and angles from a 6D interferometer: signs, runs, reference lines, reference points.
//!
//! Reading order: this file (reference lines), [`signs`] (from the channels of an instrument to the axes of the
//! machine, parity, tilt test), [`runs`] (both directions, reversal), [`levers`] (points at which components hold).
//!
//! A straightness is the range of the readings about a straight line. Three lines are in use, and they give
//! different numbers: least squares; through the end points; minimum zone, the line of the smallest vertical band
//! that holds all points, which is parallel to an edge of their convex hull. Minimum zone <= the other two. The slope
//! that a line takes out belongs to squareness (and to how the instrument was set up): curves of one machine must
//! all use one rule, by default the end points.
//!
//! Source: equations 5.6, 1.8.

pub mod levers;
pub mod runs;
pub mod signs;

use volcomp_model::statistics;

/// Which line a straightness refers to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// Smallest sum of squares.
    LeastSquares,
    /// Through the first and the last point.
    EndPoint,
    /// Smallest vertical band.
    MinimumZone,
}

impl Rule {
    /// All three.
    pub const ALL: [Self; 3] = [Self::LeastSquares, Self::EndPoint, Self::MinimumZone];

    /// Its name in reports and keys.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::LeastSquares => "least_squares",
            Self::EndPoint => "end_point",
            Self::MinimumZone => "minimum_zone",
        }
    }
}

/// A reference line `intercept + slope x` and the straightness about it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Value per position, rad where values are mm over mm.
    pub slope: f64,
    /// Value at position 0. Minimum zone: of the middle of the band.
    pub intercept: f64,
    /// Range of the readings about the line.
    pub straightness: f64,
    /// Standard deviation of the slope for readings of standard deviation 1.
    pub slope_std: f64,
}

/// Why there is no line.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum LineError {
    /// Not one value per position.
    #[error("{values} values for {positions} positions")]
    Length {
        /// Positions.
        positions: usize,
        /// Values.
        values: usize,
    },
    /// A number that is none.
    #[error("reading {row} is not finite")]
    NotFinite {
        /// 1-based reading.
        row: usize,
    },
    /// All readings at one place.
    #[error(
        "{found} distinct positions; a straight line needs 2, a straightness that says something 3 or more"
    )]
    TooFewPositions {
        /// Distinct positions.
        found: usize,
    },
}

impl Line {
    /// The lines of all rules.
    ///
    /// # Errors
    /// See [`Self::fit`].
    pub fn of_all_rules(x: &[f64], y: &[f64]) -> Result<Vec<(Rule, Self)>, LineError> {
        Rule::ALL.into_iter().map(|rule| Ok((rule, Self::fit(x, y, rule)?))).collect()
    }

    /// The reference line of `rule` through readings in any order.
    ///
    /// # Errors
    /// Fewer than two distinct positions, or numbers that are not finite.
    ///
    /// # Source  equations 5.6
    pub fn fit(x: &[f64], y: &[f64], rule: Rule) -> Result<Self, LineError> {
        if x.len() != y.len() {
            return Err(LineError::Length { positions: x.len(), values: y.len() });
        }
        if let Some(i) = x.iter().zip(y).position(|(x, y)| !(x.is_finite() && y.is_finite())) {
            return Err(LineError::NotFinite { row: i + 1 });
        }
        let [low, high] = statistics::hull(x.iter().copied());
        if x.is_empty() || high <= low {
            return Err(LineError::TooFewPositions { found: usize::from(!x.is_empty()) });
        }
        let line = match rule {
            Rule::LeastSquares => least_squares(x, y),
            Rule::EndPoint => end_point(x, y, low, high),
            Rule::MinimumZone => minimum_zone(x, y),
        };
        Ok(line)
    }

    /// Readings minus the line.
    #[must_use]
    pub fn deviations(&self, x: &[f64], y: &[f64]) -> Vec<f64> {
        x.iter().zip(y).map(|(x, y)| y - self.intercept - self.slope * x).collect()
    }
}

fn least_squares(x: &[f64], y: &[f64]) -> Line {
    let n = x.len() as f64;
    let (cx, cy) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let sxx: f64 = x.iter().map(|x| (x - cx).powi(2)).sum();
    let sxy: f64 = x.iter().zip(y).map(|(x, y)| (x - cx) * (y - cy)).sum();
    let slope = sxy / sxx;
    let [bottom, top] = band(x, y, slope);
    Line { slope, intercept: cy - slope * cx, straightness: top - bottom, slope_std: 1.0 / sxx.sqrt() }
}

/// Through the mean of the readings at either end.
fn end_point(x: &[f64], y: &[f64], low: f64, high: f64) -> Line {
    let mean_at = |end: f64| {
        let there: Vec<f64> = x.iter().zip(y).filter(|(x, _)| **x == end).map(|(_, y)| *y).collect();
        (there.iter().sum::<f64>() / there.len() as f64, 1.0 / there.len() as f64)
    };
    let ((first, var_first), (last, var_last)) = (mean_at(low), mean_at(high));
    let slope = (last - first) / (high - low);
    let [bottom, top] = band(x, y, slope);
    Line {
        slope,
        intercept: first - slope * low,
        straightness: top - bottom,
        slope_std: (var_first + var_last).sqrt() / (high - low),
    }
}

/// The exact minimum zone. The height of the band over its slope is convex with corners at the slopes of the hull's
/// edges; they are walked in order until the upper contact lies left of the lower one.
fn minimum_zone(x: &[f64], y: &[f64]) -> Line {
    let mut points: Vec<[f64; 2]> = x.iter().zip(y).map(|(x, y)| [*x, *y]).collect();
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let lower = hull(points.iter().copied());
    let upper: Vec<[f64; 2]> =
        hull(points.iter().map(|[x, y]| [*x, -y])).into_iter().map(|[x, y]| [x, -y]).collect();
    let slope_of = |a: &[f64; 2], b: &[f64; 2]| (b[1] - a[1]) / (b[0] - a[0]);
    // with the slope from minus to plus infinity the upper contact runs from right to left, the lower one from left
    // to right: upper edges are taken from the last, lower edges from the first
    let (mut u, mut l) = (upper.len() - 1, 0);
    let mut slope = f64::NEG_INFINITY;
    let mut contact = 1.0;
    while upper[u][0] > lower[l][0] {
        let next_upper = (u > 0).then(|| slope_of(&upper[u - 1], &upper[u]));
        let next_lower = (l + 1 < lower.len()).then(|| slope_of(&lower[l], &lower[l + 1]));
        match (next_upper, next_lower) {
            (Some(a), Some(b)) if a <= b => (slope, contact) = (a, upper[u][0] - upper[u - 1][0]),
            (Some(a), None) => (slope, contact) = (a, upper[u][0] - upper[u - 1][0]),
            (_, Some(b)) => (slope, contact) = (b, lower[l + 1][0] - lower[l][0]),
            (None, None) => break,
        }
        if next_upper == Some(slope) {
            u -= 1;
        } else {
            l += 1;
        }
    }
    let [bottom, top] = band(x, y, slope);
    Line {
        slope,
        intercept: f64::midpoint(bottom, top),
        straightness: top - bottom,
        slope_std: 2f64.sqrt() / contact,
    }
}

/// Lower convex hull of points sorted by x, then y; of points at one x the lowest.
fn hull(points: impl Iterator<Item = [f64; 2]>) -> Vec<[f64; 2]> {
    let mut hull: Vec<[f64; 2]> = Vec::new();
    for p in points {
        if let Some(last) = hull.last()
            && last[0] == p[0]
        {
            if last[1] <= p[1] {
                continue;
            }
            hull.pop();
        }
        while let [.., a, b] = hull.as_slice() {
            let turn = (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
            if turn > 0.0 {
                break;
            }
            hull.pop();
        }
        hull.push(p);
    }
    hull
}

/// Lowest and highest reading above a line of this slope through the origin.
fn band(x: &[f64], y: &[f64], slope: f64) -> [f64; 2] {
    statistics::hull(x.iter().zip(y).map(|(x, y)| y - slope * x))
}

#[cfg(test)]
mod tests;
