//! Search for the pitch of a cyclic error in what the other effects leave.

use crate::prelude::*;

use super::Circles;
use super::columns::of_cyclic;
use crate::golden::golden;

/// Natural logarithm of the odds against a pitch in white noise: e^-7 is one in a thousand.
const CERTAINTY: f64 = 7.0;
/// Readings per wave where the axis moves fastest.
const READINGS_PER_WAVE: f64 = 3.0;

/// The pitch between `limits` at which a cyclic error of the axis explains most; where none stands out of noise of
/// standard deviation `sigma`, the peak-to-peak value that would have.
pub(super) fn search(
    circles: &Circles,
    axis: usize,
    limits: [f64; 2],
    residuals: &DVector<f64>,
    sigma: f64,
) -> Result<f64, f64> {
    let spacing = spacing(circles);
    let shortest = limits[0].max(READINGS_PER_WAVE * circles.radius * spacing);
    let frequencies = [1.0 / limits[1], 1.0 / shortest];
    // two neighbouring frequencies differ by an eighth of a wave over the diameter
    let step = 1.0 / (16.0 * circles.radius);
    let count = (((frequencies[1] - frequencies[0]) / step).ceil() as usize).max(1);
    let explained = |frequency: f64| {
        let [s, c] = of_cyclic(circles, axis, 1.0 / frequency).map(|c| DVector::from_vec(c.values));
        let (ss, sc, cc) = (s.norm_squared(), s.dot(&c), c.norm_squared());
        let (ys, yc) = (s.dot(residuals), c.dot(residuals));
        let determinant = ss * cc - sc * sc;
        if determinant <= 1e-9 * ss * cc {
            0.0
        } else {
            (ys * ys * cc - 2.0 * ys * yc * sc + yc * yc * ss) / determinant
        }
    };
    let at = |i: usize| frequencies[0] + step * i as f64;
    let best = (0..=count).map(|i| (at(i), explained(at(i)))).max_by(|a, b| a.1.total_cmp(&b.1));
    let (coarse, _) = best.unwrap_or((frequencies[0], 0.0));
    let (fine, _) = golden(&mut |f| -explained(f), coarse - step, coarse + step, 1e-10);
    let needed = 2.0 * sigma * sigma * ((count + 1) as f64).ln() + 2.0 * sigma * sigma * CERTAINTY;
    if explained(fine) > needed {
        return Ok(1.0 / fine);
    }
    // a wave of amplitude a explains a^2/4 per reading, because cos^2 halves it once more
    Err(2.0 * (4.0 * needed / residuals.len() as f64).sqrt())
}

/// Mean angle between neighbouring readings of one run, rad.
fn spacing(circles: &Circles) -> f64 {
    let samples = &circles.samples;
    let travelled: f64 = super::travelled(samples).iter().sum();
    if travelled > 0.0 {
        travelled / samples.len() as f64
    } else {
        (TAU - largest_gap(samples.iter().map(|s| s.angle))) / samples.len() as f64
    }
}
