//! Causes that say again what an effect says that was taken out of the library: on this plan nobody can tell them from it.

use super::super::constants::{DEGENERATE, LITTLE, NEARLY, TRIED};
use nalgebra::{DMatrix, DVector};

use super::super::assessment::is_same;
use super::super::decision::Assessed;
use super::super::library::{Library, Without};
use super::super::orthonormal::orthonormal;
use super::super::report::Cause;
use super::super::search::Problem;
use super::super::session::Session;
use super::super::{Analysis, take_signals};

/// Share of the energy of what the causes do together that the effect, fitted to it, must do, too: an overlap of 0.97, which
/// leaves a quarter of its size.
const AGAIN: f64 = 0.97 * 0.97;

/// Marks the declared causes that together do what an effect does that was taken out of the library: one of them or several,
/// such as three servo lags for a common delay.
pub(super) fn mark(
    session: &mut Session,
    a: &Analysis,
    without: &[Without],
    assessed: &[Assessed],
    causes: &mut [Cause],
) {
    if without.is_empty() {
        return;
    }
    let declared: Vec<&Assessed> = assessed.iter().filter(|x| x.is_declared()).collect();
    let parts = contributions(a, &declared);
    let (removed, problem) = taken_out(session, a, without);
    for (v, variant) in removed.variants.iter().enumerate() {
        let (at, k) = problem.span[v];
        let columns: Vec<DVector<f64>> = (at..at + k).map(|c| problem.contribution(&[c], &[1.0])).collect();
        let name = removed.labels[variant.label].to_string();
        for i in said_again(&columns, &parts) {
            let label = declared[i].label.to_string();
            for c in causes.iter_mut().filter(|c| c.label() == label && !c.re_expression_of.contains(&name)) {
                c.re_expression_of.push(name.clone());
            }
        }
    }
}

/// What each effect does, whitened, fitted beside all that were chosen.
fn contributions(a: &Analysis, effects: &[&Assessed]) -> Vec<DVector<f64>> {
    let given = a.problem.given(&a.selection.chosen);
    let beta = a.problem.fit(&given);
    effects.iter().map(|x| a.problem.part(&given, &beta, x.variant)).collect()
}

/// The effects that were taken out, with their columns.
fn taken_out(session: &mut Session, a: &Analysis, without: &[Without]) -> (Library, Problem) {
    let mut removed = Library::new(session, &[]);
    let labels: Vec<bool> = removed.labels.iter().map(|l| without.iter().any(|w| w.covers(l))).collect();
    removed.variants.retain(|v| labels[v.label]);
    take_signals(session, &mut removed);
    let white: Vec<f64> = a.noise.iter().map(|c| c.white_um).collect();
    let mut problem = Problem::new(session, &removed, &a.filter, &a.gap, &white);
    problem.join(a.problem.structure().clone());
    (removed, problem)
}

/// The parts that the columns can say: those of every sum of at most [`TRIED`] that holds no smaller such sum, and those that
/// bring it nearer to the columns still.
fn said_again(columns: &[DVector<f64>], parts: &[DVector<f64>]) -> Vec<usize> {
    let Some(basis) = basis(columns) else { return Vec::new() };
    let seen: Vec<DVector<f64>> = parts.iter().map(|p| basis.tr_mul(p)).collect();
    let n = parts.len();
    let product = |v: &[DVector<f64>]| DMatrix::from_fn(n, n, |i, j| v[i].dot(&v[j]));
    let (whole, seen) = (product(parts), product(&seen));
    let energy = |m: &DMatrix<f64>, some: &[usize]| -> f64 {
        some.iter().flat_map(|i| some.iter().map(move |j| (*i, *j))).map(|ij| m[ij]).sum()
    };
    // what the rest of a sum cancels is not said by anyone
    let is_said = |some: &[usize]| {
        let each: f64 = some.iter().map(|i| whole[(*i, *i)]).sum();
        let all = energy(&whole, some);
        all > LITTLE * each && is_same(energy(&seen, some), all, AGAIN)
    };
    let with = |sum: &[usize], i: usize| sum.iter().copied().chain([i]).collect::<Vec<usize>>();
    let (mut said, mut sums): (Vec<Vec<usize>>, Vec<Vec<usize>>) = (Vec::new(), vec![Vec::new()]);
    for _ in 0..TRIED.min(n) {
        let from = |sum: &Vec<usize>| sum.last().map_or(0, |last| last + 1);
        sums = sums.iter().flat_map(|sum| (from(sum)..n).map(|i| with(sum, i))).collect();
        sums.retain(|sum| !said.iter().any(|s| s.iter().all(|i| sum.contains(i))));
        said.extend(sums.iter().filter(|sum| is_said(sum)).cloned());
    }
    let unsaid = |some: &[usize]| 1.0 - energy(&seen, some) / energy(&whole, some);
    for sum in &mut said {
        let nearer = |sum: &[usize]| {
            let more = (0..n).filter(|i| !sum.contains(i)).map(|i| with(sum, i)).filter(|s| is_said(s));
            let nearest = more.min_by(|a, b| unsaid(a).total_cmp(&unsaid(b)))?;
            (unsaid(&nearest) < NEARLY * unsaid(sum)).then_some(nearest)
        };
        while let Some(more) = nearer(sum) {
            *sum = more;
        }
    }
    let mut all = said.concat();
    all.sort_unstable();
    all.dedup();
    all
}

/// Orthonormal columns with the same span.
fn basis(columns: &[DVector<f64>]) -> Option<DMatrix<f64>> {
    let some: Vec<DVector<f64>> = columns.iter().filter(|c| c.norm_squared() > 0.0).cloned().collect();
    if some.is_empty() {
        return None;
    }
    orthonormal(DMatrix::from_columns(&some), DEGENERATE)
}

#[cfg(test)]
mod tests {
    use super::said_again;
    use nalgebra::DVector;

    fn wave(f: impl Fn(f64) -> f64) -> DVector<f64> {
        DVector::from_fn(60, |i, _| f(i as f64 / 10.0))
    }

    #[test]
    fn a_sum_that_is_the_effect_is_found_and_what_stands_beside_it_is_not() {
        let (x, y) = (wave(f64::sin), wave(|t| (3.0 * t).cos()));
        let delay = [&x + &y];
        let other = wave(|t| (7.0 * t).sin());
        assert_eq!(said_again(&delay, &[x.clone(), other.clone(), y.clone()]), [0, 2]);
        assert!(said_again(&delay, &[x.clone(), other.clone()]).is_empty());
        // one lag as a common delay less the other lag: only the sum says it
        assert_eq!(said_again(std::slice::from_ref(&x), &[other, &x + &y, -y]), [1, 2]);
    }

    #[test]
    fn each_that_is_the_effect_is_found_and_what_completes_it() {
        let part = |x: f64, y: f64, z: f64| DVector::from_vec(vec![100.0 * x, 100.0 * y, 100.0 * z]);
        let column = [part(1.0, 0.0, 0.0)];
        let (nearly, other) = (part(1.0, 0.2, 0.0), part(0.0, 0.0, 1.0));
        assert_eq!(said_again(&column, &[part(1.0, 0.0, 0.0), other.clone(), nearly.clone()]), [0, 2]);
        // a drop is a squareness and a little straightness
        assert_eq!(said_again(&column, &[nearly.clone(), other.clone(), part(0.0, -0.15, 0.0)]), [0, 2]);
        assert_eq!(said_again(&column, &[nearly.clone(), other]), [0]);
        // what cancels it leaves nothing that the effect says
        assert_eq!(said_again(&column, &[nearly, part(-1.0, -0.3, 0.0)]), [0]);
        let overlap = |c: f64| said_again(&column, &[part(c, (1.0 - c * c).sqrt(), 0.0)]).len();
        assert_eq!([overlap(0.975), overlap(0.965)], [1, 0]);
    }
}
