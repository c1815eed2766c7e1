//! Agreement of an effect between programs, places and runs: random effects in the place of vetoes.
//!
//! Parameters of an effect in one part of the readings: `b_part ~ N(b, s^2 D)`, `b ~ N(0, D)`, with `D` such that the common
//! effect and the deviations of its parts have the energy that was found, in all directions alike. The posterior mean of `s`
//! says how far the effect varies. Source: random-effects meta-analysis (DerSimonian, Laird 1986; Bayesian in Higgins,
//! Thompson, Spiegelhalter 2009).

use nalgebra::{Cholesky, DMatrix, DVector, SymmetricEigen};

use super::super::constants::{DEGENERATE, DEVIATION_EXPECTED, DEVIATIONS};
use super::figures::Part;

/// Precision and information of the parameters that one part leaves, with the logarithm of its likelihood at zero.
struct Message {
    precision: DMatrix<f64>,
    information: DVector<f64>,
    log_zero: f64,
}

/// A part in the coordinates in which all parts together have the precision 1.
struct Seen {
    upper: usize,
    vectors: DMatrix<f64>,
    values: DVector<f64>,
    /// Its information along its own directions.
    along: DVector<f64>,
}

impl Seen {
    fn new(upper: usize, precision: DMatrix<f64>, information: &DVector<f64>) -> Self {
        let own = SymmetricEigen::new(precision);
        let along = own.eigenvectors.tr_mul(information);
        Self { upper, along, vectors: own.eigenvectors, values: own.eigenvalues }
    }

    /// What it says of the mean of its parameters when they deviate by the variance `v`.
    fn message(&self, v: f64) -> Message {
        let (values, along) = (self.values.map(|g| g.max(0.0)), &self.along);
        let damped = values.map(|g| 1.0 / (1.0 + v * g));
        let mut scaled = self.vectors.clone();
        for ((mut c, g), d) in scaled.column_iter_mut().zip(values.iter()).zip(damped.iter()) {
            c *= g * d;
        }
        let log_zero = |(g, a): (&f64, &f64)| {
            let d = 1.0 + v * g;
            0.5 * (v * a * a / d - d.ln())
        };
        Message {
            precision: scaled * self.vectors.transpose(),
            information: &self.vectors * along.component_mul(&damped),
            log_zero: values.iter().zip(along.iter()).map(log_zero).sum(),
        }
    }
}

/// Variance of what parts leave beside fits of their own, as a multiple of the noise, at least 1: no model of a drive is exact to
/// the resolution of its encoder, which is all the noise that its readings have.
pub(super) fn lack_of_fit(parts: &[(usize, &Part)]) -> f64 {
    let (left, free) = parts.iter().fold((0.0, 0.0), |(left, free), (_, p)| {
        let f = p.factor();
        (left + p.yy - f.gain(&p.b), free + p.rows as f64 - f.rank() as f64)
    });
    if free > 0.0 { (left / free).max(1.0) } else { 1.0 }
}

/// Posterior mean of the deviation of an effect between programs and between the parts within them (the larger counts),
/// relative to the effect; of parts, each with the program that it belongs to, under `lack` times the noise. None where no part
/// shows the effect.
pub(super) fn between(parts: &[(usize, &Part)], lack: f64) -> Option<f64> {
    let n = parts.first()?.1.b.len();
    let seen_by =
        |p: &Part| (DMatrix::from_row_slice(n, n, &p.g) / lack, DVector::from_column_slice(&p.b) / lack);
    let (mut total, mut information) = (DMatrix::zeros(n, n), DVector::zeros(n));
    for (g, b) in parts.iter().map(|(_, p)| seen_by(p)) {
        total += g;
        information += b;
    }
    let eigen = SymmetricEigen::new(total);
    let most = eigen.eigenvalues.max();
    let kept: Vec<usize> =
        (0..n).filter(|k| eigen.eigenvalues[*k] > DEGENERATE * most && most > 0.0).collect();
    if kept.is_empty() {
        return None;
    }
    let mut turn = eigen.eigenvectors.select_columns(&kept);
    for (mut c, k) in turn.column_iter_mut().zip(&kept) {
        c /= eigen.eigenvalues[*k].sqrt();
    }
    // energy of the effect without what noise gives it
    let e2 = (turn.tr_mul(&information).norm_squared() / kept.len() as f64 - 1.0).max(1.0);
    let seen: Vec<Seen> = parts
        .iter()
        .filter(|(_, p)| p.rows > 0)
        .map(|(upper, p)| {
            let (g, b) = seen_by(p);
            Seen::new(*upper, turn.tr_mul(&(g * &turn)), &turn.tr_mul(&b))
        })
        .collect();
    let uppers = seen.iter().map(|s| s.upper).max().map_or(0, |u| u + 1);
    let m = kept.len();
    // log posterior of each pair of scales, and the larger of them
    let mut table: Vec<(f64, f64)> = Vec::new();
    for lower in DEVIATIONS {
        let mut sums: Vec<Option<(DMatrix<f64>, DVector<f64>)>> = vec![None; uppers];
        let mut zero = 0.0;
        for s in &seen {
            let message = s.message(lower * lower * e2);
            zero += message.log_zero;
            let (p, h) = sums[s.upper].get_or_insert_with(|| (DMatrix::zeros(m, m), DVector::zeros(m)));
            *p += message.precision;
            *h += message.information;
        }
        let own: Vec<Seen> = sums
            .into_iter()
            .enumerate()
            .filter_map(|(upper, sum)| sum.map(|(p, h)| Seen::new(upper, p, &h)))
            .collect();
        for upper in DEVIATIONS {
            let (mut p, mut h, mut zero) = (DMatrix::identity(m, m), DVector::zeros(m), zero);
            for u in &own {
                let message = u.message(upper * upper * e2);
                zero += message.log_zero;
                p += message.precision * e2;
                h += message.information;
            }
            let chol = Cholesky::new(p)?;
            let log_volume: f64 = chol.l_dirty().diagonal().iter().map(|d| d.ln()).sum();
            let likelihood = zero - log_volume + 0.5 * e2 * h.dot(&chol.solve(&h));
            table.push((likelihood - (upper + lower) / DEVIATION_EXPECTED, upper.max(lower)));
        }
    }
    Some(posterior_mean(&table))
}

/// Posterior mean of the standard deviation of coefficients `c ~ N(0, s^2)` seen along the directions of a Gram matrix with these
/// eigenvalues (`along`: the products with what is left), under noise of the variance `noise`.
pub fn posterior_deviation(eigenvalues: &[f64], along: &[f64], noise: f64) -> f64 {
    let log_of = |s: f64| -> f64 {
        let v = s * s / noise;
        let of = |(l, a): (&f64, &f64)| {
            let d = 1.0 + v * l.max(0.0);
            0.5 * (a * a * v / d / noise - d.ln())
        };
        eigenvalues.iter().zip(along).map(of).sum::<f64>() - s / DEVIATION_EXPECTED
    };
    let table: Vec<(f64, f64)> = DEVIATIONS.iter().map(|s| (log_of(*s), *s)).collect();
    posterior_mean(&table)
}

/// Mean of the second numbers weighted by the exponentials of the first.
fn posterior_mean(table: &[(f64, f64)]) -> f64 {
    let most = table.iter().map(|t| t.0).fold(f64::NEG_INFINITY, f64::max);
    let (sum, weight) = table.iter().fold((0.0, 0.0), |(sum, weight), (log, scale)| {
        let p = (log - most).exp();
        (sum + p * scale, weight + p)
    });
    sum / weight
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Readings of a column of ones.
    fn part(readings: &[f64]) -> Part {
        let (rows, sum) = (readings.len(), readings.iter().sum());
        Part { g: vec![rows as f64], b: vec![sum], yy: readings.iter().map(|y| y * y).sum(), rows }
    }

    /// One parameter, `size` standard deviations in each part.
    fn of(sizes: &[f64]) -> f64 {
        let parts: Vec<Part> = sizes.iter().map(|s| part(&[*s])).collect();
        let parts: Vec<(usize, &Part)> = parts.iter().enumerate().collect();
        between(&parts, 1.0).expect("seen")
    }

    #[test]
    fn an_effect_that_differs_between_parts_deviates() {
        assert!(of(&[8.0, 8.5, 7.6, 8.2, 7.9, 8.1]) < 0.15);
        assert!(of(&[8.0, -8.5, 7.6, -2.2, 0.1, 9.0]) > 0.9);
        // one part alone says little more than the prior
        assert!((0.1..0.3).contains(&of(&[8.0])), "{}", of(&[8.0]));
    }

    #[test]
    fn a_lack_of_fit_within_the_parts_leaves_their_difference_unsure() {
        let part = |mean: f64, scatter: f64| part(&[mean + scatter, mean - scatter].repeat(20));
        let of = |scatter: f64| {
            let parts = [part(4.0, scatter), part(8.0, scatter), part(1.0, scatter)];
            let parts = parts.each_ref().map(|p| (0, p));
            between(&parts, lack_of_fit(&parts)).expect("seen")
        };
        assert!(of(1.0) > of(20.0) + 0.2, "{} {}", of(1.0), of(20.0));
    }
}
