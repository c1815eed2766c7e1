//! Causes that say again what an effect says that was taken out of the library: on this plan nobody can tell them from it.

use nalgebra::{DMatrix, DVector};

use super::super::assess::Assessed;
use super::super::library::{Library, Without};
use super::super::report::Cause;
use super::super::search::Problem;
use super::super::session::Session;
use super::super::{Analysis, take_signals};

/// Share of what the causes do that the effect must be able to do, too, and the other way round.
const AGAIN: f64 = 0.97;
/// Added to the products of columns, as a share of their size: columns may say the same.
const RIDGE: f64 = 1e-9;

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
    let declared: Vec<&Assessed> = assessed.iter().filter(|x| x.declared).collect();
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
    effects
        .iter()
        .map(|x| {
            let (at, k) = a.problem.span[x.variant];
            let (mine, values): (Vec<usize>, Vec<f64>) =
                given.columns.iter().zip(&beta).filter(|(c, _)| (at..at + k).contains(*c)).unzip();
            a.problem.contribution(&mine, &values)
        })
        .collect()
}

/// The effects that were taken out, with their columns.
fn taken_out(session: &mut Session, a: &Analysis, without: &[Without]) -> (Library, Problem) {
    let mut removed = Library::new(session, &[]);
    let labels: Vec<bool> = removed.labels.iter().map(|l| without.iter().any(|w| w.covers(l))).collect();
    removed.variants.retain(|v| labels[v.label]);
    take_signals(session, &mut removed);
    let white: Vec<f64> = a.noise.iter().map(|c| c.white_um).collect();
    let problem = Problem::new(session, &removed, &a.filter, &a.gap, &white);
    (removed, problem)
}

/// The fewest of the parts whose sum the columns can say, each of them needed; none where no sum is.
fn said_again(columns: &[DVector<f64>], parts: &[DVector<f64>]) -> Vec<usize> {
    let mut order: Vec<(usize, f64)> =
        parts.iter().enumerate().map(|(i, p)| (i, share_of(columns, p))).collect();
    order.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut sum = DVector::zeros(parts.first().map_or(0, DVector::len));
    let mut said = Vec::new();
    for (i, share) in order {
        // what the columns say nothing of is another cause
        if share < 0.05 {
            break;
        }
        sum += &parts[i];
        said.push(i);
        if share_of(columns, &sum) >= AGAIN {
            return said;
        }
    }
    Vec::new()
}

/// Share of the energy of `y` that the columns explain.
fn share_of(columns: &[DVector<f64>], y: &DVector<f64>) -> f64 {
    let n = columns.len();
    let gram = DMatrix::from_fn(n, n, |i, j| columns[i].dot(&columns[j]));
    let size = gram.diagonal();
    let ridged = gram + DMatrix::from_diagonal(&size.map(|s| s * RIDGE + 1e-12));
    let b = DVector::from_iterator(n, columns.iter().map(|c| c.dot(y)));
    let Some(factor) = ridged.cholesky() else { return 0.0 };
    b.dot(&factor.solve(&b)) / y.norm_squared().max(1e-12)
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
        let mut again = said_again(&delay, &[x.clone(), other.clone(), y]);
        again.sort_unstable();
        assert_eq!(again, [0, 2]);
        assert!(said_again(&delay, &[x, other]).is_empty());
    }
}
