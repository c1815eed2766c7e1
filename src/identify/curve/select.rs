//! Which order, which period, which basis, which reversal: AICc proposes, leaving out whole positions checks.

use super::band::Band;
use super::basis::Shape;
use super::data::Data;
use super::error::CONDITION_LIMIT;
use super::error::FitError;
use super::figures::Figures;
use super::fitted::{CurveFit, Note, ReversalFit};
use super::request::{Basis, Period, Request, Reversal};
use super::sampling::COMMON_PITCHES;
use super::solve::{Design, Factor};
use super::{periods, support};
use crate::prelude::*;
use volcomp_estimate::SpectralWindow;
use volcomp_model::curve::{Chebyshev, MAX_TERMS};

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
/// Positions that each number of a series with fitted period needs, where its order is chosen: a period that is free
/// bends a few harmonics through almost any few points.
const POSITIONS_PER_NUMBER: usize = 2;
/// Most positions of a test with targets, where the wave of a screw's pitch is looked for, and how much shorter than the common ones
/// a pitch may be.
const POSITIONS_SCREW: usize = 200;
const PITCH_MARGIN: f64 = 0.8;
/// Most numbers that describe a reversal, and positions measured in both directions that each of them needs.
const REVERSAL_COLUMNS: usize = 6;
const REVERSAL_POSITIONS: usize = 4;
/// Support points of a curved reversal in the model.
const REVERSAL_POINTS: usize = 129;

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

/// A fit known by its figures; its coefficients are worked out once it is taken.
#[derive(Debug, Clone)]
struct Candidate {
    shape: Shape,
    reversal: usize,
    /// Number of the first period that was fitted, where one was.
    fitted: Option<usize>,
    figures: Figures,
}

impl Candidate {
    /// Numbers beside the coefficients: fitted periods.
    fn fitted_periods(&self) -> usize {
        self.fitted.map_or(0, |first| self.shape.periods.len() - first)
    }
}

/// The best curve of any family.
pub(super) fn best_of_all(data: &Data, request: &Request) -> Result<CurveFit, FitError> {
    if data.turn.is_some() {
        // only what repeats after a turn closes
        let wave = best_of_basis(data, Basis::Fourier, request)?;
        return Ok(table_where_better(data, wave, request));
    }
    let mut best = best_of_basis(data, Basis::HalfRange, request)?;
    if let Ok(other) = best_of_basis(data, Basis::Chebyshev, request)
        && improvement(data, &best.figures, &other.figures) > 0.0
    {
        best = other;
    }
    if let Ok(other) = best_of_basis(data, Basis::Fourier, request)
        && improvement(data, &best.figures, &other.figures) > AICC_STEP
        && predicts_no_worse(&best, &other)
    {
        best = other;
    }
    if let Some(other) = screw_wave(data, request, &best) {
        best = other;
    }
    Ok(table_where_better(data, best, request))
}

/// One wave of a pitch shorter than two mean distances of the targets, where these do not alias it. The best of many pitches is
/// better by chance, too: AICc must fall by twice the logarithm of the number of pitches that the range tells apart as well.
fn screw_wave(data: &Data, request: &Request, best: &CurveFit) -> Option<CurveFit> {
    let positions = &data.positions;
    let given = request.order.is_some() || !matches!(request.period, Period::Auto);
    if given || !request.further_periods.is_empty() || positions.len() > POSITIONS_SCREW {
        return None;
    }
    let shortest = COMMON_PITCHES.into_iter().fold(f64::INFINITY, f64::min);
    let [longest, _] = periods::period_range(positions, 1);
    let low = PITCH_MARGIN * shortest;
    let span = positions[positions.len() - 1] - positions[0];
    let tellable = span * (1.0 / low - 1.0 / longest);
    if tellable < 1.0 || !periods::is_searchable(span, [low, longest]) {
        return None;
    }
    let wave = Request { order: Some(1), period: Period::Within([low, longest]), ..request.clone() };
    let found = best_of_basis(data, Basis::Fourier, &wave).ok()?;
    let price = AICC_STEP + 2.0 * tellable.ln();
    let is_taken = improvement(data, &best.figures, &found.figures) > price
        && predicts_no_worse(best, &found)
        && found.period.is_some_and(|p| !SpectralWindow::new(positions).is_aliased(p));
    is_taken.then_some(found)
}

/// The table where it describes the targets better, or where straight lines between them predict a left-out target
/// better than the curve does. A table has no residual unless targets were repeated: nothing to compare.
fn table_where_better(data: &Data, best: CurveFit, request: &Request) -> CurveFit {
    if data.n > data.cells.len()
        && !best.figures.is_exact(data)
        && let Ok(other) = support::fit(data, request.interpolation, request.smoothing)
        && other.figures.n > other.figures.m
    {
        let between = |f: &CurveFit| f.figures.position_rmse.unwrap_or(f64::INFINITY);
        if improvement(data, &best.figures, &other.figures) > AICC_STEP
            || (1.0 - CHECK_MARGIN) * between(&best) > between(&other)
        {
            return other;
        }
    }
    best
}

/// The best curve of one family.
pub(super) fn best_of_basis(data: &Data, basis: Basis, request: &Request) -> Result<CurveFit, FitError> {
    let limit = highest_order(basis, data.positions.len());
    let lowest = usize::from(basis == Basis::Fourier);
    let reversal = saturated_reversal(data, request);
    if let (Some(order), Basis::HalfRange | Basis::Chebyshev, 0) = (request.order, basis, reversal)
        && order <= limit
        && request.penalties.is_none()
    {
        // nothing to choose
        let shape = Shape { basis, order, range: data.range(), periods: Vec::new(), linear: false };
        return finish(data, &shape, 0, None, request);
    }
    let (tried, problem) = if let Some(order) = request.order {
        if order > limit {
            let positions = data.positions.len();
            return Err(FitError::OrderTooHigh { basis, order, limit, positions });
        }
        if order < lowest {
            return Err(FitError::NoHarmonic);
        }
        (candidates(data, basis, order..=order, reversal, request)?, None)
    } else {
        let fitted =
            basis == Basis::Fourier && !(matches!(request.period, Period::Given(_)) || data.turn.is_some());
        let auto_limit = if fitted {
            // mean, linear part and period count, too
            let numbers = data.positions.len() / POSITIONS_PER_NUMBER;
            AUTO_HARMONICS_LIMIT.min(numbers.saturating_sub(2) / 2).max(lowest)
        } else {
            AUTO_ORDER_LIMIT
        };
        let orders = lowest..=limit.min(auto_limit);
        match candidates(data, basis, orders, reversal, request) {
            Ok(tried) => (tried, None),
            Err(e @ (FitError::Degenerate { .. } | FitError::PeriodSearchEmpty { .. })) => {
                (Vec::new(), Some(e))
            }
            Err(e) => return Err(e),
        }
    };
    let too_few = FitError::TooFewPositions { found: data.positions.len(), needed: 2 + lowest };
    let (taken, note) = choose(data, tried).ok_or(problem.unwrap_or(too_few))?;
    let Candidate { mut shape, reversal, fitted, .. } = with_reversal(data, taken, reversal, request);
    if let Some(given) = fitted {
        shape.periods = periods::refine(data, &shape, reversal, given, request)?;
    }
    let mut fit = finish(data, &shape, reversal, fitted, request)?;
    fit.notes.extend(note);
    Ok(fit)
}

/// The columns of a reversal that is left free while the curve is chosen; 0 where there is none to keep.
fn saturated_reversal(data: &Data, request: &Request) -> usize {
    if request.reversal == Reversal::Mean || !data.both_directions() {
        return 0;
    }
    match data.reversals().len() {
        0 => 0,
        pairs => (pairs / REVERSAL_POSITIONS).clamp(1, REVERSAL_COLUMNS),
    }
}

/// Every order of a family that the positions can carry, with its figures.
fn candidates(
    data: &Data,
    basis: Basis,
    orders: core::ops::RangeInclusive<usize>,
    reversal: usize,
    request: &Request,
) -> Result<Vec<Candidate>, FitError> {
    let shape = |order| Shape { basis, order, range: data.range(), periods: Vec::new(), linear: false };
    if basis != Basis::Fourier {
        return ladder(data, &shape(*orders.end()), orders, reversal, None, request);
    }
    let mut found = Vec::new();
    for order in orders.clone() {
        let with = |linear: bool| {
            let mut shape = Shape { linear, ..shape(order) };
            let periods = 1 + request.further_periods.len();
            if 1 + usize::from(linear) + 2 * order * periods > data.positions.len() {
                let (limit, positions) = (order.saturating_sub(1), data.positions.len());
                return Err(FitError::OrderTooHigh { basis, order, limit, positions });
            }
            let (periods, given) = periods::resolve(data, &shape, reversal, request)?;
            let fitted = (given < periods.len()).then_some(given);
            shape.periods = periods;
            let mut one = ladder(data, &shape, order..=order, reversal, fitted, request)?;
            one.pop().ok_or(FitError::NoHarmonic)
        };
        let attempt = match request.linear {
            Some(linear) => with(linear),
            // a straight part does not close
            None if data.turn.is_some() => with(false),
            None => with(false).map(|plain| match with(true) {
                Ok(line) if improvement(data, &plain.figures, &line.figures) > AICC_STEP => line,
                _ => plain,
            }),
        };
        match attempt {
            Ok(candidate) => {
                let exact = candidate.figures.is_exact(data);
                found.push(candidate);
                // nothing is left to explain
                if exact {
                    break;
                }
            }
            Err(e) if found.is_empty() => return Err(e),
            Err(_) => break,
        }
    }
    Ok(found)
}

/// Several orders of one shape from one factorisation: their columns are the first ones of the highest.
fn ladder(
    data: &Data,
    shape: &Shape,
    orders: core::ops::RangeInclusive<usize>,
    reversal: usize,
    fitted: Option<usize>,
    request: &Request,
) -> Result<Vec<Candidate>, FitError> {
    let design = Design { reversal, reversal_first: true, ..Design::of(shape) };
    if let Some(given) = &request.penalties
        && (given.len() != shape.len() || orders.start() != orders.end())
    {
        return Err(FitError::PenaltyCount { found: given.len(), terms: shape.len() });
    }
    let factor = Factor::new(data, &design, &penalty(shape, reversal, true, request));
    let first = *orders.start();
    let shapes: Vec<Shape> = orders
        .map(|order| Shape { order, ..shape.clone() })
        .take_while(|s| factor.is_sound(reversal + s.len()))
        .collect();
    if shapes.is_empty() {
        let columns = reversal + Shape { order: first, ..shape.clone() }.len();
        let condition = factor.condition(columns);
        return Err(FitError::Degenerate { basis: shape.basis, order: first, condition });
    }
    let columns: Vec<usize> = shapes.iter().map(|s| reversal + s.len()).collect();
    let rungs = factor.nested_fits(data, &design, &columns);
    let mut found: Vec<Candidate> = Vec::with_capacity(shapes.len());
    for (shape, rung) in shapes.into_iter().zip(rungs) {
        let periods = fitted.map_or(0, |first| shape.periods.len() - first);
        let figures = Figures::new(data, &rung.sums, rung.columns + periods);
        let exact = figures.is_exact(data);
        found.push(Candidate { shape, reversal, fitted, figures });
        if exact {
            break;
        }
    }
    Ok(found)
}

/// The penalties `lambda k^4` in the order of the columns.
fn penalty(shape: &Shape, reversal: usize, reversal_first: bool, request: &Request) -> Vec<f64> {
    let mut own = match (&request.penalties, request.ridge) {
        (Some(given), _) => given.clone(),
        (None, Some(lambda)) => shape.orders().into_iter().map(|k| lambda * (k as f64).powi(4)).collect(),
        (None, None) => return Vec::new(),
    };
    let at = if reversal_first { 0 } else { own.len() };
    own.splice(at..at, core::iter::repeat_n(0.0, reversal));
    own
}

/// The fit of lowest AICc. A lower order is taken where it predicts left-out positions better and describes the
/// measured ones nearly as well; where it would lose what the positions show again and again, it is only noted.
fn choose(data: &Data, tried: Vec<Candidate>) -> Option<(Candidate, Option<Note>)> {
    let figures = |i: usize| &tried[i].figures;
    let proposed = (0..tried.len())
        .reduce(|best, i| if improvement(data, figures(best), figures(i)) > 0.0 { i } else { best })?;
    let or_worst = |v: Option<f64>| v.unwrap_or(f64::INFINITY);
    let between = |i: usize| or_worst(figures(i).position_rmse);
    let at_targets = |i: usize| or_worst(figures(i).loo_rmse);
    let exact = figures(proposed).is_exact(data);
    let better: Vec<usize> =
        (0..proposed).filter(|&i| !exact && between(i) < (1.0 - CHECK_MARGIN) * between(proposed)).collect();
    let best = |candidates: &mut dyn Iterator<Item = usize>| {
        candidates.reduce(|best, i| if between(i) < between(best) { i } else { best })
    };
    let affordable = |i: &usize| at_targets(*i) <= (1.0 + TARGET_MARGIN) * at_targets(proposed);
    let taken = best(&mut better.iter().copied().filter(affordable)).unwrap_or(proposed);
    let order = |i: usize| tried[i].shape.order;
    let note = match best(&mut better.iter().copied()) {
        Some(_) if taken != proposed => Some(Note::OrderLowered { from: order(proposed), to: order(taken) }),
        Some(lower) => Some(Note::SparseTargets { error: between(proposed), lower: order(lower) }),
        None => None,
    };
    let taken = tried.into_iter().nth(taken)?;
    Some((taken, note))
}

/// The reversal that AICc asks for beside the chosen curve: none, constant, linear, ..
fn with_reversal(data: &Data, taken: Candidate, saturated: usize, request: &Request) -> Candidate {
    if saturated == 0 {
        return taken;
    }
    let design = Design { reversal: saturated, ..Design::of(&taken.shape) };
    let factor = Factor::new(data, &design, &penalty(&taken.shape, saturated, false, request));
    let own = taken.shape.len();
    let columns: Vec<usize> =
        (own..=own + saturated).take_while(|columns| factor.is_sound(*columns)).collect();
    let of = |(columns, figures): (usize, Figures)| Candidate {
        reversal: columns - own,
        figures,
        ..taken.clone()
    };
    let mut rungs = factor
        .nested_fits(data, &design, &columns)
        .into_iter()
        .map(|rung| (rung.columns, Figures::new(data, &rung.sums, rung.columns + taken.fitted_periods())));
    let Some(none) = rungs.next() else { return taken };
    let best = rungs.reduce(|best, r| if improvement(data, &best.1, &r.1) > 0.0 { r } else { best });
    match best {
        Some(best) if improvement(data, &none.1, &best.1) > AICC_STEP => of(best),
        _ => of(none),
    }
}

/// By how much AICc falls from `a` to `b`; an exact fit beats everything that is not.
fn improvement(data: &Data, a: &Figures, b: &Figures) -> f64 {
    match (a.is_exact(data), b.is_exact(data), a.aicc, b.aicc) {
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

/// Coefficients, curves and band of what was chosen.
fn finish(
    data: &Data,
    shape: &Shape,
    reversal: usize,
    fitted: Option<usize>,
    request: &Request,
) -> Result<CurveFit, FitError> {
    let design = Design { reversal, ..Design::of(shape) };
    let penalty = penalty(shape, reversal, false, request);
    let factor = Factor::new(data, &design, &penalty);
    let k = design.len();
    let condition = factor.condition(k);
    let degenerate = || FitError::Degenerate { basis: shape.basis, order: shape.order, condition };
    if !factor.is_sound(k) || condition > CONDITION_LIMIT {
        return Err(degenerate());
    }
    // refinement solves the normal equations of the readings alone, which a ridge has not
    let ridge = penalty.iter().any(|p| *p > 0.0);
    let solution = if ridge { factor.coefficients(k) } else { factor.refined(data, &design) };
    let c = solution.ok_or_else(degenerate)?;
    let sums = factor.nested_fits(data, &design, &[k])[0].sums;
    let fitted_periods = fitted.map_or(0, |first| shape.periods.len() - first);
    let figures = Figures::new(data, &sums, k + fitted_periods);
    let (own, turned) = c.as_slice().split_at(shape.len());
    let mut curves = shape.curves(own)?;
    let reversal_fit = (reversal > 0).then(|| ReversalFit { coefficients: turned.to_vec() });
    if reversal > 0 {
        curves.push(reversal_table(shape.range, turned)?);
    }
    let band = figures.rmse_dof.map(|sigma| {
        let with_periods = fitted.and_then(|first| {
            let design = Design { slopes: Some((own, first)), ..design };
            let factor = Factor::new(data, &design, &[]);
            // a wave without amplitude has any period
            let is_known = |(at, period): (usize, &f64)| sigma < factor.r[(at, at)].abs() * period;
            let known = factor.r.nrows() == design.len() && (k..).zip(&shape.periods[first..]).all(is_known);
            known.then(|| (factor.shared(data, &design), factor.r, Some(first)))
        });
        let (shared, r, fitted) =
            with_periods.unwrap_or_else(|| (factor.shared(data, &design), factor.r.clone(), None));
        Band::linear(sigma, figures.dof(data), r, (shape, reversal), own, fitted).with_shared(shared)
    });
    Ok(CurveFit {
        order: Some(shape.order),
        period: shape.periods.get(fitted.unwrap_or(0)).copied(),
        periods: shape.periods.clone(),
        period_fitted: fitted.is_some(),
        reversal: reversal_fit,
        band,
        condition,
        ..CurveFit::new(shape.basis, own.to_vec(), curves, figures)
    })
}

/// Half the reversal as a table: added towards plus, taken off towards minus.
fn reversal_table(range: [f64; 2], half: &[f64]) -> Result<Curve, FitError> {
    let [low, high] = range;
    let curve = Chebyshev::new(low, high, half.to_vec())?;
    // up to a straight line two points say it all
    let points = if half.len() <= 2 { 2 } else { REVERSAL_POINTS };
    let at = |i: usize| low + (high - low) * i as f64 / (points - 1) as f64;
    let positions: Vec<f64> = (0..points).map(|i| if i + 1 == points { high } else { at(i) }).collect();
    let forward: Vec<f64> = positions.iter().map(|x| curve.value(*x)).collect();
    let reverse = forward.iter().map(|v| -v).collect();
    Ok(Curve::Table(Table::new(positions, forward, Some(reverse), Interpolation::Linear)?))
}

/// True where a curve differs between the directions of travel.
pub(super) fn holds_reversal(fit: &CurveFit) -> bool {
    let [low, high] = fit.curve.range().unwrap_or([0.0, 1.0]);
    (0..=8).any(|i| {
        let x = low + (high - low) * f64::from(i) / 8.0;
        fit.value(x, Travel::Forward) != fit.value(x, Travel::Reverse)
    })
}
