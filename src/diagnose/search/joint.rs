//! All effects chosen together, from which some are taken out again: what any effect would bring in their place, without solving for the
//! others anew.
//!
//! With all columns in, a column `c` has the coefficients `B_c`, the fit is `beta` and the inverse of the Gram matrix `V`. Without the
//! columns D the products are `S_ce + B_Dc' V_DD^-1 B_De`, and with the gap `b_c + B_Dc' V_DD^-1 beta_D` (block inverse).

use super::super::constants::DEGENERATE;
use super::pivoted_cholesky::{Factor, add_multiples};
use super::problem::{Given, Problem};

/// The effects chosen, all of them in.
pub(super) struct Joint<'a> {
    problem: &'a Problem,
    given: Given,
    /// Products of the columns of each variant beside all that is in, row by row.
    own: Vec<Vec<f64>>,
    /// Coefficients of every column of the problem on each column that is in, row by row.
    on: Vec<f64>,
    inverse: Vec<f64>,
    beta: Vec<f64>,
}

impl<'a> Joint<'a> {
    /// Of variants (prepared).
    pub(super) fn new(problem: &'a Problem, chosen: &[usize]) -> Self {
        let given = problem.given(chosen);
        let own = (0..problem.span.len()).map(|v| problem.conditional(&given, v)).collect();
        let (on, inverse, beta) = (given.coefficients(), given.factor.inverse(), problem.fit(&given));
        Self { problem, given, own, on, inverse, beta }
    }

    /// The same without the columns of some variants; `None` where a column of the others, which depended on them, then says something.
    pub(super) fn without(&self, variants: &[usize]) -> Option<Without<'_>> {
        let columns = &self.given.columns;
        let (all, width) = (columns.len(), self.problem.b.len());
        let is_out = |c: &usize| variants.iter().any(|v| self.problem.columns(*v).contains(c));
        let kept = self.given.factor.kept();
        let out: Vec<usize> = (0..all).filter(|i| kept[*i] && is_out(&columns[*i])).collect();
        let m = out.len();
        let block: Vec<f64> = (0..m * m).map(|k| self.inverse[out[k / m] * all + out[k % m]]).collect();
        let full: Vec<f64> = (0..m).map(|i| block[i * m + i]).collect();
        let factor = Factor::new(m, &block, &full);
        let mut rows = vec![0.0; m * width];
        for (i, j) in out.iter().enumerate() {
            let (before, rest) = rows.split_at_mut(i * width);
            factor.row_forward(i, &self.on[j * width..][..width], before, &mut rest[..width]);
        }
        let returns = |c: &usize| rows.chunks_exact(width).map(|r| r[*c] * r[*c]).sum::<f64>() > DEGENERATE;
        let mut spanned = columns.iter().zip(kept).filter(|(c, kept)| !**kept && !is_out(c));
        if spanned.any(|(c, _)| returns(c)) {
            return None;
        }
        let of_gap = factor.forward(&out.iter().map(|i| self.beta[*i]).collect::<Vec<_>>());
        let mut b = self.given.left().to_vec();
        add_multiples(&mut b, &rows, &of_gap);
        Some(Without { joint: self, rows, b, of_gap })
    }
}

/// What is left of everything once some of the effects are out again.
pub(super) struct Without<'a> {
    joint: &'a Joint<'a>,
    /// What comes back, a row per column that is out.
    rows: Vec<f64>,
    b: Vec<f64>,
    of_gap: Vec<f64>,
}

impl Without<'_> {
    fn gain(&self, variant: usize) -> (f64, usize) {
        let problem = self.joint.problem;
        let own = problem.columns(variant);
        let mut g = self.joint.own[variant].clone();
        for row in self.rows.chunks_exact(problem.b.len().max(1)) {
            let back = &row[own.clone()];
            for (g, x) in g.chunks_exact_mut(back.len()).zip(back) {
                g.iter_mut().zip(back).for_each(|(g, y)| *g += x * y);
            }
        }
        problem.gain_in(variant, &g, &self.b[own])
    }

    /// Drop of the sum of squares by what is out beside all that is in, and the number of its independent columns.
    pub(super) fn gain_of_these(&self) -> (f64, usize) {
        (self.of_gap.iter().map(|z| z * z).sum(), self.of_gap.len())
    }
}

/// Everything chosen but some effects, by whichever way its products are known.
pub(super) enum Rest<'a> {
    Without(Without<'a>),
    Given(&'a Problem, Given),
}

impl<'a> Rest<'a> {
    /// `others` stay of the effects of `joint` once `out` are taken out.
    pub(super) fn new(joint: &'a Joint<'a>, others: &[usize], out: &[usize]) -> Self {
        let given = || Self::Given(joint.problem, joint.problem.given(others));
        joint.without(out).map_or_else(given, Self::Without)
    }

    /// Drop of the sum of squares by a variant beside the effects that stay, and the number of its independent columns.
    pub(super) fn gain(&self, variant: usize) -> (f64, usize) {
        match self {
            Self::Without(without) => without.gain(variant),
            Self::Given(problem, given) => problem.gain(given, variant),
        }
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
        problem.prepare(&chosen);
        let joint = Joint::new(&problem, &chosen);
        for (out, comes_back) in
            [(vec![2], false), (vec![2, 3], false), (vec![4], false), (vec![0], true), (vec![1, 3], true)]
        {
            assert_eq!(joint.without(&out).is_none(), comes_back, "{out:?}");
            let others: Vec<usize> = chosen.into_iter().filter(|v| !out.contains(v)).collect();
            let (rest, given) = (Rest::new(&joint, &others, &out), problem.given(&others));
            for v in chosen {
                let ((gain, rank), (wanted, of)) = (rest.gain(v), problem.gain(&given, v));
                assert!(
                    (gain - wanted).abs() < 1e-9 * (1.0 + wanted) && rank == of,
                    "{out:?} {v}: {gain} {wanted}"
                );
            }
        }
        let (gain, rank) = joint.without(&[3]).unwrap().gain_of_these();
        let (wanted, of) = problem.gain_beside(&[0, 1, 2, 4], 3);
        assert!((gain - wanted).abs() < 1e-9 * wanted && rank == of);
    }
}
