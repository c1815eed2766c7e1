//! All effects chosen together, from which some are taken out again: what any effect would bring in their place, without solving for the
//! others anew.
//!
//! With all columns in, a column `c` has the coefficients `B_c`, the fit is `beta` and the inverse of the Gram matrix `V`. Without the
//! columns D the products are `S_ce + B_Dc' V_DD^-1 B_De`, and with the gap `b_c + B_Dc' V_DD^-1 beta_D` (block inverse). A column that
//! stays and depended on D takes its own direction out of that.

use nalgebra::{DMatrix, DVectorView};
use rayon::prelude::*;

use super::super::constants::DEGENERATE;
use super::pivoted_cholesky::{Factor, dot};
use super::problem::{Given, Problem};
use super::select::others;

/// Columns that one processor takes at a time.
const TOGETHER: usize = 256;

/// The effects chosen, all of them in.
pub(crate) struct Joint {
    chosen: Vec<usize>,
    pub(super) given: Given,
    /// Coefficients of each column on those that are in, a column each.
    with: DMatrix<f64>,
    /// Of each variant the products of its columns with each other (row by row) and with the gap, beside all that is in.
    each: Vec<(Vec<f64>, Vec<f64>)>,
    inverse: DMatrix<f64>,
    pub(super) beta: Vec<f64>,
}

impl Joint {
    /// Of some variants.
    pub(super) fn new(problem: &mut Problem, chosen: &[usize]) -> Self {
        problem.prepare(chosen);
        Self::of(problem, chosen)
    }

    /// Of variants (prepared).
    pub(super) fn of(problem: &Problem, chosen: &[usize]) -> Self {
        let given = problem.given(chosen);
        let lower = given.factor.inverse_lower();
        let upper = lower.transpose();
        let own = problem.products_with(&given);
        let parts: Vec<[DMatrix<f64>; 2]> = (0..own.ncols())
            .into_par_iter()
            .step_by(TOGETHER)
            .map(|at| {
                let half = &lower * own.columns(at, TOGETHER.min(own.ncols() - at));
                let with = &upper * &half;
                [half, with]
            })
            .collect();
        let whole = |k: usize| {
            let data = parts.iter().flat_map(|part| part[k].as_slice()).copied().collect();
            DMatrix::from_vec(own.nrows(), own.ncols(), data)
        };
        let (half, with) = (whole(0), whole(1));
        let beta = problem.fit(&given);
        let of = |variant: usize| {
            let (mut g, mut b) = (problem.own[variant].clone(), Vec::new());
            let columns = problem.columns(variant);
            let k = columns.len();
            for (i, c) in columns.clone().enumerate() {
                for (j, other) in columns.clone().enumerate().take(i + 1) {
                    g[i * k + j] -= half.column(c).dot(&half.column(other));
                    g[j * k + i] = g[i * k + j];
                }
                b.push(problem.b[c] - dot(half.column(c).as_slice(), &given.z));
            }
            (g, b)
        };
        let each = (0..problem.span.len()).into_par_iter().with_min_len(TOGETHER).map(of).collect();
        Self { chosen: chosen.to_vec(), each, with, inverse: upper * lower, beta, given }
    }

    /// The same once other variants are chosen.
    pub(super) fn follow(&mut self, problem: &mut Problem, chosen: &[usize]) {
        if self.chosen != chosen {
            *self = Self::new(problem, chosen);
        }
    }

    /// Drop of the sum of squares by a variant beside all that is in, and the number of its independent columns.
    pub(super) fn gain(&self, problem: &Problem, variant: usize) -> (f64, usize) {
        let (g, b) = &self.each[variant];
        problem.gain_in(variant, g, b)
    }

    /// The effects without those at some places.
    pub(crate) fn without<'a>(&'a self, problem: &'a Problem, places: &[usize]) -> Without<'a> {
        let is_out = |c: &usize| places.iter().any(|p| problem.columns(self.chosen[*p]).contains(c));
        let columns = self.given.columns.iter().zip(self.given.factor.kept()).enumerate();
        let out: Vec<usize> =
            columns.clone().filter(|(_, (c, kept))| **kept && is_out(c)).map(|(i, _)| i).collect();
        let m = out.len();
        let block: Vec<f64> = (0..m * m).map(|k| self.inverse[(out[k / m], out[k % m])]).collect();
        let full: Vec<f64> = (0..m).map(|i| block[i * m + i]).collect();
        let mut without = Without {
            joint: self,
            problem,
            others: others(&self.chosen, places),
            factor: Factor::new(m, &block, &full),
            spanned: Vec::new(),
            of_gap: Vec::new(),
            out,
        };
        // a column that depended on those that are out says again what it can of theirs
        for (_, (c, _)) in columns.filter(|(_, (c, kept))| !**kept && !is_out(c)) {
            let mut back = without.back(self.with.column(*c).as_slice());
            let square = dot(&back, &back);
            if square > DEGENERATE {
                back.iter_mut().for_each(|v| *v /= square.sqrt());
                without.spanned.push(back);
            }
        }
        without.of_gap = without.back(&self.beta);
        without
    }
}

/// The effects that stay once some are out again.
pub(crate) struct Without<'a> {
    joint: &'a Joint,
    problem: &'a Problem,
    /// The effects that stay.
    pub(crate) others: Vec<usize>,
    /// Places of the columns that are out, and the decomposition of their block of the inverse.
    out: Vec<usize>,
    factor: Factor,
    /// Orthonormal directions of what is out that columns which stay say again.
    spanned: Vec<Vec<f64>>,
    of_gap: Vec<f64>,
}

impl Without<'_> {
    /// What comes back of a column with the coefficients `on` on those that were in.
    fn back(&self, on: &[f64]) -> Vec<f64> {
        let mut back: Vec<f64> = self.out.iter().map(|i| on[*i]).collect();
        self.factor.forward_in(&mut back);
        for direction in &self.spanned {
            let along = dot(direction, &back);
            back.iter_mut().zip(direction).for_each(|(b, d)| *b -= along * d);
        }
        back
    }

    /// Drop of the sum of squares by a variant beside the effects that stay, and the number of its independent columns.
    pub(crate) fn gain(&self, variant: usize) -> (f64, usize) {
        let columns = self.problem.columns(variant);
        let back: Vec<Vec<f64>> = columns.map(|c| self.back(self.joint.with.column(c).as_slice())).collect();
        self.gain_of(variant, |i| &back[i])
    }

    /// The same of any variant; what comes back of all columns is computed at once.
    pub(crate) fn gains(&self) -> impl Fn(usize) -> (f64, usize) + Sync {
        let mut back = self.factor.inverse_lower() * self.joint.with.select_rows(&self.out);
        for direction in &self.spanned {
            let direction = DVectorView::from_slice(direction, direction.len());
            let along = back.tr_mul(&direction);
            back.ger(-1.0, &direction, &along, 1.0);
        }
        move |variant| {
            let (at, _) = self.problem.span[variant];
            let m = self.out.len();
            self.gain_of(variant, |i| &back.as_slice()[(at + i) * m..][..m])
        }
    }

    fn gain_of<'b>(&self, variant: usize, back: impl Fn(usize) -> &'b [f64]) -> (f64, usize) {
        let (g, b) = &self.joint.each[variant];
        let k = b.len();
        let g: Vec<f64> = (0..k * k).map(|n| g[n] + dot(back(n / k), back(n % k))).collect();
        let b: Vec<f64> = b.iter().enumerate().map(|(i, b)| b + dot(back(i), &self.of_gap)).collect();
        self.problem.gain_in(variant, &g, &b)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::DVector;

    use super::super::super::noise::Random;
    use super::*;

    const N: usize = 80;

    /// Five effects of one to three columns that are alike; the first column of the last depends on others.
    fn problem() -> Problem {
        let mut random = Random::new(3);
        let mut column = || DVector::from_fn(N, |_, _| random.normal());
        let common = column();
        let mut effects: Vec<Vec<DVector<f64>>> =
            [1, 3, 2, 1, 2].iter().map(|k| (0..*k).map(|_| column() + &common).collect()).collect();
        effects[4][0] = &effects[0][0] + 0.3 * &effects[1][2];
        let y = column() + 3.0 * &effects[1][0] - &effects[3][0];
        Problem::made_up(&effects, y)
    }

    #[test]
    fn without_some_is_as_if_the_others_alone_were_in() {
        let mut problem = problem();
        let chosen = [0, 1, 2, 3, 4];
        let joint = Joint::new(&mut problem, &chosen);
        for (out, comes_back) in
            [(vec![2], false), (vec![2, 3], false), (vec![4], false), (vec![0], true), (vec![1, 3], true)]
        {
            let rest = joint.without(&problem, &out);
            assert_eq!(!rest.spanned.is_empty(), comes_back, "{out:?}");
            let others: Vec<usize> = chosen.into_iter().filter(|v| !out.contains(v)).collect();
            assert_eq!(rest.others, others);
            let gains = rest.gains();
            for v in chosen {
                let ((gain, rank), (wanted, of)) = (rest.gain(v), problem.gain_beside(&others, v));
                assert!((gains(v).0 - gain).abs() < 1e-9 * (1.0 + gain) && gains(v).1 == rank, "{out:?} {v}");
                assert!(
                    (gain - wanted).abs() < 1e-9 * (1.0 + wanted) && rank == of,
                    "{out:?} {v}: {gain} {wanted}"
                );
            }
        }
    }
}
