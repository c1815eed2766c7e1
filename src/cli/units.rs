//! Units in which errors are printed and stand in keys and columns: um and arcsec, over mm or deg.

use crate::prelude::*;
use volcomp_model::spec::{ANGLE_LIMIT, LENGTH_LIMIT, angle_unit_hint, length_unit_hint};

/// Units of an error at the boundary.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Units {
    /// `um` or `arcsec`.
    pub(crate) value: &'static str,
    /// `mm` or `deg`.
    pub(crate) position: &'static str,
    /// From mm or rad.
    pub(crate) of_value: fn(f64) -> f64,
    /// Back to mm or rad.
    pub(crate) to_inner: fn(f64) -> f64,
    /// From mm or rad.
    pub(crate) of_position: fn(f64) -> f64,
}

impl Units {
    /// Of an error motion of a linear axis.
    pub(crate) fn of_component(component: Component) -> Self {
        Self::over(component.is_angle(), AxisKind::Linear)
    }

    /// Of an error.
    pub(crate) fn of(symbol: ErrorSymbol) -> Self {
        Self::over(symbol.is_angle(), symbol.axis().kind())
    }

    fn over(angle: bool, kind: AxisKind) -> Self {
        let of_position = if kind.is_rotary() { deg_from_rad } else { core::convert::identity };
        let position = kind.position_unit();
        if angle {
            let (of_value, to_inner) = (arcsec_from_rad, rad_from_arcsec);
            Self { value: "arcsec", position, of_value, to_inner, of_position }
        } else {
            let (of_value, to_inner) = (um_from_mm, mm_from_um);
            Self { value: "um", position, of_value, to_inner, of_position }
        }
    }

    /// A value with its unit.
    pub(crate) fn text(&self, value: f64, decimals: usize) -> String {
        format!("{:.decimals$} {}", (self.of_value)(value), self.value)
    }

    /// Values in the unit of the boundary.
    pub(crate) fn values(&self, list: &[f64]) -> Vec<f64> {
        list.iter().copied().map(self.of_value).collect()
    }

    /// Positions in the unit of the boundary.
    pub(crate) fn positions(&self, list: &[f64]) -> Vec<f64> {
        list.iter().copied().map(self.of_position).collect()
    }
}

/// Lengths that no machine tool keeps below, um; a column in mm that is named um looks so.
const SMALLEST_UM: f64 = 0.1;

/// Half of the width of the largest position detectors, um.
const DETECTOR_UM: f64 = 25_000.0;

/// What is wrong with a deviation (um or arcsec) that is larger than any machine's: it is in another unit than stated.
pub(crate) fn beyond_machines(value: f64, is_angle: bool) -> Option<String> {
    let (limit, unit, hint): (_, _, fn(f64) -> &'static str) = if is_angle {
        (arcsec_from_rad(ANGLE_LIMIT), "arcsec", angle_unit_hint)
    } else {
        (um_from_mm(LENGTH_LIMIT), "um", length_unit_hint)
    };
    beyond((value, limit), unit, hint)
}

/// What is wrong with a place on a position detector, um, beyond half of the largest one.
pub(crate) fn beyond_detectors(value_um: f64) -> Option<String> {
    beyond((value_um, DETECTOR_UM), "um", length_unit_hint)
}

fn beyond((value, limit): (f64, f64), unit: &str, hint: fn(f64) -> &'static str) -> Option<String> {
    let size = value.abs();
    (size > limit).then(|| {
        let (shown, limit, hint) = (plain(size, 0), plain(limit, 0), hint(size));
        format!("reaches {shown} {unit}; the limit is {limit} {unit}: {hint}")
    })
}

/// Refuses deviations larger than any machine's and notes lengths smaller than any: both are in another unit than `column`
/// says. `values` are um or arcsec, each with its line, 0 where it is not known.
pub(crate) fn check_size(
    file: &str,
    column: &str,
    values: impl Iterator<Item = (f64, u64)>,
    is_angle: bool,
) -> Result<()> {
    let larger = |a: (f64, u64), b: (f64, u64)| if b.0.abs() > a.0 { (b.0.abs(), b.1) } else { a };
    let (largest, line) = values.fold((0.0, 0), larger);
    if let Some(what) = beyond_machines(largest, is_angle) {
        let place = if line > 0 { format!("{file}:{line}") } else { file.to_owned() };
        return Err(data!(place, "{column} {what}"));
    }
    if !is_angle && largest > 0.0 && largest < SMALLEST_UM {
        note!(
            "note: {file}: no deviation exceeds {SMALLEST_UM} um (largest {largest:.4} um): is {column} in um?"
        );
    }
    Ok(())
}

/// The key of an error: `exx`.
pub(crate) fn key(symbol: ErrorSymbol) -> String {
    symbol.to_string().to_lowercase()
}

/// The column of an error: `exx_um`.
pub(crate) fn column(symbol: ErrorSymbol) -> String {
    format!("{}_{}", key(symbol), Units::of(symbol).value)
}

/// A number, or a dash where there is none.
pub(crate) fn or_dash(value: Option<f64>, decimals: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.decimals$}"))
}
