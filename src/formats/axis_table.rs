//! What the tables of one axis have in common: positions with one value per direction.

use crate::prelude::*;
use volcomp_model::curve::Table;
use volcomp_model::spec::{ANGLE_LIMIT, LENGTH_LIMIT};

/// The component that is the positioning error of an axis.
#[must_use]
pub const fn positioning(axis: AxisName) -> Component {
    let offset = match axis.kind() {
        AxisKind::Linear => 0,
        AxisKind::Rotary => 3,
    };
    Component::ALL[axis.direction() + offset]
}

/// The positioning error of an axis as a symbol.
#[must_use]
pub const fn positioning_symbol(axis: AxisName) -> ErrorSymbol {
    ErrorSymbol::Motion { component: positioning(axis), axis }
}

/// A row of a table, mm or rad, with its line for messages.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Row {
    pub(super) line: usize,
    pub(super) position: f64,
    pub(super) forward: f64,
    pub(super) reverse: f64,
}

/// Refuses an error (mm, or rad where `angle`) that no machine has.
pub(super) fn possible(angle: bool, value: f64) -> Result<(), FormatErrorKind> {
    let (limit, times, unit) = if angle { (ANGLE_LIMIT, 1e3, "mrad") } else { (LENGTH_LIMIT, 1.0, "mm") };
    if value.abs() <= limit {
        return Ok(());
    }
    Err(FormatErrorKind::TooLarge { value: value * times, limit: limit * times, unit })
}

/// The curve of a table of errors of this kind; one direction where both are equal throughout.
pub(super) fn curve(rows: &[Row], kind: AxisKind) -> Result<ErrorFunction, FormatError> {
    let last = rows.last().map_or(1, |r| r.line);
    for row in rows {
        for value in [row.forward, row.reverse] {
            possible(kind == AxisKind::Rotary, value).map_err(|e| FormatError::at(row.line, 1, e))?;
        }
    }
    for pair in rows.windows(2) {
        if pair[1].position <= pair[0].position {
            let (value, previous) = (pair[1].position, pair[0].position);
            return Err(FormatError::at(pair[1].line, 1, FormatErrorKind::NotIncreasing { value, previous }));
        }
    }
    let two_way = rows.iter().any(|r| r.forward != r.reverse);
    let reverse = two_way.then(|| rows.iter().map(|r| r.reverse).collect());
    let (at, forward) = rows.iter().map(|r| (r.position, r.forward)).unzip();
    let table = Table::new(at, forward, reverse, Interpolation::Linear)
        .map_err(|e| FormatError::at(last, 1, e.into()))?;
    Ok(ErrorFunction::single(Curve::Table(table)))
}

/// Refuses positions that are not equally spaced to one part in a million.
pub(super) fn equidistant(rows: &[Row]) -> Result<(), FormatError> {
    let [first, second, ..] = rows else { return Ok(()) };
    let spacing = second.position - first.position;
    for (i, row) in rows.iter().enumerate() {
        let expected = first.position + spacing * i as f64;
        if (row.position - expected).abs() > 1e-6 * spacing.abs() * (i.max(1) as f64) {
            let value = row.position;
            return Err(FormatError::at(row.line, 1, FormatErrorKind::NotEquidistant { value, spacing }));
        }
    }
    Ok(())
}
