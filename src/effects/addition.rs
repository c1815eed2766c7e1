//! `volcomp-addition/1`: the effects found, with everything that is needed to predict them.
//!
//! Only effects of kind `machine` change a prediction; those of the instrument and of chance stand in the file for the
//! simulator and for people. Lagged signals start in equilibrium with their first value.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::machine_state::{MachineState, Source};
use crate::{Follower, Signal};
use crate::{Kind, Shape, WIDTH_MAX};
use volcomp_model::geometry::Vec3;

/// The format's name.
pub const FORMAT: &str = "volcomp-addition/1";

/// A file of effects.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Addition {
    /// `volcomp-addition/1`.
    pub format: String,
    /// The machine of the model beside which it was found.
    pub machine: String,
    /// Sign: actual minus nominal of the tool against the workpiece, in machine axes.
    pub sense: String,
    /// The model beside which it was found; files of earlier versions do not name it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base: Option<Base>,
    /// The effects.
    #[serde(default, rename = "effect", skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<Entry>,
}

/// The model beside which an addition was found.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Base {
    /// Its file, as the user named it.
    pub file: String,
    /// BLAKE3 of its text, in hex: the hash that `volcomp status` shows of a model.
    pub hash: String,
}

/// One effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Entry {
    /// Name (`docs/reference/session-files.md` 4.1).
    pub name: String,
    /// Axis, pair or symbol; empty where it has none.
    pub subject: String,
    /// Who is to blame.
    pub kind: Kind,
    /// That it is this effect.
    pub probability: f64,
    /// What the data could not tell apart from it.
    pub confounded_with: Vec<String>,
    /// Names of the parameters, each with its unit.
    pub parameter_names: Vec<String>,
    /// Their values.
    pub values: Vec<f64>,
    /// Their covariance.
    pub covariance: Vec<Vec<f64>>,
    /// Ranges of the data, by column.
    pub valid: BTreeMap<String, [f64; 2]>,
    /// The formula.
    pub shape: Shape,
}

/// An addition beside the model of another machine.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}", foreign(.found, .expected))]
pub struct Foreign {
    found: String,
    expected: String,
}

fn foreign(found: &str, expected: &str) -> String {
    if found.is_empty() {
        return format!(
            "found without a model: what the model of '{expected}' corrects already would be corrected twice; diagnose again with \
             --model, or extend the ideal model.toml that the diagnosis wrote beside the addition"
        );
    }
    format!(
        "found on machine '{found}', the model is of '{expected}'; diagnose this machine with its own model (--model)"
    )
}

/// An addition beside a model that may hold it already.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Twice {
    /// It was found beside another model.
    #[error(
        "found with {} (hash {}), this model is another (hash {}): what was put into it since then would count twice",
        base.file, short(&base.hash), short(hash)
    )]
    OtherBase {
        /// The model beside which it was found.
        base: Base,
        /// Hash of the model to extend.
        hash: String,
    },
    /// The model has the same terms.
    #[error("the model holds the same already ({}): it would be corrected twice", effects.join(", "))]
    Held {
        /// Labels of the effects.
        effects: Vec<String>,
    },
}

/// The beginning of a hash, enough to tell two models.
fn short(hash: &str) -> &str {
    hash.get(..16).unwrap_or(hash)
}

/// An effect that cannot be evaluated.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum AdditionError {
    /// Not this format.
    #[error("format is '{found}', expected {FORMAT}")]
    Format {
        /// What stands there.
        found: String,
    },
    /// Values and formula do not belong together.
    #[error("effect {effect}: {found} values, the formula takes {expected}")]
    Width {
        /// The effect.
        effect: String,
        /// Number of values.
        found: usize,
        /// Number of parameters.
        expected: usize,
    },
    /// A number that is not finite or a length that is not positive.
    #[error("effect {effect}: {what}")]
    Value {
        /// The effect.
        effect: String,
        /// What is wrong.
        what: &'static str,
    },
    /// A column is missing.
    #[error("effect {effect} needs column {column}; add it to the points, or leave the addition out")]
    Column {
        /// The effect.
        effect: String,
        /// The column.
        column: String,
    },
}

impl Entry {
    /// `name:subject`.
    #[must_use]
    pub fn label(&self) -> String {
        if self.subject.is_empty() { self.name.clone() } else { format!("{}:{}", self.name, self.subject) }
    }

    /// Columns (`docs/reference/session-files.md` 1) that it needs beside the positions.
    #[must_use]
    pub fn columns(&self) -> Vec<String> {
        self.shape.form().columns()
    }

    /// A parameter's value; 0 where there is none.
    pub(crate) fn value(&self, k: usize) -> f64 {
        self.values.get(k).copied().unwrap_or(0.0)
    }

    fn check(&self) -> Result<(), AdditionError> {
        let expected = self.shape.width();
        if self.values.len() != expected || expected > WIDTH_MAX {
            let found = self.values.len();
            return Err(AdditionError::Width { effect: self.label(), found, expected });
        }
        let wrong = |what| Err(AdditionError::Value { effect: self.label(), what });
        if self.values.iter().any(|v| !v.is_finite()) {
            return wrong("a value is not finite");
        }
        if self.shape.fixed().iter().any(|(_, v)| !v.is_finite()) {
            return wrong("a constant of the formula is not finite");
        }
        if self.shape.form().is_valid() {
            Ok(())
        } else {
            wrong("a length or time of the formula is not above zero, or a place is not finite")
        }
    }
}

impl Addition {
    /// # Errors
    /// It was not found beside the model of `machine`; found beside none it is of no machine.
    pub fn is_of(&self, machine: &str) -> Result<(), Foreign> {
        if self.machine == machine {
            return Ok(());
        }
        Err(Foreign { found: self.machine.clone(), expected: machine.to_owned() })
    }

    /// # Errors
    /// It was found beside another model than the one whose text has this BLAKE3 (hex). A file that names no model passes.
    pub fn is_beside(&self, hash: &str) -> Result<(), Twice> {
        match &self.base {
            Some(base) if base.hash != hash => {
                Err(Twice::OtherBase { base: base.clone(), hash: hash.to_owned() })
            }
            _ => Ok(()),
        }
    }

    /// Reads an addition and refuses what cannot be evaluated.
    ///
    /// # Errors
    /// What is wrong, in words.
    pub fn parse(text: &str) -> Result<Self, String> {
        let addition: Self = toml::from_str(text).map_err(|e| e.to_string())?;
        addition.check().map_err(|e| e.to_string())?;
        Ok(addition)
    }

    /// Refuses what cannot be evaluated.
    ///
    /// # Errors
    /// Another format, values that do not fit the formula, numbers that are not finite.
    pub fn check(&self) -> Result<(), AdditionError> {
        if self.format != FORMAT {
            return Err(AdditionError::Format { found: self.format.clone() });
        }
        self.effects.iter().try_for_each(Entry::check)
    }

    /// The effects that change a prediction.
    pub fn machine_effects(&self) -> impl Iterator<Item = &Entry> {
        self.effects.iter().filter(|e| e.kind == Kind::Machine)
    }

    /// The first column that an effect of the machine needs and `has` does not know.
    ///
    /// # Errors
    /// Names effect and column.
    pub fn require(&self, has: &dyn Fn(&str) -> bool) -> Result<(), AdditionError> {
        for entry in self.machine_effects() {
            let lags = entry.shape.signals().iter().any(|s| s.looks_back()).then(|| "t_s".to_owned());
            for column in entry.columns().into_iter().chain(lags) {
                if !has(&column) {
                    return Err(AdditionError::Column { effect: entry.label(), column });
                }
            }
        }
        Ok(())
    }
}

/// Evaluates the effects of the machine of some additions, row after row.
#[derive(Debug, Clone)]
pub struct Evaluator {
    entries: Vec<Entry>,
    signals: Vec<Signal>,
    /// Each of them at the row before.
    followers: Vec<Follower>,
}

impl Evaluator {
    /// An evaluator that has seen no row.
    #[must_use]
    pub fn new<'a>(additions: impl IntoIterator<Item = &'a Addition>) -> Self {
        let entries: Vec<Entry> =
            additions.into_iter().flat_map(Addition::machine_effects).cloned().collect();
        let mut signals: Vec<Signal> = Vec::new();
        for s in entries.iter().flat_map(|e| e.shape.signals()) {
            if !signals.contains(s) {
                signals.push(s.clone());
            }
        }
        let followers = signals.iter().cloned().map(Follower::new).collect();
        Self { entries, signals, followers }
    }

    /// The sources whose values [`Evaluator::next`] takes, in order.
    #[must_use]
    pub fn sources(&self) -> Vec<Source> {
        self.signals.iter().map(|s| s.source.clone()).collect()
    }

    /// The deviation at the next row, um in machine axes; `sources` in the order of [`Evaluator::sources`] (speeds of
    /// the spindle in 1000 per minute).
    pub fn next(&mut self, moment: &mut MachineState, sources: &[f64]) -> Vec3 {
        moment.signals.clear();
        for (follower, now) in self.followers.iter_mut().zip(sources) {
            follower.push(moment.t_s, *now);
            moment.signals.push(follower.at(moment.t_s, *now));
        }
        self.at(moment)
    }

    /// The first effect that has no value at a moment, and a column that it lacks there; none where all have one.
    #[must_use]
    pub fn lacks(&self, moment: &MachineState) -> Option<AdditionError> {
        let place = |s: &Signal| self.signals.iter().position(|o| o == s);
        self.entries
            .iter()
            .find(|e| !e.shape.is_known_at(moment, &place))
            .map(|e| AdditionError::Column { effect: e.label(), column: e.columns().join(", ") })
    }

    /// The deviation at a moment whose signals are filled in.
    #[must_use]
    pub fn at(&self, moment: &MachineState) -> Vec3 {
        let mut out = [Vec3::zeros(); WIDTH_MAX];
        let place = |s: &Signal| self.signals.iter().position(|o| o == s);
        let mut sum = Vec3::zeros();
        for e in &self.entries {
            let k = e.shape.width();
            out[..k].fill(Vec3::zeros());
            e.shape.evaluate_with(moment, &place, &mut out[..k]);
            for (d, v) in out[..k].iter().zip(&e.values) {
                sum += d * *v;
            }
        }
        sum
    }
}
