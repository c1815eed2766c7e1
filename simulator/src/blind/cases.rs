//! Which machines are drawn, and how large their effects are.
//!
//! The level of an effect is the RMS of what it shows over all rows of the campaign, each in units of its instrument's
//! white noise and without the offset of its setup.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use crate::campaign::{Campaign, Plan, run_campaign};
use crate::twin::catalogue::CATALOGUE;
use crate::twin::{Dice, Effect, InstrumentTruth, TwinError, TwinTruth};

/// Levels that are drawn, in units of the noise.
pub const LEVELS: [f64; 4] = [0.5, 1.0, 2.0, 5.0];
/// An effect that shows less than this per um of size is invisible to a plan.
const INVISIBLE: f64 = 0.015;

/// What a case asks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// One effect of the library.
    Single,
    /// Two.
    Pair,
    /// None.
    Null,
    /// One that no library knows.
    Outside,
    /// One that is taken out of the tool's library.
    Removed,
    /// A machine with many effects, the model given all but one.
    LeftOut,
}

/// How nature behaves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// Normal noise, a drift that forgets itself.
    Plain,
    /// Heavy tails, waves and trends in the mountings, effects that vary over the volume.
    Hard,
}

/// A case with its label; sealed until the tool has answered.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Case {
    /// Its number.
    pub number: usize,
    /// What it asks.
    pub kind: Kind,
    /// The true effects, `name:subject`.
    pub labels: Vec<String>,
    /// Their levels.
    pub levels: Vec<f64>,
    /// False where the plan cannot see them.
    pub visible: bool,
    /// Seeds of the day and of another day.
    pub days: [u64; 2],
    /// The machine.
    pub truth: TwinTruth,
}

/// How many cases of each kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Draw {
    /// One effect.
    pub singles: usize,
    /// Two effects.
    pub pairs: usize,
    /// No effect.
    pub nulls: usize,
    /// Effects outside the library.
    pub outside: usize,
}

/// Every effect with every subject, those of libraries or those outside.
#[must_use]
pub fn pool(outside: bool) -> Vec<(&'static str, &'static str)> {
    CATALOGUE
        .iter()
        .filter(|e| e.outside == outside)
        .flat_map(|e| e.subjects.list().iter().map(|s| (e.name, *s)))
        .collect()
}

/// Draws the cases; effects go round, so that all come up before one comes twice.
///
/// # Errors
/// An effect without physics.
pub fn draw(draw: Draw, plan: Plan, mode: Mode, seed: u64) -> Result<Vec<Case>, TwinError> {
    let mut dice = Dice::new(seed, "cases");
    let mut inside = Rounds::new(false);
    let mut beyond = Rounds::new(true);
    let mut cases = Vec::new();
    let kinds = [
        (Kind::Single, draw.singles),
        (Kind::Pair, draw.pairs),
        (Kind::Null, draw.nulls),
        (Kind::Outside, draw.outside),
    ];
    for (kind, count) in kinds {
        for _ in 0..count {
            let wanted = match kind {
                Kind::Single => vec![inside.next(&mut dice)],
                Kind::Pair => {
                    let first = inside.next(&mut dice);
                    let mut second = inside.next(&mut dice);
                    while second == first {
                        second = inside.next(&mut dice);
                    }
                    vec![first, second]
                }
                Kind::Outside => vec![beyond.next(&mut dice)],
                _ => Vec::new(),
            };
            cases.push(case(cases.len(), kind, &wanted, plan, mode, &mut dice)?);
        }
    }
    Ok(cases)
}

/// Goes round a shuffled pool.
struct Rounds {
    all: Vec<(&'static str, &'static str)>,
    left: Vec<(&'static str, &'static str)>,
}

impl Rounds {
    fn new(outside: bool) -> Self {
        Self { all: pool(outside), left: Vec::new() }
    }

    fn next(&mut self, dice: &mut Dice) -> (&'static str, &'static str) {
        if self.left.is_empty() {
            self.left.clone_from(&self.all);
        }
        let at = dice.below(self.left.len());
        self.left.swap_remove(at)
    }
}

/// Draws one machine.
fn case(
    number: usize,
    kind: Kind,
    wanted: &[(&str, &str)],
    plan: Plan,
    mode: Mode,
    dice: &mut Dice,
) -> Result<Case, TwinError> {
    let whole = |dice: &mut Dice| (dice.between(1.0, 9.0e8)) as u64;
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
    let mut truth = TwinTruth {
        variation: if mode == Mode::Hard { 0.15 } else { 0.0 },
        instruments,
        ..TwinTruth::perfect(whole(dice))
    };
    let days = [whole(dice), whole(dice)];
    let (mut labels, mut levels, mut visible) = (Vec::new(), Vec::new(), true);
    let mut effects = Vec::new();
    for (name, subject) in wanted {
        let level = dice.one_of(&LEVELS);
        let (effect, seen) = scaled(&truth, &Effect::new(name, subject, dice.sign()), plan, level, days[0])?;
        visible &= seen;
        labels.push(effect.label());
        levels.push(level);
        effects.push(effect);
    }
    truth.effects = effects;
    Ok(Case { number, kind, labels, levels, visible, days, truth })
}

/// An effect of such a size that it shows at a level; false where the plan does not see it.
///
/// # Errors
/// No physics for it.
pub fn scaled(
    machine: &TwinTruth,
    unit: &Effect,
    plan: Plan,
    level: f64,
    day: u64,
) -> Result<(Effect, bool), TwinError> {
    let mut effect = unit.clone();
    for round in 0..3 {
        let alone = TwinTruth { effects: vec![effect.clone()], ..machine.clone() };
        let shown = shown(&run_campaign(&alone, plan, day)?);
        if round == 0 && shown < INVISIBLE {
            effect.size_um *= 3.0 * level;
            return Ok((effect, false));
        }
        let factor = level / shown.max(1e-9);
        if (factor - 1.0).abs() < 0.03 {
            break;
        }
        effect.size_um *= factor;
    }
    Ok((effect, true))
}

/// RMS of what the effects show, in units of the noise, without the offset of each setup.
#[must_use]
pub fn shown(campaign: &Campaign) -> f64 {
    let mut setups: BTreeMap<i64, Vec<(Vector3<f64>, f64)>> = BTreeMap::new();
    for (s, m) in campaign.taken.states.iter().zip(&campaign.measured) {
        let row = (Vector3::from(s.u) / m.noise_um, m.effects_um / m.noise_um);
        setups.entry(s.place[0]).or_default().push(row);
    }
    let (mut sum, mut n) = (0.0, 0usize);
    for rows in setups.values() {
        let mut normal = Matrix3::identity() * 1e-9;
        let mut right = Vector3::zeros();
        for (u, d) in rows {
            normal += u * u.transpose();
            right += u * *d;
        }
        let offset = normal.try_inverse().map_or_else(Vector3::zeros, |inverse| inverse * right);
        sum += rows.iter().map(|(u, d)| (d - u.dot(&offset)).powi(2)).sum::<f64>();
        n += rows.len();
    }
    (sum / n.max(1) as f64).sqrt()
}

/// The effects of a machine that has many at once, for leaving out one of them.
const MANY: &[(&str, &str)] = &[
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

/// Machines with one of many effects each and the machine with all of them; the machine is the same, so that what is found
/// of the single ones holds for the whole.
///
/// # Errors
/// No physics for an effect.
pub fn many(plan: Plan, mode: Mode, seed: u64) -> Result<Vec<Case>, TwinError> {
    let mut dice = Dice::new(seed, "many");
    let empty = case(0, Kind::LeftOut, &[], plan, mode, &mut dice)?;
    let mut cases: Vec<Case> = Vec::new();
    for (name, subject) in MANY {
        let unit = Effect::new(name, subject, dice.sign());
        let (effect, visible) = scaled(&empty.truth, &unit, plan, 2.0, empty.days[0])?;
        cases.push(Case {
            number: cases.len(),
            labels: vec![effect.label()],
            levels: vec![2.0],
            visible,
            truth: TwinTruth { effects: vec![effect], ..empty.truth.clone() },
            ..empty.clone()
        });
    }
    Ok(cases)
}
