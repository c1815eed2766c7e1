//! How uncertain coefficients are by residuals that are not white.

use crate::prelude::*;

use super::Sample;
use super::runs::{BINS, bin};
use super::wander::Wander;

/// Angle over which residuals may be autocorrelated, in bins.
const TOGETHER: usize = 15;

/// Factor on standard uncertainties for autocorrelated residuals: root of their correlation time. 1 where they
/// are as uncorrelated as white noise would look.
pub(super) fn widening(residuals: &DVector<f64>) -> f64 {
    let (r, n) = (residuals.as_slice(), residuals.len());
    let power: f64 = r.iter().map(|v| v * v).sum();
    if power == 0.0 {
        return 1.0;
    }
    let correlation = |lag: usize| r.iter().zip(&r[lag..]).map(|(a, b)| a * b).sum::<f64>() / power;
    let noise = 1.0 / (n as f64).sqrt();
    if correlation(1) < 3.5 * noise {
        return 1.0;
    }
    let time: f64 = (1..n / 4).map(correlation).take_while(|c| *c > 2.0 * noise).sum();
    (1.0 + 2.0 * time).sqrt()
}

/// Covariance from the autocorrelation of the residuals along the circle, whatever the direction of travel, and of their wander
/// in time; and the largest factor on a standard uncertainty. What both directions share leaves effects alone that change sign between
/// them.
///
/// # Source  Newey and West 1987, the lag being the angle on the circle; never below that of white noise
pub(super) fn hanging_together(
    samples: &[Sample],
    (residuals, gain): (&DVector<f64>, &DMatrix<f64>),
    white: &DMatrix<f64>,
    dof: f64,
) -> (DMatrix<f64>, f64, Option<Slow>) {
    let unknowns = white.nrows();
    let mut scores = DMatrix::<f64>::zeros(unknowns, BINS);
    for (i, (s, r)) in samples.iter().zip(residuals.iter()).enumerate() {
        scores.column_mut(bin(s)).axpy(*r, &gain.column(i), 1.0);
    }
    let mut near = DMatrix::<f64>::zeros(unknowns, BINS);
    for bin in 0..BINS {
        for lag in 0..TOGETHER {
            let weight = 1.0 - lag as f64 / TOGETHER as f64;
            near.column_mut(bin).axpy(weight, &scores.column((bin + lag) % BINS), 1.0);
            if lag > 0 {
                near.column_mut(bin).axpy(weight, &scores.column((bin + BINS - lag) % BINS), 1.0);
            }
        }
    }
    let few = samples.len() as f64 / dof;
    let mut together = &scores * near.transpose() * few;
    let slow = Wander::of(samples, residuals).map(|wander| {
        let of_wander = wander.covariance(samples, gain);
        together += &of_wander;
        Slow { variance: of_wander.diagonal(), dof: wander.independent(samples) }
    });
    let together = (&together + together.transpose()) * 0.5;
    let ratio = |j: usize| (together[(j, j)] / white[(j, j)].max(f64::MIN_POSITIVE)).max(0.0).sqrt();
    // an uncertainty below that of white noise would be luck
    let lift: Vec<f64> = (0..unknowns).map(|j| (1.0 / ratio(j).max(1e-12)).max(1.0)).collect();
    let floor = |i: usize, j: usize| {
        if lift[i] > 1e6 || lift[j] > 1e6 { white[(i, j)] } else { together[(i, j)] * lift[i] * lift[j] }
    };
    let factor = (0..unknowns).map(ratio).fold(1.0, f64::max);
    (DMatrix::from_fn(unknowns, unknowns, floor), factor, slow)
}

/// What the wander has of the variance of each coefficient, and its degrees of freedom.
pub(super) struct Slow {
    pub(super) variance: DVector<f64>,
    pub(super) dof: f64,
}
