//! Outliers, from repeats; where there are none, from neighbours on the path of a ballbar, at standstill and on lines of positions; in
//! campaigns, from what all other readings and the effects found predict.

use std::collections::BTreeSet;

use super::super::constants::{FEW, HALF, LITTLE, NEARLY, OUTLYING, ROUNDS};
use super::super::session::Session;
use super::filter::{ClassNoise, Filter};
use super::line::from_lines;
use super::path::{OffPath, from_path, nearer};
use super::{MAD, by_pair, median, moves, repeats_of};

/// Readings on both sides whose median is taken as the slow part.
const NEIGHBOURS: usize = 4;

/// Readings that lie apart from their partners in other repeats, beyond the slow drift between repeats, or from the path of a
/// ballbar or of a series at standstill. `lattice_um` is the rounding of each class: what lies a step apart is rounded, no outlier.
#[must_use]
pub fn outliers(session: &Session, gap: &[f64], lattice_um: &[f64]) -> Vec<usize> {
    // those marked in the file come first: beside them the others are judged
    let mut found: Vec<usize> = (0..gap.len()).filter(|i| session.readings[*i].is_marked).collect();
    let unmarked = all_but(gap.len(), &found);
    let mut used = unmarked.clone();
    for _ in 0..ROUNDS {
        let new = round(session, gap, lattice_um, &used);
        if new.is_empty() {
            break;
        }
        for i in &new {
            used[*i] = false;
        }
        found.extend(new);
    }
    found.extend(without_majority(session, gap, &unmarked, &used));
    found.sort_unstable();
    found
}

/// Readings `used` of points with three and more repeats that no majority supports: at most half of the repeats are left, or one
/// more than were left out, of which one lies much nearer to the neighbours in its run. None says which of them are no outliers.
fn without_majority(session: &Session, gap: &[f64], unmarked: &[bool], used: &[bool]) -> Vec<usize> {
    let bent = |i: usize| bend(session, gap, used, i);
    let has_none = |(all, left): &(Vec<usize>, Vec<usize>)| {
        let mut out = all.iter().filter(|i| !used[**i]);
        match 2 * left.len() {
            twice if twice <= all.len() => true,
            twice if twice == all.len() + 1 => out.any(|o| left.iter().all(|i| bent(*o) < HALF * bent(*i))),
            _ => false,
        }
    };
    let groups = by_pair(session, unmarked).into_iter().zip(by_pair(session, used));
    groups.filter(|(all, _)| all.len() > 2).filter(has_none).flat_map(|(_, left)| left).collect()
}

/// Readings of `left` (the gap without its causes) at standstill, off any path, that are far from what all others of their setup
/// predict and from each of their repeats, of neighbours that see the same direction the farthest; none of a class that has more than
/// one in twenty of them: those are the tails of its noise, or structure.
#[must_use]
pub fn off_the_fit(
    session: &Session,
    filter: &Filter,
    left: &[f64],
    lattice_um: &[f64],
    (noise, used): (&[ClassNoise], &[bool]),
) -> Vec<usize> {
    let path = from_path(session, left, used);
    let is_judged = |i: usize| {
        let m = &session.moments[i];
        path[i].is_none() && !moves(m) && !m.is_ballbar && !m.is_encoder
    };
    let order = filter.order();
    let mut off = vec![f64::NAN; left.len()];
    order.iter().zip(filter.deletion_residuals(left)).for_each(|(i, residual)| off[*i] = residual);
    let partners = by_pair(session, used);
    let mut found = Vec::new();
    for (class, (noise, lattice_um)) in noise.iter().zip(lattice_um).enumerate() {
        let is_of = |i: usize| session.readings[i].instrument == class && is_judged(i);
        // the place of each in the order of the filter, and the reading
        let rows: Vec<(usize, usize)> =
            order.iter().copied().enumerate().filter(|(_, i)| is_of(*i)).collect();
        if rows.len() < 2 * FEW {
            continue;
        }
        let least = lattice_um / 6f64.sqrt() / noise.white_um;
        let limit = OUTLYING * robust_deviation(rows.iter().map(|(_, i)| off[*i]), least);
        let is_far = |(_, i): &(usize, usize)| {
            let mut others =
                session.readings[*i].pair.into_iter().flat_map(|p| &partners[p]).filter(|j| *j != i);
            off[*i].abs() > limit && others.all(|j| (off[*i] - off[*j]).abs() > limit)
        };
        let far: Vec<(usize, usize)> = rows.iter().copied().filter(is_far).collect();
        if far.len() as f64 > LITTLE * rows.len() as f64 {
            continue;
        }
        let is_farthest = |(k, i): &(usize, usize)| {
            let is_beside = |(l, j): &&(usize, usize)| {
                l.abs_diff(*k) <= NEIGHBOURS
                    && session.readings[*i].setup == session.readings[*j].setup
                    && session.moments[*i].u.dot(&session.moments[*j].u).abs() > NEARLY
            };
            far.iter().filter(is_beside).all(|(_, j)| off[*i].abs() >= off[*j].abs())
        };
        found.extend(far.iter().filter(|f| is_farthest(f)).map(|(_, i)| *i));
    }
    found
}

/// True for all of `n` readings but those `outlying`.
#[must_use]
pub fn all_but(n: usize, outlying: &[usize]) -> Vec<bool> {
    let mut used = vec![true; n];
    outlying.iter().for_each(|i| used[*i] = false);
    used
}

/// The reading minus the median of its partners, of two middle ones the nearer: an outlier among two partners must not make the
/// others look like one; NaN without a partner.
#[must_use]
pub fn from_partners(session: &Session, gap: &[f64], used: &[bool]) -> Vec<f64> {
    let mut out = vec![f64::NAN; gap.len()];
    for rows in by_pair(session, used).iter().filter(|g| g.len() > 1) {
        for i in rows {
            let mut apart: Vec<f64> = rows.iter().filter(|j| *j != i).map(|j| gap[*i] - gap[*j]).collect();
            apart.sort_by(f64::total_cmp);
            let middle = [apart[(apart.len() - 1) / 2], apart[apart.len() / 2]];
            out[*i] = nearer(middle[1], middle[0]);
        }
    }
    out
}

/// The robust standard deviation about zero, at least `least`: where a display rounds, most values may be equal.
fn robust_deviation(values: impl Iterator<Item = f64>, least: f64) -> f64 {
    let mut sizes: Vec<f64> = values.map(f64::abs).collect();
    (MAD * median(&mut sizes)).max(least)
}

/// On the path or the line of its neighbours.
fn from_neighbours(session: &Session, gap: &[f64], used: &[bool]) -> Vec<Option<OffPath>> {
    let path = from_path(session, gap, used).into_iter();
    path.zip(from_lines(session, gap, used)).map(|(path, line)| path.or(line)).collect()
}

fn round(session: &Session, gap: &[f64], lattice_um: &[f64], used: &[bool]) -> Vec<usize> {
    let path = from_neighbours(session, gap, used);
    let apart = by_class(session, gap, lattice_um, (used, &path)).into_iter().flatten();
    let found: BTreeSet<usize> =
        apart.filter(|(i, d)| used[*i] && d.abs() > OUTLYING).map(|(i, _)| i).collect();
    // beside an outlier its partners look wrong, too
    let is_outlier = |i: &usize| {
        is_outlier_of_repeats(session, gap, used, *i)
            .unwrap_or_else(|| is_outlier_of_path(gap, &path, *i, &found))
    };
    found.iter().copied().filter(is_outlier).collect()
}

/// How far readings lie from their partners, or in a class that has few from their path, beyond the slow part, in robust standard
/// deviations of their class, class by class; partners are those used.
fn by_class(
    session: &Session,
    gap: &[f64],
    lattice_um: &[f64],
    (used, path): (&[bool], &[Option<OffPath>]),
) -> Vec<Vec<(usize, f64)>> {
    let apart = from_partners(session, gap, used);
    let of = |class: usize| {
        let is_of = |i: &usize| session.readings[*i].instrument == class;
        let least_um = lattice_um[class] / 6f64.sqrt();
        let rows: Vec<usize> = (0..gap.len()).filter(|i| is_of(i) && apart[*i].is_finite()).collect();
        if rows.len() >= 2 * FEW {
            let detrended = (0..rows.len()).map(|k| apart[rows[k]] - slow(session, &apart, &rows, k));
            let detrended: Vec<f64> = detrended.collect();
            let sigma = robust_deviation(detrended.iter().copied(), least_um);
            return rows.into_iter().zip(detrended.iter().map(|d| d / sigma)).collect();
        }
        let rows: Vec<(usize, OffPath)> =
            (0..gap.len()).filter(is_of).filter_map(|i| Some((i, path[i]?))).collect();
        if rows.len() < 2 * FEW {
            return Vec::new();
        }
        let sigma = robust_deviation(rows.iter().map(|(_, p)| p.off_um), least_um);
        // beyond the limit counts what is also off the lines: a step of the path is not
        let apart = |(i, p): (usize, OffPath)| {
            let [off, nearest] = [p.off_um, p.nearest_um].map(|d| d / sigma);
            (i, if off.abs() > OUTLYING { nearest } else { off })
        };
        rows.into_iter().map(apart).collect()
    };
    let by_class: Vec<Vec<(usize, f64)>> = (0..session.instruments.len()).map(of).collect();
    // a class without scatter has no outliers
    by_class.into_iter().map(|c| if c.iter().all(|(_, d)| d.is_finite()) { c } else { Vec::new() }).collect()
}

/// Shares of the differences of two readings of Student's noise in the shoulders, beyond [`OUTLYING`] and beyond twice that, for 1 to
/// 200 degrees of freedom (by quadrature). Their far tails are heavier than those of Student's distribution with the same shoulders.
const TAILS: [[f64; 3]; 13] = [
    [0.075_42, 0.077_68, 0.038_98],
    [0.063_08, 0.034_53, 0.012_06],
    [0.051_60, 0.016_95, 0.004_117],
    [0.042_67, 0.008_989, 0.001_518],
    [0.035_95, 0.005_068, 0.000_595_2],
    [0.027_03, 0.001_860, 0.000_105_6],
    [0.021_69, 0.000_791_7, 2.175e-5],
    [0.018_27, 0.000_378_1, 5.033e-6],
    [0.014_33, 0.000_112_2, 3.532e-7],
    [0.010_90, 2.015e-5, 3.803e-9],
    [0.008_612, 2.946e-6, 3.31e-12],
    [0.006_914, 2.895e-7, 1.73e-18],
    [0.006_186, 6.647e-8, 9.0e-25],
];

/// Readings beyond the limit, and beyond twice it: how many there are, and how many heavy tails with the same shoulders would have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tails {
    /// Beyond each.
    pub beyond: [f64; 2],
    /// Expected there of Student's noise with the same shoulders, upper limit of two standard deviations.
    pub expected: [f64; 2],
}

/// The tails of what differs between repeats, or from a path through readings `used`: of all readings together, then of each class:
/// outliers of the same size stand far out of the noise of one instrument and in the shoulders of another's.
#[must_use]
pub fn tails(session: &Session, gap: &[f64], lattice_um: &[f64], used: &[bool]) -> Vec<Tails> {
    let path = from_neighbours(session, gap, used);
    let mut classes = by_class(session, gap, lattice_um, (&vec![true; gap.len()], &path));
    // two repeats lie equally far apart: one of them counts
    let repeats = repeats_of(session, 0..session.readings.len());
    let counts = |i: usize| {
        let of = session.readings[i].pair.and_then(|p| repeats.get(&p));
        of.is_none_or(|(n, first)| *n != 2 || *first == i)
    };
    classes.iter_mut().for_each(|c| c.retain(|(i, _)| counts(*i)));
    let all: Vec<(usize, f64)> = classes.concat();
    core::iter::once(&all)
        .chain(&classes)
        .filter(|some| !some.is_empty())
        .map(|some| tails_of(some))
        .collect()
}

fn tails_of(all: &[(usize, f64)]) -> Tails {
    let n = all.len() as f64;
    let beyond = [1.0, 2.0].map(|k| all.iter().filter(|(_, d)| d.abs() > k * OUTLYING).count() as f64);
    let shoulder = all.iter().filter(|(_, d)| (0.5 * OUTLYING..=OUTLYING).contains(&d.abs())).count() as f64;
    let share = (shoulder + 2.0 * shoulder.sqrt()) / n.max(1.0);
    Tails { beyond, expected: beyond_of(share).map(|b| n * b) }
}

/// The shares beyond [`OUTLYING`] and beyond twice that which go with a share in the shoulders, between those of [`TAILS`].
fn beyond_of(shoulder: f64) -> [f64; 2] {
    let pair = TAILS.windows(2).find(|w| shoulder >= w[1][0]).unwrap_or(&TAILS[TAILS.len() - 2..]);
    let [heavy, light] = [pair[0], pair[1]];
    let at = (shoulder / light[0]).ln() / (heavy[0] / light[0]).ln();
    [1, 2].map(|k| light[k] * (heavy[k] / light[k]).powf(at.clamp(0.0, 1.0)))
}

/// Median of what the neighbours in the same run and direction show.
fn slow(session: &Session, apart: &[f64], rows: &[usize], k: usize) -> f64 {
    let same = |j: &&usize| {
        session.readings[**j].run == session.readings[rows[k]].run
            && session.moments[**j].u.dot(&session.moments[rows[k]].u) > NEARLY
    };
    let before = rows[..k].iter().rev().take(3 * NEIGHBOURS).filter(same).take(NEIGHBOURS);
    let after = rows[k + 1..].iter().take(3 * NEIGHBOURS).filter(same).take(NEIGHBOURS);
    let mut values: Vec<f64> = before.chain(after).map(|j| apart[*j]).collect();
    if values.is_empty() { 0.0 } else { median(&mut values) }
}

/// Whether a reading is the outlier among its partners that are `used`: the farthest from their common median, or of two the one that
/// lies apart from its neighbours in the run; `None` without partners.
fn is_outlier_of_repeats(session: &Session, gap: &[f64], used: &[bool], i: usize) -> Option<bool> {
    let pair = session.readings[i].pair?;
    let is_partner = |j: &usize| used[*j] && session.readings[*j].pair == Some(pair);
    let together: Vec<usize> = (0..gap.len()).filter(is_partner).collect();
    if together.len() < 2 {
        return None;
    }
    let middle = median(&mut together.iter().map(|j| gap[*j]).collect::<Vec<f64>>());
    let apart = |j: usize| {
        if together.len() > 2 { (gap[j] - middle).abs() } else { bend(session, gap, used, j) }
    };
    Some(together.iter().all(|j| apart(i) >= apart(*j)))
}

/// True where a reading lies farther from the median of its neighbours on the path than those of them that were `found` from theirs.
fn is_outlier_of_path(gap: &[f64], path: &[Option<OffPath>], i: usize, found: &BTreeSet<usize>) -> bool {
    let off = |j: usize| {
        let others = path[j].map(|p| median(&mut p.neighbours.map(|n| gap[n])));
        others.map_or(0.0, |others| (gap[j] - others).abs())
    };
    let mut neighbours = path[i].into_iter().flat_map(|p| p.neighbours);
    neighbours.all(|j| !found.contains(&j) || off(i) >= off(j))
}

/// How far a reading lies from the line through its neighbours that are `used`.
fn bend(session: &Session, gap: &[f64], used: &[bool], i: usize) -> f64 {
    let same = |j: &usize| {
        used[*j]
            && session.readings[*j].run == session.readings[i].run
            && session.moments[*j].u.dot(&session.moments[i].u) > NEARLY
    };
    let before = (0..i).rev().take(NEIGHBOURS).find(same);
    let after = (i + 1..gap.len()).take(NEIGHBOURS).find(same);
    match (before, after) {
        (Some(a), Some(b)) => (gap[i] - 0.5 * (gap[a] + gap[b])).abs(),
        (Some(a), None) | (None, Some(a)) => (gap[i] - gap[a]).abs(),
        (None, None) => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::machine_state::Machine;
    use super::super::super::session::{History, Raw, Session};
    use super::super::Random;
    use super::{MAD, OUTLYING, Tails, median, outliers, tails_of};

    /// Differences of two draws of Student's noise in robust standard deviations, some of them replaced by `outliers`.
    fn noise(freedom: usize, n: usize, outliers: &[f64]) -> Tails {
        let mut random = Random::new(freedom as u64);
        let mut draw = || {
            let square: f64 = (0..freedom).map(|_| random.normal().powi(2)).sum();
            random.normal() / (square / freedom as f64).sqrt()
        };
        let mut values: Vec<f64> = (0..n).map(|_| draw() - draw()).collect();
        let sigma = MAD * median(&mut values.iter().map(|v| v.abs()).collect::<Vec<f64>>());
        values.iter_mut().for_each(|v| *v /= sigma);
        values.iter_mut().skip(n / 3).zip(outliers).for_each(|(v, w)| *v = *w);
        tails_of(&values.into_iter().enumerate().collect::<Vec<_>>())
    }

    #[test]
    fn heavy_tails_explain_themselves_and_outliers_are_beyond_them() {
        for freedom in [3, 4, 6, 50] {
            let t = noise(freedom, 40_000, &[]);
            for (beyond, expected) in t.beyond.into_iter().zip(t.expected) {
                assert!((0.8 * beyond - 1.0..1.5 * beyond + 3.0).contains(&expected), "{freedom}: {t:?}");
            }
        }
        let is_beyond = |t: &Tails, k: usize| {
            t.beyond[k] >= 10.0 && t.beyond[k] > 2.0 * t.expected[k] + 3.0 * t.expected[k].sqrt()
        };
        let t = noise(50, 400, &[1.5 * OUTLYING; 15]);
        assert!(is_beyond(&t, 0) && !is_beyond(&t, 1), "{t:?}");
        // in the shoulders of a small set more could be hidden than lies beyond, but not so far out
        let t = noise(3, 250, &[2.5 * OUTLYING; 10]);
        assert!(!is_beyond(&t, 0) && is_beyond(&t, 1), "{t:?}");
    }

    /// A wave of 8 mm in circles of 100 mm with a reading every four degrees bends sooner than a cubic through four of them.
    #[test]
    fn a_wave_that_circles_sample_coarsely_scatters_about_its_path() {
        let names = ["t_s", "setup", "run", "repeat", "x_mm", "y_mm", "u_x", "u_y", "u_z", "deviation_um"];
        let (mut raw, mut random) = (Raw::made_up("s.csv", &names), Random::new(3));
        for (run, sign) in [(1.0, 1.0), (2.0, -1.0)] {
            for k in 0..90 {
                let (sin, cos) = (sign * (4.0 * f64::from(k) + 2.0)).to_radians().sin_cos();
                let wave = 12.0 * (100.0 * sin * core::f64::consts::TAU / 8.0).sin() * sin;
                let t = 100.0 * run + 0.2 * f64::from(k);
                let row = [t, 1.0, run, 1.0, 100.0 * cos, 100.0 * sin, cos, sin, 0.0];
                let row = [&row[..], &[wave + 0.5 * random.normal()]].concat();
                raw.push("ballbar", raw.lines.len() as u64 + 2, &row);
            }
        }
        let session = Session::build(&[raw], History::default(), Machine::plain()).expect("a session");
        assert_eq!(outliers(&session, &session.gap(), &[0.0]), []);
    }
}
