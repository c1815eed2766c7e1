//! All effects at once: which columns the data can tell apart, least squares, contributions.

use crate::prelude::*;

use super::check::check;
use super::columns::{self, Column, Play, What};
use super::covariance::{hanging_together, widening};
use super::{
    Analysis, BallbarError, Circles, Effect, End, Estimate, Harmonic, LengthChange, Note, Pitch, Reason,
    Request, Sample, Value, pitch,
};

/// Part of a column, of unit length, that must be left beside the others; below it the data cannot tell it from them.
const LEFT_OVER: f64 = 0.03;
/// Correlation of two estimates above which the data hardly tell them apart.
const CONFOUNDED: f64 = 0.9;
/// Standard deviations beyond which an effect is called significant.
const SIGNIFICANT: f64 = 3.3;
/// Probability below which a change of the instrument's length is significant.
const LENGTH_CHANGE: f64 = 0.01;
/// How often, in the mean, places are passed in tests that show one.
const PASSES: f64 = 1.5;
/// Fits with play of the width found before.
const PLAY_FITS: usize = 3;
/// Highest wave reported.
const HARMONICS: usize = 12;
/// Gap in angle up to which waves on the circle mean something, rad.
const CLOSED: f64 = TAU / 36.0;
/// Times to the peak of a spike that are tried, s (without feed: rad, 0.1 to 1.5 deg); longer ones would be shape.
const SPIKE_TIMES: [f64; 2] = [0.003, 0.06];
const SPIKE_ANGLES: [f64; 2] = [0.0017, 0.026];

/// Columns that the data can tell apart, and those that they cannot.
struct Selected {
    columns: Vec<Column>,
    missing: Vec<(Effect, Reason)>,
}

/// A solved problem.
struct Solution {
    coefficients: DVector<f64>,
    residuals: DVector<f64>,
    /// Inverse of the normal matrix.
    cofactor: DMatrix<f64>,
    /// Coefficients per reading: their product with the readings.
    gain: DMatrix<f64>,
    sum: f64,
    condition: f64,
}

/// Analyses the circles of one plane.
///
/// # Errors
/// Too few readings or too short an arc, numbers that are none, a radius in the wrong unit.
pub fn analyse(circles: &Circles, request: &Request) -> Result<Analysis, BallbarError> {
    check(circles, request)?;
    let circles = &columns::away_from_reversals(circles);
    // seen once, a shape of the place looks like a change in time
    let covered = TAU - largest_gap(circles.samples.iter().map(|s| s.angle));
    let is_shown = super::travelled(&circles.samples).iter().sum::<f64>() > PASSES * covered;
    let (mut found, play) = with_play(circles, request, is_shown);
    let Some(change) = found.length_change else { return Ok(found) };
    if !change.is_subtracted {
        // what is not there must not widen the uncertainties of the effects
        found = fitted(circles, request, false, play);
        found.length_change = Some(change);
    }
    found.notes.push(Note::LengthChange(change));
    Ok(found)
}

/// The fit with steps of lost motion, or with play of the width that it finds where less is left so.
fn with_play(circles: &Circles, request: &Request, has_length: bool) -> (Analysis, Play) {
    let mut play = Play::default();
    let mut found = fitted(circles, request, has_length, play);
    for _ in 0..PLAY_FITS {
        let width =
            |axis, end| found.value(Effect::Backlash(axis), Some(end)).map_or(0.0, |v| v.value.max(0.0));
        let wider = [0, 1].map(|axis| [End::Positive, End::Negative].map(|end| width(axis, end)));
        if !columns::is_crossing(circles, wider) {
            break;
        }
        let next = fitted(circles, request, has_length, wider);
        if next.sigma >= found.sigma {
            break;
        }
        (found, play) = (next, wider);
    }
    (found, play)
}

/// The fit with or without a change of the instrument's length.
fn fitted(circles: &Circles, request: &Request, has_length: bool, play: Play) -> Analysis {
    let mut selected = select(circles, request, has_length, play);
    let mut y = DVector::from_iterator(circles.samples.len(), circles.samples.iter().map(|s| s.deviation));
    let spike_time = choose_spike_time(circles, request, &mut selected, &y);
    let pitches = choose_pitches(circles, request, &mut selected, &y);
    let mut solution = solved(&selected.columns, &y);
    // the eccentricity's second order shortens every reading by e^2 sin^2/(2R)
    for _ in 0..2 {
        let [cx, cy] = centre(&selected.columns, &solution.coefficients);
        for (value, s) in y.iter_mut().zip(&circles.samples) {
            let across = cx * s.angle.sin() - cy * s.angle.cos();
            *value = s.deviation + across * across / (2.0 * circles.radius);
        }
        solution = solved(&selected.columns, &y);
    }
    report(circles, selected, &solution, &y, pitches, spike_time)
}

/// Takes the columns one after the other and leaves out those that look like the ones before.
fn select(circles: &Circles, request: &Request, has_length: bool, play: Play) -> Selected {
    let (effects, missing) = columns::of_effects(circles, play);
    let mut selected = Selected { columns: columns::of_circle(circles), missing };
    let mut basis = Basis::of(&selected.columns);
    selected.take_all(effects, &mut basis);
    for axis in 0..2 {
        if let Some(p) = columns::given(request.pitch[axis]) {
            selected.take_all(columns::of_cyclic(circles, axis, p), &mut basis);
        }
    }
    if has_length {
        selected.take_all(columns::of_length(circles), &mut basis);
    }
    selected
}

/// Orthonormal directions of the columns taken so far.
struct Basis {
    directions: Vec<DVector<f64>>,
}

impl Basis {
    fn of(columns: &[Column]) -> Self {
        let mut basis = Self { directions: Vec::new() };
        basis.add_all(columns);
        basis
    }

    fn add_all(&mut self, columns: &[Column]) {
        for column in columns {
            self.add(&column.values);
        }
    }

    /// What is left of a column of unit length beside the others, and its direction.
    fn left(&self, values: &[f64]) -> (f64, DVector<f64>) {
        let mut v = DVector::from_column_slice(values);
        let norm = v.norm();
        if norm == 0.0 {
            return (0.0, v);
        }
        v /= norm;
        // twice is enough for orthogonality to rounding
        for _ in 0..2 {
            for d in &self.directions {
                let along = d.dot(&v);
                v.axpy(-along, d, 1.0);
            }
        }
        (v.norm(), v)
    }

    fn add(&mut self, values: &[f64]) -> f64 {
        let (left, direction) = self.left(values);
        if left > LEFT_OVER {
            self.directions.push(direction / left);
        }
        left
    }
}

impl Selected {
    fn take_all(&mut self, columns: impl IntoIterator<Item = Column>, basis: &mut Basis) {
        columns.into_iter().for_each(|column| self.take(column, basis));
    }

    fn take(&mut self, column: Column, basis: &mut Basis) {
        if basis.add(&column.values) > LEFT_OVER {
            self.columns.push(column);
            return;
        }
        let What::Of(effect, _) = column.what else { return };
        let shows = column.values.iter().any(|v| *v != 0.0);
        let reason = if shows { Reason::LooksLike(self.alike(&column)) } else { Reason::NoReversal(None) };
        let entry = (effect, reason);
        if !self.missing.contains(&entry) {
            self.missing.push(entry);
        }
    }

    /// The effects that make up most of a column that is a mixture of those taken.
    fn alike(&self, column: &Column) -> Vec<Effect> {
        let y = DVector::from_column_slice(&column.values);
        let solution = solved(&self.columns, &y);
        let sizes: Vec<(Effect, f64)> = self
            .columns
            .iter()
            .zip(solution.coefficients.iter())
            .filter_map(|(c, k)| match c.what {
                What::Of(effect, _) => {
                    Some((effect, k.abs() * DVector::from_column_slice(&c.values).norm() / y.norm()))
                }
                _ => None,
            })
            .filter(|(_, size)| *size > 0.3)
            .collect();
        let mut alike: Vec<Effect> = sizes.into_iter().map(|(e, _)| e).collect();
        alike.sort_unstable();
        alike.dedup();
        alike
    }
}

/// Least squares by QR on columns of unit length.
fn solved(columns: &[Column], y: &DVector<f64>) -> Solution {
    let norms: Vec<f64> =
        columns.iter().map(|c| c.values.iter().map(|v| v * v).sum::<f64>().sqrt().max(1e-300)).collect();
    let design = DMatrix::from_fn(y.len(), columns.len(), |i, j| columns[j].values[i] / norms[j]);
    let (q, r) = design.clone().qr().unpack();
    let condition = jacobi::svd(&r).condition();
    let inverse = r.try_inverse().unwrap_or_else(|| DMatrix::zeros(columns.len(), columns.len()));
    let mut gain = &inverse * q.transpose();
    let scaled = &gain * y;
    let residuals = y - &design * &scaled;
    for (mut row, norm) in gain.row_iter_mut().zip(&norms) {
        row /= *norm;
    }
    let cofactor = &inverse * inverse.transpose();
    let cofactor =
        DMatrix::from_fn(columns.len(), columns.len(), |i, j| cofactor[(i, j)] / (norms[i] * norms[j]));
    let coefficients = DVector::from_fn(columns.len(), |j, _| scaled[j] / norms[j]);
    let sum = residuals.norm_squared();
    Solution { coefficients, residuals, cofactor, gain, sum, condition }
}

/// Adds the spikes with the time to their peak at which they explain most.
fn choose_spike_time(
    circles: &Circles,
    request: &Request,
    selected: &mut Selected,
    y: &DVector<f64>,
) -> Option<f64> {
    let limits = spike_times(circles);
    let basis = Basis::of(&selected.columns);
    let explained = |time: f64| {
        let mut basis = Basis { directions: basis.directions.clone() };
        let all = columns::of_spikes(circles, time);
        basis.add_all(&all.places);
        let before = basis.directions.len();
        basis.add_all(&all.spikes);
        basis.directions[before..].iter().map(|d| d.dot(y).powi(2)).sum::<f64>()
    };
    let steps = 12;
    let between = |i: i32| limits[0] * (limits[1] / limits[0]).powf(f64::from(i) / f64::from(steps));
    let candidates: Vec<f64> =
        request.spike_time.map_or_else(|| (0..=steps).map(between).collect(), |t| vec![t]);
    let weighed = candidates.into_iter().map(|t| (t, explained(t)));
    let (time, _) = weighed.max_by(|a, b| a.1.total_cmp(&b.1))?;
    let all = columns::of_spikes(circles, time);
    selected.missing.extend(all.missing);
    let mut basis = basis;
    selected.take_all(all.places, &mut basis);
    let before = selected.columns.len();
    selected.take_all(all.spikes, &mut basis);
    (selected.columns.len() > before).then_some(time)
}

/// Shortest and longest time to the peak of a spike that these readings can show, s (without feed: rad).
fn spike_times(circles: &Circles) -> [f64; 2] {
    let feed = columns::feeds(&circles.samples).last().copied().flatten();
    let way = super::travelled(&circles.samples).iter().sum::<f64>() / circles.samples.len() as f64;
    let ([low, high], spacing) = match feed {
        Some(feed) => (SPIKE_TIMES, way * circles.radius / feed),
        None => (SPIKE_ANGLES, way),
    };
    let low = low.max(spacing);
    [low, high.max(low)]
}

/// Looks for the pitches that were asked for and adds what was found.
fn choose_pitches(
    circles: &Circles,
    request: &Request,
    selected: &mut Selected,
    y: &DVector<f64>,
) -> [Option<f64>; 2] {
    let mut found = request.pitch.map(columns::given);
    for (axis, found) in found.iter_mut().enumerate() {
        let Pitch::Search(limits) = request.pitch[axis] else { continue };
        let now = solved(&selected.columns, y);
        let sigma = (now.sum / (y.len() - selected.columns.len()) as f64).sqrt() * widening(&now.residuals);
        match pitch::search(circles, axis, limits, &now.residuals, sigma) {
            Ok(p) => {
                *found = Some(p);
                let mut basis = Basis::of(&selected.columns);
                selected.take_all(columns::of_cyclic(circles, axis, p), &mut basis);
            }
            Err(limit) => selected.missing.push((Effect::Cyclic(axis), Reason::NoPitch { limit })),
        }
    }
    found
}

fn centre(columns: &[Column], coefficients: &DVector<f64>) -> [f64; 2] {
    let mut centre = [0.0; 2];
    for (c, k) in columns.iter().zip(coefficients.iter()) {
        if let What::Centre(axis) = c.what {
            centre[axis] = *k;
        }
    }
    centre
}

fn report(
    circles: &Circles,
    selected: Selected,
    solution: &Solution,
    y: &DVector<f64>,
    pitch: [Option<f64>; 2],
    spike_time: Option<f64>,
) -> Analysis {
    let samples = &circles.samples;
    let dof = (y.len() - selected.columns.len()) as f64;
    let sigma = (solution.sum / dof).sqrt();
    let white = &solution.cofactor * (sigma * sigma);
    let is_white = widening(&solution.residuals) <= 1.0;
    let (covariance, factor, slow) = if is_white {
        (white, 1.0, None)
    } else {
        hanging_together(&circles.samples, (&solution.residuals, &solution.gain), &white, dof)
    };
    let std = |j: usize| covariance[(j, j)].max(0.0).sqrt();
    let feeds = columns::feeds(samples);
    let mut offset = [(0.0, 0.0); 2];
    let mut radius_deviation = Vec::new();
    let mut length_change = None;
    for (j, column) in selected.columns.iter().enumerate() {
        match column.what {
            What::Centre(axis) => offset[axis] = (solution.coefficients[j], std(j)),
            What::Radius(feed) => radius_deviation.push((feeds[feed], solution.coefficients[j], std(j))),
            What::LengthChange => {
                let (value, std) = (solution.coefficients[j], std(j));
                // what is known of a variance of a few correlation times is less than the number of readings says
                let by_wander = slow.as_ref().map_or(0.0, |s| (s.variance[j] / (std * std)).powi(2) / s.dof);
                let freedom = (1.0 / (1.0 / dof + by_wander)).max(1.0) as usize;
                let p_value = f_upper((value / std).powi(2), 1, freedom);
                let is_subtracted = p_value < LENGTH_CHANGE;
                length_change = Some(LengthChange { value, std, p_value, is_subtracted });
            }
            What::LengthStep | What::Of(..) | What::Place => {}
        }
    }
    let mut estimates = estimates(circles, &selected.columns, &solution.coefficients, &covariance);
    let sum: f64 = estimates.iter().map(|e| e.contribution).sum();
    for e in &mut estimates {
        e.share = if sum > 0.0 { e.contribution / sum } else { 0.0 };
    }
    estimates.sort_by(|a, b| b.contribution.total_cmp(&a.contribution));
    let covered = TAU - largest_gap(samples.iter().map(|s| s.angle));
    let mut notes = Vec::new();
    let forward = samples.iter().filter(|s| s.travel == Travel::Forward).count();
    if forward == 0 || forward == samples.len() {
        notes.push(Note::OneDirection);
    }
    match feeds[..] {
        [None] => notes.push(Note::NoFeed),
        [Some(_)] => notes.push(Note::OneFeed),
        _ => {}
    }
    if TAU - covered > CLOSED {
        notes.push(Note::Arc { covered });
    }
    if factor > 1.0 {
        notes.push(Note::NotWhite { factor });
    }
    let harmonics =
        if TAU - covered > CLOSED { Vec::new() } else { harmonics(circles, y, &solution.residuals) };
    Analysis {
        plane: circles.plane,
        radius: circles.radius,
        centre: circles.centre,
        offset,
        radius_deviation,
        estimates,
        missing: selected.missing,
        pitch,
        spike_time,
        harmonics,
        length_change,
        residuals: samples
            .iter()
            .zip(&solution.residuals)
            .map(|(s, r)| Sample { deviation: *r, ..*s })
            .collect(),
        sigma,
        condition: solution.condition,
        notes,
    }
}

/// The columns of each effect, brought together.
fn estimates(
    circles: &Circles,
    columns: &[Column],
    coefficients: &DVector<f64>,
    covariance: &DMatrix<f64>,
) -> Vec<Estimate> {
    let mut effects: Vec<Effect> = Vec::new();
    for c in columns {
        if let What::Of(effect, _) = c.what
            && !effects.contains(&effect)
        {
            effects.push(effect);
        }
    }
    let circle = Basis::of(&columns::of_circle(circles));
    let of = |effect: Effect| -> Vec<usize> {
        (0..columns.len()).filter(|&j| matches!(columns[j].what, What::Of(e, _) if e == effect)).collect()
    };
    let one = |&effect: &Effect| {
        let which = of(effect);
        let bare: Vec<DVector<f64>> = which.iter().map(|&j| without(&circle, &columns[j].values)).collect();
        let mut trace = DVector::zeros(circles.samples.len());
        for (&j, column) in which.iter().zip(&bare) {
            trace.axpy(coefficients[j], column, 1.0);
        }
        let (low, high) = (trace.imin(), trace.imax());
        let slope: Vec<f64> = bare.iter().map(|c| c[high] - c[low]).collect();
        let block = DMatrix::from_fn(which.len(), which.len(), |a, b| covariance[(which[a], which[b])]);
        let slope = DVector::from_column_slice(&slope);
        let values = values(effect, &which, columns, coefficients, covariance);
        let found = DVector::from_fn(which.len(), |a, _| coefficients[which[a]]);
        let strength = block
            .clone()
            .try_inverse()
            .map_or(0.0, |i| (found.transpose() * i * &found)[0] / which.len() as f64);
        Estimate {
            effect,
            values,
            contribution: trace[high] - trace[low],
            contribution_std: (slope.transpose() * block * &slope)[0].max(0.0).sqrt(),
            share: 0.0,
            significant: strength > SIGNIFICANT.powi(2) / (which.len() as f64).sqrt(),
            confounded: confounded(effect, &effects, &of, covariance),
        }
    };
    effects.iter().map(one).collect()
}

/// A column without what centre and radius hold of it.
fn without(circle: &Basis, values: &[f64]) -> DVector<f64> {
    let mut v = DVector::from_column_slice(values);
    for d in &circle.directions {
        let along = d.dot(&v);
        v.axpy(-along, d, 1.0);
    }
    v
}

fn values(
    effect: Effect,
    which: &[usize],
    columns: &[Column],
    coefficients: &DVector<f64>,
    covariance: &DMatrix<f64>,
) -> Vec<Value> {
    let single = |j: usize| {
        let end = match columns[j].what {
            What::Of(_, end) => end,
            _ => None,
        };
        Value { end, value: coefficients[j], std: covariance[(j, j)].max(0.0).sqrt() }
    };
    let mut list: Vec<Value> = which.iter().map(|&j| single(j)).collect();
    if let (Effect::Cyclic(_), [s, c]) = (effect, which) {
        let (a, b) = (coefficients[*s], coefficients[*c]);
        let amplitude = a.hypot(b);
        let variance = if amplitude > 0.0 {
            (a * a * covariance[(*s, *s)] + b * b * covariance[(*c, *c)] + 2.0 * a * b * covariance[(*s, *c)])
                / (amplitude * amplitude)
        } else {
            covariance[(*s, *s)]
        };
        let peak_to_peak = Value { end: None, value: 2.0 * amplitude, std: 2.0 * variance.max(0.0).sqrt() };
        list.insert(0, peak_to_peak);
    }
    list
}

/// Effects whose estimates are nearly one with this one's.
fn confounded(
    effect: Effect,
    effects: &[Effect],
    of: &dyn Fn(Effect) -> Vec<usize>,
    covariance: &DMatrix<f64>,
) -> Vec<(Effect, f64)> {
    let correlation = |i: usize, j: usize| {
        covariance[(i, j)] / (covariance[(i, i)] * covariance[(j, j)]).sqrt().max(f64::MIN_POSITIVE)
    };
    let mut list: Vec<(Effect, f64)> = effects
        .iter()
        .filter(|other| **other != effect)
        .map(|&other| {
            let pairs = of(effect).into_iter().flat_map(|i| of(other).into_iter().map(move |j| (i, j)));
            let strongest = pairs
                .map(|(i, j)| correlation(i, j))
                .fold(0.0f64, |m, c| if c.abs() > m.abs() { c } else { m });
            (other, strongest)
        })
        .filter(|(_, c)| c.abs() > CONFOUNDED)
        .collect();
    list.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    list
}

/// Amplitudes of the waves on the circle, before and after.
fn harmonics(circles: &Circles, y: &DVector<f64>, residuals: &DVector<f64>) -> Vec<Harmonic> {
    let mut columns = columns::of_circle(circles);
    let first = columns.len();
    for order in 2..=HARMONICS {
        for f in [f64::cos as fn(f64) -> f64, f64::sin] {
            let values = circles.samples.iter().map(|s| f(order as f64 * s.angle)).collect();
            columns.push(Column { what: What::Of(Effect::ScaleMismatch, None), values });
        }
    }
    let [measured, residual] = [y, residuals].map(|v| solved(&columns, v).coefficients);
    let amplitude = |c: &DVector<f64>, order: usize| {
        let at = first + 2 * (order - 2);
        c[at].hypot(c[at + 1])
    };
    (2..=HARMONICS)
        .map(|order| Harmonic {
            order,
            measured: amplitude(&measured, order),
            residual: amplitude(&residual, order),
        })
        .collect()
}
