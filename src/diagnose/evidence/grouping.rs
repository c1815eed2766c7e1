//! Readings that carry the comparison: all of them, or means over short pieces of the path.

use std::collections::{BTreeMap, BTreeSet};

use super::super::constants::{MANY, MOVES, ROWS_MAX};
use super::super::library::STILL;
use super::super::moment::{Axis, Moment, SLOTS};
use super::super::noise::clipped_deviation;
use super::super::session::Session;
use volcomp_model::geometry::Vec3;

/// Range of some quantity over all readings where it is more than `least`.
fn span(session: &Session, least: f64, of: impl Fn(&Moment) -> f64) -> f64 {
    let values = session.moments.iter().map(of).filter(|v| v.is_finite());
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if high - low > least { high - low } else { f64::INFINITY }
}

/// What rows must share to be averaged, beside setup, instrument and direction of travel.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Alike {
    /// The direction of sensitivity, and the run where an axis moves.
    Exactly,
    /// The axis that they mostly look along: a ballbar turns its direction with every reading.
    Turning,
    /// The same, over all runs.
    AcrossRuns,
}

/// The axis that a reading mostly looks along, with its sign.
fn mostly(m: &Moment) -> i64 {
    let axis = m.u.iamax();
    if m.u[axis] < 0.0 { -1 - axis as i64 } else { axis as i64 }
}

/// Rows that look and travel alike, in order: only such are averaged.
struct Class {
    rows: Vec<usize>,
    /// An axis moves while some of them are read.
    is_moving: bool,
}

/// Rows by what they must share.
fn classes(session: &Session, rows: &[usize], what: Alike) -> Vec<Class> {
    let pass = |i: usize| {
        let r = &session.readings[i];
        [r.setup, r.run, r.instrument].map(|v| v as i64)
    };
    let moves = |i: &&usize| session.moments[**i].velocity.iter().any(|v| v.abs() > STILL);
    let in_motion: BTreeSet<[i64; 3]> = rows.iter().filter(moves).map(|i| pass(*i)).collect();
    let mut known: BTreeMap<Vec<i64>, usize> = BTreeMap::new();
    let mut all: Vec<Class> = Vec::new();
    for i in rows {
        let m = &session.moments[*i];
        let [setup, run, instrument] = pass(*i);
        let is_moving = in_motion.contains(&[setup, run, instrument]);
        let run = if is_moving && what != Alike::AcrossRuns { run } else { 0 };
        let mut key = vec![setup, run, instrument, i64::from(is_moving)];
        if what == Alike::Exactly {
            key.extend(m.u.iter().map(|c| (c * 1e4).round() as i64));
        } else {
            key.push(mostly(m));
        }
        key.extend(m.direction.iter().map(|d| *d as i64));
        let next = known.len();
        let at = *known.entry(key).or_insert(next);
        if at == all.len() {
            all.push(Class { rows: Vec::new(), is_moving });
        }
        all[at].rows.push(*i);
    }
    all
}

/// Place of a reading: its positions, then its direction of sensitivity.
fn place(m: &Moment, k: usize) -> f64 {
    m.position.get(k).copied().unwrap_or_else(|| m.u[k - SLOTS])
}

/// State of the machine at rest, in steps of a ten-thousandth of what is seen and of a thousandth of a mm or N.
fn state(m: &Moment, places: &[f64]) -> Vec<i64> {
    let at = (0..places.len()).map(|k| (1e4 * place(m, k) / places[k]).round() as i64);
    let points = [m.target_mm, m.station_mm, m.reflector_mm, m.lever_mm].into_iter();
    let rest = points.flat_map(|v| [v.x, v.y, v.z]).chain(m.force_n).chain([m.tool_length_mm, m.range_mm]);
    at.chain(rest.map(|v| (1e3 * v).round() as i64)).collect()
}

/// Shares out some `total`: all get as much, but none more than its `most`.
fn shared_out(most: &[usize], total: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..most.len()).collect();
    order.sort_by_key(|k| most[*k]);
    let (mut shares, mut left) = (vec![0; most.len()], total);
    for (at, k) in order.into_iter().enumerate() {
        shares[k] = most[k].min(left / (most.len() - at));
        left -= shares[k];
    }
    shares
}

/// Readings averaged into some [`ROWS_MAX`] groups, at most twice as many or nothing: along the path in position, speed, time and
/// time since a reversal where an axis moves while it is read, else by the state of the machine, then by time. Never by stride, which
/// would lose the samples under acceleration that tell a latency from a backlash. The mean of readings is a linear function of them,
/// so that effects are averaged alike and nothing is biased. Half of the groups go to all classes of readings alike, the others first
/// to states of the machine, then to readings: a long capture leaves a laser its targets, and a capture at rest keeps its course in time.
pub(super) fn groups(session: &Session, used: &[bool]) -> Option<Vec<Vec<usize>>> {
    let all: Vec<usize> = (0..used.len()).filter(|i| used[*i]).collect();
    if all.len() <= ROWS_MAX {
        return Some(all.into_iter().map(|i| vec![i]).collect());
    }
    let (what, classes) = [Alike::Exactly, Alike::Turning, Alike::AcrossRuns]
        .into_iter()
        .map(|what| (what, classes(session, &all, what)))
        .find(|(_, classes)| classes.len() <= ROWS_MAX)?;
    let mut places: Vec<f64> = (0..SLOTS)
        .map(|k| span(session, MOVES[usize::from(k >= Axis::LINEAR.len())], |m| m.position[k]))
        .collect();
    if what != Alike::Exactly {
        // components of a unit vector
        places.extend([2.0; 3]);
    }
    let velocity: Vec<f64> = (0..SLOTS).map(|k| span(session, 0.0, |m| m.velocity[k])).collect();
    // what friction does decays within readings of a reversal
    let since = |m: &Moment, k: usize| m.since_s[k].ln();
    let turned: Vec<f64> = (0..SLOTS).map(|k| span(session, 0.0, |m| since(m, k))).collect();
    let time = span(session, 0.0, |m| m.t_s);
    // a path is one state
    let at_rest = |c: &Class| if c.is_moving { Vec::new() } else { states(session, &c.rows, &places) };
    let states: Vec<Vec<Vec<usize>>> = classes.iter().map(at_rest).collect();
    let alike = ROWS_MAX / 2 / classes.len();
    let most: Vec<usize> =
        classes.iter().zip(&states).map(|(c, states)| states.len().max(alike).min(c.rows.len())).collect();
    let first = shared_out(&most, ROWS_MAX);
    let more: Vec<usize> = classes.iter().zip(&first).map(|(c, first)| c.rows.len() - first).collect();
    let more = shared_out(&more, ROWS_MAX - first.iter().sum::<usize>());
    let wanted = first.into_iter().zip(more).map(|(a, b)| (a + b).max(1));
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for ((class, states), wanted) in classes.into_iter().zip(states).zip(wanted) {
        if class.is_moving {
            let step = |a: usize, b: usize| {
                let (a, b) = (&session.moments[a], &session.moments[b]);
                let far = |of: &dyn Fn(&Moment, usize) -> f64, spans: &[f64]| -> f64 {
                    let each = spans.iter().enumerate().map(|(k, span)| (of(a, k) - of(b, k)) / span);
                    each.filter(|d| d.is_finite()).map(f64::abs).sum()
                };
                far(&place, &places)
                    + far(&|m, k| m.velocity[k], &velocity)
                    + far(&since, &turned)
                    + (b.t_s - a.t_s).abs() / time
            };
            along(&class.rows, wanted, &step, &mut groups);
        } else {
            split(session, states, wanted, &places, &mut groups);
        }
    }
    groups.sort_by_key(|g| g[0]);
    Some(groups)
}

/// Cuts rows into pieces of equal length along the path.
fn along(rows: &[usize], wanted: usize, step: &dyn Fn(usize, usize) -> f64, out: &mut Vec<Vec<usize>>) {
    let total: f64 = rows.windows(2).map(|w| step(w[0], w[1])).sum();
    let piece = total.max(f64::MIN_POSITIVE) / wanted as f64;
    let mut length = 0.0;
    let mut group = vec![rows[0]];
    for w in rows.windows(2) {
        let before = (length / piece).floor();
        length += step(w[0], w[1]);
        if (length / piece).floor() > before {
            out.push(std::mem::take(&mut group));
        }
        group.push(w[1]);
    }
    out.push(group);
}

/// Rows by the state of the machine.
fn states(session: &Session, rows: &[usize], places: &[f64]) -> Vec<Vec<usize>> {
    let mut all: BTreeMap<Vec<i64>, Vec<usize>> = BTreeMap::new();
    for i in rows {
        all.entry(state(&session.moments[*i], places)).or_default().push(*i);
    }
    all.into_values().collect()
}

/// Halves states of the machine by place until there are as many groups as wanted; the rows of one state by time.
fn split(
    session: &Session,
    mut states: Vec<Vec<usize>>,
    wanted: usize,
    places: &[f64],
    out: &mut Vec<Vec<usize>>,
) {
    if wanted < 2 {
        let mut rows = states.concat();
        rows.sort_unstable();
        out.push(rows);
        return;
    }
    if let [rows] = &states[..] {
        let time = |a: usize, b: usize| (session.moments[b].t_s - session.moments[a].t_s).abs();
        along(rows, wanted, &time, out);
        return;
    }
    let range = |k: usize| {
        let values = states.iter().flatten().map(|i| place(&session.moments[*i], k));
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        (high - low) / places[k]
    };
    let axis = (0..places.len()).max_by(|a, b| range(*a).total_cmp(&range(*b))).unwrap_or(0);
    let at = |state: &[usize]| place(&session.moments[state[0]], axis);
    states.sort_by(|a, b| at(a).total_cmp(&at(b)).then(a[0].cmp(&b[0])));
    let (low, all) = (states.len() / 2, states.len());
    let high = states.split_off(low);
    let first = (wanted * low / all).max(1);
    split(session, states, first, places, out);
    split(session, high, wanted - first, places, out);
}

/// White noise of a reading by the second differences of readings that follow each other within a group, in units of the class noise
/// `white` of each reading: of what is shorter than the groups their means say nothing. `left`: the gap without the causes. `None`
/// where too few readings were averaged.
pub(crate) fn white_within(left: &[f64], white: impl Fn(usize) -> f64, groups: &[Vec<usize>]) -> Option<f64> {
    let triples = groups.iter().flat_map(|g| g.windows(3)).filter(|w| w[1] == w[0] + 1 && w[2] == w[1] + 1);
    // of white noise their variance is that of a reading
    let second = |w: &[usize]| (left[w[0]] - 2.0 * left[w[1]] + left[w[2]]) / 6f64.sqrt() / white(w[1]);
    let all: Vec<f64> = triples.map(second).collect();
    (all.len() >= MANY).then(|| clipped_deviation(&all))
}

/// Mean state of the readings of each group.
pub(super) fn means(session: &Session, groups: &[Vec<usize>]) -> Vec<Moment> {
    groups
        .iter()
        .map(|rows| {
            let mut m = session.moments[rows[0]].clone();
            let mean = |of: &dyn Fn(&Moment) -> f64| {
                rows.iter().map(|i| of(&session.moments[*i])).sum::<f64>() / rows.len() as f64
            };
            m.t_s = mean(&|m| m.t_s);
            for k in 0..SLOTS {
                m.position[k] = mean(&|m| m.position[k]);
                m.velocity[k] = mean(&|m| m.velocity[k]);
            }
            // the mean gap of a constant error is its product with the mean direction, which is shorter than 1
            let first = m.u;
            m.u += rows.iter().map(|i| session.moments[*i].u - first).sum::<Vec3>() / rows.len() as f64;
            m
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use core::f64::consts::TAU;

    use super::super::super::noise::Random;
    use super::white_within;

    #[test]
    fn the_noise_of_readings_is_seen_beside_drift_and_between_means() {
        let mut random = Random::new(3);
        let groups: Vec<Vec<usize>> = (0..100).map(|g| (20 * g..20 * (g + 1)).collect()).collect();
        let slow = |k: usize| 30.0 * (TAU * k as f64 / 2000.0).sin();
        let gap: Vec<f64> = (0..2000).map(|k| slow(k) + 0.2 * random.normal()).collect();
        let within = white_within(&gap, |_| 1.0, &groups).unwrap();
        assert!((within - 0.2).abs() < 0.02, "{within}");
        let single: Vec<Vec<usize>> = (0..2000).map(|k| vec![k]).collect();
        assert_eq!(white_within(&gap, |_| 1.0, &single), None);
    }
}
