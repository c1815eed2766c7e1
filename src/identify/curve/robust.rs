//! Outliers: readings that no curve should follow are found, named and left out.
//!
//! A first curve that outliers cannot drag comes from least absolute deviations, then Tukey's redescending weights,
//! both by iterated weighted least squares on sine half waves with a reversal (the ends of polynomials are too free to
//! resist one wrong reading there). Readings far from it are left out; the family that was asked for is fitted to the rest, every reading is judged again by that fit, and so on
//! until the verdicts stay. The figures are those of ordinary least squares on the readings that were kept.
//!
//! Source: Huber and Ronchetti 2009 (M-estimates); Rousseeuw and Leroy 1987 (reweighted least squares).

use crate::prelude::*;

use super::basis::Shape;
use super::data::Data;
use super::error::FitError;
use super::fitted::{CurveFit, Outlier};
use super::request::{Basis, Request};
use super::solve::dot;

/// A reading farther from the curve than this many standard deviations is an outlier: one of 16 000 honest ones.
const LIMIT: f64 = 4.0;
/// Where more than this share disagrees, the curve is wrong and not the readings.
const SHARE_MAX: f64 = 0.25;
/// Median absolute deviation of normal errors to their standard deviation.
const FROM_MEDIAN: f64 = 1.482_602_218_505_602;
/// Tukey's constant: 95 % efficiency on normal errors.
const TUKEY: f64 = 4.685;
/// Least variance that a curve is taken to leave of a reading that it follows.
const LEVERAGE_FLOOR: f64 = 0.05;
const ROUNDS: usize = 10;
const ITERATIONS: usize = 30;
/// Terms of the first curve at most, and readings that each of them needs.
const TERMS: usize = 14;
const READINGS_PER_TERM: usize = 5;
/// Readings that the first curve is made from at most; scattered by the golden ratio, so that no cycle is met in step.
const FIRST_READINGS: usize = 1 << 15;
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// Fits to what remains without outliers.
pub(super) fn fit(
    readings: &[Reading],
    request: &Request,
    plain: impl Fn(&[Reading], &Request) -> Result<CurveFit, FitError>,
) -> Result<CurveFit, FitError> {
    let request = &Request { range: request.range.or(range(readings, request)?), ..request.clone() };
    let mut out = first_verdict(readings, request)?;
    let mut round = 0;
    loop {
        let kept: Vec<Reading> = (0..readings.len()).filter(|i| !out[*i]).map(|i| readings[i]).collect();
        let found = readings.len() - kept.len();
        if found as f64 > SHARE_MAX * readings.len() as f64 {
            return Err(FitError::TooManyOutliers { found, readings: readings.len() });
        }
        let mut fit = plain(&kept, request)?;
        let (next, deviations) = verdict(readings, &fit, &out);
        round += 1;
        // verdicts that swing for ever end with the last fit and what it left out
        if next == out || round == ROUNDS {
            fit.outliers = (0..readings.len())
                .filter(|i| out[*i])
                .map(|index| Outlier { index, deviation: deviations[index] })
                .collect();
            return Ok(fit);
        }
        out = next;
    }
}

/// Range of all readings: the curve covers the ends, whether their readings stay or not. `None` for a whole turn.
pub(super) fn range(readings: &[Reading], request: &Request) -> Result<Option<[f64; 2]>, FitError> {
    // numbers that are none are refused before they can hide as outliers
    let data = Data::new(readings, request.turn)?;
    Ok(data.turn.is_none().then(|| data.range()))
}

/// Which readings are outliers of a fit that `out` were left out of, and all deviations from it. What a reading that
/// was kept may deviate by is less where the curve follows it, what one that was left out may is more.
fn verdict(readings: &[Reading], fit: &CurveFit, out: &[bool]) -> (Vec<bool>, Vec<f64>) {
    let deviations: Vec<f64> = readings.iter().map(|r| r.value - fit.value(r.position, r.travel)).collect();
    let (n, m) = (fit.figures.n as f64, fit.figures.m as f64);
    let scale = spread(&deviations).max(fit.figures.rmse_n * 1e-3) * (n / (n - m).max(1.0)).sqrt();
    let floor = 1e-9 * readings.iter().fold(0.0f64, |a, r| a.max(r.value.abs()));
    let limit = LIMIT * scale.max(floor);
    let leverage = |r: &Reading| {
        let band = fit.band.as_ref().filter(|b| b.sigma() > 0.0);
        band.map_or(0.0, |b| (b.std_at(r.position, r.travel) / b.sigma()).powi(2))
    };
    let verdicts = readings.iter().zip(&deviations).zip(out).map(|((r, d), out)| {
        // most readings are near enough not to ask
        if d.abs() <= LEVERAGE_FLOOR.sqrt() * limit {
            return false;
        }
        let share = if *out { 1.0 + leverage(r) } else { (1.0 - leverage(r)).max(LEVERAGE_FLOOR) };
        d.abs() > limit * share.sqrt()
    });
    (verdicts.collect(), deviations)
}

/// Standard deviation by the median of the absolute values; by the mean square where more than half are zero.
fn spread(values: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = values.iter().map(|v| v.abs()).collect();
    let middle = sizes.len() / 2;
    let median = *sizes.select_nth_unstable_by(middle, f64::total_cmp).1;
    if median > 0.0 {
        return FROM_MEDIAN * median;
    }
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

/// Where targets were repeated often enough their medians judge, else the first curve does.
fn first_verdict(readings: &[Reading], request: &Request) -> Result<Vec<bool>, FitError> {
    let deviations = match from_medians(readings) {
        Some(deviations) => deviations,
        None if request.basis == Some(Basis::Table) => return Err(FitError::NoRepeats),
        None => from_first_curve(readings),
    };
    let limit = LIMIT * spread(&deviations);
    Ok(deviations.iter().map(|d| d.abs() > limit).collect())
}

/// Deviations from the median of the same target and direction; `None` where one has fewer than three readings.
fn from_medians(readings: &[Reading]) -> Option<Vec<f64>> {
    let (positions, group) = group_by_position(readings);
    if 3 * positions.len() > readings.len() {
        return None;
    }
    let mut cells: Vec<Vec<f64>> = vec![Vec::new(); 2 * positions.len()];
    let slot = |i: usize| 2 * group[i] + usize::from(readings[i].travel == Travel::Reverse);
    for (i, r) in readings.iter().enumerate() {
        cells[slot(i)].push(r.value);
    }
    if cells.iter().any(|c| !c.is_empty() && c.len() < 3) {
        return None;
    }
    let medians: Vec<f64> = cells.into_iter().map(|c| median(c).unwrap_or(f64::NAN)).collect();
    // a median follows its own few readings: sqrt(n/(n-1)) about makes up for it
    let mean_count = readings.len() as f64 / medians.iter().filter(|m| m.is_finite()).count() as f64;
    let widened = (mean_count / (mean_count - 1.0)).sqrt();
    Some(readings.iter().enumerate().map(|(i, r)| (r.value - medians[slot(i)]) * widened).collect())
}

/// Deviations from half waves with a reversal that outliers cannot drag.
fn from_first_curve(readings: &[Reading]) -> Vec<f64> {
    let [low, high] = hull(readings.iter().map(|r| r.position));
    let directions = readings.iter().any(|r| r.travel != readings[0].travel);
    let terms = (readings.len() / READINGS_PER_TERM).clamp(2, TERMS);
    let shape = Shape {
        basis: Basis::HalfRange,
        order: terms - 2,
        range: [low, high],
        periods: Vec::new(),
        linear: true,
    };
    let columns = terms + usize::from(directions);
    let row = |r: &Reading, row: &mut [f64]| {
        shape.row(r.position, &mut row[..terms]);
        if directions {
            row[terms] = if r.travel == Travel::Reverse { -1.0 } else { 1.0 };
        }
    };
    // a part of a long record, evenly scattered over it, is enough for a first curve
    let part: Vec<Reading> = if readings.len() > FIRST_READINGS {
        let stride = readings.len() as f64 / FIRST_READINGS as f64;
        let place = |i: usize| (i as f64 * stride + (i as f64 * GOLDEN).fract() * stride) as usize;
        (0..FIRST_READINGS).map(|i| readings[place(i).min(readings.len() - 1)]).collect()
    } else {
        readings.to_vec()
    };
    let c = first_coefficients(&part, columns, &row);
    let mut line = vec![0.0; columns];
    readings
        .iter()
        .map(|r| {
            row(r, &mut line);
            r.value - dot(&line, c.as_slice())
        })
        .collect()
}

/// Least absolute deviations, then Tukey's weights, each until the weights have done their work.
fn first_coefficients(
    readings: &[Reading],
    columns: usize,
    row: &impl Fn(&Reading, &mut [f64]),
) -> DVector<f64> {
    let mut weights = vec![1.0; readings.len()];
    let mut deviations: Vec<f64> = readings.iter().map(|r| r.value).collect();
    let mut c = DVector::zeros(columns);
    for round in 0..2 * ITERATIONS {
        let Some(next) = weighted(readings, &weights, columns, row) else { break };
        c = next;
        let mut line = vec![0.0; columns];
        for (r, d) in readings.iter().zip(&mut deviations) {
            row(r, &mut line);
            *d = r.value - dot(&line, c.as_slice());
        }
        let scale = spread(&deviations);
        if scale <= 0.0 {
            break;
        }
        for (w, d) in weights.iter_mut().zip(&deviations) {
            *w = if round < ITERATIONS {
                // least absolute deviations, rounded off near zero
                1.0 / d.abs().max(0.05 * scale)
            } else {
                let u = d / (TUKEY * scale);
                (1.0 - u * u).max(0.0).powi(2)
            };
        }
    }
    c
}

fn weighted(
    readings: &[Reading],
    weights: &[f64],
    columns: usize,
    row: &impl Fn(&Reading, &mut [f64]),
) -> Option<DVector<f64>> {
    let mut matrix = DMatrix::zeros(columns, columns);
    let mut right = DVector::zeros(columns);
    let mut line = vec![0.0; columns];
    for (r, w) in readings.iter().zip(weights).filter(|(_, w)| **w > 0.0) {
        row(r, &mut line);
        for j in 0..columns {
            let scaled = w * line[j];
            right[j] += scaled * r.value;
            for i in j..columns {
                matrix[(i, j)] += scaled * line[i];
            }
        }
    }
    Some(matrix.cholesky()?.solve(&right))
}
