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
use super::variation::{DEGREE, DEGREES, Left, powers, products, ways};

/// Standard deviations of the coefficients that are tried, in those of the white noise of the best instrument.
pub(super) const SCALES: [f64; 8] = [0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0];

/// Quantile of chi-square with one degree of freedom: twice the logarithm of the likelihood ratio at the ends of an interval of 95 %.
const CHI_SQUARE_95: f64 = 3.84;

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
    let mut powers = powers(ways.len());
    for degree in DEGREE + 1..=DEGREES.len() {
        let of_one = |k: usize| (0..ways.len()).map(|j| if j == k { degree } else { 0 }).collect::<Vec<_>>();
        powers.extend((0..ways.len()).map(of_one));
    }
    let sees = |m: &Moment| !m.is_angular() && !m.is_encoder;
    let along = |d: usize| -> Vec<f64> {
        session.moments.iter().map(|m| if sees(m) { m.u[d] } else { 0.0 }).collect()
    };
    let each: [Vec<f64>; 3] = core::array::from_fn(along);
    let parts: Vec<&[f64]> = each.iter().map(Vec::as_slice).collect();
    let columns = products(session, filter, problem, &parts, (&ways, &powers))?;
    // what goes with the position of one axis has a name: positioning, straightness
    let is_nameless = |k: &usize| powers[k % powers.len()].iter().filter(|d| **d > 0).count() > 1;
    let nameless: Vec<usize> = (0..columns.ncols()).filter(is_nameless).collect();
    if nameless.is_empty() {
        return None;
    }
    let left = Left::new(problem, &selection.chosen, &columns);
    let own = left.beside_rest(&nameless);
    let scales = SCALES.map(|s| s * least_um);
    let scales = possible(&possible(&scales, |s| left.gain(s)), |s| own.gain(s));
    let (scale, kept) = Sets::new(problem, library, selection, &columns).most_likely(&scales)?;
    Some((LowRank::of(&columns, scale), kept))
}

/// The sizes inside the interval of 95 % that the readings leave. `gain` is twice the logarithm of the likelihood that a size gains.
fn possible(scales: &[f64], gain: impl Fn(f64) -> f64) -> Vec<f64> {
    let all: Vec<(f64, f64)> = scales.iter().map(|s| (*s, gain(*s))).collect();
    let most = all.iter().map(|s| s.1).fold(0.0, f64::max);
    all.into_iter().filter(|s| s.1 > most - CHI_SQUARE_95).map(|s| s.0).collect()
}

/// Products of the columns of the effects chosen, the gap and the columns of a discrepancy.
pub(super) struct Sets<'a> {
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
    pub(super) fn new(
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
        let mut all = problem.whitened_rows(&rows).insert_row(at, 0.0);
        all.row_mut(at).copy_from(&problem.y.transpose());
        let (own, with, among) = (&all * all.transpose(), &all * columns, columns.tr_mul(columns));
        Self { selection, library, span, own, with, among }
    }

    /// The size of the coefficients and the effects left with the most evidence, where there is more than without a discrepancy.
    pub(super) fn most_likely(&self, scales: &[f64]) -> Option<(f64, Vec<usize>)> {
        let plain = Products::beside(self, None)?;
        let plain = plain.of(self, &(0..self.span.len()).collect::<Vec<_>>());
        let of = |scale: f64| {
            let (evidence, places) = Products::beside(self, Some(scale))?.best(self);
            Some((evidence, scale, places))
        };
        let all = scales.iter().filter_map(|s| of(*s));
        let (most, scale, places) = all.max_by(|a, b| a.0.total_cmp(&b.0))?;
        let kept = || places.iter().map(|p| self.selection.chosen[*p]).collect();
        (most > plain + STRONG).then(|| (scale, kept()))
    }

    fn grid(&self, place: usize) -> usize {
        self.selection.grid[self.library.variants[self.selection.chosen[place]].label]
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
    fn last(&self, sets: &Sets<'_>, places: &[usize]) -> f64 {
        let (others, own) = places.split_at(places.len() - 1);
        let ((all, rank), (before, of_others)) = (self.gain(sets, places), self.gain(sets, others));
        evidence(all - before, rank - of_others.min(rank), sets.grid(own[0]))
    }

    /// Evidence of the effects at some places, each beside those before it, and of what is left: less its square and the determinant.
    fn of(&self, sets: &Sets<'_>, places: &[usize]) -> f64 {
        let each: f64 = (1..=places.len()).map(|n| self.last(sets, &places[..n])).sum();
        let last = self.gram.nrows() - 1;
        each - self.gram[(last, last)] - self.log_variance
    }

    /// The largest evidence of a part of the effects, found from all of them and from none, and their places.
    fn best(&self, sets: &Sets<'_>) -> (f64, Vec<usize>) {
        let of = |places: Vec<usize>| (self.of(sets, &places), places);
        let [backward, forward] = [self.backward(sets), self.forward(sets)].map(of);
        if forward.0 > backward.0 { forward } else { backward }
    }

    /// The places without those that are superfluous.
    fn backward(&self, sets: &Sets<'_>) -> Vec<usize> {
        let mut places: Vec<usize> = (0..sets.span.len()).collect();
        loop {
            let beside = |k: usize| {
                let mut turned: Vec<usize> = places.clone();
                let own = turned.remove(k);
                turned.push(own);
                (k, self.last(sets, &turned))
            };
            let weakest = (0..places.len()).map(beside).min_by(|a, b| a.1.total_cmp(&b.1));
            match weakest {
                Some((k, e)) if e < sets.selection.threshold => {
                    places.remove(k);
                }
                _ => return places,
            }
        }
    }

    /// The places that bring something, the most first.
    fn forward(&self, sets: &Sets<'_>) -> Vec<usize> {
        let mut places: Vec<usize> = Vec::new();
        loop {
            let rest = (0..sets.span.len()).filter(|p| !places.contains(p));
            let with = |p: usize| (p, self.last(sets, &[&places[..], &[p]].concat()));
            match rest.map(with).max_by(|a, b| a.1.total_cmp(&b.1)) {
                Some((p, e)) if e >= sets.selection.threshold => places.push(p),
                _ => return places,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::DVector;

    use super::super::super::library::{Kind, Label, Shape, Variant, forms};
    use super::super::super::moment::Axis;
    use super::super::super::noise::Random;
    use super::*;

    const N: usize = 300;

    /// A line and a step, both effects chosen, and eight waves of which a discrepancy consists.
    struct Case {
        library: Library,
        selection: Selection,
        effects: Vec<Vec<DVector<f64>>>,
        waves: DMatrix<f64>,
    }

    impl Case {
        fn new() -> Self {
            let at = |i: usize| 2.0 * i as f64 / (N - 1) as f64 - 1.0;
            let column = |f: &dyn Fn(f64) -> f64| DVector::from_fn(N, |i, _| f(at(i)));
            let line = column(&|x| x);
            let step = DVector::from_fn(N, |i, _| if i % 2 == 0 { 1.0 } else { -1.0 });
            let wave = |k: usize| column(&|x| (1.3 * k as f64 * x + 0.4 * k as f64).sin());
            let waves = DMatrix::from_columns(&(1..=8).map(wave).collect::<Vec<_>>());
            let variants =
                (0..2).map(|label| Variant { label, shape: Shape::Scale(forms::Scale { axis: Axis::X }) });
            let library = Library {
                labels: ["scale", "backlash"].map(|effect| Label::new(effect, "x")).to_vec(),
                kinds: vec![Kind::Machine; 2],
                variants: variants.collect(),
                ..Library::default()
            };
            let selection =
                Selection { chosen: vec![0, 1], threshold: 10.0, grid: vec![1; 2], ..Selection::default() };
            Self { library, selection, effects: vec![vec![line], vec![step]], waves }
        }

        /// Noise of unit variance with so much of both effects and of the waves.
        fn most_likely(&self, [line, step]: [f64; 2], waves: f64) -> Option<(f64, Vec<usize>)> {
            let mut random = Random::new(5);
            let mut y = DVector::from_fn(N, |_, _| random.normal());
            y.axpy(line, &self.effects[0][0], 1.0);
            y.axpy(step, &self.effects[1][0], 1.0);
            let coefficients = DVector::from_fn(self.waves.ncols(), |_, _| waves * random.normal());
            y += &self.waves * coefficients;
            let problem = Problem::made_up(&self.effects, y);
            Sets::new(&problem, &self.library, &self.selection, &self.waves).most_likely(&SCALES)
        }
    }

    #[test]
    fn products_are_those_of_whitened_columns() {
        let case = Case::new();
        let y = DVector::from_fn(N, |i, _| (i as f64).cos());
        let problem = Problem::made_up(&case.effects, y);
        let sets = Sets::new(&problem, &case.library, &case.selection, &case.waves);
        let products = Products::beside(&sets, Some(2.0)).unwrap();
        let joined = LowRank::of(&case.waves, 2.0);
        let (mut w, mut y) = (problem.whitened_rows(&[0, 1]), problem.y.clone());
        joined.turn(w.as_mut_slice(), false);
        joined.turn(y.as_mut_slice(), false);
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-6 * (1.0 + b.abs()), "{a} {b}");
        for i in 0..2 {
            close(products.gram[(i, 2)], w.row(i).transpose().dot(&y));
            close(products.gram[(0, i)], w.row(0).dot(&w.row(i)));
        }
        close(products.gram[(2, 2)], y.norm_squared());
        close(products.log_variance, joined.log_variance());
    }

    #[test]
    fn what_the_structure_of_the_others_says_is_no_effect() {
        let case = Case::new();
        let (scale, kept) = case.most_likely([0.0, 1.0], 1.0).unwrap();
        assert_eq!(kept, [1], "of coefficients of {scale}");
        assert!((0.4..2.1).contains(&scale), "{scale}");
        // effects far beyond it stay
        assert_eq!(case.most_likely([30.0, 1.0], 1.0).unwrap().1, [0, 1]);
    }

    #[test]
    fn effects_alone_ask_for_no_discrepancy() {
        assert_eq!(Case::new().most_likely([1.5, 1.0], 0.0), None);
    }
}
