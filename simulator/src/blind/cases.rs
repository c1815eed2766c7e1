//! Which machines are drawn, and how large their effects are.
//!
//! The level of an effect is the RMS of what it shows over all rows of the campaign, each in units of its instrument's
//! white noise and without the offset of its setup.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use super::generator::{Generator, GeneratorError, MANY, Named, Truth, Wanted, WantedEffect, whole};
use crate::campaign::Plan;
use crate::twin::Dice;

/// Levels of several effects at once.
const SEVERAL_LEVELS: [f64; 3] = [0.5, 1.0, 2.0];
/// How many effects several are, at least and at most.
const SEVERAL: [usize; 2] = [5, 8];
/// Effects that only chance in single readings shows: at most one of them among several.
const OF_CHANCE: [&str; 4] = ["vibration", "outliers", "quantisation", "range-noise"];
/// Levels that are drawn, in units of the noise.
pub const LEVELS: [f64; 4] = [0.5, 1.0, 2.0, 5.0];
/// An effect that shows less than this per um of size is invisible to a plan.
const INVISIBLE: f64 = 0.015;
/// Rounds in which the size is found.
const ROUNDS: usize = 3;
/// Share of a level that counts as reached.
const REACHED: f64 = 0.8;

/// What a case asks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// One effect of the library.
    Single,
    /// Two.
    Pair,
    /// Five to eight at once, none of them large: a machine as it is.
    Several,
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
    pub truth: Truth,
}

/// Where cases come from.
#[derive(Debug, Clone, Copy)]
pub struct Origin<'a> {
    /// The generator.
    pub generator: Generator,
    /// Its effects.
    pub effects: &'a [Named],
    /// What is measured.
    pub plan: Plan,
    /// How nature behaves.
    pub mode: Mode,
}

/// How many cases of each kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Draw {
    /// One effect.
    pub singles: usize,
    /// Two effects.
    pub pairs: usize,
    /// Five to eight effects.
    pub several: usize,
    /// No effect.
    pub nulls: usize,
    /// Effects outside the library.
    pub outside: usize,
}

/// The effects of the library that are drawn: those named (`name` or `name:subject`), or all where none is.
///
/// # Errors
/// A name that no effect has.
pub fn pool(from: Origin<'_>, only: &[String]) -> Result<Vec<Named>, GeneratorError> {
    let is = |wanted: &String, e: &Named| *wanted == e.name || *wanted == e.label();
    let mut all: Vec<Named> = from.effects.iter().filter(|e| !e.outside).cloned().collect();
    if let Some(name) = only.iter().find(|o| !all.iter().any(|e| is(o, e))) {
        return Err(GeneratorError::Unknown { name: name.clone(), generator: from.generator });
    }
    all.retain(|e| only.is_empty() || only.iter().any(|o| is(o, e)));
    Ok(all)
}

/// Draws the cases; effects go round, so that all come up before one comes twice. Those of the library come from
/// [`pool`].
///
/// # Errors
/// An effect without physics, or a name that no effect has.
pub fn draw(draw: Draw, from: Origin<'_>, only: &[String], seed: u64) -> Result<Vec<Case>, GeneratorError> {
    let mut dice = Dice::new(seed, "cases");
    let mut inside = Rounds::new(pool(from, only)?);
    let mut beyond = Rounds::new(from.effects.iter().filter(|e| e.outside).cloned().collect());
    let mut cases = Vec::new();
    let kinds = [
        (Kind::Single, draw.singles),
        (Kind::Pair, draw.pairs),
        (Kind::Null, draw.nulls),
        (Kind::Outside, draw.outside),
        // last, so that the cases of the other kinds do not depend on their number
        (Kind::Several, draw.several),
    ];
    for (kind, count) in kinds {
        for _ in 0..count {
            let wanted = match kind {
                Kind::Single => vec![inside.next(&mut dice)?],
                Kind::Pair => together(2, &mut inside, from.generator, &mut dice)?,
                Kind::Several => {
                    let more = dice.below(SEVERAL[1] - SEVERAL[0] + 1);
                    together(SEVERAL[0] + more, &mut inside, from.generator, &mut dice)?
                }
                Kind::Outside => vec![beyond.next(&mut dice)?],
                _ => Vec::new(),
            };
            cases.push(case(cases.len(), kind, &wanted, from, &mut dice)?);
        }
    }
    Ok(cases)
}

/// Effects for one machine, no two of them alike; fewer where the pool has no more.
fn together(
    count: usize,
    pool: &mut Rounds,
    generator: Generator,
    dice: &mut Dice,
) -> Result<Vec<Named>, GeneratorError> {
    let of_chance = |e: &Named| OF_CHANCE.contains(&e.name.as_str());
    let mut chosen = vec![pool.next(dice)?];
    let mut tries = 0;
    while chosen.len() < count && tries < 1000 {
        tries += 1;
        let next = pool.next(dice)?;
        let clashes =
            |e: &Named| generator.alike(e, &next) || (count > 2 && of_chance(e) && of_chance(&next));
        if !chosen.iter().any(clashes) {
            chosen.push(next);
        }
    }
    Ok(chosen)
}

/// Goes round a shuffled pool.
struct Rounds {
    all: Vec<Named>,
    left: Vec<Named>,
}

impl Rounds {
    const fn new(all: Vec<Named>) -> Self {
        Self { all, left: Vec::new() }
    }

    fn next(&mut self, dice: &mut Dice) -> Result<Named, GeneratorError> {
        if self.left.is_empty() {
            self.left.clone_from(&self.all);
        }
        if self.left.is_empty() {
            return Err(GeneratorError::NoEffects);
        }
        let at = dice.below(self.left.len());
        Ok(self.left.swap_remove(at))
    }
}

/// Draws one machine.
fn case(
    number: usize,
    kind: Kind,
    wanted: &[Named],
    from: Origin<'_>,
    dice: &mut Dice,
) -> Result<Case, GeneratorError> {
    let empty = from.generator.machine(from.mode, dice);
    let days = [whole(dice), whole(dice)];
    let (mut labels, mut levels, mut visible) = (Vec::new(), Vec::new(), true);
    let mut alone = Vec::new();
    for named in wanted {
        let level = if kind == Kind::Several { dice.one_of(&SEVERAL_LEVELS) } else { dice.one_of(&LEVELS) };
        let sign = dice.sign();
        labels.push(named.label());
        if let Truth::Multibody(w) = &empty {
            // its program scales them
            let (name, subject) = (named.name.clone(), named.subject.clone());
            let effects = vec![WantedEffect { name, subject, sign, level }];
            alone.push(Truth::Multibody(Wanted { effects, ..w.clone() }));
            levels.push(level);
            continue;
        }
        let one = scaled(&empty, (&named.name, &named.subject), sign, from.plan, level, days[0])?;
        visible &= one.visible;
        levels.push(one.level);
        alone.push(one.truth);
    }
    let mut truth = empty.with_effects_of(&alone);
    if let Truth::Multibody(w) = &mut truth {
        w.days = days;
    }
    Ok(Case { number, kind, labels, levels, visible, days, truth })
}

/// `name:subject` (`docs/reference/session-files.md` 4.1).
pub(crate) fn label(name: &str, subject: &str) -> String {
    if subject.is_empty() { name.to_owned() } else { format!("{name}:{subject}") }
}

/// A machine with one effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Scaled {
    /// The machine.
    pub truth: Truth,
    /// The level at which the effect shows.
    pub level: f64,
    /// False where the plan does not see it.
    pub visible: bool,
}

/// A machine with one effect of such a size that it shows at a level, or at the highest one below that it can reach: a display
/// that shows the same digit for everything hides no more than the noise.
///
/// # Errors
/// No physics for it.
pub fn scaled(
    machine: &Truth,
    (name, subject): (&str, &str),
    sign: f64,
    plan: Plan,
    level: f64,
    day: u64,
) -> Result<Scaled, GeneratorError> {
    let mut size_um = sign;
    let mut shown = 0.0;
    for round in 0..ROUNDS {
        shown = machine.only(name, subject, size_um).shown(plan, day)?;
        if round == 0 && shown < INVISIBLE {
            let truth = machine.only(name, subject, size_um * 3.0 * level);
            return Ok(Scaled { truth, level, visible: false });
        }
        let factor = level / shown.max(1e-9);
        if (factor - 1.0).abs() < 0.03 {
            break;
        }
        size_um *= factor;
    }
    let lower = LEVELS.iter().rev().find(|l| **l < level);
    match lower {
        Some(lower) if shown < REACHED * level => scaled(machine, (name, subject), sign, plan, *lower, day),
        _ => Ok(Scaled { truth: machine.only(name, subject, size_um), level, visible: true }),
    }
}

/// What an instrument sees of the effects at one reading, in units of its noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    /// The setup.
    pub setup: i64,
    /// Direction of sensitivity over the noise, 1/um.
    pub u: Vector3<f64>,
    /// What the effects show over the noise.
    pub effects: f64,
}

/// RMS of what the effects show, in units of the noise, without the offset of each setup.
#[must_use]
pub fn shown(sights: impl Iterator<Item = Sight>) -> f64 {
    let mut setups: BTreeMap<i64, Vec<(Vector3<f64>, f64)>> = BTreeMap::new();
    for s in sights {
        setups.entry(s.setup).or_default().push((s.u, s.effects));
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

/// Machines with one of many effects each and the machine with all of them; the machine is the same, so that what is found
/// of the single ones holds for the whole.
///
/// # Errors
/// No physics for an effect.
pub fn many(from: Origin<'_>, seed: u64) -> Result<Vec<Case>, GeneratorError> {
    let mut dice = Dice::new(seed, "many");
    let empty = case(0, Kind::LeftOut, &[], from, &mut dice)?;
    let mut cases: Vec<Case> = Vec::new();
    let mut calendar = Dice::new(seed, "days");
    for (name, subject) in MANY {
        let sign = dice.sign();
        let days = [whole(&mut calendar), whole(&mut calendar)];
        let one = scaled(&empty.truth, (name, subject), sign, from.plan, 2.0, days[0])?;
        cases.push(Case {
            number: cases.len(),
            labels: vec![label(name, subject)],
            levels: vec![one.level],
            visible: one.visible,
            truth: one.truth,
            days,
            ..empty.clone()
        });
    }
    Ok(cases)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_effects_named_are_drawn() {
        let effects = Generator::Twin.effects();
        let from =
            Origin { generator: Generator::Twin, effects: &effects, plan: Plan::Small, mode: Mode::Plain };
        let of = |only: &[&str]| -> Result<Vec<String>, GeneratorError> {
            let only: Vec<String> = only.iter().map(|o| (*o).to_owned()).collect();
            Ok(pool(from, &only)?.iter().map(Named::label).collect())
        };
        assert_eq!(of(&["wear"]).unwrap(), ["wear:x", "wear:y", "wear:z"]);
        assert_eq!(of(&["latency", "scale:y"]).unwrap(), ["scale:y", "latency"]);
        assert_eq!(of(&[]).unwrap().len(), effects.iter().filter(|e| !e.outside).count());
        let unknown = of(&["wear:q"]).unwrap_err().to_string();
        assert!(unknown.contains("the twin has no effect 'wear:q'"), "{unknown}");
    }

    #[test]
    fn several_effects_are_small_different_and_few_of_them_of_chance() {
        let effects = Generator::Trunnion.effects();
        let plan = Plan::Full;
        let from = Origin { generator: Generator::Trunnion, effects: &effects, plan, mode: Mode::Plain };
        let none = Draw { singles: 0, pairs: 0, several: 6, nulls: 0, outside: 0 };
        let cases = draw(none, from, &[], 3).unwrap();
        assert_eq!(cases.len(), 6);
        for case in &cases {
            assert!((SEVERAL[0]..=SEVERAL[1]).contains(&case.labels.len()), "{:?}", case.labels);
            assert!(case.levels.iter().all(|l| *l <= 2.0));
            let of_chance = case.labels.iter().filter(|l| OF_CHANCE.contains(&l.as_str())).count();
            assert!(of_chance <= 1, "{:?}", case.labels);
            let mut different = case.labels.clone();
            different.sort();
            different.dedup();
            assert_eq!(different.len(), case.labels.len());
        }
    }

    #[test]
    fn a_display_is_never_so_coarse_that_it_shows_nothing() {
        let mut dice = Dice::new(5, "machines");
        let machine = Generator::Twin.machine(Mode::Plain, &mut dice);
        let coarse = scaled(&machine, ("quantisation", ""), 1.0, Plan::Small, 5.0, 9).unwrap();
        assert!(coarse.visible && coarse.level < 5.0, "{}", coarse.level);
        let shown = coarse.truth.shown(Plan::Small, 9).unwrap();
        assert!((0.8..1.3).contains(&(shown / coarse.level)), "{shown} instead of {}", coarse.level);
        let scale = scaled(&machine, ("scale", "x"), 1.0, Plan::Small, 5.0, 9).unwrap();
        assert_eq!(scale.level, 5.0);
    }
}
