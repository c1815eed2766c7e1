//! From chosen effects to causes: alternatives, gates, probability.
//!
//! The log odds of an effect are linear in the logarithm of its evidence, in its deviation between programs, places and runs
//! (random effects, [`Gates::between`]), in how far it takes back what the others say, and in its growth along other axes; times
//! its share among the effects that explain nearly as much. The five constants, all in [`Calibration`], were fitted to blind
//! cases of two generators and judged on a third one (docs/development/ablation.md).

use super::library::{Kind, Label, Library, Shape, forms};
use super::search::{CURVES, Found, Gates, Problem, Selection, evidence, gates};

/// Share of its gain that a swapped effect must keep to count as the same, what noise takes of it, and the share that noise
/// must not take.
const SAME: f64 = 0.97;
const SAME_NOISE: f64 = 4.0;
const SAME_LEAST: f64 = 0.5;
/// The same for a table of positions and a worn place of one axis: what a worn place looks like nobody knows so well.
const CURVE_SAME: f64 = 0.85;
/// An effect is declared from this probability of its group.
pub const DECLARED: f64 = 0.6;
/// And from this one of its own: below, its name is one of many.
pub const NAMED: f64 = 0.15;

/// Constants of the log odds.
#[derive(Debug, Clone, Copy)]
struct Calibration {
    base: f64,
    /// Per unit of the logarithm of the evidence.
    evidence: f64,
    /// Per unit of the deviation between parts, relative to the effect.
    between: f64,
    /// Per unit of the cosine with what the others do, where it is negative.
    against: f64,
    /// Per unit of growth along another axis, up to `grows_most`.
    grows: f64,
    grows_most: f64,
    /// Models are never exact: evidence counts less the larger an effect is; the second where it was asked how it varies.
    temper: [f64; 2],
}

const CALIBRATION: Calibration = Calibration {
    base: -2.65,
    evidence: 0.84,
    between: 5.0,
    against: 4.0,
    grows: 1.8,
    grows_most: 1.5,
    temper: [0.008, 0.001],
};

/// Growth along another axis from which a function of one axis is none; the second where effects vary anyhow, and this one
/// varies by more than an effect does by chance.
const GROWS: [f64; 2] = [0.4, 0.7];
const VARIES: f64 = 0.34;
/// Growth with a temperature from which a function of a position is none.
const WARMS: f64 = 0.5;
/// Share of an expansion that a scale may say in its place.
const STAYS: f64 = 0.5;

/// Said of curves that nothing shows twice.
const ONE_PASS: &str =
    "a curve over one pass of one programme: nothing shows that it comes back; measure again";

/// A chosen effect with its figures.
#[derive(Debug, Clone)]
pub struct Assessed {
    /// The variant.
    pub variant: usize,
    /// Its label.
    pub label: Label,
    /// Who is to blame.
    pub kind: Kind,
    /// Its gain and evidence beside the others.
    pub found: Found,
    /// Figures of the gates.
    pub gates: Gates,
    /// Labels that keep nearly all of its gain.
    pub same: Vec<Label>,
    /// Probability that this effect, or one of `same`, is at work.
    pub group_probability: f64,
    /// Probability of this very effect.
    pub probability: f64,
    /// Its share among the effects that explain nearly as much.
    pub share: f64,
    /// The share of its group.
    pub group_share: f64,
    /// Alternatives and their probability, best first.
    pub alternatives: Vec<(Label, f64)>,
    /// The tool stands by it.
    pub declared: bool,
    /// Why not.
    pub remark: String,
}

/// Assesses every chosen effect.
pub fn assess(problem: &mut Problem, library: &Library, selection: &Selection) -> Vec<Assessed> {
    for v in &selection.chosen {
        problem.prepare(*v);
    }
    (0..selection.chosen.len()).map(|place| assess_one(problem, library, selection, place)).collect()
}

/// What is left of a probability where a gate says no.
const UNSURE: f64 = 0.1;
/// Least probability of what was chosen: in blind cases one in thirty of those that fail is at work.
const LEAST: f64 = 0.03;

/// Probability that an effect of this evidence and these figures is at work, whatever may stand for it.
fn real(evidence: f64, g: &Gates, passes: bool) -> f64 {
    LEAST + (1.0 - LEAST) * logistic(evidence, g) * if passes { 1.0 } else { UNSURE }
}

/// Takes out of the selection, one by one, what makes readings that were left out worse: beside it nothing else can be
/// judged. What was taken out is returned as it was assessed.
pub fn prune(problem: &mut Problem, library: &Library, selection: &mut Selection) -> Vec<Assessed> {
    let mut out = Vec::new();
    while !selection.chosen.is_empty() {
        let worst = assess(problem, library, selection)
            .into_iter()
            .enumerate()
            .min_by(|(_, a), (_, b)| a.gates.held_out.total_cmp(&b.gates.held_out));
        match worst {
            Some((place, x)) if x.gates.held_out < 0.0 => {
                selection.chosen.remove(place);
                out.push(x);
            }
            _ => break,
        }
    }
    out
}

fn assess_one(problem: &Problem, library: &Library, selection: &Selection, place: usize) -> Assessed {
    let variant = selection.chosen[place];
    let label = library.variants[variant].label;
    let others: Vec<usize> =
        selection.chosen.iter().enumerate().filter(|(i, _)| *i != place).map(|(_, v)| *v).collect();
    let given = problem.given(&others);
    let (gain, rank) = problem.gain(&given, variant);
    let own = Found { variant, gain, rank, evidence: evidence(gain, rank, selection.grid[label]) };
    let mut taken: Vec<usize> = others.iter().map(|v| library.variants[*v].label).collect();
    // beside a lag that is in, another one is the difference of two lags: an acceleration under a wrong name
    if !is_lag(library, label) && taken.iter().any(|l| is_lag(library, *l)) {
        taken.extend((0..library.labels.len()).filter(|l| is_lag(library, *l)));
    }
    let ranking = selection.ranking(problem, library, &given, &taken);
    let shape = &library.variants[variant].shape;
    let with_lines = shape.allows_lines() || library.may_be_a_slope(shape);
    let largest = largest_gains(problem, library, &given, &taken, with_lines);
    let g = gates(problem, library, selection, place, own.gain);
    let mut same: Vec<Label> = largest
        .iter()
        .enumerate()
        .filter(|(l, gain)| {
            let share =
                if one_curve(&library.labels[label], &library.labels[*l]) { CURVE_SAME } else { SAME };
            *l != label && (is_same(**gain, own.gain, share) || selection.one_curve.contains(&(label, *l)))
        })
        .map(|(l, _)| library.labels[l].clone())
        .collect();
    same.extend(library.behind(shape).cloned());
    same.extend(slope_of(problem, library, selection, place, gain, &same));
    // where its variation stands among the noise, evidence has been discounted already
    let is_varied = problem.variation().is_some_and(|v| v.of(label).is_some());
    let inexact = CALIBRATION.temper[usize::from(is_varied)];
    let temper = 2.0 * (1.0 + inexact * own.gain);
    let weight = |f: &Found| ((f.evidence - own.evidence) / temper).min(0.0).exp();
    let rivals: Vec<(Label, f64)> = ranking
        .iter()
        .filter(|f| library.variants[f.variant].label != label && f.evidence > 0.0)
        .map(|f| (library.labels[library.variants[f.variant].label].clone(), weight(f)))
        .filter(|(_, w)| *w > 1e-4)
        .collect();
    let total = 1.0 + rivals.iter().map(|(_, w)| w).sum::<f64>();
    let in_group = 1.0 + rivals.iter().filter(|(l, _)| same.contains(l)).map(|(_, w)| w).sum::<f64>();
    let mut remark = String::new();
    if problem.is_single_pass && shape.is_free_curve() {
        remark = ONE_PASS.to_owned();
    }
    if remark.is_empty() && cancelling(problem, library, selection, place) > CANCELLING {
        remark = "fits only by large terms that cancel each other: stands for something else".to_owned();
    }
    if remark.is_empty() && turn_share(problem, library, selection, place) > TURN_SHARE {
        remark = "is the same at every position: a lost motion, not a table of positions".to_owned();
    }
    if remark.is_empty() && only_shifts(problem, library, selection, place) {
        remark =
            "shifts with the temperature, but does not expand: something else that grows warm".to_owned();
    }
    let group_probability = real(own.evidence, &g, remark.is_empty()) * in_group / total;
    let probability = group_probability / in_group;
    let alternatives = rivals.into_iter().map(|(l, w)| (l, group_probability / in_group * w)).collect();
    Assessed {
        variant,
        label: library.labels[label].clone(),
        kind: library.kinds[label],
        found: own,
        declared: remark.is_empty() && group_probability >= DECLARED && probability >= NAMED,
        remark,
        share: 1.0 / total,
        group_share: in_group / total,
        gates: g,
        same,
        group_probability,
        probability,
        alternatives,
    }
}

/// Largest term of a power series, as a multiple of the whole: a real angle that is zero at the zero of its axis needs less.
const CANCELLING: f64 = 250.0;

/// True where an effect chosen is such a power series.
pub(super) fn cancels(problem: &Problem, library: &Library, selection: &Selection) -> bool {
    (0..selection.chosen.len()).any(|place| cancelling(problem, library, selection, place) > CANCELLING)
}

/// The largest term of an angular error over the RMS of all of them, whitened; 0 for other effects.
fn cancelling(problem: &Problem, library: &Library, selection: &Selection, place: usize) -> f64 {
    let variant = selection.chosen[place];
    let Shape::Angular(forms::Angular { degree, .. }) = library.variants[variant].shape else { return 0.0 };
    let given = problem.given(&selection.chosen);
    let beta = problem.fit(&given);
    let (at, _) = problem.span[variant];
    let (mine, values): (Vec<usize>, Vec<f64>) =
        given.columns.iter().zip(&beta).filter(|(c, _)| (at..at + degree).contains(*c)).unzip();
    let all = problem.contribution(&mine, &values).norm();
    // columns have length 1, so the values are the lengths of the terms
    let largest = values.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    if all > 0.0 { largest / all } else { 0.0 }
}

/// Share of a table with values in reverse that a constant reversal may have.
const TURN_SHARE: f64 = 0.5;

/// Share of the constant reversal in what a table with values of its own in reverse does.
fn turn_share(problem: &Problem, library: &Library, selection: &Selection, place: usize) -> f64 {
    let variant = selection.chosen[place];
    let Shape::Reverse(forms::Reverse { high, .. }) = library.variants[variant].shape else { return 0.0 };
    let given = problem.given(&selection.chosen);
    let beta = problem.fit(&given);
    let (at, k) = problem.span[variant];
    let (mine, values): (Vec<usize>, Vec<f64>) =
        given.columns.iter().zip(&beta).filter(|(c, _)| (at..at + k).contains(*c)).unzip();
    let all = problem.contribution(&mine, &values).norm_squared();
    let constant = problem.contribution(&mine[high - 1..high], &values[high - 1..high]).norm_squared();
    if all > 0.0 { constant / all } else { 0.0 }
}

/// The curves chosen whose slope an effect may be, or a straight line that is the same as it (`same`): it was measured over a
/// part of the travel, or says less than they do; from which line a curve is counted is a choice.
fn slope_of(
    problem: &Problem,
    library: &Library,
    selection: &Selection,
    place: usize,
    gain: f64,
    same: &[Label],
) -> Vec<Label> {
    let shape = &library.variants[selection.chosen[place]].shape;
    let is_part = library.may_be_a_slope(shape);
    let alike = library.variants.iter().filter(|v| same.contains(&library.labels[v.label])).map(|v| &v.shape);
    let lines: Vec<&Shape> = std::iter::once(shape).chain(alike).collect();
    let curve = |p: usize| &library.variants[selection.chosen[p]].shape;
    let is_slope_of = |p: usize| lines.iter().any(|line| line.may_be_the_slope_of(curve(p)));
    let curves = (0..selection.chosen.len()).filter(|p| *p != place && is_slope_of(*p));
    let more = |p: &usize| {
        is_part || problem.gain(&problem.given(&selection.without(&[*p])), selection.chosen[*p]).0 > gain
    };
    curves.filter(more).map(|p| library.labels[library.variants[selection.chosen[p]].label].clone()).collect()
}

/// Standard deviations from which an expansion is sure.
const EXPANDS_T: f64 = 3.0;

/// True for an expansion of which only the shift of its reference is sure.
fn only_shifts(problem: &Problem, library: &Library, selection: &Selection, place: usize) -> bool {
    let variant = selection.chosen[place];
    if !matches!(library.variants[variant].shape, Shape::Thermal(forms::Thermal { with_offset: true, .. })) {
        return false;
    }
    let given = problem.given(&selection.chosen);
    let (beta, covariance) = (problem.fit(&given), given.covariance(problem));
    let (at, _) = problem.span[variant];
    let Some(j) = given.columns.iter().position(|c| *c == at) else { return false };
    let t = |k: usize| beta[k].abs() / covariance[k * beta.len() + k].max(1e-300).sqrt();
    t(j) < EXPANDS_T && t(j + 1) > EXPANDS_T
}

/// True where an effect in the place of another one explains as much as it but for a share of it and what noise takes.
pub fn is_same(gain: f64, own: f64, share: f64) -> bool {
    gain >= share * own - SAME_NOISE && gain > SAME_LEAST * own
}

/// True for two names of a curve over the position of one axis.
fn one_curve(a: &Label, b: &Label) -> bool {
    a.subject == b.subject && CURVES.contains(&a.effect) && CURVES.contains(&b.effect)
}

fn is_lag(library: &Library, label: usize) -> bool {
    ["servo-mismatch", "latency", "clock-skew"].contains(&library.labels[label].effect)
}

/// The largest gain of each label, whatever its number of parameters; with lines of their own for curves where the effect that
/// they would replace needs none.
fn largest_gains(
    problem: &Problem,
    library: &Library,
    given: &super::search::Given,
    not: &[usize],
    with_lines: bool,
) -> Vec<f64> {
    let mut best = vec![0.0f64; library.labels.len()];
    for (v, variant) in library.variants.iter().enumerate() {
        if !not.contains(&variant.label) && (with_lines || !variant.shape.has_slope()) {
            best[variant.label] = best[variant.label].max(problem.gain(given, v).0);
        }
    }
    best
}

fn logistic(evidence: f64, g: &Gates) -> f64 {
    let c = CALIBRATION;
    let z = c.base + c.evidence * evidence.max(1.0).ln()
        - c.between * g.between
        - c.against * (-g.against).max(0.0)
        - c.grows * g.grows.clamp(0.0, c.grows_most);
    1.0 / (1.0 + (-z).exp())
}

impl Assessed {
    /// Takes back what was declared.
    pub fn doubt(&mut self, why: String) {
        self.remark = why;
        self.settle();
    }

    /// The position of another axis changes it, as [`Gates::grows`] says: what is a function of one axis alone is not at work.
    pub fn reject_growing(&mut self, along: &str) {
        let varies = self.gates.varies > 0.0;
        let by_chance = varies && self.gates.varies <= VARIES;
        if self.gates.grows > GROWS[usize::from(varies)] && !by_chance && self.remark.is_empty() {
            let percent = 100.0 * self.gates.grows;
            self.remark = format!(
                "is not the same wherever {along} stands: {percent:.0} % more or less at its ends than in its middle"
            );
        }
    }

    /// A temperature changes it, by a share from the middle to the ends: what is a function of a position alone is not at work.
    pub fn reject_warming(&mut self, share: f64) {
        if share > WARMS && self.remark.is_empty() {
            let percent = 100.0 * share;
            self.remark = format!(
                "is not the same at every temperature: {percent:.0} % more or less at the ends than in the middle"
            );
        }
    }

    /// A share of an expansion is there whether it is warm or cold: a scale of its axis.
    pub fn reject_staying(&mut self, share: f64) {
        if share > STAYS && self.remark.is_empty() {
            let percent = 100.0 * share;
            self.remark = format!("does not come and go with the temperature: {percent:.0} % of it stay");
        }
    }

    /// Sets the probability by the figures, with those that were found meanwhile.
    pub fn settle(&mut self) {
        let before = self.probability;
        let real = real(self.found.evidence, &self.gates, self.remark.is_empty());
        (self.probability, self.group_probability) = (real * self.share, real * self.group_share);
        self.declared =
            self.remark.is_empty() && self.group_probability >= DECLARED && self.probability >= NAMED;
        let scale = self.probability / before.max(1e-12);
        self.alternatives.iter_mut().for_each(|(_, p)| *p *= scale);
    }
}

/// Deviation between parts, relative to the effect, that is worth a word.
const DEVIATES: f64 = 0.3;
/// Cosine with the others that is worth a word.
const TAKES_BACK: f64 = -0.7;

impl Assessed {
    /// Why it is not declared; empty where it is.
    #[must_use]
    pub fn why_not(&self) -> String {
        if self.declared || !self.remark.is_empty() {
            return self.remark.clone();
        }
        let mut why = Vec::new();
        let percent = 100.0 * self.gates.between;
        if self.gates.between > DEVIATES {
            why.push(format!("differs between programs, places or runs by {percent:.0} % of itself"));
        }
        if self.gates.against < TAKES_BACK {
            why.push("takes back what the other effects say".to_owned());
        }
        if why.is_empty() {
            why.push(format!("posterior probability {:.2}", self.probability));
        }
        why.join("; ")
    }
}

#[cfg(test)]
mod tests {
    use super::{Gates, logistic};

    const GOOD: Gates = Gates { between: 0.05, breadth: 10.0, ..Gates::UNASKED };

    #[test]
    fn whatever_speaks_against_an_effect_lowers_its_probability() {
        let best = logistic(500.0, &GOOD);
        assert!(best > 0.9, "{best}");
        for worse in
            [Gates { between: 0.5, ..GOOD }, Gates { against: -0.5, ..GOOD }, Gates { grows: 0.5, ..GOOD }]
        {
            assert!(logistic(500.0, &worse) < best - 0.03, "{worse:?}");
        }
        assert!(logistic(30.0, &GOOD) < best - 0.03);
        // parts that differ as much as the effect is large
        let bad = Gates { between: 1.2, ..GOOD };
        assert!(logistic(500.0, &bad) < 0.3);
    }
}
