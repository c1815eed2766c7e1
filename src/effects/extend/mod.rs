//! An addition as part of a model, so that a daemon can take out what a diagnosis has found.
//!
//! What follows from position and direction of travel becomes a table or a constant of the error motion that acts alike;
//! what follows from the motion of an axis becomes a dynamic term of it; what follows from the length of the tool stands
//! with the tool; what follows from heat becomes a thermal displacement. The rest stays out, each with the reason. The model is
//! compared with the addition all over the volume, and what does not say the same there stays out, too.

mod curves;
mod heat;
mod held;
mod proof;
mod terms;

use core::fmt;

use crate::Kind;
use crate::addition::{Addition, Entry, Twice};
use crate::machine_state::Axis;
use volcomp_estimate::Thermal;
use volcomp_model::curve::Live;
use volcomp_model::{
    Component, Curve, DynamicTerm, ErrorFunction, ErrorSymbol, Model, ModelError, ModelSpec, ToolErrors,
};

pub(crate) use curves::{Sampling, bending, displacements, rotation};
pub(crate) use heat::{expansion, growth};
pub(crate) use terms::{Term, acceleration_term, fastest, steepest, terms, tool};

/// A model with an addition in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Extended {
    /// The model.
    pub spec: ModelSpec,
    /// Its thermal displacements, those that it had first.
    pub thermal: Vec<Thermal>,
    /// What became of each effect, in the order of the addition: its label and its fate.
    pub fates: Vec<(String, Fate)>,
}

/// What became of an effect.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Fate {
    /// It is in the model, by these symbols, or as `tool`.
    Taken(Vec<String>),
    /// It is not, for this reason.
    Left(&'static str),
}

/// Why an effect stays out of a model that has its terms.
const HELD: &str = "the model has the same terms already";

impl Extended {
    /// # Errors
    /// The model had the terms of some effect already.
    pub fn is_new(&self) -> Result<(), Twice> {
        let held = self.fates.iter().filter(|(_, fate)| *fate == Fate::Left(HELD));
        let effects: Vec<String> = held.map(|(label, _)| label.clone()).collect();
        if effects.is_empty() { Ok(()) } else { Err(Twice::Held { effects }) }
    }
}

impl Fate {
    /// True where the model holds it.
    #[must_use]
    pub const fn is_taken(&self) -> bool {
        matches!(self, Self::Taken(_))
    }

    /// Names of the symbols that hold it, each once; none where it is not in the model.
    #[must_use]
    pub fn symbols(&self) -> Vec<String> {
        let Self::Taken(symbols) = self else { return Vec::new() };
        let mut names = symbols.clone();
        names.dedup();
        names
    }
}

/// One symbol of an effect: what is added to it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Part {
    symbol: ErrorSymbol,
    curve: Option<Curve>,
    live: Option<Live>,
    dynamic: Option<DynamicTerm>,
}

impl Part {
    /// A constant of a symbol, mm or rad.
    pub(crate) const fn constant(symbol: ErrorSymbol, value: f64) -> Self {
        Self { symbol, curve: Some(Curve::Constant(value)), live: None, dynamic: None }
    }
}

/// What an effect becomes; the sign of each part is found by the proof.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Candidate {
    parts: Vec<Part>,
    /// The thermal displacements that feed the live values of the parts.
    thermal: Vec<Thermal>,
    /// What is wrong with tool and spindle.
    tool: Option<ToolErrors>,
}

/// What an effect becomes in a model, or why it stays out.
pub(crate) type Becomes = Result<Candidate, &'static str>;

/// Why an effect of an instrument stays out of a model.
pub(crate) const OF_THE_INSTRUMENT: &str = "it belongs to the instrument, not to the machine";

impl From<Vec<Part>> for Candidate {
    fn from(parts: Vec<Part>) -> Self {
        Self { parts, ..Self::default() }
    }
}

/// The displacement of an axis in a direction.
pub(crate) const fn shift(along: Axis, axis: Axis) -> ErrorSymbol {
    ErrorSymbol::Motion { component: Component::ALL[along.direction()], axis: axis.name() }
}

/// The turn of an axis about a direction.
pub(crate) const fn turn(about: Axis, axis: Axis) -> ErrorSymbol {
    ErrorSymbol::Motion { component: Component::ALL[3 + about.direction()], axis: axis.name() }
}

impl Candidate {
    /// The same with a sign for each part; `None` where a part has no opposite.
    fn signed(&self, signs: &[f64]) -> Option<Self> {
        let mut out = self.clone();
        for (part, sign) in out.parts.iter_mut().zip(signs) {
            if let Some(curve) = &mut part.curve {
                *curve = curves::scaled(curve, *sign)?;
            }
            if let Some(term) = &mut part.dynamic {
                term.gain *= sign;
            }
            let told = |t: &&mut Thermal| part.live.as_ref().is_some_and(|live| live.sensor == t.name);
            for input in out.thermal.iter_mut().filter(told).flat_map(|t| &mut t.inputs) {
                input.coefficients.iter_mut().for_each(|c| *c *= sign);
            }
        }
        Some(out)
    }

    /// A model with it.
    fn added_to(&self, spec: &ModelSpec) -> ModelSpec {
        let mut spec = spec.clone();
        for part in &self.parts {
            let function = spec.error_mut(part.symbol);
            match &part.curve {
                Some(Curve::Constant(value)) => add_constant(function, *value),
                Some(curve) => function.curves.push(curve.clone()),
                None => {}
            }
            function.live.extend(part.live.clone());
            function.dynamics.extend(part.dynamic);
        }
        if let Some(errors) = self.tool {
            spec.tool.length += errors.length;
            spec.tool.tilt.iter_mut().zip(errors.tilt).for_each(|(sum, v)| *sum += v);
        }
        spec
    }
}

impl fmt::Display for Fate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Taken(_) => write!(f, "in the model, {}", self.symbols().join(" ")),
            Self::Left(why) => write!(f, "not in the model: {why}"),
        }
    }
}

/// Puts the effects of a machine into its model.
///
/// # Errors
/// The model breaks a rule, before or after.
pub fn extend(spec: &ModelSpec, thermal: &[Thermal], addition: &Addition) -> Result<Extended, ModelError> {
    Model::new(spec)?;
    let mut out = Extended { spec: spec.clone(), thermal: thermal.to_vec(), fates: Vec::new() };
    for entry in &addition.effects {
        let fate = match candidate(&out, entry) {
            Err(why) => Fate::Left(why),
            Ok(candidate) => match proof::signed(&out.spec, entry, &candidate)? {
                None => Fate::Left("the chain of this model has no error motion that acts the same way"),
                Some(candidate) if held::is_held(&candidate, spec, thermal) => Fate::Left(HELD),
                Some(candidate) => {
                    out.spec = candidate.added_to(&out.spec);
                    out.thermal.extend(candidate.thermal);
                    let tool = candidate.tool.map(|_| "tool".to_owned());
                    Fate::Taken(candidate.parts.iter().map(|p| p.symbol.to_string()).chain(tool).collect())
                }
            },
        };
        out.fates.push((entry.label(), fate));
    }
    Ok(out)
}

fn candidate(model: &Extended, entry: &Entry) -> Becomes {
    match entry.kind {
        Kind::Instrument => Err(OF_THE_INSTRUMENT),
        Kind::Stochastic => Err("it is chance: no correction takes it out"),
        Kind::Machine => entry.shape.form().becomes(model, entry),
    }
}

/// One constant per symbol is easier to read than two.
fn add_constant(function: &mut ErrorFunction, value: f64) {
    for curve in &mut function.curves {
        if let Curve::Constant(before) = curve {
            *before += value;
            return;
        }
    }
    function.curves.push(Curve::Constant(value));
}
