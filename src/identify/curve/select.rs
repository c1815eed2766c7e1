//! Which order, which period, which basis: AICc proposes, leaving out whole positions checks.

use nalgebra::DVector;

use super::basis::Shape;
use super::figures::{Figures, rms};
use super::solve::{Solution, solve, sum_of_squares};
use super::{Basis, CurveFit, Data, FitError, Note, Period, Request, support};
use crate::core::model::curve::MAX_TERMS;

/// A richer family must lower AICc by more than this.
const AICC_STEP: f64 = 4.0;
/// A lower order is taken where it predicts left-out positions better by more than this share.
const CHECK_MARGIN: f64 = 0.05;
/// How much worse, at the measured positions, a lower order may be for that.
const TARGET_MARGIN: f64 = 0.25;
/// Highest order that is tried unasked.
const AUTO_ORDER_LIMIT: usize = 24;
/// Highest number of harmonics that is tried unasked together with a fitted period.
const AUTO_HARMONICS_LIMIT: usize = 8;
/// Positions are averaged down to about this number while the grid of periods is searched.
const SEARCH_POSITIONS: usize = 256;
/// Positions per wave of the highest harmonic; at 2 its sine vanishes at every position.
const POSITIONS_PER_WAVE: f64 = 2.2;
/// Periods with more spread than this between the pivots of the least-squares problem are passed over: their terms
/// cancel at the positions and swing between them.
const PIVOT_LIMIT: f64 = 100.0;
/// Longest period searched, in ranges; beyond it sine, cosine and mean become alike.
const LONGEST_PERIOD: f64 = 1.2;

/// The highest order that `positions` distinct positions may carry: `2 sqrt(n)` keeps equidistant least squares
/// free of oscillation between the positions, and there must be no more terms than positions.
#[must_use]
pub fn highest_order(basis: Basis, positions: usize) -> usize {
    let free = match basis {
        Basis::HalfRange => positions.saturating_sub(2),
        Basis::Chebyshev => positions.saturating_sub(1),
        Basis::Fourier => positions.saturating_sub(1) / 2,
        Basis::Table => return 0,
    };
    // a Chebyshev curve stores its mean among the terms
    let stored = if basis == Basis::Chebyshev { MAX_TERMS - 1 } else { MAX_TERMS };
    free.min((2.0 * (positions as f64).sqrt()) as usize).min(stored)
}

/// The periods that `order` harmonics can have on these distinct, increasing positions: more than two positions
/// per wave of the highest harmonic, at most 1.2 times the range.
#[must_use]
pub fn period_range(positions: &[f64], order: usize) -> [f64; 2] {
    let span = positions[positions.len() - 1] - positions[0];
    let spacing = span / (positions.len() - 1) as f64;
    [POSITIONS_PER_WAVE * order.max(1) as f64 * spacing, LONGEST_PERIOD * span]
}

/// The best curve of any family.
pub(super) fn best_of_all(data: &Data<'_>, request: &Request) -> Result<CurveFit, FitError> {
    let mut best = best_of_basis(data, Basis::HalfRange, request)?;
    if let Ok(other) = best_of_basis(data, Basis::Chebyshev, request)
        && improvement(data, &best, &other) > 0.0
    {
        best = other;
    }
    if let Ok(other) = best_of_basis(data, Basis::Fourier, request)
        && improvement(data, &best, &other) > AICC_STEP
        && predicts_no_worse(&best, &other)
    {
        best = other;
    }
    // a table has no residual unless targets were repeated: nothing to compare
    if data.readings.len() > data.positions.len()
        && let Ok(other) = support::fit(data, request.interpolation)
        && other.figures.n > other.figures.m
        && improvement(data, &best, &other) > AICC_STEP
    {
        best = other;
    }
    Ok(best)
}

/// The best curve of one family.
pub(super) fn best_of_basis(data: &Data<'_>, basis: Basis, request: &Request) -> Result<CurveFit, FitError> {
    let limit = highest_order(basis, data.positions.len());
    let lowest = usize::from(basis == Basis::Fourier);
    if let Some(order) = request.order {
        if order > limit {
            let positions = data.positions.len();
            return Err(FitError::OrderTooHigh { basis, order, limit, positions });
        }
        if order < lowest {
            return Err(FitError::NoHarmonic);
        }
        return at_order(data, basis, order, request);
    }
    let period_is_free = basis == Basis::Fourier && !matches!(request.period, Period::Given(_));
    let auto_limit = if period_is_free { AUTO_HARMONICS_LIMIT } else { AUTO_ORDER_LIMIT };
    let mut tried: Vec<CurveFit> = Vec::new();
    let mut problem = None;
    for order in lowest..=limit.min(auto_limit) {
        match at_order(data, basis, order, request) {
            Ok(fit) => {
                let exact = fit.figures.is_exact(data.values());
                tried.push(fit);
                // nothing is left to explain
                if exact {
                    break;
                }
            }
            Err(e @ (FitError::Degenerate { .. } | FitError::PeriodSearchEmpty { .. })) => {
                problem.get_or_insert(e);
                break;
            }
            Err(e) => return Err(e),
        }
    }
    let too_few = FitError::TooFewPositions { found: data.positions.len(), needed: 2 + lowest };
    choose(data, tried).ok_or(problem.unwrap_or(too_few))
}

/// The fit of lowest AICc. A lower order is taken where it predicts left-out positions better and describes the
/// measured ones nearly as well; where it would lose what the positions show again and again, it is only noted.
fn choose(data: &Data<'_>, tried: Vec<CurveFit>) -> Option<CurveFit> {
    let proposed = (0..tried.len())
        .reduce(|best, i| if improvement(data, &tried[best], &tried[i]) > 0.0 { i } else { best })?;
    let or_worst = |v: Option<f64>| v.unwrap_or(f64::INFINITY);
    let between = |i: usize| or_worst(tried[i].figures.position_rmse);
    let at_targets = |i: usize| or_worst(tried[i].figures.loo_rmse);
    let exact = tried[proposed].figures.is_exact(data.values());
    let better: Vec<usize> =
        (0..proposed).filter(|&i| !exact && between(i) < (1.0 - CHECK_MARGIN) * between(proposed)).collect();
    let best = |candidates: &mut dyn Iterator<Item = usize>| {
        candidates.reduce(|best, i| if between(i) < between(best) { i } else { best })
    };
    let affordable = |i: &usize| at_targets(*i) <= (1.0 + TARGET_MARGIN) * at_targets(proposed);
    let taken = best(&mut better.iter().copied().filter(affordable)).unwrap_or(proposed);
    let note = match (best(&mut better.iter().copied()), tried[proposed].order) {
        (Some(_), Some(from)) if taken != proposed => {
            tried[taken].order.map(|to| Note::OrderLowered { from, to })
        }
        (Some(lower), _) => {
            tried[lower].order.map(|lower| Note::SparseTargets { error: between(proposed), lower })
        }
        _ => None,
    };
    let mut fit = tried.into_iter().nth(taken)?;
    fit.notes.extend(note);
    Some(fit)
}

/// By how much AICc falls from `a` to `b`; an exact fit beats everything that is not.
fn improvement(data: &Data<'_>, a: &CurveFit, b: &CurveFit) -> f64 {
    let exact = |f: &CurveFit| f.figures.is_exact(data.values());
    match (exact(a), exact(b), a.figures.aicc, b.figures.aicc) {
        (true, ..) => f64::NEG_INFINITY,
        (false, true, ..) => f64::INFINITY,
        (false, false, Some(a), Some(b)) => a - b,
        // too few readings for the criterion: never the richer one
        (false, false, None, Some(_)) => f64::INFINITY,
        (false, false, _, None) => f64::NEG_INFINITY,
    }
}

fn predicts_no_worse(a: &CurveFit, b: &CurveFit) -> bool {
    b.figures.position_rmse.unwrap_or(f64::INFINITY) <= a.figures.position_rmse.unwrap_or(f64::INFINITY)
}

/// The fit of one order; a Fourier series gets its linear part and its period here.
fn at_order(data: &Data<'_>, basis: Basis, order: usize, request: &Request) -> Result<CurveFit, FitError> {
    let shape = Shape { basis, order, range: data.range(), period: 1.0, linear: false };
    if basis != Basis::Fourier {
        return fit_shape(data, shape, request, false);
    }
    let with = |linear: bool| {
        let shape = Shape { linear, ..shape };
        if shape.len() > data.positions.len() {
            let (limit, positions) = (order.saturating_sub(1), data.positions.len());
            return Err(FitError::OrderTooHigh { basis, order, limit, positions });
        }
        let (period, fitted) = match request.period {
            Period::Given(value) if value.is_finite() && value > 0.0 => (value, false),
            Period::Given(value) => return Err(FitError::PeriodNotPositive { value }),
            Period::Auto => (search_period(data, shape, period_range(&data.positions, order))?, true),
            Period::Within(range) => (search_period(data, shape, range)?, true),
        };
        fit_shape(data, Shape { period, ..shape }, request, fitted)
    };
    match request.linear {
        Some(linear) => with(linear),
        None => {
            let plain = with(false)?;
            match with(true) {
                Ok(line) if improvement(data, &plain, &line) > AICC_STEP => Ok(line),
                _ => Ok(plain),
            }
        }
    }
}

/// Least squares with everything but the coefficients given.
fn fit_shape(
    data: &Data<'_>,
    shape: Shape,
    request: &Request,
    period_fitted: bool,
) -> Result<CurveFit, FitError> {
    let design = shape.design(data.readings.iter().map(|r| r.position));
    let values: Vec<f64> = data.values().collect();
    let lambda = request.ridge.unwrap_or(0.0);
    let penalty: Vec<f64> = shape.orders().iter().map(|&k| lambda * (k as f64).powi(4)).collect();
    let solution = solve(&design, &values, &penalty).map_err(|condition| FitError::Degenerate {
        basis: shape.basis,
        order: shape.order,
        condition,
    })?;
    let mut figures = Figures::new(&values, &solution.residuals, shape.len() + usize::from(period_fitted));
    figures.loo_rmse =
        rms(solution.residuals.iter().zip(&solution.leverage).map(|(e, h)| e / (1.0 - h).max(0.0)));
    figures.position_rmse = leave_position_out(data, &solution);
    Ok(CurveFit {
        basis: shape.basis,
        order: Some(shape.order),
        period: (shape.basis == Basis::Fourier).then_some(shape.period),
        period_fitted,
        curve: shape.curve(&solution.coefficients)?,
        coefficients: solution.coefficients,
        figures,
        condition: solution.condition,
        notes: Vec::new(),
    })
}

/// Every inner position predicted from all others: `(I - H_gg)^-1 e_g` with equal rows in the group, in closed form.
fn leave_position_out(data: &Data<'_>, solution: &Solution) -> Option<f64> {
    let mut groups = vec![(0.0, 0usize); data.positions.len()];
    for (e, &g) in solution.residuals.iter().zip(&data.group) {
        groups[g].0 += e;
        groups[g].1 += 1;
    }
    let rows = solution.residuals.iter().zip(&solution.leverage).zip(&data.group);
    rms(rows.filter(|(_, g)| data.is_inner(**g)).map(|((e, h), &g)| {
        let (sum, count) = groups[g];
        e + h * sum / (1.0 - count as f64 * h).max(0.0)
    }))
}

/// Variable projection: the period of least SSE, by a grid in frequency, then golden sections on all readings.
fn search_period(data: &Data<'_>, shape: Shape, [low, high]: [f64; 2]) -> Result<f64, FitError> {
    if !(low.is_finite() && high.is_finite() && low > 0.0 && low < high) {
        return Err(FitError::PeriodSearchEmpty { low, high, order: shape.order });
    }
    let coarse = Coarse::new(data);
    let span = shape.range[1] - shape.range[0];
    // SSE changes over about 1/(N T) in frequency
    let steps = ((10.0 * shape.order as f64 * span * (1.0 / low - 1.0 / high)) as usize).max(20);
    let frequency = |i: usize| 1.0 / high + (1.0 / low - 1.0 / high) * i as f64 / steps as f64;
    let grid: Vec<f64> =
        (0..=steps).map(|i| coarse.sse(&Shape { period: 1.0 / frequency(i), ..shape })).collect();
    let mut minima: Vec<usize> = (0..=steps)
        .filter(|&i| {
            grid[i].is_finite()
                && (i == 0 || grid[i] <= grid[i - 1])
                && (i == steps || grid[i] <= grid[i + 1])
        })
        .collect();
    minima.sort_by(|&a, &b| grid[a].total_cmp(&grid[b]));
    let y = DVector::from_iterator(data.readings.len(), data.values());
    let full = |f: f64| {
        let shape = Shape { period: 1.0 / f, ..shape };
        sum_of_squares(shape.design(data.readings.iter().map(|r| r.position)), &y, PIVOT_LIMIT)
    };
    minima
        .into_iter()
        .take(3)
        .map(|i| golden(&full, frequency(i.saturating_sub(1)).min(1.0 / low), frequency((i + 1).min(steps))))
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map(|(f, _)| 1.0 / f)
        .ok_or(FitError::PeriodSearchEmpty { low, high, order: shape.order })
}

/// Neighbouring readings averaged, so that a search costs the same however long the record is.
struct Coarse {
    positions: Vec<f64>,
    /// Values times `sqrt(count)`.
    values: DVector<f64>,
    weights: Vec<f64>,
}

impl Coarse {
    fn new(data: &Data<'_>) -> Self {
        let width = data.positions.len().div_ceil(SEARCH_POSITIONS);
        let mut bins = vec![(0.0, 0.0, 0.0); data.positions.len().div_ceil(width)];
        for (reading, &g) in data.readings.iter().zip(&data.group) {
            let bin = &mut bins[g / width];
            bin.0 += reading.position;
            bin.1 += reading.value;
            bin.2 += 1.0;
        }
        Self {
            positions: bins.iter().map(|(x, _, c)| x / c).collect(),
            values: DVector::from_iterator(bins.len(), bins.iter().map(|(_, y, c)| y / c.sqrt())),
            weights: bins.iter().map(|(_, _, c)| c.sqrt()).collect(),
        }
    }

    fn sse(&self, shape: &Shape) -> f64 {
        let mut design = shape.design(self.positions.iter().copied());
        for (mut row, weight) in design.row_iter_mut().zip(&self.weights) {
            row *= *weight;
        }
        sum_of_squares(design, &self.values, PIVOT_LIMIT)
    }
}

/// Golden-section search for the minimum of `f` on `[a, b]`: place and value.
fn golden(f: &impl Fn(f64) -> f64, mut a: f64, mut b: f64) -> (f64, f64) {
    let ratio = (5f64.sqrt() - 1.0) / 2.0;
    let (mut c, mut d) = (b - ratio * (b - a), a + ratio * (b - a));
    let (mut fc, mut fd) = (f(c), f(d));
    for _ in 0..100 {
        if (b - a).abs() <= 1e-10 * (a.abs() + b.abs()) {
            break;
        }
        if fc <= fd {
            (b, d, fd) = (d, c, fc);
            c = b - ratio * (b - a);
            fc = f(c);
        } else {
            (a, c, fc) = (c, d, fd);
            d = a + ratio * (b - a);
            fd = f(d);
        }
    }
    if fc <= fd { (c, fc) } else { (d, fd) }
}
