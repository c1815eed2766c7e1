//! Readings of one error motion to the curve that describes it: least squares in well-conditioned bases.
//!
//! Bases, over `[x0, x0 + T]`, `u = (x - x0)/T`, `s = 2u - 1`:
//! half-range `1, s, sin(k pi u)`; Chebyshev `T_k(s)`; Fourier `1, [s], cos, sin(2 pi k (x - x0)/P)`;
//! table: the mean at every target.
//!
//! Assumptions: errors of the readings are independent and of equal size. Where they are not (drift from
//! cycle to cycle), AICc finds too much; therefore a simpler curve wins where leaving out whole positions says so.
//!
//! Source: equations 5.9; figures as in contract section 5. Reading order: this file, `basis`, `solve`,
//! `figures`, `select` (orders and periods), `support` (tables).

mod basis;
mod figures;
mod select;
mod solve;
mod support;

pub use figures::Figures;
pub use select::{highest_order, period_range};

use crate::core::axes::Travel;
use crate::core::model::Curve;
use crate::core::model::curve::{CurveError, Interpolation};

use super::reading::{Reading, group_by_position};

/// A family of curves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Basis {
    /// Mean, linear part and sine half waves over the range (B1).
    HalfRange,
    /// Chebyshev polynomials (B2).
    Chebyshev,
    /// Mean, linear part where wanted, and harmonics of a period (B3).
    Fourier,
    /// Support points at the targets.
    Table,
}

impl FitError {
    /// The same with positions and periods in degrees, for the message about a rotary axis.
    #[must_use]
    pub fn in_degrees(self) -> Self {
        match self {
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

impl Basis {
    /// The name used in arguments and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::HalfRange => "half-range",
            Self::Chebyshev => "chebyshev",
            Self::Fourier => "fourier",
            Self::Table => "table",
        }
    }
}

/// The period of a Fourier series.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Period {
    /// Fitted, anywhere the data can show it.
    #[default]
    Auto,
    /// Fitted, inside these limits.
    Within([f64; 2]),
    /// Given.
    Given(f64),
}

/// What to fit; `None` leaves the choice to the data.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Request {
    /// Family of curves.
    pub basis: Option<Basis>,
    /// Half waves, polynomial degree or harmonics.
    pub order: Option<usize>,
    /// Period of a Fourier series.
    pub period: Period,
    /// Whether a Fourier series has a linear part.
    pub linear: Option<bool>,
    /// Penalty `lambda SUM k^4 c_k^2` on the terms of order k; `None` fits without.
    pub ridge: Option<f64>,
    /// Interpolation of a table.
    pub interpolation: Interpolation,
}

/// Something the user should know about a fit that was made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Note {
    /// Terms nearly cancel: the curve is right on the data, its coefficients mean little.
    IllConditioned {
        /// Condition number of the basis on these positions.
        condition: f64,
    },
    /// Both directions were measured, and this curve holds their mean only.
    ReversalLeftOut {
        /// Mean difference forward minus reverse.
        mean: f64,
    },
    /// The positions are too far apart for what the error does between them.
    SparseTargets {
        /// RMS error with which left-out positions are predicted.
        error: f64,
        /// The order that predicts them better, but loses what the measured positions show.
        lower: usize,
    },
    /// AICc preferred a higher order that predicts left-out positions worse.
    OrderLowered {
        /// The order of lowest AICc.
        from: usize,
        /// The order taken.
        to: usize,
    },
}

/// A fitted curve.
#[derive(Debug, Clone, PartialEq)]
pub struct CurveFit {
    /// Family of curves.
    pub basis: Basis,
    /// Half waves, degree or harmonics; `None` for a table.
    pub order: Option<usize>,
    /// Period of a Fourier series.
    pub period: Option<f64>,
    /// True where the period came from the data.
    pub period_fitted: bool,
    /// Half-range: mean, linear, sines. Chebyshev: `T_0` and up. Fourier: mean, linear where present, then
    /// cosine and sine of each harmonic. Table: forward values, then reverse values where present.
    pub coefficients: Vec<f64>,
    /// The curve.
    pub curve: Curve,
    /// How well it fits.
    pub figures: Figures,
    /// Condition number of the basis on these positions (1 for a table).
    pub condition: f64,
    /// What the user should know.
    pub notes: Vec<Note>,
}

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
    #[error("these positions do not tell the terms of the {} basis of order {order} apart (condition {condition:.1e}, limit {limit:.0e}); take a lower order, another period or basis, or a ridge", basis.name(), limit = solve::CONDITION_LIMIT)]
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
    /// The curve cannot be built.
    #[error(transparent)]
    Curve(#[from] CurveError),
}

const fn direction_name(travel: Travel) -> &'static str {
    match travel {
        Travel::Forward => "positive",
        Travel::Reverse => "negative",
    }
}

/// Condition number above which coefficients are reported as ill-determined.
const CONDITION_NOTE: f64 = 1e4;

/// Share of the RMS residual above which a reversal that is left out is reported.
const REVERSAL_NOTE: f64 = 0.5;

/// Readings made ready for fitting.
struct Data<'a> {
    readings: &'a [Reading],
    /// Distinct positions, increasing.
    positions: Vec<f64>,
    /// For each reading the index of its position.
    group: Vec<usize>,
}

impl<'a> Data<'a> {
    fn new(readings: &'a [Reading]) -> Result<Self, FitError> {
        if let Some(i) = readings.iter().position(|r| !(r.position.is_finite() && r.value.is_finite())) {
            return Err(FitError::NotFinite { row: i + 1 });
        }
        let (positions, group) = group_by_position(readings);
        if positions.len() < 2 {
            return Err(FitError::TooFewPositions { found: positions.len(), needed: 2 });
        }
        Ok(Self { readings, positions, group })
    }

    fn range(&self) -> [f64; 2] {
        [self.positions[0], self.positions[self.positions.len() - 1]]
    }

    fn values(&self) -> impl Iterator<Item = f64> + '_ {
        self.readings.iter().map(|r| r.value)
    }

    /// True for every position but the first and the last.
    fn is_inner(&self, group: usize) -> bool {
        group > 0 && group + 1 < self.positions.len()
    }

    fn both_directions(&self) -> bool {
        self.readings.iter().any(|r| r.travel == Travel::Forward)
            && self.readings.iter().any(|r| r.travel == Travel::Reverse)
    }

    /// Mean of forward minus reverse over the positions that have both.
    fn mean_reversal(&self) -> Option<f64> {
        if !self.both_directions() {
            return None;
        }
        let [forward, reverse] = [Travel::Forward, Travel::Reverse].map(|t| support::means(self, t));
        let pairs: Vec<f64> =
            forward.iter().zip(&reverse).filter_map(|(f, r)| Some(f.as_ref()? - r.as_ref()?)).collect();
        (!pairs.is_empty()).then(|| pairs.iter().sum::<f64>() / pairs.len() as f64)
    }
}

/// Fits a curve to the readings of one error motion.
///
/// # Errors
/// Too few positions for what was asked, numbers that are not finite, terms that the positions cannot tell apart.
///
/// # Source  equations 5.9
pub fn fit(readings: &[Reading], request: &Request) -> Result<CurveFit, FitError> {
    if let Some(value) = request.ridge
        && !(value.is_finite() && value >= 0.0)
    {
        return Err(FitError::BadRidge { value });
    }
    let data = Data::new(readings)?;
    let mut fit = match request.basis {
        Some(Basis::Table) => support::fit(&data, request.interpolation)?,
        Some(basis) => select::best_of_basis(&data, basis, request)?,
        None => select::best_of_all(&data, request)?,
    };
    if fit.condition > CONDITION_NOTE {
        fit.notes.push(Note::IllConditioned { condition: fit.condition });
    }
    if fit.basis != Basis::Table
        && let Some(mean) = data.mean_reversal()
        && mean.abs() > REVERSAL_NOTE * fit.figures.rmse_n
    {
        fit.notes.push(Note::ReversalLeftOut { mean });
    }
    Ok(fit)
}

#[cfg(test)]
mod tests;
