//! What is to be fitted.

use volcomp_model::curve::Interpolation;

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

/// What happens to a drift over the cycles of a test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Drift {
    /// It stays in the readings; a significant one is noted.
    #[default]
    Keep,
    /// It is subtracted, significant or not.
    Subtract,
    /// It is subtracted where it is significant.
    Auto,
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
    /// A drift over the cycles.
    pub drift: Drift,
    /// Outliers are found, named and left out.
    pub robust: bool,
    /// The full turn of a rotary axis, rad: readings over all of it give a curve that closes.
    pub turn: Option<f64>,
}
