//! Linear regression with shrunk coefficients, from sums of products alone.
//!
//! Minimises `|y - b - X c|^2 / n + lambda SUM (sd_j c_j)^2`: every column counts in units of its own spread, the
//! constant is free. Rows are added up once, in as many sums as there are blocks; fits and forecasts over any blocks
//! follow from the sums without seeing a row again (Hoerl and Kennard, Technometrics 12 (1970) 55).

use nalgebra::{DMatrix, DVector};

/// A column whose spread is below this share of its size is constant.
const CONSTANT: f64 = 1e-9;

/// Sums of products of the columns `1, x_1 .. x_p, y`.
#[derive(Debug, Clone)]
pub(super) struct Sums {
    products: DMatrix<f64>,
}

/// Constant and coefficients.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Line {
    pub(super) constant: f64,
    pub(super) coefficients: Vec<f64>,
}

impl Sums {
    /// Nothing yet of `columns` columns.
    pub(super) fn new(columns: usize) -> Self {
        Self { products: DMatrix::zeros(columns + 2, columns + 2) }
    }

    /// Adds a row: the columns, then y.
    pub(super) fn add(&mut self, columns: &[f64], y: f64) {
        let size = self.products.nrows();
        let at = |k: usize| match k {
            0 => 1.0,
            k if k + 1 == size => y,
            k => columns[k - 1],
        };
        for j in 0..size {
            let weight = at(j);
            // only the lower half is kept up
            for i in j..size {
                self.products[(i, j)] += at(i) * weight;
            }
        }
    }

    /// Both together.
    pub(super) fn plus(&self, other: &Self) -> Self {
        Self { products: &self.products + &other.products }
    }

    /// Rows.
    pub(super) fn rows(&self) -> f64 {
        self.products[(0, 0)]
    }

    /// The shrunk regression; `None` without rows.
    pub(super) fn ridge(&self, lambda: f64) -> Option<Line> {
        let size = self.products.nrows();
        let n = self.rows();
        if n <= 0.0 {
            return None;
        }
        let mean: Vec<f64> = (0..size).map(|i| self.products[(i, 0)] / n).collect();
        let cov = |i: usize, j: usize| self.products[(i.max(j), i.min(j))] / n - mean[i] * mean[j];
        let spread = |i: usize| {
            let size = (self.products[(i, i)] / n).sqrt();
            Some(cov(i, i).max(0.0).sqrt()).filter(|sd| *sd > CONSTANT * size)
        };
        let kept: Vec<(usize, f64)> = (1..size - 1).filter_map(|i| Some((i, spread(i)?))).collect();
        let mut coefficients = vec![0.0; size - 2];
        if !kept.is_empty() {
            let p = kept.len();
            let mut matrix =
                DMatrix::from_fn(p, p, |a, b| cov(kept[a].0, kept[b].0) / (kept[a].1 * kept[b].1));
            (0..p).for_each(|a| matrix[(a, a)] += lambda);
            let right = DVector::from_fn(p, |a, _| cov(kept[a].0, size - 1) / kept[a].1);
            let solved = matrix.cholesky()?.solve(&right);
            for ((i, sd), c) in kept.iter().zip(solved.iter()) {
                coefficients[i - 1] = c / sd;
            }
        }
        let slope: f64 = coefficients.iter().zip(&mean[1..]).map(|(c, m)| c * m).sum();
        Some(Line { constant: mean[size - 1] - slope, coefficients })
    }

    /// Sum of the squares that a line leaves in these rows.
    pub(super) fn left(&self, line: &Line) -> f64 {
        let size = self.products.nrows();
        let weights = DVector::from_fn(size, |i, _| match i {
            0 => -line.constant,
            i if i + 1 == size => 1.0,
            i => -line.coefficients[i - 1],
        });
        // only the lower half is filled
        let full = DMatrix::from_fn(size, size, |i, j| self.products[(i.max(j), i.min(j))]);
        (weights.transpose() * full * &weights)[0].max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sums(rows: &[([f64; 2], f64)]) -> Sums {
        let mut sums = Sums::new(2);
        rows.iter().for_each(|(x, y)| sums.add(x, *y));
        sums
    }

    #[test]
    fn without_shrinking_a_plane_is_found_exactly() {
        let rows: Vec<_> = (0..50)
            .map(|k| {
                let x = [f64::from(k % 7), f64::from(k % 5)];
                (x, 3.0 + 2.0 * x[0] - 0.5 * x[1])
            })
            .collect();
        let all = sums(&rows[..20]).plus(&sums(&rows[20..]));
        let line = all.ridge(0.0).unwrap();
        assert!((line.constant - 3.0).abs() < 1e-12);
        assert!((line.coefficients[0] - 2.0).abs() < 1e-12 && (line.coefficients[1] + 0.5).abs() < 1e-12);
        assert!(all.left(&line) < 1e-9 * all.rows());
    }

    #[test]
    fn what_is_left_is_the_sum_of_squares_over_the_rows() {
        let rows: Vec<_> =
            (0..40).map(|k| ([f64::from(k), f64::from(k * k % 11)], f64::from(k % 3))).collect();
        let all = sums(&rows);
        let line = all.ridge(0.3).unwrap();
        let direct: f64 = rows
            .iter()
            .map(|(x, y)| {
                (y - line.constant - line.coefficients[0] * x[0] - line.coefficients[1] * x[1]).powi(2)
            })
            .sum();
        assert!((all.left(&line) - direct).abs() < 1e-9 * direct);
    }

    #[test]
    fn twins_share_and_constants_say_nothing() {
        let rows: Vec<_> = (0..30).map(|k| ([f64::from(k), f64::from(k)], f64::from(k))).collect();
        let line = sums(&rows).ridge(1e-3).unwrap();
        assert!((line.coefficients[0] - line.coefficients[1]).abs() < 1e-12);
        let rows: Vec<_> = (0..30).map(|k| ([f64::from(k), 21.5], f64::from(k))).collect();
        let line = sums(&rows).ridge(0.0).unwrap();
        assert!(line.coefficients[1] == 0.0 && (line.coefficients[0] - 1.0).abs() < 1e-12);
        assert!(Sums::new(2).ridge(0.1).is_none());
    }
}
