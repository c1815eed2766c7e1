//! How many points and runs a tracker needs for angular error motions of a wanted uncertainty.
//!
//! The covariance of the six error motions follows from points, station and noise alone (equations 5.1), so that points and
//! runs are chosen before anything is measured. Noise averages over runs; what is the same in every run (encoder errors,
//! refraction) does not and bounds what can be reached.

use super::{Geometry, Observation, ThreePointError, TrackerNoise, geometry};
use crate::prelude::*;
use crate::twist::{self, Sighting};
use volcomp_model::statistics::normal_two_sided;

/// Candidates above this number are refused.
pub const POINTS_MAX: usize = 40;

/// What is to be measured, from where.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanRequest {
    /// Candidate points on the carriage, platform coordinates, mm.
    pub points: Vec<Vec3>,
    /// Platform origin in M at home, mm.
    pub origin: Vec3,
    /// The axis that moves.
    pub axis: AxisName,
    /// True where its carriage moves by minus the programmed coordinate.
    pub workpiece_side: bool,
    /// Stops of the axis, mm.
    pub positions: Vec<f64>,
    /// Place of the tracker in M, mm.
    pub station: Vec3,
    /// Noise of one reading.
    pub noise: TrackerNoise,
    /// Standard deviation of what is the same in every run, rad per angle; 0 where unknown.
    pub systematic_angle: f64,
    /// Wanted bound of the error at every position, rad.
    pub target: f64,
    /// Probability that the errors of all positions together keep it, 0 to 1.
    pub confidence: f64,
    /// Angular error motions that must reach it: EA, EB, EC.
    pub wanted: [bool; 3],
}

/// One number of points.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanRow {
    /// Indices of the best points.
    pub chosen: Vec<usize>,
    /// Standard deviation of EA, EB, EC from one reading of every point, largest over the positions, rad.
    pub single: [f64; 3],
    /// Standard deviation that no number of runs reduces, rad.
    pub floor: [f64; 3],
    /// Runs there and back for EA, EB, EC; none where the target is below what can be reached.
    pub runs: [Option<u32>; 3],
    /// Shape of the points.
    pub geometry: Geometry,
}

impl PlanRequest {
    /// From the tracker to the middle of the points with the axis at a position, mm.
    #[must_use]
    pub fn distance(&self, position: f64) -> f64 {
        let sign = if self.workpiece_side { -1.0 } else { 1.0 };
        let mut at: Vec3 = self.origin - self.station;
        at[self.axis.direction()] += sign * position;
        let mean = self.points.iter().sum::<Vec3>() / self.points.len() as f64;
        (at + mean).norm()
    }
}

impl PlanRow {
    /// Runs there and back for all wanted angles (EA, EB, EC), one at least; none where the target of one is below what can be reached.
    #[must_use]
    pub fn runs_for(&self, wanted: &[bool; 3]) -> Option<u32> {
        let mut wanted = (0..3).filter(|i| wanted[*i]);
        wanted.try_fold(1, |most, i| Some(most.max(self.runs[i]?)))
    }
}

/// The plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// From three points up.
    pub rows: Vec<PlanRow>,
    /// Coverage factor of the wanted confidence for all positions together.
    pub coverage: f64,
    /// Index of the row with the fewest readings that reaches the target; none where no row does.
    pub best: Option<usize>,
}

/// Why no plan can be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// The points.
    #[error(transparent)]
    Points(#[from] ThreePointError),
    /// Too many.
    #[error(
        "{count} candidate points; the limit is {POINTS_MAX}: leave out points that stand close together"
    )]
    TooMany {
        /// Candidates.
        count: usize,
    },
    /// No position.
    #[error("no position of the axis; at least one is needed")]
    NoPosition,
}

/// Largest number of runs that a plan proposes.
const RUNS_MAX: f64 = 10_000.0;

/// Makes a plan: for every number of points the best of them, and the runs that they need.
///
/// # Errors
/// Fewer than three points or points on a line; more than [`POINTS_MAX`]; no position.
///
/// # Source  equations 5.1
pub fn plan(request: &PlanRequest) -> Result<Plan, PlanError> {
    let count = request.points.len();
    if count > POINTS_MAX {
        return Err(PlanError::TooMany { count });
    }
    if request.positions.is_empty() {
        return Err(PlanError::NoPosition);
    }
    geometry(&request.points).check(count)?;
    let coverage = coverage(request.positions.len(), request.confidence);
    let mut rows = Vec::new();
    let mut chosen = best_three(request);
    while chosen.len() >= 3 {
        rows.push(row(request, &chosen, coverage));
        let next = (0..count)
            .filter(|i| !chosen.contains(i))
            .map(|i| {
                let more: Vec<usize> = chosen.iter().copied().chain([i]).collect();
                (cost(request, &more), i)
            })
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, next)) = next else { break };
        chosen.push(next);
    }
    let readings = |r: &PlanRow| Some(u64::from(r.runs_for(&request.wanted)?) * r.chosen.len() as u64);
    let best = (0..rows.len()).filter_map(|i| Some((readings(&rows[i])?, i))).min().map(|(_, i)| i);
    Ok(Plan { rows, coverage, best })
}

/// Coverage factor with which `positions` independent errors all stay within, with a probability of `confidence`.
fn coverage(positions: usize, confidence: f64) -> f64 {
    let outside = (1.0 - confidence) / positions.max(1) as f64;
    let (mut low, mut high) = (0.0, 10.0);
    for _ in 0..60 {
        let middle = f64::midpoint(low, high);
        if normal_two_sided(middle) > outside { low = middle } else { high = middle }
    }
    f64::midpoint(low, high)
}

fn best_three(request: &PlanRequest) -> Vec<usize> {
    let n = request.points.len();
    let pairs = (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b)));
    let threes = pairs.flat_map(|(a, b)| (b + 1..n).map(move |c| vec![a, b, c]));
    let best = threes.map(|three| (cost(request, &three), three)).min_by(|a, b| a.0.total_cmp(&b.0));
    best.filter(|(cost, _)| cost.is_finite()).map_or_else(Vec::new, |(_, three)| three)
}

/// Largest wanted standard deviation; infinite where the points determine less than six motions.
fn cost(request: &PlanRequest, chosen: &[usize]) -> f64 {
    let std = std_of(request, chosen, &request.noise);
    (0..3).filter(|i| request.wanted[*i]).map(|i| std[i]).fold(0.0, f64::max)
}

fn row(request: &PlanRequest, chosen: &[usize], coverage: f64) -> PlanRow {
    let single = std_of(request, chosen, &request.noise);
    let floor = if request.systematic_angle > 0.0 {
        let same = TrackerNoise { range: 1e-9, range_share: 0.0, angle: request.systematic_angle };
        // weights of the noise, errors of the systematic part: bounded by the part alone
        std_of(request, chosen, &same)
    } else {
        [0.0; 3]
    };
    let runs = core::array::from_fn(|i| {
        let left = request.target.powi(2) - (coverage * floor[i]).powi(2);
        // a run passes every position twice
        let runs = ((coverage * single[i]).powi(2) / left / 2.0).ceil().max(1.0);
        (left > 0.0 && runs <= RUNS_MAX).then_some(runs as u32)
    });
    let points: Vec<Vec3> = chosen.iter().map(|i| request.points[*i]).collect();
    PlanRow { chosen: chosen.to_vec(), single, floor, runs, geometry: geometry(&points) }
}

/// Standard deviations of EA, EB, EC, largest over the positions.
fn std_of(request: &PlanRequest, chosen: &[usize], noise: &TrackerNoise) -> [f64; 3] {
    let sign = if request.workpiece_side { -1.0 } else { 1.0 };
    let direction = unit(request.axis.direction());
    let points: Vec<Vec3> = chosen.iter().map(|i| request.points[*i]).collect();
    let centroid = points.iter().sum::<Vec3>() / points.len().max(1) as f64;
    let shape = geometry(&points);
    if shape.check(points.len()).is_err() {
        return [f64::INFINITY; 3];
    }
    let mut worst = [0.0f64; 3];
    for position in &request.positions {
        let at = request.origin + direction * (sign * position) - request.station;
        let sightings: Vec<Sighting> = points
            .iter()
            .map(|p| Sighting {
                point: p - centroid,
                displacement: Vec3::zeros(),
                covariance: covariance(&(at + p), noise),
            })
            .collect();
        let covariance = twist::rows_of(&sightings).ok().and_then(|rows| twist::solve(&rows).ok());
        let Some(fit) = covariance else { return [f64::INFINITY; 3] };
        for (i, w) in worst.iter_mut().enumerate() {
            *w = w.max(fit.covariance[(3 + i, 3 + i)].max(0.0).sqrt());
        }
    }
    worst
}

/// Covariance of a point seen along `beam`.
fn covariance(beam: &Vec3, noise: &TrackerNoise) -> Mat3 {
    let level = beam.x.hypot(beam.y);
    let seen =
        Observation { range: beam.norm(), azimuth: beam.y.atan2(beam.x), elevation: beam.z.atan2(level) };
    seen.covariance(noise)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::threepoint::{Seen, solve};

    fn request() -> PlanRequest {
        PlanRequest {
            points: [
                [0.0, -200.0, 0.0],
                [0.0, 200.0, 0.0],
                [300.0, 0.0, 0.0],
                [0.0, 0.0, 350.0],
                [600.0, 200.0, 300.0],
            ]
            .map(Vec3::from)
            .to_vec(),
            origin: Vec3::zeros(),
            axis: AxisName::X,
            workpiece_side: true,
            positions: (0..21).map(|i| 40.0 * f64::from(i)).collect(),
            station: Vec3::new(2600.0, 0.0, 100.0),
            noise: TrackerNoise { range: 0.0006, range_share: 0.0, angle: 0.75 / 206_265.0 },
            systematic_angle: 0.0,
            target: 0.7 / 206_265.0,
            confidence: 0.95,
            wanted: [false, false, true],
        }
    }

    #[test]
    fn the_coverage_factor_grows_with_the_positions() {
        assert!((coverage(1, 0.95) - 1.95996).abs() < 1e-4);
        assert!((coverage(21, 0.95) - 3.0381).abs() < 1e-3, "{}", coverage(21, 0.95));
    }

    #[test]
    fn the_uncertainty_planned_is_that_of_the_solution() {
        let r = request();
        let plan = plan(&r).unwrap();
        let row = &plan.rows[0];
        let sign = -1.0;
        let origin = Vec3::new(sign * r.positions[20], 0.0, 0.0);
        let seen: Vec<Seen> = row
            .chosen
            .iter()
            .map(|i| {
                let p = r.points[*i];
                Seen {
                    platform: p,
                    measured: origin + p,
                    covariance: covariance(&(origin + p - r.station), &r.noise),
                }
            })
            .collect();
        let pose = solve(&seen, &origin).unwrap();
        let std = pose.covariance[(5, 5)].sqrt();
        assert!(std <= row.single[2] * (1.0 + 1e-9) && std > 0.5 * row.single[2], "{std} {:?}", row.single);
    }

    #[test]
    fn more_points_need_no_more_runs_and_a_systematic_part_bounds_what_can_be_reached() {
        let mut r = request();
        let all = plan(&r).unwrap();
        assert_eq!(all.rows.len(), 3);
        assert!(all.rows.windows(2).all(|w| w[1].runs[2] <= w[0].runs[2]), "{:?}", all.rows);
        assert!(all.best.is_some());
        // yaw about z: two of the best three stand apart across the beam, where the range carries it
        let three: Vec<f64> = all.rows[0].chosen.iter().map(|i| r.points[*i].y).collect();
        assert!(three.contains(&-200.0) && three.contains(&200.0), "{three:?}");
        r.systematic_angle = 100.0 / 206_265.0;
        r.wanted = [true; 3];
        assert_eq!(plan(&r).unwrap().best, None);
    }

    #[test]
    fn more_confidence_needs_runs_by_the_square_of_the_coverage_factor() {
        let usual = plan(&request()).unwrap();
        let sure = plan(&PlanRequest { confidence: 0.999, ..request() }).unwrap();
        let exact = |p: &Plan| (p.coverage * p.rows[0].single[2] / request().target).powi(2) / 2.0;
        assert!((sure.coverage - 4.066).abs() < 2e-3, "{}", sure.coverage);
        for p in [&usual, &sure] {
            assert_eq!(p.rows[0].runs[2], Some(exact(p).ceil() as u32));
        }
        assert!(sure.rows[0].runs[2] > usual.rows[0].runs[2]);
    }

    #[test]
    fn what_cannot_be_planned_is_refused() {
        let mut r = request();
        r.positions.clear();
        assert_eq!(plan(&r), Err(PlanError::NoPosition));
        let mut r = request();
        r.points.truncate(2);
        assert!(matches!(plan(&r), Err(PlanError::Points(_))));
        let mut r = request();
        r.points = vec![Vec3::zeros(); POINTS_MAX + 1];
        assert!(matches!(plan(&r), Err(PlanError::TooMany { .. })));
    }
}
