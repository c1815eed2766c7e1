//! Neighbours in space, for readings that were not taken in the order of their places and have no repeats (a table of
//! holes): what neighbours share is structure, what they do not is noise.

use std::collections::{BTreeMap, BTreeSet};

use super::super::constants::{HALF, NEARLY, ROWS};
use super::super::moment::{Moment, SLOTS};
use super::super::session::Session;
use super::median;

/// Readings count as out of order where they follow each other at this many times the distance of neighbours.
const APART: f64 = 2.0;
/// mm that a radian counts.
const MM_PER_RAD: f64 = 100.0;

/// Distance of two readings in the machine, mm.
fn distance(session: &Session, a: usize, b: usize) -> f64 {
    let (p, q) = (&session.moments[a].position, &session.moments[b].position);
    let of = |k: usize| (p[k] - q[k]) * if k < 3 { 1.0 } else { MM_PER_RAD };
    (0..p.len()).map(|k| of(k).powi(2)).sum::<f64>().sqrt()
}

/// Pairs of nearest neighbours of one pass and direction among `rows`; empty where readings follow their places.
#[must_use]
pub fn neighbours(session: &Session, rows: &[usize]) -> Vec<(usize, usize)> {
    let step = rows.len().div_ceil(ROWS).max(1);
    let rows: Vec<usize> = rows.iter().copied().step_by(step).collect();
    // another pass comes by the same places without being out of order
    let alike = |a: usize, b: usize| {
        session.readings[a].run == session.readings[b].run
            && session.readings[a].setup == session.readings[b].setup
            && session.readings[a].instrument == session.readings[b].instrument
            && session.moments[a].u.dot(&session.moments[b].u) > NEARLY
    };
    let mut pairs = BTreeSet::new();
    let (mut near, mut following) = (Vec::new(), Vec::new());
    for (k, a) in rows.iter().enumerate() {
        let best = rows
            .iter()
            .filter(|b| **b != *a && alike(*a, **b))
            .map(|b| (distance(session, *a, *b), *b))
            .filter(|(d, _)| *d > 1e-6)
            .min_by(|x, y| x.0.total_cmp(&y.0));
        let Some((d, b)) = best else { continue };
        near.push(d);
        pairs.insert(((*a).min(b), (*a).max(b)));
        if let Some(next) = rows[k + 1..].iter().take(3).find(|b| alike(*a, **b)) {
            following.push(distance(session, *a, *next));
        }
    }
    let ordered = following.is_empty() || median(&mut following) <= APART * median(&mut near);
    if ordered { Vec::new() } else { pairs.into_iter().collect() }
}

/// True where most readings look from another set-up, too, at the same place along the same direction: a part that was measured
/// again shows the noise as repeats do.
#[must_use]
pub fn is_revisited(session: &Session) -> bool {
    let key = |m: &Moment| -> Vec<i64> {
        let position = m.position.iter().map(|p| (p * 1e3).round() as i64);
        position.chain(m.u.iter().map(|c| (c * 50.0).round() as i64)).collect()
    };
    let mut setups: BTreeMap<Vec<i64>, BTreeSet<usize>> = BTreeMap::new();
    for (r, m) in session.readings.iter().zip(&session.moments) {
        setups.entry(key(m)).or_default().insert(r.setup);
    }
    let again = session.moments.iter().filter(|m| setups.get(&key(m)).is_some_and(|s| s.len() > 1)).count();
    again as f64 > HALF * session.moments.len() as f64
}

/// Median distance of a place from the nearest other one, each axis as a share of its range; infinite with one place.
#[must_use]
pub fn spacing(session: &Session) -> f64 {
    let positions = || session.moments.iter().map(|m| m.position);
    let bounds = |k: usize| {
        positions().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (l.min(p[k]), h.max(p[k])))
    };
    let ranges: Vec<f64> = (0..SLOTS).map(bounds).map(|(l, h)| h - l).collect();
    let key = |p: [f64; SLOTS]| p.map(|v| (v * 1e3).round() as i64);
    let mut places: Vec<[f64; SLOTS]> =
        positions().map(|p| (key(p), p)).collect::<BTreeMap<_, _>>().into_values().collect();
    let step = places.len().div_ceil(ROWS).max(1);
    places = places.into_iter().step_by(step).collect();
    let share = |p: &[f64; SLOTS], q: &[f64; SLOTS]| {
        let moved = (0..SLOTS).filter(|k| ranges[*k] > 1e-6);
        moved.map(|k| ((p[k] - q[k]) / ranges[k]).powi(2)).sum::<f64>().sqrt()
    };
    let nearest = |(i, p): (usize, &[f64; SLOTS])| {
        let others = places.iter().enumerate().filter(|(j, _)| *j != i);
        others.map(|(_, q)| share(p, q)).fold(f64::INFINITY, f64::min)
    };
    median(&mut places.iter().enumerate().map(nearest).collect::<Vec<f64>>())
}

#[cfg(test)]
mod tests {
    use super::super::super::machine_state::Machine;
    use super::super::super::session::{History, Raw, Session};
    use super::{is_revisited, spacing};

    /// Holes on a grid of four by four, once or in two clampings, 60 mm apart.
    fn plate(clampings: u32, shift_mm: f64) -> Session {
        let names = ["t_s", "setup", "run", "repeat", "x_mm", "y_mm", "u_x", "u_y", "u_z", "deviation_um"];
        let mut raw = Raw::made_up("plate", &names);
        for k in 0..16 * clampings {
            let [setup, i, j] = [k / 16, k % 4, k / 4 % 4].map(f64::from);
            for axis in [0.0, 1.0] {
                let [x, y] = [60.0 * i + shift_mm * setup, 60.0 * j];
                let t = 10.0 * f64::from(k) + axis;
                let row = [t, setup, setup, 0.0, x, y, 1.0 - axis, axis, 0.0, 0.7 * i - 0.3 * j + axis];
                raw.push("cmm", u64::from(k) + 2, &row);
            }
        }
        Session::build(&[raw], History::default(), Machine::plain()).expect("a session")
    }

    #[test]
    fn a_plate_measured_again_is_revisited() {
        assert!(
            !is_revisited(&plate(1, 0.0)) && is_revisited(&plate(2, 0.0)) && !is_revisited(&plate(2, 5.0))
        );
        assert!((spacing(&plate(2, 0.0)) - 1.0 / 3.0).abs() < 1e-9);
    }
}
