//! What stays where an effect acts, against what it explains there: a cause leaves noise, a part of something else does not.

use super::super::Analysis;
use super::super::assess::Assessed;
use super::super::leftover::repeated;
use super::super::session::Session;

/// Standard deviations of noise from which something stays.
const STAYS_Z: f64 = 3.0;
/// An effect acts in a programme and direction that has this share of the most that it explains in any.
const ACTS: f64 = 0.02;

/// Weighs every effect by what stays beside those that passed their gates in the programmes and directions where it acts,
/// against what all of these explain there: much of it says that the library lacks something. Against all of them, because
/// what a large effect leaves is not the fault of a small one beside it.
pub(super) fn weigh(session: &Session, a: &Analysis, assessed: &mut [Assessed]) {
    assessed.iter_mut().for_each(Assessed::settle);
    let (part, parts) = parts(session, a);
    let kept: Vec<usize> = assessed.iter().filter(|x| x.declared).map(|x| x.variant).collect();
    let stays = energy(session, a, &kept, (&part, parts));
    let all: Vec<usize> = assessed.iter().map(|x| x.variant).collect();
    let given = a.problem.given(&all);
    let beta = a.problem.fit(&given);
    let explained = |x: &Assessed| {
        let mut own = vec![0.0; parts];
        for (p, f) in part.iter().zip(a.problem.part(&given, &beta, x.variant).iter()) {
            own[*p] += f * f;
        }
        own
    };
    let each: Vec<Vec<f64>> = assessed.iter().map(explained).collect();
    let mut together = vec![0.0; parts];
    for (_, own) in assessed.iter().zip(&each).filter(|(x, _)| kept.contains(&x.variant)) {
        together.iter_mut().zip(own).for_each(|(t, o)| *t += o);
    }
    for (x, own) in assessed.iter_mut().zip(&each) {
        // formulas of the servo hold to a small share: there a small effect is no misform
        x.gates.weight = if a.problem.precise { 1.0 } else { weight(own, &together) };
        x.gates.misfit = if kept.contains(&x.variant) {
            misfit(own, &together, &stays)
        } else {
            // what stays beside it, too: what it explains itself is not held against it
            let with: Vec<usize> = kept.iter().copied().chain([x.variant]).collect();
            let all: Vec<f64> = together.iter().zip(own).map(|(t, o)| t + o).collect();
            misfit(own, &all, &energy(session, a, &with, (&part, parts)))
        };
        x.settle();
    }
}

/// Share of an effect in what is explained `together`, and by itself where it is not among these; the mean over where it acts.
fn weight(own: &[f64], together: &[f64]) -> f64 {
    let shares: f64 = own.iter().zip(together).map(|(o, t)| o * o / t.max(*o).max(1e-12)).sum();
    shares / own.iter().sum::<f64>().max(1e-12)
}

/// Programme and direction of every reading, and their number.
fn parts(session: &Session, a: &Analysis) -> (Vec<usize>, usize) {
    let direction = |i: usize| session.moments[i].u.iamax();
    let rows = a.problem.rows.iter().zip(&a.problem.cell);
    (rows.map(|(i, cell)| 3 * cell + direction(*i)).collect(), 3 * a.problem.cells)
}

/// Energy that repeats and stays in each part beside some effects, and its variance where there is only noise.
fn energy(
    session: &Session,
    a: &Analysis,
    keep: &[usize],
    (part, parts): (&[usize], usize),
) -> Vec<(f64, f64)> {
    let left = super::left_whitened(a, keep);
    let mut rows = vec![0usize; parts];
    part.iter().for_each(|p| rows[*p] += 1);
    let mut sums = vec![(0.0, 0usize); parts];
    repeated(session, &a.problem, &left, &mut |k, product| {
        let s = &mut sums[part[k]];
        *s = (s.0 + product, s.1 + 1);
    });
    rows.iter()
        .zip(sums)
        .map(|(rows, (sum, n))| {
            let per = *rows as f64 / n.max(1) as f64;
            (sum * per, n as f64 * per * per)
        })
        .collect()
}

/// What stays over what is explained `together`, the mean over where an effect acts, weighted by what it explains there.
fn misfit(own: &[f64], together: &[f64], stays: &[(f64, f64)]) -> f64 {
    let most = own.iter().copied().fold(0.0, f64::max);
    let there = || own.iter().zip(together).zip(stays).filter(|((f, _), _)| **f > ACTS * most);
    let (sum, variance, weight) = there().fold((0.0, 0.0, 0.0), |(s, v, w), ((f, all), (e, n))| {
        let share = f / all.max(1e-9);
        (s + share * e, v + share * share * n, w + f)
    });
    if sum > STAYS_Z * variance.sqrt() { sum / weight.max(1e-9) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::misfit;

    #[test]
    fn noise_is_no_misfit_and_what_stays_elsewhere_is_none() {
        let own = [100.0, 0.0];
        assert!(misfit(&own, &own, &[(20.0, 100.0), (0.0, 100.0)]) == 0.0);
        assert!(misfit(&own, &own, &[(0.0, 100.0), (500.0, 100.0)]) == 0.0);
    }

    #[test]
    fn what_stays_where_the_effect_acts_counts_against_it() {
        let own = [100.0, 0.0];
        assert!((misfit(&own, &own, &[(50.0, 100.0), (0.0, 100.0)]) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn what_a_large_effect_leaves_is_not_the_fault_of_a_small_one() {
        let (small, together) = ([100.0], [10_100.0]);
        assert!((misfit(&small, &together, &[(202.0, 1.0)]) - 0.02).abs() < 1e-12);
    }
}
