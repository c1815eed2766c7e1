//! How far readings without repeats lie from the path of their neighbours: on the circles of a ballbar, and at standstill.

use std::collections::BTreeMap;

use super::super::constants::FEW;
use super::super::moment::{MachineState, SLOTS};
use super::super::session::Session;

/// Readings before and behind that a line on a path goes through.
pub(super) const REACH: usize = 2;
/// Positions of linear axes (mm), forces (N) and lengths (mm) that differ by less are equal; and positions of rotary axes, rad.
pub(super) const EQUAL: f64 = 1e-3;
pub(super) const EQUAL_RAD: f64 = 1e-5;

/// A reading beside its neighbours on a path or a line of positions.
#[derive(Debug, Clone, Copy)]
pub(super) struct OffPath {
    /// The reading minus what its neighbours predict, on a path the cubic through the two before it and the two behind, um.
    pub(super) off_um: f64,
    /// The smallest of that and of what those before and those behind predict alone, um: a step or a bump is no outlier.
    pub(super) nearest_um: f64,
    /// The two before and the two behind.
    pub(super) neighbours: [usize; 2 * REACH],
}

/// Readings of ballbars and at standstill beside neighbours that are `used`. `None` for others, at the ends of a series, and soon after
/// a reversal, a stop or the beginning at standstill, where the path may be sharp.
pub(super) fn from_path(session: &Session, gap: &[f64], used: &[bool]) -> Vec<Option<OffPath>> {
    let mut series: BTreeMap<_, Vec<usize>> = BTreeMap::new();
    for (i, (r, m)) in session.readings.iter().zip(&session.moments).enumerate() {
        let along = if m.is_ballbar { [0; 3] } else { along(m) };
        series.entry((r.run, r.instrument, along)).or_default().push(i);
    }
    let mut out = vec![None; gap.len()];
    for rows in series.into_values() {
        let moment = |rank: usize| &session.moments[rows[rank]];
        let mut stands_since = vec![0; rows.len()];
        for k in 1..rows.len() {
            stands_since[k] = if is_same_state(moment(k - 1), moment(k)) { stands_since[k - 1] } else { k };
        }
        let neighbours: Vec<usize> = (0..rows.len()).filter(|k| used[rows[*k]]).collect();
        for (k, i) in rows.iter().copied().enumerate() {
            let ahead = neighbours.partition_point(|j| *j < k);
            let behind = ahead + usize::from(used[i]);
            if ahead < REACH || behind + REACH > neighbours.len() {
                continue;
            }
            let ranks = [ahead - 2, ahead - 1, behind, behind + 1].map(|n| neighbours[n]);
            let is_on_path = if moment(k).is_ballbar {
                moment(ranks[0]).direction == moment(k).direction
            } else {
                let [first, last] = [ranks[0], ranks[3]].map(|rank| stands_since[rank]);
                first == last && k - stands_since[k] >= FEW
            };
            if is_on_path {
                out[i] = Some(off_path(gap, &rows, k, ranks));
            }
        }
    }
    out
}

/// The direction of measurement; -0 and 0 are one.
pub(super) fn along(m: &MachineState) -> [u64; 3] {
    [m.u.x, m.u.y, m.u.z].map(|c| (c + 0.0).to_bits())
}

/// The reading of rank `k` in a series of `rows` beside neighbours of some `ranks`.
fn off_path(gap: &[f64], rows: &[usize], k: usize, ranks: [usize; 2 * REACH]) -> OffPath {
    let neighbours = ranks.map(|rank| rows[rank]);
    let at = ranks.map(|rank| rank as f64 - k as f64);
    // Lagrange's polynomial through some of them
    let through = |points: &[usize]| -> f64 {
        let weight = |p: &usize| -> f64 {
            points.iter().filter(|q| *q != p).map(|q| at[*q] / (at[*q] - at[*p])).product()
        };
        points.iter().map(|p| weight(p) * gap[neighbours[*p]]).sum()
    };
    let [off_um, before, behind] = [&[0, 1, 2, 3][..], &[0, 1], &[2, 3]].map(|p| gap[rows[k]] - through(p));
    OffPath { off_um, nearest_um: nearer(nearer(off_um, before), behind), neighbours }
}

/// The smaller of two distances.
pub(super) fn nearer(a: f64, b: f64) -> f64 {
    if b.abs() < a.abs() { b } else { a }
}

/// True where nothing changes that changes a reading but time, temperatures and the speed of the spindle.
pub(super) fn is_same_state(a: &MachineState, b: &MachineState) -> bool {
    let is_equal = |a: f64, b: f64, least: f64| (a - b).abs() < least || a.to_bits() == b.to_bits();
    (0..SLOTS).all(|s| is_equal(a.position[s], b.position[s], if s < 3 { EQUAL } else { EQUAL_RAD }))
        && others(a).zip(others(b)).all(|(a, b)| is_equal(*a, *b, EQUAL))
}

/// Forces, target and length of the tool.
fn others(m: &MachineState) -> impl Iterator<Item = &f64> {
    m.force_n.iter().chain(m.target_mm.iter()).chain([&m.tool_length_mm])
}

#[cfg(test)]
mod tests {
    use super::super::super::machine_state::Machine;
    use super::super::super::session::{History, Raw, Session};
    use super::{FEW, REACH, from_path};

    /// Readings at 50 mm but for those in `away`, one of 9 um in their middle.
    fn judged(n: usize, away: std::ops::Range<usize>) -> Vec<usize> {
        let names = ["t_s", "setup", "run", "repeat", "x_mm", "u_x", "u_y", "u_z", "deviation_um"];
        let mut raw = Raw::made_up("s.csv", &names);
        for k in 0..n {
            let x = if away.contains(&k) { 55.0 } else { 50.0 };
            let d = if k == n / 2 { 9.0 } else { 0.0 };
            raw.push("laser", k as u64 + 2, &[k as f64, 1.0, 1.0, 1.0, x, 1.0, 0.0, 0.0, d]);
        }
        let session = Session::build(&[raw], History::default(), Machine::plain()).expect("a session");
        let path = from_path(&session, &session.gap(), &vec![true; n]);
        let off = |i: usize| path[i].is_some_and(|p| p.off_um == 9.0 && p.nearest_um == 9.0);
        assert_eq!((0..n).filter(|i| off(*i)).collect::<Vec<_>>(), [n / 2]);
        (0..n).filter(|i| path[*i].is_some()).collect()
    }

    #[test]
    fn a_series_at_standstill_is_judged_once_it_has_settled() {
        let last = 80 - REACH;
        assert_eq!(judged(80, 0..0), (FEW..last).collect::<Vec<_>>());
        // away and back within the readings that settle: they are counted from the return
        let settled = [FEW..18 - REACH, 22 + FEW..last].into_iter().flatten();
        assert_eq!(judged(80, 18..22), settled.collect::<Vec<_>>());
    }
}
