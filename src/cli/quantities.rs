//! Quantities of models in the units that people and programs read: mm and deg for places, um and arcsec for errors and offsets.

use crate::prelude::*;
use volcomp_model::Pose;

/// Unit of an axis offset on the outside.
pub(crate) const fn offset_unit(axis: AxisName) -> &'static str {
    axis.kind().offset_unit()
}

/// An axis offset in its outside unit, as it is.
pub(crate) fn offset_as_is(axis: AxisName, v: f64) -> f64 {
    axis.kind().offset_out(v)
}

/// An axis offset in its outside unit.
pub(crate) fn offset_out(axis: AxisName, v: f64) -> f64 {
    rounded(offset_as_is(axis, v))
}

/// Unit of an axis position on the outside.
pub(crate) const fn position_unit(axis: AxisName) -> &'static str {
    axis.kind().position_unit()
}

/// An axis position in its outside unit.
pub(crate) fn position_out(axis: AxisName, v: f64) -> f64 {
    rounded(axis.kind().position_out(v))
}

/// Unit of an error on the outside.
pub(crate) fn error_unit(symbol: ErrorSymbol) -> &'static str {
    Units::of(symbol).value
}

/// An error in its outside unit, as it is.
pub(crate) fn error_out(symbol: ErrorSymbol, v: f64) -> f64 {
    (Units::of(symbol).of_value)(v)
}

/// Without the noise of the conversion.
pub(crate) fn rounded(v: f64) -> f64 {
    let rounded = (v * 1e6).round() / 1e6;
    // adding zero turns -0 into 0; what overflows has no decimals
    if rounded.is_finite() { rounded + 0.0 } else { v }
}

/// A range of an axis in words: `0 to 500 mm`.
pub(crate) fn range_words(axis: AxisName, range: [f64; 2]) -> String {
    let [low, high] = range.map(|q| figure(position_out(axis, q)));
    format!("{low} to {high} {}", position_unit(axis))
}

/// A point in words: `(0, 250, -100)`.
pub(crate) fn point(v: &Vec3) -> String {
    format!("({}, {}, {})", rounded(v.x), rounded(v.y), rounded(v.z))
}

/// A vector in words, with two decimals.
pub(crate) fn vector(v: &Vec3) -> String {
    format!("({}, {}, {})", plain(v.x, 2), plain(v.y, 2), plain(v.z, 2))
}

/// A vector for programs.
pub(crate) fn list(v: &Vec3) -> [f64; 3] {
    [rounded(v.x), rounded(v.y), rounded(v.z)]
}

/// The axes that have a place in the volume, by their index in the chain.
fn placed(chain: &Chain) -> impl Iterator<Item = (usize, AxisName)> {
    chain.axes().iter().enumerate().filter(|(_, a)| !a.spindle).map(|(k, a)| (k, a.name))
}

/// A pose in words: `X 12.5  Y 0 (towards minus)`.
pub(crate) fn pose_words(chain: &Chain, pose: &Pose) -> String {
    let word = |(k, axis): (usize, AxisName)| {
        let back = if pose.travel[k] == Travel::Reverse { " (towards minus)" } else { "" };
        let q = (position_out(axis, pose.position[k]) * 1e2).round() / 1e2 + 0.0;
        format!("{axis} {q}{back}")
    };
    placed(chain).map(word).joined("  ")
}

/// A pose for programs: `x_mm`, `dir_x` of every axis.
pub(crate) fn pose_json(chain: &Chain, pose: &Pose) -> Value {
    let mut out = Map::new();
    for (k, axis) in placed(chain) {
        let letter = axis.lower();
        out.insert(format!("{letter}_{}", position_unit(axis)), json!(position_out(axis, pose.position[k])));
        let direction = if pose.travel[k] == Travel::Reverse { -1 } else { 1 };
        out.insert(format!("dir_{letter}"), json!(direction));
    }
    Value::Object(out)
}

/// The largest offset of each axis that has one, and where, for programs; of each the offsets in chain order and the pose.
pub(crate) fn corrections_json<'a>(
    chain: &Chain,
    largest: impl Iterator<Item = Option<(&'a [f64], &'a Pose)>>,
) -> Map<String, Value> {
    let axes = chain.axes().iter().map(|a| a.name).zip(largest).enumerate();
    axes.filter_map(|(k, (axis, found))| {
        let (offset, pose) = found?;
        let key = format!("largest_{}", offset_unit(axis));
        let entry = json!({key: offset_out(axis, offset[k]), "at": pose_json(chain, pose)});
        Some((axis.lower().to_string(), entry))
    })
    .collect()
}
