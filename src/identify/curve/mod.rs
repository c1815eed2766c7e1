//! Readings of one error motion to the curve that describes it: least squares in well-conditioned bases.
//!
//! Bases, over `[x0, x0 + T]`, `u = (x - x0)/T`, `s = 2u - 1`:
//! half-range `1, s, sin(k pi u)`; Chebyshev `T_k(s)`; Fourier `1, [s], cos, sin(2 pi k (x - x0)/P)` of one or
//! several periods; table: the mean at every target, smoothed where wanted. Where both directions were measured, half
//! of the reversal is a Chebyshev polynomial of its own, added towards plus and taken off towards minus.
//!
//! Assumptions: errors of the readings are independent and of equal size. Where they are not (drift from
//! cycle to cycle), AICc finds too much; therefore a simpler curve wins where leaving out whole positions says so.
//!
//! Source: equations 5.9; figures: `docs/reference/json-output.md` 2. Reading order: this file, `data`, `basis`, `solve`,
//! `figures`, `select` (orders and reversal), `periods`, `support` and `smooth` (tables), `band`, `robust`;
//! `repeat` (a whole turn over a longer travel), `cycle_drift`, `uncertainty` (of the curve as one number), `sampling` (what targets cannot show) `orders` (figures of every order) and `monomial` (polynomials as others write them) stand beside.

mod band;
mod basis;
mod cycle_drift;
mod data;
mod error;
mod figures;
mod fitted;
mod lanes;
pub mod monomial;
mod nested_models;
mod orders;
mod periods;
mod repeat;
mod request;
mod robust;
mod sampling;
mod select;
mod smooth;
mod solve;
mod support;
mod uncertainty;

pub use band::Band;
pub use cycle_drift::{Course, CycleDrift};
pub use error::FitError;
pub use figures::Figures;
pub use fitted::{CurveFit, MeanReversal, Note, Outlier, ReversalFit};
pub use orders::Orders;
pub use periods::period_range;
pub use repeat::{covers_turn, repeated};
pub use request::{Basis, Drift, Period, Request, Reversal, Smoothing};
pub use sampling::{COMMON_PITCHES, Hidden, few_positions, hidden};
pub use select::highest_order;

use crate::prelude::*;

use cycle_drift::Effects;
use data::Data;

/// Condition number above which coefficients are reported as ill-determined.
const CONDITION_NOTE: f64 = 1e4;

/// Share of the RMS residual above which a reversal that is left out is reported.
const REVERSAL_NOTE: f64 = 0.5;

/// Shortest range, as a share of the stretch over which the readings lie: of a shorter one the waves are no numbers.
const RANGE_MIN: f64 = 1e-9;

/// Fits a curve to the readings of one error motion.
///
/// # Errors
/// Too few positions for what was asked, numbers that are not finite, terms that the positions cannot tell apart,
/// more outliers than a quarter.
///
/// # Source  equations 5.9
pub fn fit(readings: &[Reading], request: &Request) -> Result<CurveFit, FitError> {
    if let Some(value) = request.ridge
        && !(value.is_finite() && value >= 0.0)
    {
        return Err(FitError::BadRidge { value });
    }
    if let Some(bad) = request.penalties.iter().flatten().find(|p| !(p.is_finite() && **p >= 0.0)) {
        return Err(FitError::BadRidge { value: *bad });
    }
    let positions = readings.iter().map(|r| r.position).filter(|p| p.is_finite());
    let (first, last) = positions.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
    if let Some([low, high]) = request.range
        && !(low.is_finite() && high.is_finite() && low < high && high - low > RANGE_MIN * (last - first))
    {
        return Err(FitError::EmptyRange { low, high });
    }
    if !request.robust {
        return without_drift(readings, request);
    }
    let plain = |kept: &[Reading], request: &Request| all_readings(kept, request, &Effects::default());
    let found = robust::fit(readings, request, plain)?;
    let is_out = |i: usize| found.outliers.iter().any(|o| o.index == i);
    let kept: Vec<Reading> = (0..readings.len()).filter(|i| !is_out(*i)).map(|i| readings[i]).collect();
    let request = Request { range: request.range.or(robust::range(readings, request)?), ..request.clone() };
    let mut fit = without_drift(&kept, &request)?;
    let judged = |o: Outlier| {
        let r = readings[o.index];
        Outlier { deviation: r.value - fit.value(r.position, r.travel), ..o }
    };
    fit.outliers = found.outliers.into_iter().map(judged).collect();
    Ok(fit)
}

/// Subtracts a drift over the cycles, where that is asked for, and fits.
fn without_drift(readings: &[Reading], request: &Request) -> Result<CurveFit, FitError> {
    let effects = cycle_drift::analyse(readings, request.drift);
    if effects.offsets.is_empty() {
        return all_readings(readings, request, &effects);
    }
    let subtracted = |(r, offset): (&Reading, &f64)| Reading { value: r.value - offset, ..*r };
    let rest: Vec<Reading> = readings.iter().zip(&effects.offsets).map(subtracted).collect();
    let mut fit = all_readings(&rest, request, &effects)?;
    // no static curve can remove the drift
    fit.figures.repeatability = crate::reading::repeatability(readings);
    Ok(fit)
}

fn all_readings(readings: &[Reading], request: &Request, effects: &Effects) -> Result<CurveFit, FitError> {
    // polynomials and half waves cannot close: they keep the ends that were measured
    let closes = !matches!(request.basis, Some(Basis::HalfRange | Basis::Chebyshev));
    let turn = request.turn.filter(|_| closes);
    let data = Data { given_range: request.range, ..Data::with_effects(readings, effects, turn)? };
    let mut fit = match request.basis {
        Some(Basis::Table) if request.reversal == Reversal::Mean => {
            support::fit(&data.one_direction(), request.interpolation, request.smoothing)?
        }
        Some(Basis::Table) => support::fit(&data, request.interpolation, request.smoothing)?,
        Some(basis) => select::best_of_basis(&data, basis, request)?,
        None => select::best_of_all(&data, request)?,
    };
    if fit.condition > CONDITION_NOTE {
        fit.notes.push(Note::IllConditioned { condition: fit.condition });
    }
    fit.mean_reversal = data.mean_reversal();
    fit.lack_of_fit = uncertainty::lack_of_fit(&data, &fit);
    if let Some(mean) = fit.mean_reversal.map(|m| m.value) {
        if fit.reversal.is_some() {
            fit.notes.push(Note::ReversalKept { mean });
        } else if mean.abs() > REVERSAL_NOTE * fit.figures.rmse_n && !select::holds_reversal(&fit) {
            fit.notes.push(Note::ReversalLeftOut { mean });
        }
    }
    fit.drift = effects.drift;
    fit.notes.extend(effects.drift.map(Note::Drift));
    if !closes
        && let Some(turn) = request.turn
        && Data::new(readings, Some(turn))?.turn.is_some()
    {
        let [low, high] = data.range();
        let step = fit.value(high, Travel::Forward) - fit.value(low, Travel::Forward);
        fit.notes.push(Note::TurnLeftOpen { step });
    }
    Ok(fit)
}

#[cfg(test)]
mod tests;
