//! What a model is made of, and the rules that a whole model must keep.

use super::chain_notation::Chain;
use super::curve::Grid;
use crate::correction::ROTARY_CORRECTION_LIMIT;
use crate::dynamics::DYNAMIC_MAX;
use crate::prelude::*;

/// In which sense the error motions of an axis are stored (equations 1.4).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sense {
    /// The tool-side body moves by E relative to the workpiece-side body; function of the programmed coordinate.
    #[default]
    Relative,
    /// The motion of the carriage itself in M, over its own displacement (`x = -q` where primed).
    Carriage,
}

impl Sense {
    /// Name in model files and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Relative => "relative",
            Self::Carriage => "carriage",
        }
    }
}

/// On which body the reference point of a linear component rides (equations 1.5).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ReferenceBody {
    /// The point moves with the carriage.
    #[default]
    Carriage,
    /// The point stays with the bed side.
    Bed,
}

/// The point at which one linear component of an error motion was measured, in M at home.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ReferencePoint {
    /// Coordinates, mm.
    pub point: Vec3,
    /// The body it rides on.
    pub body: ReferenceBody,
}

/// One axis of the model. Lengths mm, angles rad.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisSpec {
    /// Its letter.
    pub name: AxisName,
    /// Lowest and highest coordinate, where given.
    pub travel: Option<[f64; 2]>,
    /// A point on the axis of rotation (rotary axes), in M at home.
    pub point: Vec3,
    /// Sense of the stored error motions.
    pub sense: Sense,
    /// Abbe and Bryan points of the components X, Y, Z.
    pub reference_points: [ReferencePoint; 3],
    /// Largest correction of a rotary axis, rad.
    pub correction_limit: f64,
}

impl AxisSpec {
    /// An axis with everything at its default; a rotary axis turns about a line through the origin of M.
    #[must_use]
    pub fn new(name: AxisName) -> Self {
        Self {
            name,
            travel: None,
            point: Vec3::zeros(),
            sense: Sense::Relative,
            reference_points: [ReferencePoint::default(); 3],
            correction_limit: ROTARY_CORRECTION_LIMIT,
        }
    }
}

/// A complete model, not yet compiled for the cycle.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelSpec {
    /// The machine it belongs to.
    pub machine: String,
    /// The chain.
    pub chain: Chain,
    /// Origin of the workpiece frame W in M at home, mm.
    pub workpiece_origin: Vec3,
    /// Tool tip in M at home, mm.
    pub tool_tip: Vec3,
    /// Spindle nose in M at home, mm; the tip is this point minus the tool length along z.
    pub gauge_point: Option<Vec3>,
    /// The linear axis that points up, where it is said: weights pull against it.
    pub vertical: Option<AxisName>,
    /// Tilt of the spindle and error of the tool length; they need the gauge point.
    pub tool: ToolErrors,
    /// Coordinates at which the workpiece datum was touched, mm and rad (equations 1.9): deviations are then relative to
    /// the one at this pose. An axis that is not named stands at 0; none named: no datum.
    pub datum: Vec<(AxisName, f64)>,
    /// The axes, any order; an axis of the chain that is missing here has all defaults.
    pub axes: Vec<AxisSpec>,
    /// Errors by symbol; a missing error is zero.
    pub errors: Vec<(ErrorSymbol, ErrorFunction)>,
}

impl ModelSpec {
    /// A model without errors.
    #[must_use]
    pub fn new(machine: &str, chain: Chain) -> Self {
        Self {
            machine: machine.to_owned(),
            chain,
            workpiece_origin: Vec3::zeros(),
            tool_tip: Vec3::zeros(),
            gauge_point: None,
            vertical: None,
            tool: ToolErrors::default(),
            datum: Vec::new(),
            axes: Vec::new(),
            errors: Vec::new(),
        }
    }

    /// The entry of an axis, or its defaults.
    #[must_use]
    pub fn axis(&self, name: AxisName) -> AxisSpec {
        self.axes.iter().find(|a| a.name == name).cloned().unwrap_or_else(|| AxisSpec::new(name))
    }

    /// The entry of an axis, made where it is missing.
    pub fn axis_mut(&mut self, name: AxisName) -> &mut AxisSpec {
        let index = self.axes.iter().position(|a| a.name == name).unwrap_or_else(|| {
            self.axes.push(AxisSpec::new(name));
            self.axes.len() - 1
        });
        &mut self.axes[index]
    }

    /// The function of an error; none where the error is zero.
    #[must_use]
    pub fn error(&self, symbol: ErrorSymbol) -> Option<&ErrorFunction> {
        self.errors.iter().find(|(s, _)| *s == symbol).map(|(_, function)| function)
    }

    /// The function of an error, made in its place where it is missing.
    pub fn error_mut(&mut self, symbol: ErrorSymbol) -> &mut ErrorFunction {
        if self.error(symbol).is_none() {
            self.errors.push((symbol, ErrorFunction::default()));
            self.errors.sort_by_key(|(symbol, _)| *symbol);
        }
        let index = self.errors.iter().position(|(s, _)| *s == symbol).unwrap_or_default();
        &mut self.errors[index].1
    }

    /// Positions of an axis (tool-side sense, mm or rad) over which the model says something: its travel or, where none
    /// is stated, the hull of the ranges of its curves and grids; `None` where neither is there.
    #[must_use]
    pub fn domain(&self, name: AxisName) -> Option<[f64; 2]> {
        let axis = self.axis(name);
        let inverted = axis.sense == Sense::Carriage && self.is_workpiece_side(name);
        let ranges = self.errors.iter().flat_map(|(symbol, f)| {
            let curves = f.curves.iter().filter(|_| symbol.axis() == name).filter_map(Curve::range);
            curves.chain(f.grids.iter().filter_map(|g| g.range(name)))
        });
        let hull = ranges.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]);
        axis.travel.or_else(|| hull.map(|[low, high]| if inverted { [-high, -low] } else { [low, high] }))
    }

    /// The sensors whose live values the errors use, each once, in the order of the errors.
    #[must_use]
    pub fn sensors(&self) -> Vec<&str> {
        let mut sensors: Vec<&str> = Vec::new();
        for live in self.errors.iter().flat_map(|(_, f)| &f.live) {
            if !sensors.contains(&live.sensor.as_str()) {
                sensors.push(&live.sensor);
            }
        }
        sensors
    }

    /// Checks every rule that needs more than one entry to be seen.
    ///
    /// # Errors
    /// The first rule broken.
    pub fn validate(&self) -> Result<(), ModelError> {
        for (i, axis) in self.axes.iter().enumerate() {
            if self.chain.index_of(axis.name).is_none() {
                return Err(ModelError::AxisNotInChain { axis: axis.name });
            }
            if self.axes[..i].iter().any(|a| a.name == axis.name) {
                return Err(ModelError::AxisTwice { axis: axis.name });
            }
            if let Some([low, high]) = axis.travel
                && !(low.is_finite() && high.is_finite() && low < high)
            {
                return Err(ModelError::Travel { axis: axis.name, low, high });
            }
        }
        for (axis, at) in &self.datum {
            if self.chain.index_of(*axis).is_none() || !at.is_finite() {
                return Err(ModelError::Datum { axis: *axis });
            }
        }
        let found = self.sensors().len();
        if found > SENSORS_MAX {
            return Err(ModelError::TooManySensors { found });
        }
        let found = self.errors.iter().map(|(_, f)| f.dynamics.len()).sum();
        if found > DYNAMIC_MAX {
            return Err(ModelError::TooManyDynamicTerms { found });
        }
        if !self.tool.is_zero() && self.gauge_point.is_none() {
            return Err(ModelError::ToolWithoutGaugePoint);
        }
        let [a, b] = self.tool.tilt;
        if !(a.abs() <= ANGLE_LIMIT && b.abs() <= ANGLE_LIMIT && self.tool.length.abs() <= ANGLE_LIMIT) {
            return Err(ModelError::ToolTooLarge);
        }
        for (i, (symbol, function)) in self.errors.iter().enumerate() {
            if self.chain.index_of(symbol.axis()).is_none() {
                return Err(ModelError::ErrorOfMissingAxis { symbol: *symbol, axis: symbol.axis() });
            }
            if self.errors[..i].iter().any(|(s, _)| s == symbol) {
                return Err(ModelError::ErrorTwice { symbol: *symbol });
            }
            if function.dynamics.iter().any(|d| !d.is_valid()) {
                return Err(ModelError::NotFinite { symbol: *symbol });
            }
            let varies = !function.grids.is_empty()
                || !function.dynamics.is_empty()
                || function.curves.iter().any(|c| !matches!(c, Curve::Constant(_)));
            if symbol.is_constant() && varies {
                return Err(ModelError::NotConstant { symbol: *symbol });
            }
            for axis in function.grids.iter().flat_map(Grid::axes) {
                if self.chain.index_of(axis).is_none() {
                    return Err(ModelError::GridOverMissingAxis { symbol: *symbol, axis });
                }
            }
            self.squareness_has_partner(*symbol)?;
            check_size(*symbol, function)?;
        }
        Ok(())
    }

    /// A squareness needs both of its axes.
    fn squareness_has_partner(&self, symbol: ErrorSymbol) -> Result<(), ModelError> {
        let ErrorSymbol::Squareness { component, .. } = symbol else { return Ok(()) };
        let partner = if component == Component::A { AxisName::Y } else { AxisName::X };
        match self.chain.index_of(partner) {
            Some(_) => Ok(()),
            None => Err(ModelError::SquarenessWithoutPartner { symbol, partner }),
        }
    }

    /// True where the axis is on the workpiece side.
    #[must_use]
    pub fn is_workpiece_side(&self, name: AxisName) -> bool {
        self.chain.axes().iter().any(|a| a.name == name && a.side == Side::Workpiece)
    }

    /// True where the curves of the axis are stored over its own displacement `-q`: in the carriage sense on the workpiece side.
    #[must_use]
    pub fn is_mirrored(&self, name: AxisName) -> bool {
        self.axis(name).sense == Sense::Carriage && self.is_workpiece_side(name)
    }
}

/// The most sensors whose live values a model may use.
pub const SENSORS_MAX: usize = 32;
/// Largest error angle taken for real, rad; above it the unit is taken to be wrong.
pub const ANGLE_LIMIT: f64 = 10e-3;
/// Largest linear error taken for real, mm; above it the unit is taken to be wrong.
pub const LENGTH_LIMIT: f64 = 5.0;

/// Largest absolute value that a function can take, bounded from its parts.
fn bound(curve: &Curve) -> f64 {
    let largest = |v: &[f64]| v.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    match curve {
        Curve::Constant(v) => v.abs(),
        Curve::Table(t) => {
            let (_, forward, reverse) = t.columns();
            largest(forward).max(reverse.map_or(0.0, largest))
        }
        // sampled: coefficients may be large and cancel
        _ => {
            let [low, high] = curve.range().unwrap_or([0.0, 1.0]);
            (0..=256).fold(0.0, |m, i| {
                m.max(curve.value(low + (high - low) * f64::from(i) / 256.0, Default::default()).abs())
            })
        }
    }
}

fn check_size(symbol: ErrorSymbol, function: &ErrorFunction) -> Result<(), ModelError> {
    let grid = |g: &Grid| g.values().iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let live = function.live.iter().map(|l| l.limit.abs());
    let dynamics = function.dynamics.iter().map(|d| d.limit.abs());
    let parts = function.curves.iter().map(bound).chain(function.grids.iter().map(grid));
    let size = parts.chain(live).chain(dynamics).sum::<f64>();
    let limit = if symbol.is_angle() { ANGLE_LIMIT } else { LENGTH_LIMIT };
    if !size.is_finite() {
        return Err(ModelError::NotFinite { symbol });
    }
    if size > limit {
        return Err(if symbol.is_angle() {
            ModelError::AngleTooLarge { symbol, value_arcsec: crate::units::arcsec_from_rad(size) }
        } else {
            ModelError::LengthTooLarge { symbol, value_um: crate::units::um_from_mm(size) }
        });
    }
    Ok(())
}

/// A rule of the whole model that is broken.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// An axis entry for an axis that the chain does not have.
    #[error("axis {axis} has an entry but is not in the chain")]
    AxisNotInChain {
        /// The axis.
        axis: AxisName,
    },
    /// Two entries for one axis.
    #[error("axis {axis} has two entries")]
    AxisTwice {
        /// The axis.
        axis: AxisName,
    },
    /// Travel is empty or reversed.
    #[error("axis {axis}: travel from {low} to {high} is empty; write the lower end first")]
    Travel {
        /// The axis.
        axis: AxisName,
        /// Lower end.
        low: f64,
        /// Upper end.
        high: f64,
    },
    /// An error of an axis that the chain does not have.
    #[error("{symbol}: axis {axis} is not in the chain")]
    ErrorOfMissingAxis {
        /// The error.
        symbol: ErrorSymbol,
        /// The axis.
        axis: AxisName,
    },
    /// A grid over an axis that the chain does not have.
    #[error("{symbol}: its grid runs over axis {axis}, which is not in the chain")]
    GridOverMissingAxis {
        /// The error.
        symbol: ErrorSymbol,
        /// The axis.
        axis: AxisName,
    },
    /// A datum at an axis that the chain does not have, or at no finite coordinate.
    #[error("the datum names axis {axis}, which is not in the chain or has no finite coordinate")]
    Datum {
        /// The axis.
        axis: AxisName,
    },
    /// More sensors than the cycle is built for.
    #[error("{found} sensors with live values; the limit is {limit}", limit = SENSORS_MAX)]
    TooManySensors {
        /// Sensors named.
        found: usize,
    },
    /// More dynamic terms than the cycle is built for.
    #[error("{found} dynamic terms; the limit is {limit}", limit = DYNAMIC_MAX)]
    TooManyDynamicTerms {
        /// Terms found.
        found: usize,
    },
    /// Errors of tool and spindle follow the tool length, which counts from the gauge point.
    #[error("[tool] needs gauge-point-mm in [frame]: the tool length counts from there")]
    ToolWithoutGaugePoint,
    /// Errors of tool and spindle beyond what is believed.
    #[error("[tool] exceeds 2063 arcsec (10 mrad) or 10000 um/m")]
    ToolTooLarge,
    /// The same error twice.
    #[error("{symbol} is given twice")]
    ErrorTwice {
        /// The error.
        symbol: ErrorSymbol,
    },
    /// A squareness or location error that is not one number.
    #[error("{symbol} is one number; write it as [errors.{}.constant]", symbol.to_string().to_lowercase())]
    NotConstant {
        /// The error.
        symbol: ErrorSymbol,
    },
    /// A squareness to an axis that does not exist.
    #[error("{symbol} is a squareness to axis {partner}, which is not in the chain")]
    SquarenessWithoutPartner {
        /// The error.
        symbol: ErrorSymbol,
        /// The axis it refers to.
        partner: AxisName,
    },
    /// A value that is not finite.
    #[error("{symbol} has a value that is not finite")]
    NotFinite {
        /// The error.
        symbol: ErrorSymbol,
    },
    /// Larger than any machine angle error.
    #[error("{symbol} reaches {} arcsec; the limit is 2063 arcsec (10 mrad): {}", whole(*value_arcsec), angle_unit_hint(*value_arcsec))]
    AngleTooLarge {
        /// The error.
        symbol: ErrorSymbol,
        /// Its size, arcsec.
        value_arcsec: f64,
    },
    /// Larger than any machine length error.
    #[error("{symbol} reaches {} um; the limit is 5000 um (5 mm): {}", whole(*value_um), length_unit_hint(*value_um))]
    LengthTooLarge {
        /// The error.
        symbol: ErrorSymbol,
        /// Its size, um.
        value_um: f64,
    },
}

/// A number without decimals, with an exponent where it would have many digits.
fn whole(v: f64) -> String {
    if v.abs() < 1e9 { format!("{v:.0}") } else { format!("{v:.3e}") }
}

/// Names a unit in which the number would be a possible error.
#[must_use]
pub fn angle_unit_hint(arcsec: f64) -> &'static str {
    match arcsec {
        v if v <= 1e4 => "were these values in urad, not in arcsec?",
        v if v <= 1e7 => "were these values in nrad, not in arcsec?",
        _ => "are these angles instead of their errors?",
    }
}

/// Names a unit in which the number would be a possible error.
#[must_use]
pub fn length_unit_hint(um: f64) -> &'static str {
    match um {
        v if v <= 5e6 => "were these values in nm, not in um?",
        _ => "are these positions instead of deviations?",
    }
}
