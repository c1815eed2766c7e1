//! Wander of instrument and machine during the runs: noise that is correlated in time, which no angle tells from an effect that changes
//! sign between the directions.

use nalgebra::{DMatrix, DVector};

use super::Sample;
use super::runs::{BINS, bin, run_starts, run_times};

/// Distances along a run at which readings are compared, in bins: what the shape of an effect leaves is shorter, and farther apart the
/// effects have taken part of the wander.
const LAGS: [usize; 5] = [6, 12, 24, 48, 80];
/// Correlation times that are tried, as shares of the longest time between two readings that are compared.
const TIMES: [f64; 7] = [0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4];

/// A process of Ornstein and Uhlenbeck: variance in mm^2 and correlation time in s (without feed: rad).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Wander {
    variance: f64,
    time: f64,
}

/// Readings of a run in a bin: their mean time, and their mean beyond that of all runs there. `count` is 0 where no other run was there.
struct Bin {
    angle: usize,
    time: f64,
    residual: f64,
    count: f64,
}

impl Wander {
    /// The wander of residuals, by the mean squares of their differences at some distances along the runs. What all runs share at an angle is of
    /// the guideways.
    pub(super) fn of(samples: &[Sample], residuals: &DVector<f64>) -> Option<Self> {
        let runs = binned(samples, residuals);
        // time between, mean square of the difference, number
        let mut squares: Vec<[f64; 3]> = Vec::new();
        for run in &runs {
            for lag in LAGS {
                let pairs = run.iter().zip(run.iter().skip(lag));
                let (mut sum, mut times, mut count) = (0.0, 0.0, 0.0);
                for (a, b) in pairs.filter(|(a, b)| a.count > 0.0 && b.count > 0.0) {
                    (sum, times, count) =
                        (sum + (a.residual - b.residual).powi(2), times + b.time - a.time, count + 1.0);
                }
                if count > 0.0 {
                    squares.push([times / count, sum / count, count]);
                }
            }
        }
        let longest = squares.iter().map(|s| s[0]).fold(0.0, f64::max);
        let fitted = TIMES.iter().filter_map(|share| Self::with_time(share * longest, &squares));
        fitted.min_by(|a, b| a.1.total_cmp(&b.1)).map(|best| best.0)
    }

    /// The variance that suits the squares best with a correlation time, beside noise that is not correlated; and what is left.
    fn with_time(time: f64, squares: &[[f64; 3]]) -> Option<(Self, f64)> {
        let grows = |s: &[f64; 3]| 2.0 * (1.0 - (-s[0] / time).exp());
        let weight: f64 = squares.iter().map(|s| s[2]).sum();
        let mean = |of: &dyn Fn(&[f64; 3]) -> f64| squares.iter().map(|s| s[2] * of(s)).sum::<f64>() / weight;
        let (x, y) = (mean(&grows), mean(&|s| s[1]));
        let (xx, xy) = (mean(&|s| (grows(s) - x).powi(2)), mean(&|s| (grows(s) - x) * (s[1] - y)));
        let variance = xy / xx;
        let left = mean(&|s| (s[1] - y - variance * (grows(s) - x)).powi(2));
        (variance > 0.0 && variance.is_finite()).then_some((Self { variance, time }, left))
    }

    /// Covariance of coefficients from it; `gain` gives the coefficients per reading.
    pub(super) fn covariance(self, samples: &[Sample], gain: &DMatrix<f64>) -> DMatrix<f64> {
        let mut sum = DMatrix::zeros(gain.nrows(), gain.nrows());
        for (first, times) in run_starts(samples).into_iter().zip(run_times(samples)) {
            // what lies behind a reading in its run, each by its correlation with this one
            let mut behind = DVector::zeros(gain.nrows());
            let mut later = times.last().copied().unwrap_or(0.0);
            for (k, time) in times.iter().enumerate().rev() {
                behind *= (-(later - time).max(0.0) / self.time).exp();
                let own = gain.column(first + k);
                sum.ger(self.variance, &own, &behind, 1.0);
                sum.ger(self.variance, &behind, &own, 1.0);
                sum.ger(self.variance, &own, &own, 1.0);
                behind += own;
                later = *time;
            }
        }
        sum
    }

    /// Number of its independent values in the runs.
    pub(super) fn independent(self, samples: &[Sample]) -> f64 {
        let times = run_times(samples);
        times.iter().filter_map(|t| t.last()).sum::<f64>() / (2.0 * self.time)
    }
}

/// The runs in bins.
fn binned(samples: &[Sample], residuals: &DVector<f64>) -> Vec<Vec<Bin>> {
    let mut runs: Vec<Vec<Bin>> = Vec::new();
    for (first, times) in run_starts(samples).into_iter().zip(run_times(samples)) {
        let mut bins: Vec<Bin> = Vec::new();
        for (k, time) in times.into_iter().enumerate() {
            let (at, residual) = (bin(&samples[first + k]), residuals[first + k]);
            match bins.last_mut().filter(|b| b.angle == at) {
                Some(b) => {
                    (b.time, b.residual, b.count) = (b.time + time, b.residual + residual, b.count + 1.0);
                }
                None => bins.push(Bin { angle: at, time, residual, count: 1.0 }),
            }
        }
        for b in &mut bins {
            (b.time, b.residual) = (b.time / b.count, b.residual / b.count);
        }
        runs.push(bins);
    }
    let mut shared = vec![(0.0, 0.0); BINS];
    for b in runs.iter().flatten() {
        shared[b.angle] = (shared[b.angle].0 + b.residual, shared[b.angle].1 + 1.0);
    }
    for b in runs.iter_mut().flatten() {
        let (sum, count) = shared[b.angle];
        // the mean takes a share of each run's own
        b.residual = (b.residual - sum / count) / (1.0 - 1.0 / count).sqrt();
        if count < 2.0 {
            b.count = 0.0;
        }
    }
    runs
}
