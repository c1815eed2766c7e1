//! Tables: support points at the targets, each the mean of its readings, smoothed where wanted.

use super::band::Band;
use super::data::{Cell, Data};
use super::error::FitError;
use super::figures::{Figures, Sums};
use super::fitted::CurveFit;
use super::request::{Basis, Smoothing};
use super::smooth::{Sequence, Smoothed, smooth};
use crate::prelude::*;

/// Steps per decade and decades of the search for the strength of smoothing.
const SEARCH: (i32, i32) = (4, 16);

/// One direction of a table.
struct Branch<'a> {
    travel: Travel,
    cells: Vec<&'a Cell>,
    means: Vec<f64>,
    counts: Vec<f64>,
    smoothed: Smoothed,
}

/// A table through the means; with a reverse curve where both directions were measured and are to be kept apart.
pub(super) fn fit(
    data: &Data,
    interpolation: Interpolation,
    smoothing: Smoothing,
) -> Result<CurveFit, FitError> {
    let mut branches = branches(data)?;
    let alpha = match smoothing {
        Smoothing::None => 0.0,
        Smoothing::Given(alpha) if alpha.is_finite() && alpha >= 0.0 => alpha,
        Smoothing::Given(value) => return Err(FitError::BadSmoothing { value }),
        Smoothing::Auto => search(data, &branches),
    };
    for branch in &mut branches {
        branch.smoothed = smoothed(data, branch, alpha);
    }
    let mut sums = Sums::default();
    let mut freedom = 0.0;
    for branch in &branches {
        freedom += branch.smoothed.leverage.iter().sum::<f64>();
        for (i, cell) in branch.cells.iter().enumerate() {
            let (value, hat) = (branch.smoothed.values[i], branch.smoothed.leverage[i]);
            if alpha > 0.0 {
                sums.add(cell, value, hat / cell.count);
                if data.is_inner(i) {
                    sums.left_out(cell, (cell.mean - value) / (1.0 - hat));
                }
            } else {
                let left_out = cell.mean - from_neighbours(data, &branch.means, i);
                add_mean(&mut sums, cell, left_out);
                if data.is_inner(i) {
                    sums.left_out(cell, left_out);
                }
            }
        }
    }
    // whole numbers are compared: a smoothed table counts its effective ones, rounded up
    let m = (freedom - 1e-6).ceil() as usize;
    let figures = Figures::new(data, &sums, m);
    let band = figures.rmse_dof.map(|sigma| band(data, &branches, sigma, figures.dof(data)));
    let coefficients: Vec<f64> = branches.iter().flat_map(|b| b.smoothed.values.iter().copied()).collect();
    let mut values = branches.into_iter().map(|b| b.smoothed.values);
    let closed = |mut v: Vec<f64>| {
        // the first value again, a turn later
        if data.turn.is_some() {
            v.push(v[0]);
        }
        v
    };
    let forward = closed(values.next().unwrap_or_default());
    let table = Table::new(positions(data), forward, values.next().map(closed), interpolation)?;
    Ok(CurveFit {
        order: None,
        smoothing: (alpha > 0.0).then_some(alpha),
        band,
        ..CurveFit::new(Basis::Table, coefficients, vec![Curve::Table(table)], figures)
    })
}

/// Support points, with the one that closes a whole turn.
fn positions(data: &Data) -> Vec<f64> {
    let mut positions = data.positions.clone();
    positions.extend(data.turn.map(|turn| data.positions[0] + turn));
    positions
}

fn branches(data: &Data) -> Result<Vec<Branch<'_>>, FitError> {
    let complete = |travel: Travel| {
        let cells = data.of(travel);
        match cells.iter().position(Option::is_none) {
            Some(i) => Err(FitError::DirectionMissing { position: data.positions[i], travel }),
            None => {
                let cells: Vec<&Cell> = cells.into_iter().flatten().collect();
                let means = cells.iter().map(|c| c.mean).collect();
                let counts = cells.iter().map(|c| c.count).collect();
                let smoothed = Smoothed { values: Vec::new(), leverage: Vec::new() };
                Ok(Branch { travel, cells, means, counts, smoothed })
            }
        }
    };
    if data.both_directions() {
        Ok(vec![complete(Travel::Forward)?, complete(Travel::Reverse)?])
    } else {
        // measured in one direction only: one curve, which then serves both
        Ok(vec![complete(data.cells[0].travel)?])
    }
}

/// One branch smoothed; a whole turn is repeated on both sides, so that it closes smoothly.
fn smoothed(data: &Data, branch: &Branch<'_>, alpha: f64) -> Smoothed {
    let one = Sequence { x: &data.positions, y: &branch.means, weight: &branch.counts };
    let Some(turn) = data.turn.filter(|_| alpha > 0.0) else { return smooth(&one, alpha) };
    let n = one.x.len();
    let x: Vec<f64> =
        [-turn, 0.0, turn].iter().flat_map(|shift| one.x.iter().map(move |x| x + shift)).collect();
    let (y, weight) = (branch.means.repeat(3), branch.counts.repeat(3));
    let all = smooth(&Sequence { x: &x, y: &y, weight: &weight }, alpha);
    Smoothed { values: all.values[n..2 * n].to_vec(), leverage: all.leverage[n..2 * n].to_vec() }
}

/// The strength of lowest generalised cross-validation, the same for both directions.
fn search(data: &Data, branches: &[Branch<'_>]) -> f64 {
    let (per_decade, decades) = SEARCH;
    let n = data.positions.len() as f64;
    let [low, high] = data.range();
    let weight = branches.iter().flat_map(|b| &b.counts).sum::<f64>() / (n * branches.len() as f64);
    let score = |alpha: f64| {
        let (mut squares, mut freedom, mut count) = (0.0, 0.0, 0.0);
        for branch in branches {
            let s = smoothed(data, branch, alpha);
            squares += (0..s.values.len())
                .map(|i| branch.counts[i] * (branch.means[i] - s.values[i]).powi(2))
                .sum::<f64>();
            freedom += s.leverage.iter().sum::<f64>();
            count += s.values.len() as f64;
        }
        squares / (count - freedom).powi(2)
    };
    // a spline that smooths over one spacing has about this strength
    let unit = weight * ((high - low) / n).powi(3);
    (0..=per_decade * decades)
        .map(|i| unit * 10f64.powf(f64::from(i) / f64::from(per_decade) - 4.0))
        .map(|alpha| (alpha, score(alpha)))
        .filter(|(_, s)| s.is_finite())
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map_or(0.0, |(alpha, _)| alpha)
}

fn band(data: &Data, branches: &[Branch<'_>], sigma: f64, dof: usize) -> Band {
    let shared = |travel: Travel| {
        let cells = data.cells.iter().enumerate().filter(move |(_, c)| c.travel == travel);
        cells.map(|(i, _)| if data.shared.is_empty() { 0.0 } else { data.shared.row(i).norm() })
    };
    let std = |b: &Branch<'_>| {
        let own = b.smoothed.leverage.iter().zip(&b.counts).map(|(h, n)| (h.max(0.0) / n).sqrt());
        let mut std: Vec<[f64; 2]> = own.zip(shared(b.travel)).map(|(own, shared)| [own, shared]).collect();
        if data.turn.is_some() {
            std.push(std[0]);
        }
        std
    };
    let reverse = branches.iter().skip(1).find(|b| b.travel == Travel::Reverse).map(std);
    Band::nodes(sigma, dof, positions(data), std(&branches[0]), reverse)
}

/// A cell about its own mean; left out, a reading is predicted by the others at its target, or from the
/// neighbouring targets where it is alone.
fn add_mean(sums: &mut Sums, cell: &Cell, from_neighbours: f64) {
    sums.sse += cell.within;
    sums.e_max = sums.e_max.max(cell.farthest(cell.mean));
    sums.loo += if cell.count > 1.0 {
        cell.within * (cell.count / (cell.count - 1.0)).powi(2)
    } else {
        from_neighbours * from_neighbours
    };
}

/// The value at support point `i` by a straight line between its neighbours; at the ends the neighbour's value.
fn from_neighbours(data: &Data, v: &[f64], i: usize) -> f64 {
    let (x, last) = (&data.positions, v.len() - 1);
    let before = match (i, data.turn) {
        (0, Some(turn)) => Some((x[last] - turn, v[last])),
        (0, None) => None,
        _ => Some((x[i - 1], v[i - 1])),
    };
    let after = match data.turn {
        Some(turn) if i == last => Some((x[0] + turn, v[0])),
        None if i == last => None,
        _ => Some((x[i + 1], v[i + 1])),
    };
    match (before, after) {
        (Some((a, va)), Some((b, vb))) => va + (vb - va) * (x[i] - a) / (b - a),
        (Some((_, v)), None) | (None, Some((_, v))) => v,
        (None, None) => v[i],
    }
}
