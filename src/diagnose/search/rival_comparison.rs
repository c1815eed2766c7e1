//! Other effects in the place of chosen ones, compared between the values of their grids: a coarse grid must not decide between
//! names.

use super::super::constants::LITTLE;
use super::super::library::{Library, Shape, forms};
use super::super::moment::Axis;
use super::super::noise::Filter;
use super::super::session::Session;
use super::problem::Problem;
use super::refine::{Beside, STEPS, put};
use super::select::{SWAP_GAIN, Selection, evidence};

/// Rivals that come this near are worth a search between the values of their grid.
const NEAR: f64 = 0.8;
/// Most rivals searched.
const RIVALS: usize = 4;

/// Gives the place to another effect whose non-linear parameters, once found between the values of the grid, explain more:
/// a coarse grid must not decide between names.
pub fn challenge(
    problem: &mut Problem,
    session: &Session,
    filter: &Filter,
    library: &mut Library,
    selection: &mut Selection,
    place: usize,
) {
    let own = selection.chosen[place];
    let others: Vec<usize> =
        selection.chosen.iter().enumerate().filter(|(i, _)| *i != place).map(|(_, v)| *v).collect();
    let beside = Beside::new(problem, &others);
    let given = Selection::given(problem, &others);
    let now = selection.found(problem, library, &given, own);
    let mut not: Vec<usize> = others.iter().map(|v| library.variants[*v].label).collect();
    not.push(library.variants[own].label);
    let rivals: Vec<usize> = selection
        .ranking(problem, library, &given, &not)
        .into_iter()
        .filter(|f| {
            let shape = &library.variants[f.variant].shape;
            // about a point that nobody knows a structure tilts like anything
            let is_tilt = matches!(shape, Shape::InertialTilt { .. });
            f.gain > NEAR * now.gain && !is_tilt && !shape.neighbours(STEPS[0]).is_empty()
        })
        .take(RIVALS)
        .map(|f| f.variant)
        .collect();
    let best = rivals
        .into_iter()
        .map(|v| {
            let (gain, rank, shape) = beside.best(problem, session, filter, &library.variants[v].shape);
            let label = library.variants[v].label;
            (evidence(gain, rank, selection.grid[label]), v, shape)
        })
        .max_by(|a, b| a.0.total_cmp(&b.0));
    if let Some((e, v, shape)) = best
        && e > now.evidence + SWAP_GAIN
    {
        put(problem, session, filter, library, v, shape);
        selection.chosen[place] = v;
    }
}

/// A structure that tilts about a point other than the one first thought of seems to give way in the direction of its axis, too:
/// one tilt in the place of both, where it says nearly as much.
pub fn one_tilt(
    problem: &mut Problem,
    session: &Session,
    filter: &Filter,
    library: &mut Library,
    selection: &mut Selection,
) {
    let axis_of = |library: &Library, v: usize| match &library.variants[v].shape {
        Shape::InertialTilt(forms::InertialTilt { axis, .. }) => Some((true, *axis)),
        Shape::Inertial(forms::Inertial { axis, along, .. }) if axis == along => Some((false, *axis)),
        _ => None,
    };
    let find = |library: &Library, chosen: &[usize], wanted| {
        chosen.iter().position(|v| axis_of(library, *v) == Some(wanted))
    };
    for axis in Axis::LINEAR {
        let chosen = selection.chosen.clone();
        let (Some(tilt), Some(compliance)) =
            (find(library, &chosen, (true, axis)), find(library, &chosen, (false, axis)))
        else {
            continue;
        };
        let pair = [chosen[tilt], chosen[compliance]];
        let others = selection.without(&[tilt, compliance]);
        let both = selection.evidence_beside(problem, library, &others, &pair);
        let variant = &library.variants[pair[0]];
        let (gain, rank, shape) =
            Beside::new(problem, &others).best(problem, session, filter, &variant.shape);
        if evidence(gain, rank, selection.grid[variant.label]) > (1.0 - LITTLE) * both {
            put(problem, session, filter, library, pair[0], shape);
            selection.chosen.remove(compliance);
        }
    }
}

/// Worn places that are looked at between the values of their grid.
const PLACES: usize = 3;

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
        let is_table = |v: &usize| matches!(library.variants[*v].shape, Shape::Polynomial(forms::Polynomial { along, over, .. }) if along == axis && over == axis);
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
        let best = places
            .into_iter()
            .take(PLACES)
            .map(|(_, v)| {
                let (gain, _, shape) = beside.best(problem, session, filter, &library.variants[v].shape);
                (gain, v, shape)
            })
            .max_by(|a, b| a.0.total_cmp(&b.0));
        let Some((gain, worn, shape)) = best else { continue };
        let label = library.variants[worn].label;
        if evidence(gain, 1, selection.grid[label]) > (1.0 - LITTLE) * sum {
            let table = library.variants[table].label;
            put(problem, session, filter, library, worn, shape);
            selection.chosen = others;
            selection.chosen.push(worn);
            selection.ban(library, table);
            selection.one_curve.push((label, table));
        }
    }
    selection.chosen.iter().for_each(|v| problem.prepare(*v));
}

/// Share of what a clock of each file says with which one delay of all is believed rather.
const ONE_DELAY: f64 = 0.995;

/// Clocks that are all equally late are a delay of the control: the same to every instrument.
pub fn one_delay(problem: &mut Problem, library: &Library, selection: &mut Selection) {
    let is_common = |v: &usize| library.labels[library.variants[*v].label].effect == "latency";
    let is_clock = |v: &usize| matches!(library.variants[*v].shape, Shape::ClockSkew { .. });
    let clock = selection.chosen.iter().copied().find(is_clock);
    let delay = (0..library.variants.len()).find(|v| is_common(v) && !selection.banned.contains(v));
    let (Some(clock), Some(delay)) = (clock, delay) else { return };
    if selection.chosen.iter().any(is_common) {
        return;
    }
    let others: Vec<usize> = selection.chosen.iter().copied().filter(|v| *v != clock).collect();
    let given = Selection::given(problem, &others);
    if problem.gain(&given, delay).0 >= ONE_DELAY * problem.gain(&given, clock).0 {
        selection.ban(library, library.variants[clock].label);
        selection.chosen = others;
        selection.chosen.push(delay);
        problem.prepare(delay);
    }
}
