//! An addition as part of a model, so that a daemon can take out what a diagnosis has found.
//!
//! What follows from position and direction of travel becomes a table or a constant of the error motion that acts alike;
//! what follows from heat becomes a thermal displacement. The rest stays out, each with the reason. Nothing is trusted: the model is
//! compared with the addition all over the volume, and what does not say the same there stays out, too.

mod heat;
mod parts;
mod proof;

use core::fmt;

use crate::Shape;
use crate::addition::{Addition, Entry};
use volcomp_estimate::Thermal;
use volcomp_model::curve::Live;
use volcomp_model::{Curve, ErrorFunction, ErrorSymbol, Model, ModelError, ModelSpec};

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
    /// It is in the model, by these symbols.
    Taken(Vec<ErrorSymbol>),
    /// It is not, for this reason.
    Left(&'static str),
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
        let mut names: Vec<String> = symbols.iter().map(ToString::to_string).collect();
        names.dedup();
        names
    }
}

/// One symbol of an effect: what is added to it.
#[derive(Debug, Clone, PartialEq)]
struct Part {
    symbol: ErrorSymbol,
    curve: Option<Curve>,
    live: Option<Live>,
}

/// What an effect becomes; the sign of each part is found by the proof.
#[derive(Debug, Clone, PartialEq, Default)]
struct Candidate {
    parts: Vec<Part>,
    /// The thermal displacements that the live values of the parts are told by.
    thermal: Vec<Thermal>,
}

impl Candidate {
    /// The same with a sign for each part; `None` where a part has no opposite.
    fn signed(&self, signs: &[f64]) -> Option<Self> {
        let mut out = self.clone();
        for (part, sign) in out.parts.iter_mut().zip(signs) {
            if let Some(curve) = &mut part.curve {
                *curve = parts::scaled(curve, *sign)?;
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
            if !spec.errors.iter().any(|(s, _)| *s == part.symbol) {
                spec.errors.push((part.symbol, ErrorFunction::default()));
                spec.errors.sort_by_key(|(symbol, _)| *symbol);
            }
            for (_, function) in spec.errors.iter_mut().filter(|(s, _)| *s == part.symbol) {
                match &part.curve {
                    Some(Curve::Constant(value)) => add_constant(function, *value),
                    Some(curve) => function.curves.push(curve.clone()),
                    None => {}
                }
                function.live.extend(part.live.clone());
            }
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
                Some(candidate) => {
                    out.spec = candidate.added_to(&out.spec);
                    out.thermal.extend(candidate.thermal);
                    Fate::Taken(candidate.parts.iter().map(|p| p.symbol).collect())
                }
            },
        };
        out.fates.push((entry.label(), fate));
    }
    Ok(out)
}

fn candidate(model: &Extended, entry: &Entry) -> Result<Candidate, &'static str> {
    if let Some(why) = reason_against(entry) {
        return Err(why);
    }
    match &entry.shape {
        Shape::Thermal { .. } | Shape::Growth { .. } => heat::candidate(model, entry),
        _ => parts::candidate(&model.spec, entry),
    }
}

/// Why an effect can be no part of a model, whatever its chain.
fn reason_against(entry: &Entry) -> Option<&'static str> {
    use crate::Kind;
    match entry.kind {
        Kind::Instrument => return Some("it belongs to the instrument, not to the machine"),
        Kind::Stochastic => return Some("it is chance: no correction takes it out"),
        Kind::Machine => {}
    }
    match &entry.shape {
        Shape::Lag { .. } | Shape::RotaryLag { .. } => Some(
            "it follows the speed: the control's feed-forward takes it out, or the delay of the recording is its cause",
        ),
        Shape::Inertial { .. } | Shape::InertialTilt { .. } => {
            Some("it follows the acceleration, which the control does not tell")
        }
        Shape::Friction { .. } | Shape::Spike { .. } => {
            Some("it lasts milliseconds after a reversal: the control's friction compensation takes it out")
        }
        Shape::Backlash { length_mm, .. } if *length_mm > 0.0 => {
            Some("it builds up over a distance after the reversal; a model knows play that is there at once")
        }
        Shape::SpindleTilt | Shape::ToolLength | Shape::Sag { tool: true, .. } => {
            Some("it follows the length of the tool, over which a model has no curve")
        }
        Shape::Load { .. } => Some("it follows forces, which nobody tells while the machine works"),
        Shape::Step { .. } => Some("it is a step in the time of one recording"),
        Shape::DeadPath { .. } | Shape::TrackerScale { .. } | Shape::ClockSkew { .. } => {
            Some("it belongs to the instrument, not to the machine")
        }
        _ => None,
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
