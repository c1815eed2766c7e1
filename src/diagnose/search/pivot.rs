//! The point about which an angular error turns: where nobody knows it, the error displaces by curves of the same form, too.
//!
//! `d = eps(q) x (r - c)`: with `eps` and `c` free this is linear in `eps` and in `eps c`, which starts the search; Gauss-Newton
//! steps end it.

use nalgebra::RowDVector;
use rayon::prelude::*;

use super::super::constants::{ROUNDS, STRONG};
use super::super::library::{Library, Shape, forms};
use super::super::noise::Filter;
use super::super::session::Session;
use super::beside::{Beside, Columns};
use super::problem::Problem;
use super::refine::put;
use super::select::{SAME_NOISE, SWAP_GAIN, Selection, evidence};

/// By how much the pivot moves for a derivative, mm.
const STEP_MM: f64 = 100.0;
/// Coordinates of a pivot across the axis of rotation.
const COORDINATES: usize = 2;

/// Gives angular errors a pivot of their own in the place of the displacements over the same axis that a pivot elsewhere asks for.
pub fn turn_about_pivots(
    problem: &mut Problem,
    session: &Session,
    filter: &Filter,
    library: &mut Library,
    selection: &mut Selection,
) {
    // what was chosen first: about its own pivot it may say all that another would
    let is_chosen = |label: &usize| selection.chosen.iter().any(|v| library.variants[*v].label == *label);
    let (chosen, rest): (Vec<usize>, Vec<usize>) = (0..library.labels.len()).partition(is_chosen);
    // what else hangs on the axis may be its form, too: a sag, a scale, a worn place
    let by_label = library.by_label();
    let mut in_vain = None;
    let every = chosen.into_iter().chain(rest).flat_map(|label| [(label, false), (label, true)]);
    for (label, with_lines) in every {
        let variants = &by_label[label];
        let Some(Shape::Angular(first)) = variants.first().map(|v| library.variants[*v].shape.clone()) else {
            continue;
        };
        let is_own = |v: &usize| library.variants[*v].label == label;
        let goes_with = |v: &usize| {
            let shape = &library.variants[*v].shape;
            let is_across = shape.acts_along().map(|a| a.direction() != first.about.direction());
            let displaces = !matches!(shape, Shape::Angular(_)) && is_across.unwrap_or(with_lines);
            displaces && shape.over() == Some(first.over) && (with_lines || shape.is_free_curve())
        };
        let (group, others): (Vec<usize>, Vec<usize>) =
            selection.chosen.iter().partition(|v| is_own(v) || goes_with(v));
        // one displacement is simpler than an angle, unless the angle was chosen
        if group.is_empty() || group.len() == 1 && !group.iter().any(is_own) {
            continue;
        }
        let tried = Some((label, group.clone()));
        if in_vain == tried {
            continue;
        }
        // an angle has a slope: what displaces must be allowed one, too
        let given = Selection::given(problem, &others);
        let sloped: Vec<usize> = group
            .iter()
            .map(|own| {
                let label = library.variants[*own].label;
                let value = |v: &usize| selection.found(problem, library, &given, *v).evidence;
                let sloped =
                    by_label[label].iter().copied().filter(|v| library.variants[*v].shape.has_slope());
                sloped.max_by(|a, b| value(a).total_cmp(&value(b))).unwrap_or(*own)
            })
            .collect();
        problem.prepare(&sloped);
        let [plain, sloped] =
            [&group, &sloped].map(|some| selection.evidence_beside(problem, library, &others, some));
        let now = plain.max(sloped);
        let beside = Beside::new(problem, &others);
        let grid = selection.grid[label];
        let turned = variants.par_iter().filter(|v| !selection.banned.contains(v)).filter_map(|v| {
            let Shape::Angular(shape) = &library.variants[*v].shape else { return None };
            let (shape, columns) = pivoted(&beside, problem, session, filter, shape.clone())?;
            let (gain, rank) = beside.says(&columns).0;
            Some((evidence(gain, rank + COORDINATES, grid), *v, shape))
        });
        let turned: Vec<_> = turned.collect();
        let Some((e, v, shape)) = turned.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
        // where the angle was not chosen, the lever must tell
        let wanted = match (group.len(), group.iter().any(is_own)) {
            (1, true) => now + SWAP_GAIN,
            (_, true) => now,
            _ => now + STRONG,
        };
        if e > wanted {
            put(problem, session, filter, library, v, shape);
            selection.chosen = others;
            selection.chosen.push(v);
            in_vain = None;
        } else {
            in_vain = tried;
        }
    }
    problem.prepare(&selection.chosen);
}

/// Gives a tilt under acceleration a pivot of its own in the place of a compliance of the same axis along itself: about a point at its
/// side, a tilt moves the tool along the axis, too.
pub fn tilt_about_pivots(
    problem: &mut Problem,
    session: &Session,
    filter: &Filter,
    library: &mut Library,
    selection: &mut Selection,
) {
    for tilt in selection.chosen.clone() {
        let Shape::InertialTilt(shape) = library.variants[tilt].shape.clone() else { continue };
        let is_along = |v: &usize| matches!(&library.variants[*v].shape, Shape::Inertial(i) if i.axis == shape.axis && i.along == shape.axis);
        let Some(along) = selection.chosen.iter().copied().find(is_along) else { continue };
        let others: Vec<usize> =
            selection.chosen.iter().copied().filter(|v| ![tilt, along].contains(v)).collect();
        let both = problem.given(&[&others[..], &[tilt, along]].concat()).explained
            - problem.given(&others).explained;
        let (gain, _, shape) = Beside::new(problem, &others).best(problem, session, filter, &shape.into());
        // a pivot in the place of a compliance: as many parameters, one cause
        if gain > both - SAME_NOISE {
            put(problem, session, filter, library, tilt, shape);
            selection.chosen = [&others[..], &[tilt]].concat();
            problem.prepare(&selection.chosen);
        }
    }
}

/// The error about the pivot that explains most, and its columns; `None` where the data know none.
fn pivoted(
    beside: &Beside,
    problem: &Problem,
    session: &Session,
    filter: &Filter,
    mut shape: forms::Angular,
) -> Option<(Shape, Columns)> {
    let across: Vec<usize> = (0..3).filter(|k| *k != shape.about.direction()).collect();
    let moved_to = |k: &usize| {
        let mut moved = shape.clone();
        moved.lever.home_mm[*k] += STEP_MM;
        Shape::from(moved)
    };
    let shapes: Vec<Shape> =
        std::iter::once(shape.clone().into()).chain(across.iter().map(moved_to)).collect();
    let columns = problem.columns_of(session, filter, &shapes.iter().collect::<Vec<_>>());
    let terms = columns.nrows() / shapes.len();
    let own = columns.rows(0, terms).into_owned();
    // a displacement by each term of the curve along each direction: the difference of two levers
    let mut all = columns;
    for k in 1..shapes.len() {
        let mut moved = all.rows_mut(k * terms, terms);
        moved -= &own;
    }
    let difference = |k: usize| all.rows((k + 1) * terms, terms);
    let found = beside.says(&all).1;
    let (curve, shifts) = found.split_at(terms);
    let square: f64 = curve.iter().map(|s| s * s).sum();
    if square <= 0.0 {
        return None;
    }
    let along_curve = |shift: &[f64]| curve.iter().zip(shift).map(|(s, b)| s * b).sum::<f64>();
    let mut steps: Vec<f64> = shifts.chunks(terms).map(|shift| along_curve(shift) / square).collect();
    // columns are linear in the pivot
    let moved = |steps: &[f64]| {
        steps.iter().enumerate().fold(own.clone(), |moved, (k, step)| moved + *step * difference(k))
    };
    for _ in 0..ROUNDS {
        let columns = moved(&steps);
        let curve = RowDVector::from_vec(beside.says(&columns).1);
        let mut columns = columns.insert_rows(terms, COORDINATES, 0.0);
        (0..COORDINATES).for_each(|k| columns.row_mut(terms + k).copy_from(&(&curve * difference(k))));
        let found = beside.says(&columns).1;
        steps.iter_mut().zip(&found[terms..]).for_each(|(s, step)| *s += step);
    }
    for (k, step) in across.iter().zip(&steps) {
        shape.lever.home_mm[*k] += STEP_MM * step;
    }
    let shape = Shape::from(shape);
    super::refine::is_local(session, &shape).then(|| (shape, moved(&steps)))
}
