//! From all sets of effects under all scales to what is believed.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{DMatrix, DVector};
use rayon::iter::{IntoParallelIterator, ParallelIterator};

use super::super::constants::{LEAST_PROBABILITY, MISFORM_RUNG, ROUNDS, SIGNIFICANT, STRONG, TIMES, TRIED};
use super::super::library::{Kind, Library, Shape};
use super::super::moment::Axis;
use super::super::search::raw_columns;
use super::super::session::Session;
use super::comparison::{Comparison, Contender, Shares};
use super::covariance::{Component, Covariance, Structure};
use super::gram::{Columns, Gram, Member};
use super::scales::{self, Rungs, Target};
use super::sets::{self, Sets};
use super::tails::points;
use volcomp_effects::prior_sd;

/// The state of the search under one set of weights.
pub(super) struct Search {
    pub(super) structure: Structure,
    /// Formula of each variant.
    shapes: Vec<Shape>,
    pub(super) columns: Columns,
    pub(super) y: DVector<f64>,
    pub(super) weights: Vec<f64>,
    /// Every pair of scales that was looked at.
    visited: BTreeMap<Rungs, (Gram, Sets)>,
    /// Log weights of the likely sets under these and neighbouring scales.
    beside: BTreeMap<Rungs, BTreeMap<Vec<usize>, f64>>,
}

impl Search {
    /// Climbs under some scales; returns the likeliest set there and its log weight.
    fn climb(&mut self, rungs: &Rungs, start: &[Member]) -> Option<(Vec<Member>, f64)> {
        if !self.visited.contains_key(rungs) {
            let covariance = Covariance::new(&self.structure, &scales::values(rungs), &self.weights)?;
            let gram = Gram::new(&covariance, &self.columns, &self.y);
            self.visited.insert(rungs.clone(), (gram, Sets::new()));
        }
        let (gram, sets) = self.visited.get_mut(rungs)?;
        sets::climb(gram, &self.columns, start, sets);
        let best = sets.values().max_by(|a, b| a.log_weight.total_cmp(&b.log_weight))?;
        Some((best.members.clone(), best.log_weight + scales::log_prior(rungs)))
    }

    /// The gap and the columns of a set with unit prior variance.
    fn target(&self, members: &[Member]) -> Target<'_> {
        let mut data = vec![self.y.clone()];
        for m in members {
            let (at, k) = self.columns.span[m.variant];
            let factor = self.columns.factor(*m);
            data.extend((at..at + k).map(|c| self.columns.values.column(c) * factor));
        }
        Target { structure: &self.structure, weights: &self.weights, data: DMatrix::from_columns(&data) }
    }

    /// The likeliest scales and set.
    fn run(&mut self) -> Option<(Rungs, Vec<Member>)> {
        let zero = vec![0; self.structure.components.len()];
        let none = self.target(&[]);
        // a mean over the places has a name, which a discrepancy that came first would take
        let may_enter = |component| {
            !matches!(component, Component::Place(_) | Component::Direction(_) | Component::Speed(_))
        };
        let (alone, named) = rayon::join(|| none.ascend(&zero), || none.ascend_among(&zero, &may_enter));
        let mut best = self.settle(zero, Vec::new())?;
        for start in [alone, named] {
            let other = self.settle(start, Vec::new())?;
            if other.2 > best.2 {
                best = other;
            }
        }
        best = self.again(best)?;
        // no formula is exact: what a large effect leaves of its own form must not pass for small ones
        if self.allow_misform(&best.0, &best.1) {
            self.visited.clear();
            best.0.resize(self.structure.components.len(), 0);
            let start = self.target(&best.1).ascend(&best.0);
            // beside what was named for the misform of a curve that misform has nothing to say: begin without it, too
            let mut open = vec![0; self.structure.components.len()];
            for (rung, (component, _)) in open.iter_mut().zip(&self.structure.components) {
                *rung = if matches!(component, Component::Misform(_)) { MISFORM_RUNG } else { 0 };
            }
            let first = self.settle(start, best.1)?;
            let second = self.settle(open, Vec::new())?;
            best = self.again(if second.2 > first.2 { second } else { first })?;
        }
        let (rungs, members, _) = best;
        if let Some((gram, sets)) = self.visited.get_mut(&rungs) {
            sets::explore(gram, &self.columns, sets);
        }
        self.ladder(&rungs)?;
        Some((rungs, members))
    }

    /// The likeliest scales and set, where the search begins again without each member in turn.
    fn again(&mut self, best: (Rungs, Vec<Member>, f64)) -> Option<(Rungs, Vec<Member>, f64)> {
        let Some((gram, sets)) = self.visited.get_mut(&best.0) else { return Some(best) };
        let before = sets::most(sets);
        sets::restart(gram, &self.columns, &best.1, sets);
        if sets::most(sets) > before { self.settle(best.0, best.1) } else { Some(best) }
    }

    /// Set and scales in turn, until neither changes; with the log weight.
    fn settle(&mut self, start: Rungs, set: Vec<Member>) -> Option<(Rungs, Vec<Member>, f64)> {
        let (mut rungs, mut members) = (start, set);
        let mut best: Option<(Rungs, Vec<Member>, f64)> = None;
        for _ in 0..ROUNDS {
            let (found, weight) = self.climb(&rungs, &members)?;
            if best.as_ref().is_none_or(|b| weight > b.2) {
                best = Some((rungs.clone(), found.clone(), weight));
            }
            let next = self.target(&found).ascend(&rungs);
            members = found;
            if next == rungs {
                break;
            }
            rungs = next;
        }
        best
    }

    /// What a member of a set says of the gap: `mean` holds the coefficients of the columns `at`.
    fn part(&self, variant: usize, at: &[usize], mean: &DVector<f64>) -> DVector<f64> {
        let (first, k) = self.columns.span[variant];
        let mut part = DVector::zeros(self.y.len());
        for (c, b) in at.iter().zip(mean.iter()).filter(|(c, _)| (first..first + k).contains(*c)) {
            part.axpy(*b, &self.columns.values.column(*c), 1.0);
        }
        part
    }

    /// Mean square beside the offsets of the mountings.
    fn mean_square(&self) -> impl Fn(&DVector<f64>) -> f64 {
        let n = self.y.len();
        let plain =
            Covariance::new(&self.structure, &vec![0.0; self.structure.components.len()], &vec![1.0; n]);
        move |v| {
            let whitened = plain.as_ref().map(|p| p.whiten(&DMatrix::from_column_slice(n, 1, v.as_slice())));
            whitened.map_or(0.0, |w| w.norm_squared() / n as f64)
        }
    }

    /// Adds a component for each effect of a set that is large against the noise; false where there is none.
    fn allow_misform(&mut self, rungs: &Rungs, members: &[Member]) -> bool {
        let Some((gram, _)) = self.visited.get(rungs) else { return false };
        let set = gram.condition(&self.columns, members);
        let sigma = gram.sigma(&set);
        let (at, mean, _) = gram.coefficients(&set);
        let mut parts: Vec<(usize, usize, DVector<f64>)> = Vec::new();
        for m in members {
            let part = self.part(m.variant, &at, &mean);
            if part.norm() > SIGNIFICANT * sigma * (part.len() as f64).sqrt() {
                parts.push((self.columns.label[m.variant], m.variant, part));
            }
        }
        // what goes with the place alone has a name where a random process of the same axis is among the effects
        let has_name = |shape: &Shape| {
            let motion = shape.error_motion();
            motion.is_some() && self.shapes.iter().any(|s| s.is_process() && s.error_motion() == motion)
        };
        parts.retain(|(_, variant, _)| !has_name(&self.shapes[*variant]));
        for (label, variant, part) in &parts {
            self.structure.misform(*label, &self.shapes[*variant], part);
        }
        !parts.is_empty()
    }

    /// Likely sets under the scales beside the likeliest: a cause may win by making the discrepancy small.
    fn ladder(&mut self, rungs: &Rungs) -> Option<()> {
        let (_, sets) = self.visited.get(rungs)?;
        let most = sets::most(sets);
        let likely: Vec<Vec<Member>> =
            sets.values().filter(|v| v.log_weight > most - STRONG).map(|v| v.members.clone()).collect();
        let variants = likely.iter().flatten().map(|m| m.variant).collect();
        let columns = self.columns.only(&variants);
        let mut cases: BTreeSet<Rungs> = self.visited.keys().cloned().collect();
        for c in 0..rungs.len() {
            let now = rungs[c];
            let beside = [0, now.saturating_sub(1), (now + 1).min(self.structure.top(c))];
            for rung in beside.into_iter().filter(|r| *r != now) {
                let mut next = rungs.clone();
                next[c] = rung;
                cases.insert(next);
            }
        }
        let keys: Vec<Vec<usize>> = likely.iter().map(|set| sets::key(&columns, set)).collect();
        let (structure, weights, y) = (&self.structure, &self.weights, &self.y);
        let weigh = |case: Rungs| {
            let covariance = Covariance::new(structure, &scales::values(&case), weights)?;
            let gram = Gram::new(&covariance, &columns, y);
            let prior = scales::log_prior(&case);
            let each = likely.iter().map(|set| sets::own_weight(&gram, &columns, set) + prior);
            let sums = keys.iter().cloned().zip(each).collect();
            Some((case, sums))
        };
        let beside: Option<Vec<_>> = cases.into_par_iter().map(weigh).collect();
        self.beside.extend(beside?);
        Some(())
    }

    /// Log weights of all sets, summed over the scales.
    fn weights_of_sets(&self) -> WeightedSets {
        let mut all = WeightedSets::new();
        for (rungs, (_, sets)) in &self.visited {
            let prior = scales::log_prior(rungs);
            for (labels, v) in sets {
                let w = v.log_weight + prior;
                let e = all.entry(labels.clone()).or_insert((v.members.clone(), w));
                if w > e.1 {
                    *e = (v.members.clone(), w);
                }
            }
        }
        for (labels, (_, weight)) in &mut all {
            let each: Vec<f64> = self.beside.values().filter_map(|sums| sums.get(labels).copied()).collect();
            if !each.is_empty() {
                *weight = weight.max(log_sum(&each));
            }
        }
        let best = all.values().map(|v| v.1).fold(f64::NEG_INFINITY, f64::max);
        all.retain(|_, v| v.1 > best - 2.0 * STRONG);
        all
    }
}

/// Members and log weight of sets, by their labels.
type WeightedSets = BTreeMap<Vec<usize>, (Vec<Member>, f64)>;

fn log_sum(values: &[f64]) -> f64 {
    let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    most + values.iter().map(|v| (v - most).exp()).sum::<f64>().ln()
}

/// Compares all sets of effects.
pub(super) fn compare(
    session: &Session,
    library: &Library,
    gap: &[f64],
    structure: Structure,
) -> Option<Comparison> {
    let base = structure;
    let n = base.groups.len();
    let mut weights = base.white.clone();
    let white = Covariance::new(&base, &vec![0.0; base.components.len()], &weights)?;
    if white.freedom() < 8 {
        return None;
    }
    let members: Vec<usize> = base.groups.concat();
    let own: Vec<f64> = members.iter().map(|i| gap[*i]).collect();
    let y = DVector::from_vec(mean_of_members(&base.groups, &own, 1));
    let raw = raw_columns(session, library, &members);
    let raw = mean_of_members(&base.groups, &raw, library.width());
    let span = library.spans();
    let label = library.variants.iter().map(|v| v.label).collect();
    let rank = ranks(library);
    let names = library.variants.iter().flat_map(|v| v.shape.parameters());
    let largest: Vec<f64> =
        names.map(|p| prior_sd(&p).map_or(f64::INFINITY, |sd| sd / base.white_um)).collect();
    let process = library.variants.iter().map(|v| v.shape.is_process()).collect();
    let mut columns = Columns::new(&raw, n, (span, label, process), &largest, &rank, &white);
    columns.line = lines(library, &columns);
    let points = points(session, &base.groups);
    let mut outlying: Vec<(usize, f64)> = Vec::new();
    for round in 0.. {
        let mut search = Search {
            structure: base.clone(),
            shapes: library.variants.iter().map(|v| v.shape.clone()).collect(),
            columns: columns.clone(),
            y: y.clone(),
            weights: weights.clone(),
            visited: BTreeMap::new(),
            beside: BTreeMap::new(),
        };
        let (rungs, members) = search.run()?;
        let tails = search.tails(&rungs, &members, &points)?;
        if round < 2 && !tails.is_empty() && outlying != tails {
            weights.clone_from(&base.white);
            for (k, w) in &tails {
                weights[*k] *= w;
            }
            outlying = tails;
            continue;
        }
        let single = outlying.iter().filter(|(k, _)| base.groups[*k].len() == 1);
        let outlying = single.map(|(k, w)| (base.groups[*k][0], *w)).collect();
        return conclude(&search, rungs, outlying);
    }
    None
}

/// The column of the scale from which each table of an axis is counted, where it is seen.
fn lines(library: &Library, columns: &Columns) -> Vec<Option<usize>> {
    let scale = |axis: Axis| {
        let is_scale = |v: &usize| match &library.variants[*v].shape {
            Shape::Scale(s) => s.axis == axis,
            Shape::RotaryScale(s) => s.frame.axis == axis,
            _ => false,
        };
        columns.variants.iter().flatten().copied().find(is_scale).map(|v| columns.span[v].0)
    };
    let of = |shape: &Shape| match shape {
        Shape::PitchTable(t) if t.process.is_from_line() && t.along.is_none() => scale(t.axis),
        Shape::RotaryTable(t) if t.process.is_from_line() => scale(t.frame.axis),
        _ => None,
    };
    library.variants.iter().map(|v| of(&v.shape)).collect()
}

/// Which of two labels with the same column stands for both: the machine before the instrument, all axes before one.
fn ranks(library: &Library) -> Vec<usize> {
    let of = |l: usize| {
        let label = &library.labels[l];
        let instrument = usize::from(library.kinds[l] != Kind::Machine);
        (2 * instrument + usize::from(!label.subject.is_empty())) * library.labels.len() + l
    };
    (0..library.labels.len()).map(of).collect()
}

fn conclude(search: &Search, rungs: Rungs, outlying: Vec<(usize, f64)>) -> Option<Comparison> {
    let sets = search.weights_of_sets();
    let total = log_sum(&sets.values().map(|v| v.1).collect::<Vec<_>>());
    let share = |w: f64| (w - total).exp();
    let (best_labels, (best, best_weight)) = sets.iter().max_by(|a, b| a.1.1.total_cmp(&b.1.1))?;
    let mut probability: BTreeMap<usize, f64> = BTreeMap::new();
    for (labels, (_, w)) in &sets {
        for l in labels {
            *probability.entry(*l).or_default() += share(*w);
        }
    }
    let (gram, _) = search.visited.get(&rungs)?;
    let best_set = gram.condition(&search.columns, best);
    let (at, mean, _) = gram.coefficients(&best_set);
    // of a member of the set, in standard deviations of the white noise; nothing of others
    let size = |variant: usize| {
        let (first, k) = search.columns.span[variant];
        let own = at.iter().zip(mean.iter()).filter(|(c, _)| (first..first + k).contains(*c));
        own.map(|(_, b)| b * b).sum::<f64>().sqrt() / search.structure.white_um
    };
    let covariance = Covariance::new(&search.structure, &scales::values(&rungs), &search.weights)?;
    let kinds: Vec<Component> = search.structure.components.iter().map(|c| c.0).collect();
    let scales: Vec<(Component, f64)> = kinds.iter().copied().zip(scales::values(&rungs)).collect();
    let n = search.y.len();
    let mut named = DVector::zeros(n);
    best.iter().for_each(|m| named += search.part(m.variant, &at, &mean));
    let left = &search.y - &named;
    let components = components(search, &covariance, &left, &scales);
    let mean_square = search.mean_square();
    // what a member says and the discrepancy beside it, where it acts
    let beside = |variant: usize| {
        let part = search.part(variant, &at, &mean);
        let label = search.columns.label[variant];
        let is_other = |c: &Component| c.is_discrepancy() && *c != Component::Misform(label);
        let setup = &search.structure.setup;
        let acts: BTreeSet<usize> = (0..n).filter(|k| part[*k] != 0.0).map(|k| setup[k]).collect();
        let mut discrepancy = sum_of(&components, n, is_other);
        let elsewhere: Vec<usize> = (0..n).filter(|k| !acts.contains(&setup[*k])).collect();
        elsewhere.iter().for_each(|k| discrepancy[*k] = 0.0);
        let scale = n as f64 / (n - elsewhere.len()).max(1) as f64;
        [part, discrepancy].map(|v| scale * mean_square(&v))
    };
    let mut contenders: Vec<Contender> = Vec::new();
    for (label, p) in &probability {
        let chosen = best_labels.contains(label);
        let holder = sets
            .iter()
            .filter(|(labels, _)| labels.contains(label))
            .max_by(|a, b| a.1.1.total_cmp(&b.1.1))?;
        let member = holder.1.0.iter().find(|m| search.columns.label[m.variant] == *label)?;
        let rivals = if chosen { rivals(search, gram, best, *label, &probability) } else { Vec::new() };
        let fits = |members: &[Member]| {
            gram.likelihood_loss(&gram.condition(&search.columns, members), &best_set) < STRONG
        };
        let sums = if chosen { pairs_in_place(&sets, best_labels, *label, &fits) } else { Vec::new() };
        let stands = |labels: &[usize]| {
            labels.contains(label)
                || rivals.iter().any(|(r, _)| labels.contains(r) && !best_labels.contains(r))
                || sums.iter().any(|pair| pair.iter().all(|l| labels.contains(l)))
        };
        let group: f64 = sets.iter().filter(|(l, _)| stands(l)).map(|(_, (_, w))| share(*w)).sum();
        let without = sets
            .iter()
            .filter(|(labels, _)| !labels.contains(label))
            .map(|(_, (_, w))| *w)
            .fold(f64::NEG_INFINITY, f64::max);
        let log_evidence = if chosen { best_weight - without } else { holder.1.1 - best_weight };
        let [own_um2, beside_um2] = if chosen { beside(member.variant) } else { [0.0; 2] };
        contenders.push(Contender {
            label: *label,
            variant: member.variant,
            probability: p.min(1.0),
            group_probability: group.min(1.0),
            rivals,
            sums,
            aliases: search.columns.aliases_of(*label, size(member.variant)),
            chosen,
            log_evidence,
            own_um2,
            beside_um2,
        });
    }
    contenders.sort_by(|a, b| {
        b.chosen.cmp(&a.chosen).then(b.probability.total_cmp(&a.probability)).then(a.label.cmp(&b.label))
    });
    let white_um = gram.sigma(&best_set);
    let by_scales: Vec<(&Rungs, f64)> =
        search.beside.iter().filter_map(|(r, sums)| Some((r, *sums.get(best_labels)?))).collect();
    let all = log_sum(&by_scales.iter().map(|v| v.1).collect::<Vec<_>>());
    let has = |rungs: &Rungs| kinds.iter().zip(rungs).any(|(c, r)| *r > 0 && c.is_discrepancy());
    let discrepancy = by_scales.iter().filter(|(r, _)| has(r)).map(|(_, w)| (w - all).exp()).sum();
    let of_discrepancy = sum_of(&components, n, |c| c.is_discrepancy());
    let of_drift = sum_of(&components, n, |c| !c.is_discrepancy());
    let shares = Shares {
        named_um2: mean_square(&named),
        discrepancy_um2: mean_square(&of_discrepancy),
        drift_um2: mean_square(&of_drift),
        noise_um2: mean_square(&(&left - &of_discrepancy - &of_drift)),
    };
    let drift = scales
        .iter()
        .filter_map(|(c, s)| match c {
            Component::Drift(t) if *s > 0.0 => Some((s * white_um, TIMES[*t] * search.structure.duration_s)),
            _ => None,
        })
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .unwrap_or((0.0, 0.0));
    Some(Comparison {
        groups: search.structure.groups.clone(),
        log_evidence: total,
        contenders,
        discrepancy,
        shares,
        scales: scales.clone(),
        white_um,
        within_um: None,
        drift,
        effective: effective(&search.structure, &scales),
        outlying,
        covariance,
    })
}

/// Labels that explain a member of the likeliest set away: with them in its place it brings less than half of its evidence.
fn rivals(
    search: &Search,
    gram: &Gram,
    best: &[Member],
    label: usize,
    probability: &BTreeMap<usize, f64>,
) -> Vec<(usize, f64)> {
    let columns = &search.columns;
    let (own, rest): (Vec<Member>, Vec<Member>) =
        best.iter().copied().partition(|m| columns.label[m.variant] == label);
    let weight = |members: &[Member]| gram.log_evidence(&gram.condition(columns, members));
    let alone = weight(best) - weight(&rest);
    let base = gram.condition(columns, &rest);
    let taken: Vec<usize> = best.iter().map(|m| columns.label[m.variant]).collect();
    let mut all = Vec::new();
    for (other, p) in probability.iter().filter(|(l, p)| !taken.contains(l) && **p > LEAST_PROBABILITY) {
        let Some(addition) = gram.addition(columns, &base, *other) else { continue };
        let with: Vec<Member> = rest.iter().copied().chain([addition.member]).collect();
        let both: Vec<Member> = with.iter().copied().chain(own.iter().copied()).collect();
        if addition.log_evidence > gram.log_evidence(&base) && weight(&both) - weight(&with) < 0.5 * alone {
            all.push((*other, *p));
        }
    }
    all.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    all
}

/// Pairs of labels that stand in the place of a member of the likeliest set and fit as well (`fits`), the likeliest first.
fn pairs_in_place(
    sets: &WeightedSets,
    best: &[usize],
    label: usize,
    fits: &dyn Fn(&[Member]) -> bool,
) -> Vec<[usize; 2]> {
    let in_its_place = |(labels, (members, w)): (&Vec<usize>, &(Vec<Member>, f64))| {
        let kept = best.iter().all(|l| labels.contains(l) != (*l == label));
        let added: Vec<usize> = labels.iter().copied().filter(|l| !best.contains(l)).collect();
        let pair = <[usize; 2]>::try_from(added).ok().filter(|_| kept)?;
        // one of them alone is a rival
        let is_enough = |one: usize| {
            let without: Vec<usize> = labels.iter().copied().filter(|l| *l != one).collect();
            sets.get(&without).is_some_and(|v| v.1 > *w)
        };
        (!pair.into_iter().any(is_enough) && fits(members)).then_some((pair, *w))
    };
    let mut all: Vec<([usize; 2], f64)> = sets.iter().filter_map(in_its_place).collect();
    all.sort_by(|a, b| b.1.total_cmp(&a.1));
    all.into_iter().map(|(pair, _)| pair).take(TRIED).collect()
}

/// Posterior mean of each component of the covariance beside `left`, um.
fn components(
    search: &Search,
    covariance: &Covariance,
    left: &DVector<f64>,
    scales: &[(Component, f64)],
) -> Vec<(Component, DVector<f64>)> {
    let whitened = covariance.whiten(&DMatrix::from_column_slice(left.len(), 1, left.as_slice()));
    let pulled = covariance.back(&whitened.column(0).into_owned());
    let all = search.structure.components.iter().zip(scales).filter(|(_, (_, s))| *s > 0.0);
    all.map(|((component, m), (_, s))| (*component, m * &pulled * (s * s))).collect()
}

/// Sum of the components that are wanted.
fn sum_of(
    components: &[(Component, DVector<f64>)],
    n: usize,
    is_wanted: impl Fn(&Component) -> bool,
) -> DVector<f64> {
    let wanted = components.iter().filter(|(c, _)| is_wanted(c));
    wanted.fold(DVector::zeros(n), |sum, (_, part)| sum + part)
}

/// A mean below this share of its largest value is rounding.
const CANCELS: f64 = 1e-9;

/// Mean of the values of each group; `data` holds a row of `width` values per member of the groups, in their order.
pub(crate) fn mean_of_members(groups: &[Vec<usize>], data: &[f64], width: usize) -> Vec<f64> {
    let mut rows = data.chunks_exact(width.max(1));
    let mut out = vec![0.0; groups.len() * width];
    let mut largest = vec![0.0f64; width];
    for (to, group) in out.chunks_exact_mut(width.max(1)).zip(groups) {
        largest.fill(0.0);
        for row in rows.by_ref().take(group.len()) {
            to.iter_mut().zip(row).for_each(|(t, v)| *t += v / group.len() as f64);
            largest.iter_mut().zip(row).for_each(|(l, v)| *l = l.max(v.abs()));
        }
        // the rounding of values that cancel is no column
        to.iter_mut().zip(&largest).filter(|(t, l)| t.abs() < CANCELS * **l).for_each(|(t, _)| *t = 0.0);
    }
    out
}

/// `tr(C)^2 / |C|^2`: independent readings with the same scatter of their mean square.
fn effective(structure: &Structure, scales: &[(Component, f64)]) -> f64 {
    let scales: Vec<f64> = scales.iter().map(|(_, s)| *s).collect();
    let c = structure.sum(&scales, &structure.white);
    c.trace().powi(2) / c.norm_squared()
}
