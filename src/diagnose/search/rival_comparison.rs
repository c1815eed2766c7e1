//! Other effects in the place of chosen ones, compared between the values of their grids: a coarse grid must not decide between
//! names.

use rayon::prelude::*;

use super::super::constants::{HALF, LITTLE, NEARLY, SURE, TRIED};
use super::super::library::{Library, Shape, forms};
use super::super::moment::Axis;
use super::super::noise::Filter;
use super::super::session::Session;
use super::beside::Beside;
use super::joint::Joint;
use super::problem::Problem;
use super::refine::{STEPS, put};
use super::select::{SWAP_GAIN, Selection, evidence};

/// Gives the place of each effect to another one whose non-linear parameters, once found between the values of the grid, explain more:
/// a coarse grid must not decide between names.
pub fn challenge(
    problem: &mut Problem,
    session: &Session,
    filter: &Filter,
    library: &mut Library,
    selection: &mut Selection,
) {
    let mut joint = Joint::new(problem, &selection.chosen);
    for place in 0..selection.chosen.len() {
        let all = (&*problem, session, filter, &*library);
        if let Some((v, shape)) = rival(all, selection, &joint, place) {
            put(problem, session, filter, library, v, shape);
            selection.chosen[place] = v;
            joint = Joint::new(problem, &selection.chosen);
        }
    }
}

/// The variant that takes a place, and its shape.
fn rival(
    (problem, session, filter, library): (&Problem, &Session, &Filter, &Library),
    selection: &Selection,
    joint: &Joint,
    place: usize,
) -> Option<(usize, Shape)> {
    let own = selection.chosen[place];
    let rest = joint.without(problem, &[place]);
    let now = selection.brings(library, own, rest.gain(own));
    let mut not: Vec<usize> = rest.others.iter().map(|v| library.variants[*v].label).collect();
    not.push(library.variants[own].label);
    let rivals: Vec<usize> = selection
        .ranked(library, &rest.gains(), &not)
        .into_iter()
        .filter(|f| {
            let shape = &library.variants[f.variant].shape;
            // about a point that nobody knows a structure tilts like anything
            let is_tilt = matches!(shape, Shape::InertialTilt { .. });
            f.gain > NEARLY * now.gain && !is_tilt && !shape.neighbours(STEPS[0]).is_empty()
        })
        .take(TRIED)
        .map(|f| f.variant)
        .collect();
    if rivals.is_empty() {
        return None;
    }
    let beside = Beside::new(problem, &rest.others);
    let best: Vec<_> = rivals
        .into_par_iter()
        .map(|v| {
            let (gain, rank, shape) = beside.best(problem, session, filter, &library.variants[v].shape);
            let label = library.variants[v].label;
            (evidence(gain, rank, selection.grid[label]), v, shape)
        })
        .collect();
    let (e, v, shape) = best.into_iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
    (e > now.evidence + SWAP_GAIN).then_some((v, shape))
}

/// Of two effects that take back what the other says the one that, refined alone, explains nearly as much as both.
pub fn one_of_two(
    problem: &mut Problem,
    session: &Session,
    filter: &Filter,
    library: &mut Library,
    selection: &mut Selection,
) {
    while let Some((stays, shape, others)) = instead_of_both(problem, session, filter, library, selection) {
        put(problem, session, filter, library, stays, shape);
        selection.chosen = [&others[..], &[stays]].concat();
    }
    problem.prepare(&selection.chosen);
}

/// The variant, its shape and the rest of the effects for a pair that one of the two replaces.
fn instead_of_both(
    problem: &mut Problem,
    session: &Session,
    filter: &Filter,
    library: &Library,
    selection: &Selection,
) -> Option<(usize, Shape, Vec<usize>)> {
    let n = selection.chosen.len();
    let all = Selection::given(problem, &selection.chosen);
    for (a, b) in (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b))) {
        let pair = [selection.chosen[a], selection.chosen[b]];
        if problem.cosine(&all, pair) > -HALF {
            continue;
        }
        let others = selection.without(&[a, b]);
        let now = selection.evidence_beside(problem, library, &others, &pair);
        let given = Selection::given(problem, &others);
        let beside = Beside::new(problem, &others);
        let alone = pair.map(|own| {
            let v = selection.best_of(problem, library, &given, own);
            let (gain, rank, shape) = beside.best(problem, session, filter, &library.variants[v].shape);
            (evidence(gain, rank, selection.grid[library.variants[v].label]), v, shape)
        });
        let best = alone.into_iter().max_by(|x, y| x.0.total_cmp(&y.0));
        if let Some((e, v, shape)) = best
            && e > NEARLY * now
        {
            return Some((v, shape, others));
        }
    }
    None
}

/// A table of positions may be a worn place that none of the grid looks like: one worn place in the place of all curves over
/// that axis, where it says nearly as much. The table is not looked for any more.
pub fn one_worn_place(
    problem: &mut Problem,
    session: &Session,
    filter: &Filter,
    library: &mut Library,
    selection: &mut Selection,
) {
    for axis in Axis::LINEAR {
        let is_table = |v: &usize| match &library.variants[*v].shape {
            Shape::Polynomial(p) => p.along == axis && p.over == axis,
            Shape::PositionTable(t) => t.axis == axis,
            Shape::PitchTable(t) => t.axis == axis && t.along.is_none(),
            _ => false,
        };
        let is_curve = |v: &usize| {
            let shape = &library.variants[*v].shape;
            is_table(v)
                || shape.over() == Some(axis)
                    && matches!(
                        shape,
                        Shape::Scale { .. } | Shape::Sag { .. } | Shape::Ram { .. } | Shape::Wear { .. }
                    )
        };
        let (curves, others): (Vec<usize>, Vec<usize>) = selection.chosen.iter().partition(|v| is_curve(v));
        let Some(table) = curves.iter().copied().find(is_table) else { continue };
        let sum = selection.evidence_beside(problem, library, &others, &curves);
        let given = Selection::given(problem, &others);
        let mut places: Vec<(f64, usize)> = (0..library.variants.len())
            .filter(|v| matches!(library.variants[*v].shape, Shape::Wear(forms::Wear { axis: own, .. }) if own == axis))
            .filter(|v| !selection.banned.contains(v))
            .map(|v| (problem.gain(&given, v).0, v))
            .collect();
        places.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let beside = Beside::new(problem, &others);
        places.truncate(TRIED);
        let best: Vec<_> = places
            .into_par_iter()
            .map(|(_, v)| {
                let (gain, _, shape) = beside.best(problem, session, filter, &library.variants[v].shape);
                (gain, v, shape)
            })
            .collect();
        let best = best.into_iter().max_by(|a, b| a.0.total_cmp(&b.0));
        let Some((gain, worn, shape)) = best else { continue };
        let label = library.variants[worn].label;
        if evidence(gain, 1, selection.grid[label]) <= (1.0 - LITTLE) * sum {
            continue;
        }
        let left = [&others, &selection.chosen].map(|chosen| left_in_programs(problem, chosen));
        let before = library.variants[worn].shape.clone();
        put(problem, session, filter, library, worn, shape);
        let with_worn = [&others[..], &[worn]].concat();
        let rank = problem.span[table].1 as f64;
        if says_as_much(&left, &left_in_programs(problem, &with_worn), rank) {
            let table = library.variants[table].label;
            selection.chosen = with_worn;
            selection.ban(library, table);
            selection.one_curve.push((label, table));
        } else {
            put(problem, session, filter, library, worn, before);
        }
    }
    problem.prepare(&selection.chosen);
}

/// Sum of squares that some effects leave in each program.
fn left_in_programs(problem: &mut Problem, chosen: &[usize]) -> Vec<f64> {
    let given = Selection::given(problem, chosen);
    let left = &problem.y - problem.contribution(&given.columns, &problem.fit(&given));
    let mut sums = vec![0.0; problem.cells];
    left.iter().zip(&problem.cell).for_each(|(e, cell)| sums[*cell] += e * e);
    sums
}

/// True where what stands in the place of a table of `rank` columns leaves little of what the table explains, and of the noise that
/// the table fits, in every program: readings that lie close would outweigh all others.
fn says_as_much([without, with_table]: &[Vec<f64>; 2], with_other: &[f64], rank: f64) -> bool {
    let by_chance = rank + SURE * (2.0 * rank).sqrt();
    let programs = without.iter().zip(with_table).zip(with_other);
    programs.into_iter().all(|((none, table), other)| other - table <= LITTLE * (none - table) + by_chance)
}
