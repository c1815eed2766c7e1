//! Why a model cannot be written in a format.

use crate::prelude::*;

/// Why a model cannot be written in a format.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ExportError {
    /// An axis that the model does not have.
    #[error("axis {axis} is not in the chain of the model")]
    AxisNotInChain {
        /// The axis.
        axis: AxisName,
    },
    /// Nothing to write.
    #[error("the model has no {what} over the position of axis {axis}; nothing to write")]
    NoError {
        /// What the format would hold.
        what: &'static str,
        /// The axis.
        axis: AxisName,
    },
    /// The range of the table is not known.
    #[error("axis {axis} has neither a travel nor a curve with a range; give --range LOW:HIGH")]
    NoRange {
        /// The axis.
        axis: AxisName,
    },
    /// A range that is none.
    #[error("axis {axis}: range from {low} to {high} is empty; write the lower end first")]
    EmptyRange {
        /// The axis.
        axis: AxisName,
        /// Lower end.
        low: f64,
        /// Upper end.
        high: f64,
    },
    /// Values that a sensor tells.
    #[error("{symbol} has a part that a sensor tells while the machine works; no table can hold it")]
    Live {
        /// The error.
        symbol: ErrorSymbol,
    },
    /// Several axes.
    #[error("{symbol} depends on several axes; {format} holds curves over one axis only (isg holds grids)")]
    Grid {
        /// The error.
        symbol: ErrorSymbol,
        /// The format.
        format: &'static str,
    },
    /// Two directions.
    #[error(
        "{symbol} differs between the directions of travel, {format} does not: choose with --direction forward, reverse or mean"
    )]
    TwoDirections {
        /// The error.
        symbol: ErrorSymbol,
        /// The format.
        format: &'static str,
    },
    /// Too many points.
    #[error(
        "{found} points are needed, {format} holds {limit}; give a larger --tolerance-um, a --step, or a smaller --range (with {limit} equidistant points the table would err by {reached_um:.3} um)"
    )]
    TooManyPoints {
        /// Points needed, at least.
        found: usize,
        /// Most the format holds.
        limit: usize,
        /// The format.
        format: &'static str,
        /// Largest error with the most points, um (angles: over a lever of one metre).
        reached_um: f64,
    },
    /// Two points that the format prints alike.
    #[error(
        "axis {axis}: the model changes by more than the tolerance between positions that are equal to {decimals} decimals, as {format} writes them; the table would err by {reached_um:.3} um: give a larger --tolerance-um"
    )]
    Jump {
        /// The axis.
        axis: AxisName,
        /// The format.
        format: &'static str,
        /// Its decimals of a position, mm or deg.
        decimals: usize,
        /// Largest error of the table, um (angles: over a lever of one metre).
        reached_um: f64,
    },
    /// A step that does not fit.
    #[error("step {step} is not above 0 and below the range of {span}")]
    Step {
        /// The step.
        step: f64,
        /// Length of the range.
        span: f64,
    },
    /// An axis letter that the format does not have.
    #[error("{format} has no axis {axis}; its axes are {known}")]
    NoSuchAxis {
        /// The axis.
        axis: AxisName,
        /// The format.
        format: &'static str,
        /// Axes of the format.
        known: &'static str,
    },
    /// The body whose motion the values describe.
    #[error(
        "axis {axis} is on the workpiece side, and the format does not say whose motion its values are: give --sense relative or --sense carriage"
    )]
    SenseNotStated {
        /// The axis.
        axis: AxisName,
    },
    /// Not exactly one axis.
    #[error("{format} is for one axis: give --axis once")]
    OneAxis {
        /// The format, or what is asked of it.
        format: &'static str,
    },
    /// The kind of a COMP_FILE.
    #[error("give --comp-type 0 (actual positions) or 1 (trims), as COMP_FILE_TYPE of the INI file")]
    CompTypeNotStated,
    /// A sign that nobody documents.
    #[error(
        "the sign of the values is not documented for this format: give --sign deviation (actual - nominal) or --sign correction, after a look into the control's manual"
    )]
    SignNotStated,
}
