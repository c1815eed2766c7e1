//! The non-linear parameters of a chosen effect between the values of its grid: a search by shrinking steps.

use super::super::library::{Library, Shape};
use super::super::moment::Axis;
use super::super::noise::Filter;
use super::super::session::Session;
use super::problem::Problem;
use super::small::Factor;

/// First and last relative step.
pub(super) const STEPS: [f64; 5] = [0.25, 0.12, 0.05, 0.02, 0.008];

/// Copies of a shape whose non-linear parameters are a little larger or smaller.
pub(super) fn neighbours(shape: &Shape, step: f64) -> Vec<Shape> {
    let mut all = Vec::new();
    let up = 1.0 + step;
    let mut with = |change: &dyn Fn(&mut Shape, f64)| {
        for f in [up, 1.0 / up] {
            let mut s = shape.clone();
            change(&mut s, f);
            if s != *shape {
                all.push(s);
            }
        }
    };
    match shape {
        Shape::Backlash { .. } => with(&|s, f| {
            if let Shape::Backlash { length_mm, .. } = s {
                *length_mm *= f;
            }
        }),
        Shape::Spike { .. } => {
            with(&|s, f| {
                if let Shape::Spike { fall_s, .. } = s {
                    *fall_s *= f;
                }
            });
            with(&|s, f| {
                if let Shape::Spike { rise_s, .. } = s {
                    *rise_s *= f;
                }
            });
        }
        Shape::Cyclic { .. } => with(&|s, f| {
            if let Shape::Cyclic { pitch_mm, .. } = s {
                // a pitch is known to a small part of a period over the travel
                *pitch_mm *= 1.0 + (f - 1.0) * 0.04;
            }
        }),
        Shape::Sag { .. } => with(&|s, f| {
            if let Shape::Sag { length_mm, .. } = s {
                *length_mm *= f;
            }
        }),
        Shape::Wear { width_mm: width, .. } => {
            let width = *width;
            with(&|s, f| {
                if let Shape::Wear { width_mm, .. } = s {
                    *width_mm *= f;
                }
            });
            with(&|s, f| {
                if let Shape::Wear { centre_mm, .. } = s {
                    *centre_mm += width * (f - 1.0) * 2.0;
                }
            });
            with(&|s, f| {
                if let Shape::Wear { power, .. } = s {
                    *power *= f;
                }
            });
            with(&|s, f| {
                if let Shape::Wear { order, .. } = s {
                    // a bell has no end; from here on one is looked for
                    *order = Some(order.map_or(WEAR_ORDERS[1], |order| order * f * f));
                }
            });
        }
        Shape::InertialTilt { about, .. } => {
            for slot in (0..3).filter(|k| about.iter().any(|b| b.direction() != *k)) {
                with(&|s, f| {
                    if let Shape::InertialTilt { lever, .. } = s {
                        lever.home_mm[slot] += PIVOT_STEP_MM * (f - 1.0);
                    }
                });
            }
        }
        _ => {}
    }
    all.retain(is_itself);
    all
}

/// Step with which the point about which a structure tilts is looked for, mm, and how far from the tool it may lie, as a
/// multiple of the longest travel: about a point far away everything moves alike, which is another effect.
const PIVOT_STEP_MM: f64 = 1000.0;
const PIVOT_MAX: f64 = 0.5;

/// Longest decay of a reversal spike, s: a longer one is lost motion under another name.
const SPIKE_MAX_S: f64 = 0.8;
/// Longest rise of a spike, as a share of its decay.
const RISE_SHARE: f64 = 0.6;
/// How flat the bottom of a worn place may be: from a dent to a trough.
const WEAR_POWERS: [f64; 2] = [1.5, 6.0];
/// How sharply it may end: from a step at its rim to nearly a bell.
const WEAR_ORDERS: [f64; 2] = [0.5, 8.0];
/// Longest transition of lost motion, mm.
const TRANSITION_MAX_MM: f64 = 15.0;

/// False where a parameter has left the range in which the effect is what its name says.
fn is_itself(shape: &Shape) -> bool {
    match shape {
        Shape::Spike { rise_s, fall_s, .. } => *fall_s <= SPIKE_MAX_S && *rise_s <= RISE_SHARE * *fall_s,
        Shape::Backlash { length_mm, .. } => *length_mm <= TRANSITION_MAX_MM,
        Shape::Wear { power, order, .. } => {
            let is_within = |range: [f64; 2], v: &f64| (range[0]..=range[1]).contains(v);
            is_within(WEAR_POWERS, power) && order.as_ref().is_none_or(|o| is_within(WEAR_ORDERS, o))
        }
        _ => true,
    }
}

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
    if let Shape::Lag { axes, .. } = &shape {
        tie(problem, session, filter, library, chosen, place, axes.clone());
        return;
    }
    if neighbours(&shape, STEPS[0]).is_empty() {
        return;
    }
    let others: Vec<usize> =
        chosen.iter().enumerate().filter(|(i, _)| *i != place).map(|(_, v)| *v).collect();
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

/// Half the width of a worn place at half its depth, as a share of the travel: wider it is a table, narrower a wave.
const WIDTH_RANGE: [f64; 2] = [0.026, 0.142];

/// Longest beam, as a multiple of the travel: a longer one is a parabola under another name.
const BEAM_MAX: f64 = 3.0;

/// False where a worn place lies beyond the data, is as wide as the travel or as narrow as a wave, a beam far longer than the travel, or a
/// structure tilts about a point far away.
fn is_local(session: &Session, shape: &Shape) -> bool {
    let span = |axis: &Axis| {
        let all = session.moments.iter().map(|m| m.position[axis.slot()]);
        all.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], v| [l.min(v), h.max(v)])
    };
    if let Shape::InertialTilt { lever, .. } = shape {
        let longest = Axis::LINEAR.iter().map(span).map(|[low, high]| high - low).fold(0.0, f64::max);
        let tip: [f64; 3] = session.machine.tool_tip_mm.into();
        return (0..3).all(|k| (lever.home_mm[k] - tip[k]).abs() <= PIVOT_MAX * longest);
    }
    let (Shape::Wear { axis, .. } | Shape::Sag { axis, .. }) = shape else { return true };
    let [low, high] = span(axis);
    match shape {
        Shape::Wear { centre_mm, width_mm, power, order, .. } => {
            let depth = order.map_or(std::f64::consts::LN_2, |n| n * (1.0 - 0.5f64.powf(1.0 / n)));
            let half_mm = width_mm * (2.0 * depth).powf(1.0 / power);
            (low..=high).contains(centre_mm)
                && (WIDTH_RANGE[0]..=WIDTH_RANGE[1]).contains(&(half_mm / (high - low)))
        }
        Shape::Sag { length_mm, .. } => *length_mm <= BEAM_MAX * (high - low),
        _ => true,
    }
}

/// The effects that stay, for what is compared beside them.
pub(super) struct Beside {
    /// Their whitened columns.
    columns: Vec<Vec<f64>>,
    /// Products of all pairs of them, row by row.
    products: Vec<Vec<f64>>,
    /// Products with what is explained.
    right: Vec<f64>,
    y: Vec<f64>,
    /// Drop of the sum of squares by them alone, and how many of them are independent.
    ground: (f64, usize),
}

impl Beside {
    pub(super) fn new(problem: &Problem, others: &[usize]) -> Self {
        let columns = others.iter().flat_map(|v| problem.span[*v].0..problem.span[*v].0 + problem.span[*v].1);
        Self::of(columns.map(|c| problem.w.row(c).iter().copied().collect()).collect(), problem)
    }

    fn of(columns: Vec<Vec<f64>>, problem: &Problem) -> Self {
        let y: Vec<f64> = problem.y.iter().copied().collect();
        let products =
            (0..columns.len()).map(|i| columns[..=i].iter().map(|c| dot(&columns[i], c)).collect()).collect();
        let right = columns.iter().map(|c| dot(c, &y)).collect();
        let mut beside = Self { columns, products, right, y, ground: (0.0, 0) };
        beside.ground = beside.joint(&[]);
        beside
    }

    /// Drop of the sum of squares by these columns and more together, and the number of independent ones.
    fn joint(&self, more: &[Vec<f64>]) -> (f64, usize) {
        let (k, n) = (self.columns.len(), self.columns.len() + more.len());
        let mut g = vec![0.0; n * n];
        let mut set = |i: usize, j: usize, v: f64| {
            g[i * n + j] = v;
            g[j * n + i] = v;
        };
        for (i, row) in self.products.iter().enumerate() {
            row.iter().enumerate().for_each(|(j, v)| set(i, j, *v));
        }
        for (i, column) in more.iter().enumerate() {
            let known = self.columns.iter().chain(&more[..=i]);
            known.enumerate().for_each(|(j, c)| set(k + i, j, dot(column, c)));
        }
        let full: Vec<f64> = (0..n).map(|i| g[i * n + i]).collect();
        let b: Vec<f64> = self.right.iter().copied().chain(more.iter().map(|c| dot(c, &self.y))).collect();
        let factor = Factor::new(n, &g, &full);
        (factor.gain(&b), factor.rank())
    }

    /// What a shape brings with the best values near its own, the number of its independent columns, and that shape.
    pub(super) fn best(
        &self,
        problem: &Problem,
        session: &Session,
        filter: &Filter,
        shape: &Shape,
    ) -> (f64, usize, Shape) {
        let score = |shape: &Shape| self.joint(&problem.whitened(session, filter, shape));
        let mut shape = shape.clone();
        let mut best = score(&shape);
        for step in STEPS {
            for _ in 0..6 {
                let better = neighbours(&shape, step)
                    .into_iter()
                    .filter(|s| is_local(session, s))
                    .map(|s| (score(&s), s))
                    .filter(|(g, _)| g.0 > best.0 + 1e-6)
                    .max_by(|a, b| a.0.0.total_cmp(&b.0.0));
                let Some((gain, s)) = better else { break };
                (best, shape) = (gain, s);
            }
        }
        (best.0 - self.ground.0, best.1 - self.ground.1, shape)
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// A lag is a delay (its second term is half its square) or a filter (its square), or neither; a free second term would
/// pass the compliance of the structure off as a lag.
fn tie(
    problem: &mut Problem,
    session: &Session,
    filter: &Filter,
    library: &mut Library,
    chosen: &[usize],
    place: usize,
    axes: Vec<Axis>,
) {
    let variant = chosen[place];
    for v in chosen {
        problem.prepare(*v);
    }
    let given = problem.given(chosen);
    let (at, _) = problem.span[variant];
    let beta = problem.fit(&given);
    let own = given.columns.iter().position(|c| *c == at).map_or(0.0, |j| beta[j]);
    let norm = problem.norm[at];
    let lag_ms = if norm > 0.0 { own / norm } else { 0.0 };
    let base: Vec<Vec<f64>> = given
        .columns
        .iter()
        .filter(|c| **c != at)
        .map(|c| problem.w.row(*c).iter().copied().collect())
        .collect();
    let beside = Beside::of(base, problem);
    let best = [0.0, 0.5 * lag_ms, lag_ms]
        .into_iter()
        .filter(|t| *t >= 0.0)
        .map(|tie_ms| Shape::Lag { axes: axes.clone(), tie_ms })
        .map(|s| (beside.joint(&problem.whitened(session, filter, &s)).0, s))
        .max_by(|a, b| a.0.total_cmp(&b.0));
    if let Some((_, shape)) = best {
        put(problem, session, filter, library, variant, shape);
    }
}
