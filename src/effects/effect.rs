//! What is known of an effect, and its name with the axis, pair or symbol that has it.

use core::fmt;

use serde::{Deserialize, Serialize};

use crate::data::{Data, Variants};
use crate::library::EFFECTS;
use crate::machine_state::Axis;

/// Who is to blame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// The machine: simulator and compensator.
    Machine,
    /// The measurement: never the compensator.
    Instrument,
    /// Not repeatable: simulator only.
    Stochastic,
}

/// A measurement that changes the size of some effects and leaves that of others, which tells them apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Measurement {
    /// Circles in every plane, both ways, at two feeds.
    Circles,
    /// An axis from point to point with dwells, to and fro.
    Points,
    /// The same with uneven steps shorter than a period of the screw.
    FineSteps,
    /// The same at a second place of the other axes.
    SecondPlace,
    /// The same cold and warm.
    ColdAndWarm,
    /// The same with two tools.
    TwoTools,
    /// Spindle on, off and on.
    Spindle,
    /// Moves with a clear beginning and end.
    StartAndStop,
    /// The same line, the instrument elsewhere.
    SecondInstrument,
    /// A rotary axis in uneven steps.
    Turn,
    /// A line from one end of the travel to the other.
    WholeTravel,
}

/// A measurement procedure.
#[derive(Debug)]
pub struct Procedure {
    /// What it measures.
    pub motion: Measurement,
    /// What is to be done, in the imperative.
    pub action: &'static str,
    /// Preparation by somebody who has done it before: mounting, alignment, warm-up, min.
    pub prepare_min: f64,
}

/// An effect: everything about it but the formulas of its variants, which stand beside it in [`crate::library`].
#[derive(Debug)]
pub struct Effect {
    /// Name in reports.
    pub name: &'static str,
    /// Name in sentences; `{}` is its subject.
    pub title: &'static str,
    /// Other names for it.
    pub synonyms: &'static str,
    /// Who is to blame.
    pub kind: Kind,
    /// Which subjects it can have.
    pub subjects: Subjects,
    /// What causes it.
    pub cause: &'static str,
    /// The formula.
    pub formula: &'static str,
    /// What it looks like.
    pub looks_like: &'static str,
    /// With what it is confused.
    pub confused_with: &'static str,
    /// Which measurement settles it.
    pub settles: &'static str,
    /// Measurements that change its size.
    pub changes_with: &'static [Measurement],
    /// What removes or reduces it.
    pub remedy: &'static str,
    /// Its variants for the data of a session, or why these data cannot show it; no variants and no reason where the effect has
    /// none there that anybody would look for.
    pub variants: fn(&Data, &Subject) -> Variants,
}

impl Effect {
    /// The effect of a name or a synonym.
    #[must_use]
    pub fn find(name: &str) -> Option<&'static Self> {
        let all = || EFFECTS.iter().copied();
        all().find(|e| e.name == name).or_else(|| all().find(|e| e.synonyms.split(' ').any(|s| s == name)))
    }
}

/// Which subjects an effect can have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Subjects {
    /// The machine or the instrument as a whole.
    Whole,
    /// Pairs of linear axes.
    Pairs,
    /// Linear axes.
    Linear,
    /// Rotary axes.
    Rotary,
    /// Linear and rotary axes.
    Axes,
    /// Symbols of straightness errors.
    Straightness,
    /// Symbols of angular errors.
    Angular,
}

/// One of the subjects of an effect.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Subject {
    /// As it stands behind the colon in reports; empty for the whole.
    pub name: String,
    /// The axis itself; of a pair its first axis, of an error symbol the direction along or about which it acts.
    pub first: Axis,
    /// The axis itself; of a pair its second axis, of an error symbol the axis that has the error.
    pub axis: Axis,
}

impl Subjects {
    /// What stands behind the colon in reports, in words; empty for the whole.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Whole => "",
            Self::Pairs => "axis pair",
            Self::Linear | Self::Axes => "axis",
            Self::Rotary => "rotary axis",
            Self::Straightness | Self::Angular => "error symbol",
        }
    }

    /// All of them; one without a name for the whole.
    #[must_use]
    pub fn all(self) -> Vec<Subject> {
        use Axis::{A, B, C, X, Y, Z};
        let subject = |name: String, first, axis| Subject { name, first, axis };
        let axes = |all: &[Axis]| all.iter().map(|a| subject(a.to_string(), *a, *a)).collect();
        // straightness is across the axis, an angular error about any of the three
        let symbols = |directions: [Axis; 3], across: bool| {
            let of = |axis: Axis| directions.map(|d| subject(format!("e{d}{axis}"), d, axis));
            Axis::LINEAR.into_iter().flat_map(of).filter(|s| !across || s.first != s.axis).collect()
        };
        match self {
            Self::Whole => vec![subject(String::new(), X, X)],
            Self::Pairs => [(X, Y), (Y, Z), (Z, X)].map(|(a, b)| subject(format!("{a}{b}"), a, b)).into(),
            Self::Linear => axes(&Axis::LINEAR),
            Self::Rotary => axes(&[A, B, C]),
            Self::Axes => axes(&Axis::ALL),
            Self::Straightness => symbols(Axis::LINEAR, true),
            Self::Angular => symbols([A, B, C], false),
        }
    }
}

/// An effect by name, with the axis, pair or symbol that has it.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Label {
    /// Its name (`docs/reference/session-files.md` 4.1).
    pub effect: &'static str,
    /// Axis, axis pair, error symbol, or empty.
    pub subject: String,
}

impl Label {
    /// A label.
    #[must_use]
    pub fn new(effect: &'static str, subject: impl fmt::Display) -> Self {
        Self { effect, subject: subject.to_string() }
    }

    /// The label of a text `effect` or `effect:subject`. Synonyms count, and either order of a pair.
    ///
    /// # Errors
    /// An effect that is not in the library, or a subject that it cannot have.
    pub fn parse(text: &str) -> Result<(&'static str, Option<String>), LabelError> {
        let (name, subject) =
            text.split_once(':').map_or((text, None), |(e, s)| (e, Some(s.to_ascii_lowercase())));
        let effect = Effect::find(&name.to_ascii_lowercase())
            .ok_or_else(|| LabelError::Effect { effect: name.to_owned() })?;
        let Some(subject) = subject.filter(|s| !s.is_empty()) else { return Ok((effect.name, None)) };
        // a pair is named in one order only
        let turned: String = subject.chars().rev().collect();
        let is_pair = effect.subjects == Subjects::Pairs;
        let all = effect.subjects.all();
        let mut known = all.iter().map(|s| s.name.clone()).filter(|name| !name.is_empty());
        if let Some(found) = known.clone().find(|k| *k == subject || (is_pair && *k == turned)) {
            return Ok((effect.name, Some(found)));
        }
        let first = known.next().unwrap_or_else(|| "none".to_owned());
        let known = known.fold(first, |list, name| format!("{list}, {name}"));
        Err(LabelError::Subject { effect: effect.name, subject, known })
    }
}

/// A text that is no label.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LabelError {
    /// No such effect.
    #[error("unknown effect '{effect}'; volcomp diagnose --list-effects lists them")]
    Effect {
        /// What stands before the colon.
        effect: String,
    },
    /// The effect has no such subject.
    #[error("{effect} has no subject '{subject}'; its subjects are: {known}")]
    Subject {
        /// The effect.
        effect: &'static str,
        /// What stands behind the colon.
        subject: String,
        /// What may stand there.
        known: String,
    },
}

impl fmt::Display for Label {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.subject.is_empty() {
            write!(f, "{}", self.effect)
        } else {
            write!(f, "{}:{}", self.effect, self.subject)
        }
    }
}

/// An effect taken out of the library.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Without {
    /// The effect.
    pub effect: &'static str,
    /// Its subject; all of them where there is none.
    pub subject: Option<String>,
}

impl Without {
    /// True where it takes out `label`.
    #[must_use]
    pub fn covers(&self, label: &Label) -> bool {
        self.effect == label.effect && self.subject.as_ref().is_none_or(|s| *s == label.subject)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_label_has_an_effect_and_a_subject_that_it_can_have() {
        let known = |text: &str| Label::parse(text).map(|(e, s)| format!("{e}:{}", s.unwrap_or_default()));
        for (text, label) in [
            ("backlash", "backlash:"),
            ("lost-motion:X", "backlash:x"),
            ("backlash:c", "backlash:c"),
            ("scale:c", "scale:c"),
            ("squareness:yx", "squareness:xy"),
            ("squareness:xz", "squareness:zx"),
            ("straightness:ezx", "straightness:ezx"),
            ("angular:ebx", "angular:ebx"),
            ("rotary-location:a", "rotary-location:a"),
        ] {
            assert_eq!(known(text).as_deref(), Ok(label));
        }
        for (text, said) in [
            ("nope:x", "unknown effect 'nope'"),
            ("backlash:q", "its subjects are: x, y, z, a, b, c"),
            ("squareness:xx", "its subjects are: xy, yz, zx"),
            ("spindle-growth:x", "its subjects are: none"),
            ("straightness:exx", "its subjects are: eyx, ezx, exy, ezy, exz, eyz"),
            ("rotary-motion:x", "its subjects are: a, b, c"),
        ] {
            let message = known(text).unwrap_err().to_string();
            assert!(message.contains(said), "{text}: {message}");
        }
    }
}
