//! Discrepancy: structure over the volume that no effect describes. A real machine has some, and small effects are named after it
//! where it is taken for noise that is independent from reading to reading.
//!
//! A displacement of the tool along each direction of the machine, a sum of products of Legendre polynomials of the linear axes with
//! normal coefficients of a common size. Sizes, and with each of them the effects that are left of those chosen, are compared as
//! models: `y ~ N(X b, 1 + s^2 P P')`, all in the products of the columns. Source: Kennedy, O'Hagan 2001; Brynjarsdottir,
//! O'Hagan 2014; `docs/explanation/diagnosis.md` (discrepancy).

use nalgebra::{Cholesky, DMatrix};

use super::super::constants::STRONG;
use super::super::library::Library;
use super::super::moment::Moment;
use super::super::noise::Filter;
use super::super::session::Session;
use super::low_rank::LowRank;
use super::pivoted_cholesky::Factor;
use super::problem::Problem;
use super::select::{Selection, evidence};
use super::variation::{powers, products, ways};

/// Standard deviations of the coefficients that are tried, in those of the white noise of the best instrument.
const SCALES: [f64; 8] = [0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0];

/// The discrepancy that, with those of the effects chosen that it leaves (returned with it), says more than all of the effects chosen
/// without one; `None` where there is no such. `least_um` is the white noise of the best instrument.
#[must_use]
pub fn discrepancy(
    session: &Session,
    filter: &Filter,
    problem: &Problem,
    library: &Library,
    selection: &Selection,
    least_um: f64,
) -> Option<(LowRank, Vec<usize>)> {
    let ways = ways(session, problem);
    let powers = powers(ways.len());
    let sees = |m: &Moment| !m.is_angular() && !m.is_encoder;
    let along = |d: usize| -> Vec<f64> {
        session.moments.iter().map(|m| if sees(m) { m.u[d] } else { 0.0 }).collect()
    };
    let each: [Vec<f64>; 3] = core::array::from_fn(along);
    let parts: Vec<&[f64]> = each.iter().map(Vec::as_slice).collect();
    let columns = products(session, filter, problem, &parts, (&ways, &powers))?;
    let sets = Sets::new(problem, library, selection, &columns);
    let plain = Products::beside(&sets, None)?.evidence(&sets, &selection.chosen);
    let scales = SCALES.map(|s| s * least_um);
    let of = |scale: f64| {
        let products = Products::beside(&sets, Some(scale))?;
        let (evidence, kept) = products.best(&sets, &selection.chosen, selection.threshold);
        Some((evidence, scale, kept))
    };
    let all = scales.into_iter().filter_map(of);
    let (most, scale, kept) = all.max_by(|a, b| a.0.total_cmp(&b.0))?;
    (most > plain + STRONG).then(|| (LowRank::of(&columns, scale), kept))
}

/// Products of the columns of the effects chosen, the gap and the columns of a discrepancy.
struct Sets<'a> {
    selection: &'a Selection,
    library: &'a Library,
    /// First column and number of columns of each effect chosen.
    span: Vec<(usize, usize)>,
    /// Of the effects' columns and the gap (the last) with each other.
    own: DMatrix<f64>,
    /// Of these with the columns of the discrepancy, and of those with each other.
    with: DMatrix<f64>,
    among: DMatrix<f64>,
}

impl<'a> Sets<'a> {
    fn new(
        problem: &Problem,
        library: &'a Library,
        selection: &'a Selection,
        columns: &DMatrix<f64>,
    ) -> Self {
        let (mut span, mut rows, mut at) = (Vec::new(), Vec::new(), 0);
        for v in &selection.chosen {
            let (first, k) = problem.span[*v];
            rows.extend(first..first + k);
            span.push((at, k));
            at += k;
        }
        let mut all = problem.w.select_rows(&rows).insert_row(at, 0.0);
        all.row_mut(at).copy_from(&problem.y.transpose());
        let (own, with, among) = (&all * all.transpose(), &all * columns, columns.tr_mul(columns));
        Self { selection, library, span, own, with, among }
    }

    fn grid(&self, variant: usize) -> usize {
        self.selection.grid[self.library.variants[variant].label]
    }
}

/// Products of the effects' columns and the gap, whitened by a discrepancy of one size.
struct Products {
    gram: DMatrix<f64>,
    /// Logarithm of the determinant of what joined the noise.
    log_variance: f64,
}

impl Products {
    /// `None` where the products are degenerate.
    fn beside(sets: &Sets<'_>, scale: Option<f64>) -> Option<Self> {
        let Some(scale) = scale else { return Some(Self { gram: sets.own.clone(), log_variance: 0.0 }) };
        let m = sets.among.nrows();
        let inner = &sets.among + DMatrix::identity(m, m) / (scale * scale);
        let chol = Cholesky::new(inner)?;
        let log: f64 = chol.l_dirty().diagonal().iter().map(|d| 2.0 * (d * scale).ln()).sum();
        let gram = &sets.own - &sets.with * chol.solve(&sets.with.transpose());
        Some(Self { gram, log_variance: log })
    }

    /// Drop of the sum of squares by the effects at some places, and their independent columns.
    fn gain(&self, sets: &Sets<'_>, places: &[usize]) -> (f64, usize) {
        let columns: Vec<usize> =
            places.iter().flat_map(|p| sets.span[*p].0..sets.span[*p].0 + sets.span[*p].1).collect();
        let (n, last) = (columns.len(), self.gram.nrows() - 1);
        let pair = |k: usize| self.gram[(columns[k / n], columns[k % n])];
        let g: Vec<f64> = (0..n * n).map(pair).collect();
        let full: Vec<f64> = columns.iter().map(|c| sets.own[(*c, *c)]).collect();
        let b: Vec<f64> = columns.iter().map(|c| self.gram[(*c, last)]).collect();
        let factor = Factor::new(n, &g, &full);
        (factor.gain(&b), factor.rank())
    }

    /// Evidence of the effect at the last of some places beside the others.
    fn last(&self, sets: &Sets<'_>, places: &[usize], chosen: &[usize]) -> f64 {
        let (others, own) = places.split_at(places.len() - 1);
        let ((all, rank), (before, of_others)) = (self.gain(sets, places), self.gain(sets, others));
        evidence(all - before, rank - of_others.min(rank), sets.grid(chosen[own[0]]))
    }

    /// Evidence of the effects at some places, each beside those before it, and of what is left: less its square and the determinant.
    fn of(&self, sets: &Sets<'_>, places: &[usize], chosen: &[usize]) -> f64 {
        let each: f64 = (1..=places.len()).map(|n| self.last(sets, &places[..n], chosen)).sum();
        let last = self.gram.nrows() - 1;
        each - self.gram[(last, last)] - self.log_variance
    }

    fn evidence(&self, sets: &Sets<'_>, chosen: &[usize]) -> f64 {
        self.of(sets, &(0..chosen.len()).collect::<Vec<_>>(), chosen)
    }

    /// The largest evidence of a part of the effects, found from all of them and from none, and that part.
    fn best(&self, sets: &Sets<'_>, chosen: &[usize], threshold: f64) -> (f64, Vec<usize>) {
        let of = |places: Vec<usize>| {
            (self.of(sets, &places, chosen), places.iter().map(|p| chosen[*p]).collect::<Vec<usize>>())
        };
        let [backward, forward] =
            [self.backward(sets, chosen, threshold), self.forward(sets, chosen, threshold)].map(of);
        if forward.0 > backward.0 { forward } else { backward }
    }

    /// The places without those that are superfluous.
    fn backward(&self, sets: &Sets<'_>, chosen: &[usize], threshold: f64) -> Vec<usize> {
        let mut places: Vec<usize> = (0..chosen.len()).collect();
        loop {
            let beside = |k: usize| {
                let mut turned: Vec<usize> = places.clone();
                let own = turned.remove(k);
                turned.push(own);
                (k, self.last(sets, &turned, chosen))
            };
            let weakest = (0..places.len()).map(beside).min_by(|a, b| a.1.total_cmp(&b.1));
            match weakest {
                Some((k, e)) if e < threshold => {
                    places.remove(k);
                }
                _ => return places,
            }
        }
    }

    /// The places that bring something, the most first.
    fn forward(&self, sets: &Sets<'_>, chosen: &[usize], threshold: f64) -> Vec<usize> {
        let mut places: Vec<usize> = Vec::new();
        loop {
            let rest = (0..chosen.len()).filter(|p| !places.contains(p));
            let with = |p: usize| (p, self.last(sets, &[&places[..], &[p]].concat(), chosen));
            match rest.map(with).max_by(|a, b| a.1.total_cmp(&b.1)) {
                Some((p, e)) if e >= threshold => places.push(p),
                _ => return places,
            }
        }
    }
}
