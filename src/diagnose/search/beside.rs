//! What columns outside the library bring beside effects that stay: decomposed once, so that the many shapes that a refinement tries
//! cost their products with them alone.

use rayon::prelude::*;

use super::super::library::Shape;
use super::super::noise::Filter;
use super::super::session::Session;
use super::pivoted_cholesky::{Factor, Rest, dot};
use super::problem::{Given, Problem};
use super::refine::{STEPS, is_local};

/// Most moves with one step.
const MOVES: usize = 6;

/// Columns whitened by the filter, a value per row of the problem each, and after these what of each lies along the directions of the
/// noise that joined, which its products lack (Woodbury).
pub(super) type Columns = Vec<Vec<f64>>;

/// The effects that stay, for what is compared beside them.
pub(super) struct Beside {
    columns: Columns,
    factor: Factor,
    y: Vec<f64>,
    /// Number of rows of the problem.
    rows: usize,
    /// `L^-1` times the products of the columns with the gap.
    z: Vec<f64>,
}

impl Beside {
    /// Beside some variants (prepared).
    pub(super) fn new(problem: &Problem, others: &[usize]) -> Self {
        let Given { columns, factor, z, .. } = problem.given(others);
        let (columns, y) = problem.columns_and_gap(&columns);
        Self { columns, factor, y, rows: problem.len(), z }
    }

    /// Product of two columns beside the noise that joined.
    fn product(&self, a: &[f64], b: &[f64]) -> f64 {
        let ((a, a_along), (b, b_along)) = (a.split_at(self.rows), b.split_at(self.rows));
        dot(a, b) - dot(a_along, b_along)
    }

    /// Decomposition of the products of columns with each other beside what stays, and their products with the gap beside it.
    fn rest(&self, more: &Columns) -> (Factor, Vec<f64>) {
        let (k, n) = (more.len(), self.columns.len());
        let mut with = vec![0.0; k * n];
        for (i, other) in self.columns.iter().enumerate() {
            more.iter().enumerate().for_each(|(j, c)| with[j * n + i] = self.product(other, c));
        }
        let mut g = vec![0.0; k * k];
        for i in 0..k {
            (0..=i).for_each(|j| g[i * k + j] = self.product(&more[i], &more[j]));
        }
        let full: Vec<f64> = (0..k).map(|i| g[i * k + i]).collect();
        let b = more.iter().map(|c| self.product(c, &self.y)).collect();
        let rest = Rest::new(&self.factor, &self.z, with, g, b);
        (Factor::new(k, &rest.g, &full), rest.b)
    }

    /// Drop of the sum of squares by columns beside what stays, and how many of them are independent of it.
    pub(super) fn gain(&self, more: &Columns) -> (f64, usize) {
        let (factor, b) = self.rest(more);
        (factor.gain(&b), factor.rank())
    }

    /// The values of columns beside what stays.
    pub(super) fn values(&self, more: &Columns) -> Vec<f64> {
        let (factor, b) = self.rest(more);
        factor.solve(&b)
    }

    /// What a shape brings with the best values near its own, the number of its independent columns, and that shape.
    pub(super) fn best(
        &self,
        problem: &Problem,
        session: &Session,
        filter: &Filter,
        shape: &Shape,
    ) -> (f64, usize, Shape) {
        let gains = |shapes: &[&Shape]| -> Vec<(f64, usize)> {
            problem.columns_of(session, filter, shapes).par_iter().map(|c| self.gain(c)).collect()
        };
        let mut best = (gains(&[shape])[0], shape.clone());
        for step in STEPS {
            for _ in 0..MOVES {
                let mut near = best.1.neighbours(step);
                near.retain(|s| is_local(session, s));
                if near.is_empty() {
                    break;
                }
                let gains = gains(&near.iter().collect::<Vec<_>>());
                let better = gains.into_iter().zip(near).filter(|(g, _)| g.0 > best.0.0 + 1e-6);
                let Some(found) = better.max_by(|a, b| a.0.0.total_cmp(&b.0.0)) else { break };
                best = found;
            }
        }
        let ((gain, rank), shape) = best;
        (gain, rank, shape)
    }
}
