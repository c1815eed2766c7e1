//! How far readings without repeats lie from their neighbours on a line of positions at which the machine rests.

use std::collections::BTreeMap;

use super::super::moment::SLOTS;
use super::super::session::Session;
use super::path::{EQUAL, EQUAL_RAD, OffPath, REACH, along, nearer};
use super::{median, moves};

/// Readings on either side that predict one, at most, and half of those that predict one at the end; [`REACH`] at least.
const FAR: usize = 3;

/// Readings at rest beside neighbours that are `used` on a line of positions along one linear axis, of one run, direction of the axis
/// and direction of measurement. Of two lines the one that a reading lies nearer to. What other readings at the same position deviate
/// by, too, is structure; `None` for the [`REACH`] at each end without such others.
pub(super) fn from_lines(session: &Session, gap: &[f64], used: &[bool]) -> Vec<Option<OffPath>> {
    let mut out: Vec<Option<OffPath>> = vec![None; gap.len()];
    let mut at_end = vec![false; gap.len()];
    let at_rest = |i: &usize| {
        let m = &session.moments[*i];
        !moves(m) && !m.is_ballbar && !m.is_encoder
    };
    for axis in 0..3 {
        let at = |i: usize| session.moments[i].position[axis];
        let mut lines: BTreeMap<_, Vec<usize>> = BTreeMap::new();
        for i in (0..gap.len()).filter(at_rest) {
            let (r, m) = (&session.readings[i], &session.moments[i]);
            let mut across = m.position;
            across[axis] = 0.0;
            let line = (r.run, r.instrument, along(m), place(&across), m.direction[axis] as i64);
            lines.entry(line).or_default().push(i);
        }
        for mut rows in lines.into_values() {
            rows.sort_by(|i, j| at(*i).total_cmp(&at(*j)));
            for i in rows.iter().copied() {
                let sides = neighbours(&rows, i, &at, used);
                if let Some(off) = off_line(gap, i, &sides)
                    && out[i].is_none_or(|o| off.off_um.abs() <= o.off_um.abs())
                {
                    out[i] = Some(off);
                    at_end[i] = sides.iter().any(|s| s.len() < REACH);
                }
            }
        }
    }
    let position = |i: usize| {
        let (r, m) = (&session.readings[i], &session.moments[i]);
        (r.setup, r.instrument, along(m), place(&m.position))
    };
    let mut same: BTreeMap<_, Vec<(usize, f64)>> = BTreeMap::new();
    for (i, off) in out.iter().enumerate().filter_map(|(i, off)| Some((i, (*off)?))) {
        same.entry(position(i)).or_default().push((i, off.off_um));
    }
    for i in 0..gap.len() {
        let Some(off) = &mut out[i] else { continue };
        let others = same[&position(i)].iter().filter(|(j, _)| *j != i);
        off.nearest_um = others.clone().map(|(_, um)| off.off_um - um).fold(off.nearest_um, nearer);
        if at_end[i] && others.count() == 0 {
            out[i] = None;
        }
    }
    out
}

/// The readings `used` before and behind reading `i` on a line of `rows` in the order of their places (`at`), the nearest first, with
/// their distances: equally many on either side, but at the ends.
fn neighbours(rows: &[usize], i: usize, at: &dyn Fn(usize) -> f64, used: &[bool]) -> [Vec<(usize, f64)>; 2] {
    let apart = |j: usize| at(j) - at(i);
    let ahead = rows.partition_point(|j| apart(*j) < -EQUAL);
    let behind = rows.partition_point(|j| apart(*j) <= EQUAL);
    let nearest = |some: &mut dyn Iterator<Item = &usize>| {
        some.copied().filter(|j| used[*j]).take(2 * FAR).map(|j| (j, apart(j))).collect::<Vec<_>>()
    };
    let mut sides = [nearest(&mut rows[..ahead].iter().rev()), nearest(&mut rows[behind..].iter())];
    let fewer = sides[0].len().min(sides[1].len());
    let most = if fewer < REACH { 2 * FAR - fewer } else { FAR.min(fewer) };
    sides.iter_mut().for_each(|s| s.truncate(most));
    sides
}

/// Positions that are equal have the same numbers.
fn place(position: &[f64; SLOTS]) -> [i64; SLOTS] {
    core::array::from_fn(|s| (position[s] / if s < 3 { EQUAL } else { EQUAL_RAD }).round() as i64)
}

/// The reading `i` beside Theil and Sen's line through its neighbours on both sides, with their distances along the line: some of them
/// may be outliers, too. `None` where they are few, or two of them stand at one position.
fn off_line(gap: &[f64], i: usize, sides: &[Vec<(usize, f64)>; 2]) -> Option<OffPath> {
    let mut near = sides.concat();
    near.sort_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
    let pairs: Vec<(usize, usize)> = (0..near.len()).flat_map(|k| (0..k).map(move |l| (k, l))).collect();
    if near.len() < 2 * REACH || pairs.iter().any(|(k, l)| (near[*k].1 - near[*l].1).abs() < EQUAL) {
        return None;
    }
    let steep = |(k, l): &(usize, usize)| (gap[near[*k].0] - gap[near[*l].0]) / (near[*k].1 - near[*l].1);
    let slope = median(&mut pairs.iter().map(steep).collect::<Vec<f64>>());
    let from = |some: &[(usize, f64)]| {
        gap[i] - median(&mut some.iter().map(|(j, at)| gap[*j] - slope * at).collect::<Vec<f64>>())
    };
    let off_um = from(&near);
    let of_one_side = sides.iter().filter(|s| s.len() >= REACH).map(|s| from(s));
    let neighbours = core::array::from_fn(|k| near[k].0);
    Some(OffPath { off_um, nearest_um: of_one_side.fold(off_um, nearer), neighbours })
}
