//! Error by error: what each curve says in one model and in the other.

use super::Pair;
use crate::curve::Live;
use crate::kinematics::PointFlags;
use crate::prelude::*;

/// Places of even sampling along an axis; support points of tables are added to them.
const SAMPLES: u32 = 800;
/// Samples on the shortest wave of a series.
const PER_WAVE: f64 = 24.0;
/// Most samples of short waves.
const SAMPLES_MAX: f64 = 20_000.0;
/// Differences below this are rounding, mm.
pub(super) const LENGTH_ZERO: f64 = 1e-10;
/// Differences below this are rounding, rad.
pub(super) const ANGLE_ZERO: f64 = 1e-13;

/// One error that is not the same in both models.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorDifference {
    /// The error.
    pub symbol: ErrorSymbol,
    /// Whether the first and the second model state it.
    pub stated: [bool; 2],
    /// The difference where it is largest, second minus first, mm or rad.
    pub largest: f64,
    /// Programmed coordinate of the axis there, mm or rad; 0 for a constant.
    pub at: f64,
    /// Direction of travel there.
    pub travel: Travel,
    /// Root mean square over the range, mm or rad.
    pub rms: f64,
    /// Programmed coordinates that were compared; `None` for a constant.
    pub over: Option<[f64; 2]>,
    /// Most that transient and live terms that differ may add, mm or rad; `largest` is without them.
    pub unsearched: f64,
    /// Standard uncertainties stated.
    pub std: [Option<f64>; 2],
}

/// What an error motion of a model says in relative sense at programmed coordinates of its axis, mm or rad, all other
/// axes at the lower end of their travel.
#[must_use]
pub fn relative_values(
    spec: &ModelSpec,
    model: &Model,
    symbol: ErrorSymbol,
    positions: &[f64],
    travel: Travel,
) -> Vec<f64> {
    let models = [model.clone(), model.clone()];
    let pair = Pair::new([spec, spec], &models);
    let value = |q: &f64| motions(&pair, 0, symbol.axis(), *q, travel, 0.0)[symbol.component().index()];
    positions.iter().map(value).collect()
}

/// All errors that differ, in the order of their symbols.
pub(super) fn differences(pair: &Pair<'_>) -> Vec<ErrorDifference> {
    let mut symbols: Vec<ErrorSymbol> =
        pair.specs.iter().flat_map(|s| s.errors.iter().map(|(symbol, _)| *symbol)).collect();
    symbols.sort_unstable();
    symbols.dedup();
    symbols.into_iter().filter_map(|symbol| difference(pair, symbol)).collect()
}

fn difference(pair: &Pair<'_>, symbol: ErrorSymbol) -> Option<ErrorDifference> {
    let functions = pair.specs.map(|s| s.error(symbol));
    if functions[0] == functions[1] && same_sense(pair, symbol.axis()) {
        return None;
    }
    let zero = if symbol.is_angle() { ANGLE_ZERO } else { LENGTH_ZERO };
    let stated = functions.map(|f| f.is_some());
    let std = functions.map(|f| f.and_then(|f| f.std));
    let mut out = ErrorDifference {
        symbol,
        stated,
        largest: 0.0,
        at: 0.0,
        travel: Travel::Forward,
        rms: 0.0,
        over: None,
        unsearched: unsearched(functions),
        std,
    };
    if symbol.is_constant() {
        let value = |f: Option<&ErrorFunction>| f.map_or(0.0, |f| f.value(0.0, Travel::Forward));
        out.largest = value(functions[1]) - value(functions[0]);
        out.rms = out.largest.abs();
    } else {
        let (mut sum, mut count) = (0.0, 0.0);
        let samples = samples(pair, symbol.axis());
        out.over = samples.first().zip(samples.last()).map(|(low, high)| [*low, *high]);
        each(pair, symbol.axis(), &samples, |q, travel, values| {
            let d = values[symbol.component().index()];
            sum += d * d;
            count += 1.0;
            if d.abs() > out.largest.abs() {
                (out.largest, out.at, out.travel) = (d, q, travel);
            }
        });
        out.rms = f64::sqrt(sum / f64::max(count, 1.0));
    }
    let moved = out.largest.abs() > zero;
    let signals = functions.map(|f| f.map(|f| (&f.live, &f.dynamics)));
    (moved || stated[0] != stated[1] || std[0] != std[1] || signals[0] != signals[1]).then_some(out)
}

/// Most by which transient and live terms may differ, mm or rad: by their limits.
fn unsearched(functions: [Option<&ErrorFunction>; 2]) -> f64 {
    let transients = functions.map(|f| {
        let all = f.map_or(&[][..], |f| &f.dynamics).iter();
        all.filter(|d| d.law.is_transient()).collect::<Vec<_>>()
    });
    let only = |some: &[&DynamicTerm], others: &[&DynamicTerm]| -> f64 {
        some.iter().filter(|t| !others.contains(t)).map(|t| t.limit).sum()
    };
    let [a, b] = functions.map(|f| f.map_or(&[][..], |f| &f.live));
    let twin = |live: &Live, others: &[Live]| {
        let same = |o: &&Live| o.sensor == live.sensor && o.reference == live.reference;
        others.iter().find(same).map(|o| o.limit.abs())
    };
    // the same reading kept within other limits differs by no more than the limits do
    let changed: f64 =
        a.iter().map(|l| twin(l, b).map_or(l.limit.abs(), |limit| (limit - l.limit.abs()).abs())).sum();
    let added: f64 = b.iter().filter(|l| twin(l, a).is_none()).map(|l| l.limit.abs()).sum();
    only(&transients[0], &transients[1]) + only(&transients[1], &transients[0]) + changed + added
}

fn same_sense(pair: &Pair<'_>, axis: AxisName) -> bool {
    let [a, b] = pair.specs.map(|s| (s.axis(axis).sense, s.is_workpiece_side(axis), s.axis(axis).travel));
    a == b && !has_grids(pair, axis)
}

/// The six differences of an axis in relative sense at every sample, both directions of travel, other axes of
/// grids at their lower end, middle and upper end.
pub(super) fn each(
    pair: &Pair<'_>,
    axis: AxisName,
    samples: &[f64],
    mut visit: impl FnMut(f64, Travel, [f64; 6]),
) {
    let shares: &[f64] = if has_grids(pair, axis) { &[0.0, 0.25, 0.5, 0.75, 1.0] } else { &[0.0] };
    for &share in shares {
        for &q in samples {
            for travel in [Travel::Forward, Travel::Reverse] {
                let [a, b] = [0, 1].map(|i| motions(pair, i, axis, q, travel, share));
                visit(q, travel, core::array::from_fn(|i| b[i] - a[i]));
            }
        }
    }
}

fn has_grids(pair: &Pair<'_>, axis: AxisName) -> bool {
    pair.specs.iter().any(|s| s.errors.iter().any(|(s, f)| s.axis() == axis && !f.grids.is_empty()))
}

fn motions(pair: &Pair<'_>, which: usize, axis: AxisName, q: f64, travel: Travel, share: f64) -> [f64; 6] {
    let (spec, model) = (pair.specs[which], &pair.models[which]);
    let Some(k) = spec.chain.index_of(axis) else { return [0.0; 6] };
    let mut pose = Pose::at([0.0; MAX_AXES]);
    for (p, other) in pose.position.iter_mut().zip(spec.chain.axes()) {
        if let Some([low, high]) = pair.travel(other.name) {
            *p = low + share * (high - low);
        }
    }
    pose.position[k] = q;
    pose.travel[k] = travel;
    let joint = &model.joints[k];
    let values = joint.motions_at(k, &pose, &mut PointFlags::default());
    let sign = if joint.inverted { -1.0 } else { 1.0 };
    let (shift, turn) = (values.shift * sign, values.turn * sign);
    [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z]
}

/// Programmed coordinates at which the curves of an axis are compared: evenly spaced, fine enough for the shortest
/// wave, and every support point of a table.
pub(super) fn samples(pair: &Pair<'_>, axis: AxisName) -> Vec<f64> {
    let mut knots = Vec::new();
    let mut shortest = f64::INFINITY;
    for (spec, model) in pair.specs.iter().zip(pair.models) {
        let Some(k) = spec.chain.index_of(axis) else { continue };
        let sign = if model.joints[k].inverted { -1.0 } else { 1.0 };
        for (_, function) in spec.errors.iter().filter(|(s, _)| s.axis() == axis && !s.is_constant()) {
            let tables = function.curves.iter().filter_map(|c| match c {
                Curve::Table(t) => Some(t.columns().0),
                _ => None,
            });
            let own = |g: &crate::curve::Grid| g.axes().position(|a| a == axis);
            let grids = function.grids.iter().filter_map(|g| Some(g.positions(own(g)?)));
            knots.extend(tables.chain(grids).flatten().map(|x| sign * x));
            for curve in &function.curves {
                shortest = shortest.min(shortest_wave(curve));
            }
        }
    }
    let fallback = if axis.kind() == AxisKind::Rotary { core::f64::consts::PI } else { 0.0 };
    let [low, high] = pair.travel(axis).unwrap_or([-fallback, fallback]);
    let steps = f64::from(SAMPLES).max((PER_WAVE * (high - low) / shortest).min(SAMPLES_MAX)).ceil() as u32;
    let even = (0..=steps).map(|i| low + (high - low) * f64::from(i) / f64::from(steps));
    let mut all: Vec<f64> = even.chain(knots.into_iter().filter(|x| (low..=high).contains(x))).collect();
    all.sort_by(f64::total_cmp);
    all.dedup();
    all
}

/// Length of the shortest wave of a curve.
fn shortest_wave(curve: &Curve) -> f64 {
    let length = |c: &Curve| c.range().map_or(f64::INFINITY, |[low, high]| high - low);
    match curve {
        Curve::Fourier(f) if !f.harmonics().is_empty() => f.period() / f.harmonics().len() as f64,
        Curve::HalfRange(h) => 2.0 * length(curve) / h.coefficients().2.count().max(1) as f64,
        // between two neighbouring extremes near an end a polynomial of degree n has about 5/n^2 of its range
        Curve::Chebyshev(c) => 5.0 * length(curve) / (c.coefficients().len().max(2) as f64 - 1.0).powi(2),
        _ => f64::INFINITY,
    }
}
