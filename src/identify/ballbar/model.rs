//! What of the effects a static model can hold: squareness, scale, straightness, cyclic error, lost motion.
//!
//! Values are those on the circles: where other axes carry angular errors, these are in them at the place of the
//! circle, unless the prediction of a model that holds them was subtracted from the readings before. Scale needs the instrument's true length; without it the mean scale of a plane's two axes is taken for zero.

use crate::prelude::*;

use super::{Analysis, Effect, End, Plane};
use volcomp_model::curve::CurveError;

/// An error that the circles give.
#[derive(Debug, Clone, PartialEq)]
pub struct Assembled {
    /// Its symbol.
    pub symbol: ErrorSymbol,
    /// The curve, in relative sense over the programmed coordinate.
    pub curve: Curve,
    /// Standard uncertainty (k = 1) of its largest part.
    pub std: f64,
    /// Where the curve holds one thing twice measured (one axis in two planes): largest difference over its standard
    /// deviation.
    pub disagreement: Option<f64>,
}

/// Support points of a smooth curve.
const POINTS: usize = 61;
/// Support points per wave of a cyclic error.
const POINTS_PER_PITCH: f64 = 12.0;
/// Most support points of a curve.
const POINTS_MAX: usize = 2000;

/// One number with the plane it came from.
#[derive(Clone, Copy)]
struct Weighed {
    value: f64,
    std: f64,
}

/// Mean by weight, its uncertainty, and how far the parts disagree in standard deviations.
fn mean(parts: &[Weighed]) -> Option<(Weighed, Option<f64>)> {
    let [first, rest @ ..] = parts else { return None };
    if rest.is_empty() {
        return Some((*first, None));
    }
    let weight = |p: &Weighed| 1.0 / p.std.powi(2).max(f64::MIN_POSITIVE);
    let sum: f64 = parts.iter().map(weight).sum();
    let value = parts.iter().map(|p| p.value * weight(p)).sum::<f64>() / sum;
    let apart =
        |p: &Weighed| (p.value - value).abs() / (p.std.powi(2) - 1.0 / sum).max(f64::MIN_POSITIVE).sqrt();
    let disagreement = parts.iter().map(apart).fold(0.0, f64::max);
    Some((Weighed { value, std: (1.0 / sum).sqrt() }, Some(disagreement)))
}

/// The errors that the circles give, significant ones only. `length_std` is the standard uncertainty of the
/// instrument's length, mm; `None` where it was not calibrated.
///
/// # Errors
/// A table that breaks a rule; circles of no extent.
pub fn assemble(analyses: &[Analysis], length_std: Option<f64>) -> Result<Vec<Assembled>, CurveError> {
    let mut all = Vec::new();
    for a in analyses {
        all.extend(squareness(a));
        for axis in 0..2 {
            all.extend(straightness(a, axis)?);
        }
    }
    for axis in [AxisName::X, AxisName::Y, AxisName::Z] {
        all.extend(positioning(analyses, axis, length_std)?);
    }
    all.sort_by_key(|e| e.symbol);
    Ok(all)
}

fn significant(a: &Analysis, effect: Effect) -> bool {
    a.estimate(effect).is_some_and(|e| e.significant)
}

/// Squareness with the sign of the model: above 90 deg is plus for C0Y and A0Z, minus for B0Z.
fn squareness(a: &Analysis) -> Option<Assembled> {
    let found = a.value(Effect::Squareness, None).filter(|_| significant(a, Effect::Squareness))?;
    let (component, axis, sign) = match a.plane {
        Plane::Xy => (Component::C, AxisName::Y, 1.0),
        Plane::Yz => (Component::A, AxisName::Z, 1.0),
        Plane::Zx => (Component::B, AxisName::Z, -1.0),
    };
    let symbol = ErrorSymbol::Squareness { component, axis };
    let curve = Curve::Constant(sign * found.value);
    Some(Assembled { symbol, curve, std: found.std, disagreement: None })
}

/// The bow of an axis in its plane.
fn straightness(a: &Analysis, index: usize) -> Result<Option<Assembled>, CurveError> {
    let effect = Effect::Straightness(index);
    let Some(found) = a.value(effect, None).filter(|_| significant(a, effect)) else { return Ok(None) };
    let axes = a.plane.axes();
    let component = Component::ALL[axes[1 - index].direction()];
    let positions = grid(a.centre[index], a.radius, POINTS);
    let bow = |x: &f64| found.value * (1.0 - ((x - a.centre[index]) / a.radius).powi(2));
    let values = positions.iter().map(bow).collect();
    let table = Table::new(positions, values, None, Interpolation::Linear)?;
    let symbol = ErrorSymbol::Motion { component, axis: axes[index] };
    Ok(Some(Assembled { symbol, curve: Curve::Table(table), std: found.std, disagreement: None }))
}

/// Scale, cyclic error and lost motion of an axis, from all planes in which it moves.
fn positioning(
    analyses: &[Analysis],
    axis: AxisName,
    length_std: Option<f64>,
) -> Result<Option<Assembled>, CurveError> {
    let with_axis: Vec<(&Analysis, usize)> =
        analyses.iter().filter_map(|a| Some((a, a.plane.axes().iter().position(|x| *x == axis)?))).collect();
    let scales: Vec<Weighed> = with_axis.iter().filter_map(|(a, i)| scale(a, *i, length_std)).collect();
    let scale = mean(&scales);
    let backlash = [End::Positive, End::Negative].map(|end| {
        let parts: Vec<Weighed> = with_axis.iter().filter_map(|(a, i)| lost_motion(a, *i, end)).collect();
        mean(&parts)
    });
    let cyclic = with_axis
        .iter()
        .filter(|(a, i)| significant(a, Effect::Cyclic(*i)))
        .filter_map(|(a, i)| Some((a.pitch[*i]?, a.estimate(Effect::Cyclic(*i))?)))
        .min_by(|a, b| a.1.values[0].std.total_cmp(&b.1.values[0].std));
    let Some((reach, middle)) = reach(&with_axis) else { return Ok(None) };
    let both = backlash[0].or(backlash[1]).zip(backlash[1].or(backlash[0]));
    if scale.is_none() && both.is_none() && cyclic.is_none() {
        return Ok(None);
    }
    let waves = cyclic.map_or(0.0, |(pitch, _)| 2.0 * reach / pitch * POINTS_PER_PITCH);
    let positions = grid(middle, reach, (waves.ceil() as usize + 1).clamp(POINTS, POINTS_MAX));
    let smooth = |x: f64| {
        let wave = cyclic.map_or(0.0, |(pitch, e)| match e.values[..] {
            [_, s, c] => {
                let phase = TAU * x / pitch;
                s.value * phase.sin() + c.value * phase.cos()
            }
            _ => 0.0,
        });
        scale.map_or(0.0, |(s, _)| s.value * (x - middle)) + wave
    };
    let lost = |x: f64| {
        both.map_or(0.0, |((p, _), (n, _))| {
            let share = ((x - middle) / reach + 1.0) / 2.0;
            share * p.value + (1.0 - share) * n.value
        })
    };
    let forward = positions.iter().map(|x| smooth(*x) - lost(*x) / 2.0).collect();
    let reverse = both.map(|_| positions.iter().map(|x| smooth(*x) + lost(*x) / 2.0).collect());
    let table = Table::new(positions, forward, reverse, Interpolation::Linear)?;
    let parts = [scale, backlash[0], backlash[1]];
    let from_scale = scale.map_or(0.0, |(s, _)| s.std * reach);
    let from_lost = backlash.iter().flatten().map(|(b, _)| b.std / 2.0).fold(0.0, f64::max);
    let from_wave = cyclic.map_or(0.0, |(_, e)| e.values[0].std / 2.0);
    let disagreement = parts.iter().flatten().filter_map(|(_, d)| *d).reduce(f64::max);
    let component = Component::ALL[axis.direction()];
    Ok(Some(Assembled {
        symbol: ErrorSymbol::Motion { component, axis },
        curve: Curve::Table(table),
        std: from_scale.max(from_lost).max(from_wave),
        disagreement,
    }))
}

/// Scale error of an axis: half the mismatch, and the mean from the radius where the instrument's length is known so well that a scale
/// differs from zero; without the mean only a significant mismatch. What one axis gets the other one gets, too, so that the circles
/// stay what they are.
fn scale(a: &Analysis, index: usize, length_std: Option<f64>) -> Option<Weighed> {
    let mismatch = a.value(Effect::ScaleMismatch, None)?;
    let (mean, mean_std) = match (length_std, a.radius_deviation.first()) {
        (Some(length), Some((_, deviation, std))) => (deviation / a.radius, std.hypot(length) / a.radius),
        _ => (0.0, 0.0),
    };
    let halves = [0.5, -0.5].map(|sign| Weighed { value: sign * mismatch.value, std: 0.5 * mismatch.std });
    let full = halves.map(|w| Weighed { value: mean + w.value, std: mean_std.hypot(w.std) });
    let differs = |both: &[Weighed; 2]| both.iter().any(|w| w.value.abs() > 2.0 * w.std);
    let halves = significant(a, Effect::ScaleMismatch).then_some(halves);
    Some(full).filter(|_| length_std.is_some()).filter(differs).or(halves).map(|both| both[index])
}

fn lost_motion(a: &Analysis, index: usize, end: End) -> Option<Weighed> {
    let effect = Effect::Backlash(index);
    let found = a.value(effect, Some(end)).filter(|_| significant(a, effect))?;
    Some(Weighed { value: found.value, std: found.std })
}

/// Half the range and the middle of what the circles cover of an axis.
fn reach(with_axis: &[(&Analysis, usize)]) -> Option<(f64, f64)> {
    let low = with_axis.iter().map(|(a, i)| a.centre[*i] - a.radius).reduce(f64::min)?;
    let high = with_axis.iter().map(|(a, i)| a.centre[*i] + a.radius).reduce(f64::max)?;
    Some(((high - low) / 2.0, (high + low) / 2.0))
}

fn grid(middle: f64, reach: f64, points: usize) -> Vec<f64> {
    let step = 2.0 * reach / (points - 1) as f64;
    (0..points).map(|i| middle - reach + step * i as f64).collect()
}
