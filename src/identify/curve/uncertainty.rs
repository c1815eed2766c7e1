//! Standard uncertainty of a fitted curve as one number, for a model: RMS over the range of the standard deviation of the curve,
//! with what the curve misses of the means (lack of fit).
//!
//! Where targets were repeated, the variance of the means about the curve beyond that of the repetitions is lack of fit. A table
//! has none at its targets; between them straight lines miss a smooth error by `h^2 f''/sqrt(120)` RMS, where the mean of the
//! neighbours misses a left-out target by `h^2 f''/2`. Without repetitions the second differences of the residuals along the
//! travel estimate the noise, and the rest of the residuals is lack of fit.
//!
//! Source: Draper and Smith 1998, 2.1 (lack of fit); Gasser, Sroka and Jennen-Steinmetz 1986 (second differences).

use volcomp_units::axes::Travel;

use super::data::{Cell, Data};
use super::fitted::CurveFit;
use super::request::Basis;

/// Places of the RMS.
const PLACES: u32 = 40;
/// Variance of `a - 2 b + c` of three values with variance 1.
const SECOND_DIFFERENCE: f64 = 6.0;
/// `4/120`: square of the error between two targets over that of the neighbours' mean at a target left out.
const BETWEEN_TARGETS: f64 = 1.0 / 30.0;
/// Neighbours whose second differences are taken together, and most such stretches of a direction.
const STRETCH: usize = 64;
const STRETCHES: usize = 4;
/// Fewest residuals whose second differences say anything.
const DIFFERENCES_MIN: usize = 5;

/// Standard deviation of what the curve misses of the error, mm or rad.
pub(super) fn lack_of_fit(data: &Data, fit: &CurveFit) -> f64 {
    let figures = &fit.figures;
    let Some(sigma) = figures.rmse_dof else { return 0.0 };
    let variance = match data.repeatability() {
        Some(pure) if fit.basis == Basis::Table && fit.smoothing.is_none() => {
            let left_out = figures.position_rmse.map_or(0.0, |e| e * e);
            let per_cell = data.n as f64 / data.cells.len() as f64;
            BETWEEN_TARGETS * (left_out - pure * pure * (1.0 + 1.5 / per_cell))
        }
        Some(pure) => {
            let within: f64 = data.cells.iter().map(|c| c.within).sum();
            let free = data.cells.len() as f64 - figures.m as f64;
            let mean_square = (figures.sse - within) / free.max(1.0);
            (mean_square - pure * pure) * data.cells.len() as f64 / data.n as f64
        }
        None => {
            let noise = second_differences(data, fit);
            noise.map_or(0.0, |noise| sigma * sigma - noise)
        }
    };
    variance.max(0.0).sqrt()
}

/// Variance of the readings by the second differences of the residuals, each direction by itself.
fn second_differences(data: &Data, fit: &CurveFit) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0usize);
    for travel in [Travel::Forward, Travel::Reverse] {
        let residual = |c: &&Cell| c.mean - fit.value(data.positions[c.group], travel);
        let cells: Vec<&Cell> = data.of(travel).iter().flatten().copied().collect();
        // of a dense scan some stretches tell enough
        let is_dense = cells.len() > STRETCH * STRETCHES;
        let stretches = cells.chunks(if is_dense { STRETCH } else { cells.len().max(1) });
        for stretch in stretches.step_by(cells.len().div_ceil(STRETCH * STRETCHES).max(1)) {
            let residuals: Vec<f64> = stretch.iter().map(residual).collect();
            for w in residuals.windows(3) {
                sum += (w[0] - 2.0 * w[1] + w[2]).powi(2);
                count += 1;
            }
        }
    }
    (count >= DIFFERENCES_MIN).then(|| sum / (SECOND_DIFFERENCE * count as f64))
}

impl CurveFit {
    /// Standard uncertainty (k = 1) of the curve, RMS over its range and the directions that it tells apart, mm or rad: covariance of
    /// its numbers, offsets of the cycles, what a subtracted drift leaves, lack of fit. `None` without degrees of freedom.
    ///
    /// # Source  GUM (JCGM 100:2008) 4.2, 5.1.2
    #[must_use]
    pub fn standard_uncertainty(&self) -> Option<f64> {
        let band = self.band.as_ref()?;
        let [low, high] = self.curve.range().unwrap_or([0.0, 1.0]);
        let mut sum = 0.0;
        for i in 0..=PLACES {
            let x = low + (high - low) * f64::from(i) / f64::from(PLACES);
            sum += [Travel::Forward, Travel::Reverse].map(|t| band.std_at(x, t).powi(2)).iter().sum::<f64>();
        }
        let mean = sum / f64::from(2 * (PLACES + 1));
        Some(mean.sqrt().hypot(self.lack_of_fit))
    }
}
