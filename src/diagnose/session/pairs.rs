//! Which rows are the same programmed point in different repeats.
//!
//! The column `pair` may number points, or whole passes whose rows then correspond in order. Where an instrument of a file has no
//! numbers, rows of equal commanded state correspond. Partners must stand at the same place and look the same way.

use std::collections::BTreeMap;

/// What identifies the place of a row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    /// Index of file and instrument class.
    pub(super) class: (usize, usize),
    pub(super) setup: usize,
    pub(super) repeat: i64,
    /// NaN without one.
    pub(super) pair: f64,
    /// Positions, mm or deg.
    pub(super) position: [f64; 6],
    pub(super) direction: [f64; 6],
    pub(super) u: [f64; 3],
    pub(super) tool: f64,
}

/// Number, or setup and state.
type Key = (i64, [i64; 16]);

/// Partners may stand so far apart, mm or deg.
const NEAR: f64 = 2.0;

fn rounded(v: f64, step: f64) -> i64 {
    if v.is_finite() { (v / step).round() as i64 } else { i64::MIN }
}

/// A number per row that partners share.
pub(super) fn find(places: &[Place]) -> Vec<Option<usize>> {
    // one file or instrument may number its points while another does not
    let mut classes: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
    for (i, p) in places.iter().enumerate() {
        classes.entry(p.class).or_default().push(i);
    }
    let mut out = vec![None; places.len()];
    let mut next = 0;
    for rows in classes.values().flat_map(|rows| groups(places, rows)) {
        let first = &places[rows[0]];
        let same: Vec<usize> = rows.into_iter().filter(|r| corresponds(&places[*r], first)).collect();
        let repeats = same.iter().any(|r| places[*r].repeat != first.repeat);
        if repeats {
            for r in same {
                out[r] = Some(next);
            }
            next += 1;
        }
    }
    out
}

/// Which of some `rows` of one file and instrument have the same number, or without numbers the same commanded state.
fn groups(places: &[Place], rows: &[usize]) -> Vec<Vec<usize>> {
    let of: Vec<&Place> = rows.iter().map(|i| &places[*i]).collect();
    let numbered = of.iter().any(|p| p.pair.is_finite());
    let by_point = numbered && is_by_point(&of);
    let mut seen: BTreeMap<(Key, i64), usize> = BTreeMap::new();
    let mut groups: BTreeMap<(Key, usize), Vec<usize>> = BTreeMap::new();
    for (i, p) in rows.iter().zip(of) {
        if numbered && !p.pair.is_finite() {
            continue;
        }
        let mut state = [0i64; 16];
        if !numbered || by_point {
            for (s, u) in state[12..15].iter_mut().zip(p.u) {
                *s = rounded(u, 0.05);
            }
        }
        if !numbered {
            for k in 0..6 {
                state[k] = rounded(p.position[k], 1e-3);
                state[6 + k] = rounded(p.direction[k], 1.0);
            }
            state[15] = rounded(p.tool, 1e-2);
        }
        let key = (if numbered { p.pair as i64 } else { p.setup as i64 }, state);
        let count = seen.entry((key, p.repeat)).or_default();
        groups.entry((key, *count)).or_default().push(*i);
        *count += 1;
    }
    groups.into_values().collect()
}

fn corresponds(a: &Place, b: &Place) -> bool {
    let near = |x: f64, y: f64| (x - y).abs() <= NEAR || (x.is_nan() && y.is_nan());
    a.position.iter().zip(b.position).all(|(x, y)| near(*x, y))
        && a.u.iter().zip(b.u).all(|(x, y)| (x - y).abs() < 0.05)
}

/// True where a pair number stands for a point: few rows of one repeat share it.
fn is_by_point(places: &[&Place]) -> bool {
    let mut counts: BTreeMap<(i64, i64), usize> = BTreeMap::new();
    for p in places.iter().filter(|p| p.pair.is_finite()) {
        *counts.entry((p.pair as i64, p.repeat)).or_default() += 1;
    }
    let mut sizes: Vec<usize> = counts.into_values().collect();
    sizes.sort_unstable();
    sizes.get(sizes.len() / 2).is_some_and(|m| *m <= 3)
}
