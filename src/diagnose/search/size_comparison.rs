//! Sizes of a random part of the gap compared as models, each with the effects that it leaves of those chosen.
//!
//! `y ~ N(X b, 1 + P S^2 P')` with the columns `P` of the random part and their sizes `S` (standard deviations of the coefficients), all
//! in the products of the columns. Source: Kennedy, O'Hagan 2001; Brynjarsdottir, O'Hagan 2014.

use nalgebra::{Cholesky, DMatrix};

use super::super::constants::STRONG;
use super::super::dense::product;
use super::super::library::Library;
use super::pivoted_cholesky::Factor;
use super::problem::Problem;
use super::select::{Selection, evidence};

/// Products of the columns of the effects chosen, the gap and the columns of a random part.
pub(super) struct Sets<'a> {
    selection: &'a Selection,
    library: &'a Library,
    /// First column and number of columns of each effect chosen.
    span: Vec<(usize, usize)>,
    /// Of the effects' columns and the gap (the last) with each other.
    own: DMatrix<f64>,
    /// Of these with the columns of the random part, and of those with each other.
    with: DMatrix<f64>,
    among: DMatrix<f64>,
}

/// Sizes with the effects left.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Sized {
    /// Twice a log evidence.
    pub(super) evidence: f64,
    /// The size of every column.
    pub(super) sizes: Vec<f64>,
    places: Vec<usize>,
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
        let (own, with, among) = (&all * all.transpose(), &all * columns, product(columns, columns));
        Self { selection, library, span, own, with, among }
    }

    /// The most evidence under some sizes of the columns, and the effects left; `None` where the products are degenerate.
    pub(super) fn under(&self, sizes: Vec<f64>) -> Option<Sized> {
        let (evidence, places) = Products::beside(self, Some(&sizes))?.best(self);
        Some(Sized { evidence, sizes, places })
    }

    /// Those of some sizes, the same of all columns, with the most evidence.
    pub(super) fn most_likely(&self, sizes: &[f64]) -> Option<Sized> {
        let all = sizes.iter().filter_map(|s| self.under(vec![*s; self.among.nrows()]));
        all.max_by(|a, b| a.evidence.total_cmp(&b.evidence))
    }

    /// The effects left of those chosen, where that says more than all of them without a random part.
    pub(super) fn kept(&self, found: &Sized) -> Option<Vec<usize>> {
        let plain = Products::beside(self, None)?;
        let plain = plain.of(self, &(0..self.span.len()).collect::<Vec<_>>());
        let kept = || found.places.iter().map(|p| self.selection.chosen[*p]).collect();
        (found.evidence > plain + STRONG).then(kept)
    }

    fn grid(&self, place: usize) -> usize {
        self.selection.grid[self.library.variants[self.selection.chosen[place]].label]
    }
}

/// Products of the effects' columns and the gap, whitened by a random part.
struct Products {
    gram: DMatrix<f64>,
    /// Logarithm of the determinant of what joined the noise.
    log_variance: f64,
}

impl Products {
    /// `None` where the products are degenerate.
    fn beside(sets: &Sets<'_>, sizes: Option<&[f64]>) -> Option<Self> {
        let Some(sizes) = sizes else { return Some(Self { gram: sets.own.clone(), log_variance: 0.0 }) };
        let m = sets.among.nrows();
        let inner = DMatrix::from_fn(m, m, |i, j| {
            sizes[i] * sizes[j] * sets.among[(i, j)] + f64::from(u8::from(i == j))
        });
        let mut with = sets.with.clone();
        with.column_iter_mut().zip(sizes).for_each(|(mut column, size)| column *= *size);
        let chol = Cholesky::new(inner)?;
        let log_variance = chol.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum();
        let gram = &sets.own - &with * chol.solve(&with.transpose());
        Some(Self { gram, log_variance })
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
    use super::super::discrepancy::SCALES;
    use super::super::low_rank::LowRank;
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
            let sets = Sets::new(&problem, &self.library, &self.selection, &self.waves);
            let found = sets.most_likely(&SCALES)?;
            sets.kept(&found).map(|kept| (found.sizes[0], kept))
        }
    }

    #[test]
    fn products_are_those_of_whitened_columns() {
        let case = Case::new();
        let y = DVector::from_fn(N, |i, _| (i as f64).cos());
        let problem = Problem::made_up(&case.effects, y);
        let sets = Sets::new(&problem, &case.library, &case.selection, &case.waves);
        let products = Products::beside(&sets, Some(&[2.0; 8])).unwrap();
        let joined = LowRank::of(&case.waves, &[2.0; 8]);
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
