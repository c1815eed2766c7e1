//! What has come of a fit.

use crate::prelude::*;
use volcomp_model::curve::ErrorFunction;

use super::band::Band;
use super::cycle_drift::CycleDrift;
use super::figures::Figures;
use super::request::Basis;

/// A reading that was left out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outlier {
    /// Index among the readings given.
    pub index: usize,
    /// Reading minus curve, mm or rad.
    pub deviation: f64,
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
    /// The readings drift over the cycles: part of the difference of the directions is drift, or was until it was subtracted.
    Drift(CycleDrift),
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

/// Mean difference of the directions of travel, forward minus reverse, mm or rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanReversal {
    /// The mean over the positions that have both directions.
    pub value: f64,
    /// Its standard uncertainty (k = 1): scatter, offsets of the cycles, what a subtracted drift leaves; `None` where nothing repeats.
    pub std: Option<f64>,
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
    /// Standard deviation of what the curve misses of the error beyond the noise, mm or rad.
    pub lack_of_fit: f64,
    /// Mean of forward minus reverse over the positions that have both.
    pub mean_reversal: Option<MeanReversal>,
    /// A drift over the cycles that is significant or was subtracted.
    pub drift: Option<CycleDrift>,
    /// What the user should know.
    pub notes: Vec<Note>,
}

impl CurveFit {
    /// A fit with everything else absent; `curves` is not empty.
    pub(super) fn new(basis: Basis, coefficients: Vec<f64>, curves: Vec<Curve>, figures: Figures) -> Self {
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
            lack_of_fit: 0.0,
            mean_reversal: None,
            drift: None,
            notes: Vec::new(),
        }
    }

    /// The value at `position`, travelling in direction `travel`.
    #[must_use]
    pub fn value(&self, position: f64, travel: Travel) -> f64 {
        self.curve.value(position, travel) + self.more.iter().map(|c| c.value(position, travel)).sum::<f64>()
    }

    /// The error function of a model with the standard uncertainty of the curve.
    #[must_use]
    pub fn function(&self) -> ErrorFunction {
        let curves = core::iter::once(&self.curve).chain(&self.more).cloned().collect();
        ErrorFunction { curves, std: self.standard_uncertainty(), ..ErrorFunction::default() }
    }
}
