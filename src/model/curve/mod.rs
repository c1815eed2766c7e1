//! Error functions: the value of one error motion over the coordinate of its axis.
//!
//! Positions are mm or rad (the axis decides), values mm or rad (the symbol decides). Every curve is
//! evaluated inside its own range only: outside, the end value is held (equations 5.9, "never extrapolate").

mod grid;
mod harmonic;
mod polynomial;
mod table;

pub use grid::{GRID_POINTS_MAX, Grid};
pub use harmonic::{Fourier, HalfRange};
pub use polynomial::Chebyshev;
pub use table::{Interpolation, Table};

use crate::prelude::*;

/// Why a curve cannot be built.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum CurveError {
    /// Not enough support points.
    #[error("a table needs at least {needed} positions, found {found}")]
    TooFewPoints {
        /// Positions needed.
        needed: usize,
        /// Positions found.
        found: usize,
    },
    /// One value per position is required.
    #[error("{found} values for {expected} positions")]
    LengthMismatch {
        /// Number of positions.
        expected: usize,
        /// Number of values.
        found: usize,
    },
    /// Positions must increase strictly.
    #[error("position {value} (row {row}) is not above {previous} (row {})", row - 1)]
    NotIncreasing {
        /// 1-based row of the offending position.
        row: usize,
        /// The offending position.
        value: f64,
        /// The position before it.
        previous: f64,
    },
    /// A number is NaN or infinite.
    #[error("number {row} is not finite")]
    NotFinite {
        /// 1-based row.
        row: usize,
    },
    /// A span, period or range that must be positive is not.
    #[error("{what} must be above 0, found {value}")]
    NotPositive {
        /// The quantity.
        what: &'static str,
        /// The value found.
        value: f64,
    },
    /// A grid needs two or three axes.
    #[error("a grid has two or three axes, found {found}")]
    GridAxes {
        /// Axes found.
        found: usize,
    },
    /// A grid names an axis twice.
    #[error("a grid names axis {axis} twice")]
    GridAxisTwice {
        /// The axis.
        axis: AxisName,
    },
    /// More terms than the cycle is built for.
    #[error("{found} terms exceed the limit of {limit}")]
    TooManyTerms {
        /// Terms found.
        found: usize,
        /// Most terms allowed.
        limit: usize,
    },
}

/// The most harmonics or polynomial degrees of one curve.
pub const MAX_TERMS: usize = 64;

/// One curve.
#[derive(Debug, Clone, PartialEq)]
pub enum Curve {
    /// The same value everywhere.
    Constant(f64),
    /// Support points with linear or monotone cubic interpolation.
    Table(Table),
    /// Mean, linear part and harmonics of a period.
    Fourier(Fourier),
    /// Mean, linear part and sine half waves over the range.
    HalfRange(HalfRange),
    /// Chebyshev polynomials over a range.
    Chebyshev(Chebyshev),
}

impl Curve {
    /// The value at `position`, travelling in direction `travel`.
    #[must_use]
    pub fn value(&self, position: f64, travel: Travel) -> f64 {
        match self {
            Self::Constant(value) => *value,
            Self::Table(t) => t.value(position, travel),
            Self::Fourier(f) => f.value(position),
            Self::HalfRange(h) => h.value(position),
            Self::Chebyshev(c) => c.value(position),
        }
    }

    /// The range that the curve was made for; `None` where it holds everywhere.
    #[must_use]
    pub fn range(&self) -> Option<[f64; 2]> {
        match self {
            Self::Constant(_) => None,
            Self::Table(t) => Some(t.range()),
            Self::Fourier(f) => Some(f.range()),
            Self::HalfRange(h) => Some(h.range()),
            Self::Chebyshev(c) => Some(c.range()),
        }
    }
}

/// A value that a sensor tells while the machine works; zero until it does.
#[derive(Debug, Clone, PartialEq)]
pub struct Live {
    /// The sensor by name.
    pub sensor: String,
    /// The value is kept within plus and minus this, mm or rad.
    pub limit: f64,
    /// Where given, the sensor tells a strain, mm or rad per mm, and this is the coordinate in mm that does not move.
    pub reference: Option<f64>,
}

/// An error motion: the sum of its curves, grids and live values, with the uncertainty that was stated for it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ErrorFunction {
    /// Terms over the coordinate of the axis itself, to add up; empty means zero.
    pub curves: Vec<Curve>,
    /// Terms over the coordinates of several axes, to add up.
    pub grids: Vec<Grid>,
    /// Values from sensors, to add up.
    pub live: Vec<Live>,
    /// Terms that follow the motion of the axis, to add up.
    pub dynamics: Vec<DynamicTerm>,
    /// Standard uncertainty (k = 1), mm or rad, where stated.
    pub std: Option<f64>,
}

impl ErrorFunction {
    /// A function of one curve.
    #[must_use]
    pub fn single(curve: Curve) -> Self {
        Self { curves: vec![curve], ..Self::default() }
    }

    /// With what was found beyond it; `std` is the standard uncertainty (k = 1) of that. A constant that was found beyond a
    /// constant was measured anew as a whole.
    #[must_use]
    pub fn with(mut self, more: Curve, std: f64) -> Self {
        if let ([Curve::Constant(value)], Curve::Constant(more)) = (&mut self.curves[..], &more) {
            *value += more;
            return Self { std: Some(std), ..self };
        }
        self.curves.push(more);
        Self { std: Some(self.std.unwrap_or(0.0).hypot(std)), ..self }
    }

    /// The part that depends on the axis itself, at `position`, each curve held at the ends of its own range.
    #[must_use]
    pub fn value(&self, position: f64, travel: Travel) -> f64 {
        self.curves.iter().map(|c| c.value(position, travel)).sum()
    }

    /// The part of the grids; `at` gives the coordinate of an axis.
    pub fn grids_value(&self, at: impl Fn(AxisName) -> f64) -> f64 {
        self.grids.iter().map(|grid| grid.value(&grid.axes().map(&at).collect::<Vec<_>>()).0).sum()
    }

    /// The range that all curves cover; `None` where all hold everywhere.
    #[must_use]
    pub fn range(&self) -> Option<[f64; 2]> {
        self.curves.iter().filter_map(Curve::range).reduce(|a, b| [a[0].max(b[0]), a[1].min(b[1])])
    }
}

/// Refuses NaN and infinities, naming the 1-based row.
fn all_finite(values: &[f64]) -> Result<(), CurveError> {
    match values.iter().position(|v| !v.is_finite()) {
        Some(i) => Err(CurveError::NotFinite { row: i + 1 }),
        None => Ok(()),
    }
}

/// Refuses zero, negative and non-finite numbers.
fn positive(what: &'static str, value: f64) -> Result<f64, CurveError> {
    if value.is_finite() && value > 0.0 { Ok(value) } else { Err(CurveError::NotPositive { what, value }) }
}
