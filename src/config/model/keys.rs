//! Keys of the model file that carry a unit: which one applies, and the way to and from mm and rad.

use crate::prelude::*;
use volcomp_units::{deg_from_rad, rad_from_deg};

/// Keys of positions along an axis.
#[derive(Debug)]
pub(super) struct PositionKeys {
    pub(super) unit: &'static str,
    pub(super) position: &'static str,
    pub(super) origin: &'static str,
    pub(super) span: &'static str,
    pub(super) period: &'static str,
    pub(super) range: &'static str,
    pub(super) travel: &'static str,
    /// File to inside.
    pub(super) read: fn(f64) -> f64,
    /// Inside to file.
    pub(super) write: fn(f64) -> f64,
}

/// Keys of error values.
#[derive(Debug)]
pub(super) struct ValueKeys {
    pub(super) unit: &'static str,
    pub(super) value: &'static str,
    pub(super) reverse: &'static str,
    pub(super) mean: &'static str,
    pub(super) linear: &'static str,
    pub(super) cos: &'static str,
    pub(super) sin: &'static str,
    pub(super) coefficients: &'static str,
    pub(super) std: &'static str,
    pub(super) limit: &'static str,
    /// File to inside.
    pub(super) read: fn(f64) -> f64,
    /// Inside to file.
    pub(super) write: fn(f64) -> f64,
}

static LINEAR: PositionKeys = PositionKeys {
    unit: "mm",
    position: "position-mm",
    origin: "origin-mm",
    span: "span-mm",
    period: "period-mm",
    range: "range-mm",
    travel: "travel-mm",
    read: core::convert::identity,
    write: core::convert::identity,
};

static ROTARY: PositionKeys = PositionKeys {
    unit: "deg",
    position: "position-deg",
    origin: "origin-deg",
    span: "span-deg",
    period: "period-deg",
    range: "range-deg",
    travel: "travel-deg",
    read: rad_from_deg,
    write: deg_from_rad,
};

static LENGTH: ValueKeys = ValueKeys {
    unit: "um",
    value: "value-um",
    reverse: "reverse-um",
    mean: "mean-um",
    linear: "linear-um",
    cos: "cos-um",
    sin: "sin-um",
    coefficients: "coefficients-um",
    std: "std-um",
    limit: "limit-um",
    read: mm_from_um,
    write: um_from_mm,
};

static ANGLE: ValueKeys = ValueKeys {
    unit: "arcsec",
    value: "value-arcsec",
    reverse: "reverse-arcsec",
    mean: "mean-arcsec",
    linear: "linear-arcsec",
    cos: "cos-arcsec",
    sin: "sin-arcsec",
    coefficients: "coefficients-arcsec",
    std: "std-arcsec",
    limit: "limit-arcsec",
    read: rad_from_arcsec,
    write: arcsec_from_rad,
};

/// Positions of a grid along an axis.
pub(super) const fn grid_key(axis: AxisName) -> &'static str {
    match axis {
        AxisName::X => "x-mm",
        AxisName::Y => "y-mm",
        AxisName::Z => "z-mm",
        AxisName::U => "u-mm",
        AxisName::V => "v-mm",
        AxisName::W => "w-mm",
        AxisName::A => "a-deg",
        AxisName::B => "b-deg",
        AxisName::C => "c-deg",
        AxisName::S => "s-deg",
    }
}

impl PositionKeys {
    pub(super) fn of(axis: AxisName) -> &'static Self {
        match axis.kind() {
            AxisKind::Linear => &LINEAR,
            AxisKind::Rotary => &ROTARY,
        }
    }

    /// Why the unit is what it is.
    pub(super) fn reason(axis: AxisName) -> String {
        format!("axis {axis} is {}", axis.kind().name())
    }
}

impl ValueKeys {
    pub(super) fn of(symbol: ErrorSymbol) -> &'static Self {
        if symbol.is_angle() { &ANGLE } else { &LENGTH }
    }

    /// Why the unit is what it is.
    pub(super) fn reason(symbol: ErrorSymbol) -> String {
        format!("{symbol} is {}", if symbol.is_angle() { "an angle" } else { "a length" })
    }
}
