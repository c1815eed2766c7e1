//! Small symmetric systems whose columns may depend on each other: a Cholesky decomposition that leaves out what is
//! already spanned.

use super::super::constants::DEGENERATE;

/// A decomposition `G = L L'` of the independent columns.
#[derive(Debug, Clone, Default)]
pub(super) struct Factor {
    n: usize,
    /// Row by row; rows of columns that were left out are zero.
    l: Vec<f64>,
    kept: Vec<bool>,
}

impl Factor {
    /// Decomposes a symmetric matrix given row by row; a column is left out where less than a tiny share of `full` (its
    /// size before anything was taken off) is its own.
    pub(super) fn new(n: usize, g: &[f64], full: &[f64]) -> Self {
        let mut l = vec![0.0; n * n];
        let mut kept = vec![false; n];
        for j in 0..n {
            let mut d = g[j * n + j];
            for k in 0..j {
                d -= l[j * n + k] * l[j * n + k];
            }
            if !(d > DEGENERATE * full[j] && d > 0.0) {
                for k in 0..j {
                    l[j * n + k] = 0.0;
                }
                continue;
            }
            kept[j] = true;
            let root = d.sqrt();
            l[j * n + j] = root;
            for i in j + 1..n {
                let mut v = g[i * n + j];
                for k in 0..j {
                    v -= l[i * n + k] * l[j * n + k];
                }
                l[i * n + j] = v / root;
            }
        }
        Self { n, l, kept }
    }

    /// Number of independent columns.
    pub(super) fn rank(&self) -> usize {
        self.kept.iter().filter(|k| **k).count()
    }

    /// `L^-1 b`; zero where a column was left out.
    pub(super) fn forward(&self, b: &[f64]) -> Vec<f64> {
        let n = self.n;
        let mut x = vec![0.0; n];
        for i in 0..n {
            if self.kept[i] {
                let sum: f64 = (0..i).map(|k| self.l[i * n + k] * x[k]).sum();
                x[i] = (b[i] - sum) / self.l[i * n + i];
            }
        }
        x
    }

    /// Row `i` of `L^-1 G` from row `i` of `G` and the rows before; zero where the column was left out.
    pub(super) fn row_forward(&self, i: usize, g: &[f64], before: &[f64], row: &mut [f64]) {
        if !self.kept[i] {
            return;
        }
        row.copy_from_slice(g);
        // rows of columns that were left out are zero
        let factors: Vec<f64> = self.l[i * self.n..][..i].iter().map(|l| -l).collect();
        add_multiples(row, before, &factors);
        let root = self.l[i * self.n + i];
        for r in row {
            *r /= root;
        }
    }

    /// True for each independent column.
    pub(super) fn kept(&self) -> &[bool] {
        &self.kept
    }

    /// `L'^-1 A` in place, `A` row by row, zero where a column was left out.
    pub(super) fn backward_rows(&self, a: &mut [f64], width: usize) {
        for i in (0..self.n).rev().filter(|i| self.kept[*i]) {
            let (before, after) = a.split_at_mut((i + 1) * width);
            let row = &mut before[i * width..];
            let factors: Vec<f64> = (i + 1..self.n).map(|k| -self.l[k * self.n + i]).collect();
            add_multiples(row, after, &factors);
            let root = self.l[i * self.n + i];
            row.iter_mut().for_each(|v| *v /= root);
        }
    }

    /// `L'^-1 b`.
    fn backward(&self, b: &[f64]) -> Vec<f64> {
        let n = self.n;
        let mut x = vec![0.0; n];
        for i in (0..n).rev() {
            if self.kept[i] {
                let sum: f64 = (i + 1..n).filter(|k| self.kept[*k]).map(|k| self.l[k * n + i] * x[k]).sum();
                x[i] = (b[i] - sum) / self.l[i * n + i];
            }
        }
        x
    }

    /// `G^-1 b`.
    pub(super) fn solve(&self, b: &[f64]) -> Vec<f64> {
        self.backward(&self.forward(b))
    }

    /// Drop of the sum of squares by fitting.
    pub(super) fn gain(&self, b: &[f64]) -> f64 {
        self.forward(b).iter().map(|v| v * v).sum()
    }

    /// `G^-1`, row by row.
    pub(super) fn inverse(&self) -> Vec<f64> {
        let n = self.n;
        let mut out = vec![0.0; n * n];
        for j in 0..n {
            let mut e = vec![0.0; n];
            e[j] = 1.0;
            for (i, v) in self.solve(&e).into_iter().enumerate() {
                out[i * n + j] = if self.kept[j] { v } else { 0.0 };
            }
        }
        out
    }
}

/// Rows that are added for each time that a sum is read and written.
pub(super) const ROWS: usize = 4;

/// Adds multiples of rows, which lie one after the other.
pub(super) fn add_multiples(sum: &mut [f64], rows: &[f64], factors: &[f64]) {
    let width = sum.len();
    for (rows, factors) in rows.chunks(ROWS * width.max(1)).zip(factors.chunks(ROWS)) {
        if let [p, q, r, s] = *factors {
            let (first, second) = rows.split_at(2 * width);
            let ((a, b), (c, d)) = (first.split_at(width), second.split_at(width));
            for (sum, ((a, b), (c, d))) in sum.iter_mut().zip(a.iter().zip(b).zip(c.iter().zip(d))) {
                *sum += p * a + q * b + (r * c + s * d);
            }
        } else {
            for (row, factor) in rows.chunks(width.max(1)).zip(factors) {
                sum.iter_mut().zip(row).for_each(|(sum, v)| *sum += factor * v);
            }
        }
    }
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
