//! Effects of direction, velocity and acceleration as dynamic terms, those of the tool as tool errors.

use super::curves::{seen, travel};
use super::{Becomes, Candidate, Extended, Part};
use crate::addition::Entry;
use crate::machine_state::Axis;
use volcomp_model::{DynamicTerm, ErrorSymbol, Law, ToolErrors};

/// A term is kept within so many times what it reaches inside the range of the data.
const ROOM: f64 = 1.5;
/// Smallest limit of a term, mm or rad.
const LIMIT_MIN: f64 = 1e-9;
/// mm per m.
const PER_M: f64 = 1e-3;

const NO_SPEEDS: &str = "the addition does not say at which speeds it was seen; diagnose again";
const NO_ACCELERATIONS: &str = "the addition does not say at which accelerations it was seen; diagnose again";
const NO_GAUGE: &str = "the model does not say from where tool lengths count; add gauge-point-mm to [frame]";

/// A dynamic term of an axis: parameter `at` of the entry times `unit`, and the growth per metre of the next one where `slope`.
pub(crate) struct Term {
    pub(crate) axis: Axis,
    pub(crate) symbol: ErrorSymbol,
    pub(crate) law: Law,
    /// Largest signal that the data have seen.
    pub(crate) most: f64,
    pub(crate) at: usize,
    pub(crate) slope: bool,
    pub(crate) unit: f64,
}

/// An effect as dynamic terms.
pub(crate) fn terms(model: &Extended, entry: &Entry, terms: impl IntoIterator<Item = Term>) -> Becomes {
    let part = |t: Term| {
        let gain = entry.value(t.at) * t.unit;
        let growth =
            if t.slope && gain != 0.0 { entry.value(t.at + 1) * PER_M / entry.value(t.at) } else { 0.0 };
        let far = travel(&model.spec, entry, t.axis).or_else(|| seen(entry, t.axis)).unwrap_or_default();
        let largest = far.iter().fold(1.0f64, |m, x| m.max((1.0 + growth * x).abs()));
        term(t.symbol, t.law, gain, growth, gain.abs() * largest * t.most)
    };
    Ok(terms.into_iter().map(part).collect::<Vec<_>>().into())
}

/// A term that reaches so far inside the range of the data, mm or rad; none where that is nothing.
pub(crate) fn acceleration_term(symbol: ErrorSymbol, gain: f64, most: f64) -> Option<Part> {
    let reach = gain.abs() * most;
    (reach > LIMIT_MIN).then(|| term(symbol, Law::Acceleration, gain, 0.0, reach))
}

fn term(symbol: ErrorSymbol, law: Law, gain: f64, growth: f64, reach: f64) -> Part {
    let limit = (ROOM * reach).max(LIMIT_MIN);
    Part { symbol, curve: None, live: None, dynamic: Some(DynamicTerm { law, gain, growth, limit }) }
}

/// What is wrong with tool and spindle.
pub(crate) fn tool(model: &Extended, errors: ToolErrors) -> Becomes {
    if model.spec.gauge_point.is_none() {
        return Err(NO_GAUGE);
    }
    Ok(Candidate { tool: Some(errors), ..Candidate::default() })
}

/// The largest velocity of the data, in the unit of its column.
pub(crate) fn fastest(entry: &Entry, axis: Axis) -> Result<f64, &'static str> {
    largest(entry, &axis.velocity_column()).ok_or(NO_SPEEDS)
}

/// The largest acceleration of the data, mm/s^2.
pub(crate) fn steepest(entry: &Entry, axis: Axis) -> Result<f64, &'static str> {
    largest(entry, &axis.acceleration_column()).ok_or(NO_ACCELERATIONS)
}

/// The largest size of a column in the data.
pub(super) fn largest(entry: &Entry, column: &str) -> Option<f64> {
    Some(entry.valid.get(column)?.iter().fold(0.0f64, |m, v| m.max(v.abs())))
}
