//! Which effects: forward, every effect swapped against all others after each step, two merged into one, backward.
//!
//! Evidence is twice the logarithm of a Bayes factor with a locally fitted g-prior, less a price for the grid of the
//! non-linear parameters. The threshold is what the library finds in pure noise.
//! Source: `docs/explanation/diagnosis.md` (search, one name).

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::super::constants::{LITTLE, MOST, NEARLY, SURE};
use super::super::library::{Library, Shape, Variant, forms};
use super::super::noise::Random;
use super::joint::Joint;
use super::pivoted_cholesky::Factor;
use super::problem::{Given, Problem};

/// Price of a parameter beside its g-prior.
const PARAMETER_PRICE: f64 = 0.7;
/// A further effect brings at least this share of the number of readings, and of the energy that earlier effects have where it acts.
/// At 2 % what stands for something outside the library is not chosen, and nothing says that it is there.
const FURTHER_SHARE: f64 = 0.006;
const CELL_SHARE: f64 = 0.015;
/// Draws of pure noise.
const DRAWS: usize = 96;
/// Share of the draws below the threshold.
const QUANTILE: f64 = 0.98;
/// Margin above what noise reaches.
const MARGIN: f64 = 4.0;
/// The same for the control's own encoders, whose following error a lag describes to a small share.
const PRECISE_SHARE: f64 = 5e-7;
/// Names of one curve over the position of an axis: what one of them leaves, the other takes.
pub const CURVES: [&str; 2] = ["positioning", "wear"];
/// A scale is a curve over the same position, too; beside it, or it beside them, the smaller must have this share of the larger:
/// nothing is straight to the last share.
const STRAIGHT: &str = "scale";
/// Names of what happens at a reversal of an axis, and the share of the larger that the smaller must have: how lost motion
/// builds up and friction breaks loose is known no better.
const REVERSALS: [&str; 2] = ["backlash", "reversal-spike"];
/// What noise takes of the gain of a swapped effect.
pub const SAME_NOISE: f64 = 4.0;
/// Variants that one processor takes at a time.
const TOGETHER: usize = 16;
/// A swap must bring this much evidence.
pub const SWAP_GAIN: f64 = 0.5;

/// Twice the logarithm of the Bayes factor of an effect.
#[must_use]
pub fn evidence(gain: f64, rank: usize, grid: usize) -> f64 {
    let price = 2.0 * (grid.max(1) as f64).ln();
    let k = rank as f64;
    if rank == 0 || gain <= k {
        return -k - price;
    }
    gain - k - k * (gain / k).ln() - PARAMETER_PRICE * k - price
}

/// A selection in progress.
#[derive(Debug, Clone, Default)]
pub struct Selection {
    /// The variants chosen, in the order of their choice.
    pub chosen: Vec<usize>,
    /// Evidence that noise alone reaches.
    pub threshold: f64,
    /// Number of variants of each label.
    pub grid: Vec<usize>,
    /// Forward steps only: to show what the others are good for.
    pub is_plain: bool,
    /// Variants that came out as no body can behave, or as the second name of something.
    pub banned: Vec<usize>,
    /// Labels of one curve that needed two names, the one that stayed first.
    pub one_curve: Vec<(usize, usize)>,
}

/// The evidence that the library finds in pure noise.
#[must_use]
pub fn threshold(problem: &Problem, library: &Library, grid: &[usize], seed: u64) -> f64 {
    let mut random = Random::new(seed);
    let n = problem.len();
    let noise = DMatrix::from_fn(n, DRAWS, |_, _| random.normal());
    let products = problem.products(&noise);
    let factors: Vec<_> = library
        .variants
        .par_iter()
        .enumerate()
        .map(|(v, _)| {
            let full = problem.full(problem.columns(v));
            Factor::new(full.len(), &problem.own[v], &full)
        })
        .collect();
    let products: Vec<_> = products.column_iter().collect();
    let mut highest: Vec<f64> = products
        .par_iter()
        .map(|b| {
            factors
                .iter()
                .zip(&library.variants)
                .zip(&problem.span)
                .map(|((f, v), (at, k))| {
                    evidence(f.gain(&b.as_slice()[*at..at + k]), f.rank(), grid[v.label])
                })
                .fold(f64::NEG_INFINITY, f64::max)
        })
        .collect();
    highest.sort_by(f64::total_cmp);
    let at = ((QUANTILE * DRAWS as f64) as usize).min(DRAWS - 1);
    highest[at].max(0.0) + MARGIN
}

/// An alternative and what it brings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// The variant.
    pub variant: usize,
    /// Drop of the sum of squares.
    pub gain: f64,
    /// Independent columns.
    pub rank: usize,
    /// Evidence.
    pub evidence: f64,
}

/// The variants but those at some places.
pub(super) fn others(variants: &[usize], places: &[usize]) -> Vec<usize> {
    variants.iter().enumerate().filter(|(i, _)| !places.contains(i)).map(|(_, v)| *v).collect()
}

fn labels(library: &Library, variants: &[usize]) -> Vec<usize> {
    variants.iter().map(|v| library.variants[*v].label).collect()
}

impl Selection {
    /// The best variant of every label, best first, by what each brings: drop of the sum of squares, and the number of its independent
    /// columns; labels of `not` are left out.
    pub(crate) fn ranked(
        &self,
        library: &Library,
        gain: &(dyn Fn(usize) -> (f64, usize) + Sync),
        not: &[usize],
    ) -> Vec<Found> {
        let found = |(v, variant): (usize, &Variant)| {
            let is_asked =
                !not.contains(&variant.label) && !variant.shape.has_slope() && !self.banned.contains(&v);
            is_asked.then(|| self.brings(library, v, gain(v)))
        };
        let variants = library.variants.par_iter().with_min_len(TOGETHER).enumerate();
        let found: Vec<Option<Found>> = variants.map(found).collect();
        let mut best: Vec<Option<Found>> = vec![None; library.labels.len()];
        for found in found.into_iter().flatten() {
            let best = &mut best[library.variants[found.variant].label];
            if best.is_none_or(|b| found.evidence > b.evidence) {
                *best = Some(found);
            }
        }
        let mut all: Vec<Found> = best.into_iter().flatten().collect();
        all.sort_by(|a, b| b.evidence.total_cmp(&a.evidence).then(a.variant.cmp(&b.variant)));
        all
    }

    /// What a variant brings beside what is given.
    #[must_use]
    pub fn found(&self, problem: &Problem, library: &Library, given: &Given, variant: usize) -> Found {
        self.brings(library, variant, problem.gain(given, variant))
    }

    /// What a variant brings beside others (prepared).
    fn found_beside(&self, problem: &Problem, library: &Library, others: &[usize], variant: usize) -> Found {
        self.brings(library, variant, problem.gain_beside(others, variant))
    }

    pub(crate) fn brings(&self, library: &Library, variant: usize, (gain, rank): (f64, usize)) -> Found {
        let evidence = evidence(gain, rank, self.grid[library.variants[variant].label]);
        Found { variant, gain, rank, evidence }
    }

    /// Evidence of all that is chosen, each beside those before it.
    #[must_use]
    pub fn evidence(&self, problem: &mut Problem, library: &Library) -> f64 {
        self.evidence_beside(problem, library, &[], &self.chosen)
    }

    /// Evidence of some variants, each beside what is known and those before it.
    pub(super) fn evidence_beside(
        &self,
        problem: &mut Problem,
        library: &Library,
        known: &[usize],
        some: &[usize],
    ) -> f64 {
        let all = [known, some].concat();
        problem.prepare(&all);
        let own = |n: usize| self.found_beside(problem, library, &all[..n], all[n]).evidence;
        (known.len()..all.len()).map(own).sum()
    }

    /// Begins again with some variants, less those that are superfluous beside the others.
    pub fn restart(&mut self, problem: &mut Problem, library: &Library, chosen: &[usize]) {
        self.chosen = chosen.to_vec();
        self.banned.clear();
        self.one_curve.clear();
        self.backward(problem, library);
    }

    /// Everything chosen but some places.
    #[must_use]
    pub fn without(&self, places: &[usize]) -> Vec<usize> {
        others(&self.chosen, places)
    }

    pub(super) fn given(problem: &mut Problem, chosen: &[usize]) -> Given {
        problem.prepare(chosen);
        problem.given(chosen)
    }

    /// Runs the search from what is chosen.
    pub fn search(&mut self, problem: &mut Problem, library: &Library) {
        if self.chosen.len() >= MOST {
            return;
        }
        // what led back to where the search has been: one effect in the place of two may say less than both
        let (mut in_vain, mut seen): (Vec<usize>, Vec<Vec<usize>>) = (Vec::new(), vec![self.state()]);
        let mut joint = Joint::new(problem, &self.chosen);
        for _ in 0..4 * MOST {
            if self.chosen.len() >= MOST {
                break;
            }
            let labels = labels(library, &self.chosen);
            let ranking = self.ranked(library, &|v| joint.gain(problem, v), &labels);
            let next = ranking
                .iter()
                .take_while(|f| f.evidence > self.threshold)
                .take(MOST)
                .find(|f| !in_vain.contains(&f.variant) && self.may_join(problem, &joint, f))
                .copied();
            let Some(next) = next else { break };
            self.chosen.push(next.variant);
            joint.follow(problem, &self.chosen);
            if self.is_plain {
                continue;
            }
            self.swap_in(&mut joint, problem, library);
            self.merge_in(&joint, problem, library);
            self.backward_in(&mut joint, problem, library);
            let state = self.state();
            if seen.contains(&state) {
                in_vain.push(next.variant);
            } else {
                seen.push(state);
            }
        }
    }

    /// The chosen variants in no order of choice.
    fn state(&self) -> Vec<usize> {
        let mut state = self.chosen.clone();
        state.sort_unstable();
        state
    }

    /// A further effect must matter where it acts, or it is the misfit of a larger one.
    fn may_join(&self, problem: &Problem, joint: &Joint, found: &Found) -> bool {
        if self.chosen.is_empty() || self.is_plain {
            return true;
        }
        if found.gain < FURTHER_SHARE * problem.len() as f64 {
            return false;
        }
        let earlier = problem.contribution(&joint.given.columns, &joint.beta);
        let own: Vec<usize> = problem.columns(found.variant).collect();
        let mut energy = vec![0.0; problem.cells];
        let mut acts = vec![0.0; problem.cells];
        for (i, row) in problem.whitened_rows(&own).column_iter().enumerate() {
            let cell = problem.cell[i];
            energy[cell] += earlier[i] * earlier[i];
            acts[cell] += row.norm_squared();
        }
        let total: f64 = acts.iter().sum();
        let where_it_acts: f64 =
            energy.iter().zip(&acts).filter(|(_, a)| **a > 0.01 * total).map(|(e, _)| e).sum();
        let share = if problem.precise { PRECISE_SHARE } else { CELL_SHARE };
        found.gain >= share * where_it_acts
    }

    /// Swaps every effect against all others until nothing changes.
    pub fn swap(&mut self, problem: &mut Problem, library: &Library) {
        self.swap_in(&mut Joint::new(problem, &self.chosen), problem, library);
    }

    fn swap_in(&mut self, joint: &mut Joint, problem: &mut Problem, library: &Library) {
        for _ in 0..4 {
            let (mut changed, mut first) = (false, 0);
            while first < self.chosen.len() {
                let better = |place: usize| {
                    let (rest, own) = (joint.without(problem, &[place]), self.chosen[place]);
                    let labels = labels(library, &rest.others);
                    let now = self.brings(library, own, rest.gain(own)).evidence;
                    let best = self.ranked(library, &rest.gains(), &labels).first().copied()?;
                    (best.evidence > now + SWAP_GAIN && best.variant != own).then_some((place, best.variant))
                };
                let places = (first..self.chosen.len()).into_par_iter();
                let Some((place, variant)) = places.find_map_first(better) else { break };
                self.chosen[place] = variant;
                joint.follow(problem, &self.chosen);
                (changed, first) = (true, place + 1);
            }
            if !changed {
                break;
            }
        }
    }

    /// One effect in the place of two, where it explains as much.
    pub fn merge(&mut self, problem: &mut Problem, library: &Library) {
        self.merge_in(&Joint::new(problem, &self.chosen), problem, library);
    }

    fn merge_in(&mut self, joint: &Joint, problem: &Problem, library: &Library) {
        let last = self.alone(joint, problem, library);
        let instead = |(a, b): (usize, usize)| {
            let (rest, first, second) = (joint.without(problem, &[a, b]), self.chosen[a], self.chosen[b]);
            let now = self.brings(library, first, rest.gain(first)).evidence + last[b];
            let labels = labels(library, &rest.others);
            let best = self.ranked(library, &rest.gains(), &labels).first().copied()?;
            let is_one = best.evidence > now
                || best.evidence > NEARLY * now && problem.cosine(&joint.given, [first, second]) < -NEARLY;
            is_one.then(|| [&rest.others[..], &[best.variant]].concat())
        };
        let n = self.chosen.len();
        let pairs: Vec<(usize, usize)> = (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b))).collect();
        if let Some(chosen) = pairs.into_par_iter().find_map_first(instead) {
            self.chosen = chosen;
        }
    }

    /// Evidence of each effect beside all others.
    fn alone(&self, joint: &Joint, problem: &Problem, library: &Library) -> Vec<f64> {
        let evidence = |(place, v): (usize, &usize)| {
            self.brings(library, *v, joint.without(problem, &[place]).gain(*v)).evidence
        };
        self.chosen.par_iter().enumerate().map(evidence).collect()
    }

    /// Leaves one name to what is one thing with two: a table of positions and a worn place of the same axis, lost motion and
    /// a little of a reversal spike. The other name is not looked for any more.
    pub fn single_out(&mut self, problem: &mut Problem, library: &Library) {
        while let Some((stays, goes)) = self.doubled(problem, library) {
            let label = library.variants[self.chosen[goes]].label;
            self.ban(library, label);
            let kept = library.variants[self.chosen[stays]].label;
            if [kept, label].iter().all(|l| CURVES.contains(&library.labels[*l].effect)) {
                self.one_curve.push((kept, label));
            }
            let others = self.without(&[stays, goes]);
            let given = Self::given(problem, &others);
            self.chosen[stays] = self.best_of(problem, library, &given, self.chosen[stays]);
            self.chosen.remove(goes);
            self.search(problem, library);
        }
    }

    /// Looks for an effect no more.
    pub(super) fn ban(&mut self, library: &Library, label: usize) {
        let variants = library.variants.iter().enumerate().filter(|(_, v)| v.label == label);
        self.banned.extend(variants.map(|(v, _)| v));
    }

    /// The best variant of the effect of `own` beside what is given.
    pub(super) fn best_of(&self, problem: &Problem, library: &Library, given: &Given, own: usize) -> usize {
        let label = library.variants[own].label;
        let value = |v: usize| (self.found(problem, library, given, v).evidence, v);
        let others = library
            .variants
            .iter()
            .enumerate()
            .filter(|(v, variant)| variant.label == label && !variant.shape.has_slope() && *v != own);
        others.map(|(v, _)| value(v)).fold(value(own), |best, f| if f.0 > best.0 { f } else { best }).1
    }

    /// Of a table of positions and a worn place the one that stays, first: the worn place where the table has next to nothing
    /// to say beside it, for a table can say any worn place.
    fn truer(&self, problem: &mut Problem, table: usize, worn: usize) -> (usize, usize) {
        problem.prepare(&self.chosen);
        let alone = problem.gain_beside(&self.without(&[table, worn]), self.chosen[worn]).0;
        let more = problem.gain_beside(&self.without(&[table]), self.chosen[table]).0;
        if more < LITTLE * alone { (worn, table) } else { (table, worn) }
    }

    /// Two names for one thing: the place that stays and the place that goes.
    fn doubled(&self, problem: &mut Problem, library: &Library) -> Option<(usize, usize)> {
        let label = |place: usize| &library.labels[library.variants[self.chosen[place]].label];
        for a in 0..self.chosen.len() {
            for b in 0..self.chosen.len() {
                if label(a).subject != label(b).subject {
                    continue;
                }
                let names = [label(a).effect, label(b).effect];
                if names == CURVES {
                    return Some(self.truer(problem, a, b));
                }
                let least = match names {
                    REVERSALS => LITTLE,
                    [STRAIGHT, other] if CURVES.contains(&other) => LITTLE,
                    _ => continue,
                };
                problem.prepare(&self.chosen);
                let [first, second] =
                    [a, b].map(|place| problem.gain_beside(&self.without(&[place]), self.chosen[place]).0);
                if first.min(second) < least * first.max(second) {
                    return Some(if first > second { (a, b) } else { (b, a) });
                }
            }
        }
        None
    }

    /// Takes out what no body can do, and searches on without it: a ram whose two weights pull
    /// against each other, a beam that turns its end and does not drop.
    pub fn expel(&mut self, problem: &mut Problem, library: &Library) {
        while let Some(place) = self.impossible(problem, library) {
            self.banned.push(self.chosen.remove(place));
            self.search(problem, library);
        }
    }

    fn impossible(&self, problem: &mut Problem, library: &Library) -> Option<usize> {
        let given = Self::given(problem, &self.chosen);
        let beta = problem.fit(&given);
        let covariance = given.covariance(problem);
        let n = beta.len();
        (0..self.chosen.len()).find(|place| {
            let variant = self.chosen[*place];
            let (at, _) = problem.span[variant];
            let Some(j) = given.columns.iter().position(|c| *c == at) else { return false };
            let is_sure = |k: usize| beta[k].abs() > SURE * covariance[k * n + k].max(0.0).sqrt();
            match library.variants[variant].shape {
                Shape::Ram(_) => beta[j] * beta[j + 1] < 0.0 && is_sure(j) && is_sure(j + 1),
                Shape::Sag(forms::Sag { tool: true, .. }) => is_sure(j + 1) && !is_sure(j),
                _ => false,
            }
        })
    }

    /// Takes out what the others have made superfluous.
    fn backward(&mut self, problem: &mut Problem, library: &Library) {
        self.backward_in(&mut Joint::new(problem, &self.chosen), problem, library);
    }

    fn backward_in(&mut self, joint: &mut Joint, problem: &mut Problem, library: &Library) {
        loop {
            joint.follow(problem, &self.chosen);
            let each = self.alone(joint, problem, library);
            match (0..each.len()).min_by(|a, b| each[*a].total_cmp(&each[*b])) {
                Some(place) if each[place] < self.threshold => self.chosen.remove(place),
                _ => break,
            };
        }
    }
}
