//! Sets of effects: search and the posterior over all that were visited.

use std::collections::{BTreeMap, BTreeSet};

use super::super::constants::{MOST, STRONG};
use super::gram::{Columns, Gram, Member};

/// A set of labels with the best variant and scale of each.
#[derive(Debug, Clone)]
pub(super) struct Visited {
    pub(super) members: Vec<Member>,
    /// Log posterior, not normalised.
    pub(super) log_weight: f64,
}

/// Sets by their labels, sorted.
pub(super) type Sets = BTreeMap<Vec<usize>, Visited>;

/// The highest log weight.
pub(super) fn most(sets: &Sets) -> f64 {
    sets.values().map(|v| v.log_weight).fold(f64::NEG_INFINITY, f64::max)
}

/// Log prior of each further effect: as likely as none of them together.
fn price(columns: &Columns) -> f64 {
    -(columns.visible.saturating_sub(1).max(2) as f64).ln()
}

pub(super) fn key(columns: &Columns, members: &[Member]) -> Vec<usize> {
    let mut labels: Vec<usize> = members.iter().map(|m| columns.label[m.variant]).collect();
    labels.sort_unstable();
    labels
}

/// Keeps what is new or better; returns true where the set was not known.
fn visit(sets: &mut Sets, columns: &Columns, members: &[Member], log_weight: f64) -> bool {
    let known = sets.entry(key(columns, members));
    match known {
        std::collections::btree_map::Entry::Vacant(e) => {
            e.insert(Visited { members: members.to_vec(), log_weight });
            true
        }
        std::collections::btree_map::Entry::Occupied(mut e) => {
            if log_weight > e.get().log_weight {
                e.insert(Visited { members: members.to_vec(), log_weight });
            }
            false
        }
    }
}

/// Visits every set that has one more label than `members`, other than `barred`.
fn grow(
    gram: &Gram,
    columns: &Columns,
    members: &[Member],
    barred: Option<usize>,
    sets: &mut Sets,
) -> Option<(Vec<Member>, f64)> {
    let additions = gram.additions(columns, members);
    let prior = extra(columns, members) + price(columns);
    let mut best: Option<(Vec<Member>, f64)> = None;
    for label in (0..columns.labels).filter(|l| barred != Some(*l)) {
        let Some(addition) = additions[label] else { continue };
        let weight = addition.log_evidence + prior;
        let mut with = members.to_vec();
        with.push(addition.member);
        visit(sets, columns, &with, weight);
        if best.as_ref().is_none_or(|(_, b)| weight > *b) {
            best = Some((with, weight));
        }
    }
    best
}

/// Forward search without `barred` until nothing is better; the set and its log weight.
fn forward(
    gram: &Gram,
    columns: &Columns,
    (mut members, mut weight): (Vec<Member>, f64),
    barred: Option<usize>,
    sets: &mut Sets,
) -> (Vec<Member>, f64) {
    while members.len() < MOST
        && let Some((with, w)) = grow(gram, columns, &members, barred, sets)
        && w > weight + 1e-6
    {
        (members, weight) = (with, w);
    }
    (members, weight)
}

/// Climbs again, from what forward search finds without each member in turn: one effect that resembles the sum of two comes in
/// first and cannot be exchanged for both at once. So does a table with its slope: climbs from the line alone, too.
pub(super) fn restart(gram: &Gram, columns: &Columns, members: &[Member], sets: &mut Sets) {
    for m in members {
        let start = forward(gram, columns, (Vec::new(), gram.none), Some(columns.label[m.variant]), sets);
        climb(gram, columns, &start.0, sets);
        let line = columns.variants[columns.label[m.variant]].iter().find_map(|v| columns.line[*v]);
        let label = line.and_then(|line| columns.span.iter().position(|s| s.0 == line));
        let none = gram.condition(columns, &[]);
        if let Some(alone) = label.and_then(|v| gram.addition(columns, &none, columns.label[v])) {
            climb(gram, columns, &[alone.member], sets);
        }
    }
}

/// Forward search, then exchanges and removals of single members, until nothing is better; the highest log weight.
pub(super) fn climb(gram: &Gram, columns: &Columns, start: &[Member], sets: &mut Sets) -> f64 {
    let mut members = start.to_vec();
    visit(sets, columns, &[], gram.none);
    let mut weight = own_weight(gram, columns, &members);
    visit(sets, columns, &members, weight);
    loop {
        (members, weight) = forward(gram, columns, (members, weight), None, sets);
        let mut best = (members.clone(), weight);
        for k in 0..members.len() {
            let mut rest = members.clone();
            rest.remove(k);
            let w = own_weight(gram, columns, &rest);
            visit(sets, columns, &rest, w);
            if w > best.1 {
                best = (rest.clone(), w);
            }
            if let Some((with, w)) = grow(gram, columns, &rest, None, sets)
                && w > best.1
            {
                best = (with, w);
            }
        }
        if best.1 <= weight + 1e-6 {
            return weight;
        }
        (members, weight) = best;
    }
}

/// Log weight of a set, its labels averaged over variants and scales as they were when each came in.
pub(super) fn own_weight(gram: &Gram, columns: &Columns, members: &[Member]) -> f64 {
    let set = gram.condition(columns, members);
    gram.log_evidence(&set) + extra(columns, members)
}

/// Log prior of a set and the averages of its members.
pub(super) fn extra(columns: &Columns, members: &[Member]) -> f64 {
    members.iter().map(|m| m.average + price(columns)).sum()
}

/// Visits the neighbours of all sets that count, the likeliest first.
pub(super) fn explore(gram: &Gram, columns: &Columns, sets: &mut Sets) {
    let mut done: BTreeSet<Vec<usize>> = BTreeSet::new();
    for _ in 0..MOST {
        let best = most(sets);
        let next = sets
            .iter()
            .filter(|(k, v)| v.log_weight > best - STRONG && !done.contains(*k))
            .max_by(|a, b| a.1.log_weight.total_cmp(&b.1.log_weight))
            .map(|(k, v)| (k.clone(), v.members.clone()));
        let Some((labels, members)) = next else { return };
        done.insert(labels);
        if members.len() < MOST {
            grow(gram, columns, &members, None, sets);
        }
        for k in 0..members.len() {
            let mut rest = members.clone();
            rest.remove(k);
            let w = own_weight(gram, columns, &rest);
            visit(sets, columns, &rest, w);
            grow(gram, columns, &rest, None, sets);
        }
    }
}
