//! Where the machines of blind cases come from: two generators that share no physics, plan or noise.

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
}

impl core::fmt::Display for Generator {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Twin => "twin",
            Self::Trunnion => "trunnion",
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
    /// Every effect with every subject, those of libraries or those outside.
    #[must_use]
    pub fn pool(self, outside: bool) -> Vec<(&'static str, &'static str)> {
        let with = |name, subjects: &'static [&'static str]| subjects.iter().map(move |s| (name, *s));
        match self {
            Self::Twin => crate::twin::catalogue::CATALOGUE
                .iter()
                .filter(|e| e.outside == outside)
                .flat_map(|e| with(e.name, e.subjects.list()))
                .collect(),
            Self::Trunnion => formulas::catalogue::CATALOGUE
                .iter()
                .filter(|e| e.outside() == outside)
                .flat_map(|e| with(e.name, e.subjects))
                .collect(),
        }
    }

    /// True where two effects make no pair.
    pub(super) fn alike(self, first: (&str, &str), second: (&str, &str)) -> bool {
        let [one, other] = [first, second].map(|(name, subject)| label(name, subject));
        first == second || (self == Self::Trunnion && formulas::catalogue::alike(&one, &other))
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
        }
    }

    /// The same machine with the effects of others of its generator, and not its own.
    #[must_use]
    pub fn with_effects_of<'a>(&self, others: impl IntoIterator<Item = &'a Self>) -> Self {
        let mut whole = self.clone();
        match &mut whole {
            Self::Twin(t) => t.effects.clear(),
            Self::Trunnion(t) => t.faults.clear(),
        }
        for other in others {
            match (&mut whole, other) {
                (Self::Twin(t), Self::Twin(o)) => t.effects.extend(o.effects.iter().cloned()),
                (Self::Trunnion(t), Self::Trunnion(o)) => t.faults.extend(o.faults.iter().cloned()),
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
        })
    }
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
            let pool = generator.pool(false);
            assert!(MANY.iter().all(|e| pool.contains(e)));
            assert!(generator.pool(true).iter().all(|e| e.0.starts_with("outside-")));
        }
    }
}
