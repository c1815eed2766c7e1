//! How far the gap shrinks on new data of the same program: cross-validation over blocks of runs, and a bootstrap of
//! the blocks for the interval.
//!
//! The fit of a fold does not see its block (where effects vary over the volume: but for the size of that variation), so what the parameters owe to noise does not count as gain. The interval
//! also covers that new data have noise, drift and weather of their own.

use super::constants::{DRAWS, FOLD_RIDGE, TOLD};
use super::noise::Random;
use super::offsets::{peak99, rms, without_offsets};
use super::prediction_interval::Day;
use super::report::Shrink;
use super::search::{FOLDS, Problem, fold_of};
use super::session::Session;

/// The interval of the bootstrap is widened by this: new data scatter as much as the old.
const WIDEN: f64 = 1.25;

/// What some columns contribute to every reading of the session, um, fitted without the reading's own fold.
pub(super) struct Contributions {
    /// Per column of the selection, in its order; per row of the session, fitted on other folds, without the offsets that the set-ups
    /// have with that fit: each fold has its own.
    pub(super) held_out: Vec<Vec<f64>>,
    /// The same with the fit to all readings.
    pub(super) in_sample: Vec<Vec<f64>>,
    /// The fit without each fold, in the scale of the problem.
    pub(super) folds: Vec<nalgebra::DVector<f64>>,
}

/// Contributions of the columns `columns` with raw values `raw` (per column, per row of the session).
#[must_use]
pub(super) fn contributions(
    session: &Session,
    problem: &Problem,
    columns: &[usize],
    beta: &[f64],
    (raw, used): (&[Vec<f64>], &[bool]),
) -> Contributions {
    let n = columns.len();
    if n == 0 {
        return Contributions { held_out: Vec::new(), in_sample: Vec::new(), folds: Vec::new() };
    }
    let count = FOLDS.min(problem.blocks.max(2));
    let mut g = vec![nalgebra::DMatrix::<f64>::zeros(n, n); count];
    let mut b = vec![nalgebra::DVector::<f64>::zeros(n); count];
    for (i, x) in problem.whitened_rows(columns).column_iter().enumerate() {
        let f = fold_of(problem.block[i], problem.blocks);
        g[f].ger(1.0, &x, &x, 1.0);
        b[f].axpy(problem.y[i], &x, 1.0);
    }
    let whole_g = g.iter().fold(nalgebra::DMatrix::zeros(n, n), |s, m| s + m);
    let whole_b = b.iter().fold(nalgebra::DVector::zeros(n), |s, v| s + v);
    let fits: Vec<nalgebra::DVector<f64>> = (0..count)
        .map(|f| {
            let mut rest = &whole_g - &g[f];
            for j in 0..n {
                rest[(j, j)] += FOLD_RIDGE * whole_g[(j, j)];
            }
            let scale = rest.diagonal().max().max(1e-12);
            rest.svd(true, true)
                .solve(&(&whole_b - &b[f]), 1e-10 * scale)
                .unwrap_or_else(|_| nalgebra::DVector::from_column_slice(beta))
        })
        .collect();
    let fold = folds(session, problem);
    let scaled = |j: usize, b: f64| {
        let norm = problem.norm[columns[j]];
        if norm > 0.0 { b / norm } else { 0.0 }
    };
    let held_out =
        (0..n).map(|j| held_out(session, used, &raw[j], |i| scaled(j, fits[fold[i]][j]))).collect();
    let in_sample = (0..n).map(|j| raw[j].iter().map(|v| v * scaled(j, beta[j])).collect()).collect();
    Contributions { held_out, in_sample, folds: fits }
}

/// What a raw column contributes to each reading, um, by the parameter that was fitted without the reading's own fold: without the
/// offsets that the set-ups have with that fit; 0 of those that are not used.
#[must_use]
pub(super) fn held_out(
    session: &Session,
    used: &[bool],
    raw: &[f64],
    parameter: impl Fn(usize) -> f64,
) -> Vec<f64> {
    let own = without_offsets(session, raw, used).into_iter().enumerate();
    own.map(|(i, v)| if used[i] { v * parameter(i) } else { 0.0 }).collect()
}

/// The fold of each reading of the session; 0 of those that are not used.
pub(super) fn folds(session: &Session, problem: &Problem) -> Vec<usize> {
    let mut fold = vec![0; session.readings.len()];
    for (block, i) in problem.block.iter().zip(&problem.rows) {
        fold[*i] = fold_of(*block, problem.blocks);
    }
    fold
}

/// `gap` minus the sum of some contributions.
#[must_use]
pub(super) fn minus(gap: &[f64], parts: &[Vec<f64>], take: impl Fn(usize) -> bool) -> Vec<f64> {
    let mut out = gap.to_vec();
    for (_, part) in parts.iter().enumerate().filter(|(j, _)| take(*j)) {
        for (o, p) in out.iter_mut().zip(part) {
            *o -= p;
        }
    }
    out
}

/// The forecast, with the columns that `take` names.
#[must_use]
pub(super) fn forecast(
    problem: &Problem,
    gap: &[f64],
    parts: &Contributions,
    take: &dyn Fn(usize) -> bool,
    day: &Day<'_>,
    seed: u64,
) -> Shrink {
    let Day { session, used, .. } = *day;
    let before = without_offsets(session, gap, used);
    let after = without_offsets(session, &minus(gap, &parts.held_out, take), used);
    let fitted = without_offsets(session, &minus(gap, &parts.in_sample, take), used);
    let (rms_before, rms_after) = (rms(&before), rms(&after));
    let fraction = 1.0 - rms_after / rms_before.max(1e-12);
    let mut sums = vec![[0.0; 3]; problem.blocks];
    // a program is what it is: blocks are drawn again within their setup
    let mut strata: std::collections::BTreeMap<usize, Vec<usize>> = std::collections::BTreeMap::new();
    let mut setup_of = vec![0; problem.blocks];
    for (k, i) in problem.rows.iter().enumerate() {
        setup_of[problem.block[k]] = session.readings[*i].setup;
    }
    for (block, setup) in setup_of.iter().enumerate() {
        strata.entry(*setup).or_default().push(block);
    }
    for (k, i) in problem.rows.iter().enumerate() {
        let s = &mut sums[problem.block[k]];
        s[0] += before[*i] * before[*i];
        s[1] += after[*i] * after[*i];
        s[2] += 1.0;
    }
    let mut random = Random::new(seed ^ 0x5157);
    let mut draws: Vec<f64> = (0..DRAWS)
        .map(|_| {
            let (mut b, mut a) = (0.0, 0.0);
            for blocks in strata.values() {
                for _ in 0..blocks.len() {
                    let s = &sums[blocks[random.below(blocks.len())]];
                    b += s[0];
                    a += s[1];
                }
            }
            1.0 - (a / b.max(1e-12)).sqrt()
        })
        .collect();
    draws.sort_by(f64::total_cmp);
    let nothing = !(0..parts.held_out.len()).any(take);
    let (low, high) = (draws[DRAWS / 20], draws[DRAWS - 1 - DRAWS / 20]);
    let spread = day.spread(rms_before.powi(2), rms_after.powi(2));
    let half = |v: f64, spread: f64| (WIDEN * v).hypot(TOLD).hypot(spread);
    let ci90 = if nothing {
        [0.0, 0.0]
    } else {
        [fraction - half(fraction - low, spread[0]), (fraction + half(high - fraction, spread[1])).min(1.0)]
    };
    Shrink {
        rms_before_um: rms_before,
        rms_after_um: rms_after,
        fraction: if nothing { 0.0 } else { fraction },
        ci90,
        how: "blocked cross-validation".to_owned(),
        in_sample_fraction: if nothing { 0.0 } else { 1.0 - rms(&fitted) / rms_before.max(1e-12) },
        peak99_before_um: peak99(&before),
        peak99_after_um: peak99(&after),
    }
}
