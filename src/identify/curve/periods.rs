//! Fitted periods by variable projection: for given periods the coefficients are linear least squares, so only the
//! periods are searched. A grid in frequency finds the basin, golden sections narrow it, Gauss-Newton steps on all
//! readings with the derivative of the curve by the period finish it to the last digits. Several periods are placed
//! one after the other, then each again with the others held, then all together.

use nalgebra::{DMatrix, DVector};

use super::basis::Shape;
use super::data::Data;
use super::error::FitError;
use super::request::{Period, Request};
use super::solve::{Design, Factor};
use crate::golden::golden;

/// Positions are averaged down to about this number, or to four per shortest wave, while the grid is searched.
const SEARCH_POSITIONS: usize = 256;
const SEARCH_POSITIONS_MAX: usize = 8192;
const POSITIONS_PER_SEARCHED_WAVE: f64 = 4.0;
/// Positions per wave of the highest harmonic; at 2 its sine vanishes at every position.
const POSITIONS_PER_WAVE: f64 = 2.2;
/// Periods with more spread than this between the pivots of the least-squares problem are passed over: their terms
/// cancel at the positions and swing between them.
const PIVOT_LIMIT: f64 = 100.0;
/// Longest period searched, in ranges; beyond it sine, cosine and mean become alike.
const LONGEST_PERIOD: f64 = 1.2;
/// Grid points per `1 / (N T)`, over which the sum of squares changes.
const GRID_DENSITY: f64 = 10.0;
/// Most grid points: a few seconds of work.
const GRID_MAX: usize = 200_000;
/// Minima of the grid that are followed.
const MINIMA: usize = 3;
/// Rounds in which each period is searched again with the others held.
const ROUNDS: usize = 10;
/// Gauss-Newton steps at most, and the relative step at which they end.
const STEPS: usize = 60;
/// Where golden sections end, relative: the steps take over from here.
const GOLDEN_END: f64 = 1e-5;
const STEP_END: f64 = 1e-13;
/// How far the last steps on all readings may move a period that averaged ones gave, as a factor.
const REFINED_WITHIN: f64 = 1.05;

/// The periods that `order` harmonics can have on these distinct, increasing positions: more than two positions
/// per wave of the highest harmonic, at most 1.2 times the range.
#[must_use]
pub fn period_range(positions: &[f64], order: usize) -> [f64; 2] {
    let span = positions[positions.len() - 1] - positions[0];
    let spacing = span / (positions.len() - 1) as f64;
    [POSITIONS_PER_WAVE * order.max(1) as f64 * spacing, LONGEST_PERIOD * span]
}

/// What a request says about periods: the given ones, and where each of the others is searched.
fn wanted(data: &Data, shape: &Shape, request: &Request) -> Result<(Vec<f64>, Vec<[f64; 2]>), FitError> {
    let all = || core::iter::once(&request.period).chain(&request.further_periods);
    let (mut placed, mut ranges) = (Vec::new(), Vec::new());
    for period in all() {
        match (period, data.turn) {
            (Period::Given(value), _) if value.is_finite() && *value > 0.0 => placed.push(*value),
            (Period::Given(value), _) => return Err(FitError::PeriodNotPositive { value: *value }),
            // a whole turn repeats after the turn
            (Period::Auto, Some(turn)) if request.further_periods.is_empty() => placed.push(turn),
            (Period::Auto, _) => {
                ranges.push(period_range(&data.coarsened(SEARCH_POSITIONS).positions, shape.order));
            }
            (Period::Within(range), _) => ranges.push(*range),
        }
    }
    Ok((placed, ranges))
}

/// The periods of a request: given ones as they are, then the fitted ones, longest first. Second: how many are given.
pub(super) fn resolve(
    data: &Data,
    shape: &Shape,
    reversal: usize,
    request: &Request,
) -> Result<(Vec<f64>, usize), FitError> {
    let (placed, ranges) = wanted(data, shape, request)?;
    let given = placed.len();
    if ranges.is_empty() {
        return Ok((placed, given));
    }
    for [low, high] in &ranges {
        if !(low.is_finite() && high.is_finite() && *low > 0.0 && low < high) {
            return Err(FitError::PeriodSearchEmpty { low: *low, high: *high, order: shape.order });
        }
    }
    let shortest = ranges.iter().fold(f64::INFINITY, |a, r| a.min(r[0]));
    let coarse = coarse(data, shape, shortest);
    let best = place(&coarse, shape, placed, &ranges)?
        .into_iter()
        .map(|periods| polish(&coarse, shape, reversal, periods, given, &ranges))
        .min_by(|a, b| a.1.total_cmp(&b.1));
    let Some((mut periods, _)) = best else { return Err(empty(&ranges, shape)) };
    periods[given..].sort_by(|a, b| b.total_cmp(a));
    Ok((periods, given))
}

/// The periods after `given` brought to the last digit on all readings, where the search was on averaged ones; they
/// stay where they were searched.
pub(super) fn refine(
    data: &Data,
    shape: &Shape,
    reversal: usize,
    given: usize,
    request: &Request,
) -> Result<Vec<f64>, FitError> {
    let (_, searched) = wanted(data, shape, request)?;
    let low = searched.iter().fold(f64::INFINITY, |a, r| a.min(r[0]));
    let high = searched.iter().fold(0.0f64, |a, r| a.max(r[1]));
    let ranges: Vec<[f64; 2]> = shape.periods[given..]
        .iter()
        .map(|p| [(p / REFINED_WITHIN).max(low), (p * REFINED_WITHIN).min(high)])
        .collect();
    Ok(polish(data, shape, reversal, shape.periods.clone(), given, &ranges).0)
}

/// Neighbouring positions averaged, as far as the shortest wave allows.
fn coarse(data: &Data, shape: &Shape, shortest: f64) -> Data {
    let waves = shape.order as f64 * (shape.range[1] - shape.range[0]) / shortest;
    let wanted = (POSITIONS_PER_SEARCHED_WAVE * waves) as usize;
    data.coarsened(wanted.clamp(SEARCH_POSITIONS, SEARCH_POSITIONS_MAX))
}

fn empty(ranges: &[[f64; 2]], shape: &Shape) -> FitError {
    FitError::PeriodSearchEmpty { low: ranges[0][0], high: ranges[0][1], order: shape.order }
}

/// Starting values for the last steps: the best few where one period is searched, else the one that settles.
fn place(
    coarse: &Data,
    shape: &Shape,
    mut placed: Vec<f64>,
    ranges: &[[f64; 2]],
) -> Result<Vec<Vec<f64>>, FitError> {
    let given = placed.len();
    for (i, range) in ranges.iter().enumerate() {
        let found = search(coarse, shape, &placed, *range);
        if ranges.len() == 1 {
            let with = |p: f64| placed.iter().copied().chain([p]).collect::<Vec<f64>>();
            return Ok(found.into_iter().map(|(p, _)| with(p)).collect());
        }
        let Some((period, _)) = found.first() else { return Err(empty(&ranges[i..], shape)) };
        placed.push(*period);
    }
    for _ in 0..ROUNDS {
        let before = placed.clone();
        for (i, range) in ranges.iter().enumerate() {
            let mut others = placed.clone();
            others.remove(given + i);
            if let Some((period, _)) = search(coarse, shape, &others, *range).first() {
                placed[given + i] = *period;
            }
        }
        if before.iter().zip(&placed).all(|(a, b)| (a - b).abs() <= 1e-6 * b) {
            break;
        }
    }
    Ok(vec![placed])
}

/// Points of the grid over which `order` harmonics of these periods are searched.
fn grid_steps(order: usize, span: f64, [low, high]: [f64; 2]) -> usize {
    ((GRID_DENSITY * order as f64 * span * (1.0 / low - 1.0 / high)) as usize).max(20)
}

/// True where the grid is fine enough to find every wave of one harmonic within these periods.
pub(super) fn is_searchable(span: f64, range: [f64; 2]) -> bool {
    grid_steps(1, span, range) <= GRID_MAX
}

/// The best periods beside those already placed, with their sums of squares on the coarse data.
fn search(coarse: &Data, shape: &Shape, placed: &[f64], [low, high]: [f64; 2]) -> Vec<(f64, f64)> {
    let span = shape.range[1] - shape.range[0];
    let mut trial = Shape { periods: placed.to_vec(), ..shape.clone() };
    trial.periods.push(high);
    let last = placed.len();
    let mut sse = |frequency: f64| {
        trial.periods[last] = 1.0 / frequency;
        sum_of_squares(coarse, &trial)
    };
    let steps = grid_steps(shape.order, span, [low, high]).min(GRID_MAX);
    let frequency = |i: usize| 1.0 / high + (1.0 / low - 1.0 / high) * i as f64 / steps as f64;
    let grid: Vec<f64> = (0..=steps).map(|i| sse(frequency(i))).collect();
    let mut minima: Vec<usize> = (0..=steps)
        .filter(|&i| {
            grid[i].is_finite()
                && (i == 0 || grid[i] <= grid[i - 1])
                && (i == steps || grid[i] <= grid[i + 1])
        })
        .collect();
    minima.sort_by(|&a, &b| grid[a].total_cmp(&grid[b]));
    let mut found: Vec<(f64, f64)> = minima
        .into_iter()
        .take(MINIMA)
        .map(|i| golden(&mut sse, frequency(i.saturating_sub(1)), frequency((i + 1).min(steps)), GOLDEN_END))
        .map(|(f, s)| (1.0 / f, s))
        .collect();
    found.sort_by(|a, b| a.1.total_cmp(&b.1));
    found
}

/// Gauss-Newton on all readings from `periods`, of which those after `given` move inside their ranges.
fn polish(
    data: &Data,
    shape: &Shape,
    reversal: usize,
    periods: Vec<f64>,
    given: usize,
    ranges: &[[f64; 2]],
) -> (Vec<f64>, f64) {
    let mut here = Shape { periods, ..shape.clone() };
    let (mut coefficients, mut sse) = solved(data, &here, reversal);
    for _ in 0..STEPS {
        let design =
            Design { reversal, slopes: Some((&coefficients[..here.len()], given)), ..Design::of(&here) };
        let k = design.len();
        let factor = Factor::new(data, &design, &[]);
        let Some(solution) = (factor.r.nrows() == k).then(|| factor.coefficients(k)).flatten() else { break };
        let step = &solution.as_slice()[here.len() + reversal..];
        let mut share = 1.0;
        let moved = loop {
            let mut next = here.clone();
            for ((p, d), [low, high]) in next.periods[given..].iter_mut().zip(step).zip(ranges) {
                *p = (*p + share * d).clamp(*low, *high);
            }
            let (c, s) = solved(data, &next, reversal);
            // at the minimum only rounding tells the two apart
            if s <= sse * (1.0 + 1e-15) {
                break Some((next, c, s));
            }
            share *= 0.5;
            if share < 1e-3 {
                break None;
            }
        };
        let Some((next, c, s)) = moved else { break };
        let change =
            next.periods.iter().zip(&here.periods).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max);
        (here, coefficients, sse) = (next, c, s);
        if change <= STEP_END {
            break;
        }
    }
    (here.periods, sse)
}

/// Coefficients and sum of squares with everything but them given.
fn solved(data: &Data, shape: &Shape, reversal: usize) -> (Vec<f64>, f64) {
    let design = Design { reversal, ..Design::of(shape) };
    let k = design.len();
    let factor = Factor::new(data, &design, &[]);
    if factor.r.nrows() < k || !factor.is_sound(k) {
        return (vec![0.0; k], f64::INFINITY);
    }
    let sse = factor.nested_fits(data, &design, &[k])[0].sums.sse;
    factor.coefficients(k).map_or((vec![0.0; k], f64::INFINITY), |c| (c.as_slice().to_vec(), sse))
}

/// Sum of squares of the best coefficients, up to a constant; infinite where the pivots spread too much.
fn sum_of_squares(data: &Data, shape: &Shape) -> f64 {
    let m = shape.len();
    if data.positions.len() < m {
        return f64::INFINITY;
    }
    let mut matrix = DMatrix::zeros(m, m);
    let mut right = DVector::zeros(m);
    let mut row = vec![0.0; m];
    let mut squares = 0.0;
    for cell in &data.cells {
        let (w, y) = (cell.count, cell.mean);
        shape.row(data.positions[cell.group], &mut row);
        squares += w * y * y;
        for (j, a) in row.iter().enumerate() {
            let weighted = w * a;
            right[j] += weighted * y;
            // lower triangle, column by column
            for (i, b) in row.iter().enumerate().skip(j) {
                matrix[(i, j)] += weighted * b;
            }
        }
    }
    let Some(factor) = matrix.cholesky() else { return f64::INFINITY };
    let lower = factor.l_dirty();
    let pivots = (0..m).map(|i| lower[(i, i)]);
    let (high, low) = pivots.fold((0.0f64, f64::INFINITY), |(h, l), p| (h.max(p), l.min(p)));
    if high.is_nan() || high > PIVOT_LIMIT * low {
        return f64::INFINITY;
    }
    match lower.solve_lower_triangular(&right) {
        Some(z) => squares - z.norm_squared(),
        None => f64::INFINITY,
    }
}
