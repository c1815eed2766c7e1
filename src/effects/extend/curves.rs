//! Effects of position and direction as curves of error motions.

use super::{Becomes, Extended, Part, shift, turn};
use crate::WIDTH_MAX;
use crate::addition::Entry;
use crate::lever::Lever;
use crate::machine_state::{Axis, MachineState, SLOTS};
use volcomp_model::curve::{Interpolation, Table};
use volcomp_model::geometry::{Vec3, unit};
use volcomp_model::{Component, Curve, ErrorSymbol, ModelSpec};
use volcomp_units::{RAD_PER_ARCSEC, mm_from_um};

/// Points of a table.
const POINTS: usize = 201;
/// Points in the shortest wave: straight lines between them are right to half a percent.
const PER_WAVE: f64 = 32.0;
/// Most points of a table.
const POINTS_MAX: usize = 8001;
/// Pivots closer than this are one, mm.
const SAME_PIVOT_MM: f64 = 1e-6;
/// Positions of tables are rounded to parts of a mm or rad, so that those of several tables are equal where they are meant to be.
const POSITION_PARTS: f64 = 1e9;
/// Values below this are no part of a model, mm or rad.
const NOTHING: f64 = 1e-12;

const ZERO: &str = "it is zero all over the travel";
const NO_TRAVEL: &str = "the model does not say how far its axis travels, nor the addition where it was seen; add travel-mm to [axes]";

/// A curve times a sign; `None` where it cannot be one.
pub(super) fn scaled(curve: &Curve, sign: f64) -> Option<Curve> {
    Some(match curve {
        Curve::Constant(value) => Curve::Constant(value * sign),
        Curve::Table(table) => {
            let (positions, forward, reverse) = table.columns();
            let times = |values: &[f64]| values.iter().map(|v| v * sign).collect::<Vec<f64>>();
            let reverse = reverse.map(times);
            let table = Table::new(positions.to_vec(), times(forward), reverse, table.interpolation());
            Curve::Table(table.ok()?)
        }
        _ => return None,
    })
}

/// Where an axis may be: its travel in the model, else where the data were; mm or rad.
pub(crate) fn travel(spec: &ModelSpec, entry: &Entry, axis: Axis) -> Option<[f64; 2]> {
    spec.axis(axis.name()).travel.or_else(|| seen(entry, axis)).filter(|[low, high]| low < high)
}

/// Where the data were, mm or rad.
pub(crate) fn seen(entry: &Entry, axis: Axis) -> Option<[f64; 2]> {
    let range = entry.valid.get(&axis.column())?;
    Some(range.map(|q| axis.name().kind().position_in(q)))
}

/// Where a table has its points.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Sampling<'a> {
    /// At these places and at the ends of the travel.
    At(&'a [f64]),
    /// At the ends of the travel: a straight line.
    Line,
    /// Evenly.
    Even,
    /// Evenly, so many in each of the shortest waves (length mm or rad).
    Waves(f64),
    /// Closer towards the ends of the data, as polynomials ask for.
    Polynomial,
}

/// The displacement in each direction as a table over one axis. Straight lines go on to the end of the travel, anything
/// else is held where the data end.
pub(crate) fn displacements(model: &Extended, entry: &Entry, over: Axis, sampling: Sampling<'_>) -> Becomes {
    let at = places(model, entry, over, sampling)?;
    let kept = |q: f64| match seen(entry, over) {
        Some([low, high]) if at.len() > 2 && low < high => q.clamp(low, high),
        _ => q,
    };
    let along = |direction: f64| -> Vec<Vec3> {
        at.iter().map(|q| displacement_um(entry, over, kept(*q), direction).map(mm_from_um)).collect()
    };
    let [forward, reverse] = [1.0, -1.0].map(along);
    let mut parts = Vec::new();
    for (k, component) in [Component::X, Component::Y, Component::Z].into_iter().enumerate() {
        let [forward, reverse] = [&forward, &reverse].map(|d| d.iter().map(|d| d[k]).collect::<Vec<f64>>());
        parts.extend(table(ErrorSymbol::Motion { component, axis: over.name() }, &at, forward, reverse)?);
    }
    if parts.is_empty() { Err(ZERO) } else { Ok(parts.into()) }
}

/// The positions of a table over one axis, mm or rad, rounded between the ends.
fn places(
    model: &Extended,
    entry: &Entry,
    over: Axis,
    sampling: Sampling<'_>,
) -> Result<Vec<f64>, &'static str> {
    let at = unrounded(model, entry, over, sampling)?;
    let ends @ [low, high] = [at[0], at[at.len() - 1]];
    let inner = at.iter().map(|q| (q * POSITION_PARTS).round() / POSITION_PARTS);
    let inner = inner.filter(|q| ends.iter().all(|end| (q - end).abs() >= 1.0 / POSITION_PARTS));
    let mut rounded: Vec<f64> = [low].into_iter().chain(inner).chain([high]).collect();
    rounded.dedup();
    Ok(rounded)
}

fn unrounded(
    model: &Extended,
    entry: &Entry,
    over: Axis,
    sampling: Sampling<'_>,
) -> Result<Vec<f64>, &'static str> {
    let range = travel(&model.spec, entry, over).ok_or(NO_TRAVEL)?;
    Ok(match (sampling, seen(entry, over)) {
        (Sampling::At(places), _) => {
            let [low, high] = range;
            let inside = places.iter().copied().filter(|q| *q > low && *q < high);
            [low].into_iter().chain(inside).chain([high]).collect()
        }
        (Sampling::Line, _) => positions(range, 2),
        (Sampling::Waves(shortest), _) => {
            let points = (PER_WAVE * (range[1] - range[0]) / shortest).ceil() as usize + 1;
            if points > POINTS_MAX {
                return Err("its waves are too short for a table over the whole travel");
            }
            positions(range, points.max(POINTS))
        }
        (Sampling::Polynomial, Some(seen)) => positions_of_polynomial(range, seen),
        _ => positions(range, POINTS),
    })
}

/// The displacement at one place of one axis, all others at zero, um.
fn displacement_um(entry: &Entry, over: Axis, q: f64, direction: f64) -> Vec3 {
    let mut m =
        MachineState { since_mm: [f64::INFINITY; SLOTS], direction: [1.0; SLOTS], ..MachineState::default() };
    m.position[over.slot()] = q;
    m.direction[over.slot()] = direction;
    let mut out = [Vec3::zeros(); WIDTH_MAX];
    entry.shape.evaluate_with(&m, &|_| None, &mut out);
    out.iter().zip(&entry.values).map(|(d, v)| d * *v).sum()
}

/// A curve at some places, held where the data end.
fn held(entry: &Entry, over: Axis, at: &[f64], curve: &dyn Fn(f64) -> f64) -> impl Iterator<Item = f64> {
    let range = seen(entry, over);
    at.iter().map(move |q| curve(range.map_or(*q, |[low, high]| q.clamp(low, high))))
}

/// An angle over one axis (arcsec by position) about some point as tables: of the rotation, and of the displacements that it makes at
/// the reference points of the model.
pub(crate) fn rotation(
    model: &Extended,
    entry: &Entry,
    over: Axis,
    (about, lever): (Axis, Option<&Lever>),
    sampling: Sampling<'_>,
    angle_arcsec: &dyn Fn(f64) -> f64,
) -> Becomes {
    let at = places(model, entry, over, sampling)?;
    let angles: Vec<f64> = held(entry, over, &at, angle_arcsec).map(|v| v * RAD_PER_ARCSEC).collect();
    let mut parts = vec![table(turn(about, over), &at, angles.clone(), angles.clone())?.ok_or(ZERO)?];
    let across = Axis::LINEAR.into_iter().filter(|a| *a != about);
    for (along, lever) in across.filter_map(|a| Some((a, lever?))) {
        let reference = model.spec.axis(over.name()).reference_points[along.direction()].point;
        let from = lever.home_at_tip(&model.spec) - model.spec.tool_tip + reference;
        let arm = unit(about.direction()).cross(&from)[along.direction()];
        if arm.abs() > SAME_PIVOT_MM {
            let shifts: Vec<f64> = angles.iter().map(|a| a * arm).collect();
            parts.extend(table(shift(along, over), &at, shifts.clone(), shifts)?);
        }
    }
    Ok(parts.into())
}

/// What bends along an axis: its drop against the axis that points up (um by position) and the slope (um per mm) about the third axis,
/// through a lever.
pub(crate) fn bending(
    model: &Extended,
    entry: &Entry,
    (over, up): (Axis, Axis),
    lever: &Lever,
    [drop_um, slope]: [&dyn Fn(f64) -> f64; 2],
) -> Becomes {
    let about = Axis::LINEAR[3 - over.direction() - up.direction()];
    let arcsec = |q: f64| mm_from_um(slope(q)) / RAD_PER_ARCSEC;
    let mut candidate = rotation(model, entry, over, (about, Some(lever)), Sampling::Even, &arcsec)?;
    let at = places(model, entry, over, Sampling::Even)?;
    let drops: Vec<f64> = held(entry, over, &at, drop_um).map(mm_from_um).collect();
    candidate.parts.extend(table(shift(up, over), &at, drops.clone(), drops)?);
    Ok(candidate)
}

fn positions([low, high]: [f64; 2], points: usize) -> Vec<f64> {
    let steps = (points - 1) as f64;
    (0..points).map(|i| low + (high - low) * i as f64 / steps).collect()
}

/// Extrema of a Chebyshev polynomial over the range of the data, where a Legendre polynomial of degree n is steepest at the
/// ends; with the ends of the travel. Straight lines between them deviate by at most (n pi / points)^2 / 8 of a polynomial.
fn positions_of_polynomial([low, high]: [f64; 2], seen: [f64; 2]) -> Vec<f64> {
    let [from, to] = [seen[0].max(low), seen[1].min(high)];
    if from >= to {
        return positions([low, high], POINTS);
    }
    let steps = (POINTS - 1) as f64;
    let inner = (0..POINTS).map(|i| {
        let share = 0.5 - 0.5 * (core::f64::consts::PI * i as f64 / steps).cos();
        from + (to - from) * share
    });
    let before = (low < from).then_some(low);
    let after = (high > to).then_some(high);
    before.into_iter().chain(inner).chain(after).collect()
}

/// A table, with a column for the way back where it differs; `None` where it is zero.
fn table(
    symbol: ErrorSymbol,
    at: &[f64],
    forward: Vec<f64>,
    reverse: Vec<f64>,
) -> Result<Option<Part>, &'static str> {
    if forward.iter().chain(&reverse).all(|v| v.abs() < NOTHING) {
        return Ok(None);
    }
    let differs = forward.iter().zip(&reverse).any(|(f, r)| (f - r).abs() >= NOTHING);
    let table = Table::new(at.to_vec(), forward, differs.then_some(reverse), Interpolation::Linear)
        .map_err(|_| "its values make no table")?;
    Ok(Some(Part { symbol, curve: Some(Curve::Table(table)), live: None, dynamic: None }))
}
