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
        let mut lines: BTreeMap<_, Vec<usize>> = BTreeMap::new();
        for i in (0..gap.len()).filter(at_rest) {
            let (r, m) = (&session.readings[i], &session.moments[i]);
            let mut across = m.position;
            across[axis] = 0.0;
            let line = (r.run, r.instrument, along(m), place(&across), m.direction[axis] as i64);
            lines.entry(line).or_default().push(i);
        }
        for mut rows in lines.into_values() {
            let at = |i: usize| session.moments[i].position[axis];
            rows.sort_by(|i, j| at(*i).total_cmp(&at(*j)));
            for i in &rows {
                let apart = |j: &usize| (*j, at(*j) - at(*i));
                let ahead = rows.partition_point(|j| apart(j).1 < -EQUAL);
                let behind = rows.partition_point(|j| apart(j).1 <= EQUAL);
                let nearest = |some: &mut dyn Iterator<Item = &usize>| {
                    some.filter(|j| used[**j]).take(2 * FAR).map(apart).collect::<Vec<_>>()
                };
                let mut sides =
                    [nearest(&mut rows[..ahead].iter().rev()), nearest(&mut rows[behind..].iter())];
                let fewer = sides[0].len().min(sides[1].len());
                let is_inside = fewer >= REACH;
                let most = if is_inside { FAR.min(fewer) } else { 2 * FAR - fewer };
                sides.iter_mut().for_each(|s| s.truncate(most));
                if let Some(off) = off_line(gap, *i, &sides)
                    && out[*i].is_none_or(|o| off.off_um.abs() <= o.off_um.abs())
                {
                    out[*i] = Some(off);
                    at_end[*i] = !is_inside;
                }
            }
        }
    }
    let mut places: BTreeMap<_, Vec<usize>> = BTreeMap::new();
    for i in (0..gap.len()).filter(|i| out[*i].is_some()) {
        let (r, m) = (&session.readings[i], &session.moments[i]);
        places.entry((r.setup, r.instrument, along(m), place(&m.position))).or_default().push(i);
    }
    let off_um: Vec<f64> = out.iter().map(|o| o.map_or(f64::NAN, |o| o.off_um)).collect();
    for i in 0..gap.len() {
        let Some(off) = &mut out[i] else { continue };
        let (r, m) = (&session.readings[i], &session.moments[i]);
        let same = &places[&(r.setup, r.instrument, along(m), place(&m.position))];
        let apart = same.iter().filter(|j| **j != i).map(|j| off_um[i] - off_um[*j]);
        off.nearest_um = apart.fold(off.nearest_um, nearer);
        if at_end[i] && same.len() == 1 {
            out[i] = None;
        }
    }
    out
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
