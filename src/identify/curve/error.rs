//! Why no curve could be fitted.

use super::request::Basis;
use volcomp_model::curve::CurveError;
use volcomp_units::axes::{AxisKind, Travel};

/// Condition number above which the terms count as indistinguishable.
pub(super) const CONDITION_LIMIT: f64 = 1e10;

/// Why no curve could be fitted.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum FitError {
    /// Nothing to fit a curve through.
    #[error("{found} distinct positions; a curve needs at least {needed}")]
    TooFewPositions {
        /// Positions found.
        found: usize,
        /// Positions needed.
        needed: usize,
    },
    /// A reading that is no number.
    #[error("reading {row} is not finite")]
    NotFinite {
        /// 1-based reading.
        row: usize,
    },
    /// More terms than the positions can carry.
    #[error(
        "order {order} of the {} basis exceeds the limit of {limit} for {positions} positions (2 sqrt(n), the model's limit, and as many positions as terms); take a lower order or measure more positions",
        basis.name()
    )]
    OrderTooHigh {
        /// Family of curves.
        basis: Basis,
        /// Order asked for.
        order: usize,
        /// Highest order allowed.
        limit: usize,
        /// Distinct positions.
        positions: usize,
    },
    /// A Fourier series without harmonics is a straight line.
    #[error("a fourier series needs order 1 or more, found 0; take --basis chebyshev --order 1 for a line")]
    NoHarmonic,
    /// A period that is no period.
    #[error("period {value} is not above 0")]
    PeriodNotPositive {
        /// The value.
        value: f64,
    },
    /// No period can be seen in these data.
    #[error(
        "period search from {low} to {high} is empty: {order} harmonics need two positions per wave; take a lower order or measure closer"
    )]
    PeriodSearchEmpty {
        /// Shortest period.
        low: f64,
        /// Longest period.
        high: f64,
        /// Harmonics.
        order: usize,
    },
    /// The positions do not tell the terms apart.
    #[error("these positions do not tell the terms of the {} basis of order {order} apart (condition {condition:.1e}, limit {limit:.0e}); take a lower order, another period or basis, or a ridge", basis.name(), limit = CONDITION_LIMIT)]
    Degenerate {
        /// Family of curves.
        basis: Basis,
        /// Order.
        order: usize,
        /// Condition number.
        condition: f64,
    },
    /// A ridge must not be negative.
    #[error("ridge {value} is not a number from 0 up")]
    BadRidge {
        /// The value.
        value: f64,
    },
    /// A table with two directions needs both at every target.
    #[error("position {position} was not approached in the {} direction; a table with reversal needs every target from both sides (select the cycles or one direction)", direction_name(*travel))]
    DirectionMissing {
        /// The position, mm or rad.
        position: f64,
        /// The direction without a reading.
        travel: Travel,
    },
    /// A range that is none.
    #[error(
        "range {low} to {high} is empty, or shorter than a billionth of the stretch measured; give the travel of the axis"
    )]
    EmptyRange {
        /// Lower end.
        low: f64,
        /// Upper end.
        high: f64,
    },
    /// One penalty per coefficient is needed.
    #[error("{found} penalties for {terms} coefficients; give the order, and one penalty per coefficient")]
    PenaltyCount {
        /// Penalties found.
        found: usize,
        /// Coefficients.
        terms: usize,
    },
    /// The strength of smoothing must not be negative.
    #[error("smoothing {value} is not a number from 0 up")]
    BadSmoothing {
        /// The value.
        value: f64,
    },
    /// So many readings disagree with the rest that the curve is wrong, not they.
    #[error(
        "{found} of {readings} readings disagree with the rest; up to a quarter can be left out as outliers: take another basis, or fit without --robust and look at the picture"
    )]
    TooManyOutliers {
        /// Readings that disagree.
        found: usize,
        /// Readings in all.
        readings: usize,
    },
    /// Nothing tells an outlier from an error of the machine.
    #[error(
        "outliers of a table need three readings at every target and direction; measure again, or take a smooth basis"
    )]
    NoRepeats,
    /// The curve cannot be built.
    #[error(transparent)]
    Curve(#[from] CurveError),
}

impl FitError {
    /// The same with positions and periods in the units of an axis, for a message: degrees where it turns.
    #[must_use]
    pub fn in_units_of(self, kind: AxisKind) -> Self {
        match self {
            other if !kind.is_rotary() => other,
            Self::DirectionMissing { position, travel } => {
                Self::DirectionMissing { position: position.to_degrees(), travel }
            }
            Self::PeriodNotPositive { value } => Self::PeriodNotPositive { value: value.to_degrees() },
            Self::PeriodSearchEmpty { low, high, order } => {
                Self::PeriodSearchEmpty { low: low.to_degrees(), high: high.to_degrees(), order }
            }
            other => other,
        }
    }
}

const fn direction_name(travel: Travel) -> &'static str {
    match travel {
        Travel::Forward => "positive",
        Travel::Reverse => "negative",
    }
}
