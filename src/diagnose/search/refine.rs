//! The non-linear parameters of a chosen effect between the values of its grid: a search by shrinking steps.

use super::super::library::{Library, Shape, forms};
use super::super::moment::{Axis, Source};
use super::super::noise::Filter;
use super::super::session::Session;
use super::beside::Beside;
use super::problem::Problem;
use super::select::{Selection, others};

/// First and last relative step.
pub(super) const STEPS: [f64; 6] = [0.25, 0.12, 0.05, 0.02, 0.008, 0.003];

/// Most moves of one step of the search for a response.
const RESPONSE_MOVES: usize = 4;
/// A velocity loop that lags by more of the lag of its position loop lets it oscillate.
const HALF: f64 = 0.5;

/// Improves the chosen variant at `place`; the others stay.
pub fn refine(
    problem: &mut Problem,
    session: &Session,
    filter: &Filter,
    library: &mut Library,
    chosen: &[usize],
    place: usize,
) {
    let variant = chosen[place];
    let mut shape = library.variants[variant].shape.clone();
    if let Shape::Lag(forms::Lag { axes, .. }) = &shape {
        let axes = axes.clone();
        tie(problem, session, filter, library, chosen, place, &axes);
        return;
    }
    if shape.neighbours(STEPS[0]).is_empty() {
        return;
    }
    let others = others(chosen, &[place]);
    problem.prepare(&others);
    let beside = Beside::new(problem, &others);
    (.., shape) = beside.best(problem, session, filter, &shape);
    put(problem, session, filter, library, variant, shape);
}

/// Gives a variant another shape, and the problem its columns.
pub(super) fn put(
    problem: &mut Problem,
    session: &Session,
    filter: &Filter,
    library: &mut Library,
    variant: usize,
    shape: Shape,
) {
    if shape != library.variants[variant].shape {
        problem.replace(session, filter, variant, &shape);
        library.variants[variant].shape = shape;
    }
}

/// False where a parameter has left the range in which these data let the effect be what its name says.
pub(super) fn is_local(session: &Session, shape: &Shape) -> bool {
    let span = |axis: Axis| {
        let all = session.moments.iter().map(|m| m.position[axis.slot()]);
        all.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], v| [l.min(v), h.max(v)])
    };
    shape.is_within(&span, session.machine.tool_tip_mm.into())
}

/// A lag is a delay (its second term is half its square), a position loop, or neither; a free second term would pass the compliance
/// of the structure off as a lag.
fn tie(
    problem: &mut Problem,
    session: &Session,
    filter: &Filter,
    library: &mut Library,
    chosen: &[usize],
    place: usize,
    axes: &[Axis],
) {
    let variant = chosen[place];
    let others: Vec<usize> = chosen.iter().copied().filter(|v| *v != variant).collect();
    problem.prepare(&others);
    let beside = Beside::new(problem, &others);
    let says = |problem: &Problem, shape: &Shape| {
        let ((gain, _), values) = beside.says(&problem.columns_of(session, filter, &[shape]));
        (gain, values[0])
    };
    let loose = Shape::Lag(forms::Lag::of(axes.to_vec()));
    let (gain, lag_ms) = says(problem, &loose);
    let mut candidates = vec![(gain, loose)];
    if lag_ms > 0.0 {
        let delay = Shape::Lag(forms::Lag::delay(axes.to_vec(), lag_ms));
        candidates.push((says(problem, &delay).0, delay));
        candidates.extend(position_loop(session, problem.precise, (axes, lag_ms), &|s| says(problem, s)));
    }
    let best = candidates.into_iter().max_by(|a, b| a.0.total_cmp(&b.0));
    let Some((_, Shape::Lag(found))) = best else { return };
    // what the same readings see is the same response under any name
    let seen = session.axes_seen();
    let of = |axes: &[Axis]| seen.iter().filter(|a| axes.contains(a)).copied().collect::<Vec<_>>();
    for other in 0..library.variants.len() {
        let Shape::Lag(lag) = &library.variants[other].shape else { continue };
        if of(&lag.axes) == of(axes) {
            let same = Shape::Lag(found.over(lag.axes.clone()));
            put(problem, session, filter, library, other, same);
        }
    }
}

/// Root of the sum of squares that some variants leave, whitened.
fn left(problem: &mut Problem, chosen: &[usize]) -> f64 {
    let given = Selection::given(problem, chosen);
    (problem.y.norm_squared() - given.explained).max(0.0).sqrt()
}

/// On the control's own encoders a response for each axis in the place of a common one and differences from it, where that says
/// more: the difference of two responses is no response.
pub fn one_response_per_axis(
    problem: &mut Problem,
    session: &Session,
    filter: &Filter,
    library: &mut Library,
    selection: &mut Selection,
) {
    let is_lag = |v: &usize| matches!(library.variants[*v].shape, Shape::Lag(_));
    let (lags, others): (Vec<usize>, Vec<usize>) = selection.chosen.iter().partition(|v| is_lag(v));
    let seen = session.axes_seen();
    let own: Vec<usize> = (0..library.variants.len())
        .filter(|v| matches!(&library.variants[*v].shape, Shape::Lag(lag) if matches!(lag.axes[..], [a] if seen.contains(&a))))
        .collect();
    if !problem.precise || lags.is_empty() || own.len() < 2 {
        return;
    }
    let now = left(problem, &selection.chosen);
    let before: Vec<Shape> = own.iter().map(|v| library.variants[*v].shape.clone()).collect();
    let apart = [&others[..], &own].concat();
    for place in others.len()..apart.len() {
        refine(problem, session, filter, library, &apart, place);
    }
    // no model of a drive is exact: drives are taken for alike unless half of what is left goes
    if left(problem, &apart) < HALF * now {
        lags.iter()
            .filter(|v| !own.contains(v))
            .for_each(|v| selection.ban(library, library.variants[*v].label));
        selection.chosen = apart;
        return;
    }
    for (v, shape) in own.iter().zip(before) {
        put(problem, session, filter, library, *v, shape);
    }
    problem.prepare(&selection.chosen);
}

/// The position loop whose lag is what it takes as its time constant, and what it explains; none where the velocities are not
/// known. The control's own encoders see no compliance of the structure: of theirs the lag of the velocity loop and a dead time
/// are found, too.
fn position_loop(
    session: &Session,
    is_servo: bool,
    (axes, lag_ms): (&[Axis], f64),
    says: &dyn Fn(&Shape) -> (f64, f64),
) -> Option<(f64, Shape)> {
    let known = |a: &Axis| session.history.sources().contains(&Source::Velocity(*a));
    if !axes.iter().all(known) {
        return None;
    }
    // a position loop alone, with a velocity loop, a dead time alone
    let begins: &[[f64; 2]] = if is_servo { &[[0.0, 1.0], [0.0, 0.75], [1.0, 0.5]] } else { &[[0.0, 1.0]] };
    let found = begins.iter().map(|begin| response(is_servo, (axes, lag_ms), *begin, says));
    found.max_by(|a, b| a.0.total_cmp(&b.0))
}

/// The best response found from a share of the dead time in the lag and the second coefficient of its series, over the square of the
/// lag: dead time and velocity loop nearly say the same, and along this coefficient they differ most.
fn response(
    is_servo: bool,
    (axes, mut lag_ms): (&[Axis], f64),
    mut at: [f64; 2],
    says: &dyn Fn(&Shape) -> (f64, f64),
) -> (f64, Shape) {
    // without a velocity loop the coefficient is largest
    let largest = |dead: f64| 1.0 - dead + 0.5 * dead * dead;
    let of = |lag_ms: f64, [dead, second]: [f64; 2]| {
        let rest = 1.0 - dead;
        let inner = if rest > 0.0 { (largest(dead) - second) / rest } else { 0.0 };
        let inner = inner.clamp(0.0, HALF * rest);
        let times_ms = [dead * lag_ms, inner * lag_ms];
        Shape::Lag(forms::Lag::response(axes.to_vec(), lag_ms, times_ms))
    };
    for step in STEPS {
        for _ in 0..RESPONSE_MOVES {
            let found_ms = says(&of(lag_ms, at)).1;
            if found_ms <= 0.0 {
                break;
            }
            lag_ms = found_ms;
            if !is_servo {
                break;
            }
            let near = [[-step, 0.0], [step, 0.0], [0.0, -step], [0.0, step]];
            let near = near.map(|[d, s]| [(at[0] + d).clamp(0.0, 1.0), at[1] + s]);
            let gains = near.into_iter().chain([at]).map(|a| (says(&of(lag_ms, a)).0, a));
            let best = gains.max_by(|a, b| a.0.total_cmp(&b.0)).map_or(at, |best| best.1);
            if best == at {
                break;
            }
            at = best;
        }
    }
    let shape = of(lag_ms, at);
    (says(&shape).0, shape)
}
