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
        // rows of columns that were left out are zero; four at a time for each time that the row is read and written
        let l = &self.l[i * self.n..];
        let none = vec![0.0; row.len()];
        for (some, l) in before.chunks(4 * row.len().max(1)).zip(l[..i].chunks(4)) {
            let before = |k: usize| some.get(k * none.len()..(k + 1) * none.len()).unwrap_or(&none);
            let l: [f64; 4] = core::array::from_fn(|k| l.get(k).copied().unwrap_or(0.0));
            let others = before(0).iter().zip(before(1)).zip(before(2).iter().zip(before(3)));
            for (r, ((a, b), (c, d))) in row.iter_mut().zip(others) {
                *r -= l[0] * a + l[1] * b + (l[2] * c + l[3] * d);
            }
        }
        let root = self.l[i * self.n + i];
        for r in row {
            *r /= root;
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
