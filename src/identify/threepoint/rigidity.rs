//! Distances between the points over all poses: do they form a rigid body, and how noisy is the instrument?
//!
//! Needs no nominal geometry, no registration and no axis: a distance is the same wherever the carriage stands.
//! The standard deviation of a side holds the noise of its two ends along it. A loose point spoils every side that ends
//! in it: leaving it out makes the others quiet.

use volcomp_model::geometry::Vec3;

/// The distance between two points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Side {
    /// Index of one point.
    pub from: usize,
    /// Index of the other.
    pub to: usize,
    /// Poses in which both were seen.
    pub poses: usize,
    /// Mean distance, mm.
    pub mean: f64,
    /// Standard deviation over the poses (divisor n), mm.
    pub std: f64,
    /// The same as an estimate of the noise (divisor n - 1), mm.
    pub std_sample: f64,
    /// Largest minus smallest, mm.
    pub peak_to_peak: f64,
}

/// All distances.
#[derive(Debug, Clone, PartialEq)]
pub struct Sides {
    /// Every pair that was seen together at least twice.
    pub sides: Vec<Side>,
    /// Noise of one coordinate, pooled over all sides, mm: the root of half the mean variance of a side.
    pub sigma: f64,
    /// The point without which the other sides are quietest, and by what factor their variance is below that without
    /// the next candidate; `None` where no point leads clearly.
    pub suspect: Option<(usize, f64)>,
}

/// Compares the distances between points over poses; `poses[k][i]` is point i in pose k, `None` where it was not seen.
///
/// `None` where no two points were seen together twice.
#[must_use]
pub fn sides(poses: &[Vec<Option<Vec3>>]) -> Option<Sides> {
    let points = poses.iter().map(Vec::len).max()?;
    let mut sides = Vec::new();
    for from in 0..points {
        for to in from + 1..points {
            let distances: Vec<f64> = poses
                .iter()
                .filter_map(|p| Some((p.get(from)?.as_ref()? - p.get(to)?.as_ref()?).norm()))
                .collect();
            sides.extend(side(from, to, &distances));
        }
    }
    if sides.is_empty() {
        return None;
    }
    let free: f64 = sides.iter().map(|s| (s.poses - 1) as f64).sum();
    let variance = sides.iter().map(|s| (s.poses - 1) as f64 * s.std_sample.powi(2)).sum::<f64>() / free;
    Some(Sides { sigma: (variance / 2.0).sqrt(), suspect: loose(&sides, points), sides })
}

/// Factor in variance from which on a point is called the suspect.
const CLEAR_LEAD: f64 = 4.0;

/// Share of a distance that is rounding, not noise.
const ROUNDING: f64 = 1e-12;

fn side(from: usize, to: usize, distances: &[f64]) -> Option<Side> {
    if distances.len() < 2 {
        return None;
    }
    let n = distances.len() as f64;
    let mean = distances.iter().sum::<f64>() / n;
    let squares: f64 = distances.iter().map(|d| (d - mean).powi(2)).sum();
    let (low, high) = distances.iter().fold((f64::MAX, f64::MIN), |(l, h), d| (l.min(*d), h.max(*d)));
    Some(Side {
        from,
        to,
        poses: distances.len(),
        mean,
        std: (squares / n).sqrt(),
        std_sample: (squares / (n - 1.0)).sqrt(),
        peak_to_peak: high - low,
    })
}

/// Compares the pooled variance of the sides without each point in turn.
fn loose(sides: &[Side], points: usize) -> Option<(usize, f64)> {
    let mut without: Vec<(f64, usize)> = (0..points)
        .filter_map(|i| {
            let (sum, free) = sides
                .iter()
                .filter(|s| s.from != i && s.to != i)
                .map(|s| ((s.poses - 1) as f64 * s.std_sample.powi(2), (s.poses - 1) as f64))
                .fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
            (free > 0.0).then_some((sum / free, i))
        })
        .collect();
    without.sort_by(|a, b| a.0.total_cmp(&b.0));
    // differences of rounding size are no noise
    let floor = sides.iter().map(|s| (ROUNDING * s.mean).powi(2)).fold(0.0, f64::max);
    match without.as_slice() {
        [(best, i), (next, _), ..] if *next > CLEAR_LEAD * (best + floor) => {
            Some((*i, next / (best + floor)))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(shift: f64, fault: f64) -> Vec<Option<Vec3>> {
        [[0.0, 0.0, 0.0], [300.0, 0.0, 0.0], [0.0, 300.0, fault], [250.0, 270.0, 40.0]]
            .map(|p| Some(Vec3::from(p) + Vec3::new(shift, 2.0 * shift, -shift)))
            .to_vec()
    }

    #[test]
    fn a_rigid_body_has_no_noise_and_a_loose_point_is_named() {
        let rigid: Vec<_> = (0..9).map(|i| pose(f64::from(i) * 50.0, 0.0)).collect();
        let found = sides(&rigid).unwrap();
        assert_eq!((found.sides.len(), found.suspect), (6, None));
        assert!(found.sigma < 1e-12 && (found.sides[0].mean - 300.0).abs() < 1e-12);
        let loose: Vec<_> = (0..9)
            .map(|i| {
                let mut p = pose(f64::from(i) * 50.0, 0.0);
                if let Some(x) = p[2].as_mut() {
                    x.y += 0.01 * f64::from(i % 3);
                }
                p
            })
            .collect();
        let found = sides(&loose).unwrap();
        assert_eq!(found.suspect.map(|(i, _)| i), Some(2), "{found:?}");
    }

    #[test]
    fn lost_points_are_left_out_and_one_pose_says_nothing() {
        let mut poses: Vec<_> = (0..4).map(|i| pose(f64::from(i), 0.0)).collect();
        poses[1][0] = None;
        let found = sides(&poses).unwrap();
        assert_eq!((found.sides[0].poses, found.sides[5].poses), (3, 4));
        assert_eq!(sides(&poses[..1]), None);
        assert_eq!(sides(&[]), None);
    }
}
