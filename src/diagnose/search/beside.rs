//! What columns outside the library bring beside effects that stay: decomposed once, so that the many shapes that a refinement tries
//! cost their products with them alone.

use nalgebra::{DMatrix, DMatrixView};

use super::super::library::Shape;
use super::super::noise::Filter;
use super::super::session::Session;
use super::low_rank::product;
use super::pivoted_cholesky::{Factor, Rest};
use super::problem::{Given, Problem, WIDE};
use super::refine::{STEPS, is_local};

/// Most moves with one step.
const MOVES: usize = 6;

/// Columns whitened by the filter, a matrix row each: a value per row of the problem, and after these what of each lies along the
/// directions of the noise that joined, which its products lack (Woodbury).
pub(super) type Columns = DMatrix<f64>;

/// The effects that stay, for what is compared beside them.
pub(super) struct Beside {
    /// Their columns and the gap, a matrix column each; what lies along the directions of the noise with the sign that it has in products.
    with: DMatrix<f64>,
    factor: Factor,
    /// Number of rows of the problem.
    rows: usize,
    /// `L^-1` times the products of the columns with the gap.
    z: Vec<f64>,
}

impl Beside {
    /// Beside some variants (prepared).
    pub(super) fn new(problem: &Problem, others: &[usize]) -> Self {
        let Given { columns, factor, z, .. } = problem.given(others);
        let (rows, mut with) = (problem.len(), problem.columns_and_gap(&columns).transpose());
        with.rows_range_mut(rows..).neg_mut();
        Self { with, factor, rows, z }
    }

    /// Products of columns with each other beside the noise that joined, row by row.
    fn among(&self, own: &DMatrixView<'_, f64>) -> Vec<f64> {
        let k = own.nrows();
        let (values, along) = own.columns_range_pair(..self.rows, self.rows..);
        if k > WIDE {
            return (values * values.transpose() - along * along.transpose()).as_slice().to_vec();
        }
        let mut g = vec![0.0; k * k];
        for (part, sign) in [(values, 1.0), (along, -1.0)] {
            for row in part.column_iter() {
                for i in 0..k {
                    (0..=i).for_each(|j| g[i * k + j] += sign * row[i] * row[j]);
                }
            }
        }
        g
    }

    /// Decomposition of the products of columns with each other beside what stays, and their products with the gap beside it, for each
    /// group of so many columns.
    fn rests(&self, more: &Columns, widths: impl Iterator<Item = usize>) -> Vec<(Factor, Vec<f64>)> {
        let with = product(&more.as_view(), &self.with).transpose();
        let n = with.nrows() - 1;
        let mut at = 0;
        let of_group = |k: usize| {
            let g = self.among(&more.rows(at, k));
            let own = with.columns(at, k);
            at += k;
            let full: Vec<f64> = (0..k).map(|i| g[i * k + i]).collect();
            let b = own.row(n).iter().copied().collect();
            let rest = Rest::new(&self.factor, &self.z, own.rows(0, n).iter().copied().collect(), g, b);
            (Factor::new(k, &rest.g, &full), rest.b)
        };
        widths.map(of_group).collect()
    }

    /// Drop of the sum of squares by each group of so many columns beside what stays, and how many of them are independent of it.
    pub(super) fn gains(&self, more: &Columns, widths: impl Iterator<Item = usize>) -> Vec<(f64, usize)> {
        self.rests(more, widths).iter().map(|(factor, b)| (factor.gain(b), factor.rank())).collect()
    }

    /// The same of all columns together, and their values.
    pub(super) fn says(&self, more: &Columns) -> ((f64, usize), Vec<f64>) {
        let (factor, b) = self.rests(more, std::iter::once(more.nrows())).remove(0);
        ((factor.gain(&b), factor.rank()), factor.solve(&b))
    }

    /// What a shape brings with the best values near its own, the number of its independent columns, and that shape.
    pub(super) fn best(
        &self,
        problem: &Problem,
        session: &Session,
        filter: &Filter,
        shape: &Shape,
    ) -> (f64, usize, Shape) {
        let gains = |shapes: &[&Shape]| {
            let columns = problem.columns_of(session, filter, shapes);
            self.gains(&columns, shapes.iter().map(|s| s.width()))
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
