//! Readings of one error motion to the curve that describes it: least squares in well-conditioned bases.
//!
//! Bases, over `[x0, x0 + T]`, `u = (x - x0)/T`, `s = 2u - 1`:
//! half-range `1, s, sin(k pi u)`; Chebyshev `T_k(s)`; Fourier `1, [s], cos, sin(2 pi k (x - x0)/P)` of one or
//! several periods; table: the mean at every target, smoothed where wanted. Where both directions were measured, half
//! of the reversal is a Chebyshev polynomial of its own, added towards plus and taken off towards minus.
//!
//! Assumptions: errors of the readings are independent and of equal size. Where they are not (drift from
//! cycle to cycle), AICc finds too much; therefore a simpler curve wins where leaving out whole positions says so.
//!
//! Source: equations 5.9; figures: `docs/reference/json-output.md` 2. Reading order: this file, `data`, `basis`, `solve`,
//! `figures`, `select` (orders and reversal), `periods`, `support` and `smooth` (tables), `band`, `robust`;
//! `sampling` (what targets cannot show) and `monomial` (polynomials as others write them) stand beside.

mod band;
mod basis;
mod climb;
mod data;
mod error;
mod figures;
mod lanes;
pub mod monomial;
mod periods;
mod robust;
mod sampling;
mod select;
mod smooth;
mod solve;
mod support;

pub use band::Band;
pub use error::FitError;
pub use figures::Figures;
pub use periods::period_range;
pub use robust::Outlier;
pub use sampling::{COMMON_PITCHES, Hidden, hidden};
pub use select::highest_order;

use volcomp_model::Curve;
use volcomp_model::curve::{ErrorFunction, Interpolation};
use volcomp_units::axes::Travel;

use super::reading::Reading;
use data::Data;

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
    /// Fitted, anywhere the data can show it; a whole turn where a rotary axis was measured over one.
    #[default]
    Auto,
    /// Fitted, inside these limits.
    Within([f64; 2]),
    /// Given.
    Given(f64),
}

/// What happens to the difference between the directions of travel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Reversal {
    /// It is kept where the readings show it.
    #[default]
    Auto,
    /// The curve holds the mean of both directions.
    Mean,
}

/// Smoothing of a table.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Smoothing {
    /// The mean of the readings at every target.
    #[default]
    None,
    /// As much as generalised cross-validation asks for.
    Auto,
    /// This much: `alpha` of `SUM n_i (mean_i - g_i)^2 + alpha INT g''^2`.
    Given(f64),
}

/// What to fit; `None` leaves the choice to the data.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Request {
    /// Family of curves.
    pub basis: Option<Basis>,
    /// Half waves, polynomial degree or harmonics.
    pub order: Option<usize>,
    /// Period of a Fourier series.
    pub period: Period,
    /// Further periods of it, each with as many harmonics.
    pub further_periods: Vec<Period>,
    /// Whether a Fourier series has a linear part.
    pub linear: Option<bool>,
    /// Penalty `lambda SUM k^4 c_k^2` on the terms of order k; `None` fits without.
    pub ridge: Option<f64>,
    /// Penalties `SUM p_j c_j^2` coefficient by coefficient, instead of a ridge; with an order only.
    pub penalties: Option<Vec<f64>>,
    /// Range of the basis instead of first to last position.
    pub range: Option<[f64; 2]>,
    /// Interpolation of a table.
    pub interpolation: Interpolation,
    /// Smoothing of a table.
    pub smoothing: Smoothing,
    /// The difference between the directions.
    pub reversal: Reversal,
    /// Outliers are found, named and left out.
    pub robust: bool,
    /// The full turn of a rotary axis, rad: readings over all of it give a curve that closes.
    pub turn: Option<f64>,
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
    /// Both directions were measured, and the curve tells them apart.
    ReversalKept {
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
    /// A whole turn was measured, and this basis does not come back to where it began.
    TurnLeftOpen {
        /// Difference of the curve between its ends.
        step: f64,
    },
}

/// The difference between the directions of travel.
#[derive(Debug, Clone, PartialEq)]
pub struct ReversalFit {
    /// Half of forward minus reverse as Chebyshev polynomials over the range.
    pub coefficients: Vec<f64>,
}

/// A fitted curve.
#[derive(Debug, Clone, PartialEq)]
pub struct CurveFit {
    /// Family of curves.
    pub basis: Basis,
    /// Half waves, degree or harmonics; `None` for a table.
    pub order: Option<usize>,
    /// Period of a Fourier series; of several the first that was fitted.
    pub period: Option<f64>,
    /// All its periods: given ones, then fitted ones, longest first.
    pub periods: Vec<f64>,
    /// True where a period came from the data.
    pub period_fitted: bool,
    /// Half-range: mean, linear, sines. Chebyshev: `T_0` and up. Fourier: mean, linear where present, then
    /// cosine and sine of each harmonic of each period. Table: forward values, then reverse values where present.
    pub coefficients: Vec<f64>,
    /// The difference between the directions, where a smooth curve holds it.
    pub reversal: Option<ReversalFit>,
    /// The curve without [`more`](Self::more).
    pub curve: Curve,
    /// What adds to it: further periods, the reversal.
    pub more: Vec<Curve>,
    /// How well it fits.
    pub figures: Figures,
    /// How well the curve is known; `None` without degrees of freedom.
    pub band: Option<Band>,
    /// Strength of smoothing of a table, where smoothed.
    pub smoothing: Option<f64>,
    /// Readings left out.
    pub outliers: Vec<Outlier>,
    /// Condition number of the basis on these positions (1 for a table).
    pub condition: f64,
    /// What the user should know.
    pub notes: Vec<Note>,
}

impl CurveFit {
    /// A fit with everything else absent; `curves` is not empty.
    fn new(basis: Basis, coefficients: Vec<f64>, curves: Vec<Curve>, figures: Figures) -> Self {
        let mut curves = curves.into_iter();
        Self {
            basis,
            order: None,
            period: None,
            periods: Vec::new(),
            period_fitted: false,
            coefficients,
            reversal: None,
            curve: curves.next().unwrap_or(Curve::Constant(0.0)),
            more: curves.collect(),
            figures,
            band: None,
            smoothing: None,
            outliers: Vec::new(),
            condition: 1.0,
            notes: Vec::new(),
        }
    }

    /// The value at `position`, travelling in direction `travel`.
    #[must_use]
    pub fn value(&self, position: f64, travel: Travel) -> f64 {
        self.curve.value(position, travel) + self.more.iter().map(|c| c.value(position, travel)).sum::<f64>()
    }

    /// The error function of a model, with the residual standard deviation as its uncertainty.
    #[must_use]
    pub fn function(&self) -> ErrorFunction {
        let curves = core::iter::once(&self.curve).chain(&self.more).cloned().collect();
        ErrorFunction { curves, std: self.figures.rmse_dof, ..ErrorFunction::default() }
    }
}

/// Condition number above which coefficients are reported as ill-determined.
const CONDITION_NOTE: f64 = 1e4;

/// Share of the RMS residual above which a reversal that is left out is reported.
const REVERSAL_NOTE: f64 = 0.5;

/// Fits a curve to the readings of one error motion.
///
/// # Errors
/// Too few positions for what was asked, numbers that are not finite, terms that the positions cannot tell apart,
/// more outliers than a quarter.
///
/// # Source  equations 5.9
pub fn fit(readings: &[Reading], request: &Request) -> Result<CurveFit, FitError> {
    if let Some(value) = request.ridge
        && !(value.is_finite() && value >= 0.0)
    {
        return Err(FitError::BadRidge { value });
    }
    if let Some(bad) = request.penalties.iter().flatten().find(|p| !(p.is_finite() && **p >= 0.0)) {
        return Err(FitError::BadRidge { value: *bad });
    }
    if let Some([low, high]) = request.range
        && !(low.is_finite() && high.is_finite() && low < high)
    {
        return Err(FitError::EmptyRange { low, high });
    }
    if request.robust {
        robust::fit(readings, request, all_readings)
    } else {
        all_readings(readings, request)
    }
}

fn all_readings(readings: &[Reading], request: &Request) -> Result<CurveFit, FitError> {
    // polynomials and half waves cannot close: they keep the ends that were measured
    let closes = !matches!(request.basis, Some(Basis::HalfRange | Basis::Chebyshev));
    let data = Data { given_range: request.range, ..Data::new(readings, request.turn.filter(|_| closes))? };
    let mut fit = match request.basis {
        Some(Basis::Table) if request.reversal == Reversal::Mean => {
            support::fit(&data.one_direction(), request.interpolation, request.smoothing)?
        }
        Some(Basis::Table) => support::fit(&data, request.interpolation, request.smoothing)?,
        Some(basis) => select::best_of_basis(&data, basis, request)?,
        None => select::best_of_all(&data, request)?,
    };
    if fit.condition > CONDITION_NOTE {
        fit.notes.push(Note::IllConditioned { condition: fit.condition });
    }
    if let Some(mean) = data.mean_reversal() {
        if fit.reversal.is_some() {
            fit.notes.push(Note::ReversalKept { mean });
        } else if mean.abs() > REVERSAL_NOTE * fit.figures.rmse_n && !select::holds_reversal(&fit) {
            fit.notes.push(Note::ReversalLeftOut { mean });
        }
    }
    if !closes
        && let Some(turn) = request.turn
        && Data::new(readings, Some(turn))?.turn.is_some()
    {
        let [low, high] = data.range();
        let step = fit.value(high, Travel::Forward) - fit.value(low, Travel::Forward);
        fit.notes.push(Note::TurnLeftOpen { step });
    }
    Ok(fit)
}

#[cfg(test)]
mod tests;
