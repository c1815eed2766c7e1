//! Small symmetric systems whose columns may depend on each other: a Cholesky decomposition that leaves out what is
//! already spanned.

use nalgebra::{DMatrix, DVectorView};

use super::super::constants::DEGENERATE;
use super::super::dense::{inverse_lower, product};

/// A decomposition `G = L L'` of the independent columns.
#[derive(Debug, Clone, Default)]
pub(super) struct Factor {
    n: usize,
    /// Row by row; rows of columns that were left out are zero.
    l: Vec<f64>,
    kept: Vec<bool>,
}

impl Factor {
    /// Decomposes a symmetric matrix given row by row, of which the half up to the diagonal is read; a column is left out where less than
    /// a tiny share of `full` (its size before anything was taken off) is its own.
    pub(super) fn new(n: usize, g: &[f64], full: &[f64]) -> Self {
        let mut factor = Self { n, l: vec![0.0; n * n], kept: vec![false; n] };
        for i in 0..n {
            let (before, row) = factor.l.split_at_mut(i * n);
            for j in (0..i).filter(|j| factor.kept[*j]) {
                let other = &before[j * n..][..j];
                row[j] = (g[i * n + j] - dot(&row[..j], other)) / before[j * n + j];
            }
            let d = g[i * n + i] - dot(&row[..i], &row[..i]);
            if d > DEGENERATE * full[i] && d > 0.0 {
                (row[i], factor.kept[i]) = (d.sqrt(), true);
            } else {
                row[..i].fill(0.0);
            }
        }
        factor
    }

    /// Number of independent columns.
    pub(super) fn rank(&self) -> usize {
        self.kept.iter().filter(|k| **k).count()
    }

    /// True for each independent column.
    pub(super) fn kept(&self) -> &[bool] {
        &self.kept
    }

    /// The independent columns with the rows of `L` up to their diagonals.
    fn rows(&self) -> impl DoubleEndedIterator<Item = (usize, &[f64])> {
        let rows = self.l.chunks_exact(self.n.max(1)).enumerate();
        rows.filter(|(i, _)| self.kept[*i]).map(|(i, row)| (i, &row[..=i]))
    }

    /// `L^-1 b`; zero where a column was left out.
    pub(super) fn forward(&self, b: &[f64]) -> Vec<f64> {
        let mut x = b.to_vec();
        self.forward_in(&mut x);
        x
    }

    /// The same in place.
    pub(super) fn forward_in(&self, x: &mut [f64]) {
        for (i, row) in self.l.chunks_exact(self.n.max(1)).enumerate() {
            x[i] = if self.kept[i] { (x[i] - dot(&row[..i], &x[..i])) / row[i] } else { 0.0 };
        }
    }

    /// `L'^-1 x` in place; zero where a column was left out.
    pub(super) fn backward(&self, x: &mut [f64]) {
        for (i, row) in self.rows().rev() {
            let (before, own) = x.split_at_mut(i);
            own[0] /= row[i];
            before.iter_mut().zip(row).for_each(|(x, l)| *x -= own[0] * l);
        }
        x.iter_mut().zip(&self.kept).for_each(|(x, kept)| *x = if *kept { *x } else { 0.0 });
    }

    /// `G^-1 b`.
    pub(super) fn solve(&self, b: &[f64]) -> Vec<f64> {
        let mut x = self.forward(b);
        self.backward(&mut x);
        x
    }

    /// Drop of the sum of squares by fitting.
    pub(super) fn gain(&self, b: &[f64]) -> f64 {
        self.forward(b).iter().map(|v| v * v).sum()
    }

    /// `L^-1`; rows and columns of what was left out are zero.
    pub(super) fn inverse_lower(&self) -> DMatrix<f64> {
        let kept: Vec<usize> = self.rows().map(|(i, _)| i).collect();
        let small = DMatrix::from_fn(kept.len(), kept.len(), |i, j| self.l[kept[i] * self.n + kept[j]]);
        let inverse = inverse_lower(&small);
        let mut out = DMatrix::zeros(self.n, self.n);
        for (j, to) in kept.iter().enumerate() {
            (j..kept.len()).for_each(|i| out[(kept[i], *to)] = inverse[(i, j)]);
        }
        out
    }

    /// `G^-1`, row by row.
    pub(super) fn inverse(&self) -> Vec<f64> {
        let lower = self.inverse_lower();
        product(&lower, &lower).as_slice().to_vec()
    }
}

/// What is left of some columns beside decomposed ones.
pub(super) struct Rest {
    /// Products of the columns with each other, row by row.
    pub g: Vec<f64>,
    /// Products with the gap.
    pub b: Vec<f64>,
}

impl Rest {
    /// From the products of the columns with the decomposed ones (one column after the other), with each other and with the gap;
    /// `z` is `L^-1` times the products of
    /// the decomposed ones with the gap.
    pub(super) fn new(
        factor: &Factor,
        z: &[f64],
        mut with: Vec<f64>,
        mut g: Vec<f64>,
        mut b: Vec<f64>,
    ) -> Self {
        let (k, n) = (b.len(), z.len());
        with.chunks_exact_mut(n.max(1)).for_each(|column| factor.forward_in(column));
        let column = |i: usize| &with[i * n..][..n];
        for i in 0..k {
            for j in 0..=i {
                g[i * k + j] -= dot(column(i), column(j));
                g[j * k + i] = g[i * k + j];
            }
            b[i] -= dot(column(i), z);
        }
        Self { g, b }
    }
}

/// Product of two columns, in several sums at a time.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    DVectorView::from_slice(a, a.len()).dot(&DVectorView::from_slice(b, b.len()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solves_and_leaves_out_what_depends() {
        let g = [4.0, 2.0, 8.0, 2.0, 3.0, 4.0, 8.0, 4.0, 16.0];
        let full = [4.0, 3.0, 16.0];
        let f = Factor::new(3, &g, &full);
        assert_eq!(f.rank(), 2);
        let x = f.solve(&[2.0, 1.0, 4.0]);
        assert!(
            (4.0 * x[0] + 2.0 * x[1] - 2.0).abs() < 1e-12 && (2.0 * x[0] + 3.0 * x[1] - 1.0).abs() < 1e-12
        );
        assert_eq!(x[2], 0.0);
        assert!((f.gain(&[2.0, 1.0, 4.0]) - (2.0 * x[0] + x[1])).abs() < 1e-12);
    }
}
