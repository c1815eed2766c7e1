//! Six error motions over the positions of a linear axis: sense, gauge, and readings for curve fits.
//!
//! An instrument outside the machine cannot tell a constant error from its own set-up, nor a slope of straightness from
//! a turn of its frame. Therefore the motions are made zero at one position, and the straightnesses lose the slope of
//! one reference line; what was taken away is returned, because with a trusted frame it is squareness.
//!
//! Source: equations 1.4 (sense), 1.8 (gauge), 5.6 (lines).

use crate::prelude::*;

/// The error motions at one position, once.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionRow {
    /// Programmed coordinate, mm.
    pub position: f64,
    /// Which repetition.
    pub cycle: u32,
    /// Direction of approach.
    pub travel: Travel,
    /// EX EY EZ (mm) EA EB EC (rad).
    pub motion: Vector6<f64>,
    /// Covariance of these.
    pub covariance: Matrix6<f64>,
}

/// The line about which straightness is stated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Line {
    /// Through the means at the first and last position (the rule of the model).
    #[default]
    EndPoint,
    /// Least squares over all rows.
    LeastSquares,
    /// Slopes stay as measured: the frame of the instrument is trusted.
    AsMeasured,
}

/// Motions in the gauge of a model.
#[derive(Debug, Clone, PartialEq)]
pub struct Gauged {
    /// The rows, zero in the mean at `reference_position`.
    pub rows: Vec<MotionRow>,
    /// Where they are zero.
    pub reference_position: f64,
    /// What was taken away everywhere, mm and rad.
    pub constant: Vector6<f64>,
    /// Slopes of the lines taken out of EX EY EZ, mm per mm; zero along the axis.
    pub slope: [f64; 3],
}

/// Why motions cannot be brought into the gauge of a model.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum GaugeError {
    /// A line needs two positions.
    #[error("{found} distinct positions; the error motions of an axis need at least 2")]
    TooFewPositions {
        /// Positions found.
        found: usize,
    },
    /// The reference position lies outside the data.
    #[error(
        "reference position {position} mm is outside the measured range {low} to {high} mm; choose one inside"
    )]
    Outside {
        /// The position.
        position: f64,
        /// First measured.
        low: f64,
        /// Last measured.
        high: f64,
    },
}

/// The motions of a carriage on the workpiece side as motions of the tool side relative to it, at the same
/// programmed coordinate: all six change sign.
///
/// # Source  equations 1.4: `E_rel(q) = -E_car(x = -q)`; the rows are ordered by q already
pub fn to_relative(rows: &mut [MotionRow]) {
    for row in rows {
        row.motion = -row.motion;
    }
}

/// Takes out the values at the reference position (0 where that was measured, else the nearest end) and the slopes
/// of the straightnesses.
///
/// # Errors
/// Fewer than two positions, a reference position outside.
pub fn gauge(
    mut rows: Vec<MotionRow>,
    axis: AxisName,
    reference_position: Option<f64>,
    line: Line,
) -> Result<Gauged, GaugeError> {
    let (positions, means) = means(&rows);
    if positions.len() < 2 {
        return Err(GaugeError::TooFewPositions { found: positions.len() });
    }
    let (low, high) = (positions[0], positions[positions.len() - 1]);
    let at = reference_position.unwrap_or_else(|| 0.0f64.clamp(low, high));
    if !(low..=high).contains(&at) {
        return Err(GaugeError::Outside { position: at, low, high });
    }
    let mut slope = [0.0; 3];
    for (i, s) in slope.iter_mut().enumerate().filter(|(i, _)| *i != axis.direction()) {
        *s = match line {
            Line::AsMeasured => 0.0,
            Line::EndPoint => (means[means.len() - 1][i] - means[0][i]) / (high - low),
            Line::LeastSquares => least_squares_slope(&rows, i),
        };
    }
    let constant = interpolated(&positions, &means, at);
    for row in &mut rows {
        row.motion -= constant;
        for (i, s) in slope.iter().enumerate() {
            row.motion[i] -= s * (row.position - at);
        }
    }
    Ok(Gauged { rows, reference_position: at, constant, slope })
}

/// Distinct positions, and the mean motion at each.
#[must_use]
pub fn means(rows: &[MotionRow]) -> (Vec<f64>, Vec<Vector6<f64>>) {
    let readings: Vec<Reading> = rows.iter().map(|r| reading(r, 0)).collect();
    let (positions, group) = group_by_position(&readings);
    let mut sums = vec![(Vector6::zeros(), 0.0); positions.len()];
    for (row, g) in rows.iter().zip(group) {
        sums[g].0 += row.motion;
        sums[g].1 += 1.0;
    }
    (positions, sums.into_iter().map(|(sum, n)| sum / n).collect())
}

fn interpolated(positions: &[f64], values: &[Vector6<f64>], at: f64) -> Vector6<f64> {
    let k = positions.partition_point(|p| *p < at).clamp(1, positions.len() - 1);
    let share = (at - positions[k - 1]) / (positions[k] - positions[k - 1]);
    values[k - 1] * (1.0 - share) + values[k] * share
}

fn least_squares_slope(rows: &[MotionRow], component: usize) -> f64 {
    let n = rows.len() as f64;
    let mean_x = rows.iter().map(|r| r.position).sum::<f64>() / n;
    let (top, bottom) = rows.iter().fold((0.0, 0.0), |(t, b), r| {
        let x = r.position - mean_x;
        (t + x * r.motion[component], b + x * x)
    });
    top / bottom
}

fn reading(row: &MotionRow, component: usize) -> Reading {
    Reading { cycle: row.cycle, travel: row.travel, position: row.position, value: row.motion[component] }
}

/// Slope of a motion over the position by least squares, in its unit per mm; 0 at a single position.
#[must_use]
pub fn slope(rows: &[MotionRow], component: usize) -> f64 {
    let n = rows.len() as f64;
    let of = |r: &MotionRow| (r.position, r.motion[component]);
    let (mean_q, mean_e) = rows.iter().map(of).fold((0.0, 0.0), |m, (q, e)| (m.0 + q / n, m.1 + e / n));
    let (mut qq, mut qe) = (0.0, 0.0);
    for (q, e) in rows.iter().map(of) {
        qq += (q - mean_q).powi(2);
        qe += (q - mean_q) * (e - mean_e);
    }
    if qq > 0.0 { qe / qq } else { 0.0 }
}

impl Gauged {
    /// The readings of one error motion, for a curve fit.
    #[must_use]
    pub fn readings(&self, component: Component) -> Vec<Reading> {
        self.rows.iter().map(|r| reading(r, component.index())).collect()
    }

    /// Root mean square of the standard deviations of one error motion over the rows: what the measurement alone
    /// leaves uncertain of a single row.
    #[must_use]
    pub fn std(&self, component: Component) -> f64 {
        let k = component.index();
        let sum: f64 = self.rows.iter().map(|r| r.covariance[(k, k)]).sum();
        (sum / self.rows.len() as f64).sqrt()
    }
}

/// Positions closer than this (mm) are the same for two methods.
const SAME_POSITION: f64 = 1e-3;

/// Differences of the motions of two methods over the positions that both have, own minus other, about their mean: each
/// method has its own zero. EX EY EZ mm, EA EB EC rad.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// Positions in common.
    pub positions: usize,
    /// Root mean square.
    pub rms: [f64; 6],
    /// Largest absolute difference.
    pub largest: [f64; 6],
    /// Standard deviation of one of the own means.
    pub std_here: [f64; 6],
    /// Standard deviation of one of the other's means from its repeats; `None` without repeats.
    pub std_there: [Option<f64>; 6],
}

impl Comparison {
    /// Compares with positions (mm) and motions of another method, in any order.
    ///
    /// # Errors
    /// Fewer than two positions in common: their number.
    pub fn of(own: &Gauged, other: &[(f64, [f64; 6])]) -> Result<Self, usize> {
        let (positions, means) = means(&own.rows);
        let per_position = own.rows.len() as f64 / positions.len() as f64;
        let mut differences: Vec<[f64; 6]> = Vec::new();
        let (mut squares, mut free, mut repeats) = ([0.0; 6], 0usize, 0usize);
        for (position, mean) in positions.iter().zip(&means) {
            let is_same = |(p, _): &&(f64, [f64; 6])| (p - position).abs() < SAME_POSITION;
            let there: Vec<&[f64; 6]> = other.iter().filter(is_same).map(|(_, m)| m).collect();
            if there.is_empty() {
                continue;
            }
            let n = there.len() as f64;
            let average: [f64; 6] = core::array::from_fn(|i| there.iter().map(|m| m[i]).sum::<f64>() / n);
            for (i, s) in squares.iter_mut().enumerate() {
                *s += there.iter().map(|m| (m[i] - average[i]).powi(2)).sum::<f64>();
            }
            free += there.len() - 1;
            repeats += there.len();
            differences.push(core::array::from_fn(|i| mean[i] - average[i]));
        }
        if differences.len() < 2 {
            return Err(differences.len());
        }
        let count = differences.len() as f64;
        let offset: [f64; 6] =
            core::array::from_fn(|i| differences.iter().map(|d| d[i]).sum::<f64>() / count);
        let of = |i: usize| differences.iter().map(move |d| d[i] - offset[i]);
        Ok(Self {
            positions: differences.len(),
            rms: core::array::from_fn(|i| (of(i).map(|d| d * d).sum::<f64>() / (count - 1.0)).sqrt()),
            largest: core::array::from_fn(|i| of(i).fold(0.0f64, |m, d| m.max(d.abs()))),
            std_here: Component::ALL.map(|c| own.std(c) / per_position.sqrt()),
            std_there: core::array::from_fn(|i| {
                (free > 0).then(|| (squares[i] / free as f64 / (repeats as f64 / count)).sqrt())
            }),
        })
    }
}

/// The six symbols of an axis.
#[must_use]
pub fn symbols(axis: AxisName) -> [ErrorSymbol; 6] {
    Component::ALL.map(|component| ErrorSymbol::Motion { component, axis })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows() -> Vec<MotionRow> {
        (-2..=3)
            .flat_map(|i| {
                let q = f64::from(i) * 100.0;
                let motion =
                    Vector6::new(1.0 + 1e-3 * q, 2.0 - 2e-3 * q + 1e-6 * q * q, 5e-4 * q, 3.0, 0.0, q);
                [Travel::Forward, Travel::Reverse].map(|travel| MotionRow {
                    position: q,
                    cycle: 1,
                    travel,
                    motion,
                    covariance: Matrix6::identity() * 4.0,
                })
            })
            .collect()
    }

    #[test]
    fn zero_at_home_and_no_slope_across() {
        let g = gauge(rows(), AxisName::X, None, Line::EndPoint).unwrap();
        let (positions, means) = means(&g.rows);
        assert_eq!((g.reference_position, positions.len()), (0.0, 6));
        assert!(means[2].norm() < 1e-12);
        assert!((means[5][1] - means[0][1]).abs() < 1e-12 && (means[5][2] - means[0][2]).abs() < 1e-12);
        assert!((means[5][0] - 0.3).abs() < 1e-12, "scale stays");
        assert!((means[5][5] - 300.0).abs() < 1e-12, "angles keep their slope");
        assert!((g.constant[3] - 3.0).abs() < 1e-12 && (g.slope[2] - 5e-4).abs() < 1e-15);
        assert!((g.std(Component::A) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn other_lines_other_references() {
        let g = gauge(rows(), AxisName::Y, Some(250.0), Line::AsMeasured).unwrap();
        assert_eq!(g.slope, [0.0; 3]);
        assert!((g.constant[0] - 1.25).abs() < 1e-12);
        let g = gauge(rows(), AxisName::X, None, Line::LeastSquares).unwrap();
        assert!((g.slope[2] - 5e-4).abs() < 1e-15 && (g.slope[1] + 1.9e-3).abs() < 1e-12, "{g:?}");
        assert!(matches!(
            gauge(rows(), AxisName::X, Some(301.0), Line::EndPoint),
            Err(GaugeError::Outside { low: -200.0, high: 300.0, .. })
        ));
        assert!(matches!(
            gauge(rows()[..2].to_vec(), AxisName::X, None, Line::EndPoint),
            Err(GaugeError::TooFewPositions { found: 1 })
        ));
    }
}
