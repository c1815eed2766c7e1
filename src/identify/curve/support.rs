//! Tables: support points at the targets, each the mean of its readings.

use super::figures::{Figures, rms};
use super::{Basis, CurveFit, Data, FitError};
use crate::core::axes::Travel;
use crate::core::model::Curve;
use crate::core::model::curve::{Interpolation, Table};

/// Mean per position of the readings in one direction.
pub(super) fn means(data: &Data<'_>, travel: Travel) -> Vec<Option<f64>> {
    sums(data, travel).into_iter().map(|(sum, count)| (count > 0).then(|| sum / count as f64)).collect()
}

fn sums(data: &Data<'_>, travel: Travel) -> Vec<(f64, usize)> {
    let mut sums = vec![(0.0, 0usize); data.positions.len()];
    for (reading, &g) in data.readings.iter().zip(&data.group) {
        if reading.travel == travel {
            sums[g].0 += reading.value;
            sums[g].1 += 1;
        }
    }
    sums
}

/// A table through the means; with a reverse curve where both directions were measured.
pub(super) fn fit(data: &Data<'_>, interpolation: Interpolation) -> Result<CurveFit, FitError> {
    let complete = |travel: Travel| {
        let means = means(data, travel);
        match means.iter().position(Option::is_none) {
            Some(i) => Err(FitError::DirectionMissing { position: data.positions[i], travel }),
            None => Ok(means.into_iter().flatten().collect::<Vec<f64>>()),
        }
    };
    let branches: Vec<(Travel, Vec<f64>)> = if data.both_directions() {
        vec![(Travel::Forward, complete(Travel::Forward)?), (Travel::Reverse, complete(Travel::Reverse)?)]
    } else {
        // measured in one direction only: one curve, which then serves both
        let travel = data.readings[0].travel;
        vec![(travel, complete(travel)?)]
    };
    let of = |travel: Travel| &branches[usize::from(branches.len() == 2 && travel == Travel::Reverse)].1;
    let values: Vec<f64> = data.values().collect();
    let fitted: Vec<f64> =
        data.readings.iter().zip(&data.group).map(|(r, &g)| r.value - of(r.travel)[g]).collect();
    let coefficients: Vec<f64> = branches.iter().flat_map(|(_, v)| v.iter().copied()).collect();
    let mut figures = Figures::new(&values, &fitted, coefficients.len());
    figures.loo_rmse = leave_one_out(data, &fitted, &of);
    let inner = data.readings.iter().zip(&data.group).filter(|(_, g)| data.is_inner(**g));
    figures.position_rmse =
        rms(inner.map(|(r, &g)| r.value - from_neighbours(&data.positions, of(r.travel), g)));
    let mut values = branches.into_iter().map(|(_, v)| v);
    let forward = values.next().unwrap_or_default();
    Ok(CurveFit {
        basis: Basis::Table,
        order: None,
        period: None,
        period_fitted: false,
        coefficients,
        curve: Curve::Table(Table::new(data.positions.clone(), forward, values.next(), interpolation)?),
        figures,
        condition: 1.0,
        notes: Vec::new(),
    })
}

/// Each reading predicted from the others at its target, or from the neighbouring targets where it is alone.
fn leave_one_out<'a>(
    data: &Data<'_>,
    residuals: &[f64],
    of: &impl Fn(Travel) -> &'a Vec<f64>,
) -> Option<f64> {
    let counts = [Travel::Forward, Travel::Reverse].map(|t| sums(data, t));
    rms(data.readings.iter().zip(&data.group).zip(residuals).map(|((r, &g), e)| {
        let count = counts[usize::from(r.travel == Travel::Reverse)][g].1 as f64;
        if count > 1.0 {
            e * count / (count - 1.0)
        } else {
            r.value - from_neighbours(&data.positions, of(r.travel), g)
        }
    }))
}

/// The value at support point `i` by a straight line between its neighbours; at the ends the neighbour's value.
fn from_neighbours(x: &[f64], v: &[f64], i: usize) -> f64 {
    match (i.checked_sub(1), i + 1 < x.len()) {
        (Some(a), true) => v[a] + (v[i + 1] - v[a]) * (x[i] - x[a]) / (x[i + 1] - x[a]),
        (Some(a), false) => v[a],
        (None, true) => v[i + 1],
        (None, false) => v[i],
    }
}
