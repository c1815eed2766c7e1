//! Runs of a circle: how far each travelled, and where its measured part begins and ends.

use core::f64::consts::{PI, TAU};

use super::Sample;
use volcomp_model::statistics::hull;
use volcomp_units::axes::Travel;

/// More than a turn by this much counts as overshoot, rad.
const MORE_THAN_A_TURN: f64 = 1e-3;

/// +1 from the first axis towards the second, -1 back.
pub(super) const fn sign(travel: Travel) -> f64 {
    match travel {
        Travel::Forward => 1.0,
        Travel::Reverse => -1.0,
    }
}

/// Stretches of one direction, feed and run, in the order they were taken.
fn runs(samples: &[Sample]) -> impl Iterator<Item = &[Sample]> {
    samples.chunk_by(|a, b| a.travel == b.travel && a.feed == b.feed && a.run == b.run)
}

/// Angle travelled up to each reading of a run, rad.
fn path(run: &[Sample]) -> Vec<f64> {
    let mut sum = 0.0;
    let mut out = Vec::with_capacity(run.len());
    let mut last = run.first().map_or(0.0, |s| s.angle);
    for s in run {
        let step = (s.angle - last + PI).rem_euclid(TAU) - PI;
        sum += sign(s.travel) * step;
        last = s.angle;
        out.push(sum);
    }
    out
}

/// Index of the first reading of each run.
#[must_use]
pub fn run_starts(samples: &[Sample]) -> Vec<usize> {
    let next = |start: &mut usize, run: &[Sample]| {
        let first = *start;
        *start += run.len();
        Some(first)
    };
    runs(samples).scan(0, next).collect()
}

/// Angle that each run travelled, rad.
#[must_use]
pub fn travelled(samples: &[Sample]) -> Vec<f64> {
    runs(samples).map(|run| path(run).last().copied().unwrap_or(0.0)).collect()
}

/// Bins of a degree on the circle.
pub(super) const BINS: usize = 360;

/// The bin of a reading.
pub(super) fn bin(s: &Sample) -> usize {
    (s.angle.rem_euclid(TAU) / TAU * BINS as f64) as usize % BINS
}

/// Time of each reading of each run from its begin, s (without feed: rad).
pub(super) fn run_times(samples: &[Sample]) -> Vec<Vec<f64>> {
    let times = |run: &[Sample]| {
        let time = |(s, p): (&Sample, f64)| p / s.feed.unwrap_or(1.0);
        run.iter().zip(path(run)).map(time).collect()
    };
    runs(samples).map(times).collect()
}

/// Time of each reading as a share of that of the whole test, from -1/2 to 1/2: of the path at its feed (without feed: of the
/// path), without pauses between runs.
pub(super) fn elapsed(samples: &[Sample]) -> Vec<f64> {
    let mut all = Vec::with_capacity(samples.len());
    let mut begin = 0.0;
    for times in run_times(samples) {
        all.extend(times.iter().map(|t| begin + t));
        begin = all.last().copied().unwrap_or(begin);
    }
    let [low, high] = hull(all.iter().copied());
    let span = (high - low).max(f64::MIN_POSITIVE);
    all.into_iter().map(|t| (t - low) / span - 0.5).collect()
}

/// The readings without the overshoot of their runs: `overshoot` (rad) at both ends, or, where it is not given, what is
/// more than one turn, half at either end.
#[must_use]
pub fn cut_overshoot(samples: &[Sample], overshoot: Option<f64>) -> Vec<Sample> {
    within_overshoot(samples, overshoot).into_iter().map(|i| samples[i]).collect()
}

/// Which readings these are.
#[must_use]
pub fn within_overshoot(samples: &[Sample], overshoot: Option<f64>) -> Vec<usize> {
    let mut kept = Vec::with_capacity(samples.len());
    let mut first = 0;
    for run in runs(samples) {
        let path = path(run);
        let total = path.last().copied().unwrap_or(0.0);
        let cut = overshoot.unwrap_or_else(|| {
            let more = total - TAU;
            if more > MORE_THAN_A_TURN { more / 2.0 } else { 0.0 }
        });
        // rounding must not cost the last reading
        let margin = 1e-9;
        let inside = |p: f64| p >= cut - margin && p <= total - cut + margin;
        kept.extend((first..).zip(path).filter(|(_, p)| inside(*p)).map(|(i, _)| i));
        first += run.len();
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(from_deg: i32, to_deg: i32) -> Vec<Sample> {
        let travel = if to_deg > from_deg { Travel::Forward } else { Travel::Reverse };
        let step = (to_deg - from_deg).signum();
        (0..=(to_deg - from_deg).abs())
            .map(|i| Sample {
                angle: f64::from((from_deg + step * i).rem_euclid(360)).to_radians(),
                deviation: 0.0,
                travel,
                feed: None,
                run: 0,
            })
            .collect()
    }

    #[test]
    fn overshoot_is_cut_at_both_ends_of_each_run() {
        let mut both = run(-180, 540);
        both.extend(run(540, -180));
        let kept = cut_overshoot(&both, None);
        assert_eq!(kept.len(), 2 * 361);
        assert!(kept[0].angle.abs() < 1e-12 && kept[361].angle.abs() < 1e-12);
        assert!((travelled(&both)[1].to_degrees() - 720.0).abs() < 1e-9);
        let arc = cut_overshoot(&run(-22, 202), Some(2f64.to_radians()));
        assert_eq!(arc.len(), 221);
        assert!((arc[0].angle.to_degrees() - 340.0).abs() < 1e-9);
        assert_eq!(cut_overshoot(&run(0, 359), None).len(), 360);
    }
}
