//! Where the machines of blind cases come from: three generators that share no physics, plan or noise.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::cases::{Mode, Sight, label, shown};
use crate::campaign::files::{Files, Text};
use crate::campaign::{Plan, run_campaign};
use crate::formulas::{self, FormulaError, FormulaTruth};
use crate::twin::{Dice, Effect, InstrumentTruth, TwinError, TwinTruth};

/// A generator of session files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Generator {
    /// A machine with one table, simulated in time.
    Twin,
    /// A machine with a swivelling table, from closed formulas; it has a plan of its own.
    Trunnion,
    /// A boring mill from multibody dynamics, conduction on grids and beam elements: a program of its own
    /// (`simulator/multibody`) with a plan of its own.
    Multibody,
}

impl Generator {
    /// True where it measures one plan only.
    #[must_use]
    pub const fn has_its_own_plan(self) -> bool {
        matches!(self, Self::Trunnion | Self::Multibody)
    }
}

impl core::fmt::Display for Generator {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Twin => "twin",
            Self::Trunnion => "trunnion",
            Self::Multibody => "multibody",
        })
    }
}

/// Why nothing was generated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GeneratorError {
    /// The twin says why.
    #[error(transparent)]
    Twin(#[from] TwinError),
    /// The formulas say why.
    #[error(transparent)]
    Formulas(#[from] FormulaError),
    /// The program of its own has to be asked.
    #[error("the cases of the {0} are simulated by a program of its own")]
    Elsewhere(Generator),
    /// It has no effects to draw from.
    #[error("no effects to draw from")]
    NoEffects,
    /// No effect of that name.
    #[error("the {generator} has no effect '{name}'; cncsim campaign --list-effects lists those of the twin")]
    Unknown {
        /// What was asked for.
        name: String,
        /// Of whom.
        generator: Generator,
    },
}

/// A machine as it really is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "generator", rename_all = "kebab-case")]
pub enum Truth {
    /// Of [`Generator::Twin`].
    Twin(TwinTruth),
    /// Of [`Generator::Trunnion`].
    Trunnion(FormulaTruth),
    /// Of [`Generator::Multibody`]: what its program is asked for.
    Multibody(Wanted),
}

/// The effects of a machine that has many at once, for leaving out one of them.
pub(super) const MANY: &[(&str, &str)] = &[
    ("squareness", "xy"),
    ("scale", "z"),
    ("positioning", "x"),
    ("cyclic", "y"),
    ("straightness", "eyx"),
    ("angular", "eay"),
    ("backlash", "x"),
    ("servo-mismatch", "y"),
    ("inertial", "z"),
    ("thermal-expansion", "y"),
    ("spindle-growth", ""),
    ("rotary-location", "c"),
    ("load", "x"),
];

impl Generator {
    /// Every effect with every subject; none where a program of its own has to be asked.
    #[must_use]
    pub fn effects(self) -> Vec<Named> {
        let with = |name: &str, subjects: &'static [&'static str], outside: bool| -> Vec<Named> {
            subjects.iter().map(|s| Named::new(name, s, outside)).collect()
        };
        match self {
            Self::Twin => crate::twin::catalogue::CATALOGUE
                .iter()
                .flat_map(|e| with(e.name, e.subjects.list(), e.outside))
                .collect(),
            Self::Trunnion => formulas::catalogue::CATALOGUE
                .iter()
                .flat_map(|e| with(e.name, e.subjects, e.outside()))
                .collect(),
            Self::Multibody => Vec::new(),
        }
    }

    /// True where two effects are not drawn together.
    pub(super) fn alike(self, first: &Named, second: &Named) -> bool {
        first == second
            || first.families.iter().any(|f| second.families.contains(f))
            || (self == Self::Trunnion && formulas::catalogue::alike(&first.label(), &second.label()))
    }

    /// Draws a machine without effects.
    pub(super) fn machine(self, mode: Mode, dice: &mut Dice) -> Truth {
        match self {
            Self::Twin => Truth::Twin(twin(mode, dice)),
            Self::Trunnion => Truth::Trunnion(FormulaTruth {
                drift: dice.between(0.3, 1.0),
                drift_s: dice.between(250.0, 1800.0),
                hard: mode == Mode::Hard,
                ..FormulaTruth::perfect(whole(dice))
            }),
            Self::Multibody => Truth::Multibody(Wanted {
                effects: Vec::new(),
                seed: whole(dice),
                days: [1, 2],
                hard: mode == Mode::Hard,
            }),
        }
    }
}

/// A whole number for a seed.
pub(super) fn whole(dice: &mut Dice) -> u64 {
    dice.between(1.0, 9.0e8) as u64
}

fn twin(mode: Mode, dice: &mut Dice) -> TwinTruth {
    let instruments = InstrumentTruth {
        drift: dice.between(0.3, 1.0),
        drift_s: dice.between(200.0, 1500.0),
        dropouts: if dice.between(0.0, 1.0) > 0.7 { 0.02 } else { 0.0 },
        ..InstrumentTruth::default()
    };
    let instruments = match mode {
        Mode::Plain => instruments,
        Mode::Hard => InstrumentTruth {
            heavy_tails: true,
            waves: dice.between(0.3, 0.8),
            trend_per_h: dice.between(0.2, 0.8),
            ..instruments
        },
    };
    TwinTruth {
        variation: if mode == Mode::Hard { 0.15 } else { 0.0 },
        instruments,
        ..TwinTruth::perfect(whole(dice))
    }
}

impl Truth {
    /// The same machine with this effect and no other.
    #[must_use]
    pub fn only(&self, name: &str, subject: &str, size_um: f64) -> Self {
        match self {
            Self::Twin(t) => {
                Self::Twin(TwinTruth { effects: vec![Effect::new(name, subject, size_um)], ..t.clone() })
            }
            Self::Trunnion(t) => Self::Trunnion(t.only(name, subject, size_um)),
            Self::Multibody(w) => Self::Multibody(w.clone()),
        }
    }

    /// The same machine with the effects of others of its generator, and not its own.
    #[must_use]
    pub fn with_effects_of<'a>(&self, others: impl IntoIterator<Item = &'a Self>) -> Self {
        let mut whole = self.clone();
        match &mut whole {
            Self::Twin(t) => t.effects.clear(),
            Self::Trunnion(t) => t.faults.clear(),
            Self::Multibody(w) => w.effects.clear(),
        }
        for other in others {
            match (&mut whole, other) {
                (Self::Twin(t), Self::Twin(o)) => t.effects.extend(o.effects.iter().cloned()),
                (Self::Trunnion(t), Self::Trunnion(o)) => t.faults.extend(o.faults.iter().cloned()),
                (Self::Multibody(w), Self::Multibody(o)) => w.effects.extend(o.effects.iter().cloned()),
                _ => {}
            }
        }
        whole
    }

    /// The same machine with little noise.
    #[must_use]
    pub fn quiet(&self) -> Self {
        match self {
            Self::Twin(t) => {
                let instruments = InstrumentTruth { noise: 0.1, drift: 0.1, ..InstrumentTruth::default() };
                Self::Twin(TwinTruth { instruments, ..t.clone() })
            }
            Self::Trunnion(t) => {
                Self::Trunnion(FormulaTruth { noise: 0.1, drift: 0.1, hard: false, ..t.clone() })
            }
            Self::Multibody(w) => Self::Multibody(w.clone()),
        }
    }

    /// RMS of what its effects show on a day, in units of the noise, without the offset of each setup.
    ///
    /// # Errors
    /// An effect that the generator does not have.
    pub fn shown(&self, plan: Plan, day: u64) -> Result<f64, GeneratorError> {
        let sight = |setup: i64, u: Vector3<f64>, effects_um: f64, noise_um: f64| Sight {
            setup,
            u: u / noise_um,
            effects: effects_um / noise_um,
        };
        Ok(match self {
            Self::Twin(t) => {
                let c = run_campaign(t, plan, day)?;
                let rows = c.taken.states.iter().zip(&c.measured);
                shown(rows.map(|(s, m)| sight(s.place[0], Vector3::from(s.u), m.effects_um, m.noise_um)))
            }
            Self::Trunnion(t) => {
                let c = formulas::measure(t, day)?;
                let rows = c.rows.iter().zip(&c.readings);
                shown(rows.map(|(r, d)| sight(r.place[0], r.u, d.effects_um, d.noise_um)))
            }
            Self::Multibody(_) => return Err(GeneratorError::Elsewhere(Generator::Multibody)),
        })
    }

    /// What the tool is given of a day.
    ///
    /// # Errors
    /// An effect that the generator does not have.
    pub fn files(&self, plan: Plan, day: u64) -> Result<Files, GeneratorError> {
        Ok(match self {
            Self::Twin(t) => Files::of(&run_campaign(t, plan, day)?),
            Self::Trunnion(t) => {
                let m = formulas::measure(t, day)?;
                let text = |s: formulas::files::Sheet| Text { name: s.name, text: s.text };
                Files {
                    sessions: formulas::files::sessions(&m).into_iter().map(text).collect(),
                    history: text(formulas::files::history(&m)),
                    model: Text::model(formulas::machine::nominal_model()),
                }
            }
            Self::Multibody(_) => return Err(GeneratorError::Elsewhere(Generator::Multibody)),
        })
    }

    /// What its effects do together at each row of each session file of a day, um along u.
    ///
    /// # Errors
    /// An effect that the generator does not have.
    pub fn along_u(&self, plan: Plan, day: u64) -> Result<BTreeMap<String, Vec<f64>>, GeneratorError> {
        let mut files: BTreeMap<String, Vec<f64>> = BTreeMap::new();
        let mut put = |instrument: &str, um: f64| {
            files.entry(format!("{instrument}.csv")).or_default().push(um);
        };
        match self {
            Self::Twin(t) => {
                let c = run_campaign(t, plan, day)?;
                c.taken.states.iter().zip(&c.measured).for_each(|(s, m)| put(s.instrument, m.effects_um));
            }
            Self::Trunnion(t) => {
                let c = formulas::measure(t, day)?;
                c.rows.iter().zip(&c.readings).for_each(|(r, d)| put(r.instrument, d.effects_um));
            }
            Self::Multibody(_) => return Err(GeneratorError::Elsewhere(Generator::Multibody)),
        }
        Ok(files)
    }

    /// The same machine with those of its effects that have a label.
    #[must_use]
    pub fn alone(&self, wanted: &str) -> Self {
        let mut one = self.clone();
        match &mut one {
            Self::Twin(t) => t.effects.retain(|e| label(&e.name, &e.subject) == wanted),
            Self::Trunnion(t) => t.faults.retain(|f| label(&f.name, &f.subject) == wanted),
            Self::Multibody(w) => w.effects.retain(|e| label(&e.name, &e.subject) == wanted),
        }
        one
    }
}

/// An effect that a generator has.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub struct Named {
    /// Name.
    pub name: String,
    /// Subject, or empty.
    pub subject: String,
    /// No library of causes knows it.
    pub outside: bool,
    /// Two effects with one in common are not drawn together.
    pub families: Vec<String>,
}

impl Named {
    /// An effect that belongs to no family.
    #[must_use]
    pub fn new(name: &str, subject: &str, outside: bool) -> Self {
        Self { name: name.to_owned(), subject: subject.to_owned(), outside, families: Vec::new() }
    }

    /// `name:subject`.
    #[must_use]
    pub fn label(&self) -> String {
        label(&self.name, &self.subject)
    }
}

/// What the program of a generator is asked for, as JSON.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Wanted {
    /// Effects of the machine.
    pub effects: Vec<WantedEffect>,
    /// Seed of the machine.
    pub seed: u64,
    /// Seeds of the day and of another day.
    pub days: [u64; 2],
    /// Heavy tails, waves and trends; effects that vary over the volume.
    pub hard: bool,
}

/// An effect that is asked for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WantedEffect {
    /// Name.
    pub name: String,
    /// Subject, or empty.
    pub subject: String,
    /// +1 or -1.
    pub sign: f64,
    /// RMS over all readings in units of the noise, without the offsets of the setups.
    pub level: f64,
}

/// The truth that the program writes, `volcomp-case-truth/1`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct CaseTruth {
    /// Effects, in the order of the request.
    pub effects: Vec<TrueEffect>,
    /// What each effect alone does, um along u: session file, label, row.
    pub columns: BTreeMap<String, BTreeMap<String, Vec<f64>>>,
}

/// A true effect.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct TrueEffect {
    /// `name:subject`.
    pub label: String,
    /// The level reached.
    pub level: f64,
    /// The plan shows it.
    pub visible: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_truth_survives_its_sealing() {
        let mut dice = Dice::new(4, "machines");
        for generator in [Generator::Twin, Generator::Trunnion] {
            let truth = generator.machine(Mode::Hard, &mut dice).only("backlash", "x", 2.5);
            let sealed = toml::to_string(&truth).unwrap();
            assert_eq!(toml::from_str::<Truth>(&sealed).unwrap(), truth, "{sealed}");
        }
    }

    #[test]
    fn every_effect_that_can_be_left_out_is_in_the_pool() {
        for generator in [Generator::Twin, Generator::Trunnion] {
            let effects = generator.effects();
            let has = |(name, subject): &(&str, &str)| effects.contains(&Named::new(name, subject, false));
            assert!(MANY.iter().all(has));
            assert!(effects.iter().all(|e| e.outside == e.name.starts_with("outside-")));
        }
    }
}
