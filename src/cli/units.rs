//! Units in which errors are printed and stand in keys and columns: um and arcsec, over mm or deg.

use volcomp_model::{Component, ErrorSymbol};
use volcomp_units::axes::AxisKind;
use volcomp_units::{arcsec_from_rad, deg_from_rad, mm_from_um, rad_from_arcsec, um_from_mm};

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
