//! The evidence of each chosen effect: its gain beside the others and what explains nearly as much in its place. Nothing is
//! decided here: that is [`super::decision`].

use rayon::prelude::*;

use super::constants::{CURVE_SAME, HALF, INEXACT, NEARLY};
use super::decision::Evidence;
use super::library::{Label, Library, Shape};
use super::search::{CURVES, Found, Problem, SAME_NOISE, Selection, Whole, figures};

/// Collects the evidence of every chosen effect, whose columns are prepared.
#[must_use]
pub fn assess(problem: &Problem, library: &Library, selection: &Selection) -> Vec<Evidence> {
    let whole = Whole::new(problem, &selection.chosen);
    let places = (0..selection.chosen.len()).into_par_iter();
    places.map(|place| assess_one((problem, library, selection, &whole), place)).collect()
}

/// Takes out of the selection, one by one, what makes readings that were left out worse: beside it nothing else can be
/// judged. What was taken out is returned with its evidence.
pub fn prune(problem: &Problem, library: &Library, selection: &mut Selection) -> Vec<Evidence> {
    let mut out = Vec::new();
    while !selection.chosen.is_empty() {
        let worst = assess(problem, library, selection)
            .into_iter()
            .enumerate()
            .min_by(|(_, a), (_, b)| a.figures.held_out.total_cmp(&b.figures.held_out));
        match worst {
            Some((place, x)) if x.figures.held_out < 0.0 => {
                selection.chosen.remove(place);
                out.push(Evidence { is_pruned: true, ..x });
            }
            _ => break,
        }
    }
    out
}

fn assess_one(
    (problem, library, selection, whole): (&Problem, &Library, &Selection, &Whole),
    place: usize,
) -> Evidence {
    let variant = selection.chosen[place];
    let label = library.variants[variant].label;
    let rest = whole.joint.without(problem, &[place]);
    let own = selection.brings(library, variant, rest.gain(variant));
    let mut taken: Vec<usize> = rest.others.iter().map(|v| library.variants[*v].label).collect();
    // beside a lag that is in, another one is the difference of two lags: an acceleration under a wrong name
    if !is_lag(library, label) && taken.iter().any(|l| is_lag(library, *l)) {
        taken.extend((0..library.labels.len()).filter(|l| is_lag(library, *l)));
    }
    let gain = rest.gains();
    let ranking = selection.ranked(library, &gain, &taken);
    let shape = &library.variants[variant].shape;
    let with_lines = shape.allows_lines() || library.may_be_a_slope(shape);
    let largest = largest_gains(library, &gain, &taken, with_lines);
    let mut same: Vec<Label> = largest
        .iter()
        .enumerate()
        .filter(|(l, gain)| {
            let share =
                if one_curve(&library.labels[label], &library.labels[*l]) { CURVE_SAME } else { NEARLY };
            *l != label && (is_same(**gain, own.gain, share) || selection.one_curve.contains(&(label, *l)))
        })
        .map(|(l, _)| library.labels[l].clone())
        .collect();
    same.extend(library.behind(shape).cloned());
    same.extend(slope_of(problem, library, selection, place, own.gain, &same));
    // where its variation stands among the noise, evidence has been discounted already
    let is_varied = problem.variation().is_some_and(|v| v.of(label).is_some());
    let inexact = INEXACT[usize::from(is_varied)];
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
    Evidence {
        variant,
        label: library.labels[label].clone(),
        kind: library.kinds[label],
        found: own,
        figures: figures(problem, library, whole, variant, own.gain),
        same,
        sums: Vec::new(),
        share: 1.0 / total,
        group_share: in_group / total,
        rivals,
        is_pruned: false,
    }
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
    let more =
        |p: &usize| is_part || problem.gain_beside(&selection.without(&[*p]), selection.chosen[*p]).0 > gain;
    curves.filter(more).map(|p| library.labels[library.variants[selection.chosen[p]].label].clone()).collect()
}

/// True where an effect in the place of another one explains as much as it but for a share of it and what noise takes.
pub fn is_same(gain: f64, own: f64, share: f64) -> bool {
    gain >= share * own - SAME_NOISE && gain > HALF * own
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
    library: &Library,
    gain: &dyn Fn(usize) -> (f64, usize),
    not: &[usize],
    with_lines: bool,
) -> Vec<f64> {
    let mut best = vec![0.0f64; library.labels.len()];
    for (v, variant) in library.variants.iter().enumerate() {
        if !not.contains(&variant.label) && (with_lines || !variant.shape.has_slope()) {
            best[variant.label] = best[variant.label].max(gain(v).0);
        }
    }
    best
}
