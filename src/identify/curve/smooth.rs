//! Smoothing of a table: the natural cubic spline that minimises `SUM w_i (y_i - g_i)^2 + alpha INT g''^2`.
//!
//! Source: Green and Silverman 1994, chapter 2 (Reinsch's algorithm); leverages after Hutchinson and de Hoog 1985.
//! Everything is banded: time and memory grow with the number of targets only.

/// One sequence of values to smooth.
pub(super) struct Sequence<'a> {
    pub(super) x: &'a [f64],
    pub(super) y: &'a [f64],
    pub(super) weight: &'a [f64],
}

/// Smoothed values and the diagonal of the hat matrix.
pub(super) struct Smoothed {
    pub(super) values: Vec<f64>,
    pub(super) leverage: Vec<f64>,
}

/// Smooths; with fewer than three values they stay as they are.
pub(super) fn smooth(s: &Sequence<'_>, alpha: f64) -> Smoothed {
    let n = s.x.len();
    if n < 3 || alpha <= 0.0 {
        return Smoothed { values: s.y.to_vec(), leverage: vec![1.0; n] };
    }
    let h: Vec<f64> = s.x.windows(2).map(|w| w[1] - w[0]).collect();
    let m = n - 2;
    // columns of Q: second differences
    let q = |j: usize| [1.0 / h[j], -1.0 / h[j] - 1.0 / h[j + 1], 1.0 / h[j + 1]];
    let mut band = vec![[0.0; 3]; m];
    for j in 0..m {
        for d in 0..3.min(m - j) {
            let mut sum = match d {
                0 => (h[j] + h[j + 1]) / 3.0,
                1 => h[j + 1] / 6.0,
                _ => 0.0,
            };
            let (a, b) = (q(j), q(j + d));
            for i in d..3 {
                sum += alpha * a[i] * b[i - d] / s.weight[j + i];
            }
            band[j][d] = sum;
        }
    }
    let right: Vec<f64> =
        (0..m).map(|j| q(j).iter().zip(&s.y[j..]).map(|(q, y)| q * y).sum::<f64>()).collect();
    let (diagonal, lower) = factor(&band);
    let gamma = solve(&diagonal, &lower, right);
    let inverse = central_inverse(&diagonal, &lower);
    let entry = |i: usize, j: usize| inverse[i.min(j)][i.abs_diff(j)];
    let mut values = s.y.to_vec();
    let mut leverage = vec![1.0; n];
    for i in 0..n {
        // the columns of Q that touch row i
        let columns = i.saturating_sub(2)..=i.min(m - 1);
        let (mut moved, mut square) = (0.0, 0.0);
        for j in columns.clone() {
            let a = q(j)[i - j];
            moved += a * gamma[j];
            for k in columns.clone() {
                square += a * q(k)[i - k] * entry(j, k);
            }
        }
        values[i] -= alpha / s.weight[i] * moved;
        leverage[i] -= alpha / s.weight[i] * square;
    }
    Smoothed { values, leverage }
}

/// `L D L^T` of a symmetric matrix with two off-diagonals, given as upper bands.
fn factor(band: &[[f64; 3]]) -> (Vec<f64>, Vec<[f64; 2]>) {
    let m = band.len();
    let mut d = vec![0.0; m];
    let mut l = vec![[0.0; 2]; m];
    for j in 0..m {
        let mut pivot = band[j][0];
        let mut next = band[j][1];
        if j >= 1 {
            pivot -= l[j - 1][0] * l[j - 1][0] * d[j - 1];
            next -= l[j - 1][1] * l[j - 1][0] * d[j - 1];
        }
        if j >= 2 {
            pivot -= l[j - 2][1] * l[j - 2][1] * d[j - 2];
        }
        d[j] = pivot;
        l[j] = [next / pivot, band[j][2] / pivot];
    }
    (d, l)
}

fn solve(d: &[f64], l: &[[f64; 2]], mut x: Vec<f64>) -> Vec<f64> {
    let m = d.len();
    for j in 0..m {
        if j >= 1 {
            x[j] -= l[j - 1][0] * x[j - 1];
        }
        if j >= 2 {
            x[j] -= l[j - 2][1] * x[j - 2];
        }
    }
    for j in (0..m).rev() {
        x[j] /= d[j];
        if j + 1 < m {
            x[j] -= l[j][0] * x[j + 1];
        }
        if j + 2 < m {
            x[j] -= l[j][1] * x[j + 2];
        }
    }
    x
}

/// The diagonal and two off-diagonals of the inverse.
fn central_inverse(d: &[f64], l: &[[f64; 2]]) -> Vec<[f64; 3]> {
    let m = d.len();
    let mut s = vec![[0.0; 3]; m];
    for j in (0..m).rev() {
        let a = if j + 1 < m { l[j][0] } else { 0.0 };
        let b = if j + 2 < m { l[j][1] } else { 0.0 };
        let (s1, s2) =
            (if j + 1 < m { s[j + 1] } else { [0.0; 3] }, if j + 2 < m { s[j + 2] } else { [0.0; 3] });
        let first = -a * s1[0] - b * s1[1];
        let second = -a * s1[1] - b * s2[0];
        s[j] = [1.0 / d[j] - a * first - b * second, first, second];
    }
    s
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    #[test]
    fn values_and_leverages_are_those_of_the_full_matrices() {
        let x = [0.0, 7.0, 10.0, 22.0, 30.0, 33.0, 50.0];
        let y = [1.0, -2.0, 0.5, 3.0, 2.0, 2.5, -1.0];
        let w = [1.0, 2.0, 5.0, 1.0, 3.0, 1.0, 2.0];
        let n = x.len();
        let h = |i: usize| x[i + 1] - x[i];
        let mut q = DMatrix::zeros(n, n - 2);
        let mut r = DMatrix::zeros(n - 2, n - 2);
        for j in 0..n - 2 {
            q[(j, j)] = 1.0 / h(j);
            q[(j + 1, j)] = -1.0 / h(j) - 1.0 / h(j + 1);
            q[(j + 2, j)] = 1.0 / h(j + 1);
            r[(j, j)] = (h(j) + h(j + 1)) / 3.0;
            if j > 0 {
                r[(j, j - 1)] = h(j) / 6.0;
                r[(j - 1, j)] = h(j) / 6.0;
            }
        }
        let weights: DMatrix<f64> = DMatrix::from_diagonal(&DVector::from_row_slice(&w));
        let k: DMatrix<f64> = &q * r.try_inverse().unwrap() * q.transpose();
        for alpha in [1e-3, 10.0, 1e4] {
            let hat: DMatrix<f64> = (&weights + &k * alpha).try_inverse().unwrap() * &weights;
            let direct = &hat * DVector::from_row_slice(&y);
            let got = smooth(&Sequence { x: &x, y: &y, weight: &w }, alpha);
            for i in 0..n {
                assert!((got.values[i] - direct[i]).abs() < 1e-10, "{alpha} {i}");
                assert!((got.leverage[i] - hat[(i, i)]).abs() < 1e-10, "{alpha} {i}");
            }
        }
    }

    #[test]
    fn much_smoothing_gives_the_straight_line() {
        let x: Vec<f64> = (0..20).map(f64::from).collect();
        let y: Vec<f64> = x.iter().map(|x| 2.0 + 0.5 * x).collect();
        let got = smooth(&Sequence { x: &x, y: &y, weight: &[1.0; 20] }, 1e6);
        assert!(got.values.iter().zip(&y).all(|(a, b)| (a - b).abs() < 1e-8));
        assert!((got.leverage.iter().sum::<f64>() - 2.0).abs() < 1e-3);
    }
}
