//! A chain identified axis by axis: each axis is corrected before the next one is measured.
//!
//! Made for the gear grinder of 001 (A turns the workpiece, B swivels the probe, X and Y carry the head, in the order
//! A, B, X, Y), right for any chain. One file per step: deviations of the tool tip relative to the workpiece, seen
//! with several tips (or probe styli) while the axis of the step goes through its positions. Three tips that do not
//! lie on a line give all six error motions of a position; one positioning value per position, as 001 measured, gives
//! one (equations 4.1, (18) to (21): rank 1 of 6).
//!
//! `deviation = axis of this step + set-up + [axes before: true - corrected] + noise`
//! - axis of this step: six motions per position, zero at the reference position (equations 1.8), by least squares;
//! - set-up: the artefact lies in W shifted and turned by an unknown rigid amount, one per file;
//! - axes before: what their model predicts plus what the corrections in force did is subtracted; what the model does
//!   not know of them stays in and is this step's inherited uncertainty;
//! - axes after: must stand still, because nobody knows their errors yet.
//!
//! What a step cannot explain is tested against what noise and the steps before let expect. Where it is more, readings or steps
//! contradict each other: the uncertainties of the step, and of the axes before that moved in it, are enlarged by the factor.
//!
//! A rotary axis' location errors are the part of its deviations that turns with it (its average line); the motions
//! keep the rest. Uncertainties of all steps are carried as one covariance with all correlations.
//!
//! Assumptions: first order; between positions straight lines or a fitted curve; noise independent and equal; tips known.
//! Source: equations 2, 2.3, 4.1, 5.1. Reading order: this file, `effects`, `step`, `plan`.

mod effects;
mod plan;
mod step;

pub use plan::{Planned, plan};

use crate::prelude::*;

use volcomp_model::ModelError;
use volcomp_model::curve::CurveError;
use volcomp_units::axes::AxisArray;

use crate::curve::{self, CurveFit, FitError};

/// A measured point. Lengths mm, angles rad; axes in chain order.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Programmed coordinates, without corrections.
    pub position: AxisArray,
    /// What was added to them.
    pub correction: AxisArray,
    /// Tool tip in M at home.
    pub tip: Vec3,
    /// Actual minus nominal position of the tip relative to the workpiece, in W; `None` where not measured.
    pub deviation: [Option<f64>; 3],
}

/// What was measured of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// The axis.
    pub axis: AxisName,
    /// The readings.
    pub rows: Vec<Row>,
}

/// What is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// Error motions to find; the others are taken for zero.
    pub components: Vec<Component>,
    /// Noise of a reading, mm, where known.
    pub sigma: Option<f64>,
    /// How the values found at the positions become curves.
    pub curves: Curves,
}

impl Default for Request {
    fn default() -> Self {
        Self { components: Component::ALL.to_vec(), sigma: None, curves: Curves::Lines }
    }
}

/// How the values found at the positions become curves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Curves {
    /// Straight lines between them: their noise stays.
    Lines,
    /// The curve that [`curve::fit`] chooses, zero at the reference position: noise averages over the positions.
    Fitted,
}

/// Uncertainty of one kind of number, k = 1: mm or rad.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Shares {
    /// From the readings of the step itself.
    pub own: f64,
    /// From what the steps before left uncertain.
    pub inherited: f64,
}

/// One error motion found.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// Its symbol.
    pub symbol: ErrorSymbol,
    /// Values at the positions of the step, mm or rad, in the sense of the axis.
    pub values: Vec<f64>,
    /// Uncertainty of each.
    pub std: Vec<Shares>,
    /// What a fitted curve leaves of these.
    pub(super) smoothing: Smoothed,
}

/// What a fitted curve leaves of the uncertainty of single positions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Smoothed {
    /// RMS standard deviation of the curve over that of a value.
    pub(super) share: f64,
    /// Standard deviation of what the curve misses, mm or rad.
    pub(super) lack_of_fit: f64,
}

impl Smoothed {
    /// Straight lines between the positions leave all of it.
    pub(super) const NONE: Self = Self { share: 1.0, lack_of_fit: 0.0 };
}

/// How the artefact's set-up was treated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SetUp {
    /// Unknown shift and turn.
    Rigid,
    /// Unknown shift; its turn is taken for zero because the readings at the reference position cannot show it.
    ShiftOnly,
}

/// The test of what a step cannot explain against what was expected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Consistency {
    /// Probability that noise and what the steps before left uncertain exceed it.
    pub p_value: f64,
    /// Root mean square over the expected one.
    pub factor: f64,
    /// By what the uncertainties were enlarged; 1 where the test is passed.
    pub enlarged: f64,
}

/// A reading that does not fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Worst {
    /// Index of the row.
    pub row: usize,
    /// Direction in W: 0, 1, 2 for X, Y, Z.
    pub direction: usize,
    /// Measured minus explained, mm.
    pub residual: f64,
}

/// What one step found.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// The axis.
    pub axis: AxisName,
    /// Programmed coordinates, increasing.
    pub positions: Vec<f64>,
    /// Index of the position at which all motions are zero.
    pub reference: usize,
    /// The motions.
    pub motions: Vec<Motion>,
    /// Location errors of a rotary axis with their standard deviation.
    pub locations: Vec<(ErrorSymbol, f64, f64)>,
    /// Set-up of the artefact.
    pub set_up: SetUp,
    /// Single values measured.
    pub readings: usize,
    /// Readings minus unknowns.
    pub dof: usize,
    /// Root mean square of what the step cannot explain, mm.
    pub rms: f64,
    /// What that should be from the noise and from what the steps before left uncertain.
    pub expected_rms: Option<f64>,
    /// Noise of a reading: stated, else from the rigidity of the tips; `None` without redundancy.
    pub sigma: Option<f64>,
    /// Rigidity: probability that the tips of a pose disagree as they do with the stated noise.
    pub p_value: Option<f64>,
    /// Whether the readings agree with the noise and with the steps before; `None` where nothing tells.
    pub consistency: Option<Consistency>,
    /// The reading that the step explains least.
    pub worst: Worst,
    /// Uncertainty of the tip that comes from this axis alone, root mean square over its positions.
    pub tip: Shares,
    /// Uncertainty of the tip from all axes found so far, over the poses of this step.
    pub chain: f64,
    /// Condition number of the worst position's design, angles counted as lengths at the tips' spread.
    pub condition: f64,
}

/// A chain identified so far.
#[derive(Debug, Clone)]
pub struct Chain {
    spec: ModelSpec,
    steps: Vec<Found>,
    /// Covariance of all motions at all positions but the reference ones, in the order of the steps.
    covariance: DMatrix<f64>,
}

/// Why a step cannot be identified.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GrinderError {
    /// The axis is not there.
    #[error("axis {axis} is not in the chain")]
    NotInChain {
        /// The axis.
        axis: AxisName,
    },
    /// The axis was identified before.
    #[error("axis {axis} was identified in a step before; every axis has one step")]
    Twice {
        /// The axis.
        axis: AxisName,
    },
    /// An axis moves whose errors are unknown.
    #[error(
        "axis {moving} moves by {by:.3} {unit} in the step of axis {axis}, but is not identified yet: hold it still, or measure axis {moving} first"
    )]
    MovesTooEarly {
        /// The axis of the step.
        axis: AxisName,
        /// The axis that moves.
        moving: AxisName,
        /// By how much, mm or deg.
        by: f64,
        /// Unit of `by`.
        unit: &'static str,
    },
    /// Too few positions.
    #[error("axis {axis} stands at {found} position(s); at least 2 are needed")]
    TooFewPositions {
        /// The axis.
        axis: AxisName,
        /// Distinct positions.
        found: usize,
    },
    /// Nothing asked for.
    #[error("no error motion of axis {axis} is asked for")]
    NoComponent {
        /// The axis.
        axis: AxisName,
    },
    /// The tips of a position do not determine the motions.
    #[error(
        "axis {axis} at {position:.3}: the readings determine {rank} of {unknowns} error motions (condition {condition:.1e}, limit {limit:.0e}); measure with three tips that do not lie on a line, or ask for fewer motions"
    )]
    Undetermined {
        /// The axis.
        axis: AxisName,
        /// Its coordinate, mm or deg.
        position: f64,
        /// What the readings determine.
        rank: usize,
        /// What is asked for.
        unknowns: usize,
        /// Condition number, angles counted as lengths at the tips' spread.
        condition: f64,
        /// Largest condition number accepted.
        limit: f64,
    },
    /// Nothing says where the artefact lies.
    #[error(
        "axis {axis}: {missing} not measured at the reference position {position:.3}, so the position of the artefact in that direction is unknown; measure it there"
    )]
    NoReference {
        /// The axis.
        axis: AxisName,
        /// The directions.
        missing: &'static str,
        /// The reference position, mm or deg.
        position: f64,
    },
    /// Travel is needed to plan.
    #[error("axis {axis} has no travel in the model; without it no positions can be planned")]
    NoTravel {
        /// The axis.
        axis: AxisName,
    },
    /// The model breaks a rule.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The table of a motion breaks a rule.
    #[error(transparent)]
    Curve(#[from] CurveError),
    /// No curve fits the values of a motion.
    #[error("{symbol}: {source}")]
    Fit {
        /// The motion.
        symbol: ErrorSymbol,
        /// Why.
        source: FitError,
    },
}

impl Chain {
    /// A chain before its first step: geometry, and errors that are taken as known exactly.
    #[must_use]
    pub fn new(spec: ModelSpec) -> Self {
        Self { spec, steps: Vec::new(), covariance: DMatrix::zeros(0, 0) }
    }

    /// The model with what was found so far.
    #[must_use]
    pub const fn spec(&self) -> &ModelSpec {
        &self.spec
    }

    /// The steps so far.
    #[must_use]
    pub fn steps(&self) -> &[Found] {
        &self.steps
    }

    /// Identifies the next axis.
    ///
    /// # Errors
    /// Axes that move too early, positions whose readings do not determine the motions, a model that breaks a rule.
    pub fn identify(&mut self, measured: &Measured, request: &Request) -> Result<&Found, GrinderError> {
        let solved = step::solve(self, measured, request)?;
        self.spec = solved.spec;
        for (step, factor) in self.steps.iter_mut().zip(&solved.enlarged) {
            step.enlarge(*factor);
            for motion in &step.motions {
                put_std(
                    &mut self.spec,
                    motion.symbol,
                    motion.std_of_curve().filter(|_| step.sigma.is_some()),
                );
            }
            for (symbol, _, std) in &step.locations {
                put_std(&mut self.spec, *symbol, step.sigma.map(|_| *std));
            }
        }
        self.covariance = solved.covariance;
        self.steps.push(solved.found);
        Ok(&self.steps[self.steps.len() - 1])
    }
}

/// The curves of the motions found, in the sense of the axis, and the locations.
fn write_into(spec: &mut ModelSpec, found: &mut Found, how: Curves) -> Result<(), GrinderError> {
    let mirrored = spec.is_mirrored(found.axis);
    let stored = |q: f64| if mirrored { -q } else { q };
    for motion in &mut found.motions {
        let mut support: Vec<(f64, f64)> =
            found.positions.iter().map(|q| stored(*q)).zip(motion.values.iter().copied()).collect();
        support.sort_by(|a, b| a.0.total_cmp(&b.0));
        let curves = match how {
            Curves::Lines => {
                let (positions, values) = support.into_iter().unzip();
                vec![Curve::Table(Table::new(positions, values, None, Interpolation::Linear)?)]
            }
            Curves::Fitted => {
                let fit = fitted(&support, motion.symbol)?;
                motion.smoothing = smoothed(&fit, &support, motion.own());
                let zero = fit.value(stored(found.positions[found.reference]), Travel::Forward);
                core::iter::once(fit.curve).chain(fit.more).chain([Curve::Constant(-zero)]).collect()
            }
        };
        // a rotary axis is in the same pose at every turn
        let travel = spec.axis(found.axis).travel.filter(|_| found.axis.kind() == AxisKind::Rotary);
        let curves = match travel.map(|[low, high]| if mirrored { [-high, -low] } else { [low, high] }) {
            Some(travel) => curve::repeated(&curves, core::f64::consts::TAU, travel)?.unwrap_or(curves),
            None => curves,
        };
        let std = motion.std_of_curve().filter(|_| found.sigma.is_some());
        put(spec, motion.symbol, ErrorFunction { std, curves, ..ErrorFunction::default() });
    }
    for (symbol, value, std) in &found.locations {
        let std = found.sigma.map(|_| *std);
        put(spec, *symbol, ErrorFunction { std, ..ErrorFunction::single(Curve::Constant(*value)) });
    }
    Ok(())
}

/// Curve through values at positions.
fn fitted(support: &[(f64, f64)], symbol: ErrorSymbol) -> Result<CurveFit, GrinderError> {
    let readings: Vec<Reading> = support
        .iter()
        .map(|&(position, value)| Reading { cycle: 0, travel: Travel::Forward, position, value })
        .collect();
    let turn = (symbol.axis().kind() == AxisKind::Rotary).then_some(core::f64::consts::TAU);
    curve::fit(&readings, &curve::Request { turn, ..curve::Request::default() })
        .map_err(|source| GrinderError::Fit { symbol, source })
}

/// How much the curve averages the noise of the values, and what it misses of them.
fn smoothed(fit: &CurveFit, support: &[(f64, f64)], own: f64) -> Smoothed {
    let Some(band) = fit.band.as_ref().filter(|b| b.sigma() > 0.0) else { return Smoothed::NONE };
    let relative = |(x, _): &(f64, f64)| (band.std_at(*x, Travel::Forward) / band.sigma()).powi(2);
    let mean = support.iter().map(relative).sum::<f64>() / support.len() as f64;
    // the noise of the values is known: the rest of the residuals is what the curve misses
    let lack_of_fit = (band.sigma().powi(2) - own * own).max(0.0).sqrt();
    Smoothed { share: mean.sqrt().min(1.0), lack_of_fit }
}

fn put(spec: &mut ModelSpec, symbol: ErrorSymbol, function: ErrorFunction) {
    spec.errors.retain(|(s, _)| *s != symbol);
    spec.errors.push((symbol, function));
    spec.errors.sort_by_key(|(s, _)| *s);
}

/// Changes the uncertainty of an error that is there.
fn put_std(spec: &mut ModelSpec, symbol: ErrorSymbol, std: Option<f64>) {
    if let Some((_, function)) = spec.errors.iter_mut().find(|(s, _)| *s == symbol) {
        function.std = std;
    }
}

impl Motion {
    /// Root mean square of the uncertainties from the readings of the step itself.
    fn own(&self) -> f64 {
        (self.std.iter().map(|s| s.own * s.own).sum::<f64>() / self.std.len().max(1) as f64).sqrt()
    }

    /// Standard uncertainty of the curve: root mean square over the positions. A fitted curve averages the noise of the step itself;
    /// what the steps before left uncertain is common to all positions.
    fn std_of_curve(&self) -> Option<f64> {
        let Smoothed { share, lack_of_fit } = self.smoothing;
        let square = |s: &Shares| (share * s.own).powi(2) + s.inherited.powi(2);
        let squares = self.std.iter().map(square).sum::<f64>();
        (!self.std.is_empty()).then(|| (squares / self.std.len() as f64).sqrt().hypot(lack_of_fit))
    }
}

impl Found {
    /// Enlarges what is said to be uncertain.
    fn enlarge(&mut self, factor: f64) {
        let by = |s: &mut Shares| {
            s.own *= factor;
            s.inherited *= factor;
        };
        self.motions.iter_mut().flat_map(|m| &mut m.std).for_each(by);
        self.locations.iter_mut().for_each(|l| l.2 *= factor);
        by(&mut self.tip);
        self.chain *= factor;
    }
}

impl Shares {
    /// Both together.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.own.hypot(self.inherited)
    }
}

#[cfg(test)]
mod tests;
