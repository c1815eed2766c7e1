//! Neighbours in space, for readings that were not taken in the order of their places and have no repeats (a table of
//! holes): what neighbours share is structure, what they do not is noise.

use std::collections::BTreeSet;

use super::super::constants::{NEARLY, ROWS};
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

/// Pairs of nearest neighbours of one setup and direction among `rows`; empty where readings follow their places.
#[must_use]
pub fn neighbours(session: &Session, rows: &[usize]) -> Vec<(usize, usize)> {
    let step = rows.len().div_ceil(ROWS).max(1);
    let rows: Vec<usize> = rows.iter().copied().step_by(step).collect();
    let alike = |a: usize, b: usize| {
        session.readings[a].setup == session.readings[b].setup
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
