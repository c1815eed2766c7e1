//! How far readings without repeats lie from the path of their neighbours: on the circles of a ballbar, and at standstill.

use std::collections::BTreeMap;

use super::super::constants::FEW;
use super::super::moment::MachineState;
use super::super::session::Session;

/// Readings before and behind that a line on a path goes through.
pub(super) const REACH: usize = 2;
/// Positions (mm, rad), forces (N) and lengths (mm) that differ by less are equal.
const STANDING: f64 = 1e-3;

/// The reading of a ballbar, or one at standstill, minus the cubic through the two before it in its series and the two behind; and minus
/// the nearest of that and of the lines through the two before and the two behind: a step or a bump of the path is none of its
/// readings'. Neighbours are those `used`. NaN at the ends of a series and soon after a reversal or a stop, where the path may be sharp.
pub(super) fn from_path(session: &Session, gap: &[f64], used: &[bool]) -> Vec<[f64; 2]> {
    let mut series: BTreeMap<_, Vec<usize>> = BTreeMap::new();
    for (i, (r, m)) in session.readings.iter().zip(&session.moments).enumerate() {
        let along = if m.is_ballbar { [0; 3] } else { [m.u.x, m.u.y, m.u.z].map(f64::to_bits) };
        series.entry((r.run, r.instrument, along)).or_default().push(i);
    }
    let mut out = vec![[f64::NAN; 2]; gap.len()];
    for rows in series.into_values() {
        let neighbours: Vec<usize> = rows.iter().copied().filter(|i| used[*i]).collect();
        for i in rows {
            let ahead = neighbours.partition_point(|j| *j < i);
            let behind = ahead + usize::from(used[i]);
            if ahead < REACH || behind + REACH > neighbours.len() {
                continue;
            }
            let w = [ahead - 2, ahead - 1, behind, behind + 1].map(|k| neighbours[k]);
            let long_ago = ahead.checked_sub(FEW).map(|k| neighbours[k]);
            if is_on_a_path(session, i, w, long_ago) {
                let [two_before, before, behind, two_behind] = w.map(|j| gap[j]);
                let cubic = (4.0 * (before + behind) - two_before - two_behind) / 6.0;
                let apart = [cubic, 2.0 * before - two_before, 2.0 * behind - two_behind].map(|e| gap[i] - e);
                let nearest = |a: f64, b: f64| if b.abs() < a.abs() { b } else { a };
                out[i] = [apart[0], apart.into_iter().fold(f64::INFINITY, nearest)];
            }
        }
    }
    out
}

/// True where nothing but time changes between a reading and its neighbours, nor has since `long_ago`, so that the axes have settled;
/// or nothing but the angle of a ballbar, without a reversal before it.
fn is_on_a_path(
    session: &Session,
    i: usize,
    neighbours: [usize; 2 * REACH],
    long_ago: Option<usize>,
) -> bool {
    let (m, is_close) =
        (&session.moments[i], |a: f64, b: f64| (a - b).abs() < STANDING || a.to_bits() == b.to_bits());
    if m.is_ballbar {
        return session.moments[neighbours[0]].direction == m.direction;
    }
    let is_same = |j: usize| state(m).zip(state(&session.moments[j])).all(|(a, b)| is_close(*a, *b));
    long_ago.is_some_and(is_same) && neighbours.into_iter().all(is_same)
}

/// What beside time changes a reading.
fn state(m: &MachineState) -> impl Iterator<Item = &f64> {
    m.position.iter().chain(&m.force_n).chain(m.target_mm.iter()).chain([&m.tool_length_mm])
}
