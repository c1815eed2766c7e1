//! Agreement of an effect between programs, places and runs: random effects in the place of vetoes.
//!
//! Parameters of an effect in one part of the readings: `b_part ~ N(b, s^2 D)`, `b ~ N(0, D)`, with `D` such that the common
//! effect and the deviations of its parts have the energy that was found, in all directions alike. "An effect" has a common
//! `b` and a small `s`; "a discrepancy in the form of this effect" has no common `b`. The ratio of their marginal likelihoods,
//! each averaged over its scales, says how far the data speak for the effect, and the posterior mean of `s` how far it varies.
//! Source: random-effects meta-analysis (DerSimonian, Laird 1986; Bayesian in Higgins, Thompson, Spiegelhalter 2009).

use nalgebra::{Cholesky, DMatrix, DVector, SymmetricEigen};

use super::gates::Part;

/// Scales of the deviation of a part, relative to the effect: of an effect, and of a discrepancy in its form.
const EFFECT: [f64; 4] = [0.0, 0.1, 0.2, 0.35];
const DISCREPANCY: [f64; 5] = [0.0, 0.35, 0.7, 1.0, 1.4];
/// Mean deviation before anything is known (exponential prior): what no second part tells counts by it.
const EXPECTED: f64 = 0.25;
/// Share of the largest eigenvalue below which a direction is not seen.
const SEEN: f64 = 1e-7;

/// What the parts say of an effect.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Agreement {
    /// Natural logarithm of the Bayes factor of an effect against a discrepancy in its form.
    pub log_bayes: f64,
    /// Posterior mean of the deviation between the upper parts, relative to the effect, over all scales with a common effect.
    pub between: f64,
}

impl Agreement {
    /// What two ways to divide the readings say together: the lesser agreement.
    pub(super) fn and(self, other: Self) -> Self {
        Self { log_bayes: self.log_bayes.min(other.log_bayes), between: self.between.max(other.between) }
    }
}

/// Precision and information of the parameters that one part leaves, with the logarithm of its likelihood at zero.
struct Message {
    precision: DMatrix<f64>,
    information: DVector<f64>,
    log_zero: f64,
}

/// Logarithms of the likelihood with and without a common effect, under one pair of scales.
struct Likelihood {
    upper: f64,
    lower: f64,
    with: f64,
    zero: f64,
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

/// Agreement between parts, each with the program that it belongs to.
#[must_use]
pub(super) fn agreement(parts: &[(usize, &Part)]) -> Option<Agreement> {
    let n = parts.first()?.1.b.len();
    let mut total = DMatrix::zeros(n, n);
    let mut information = DVector::zeros(n);
    for (_, p) in parts {
        total += DMatrix::from_row_slice(n, n, &p.g);
        information += DVector::from_column_slice(&p.b);
    }
    let eigen = SymmetricEigen::new(total);
    let most = eigen.eigenvalues.max();
    let kept: Vec<usize> = (0..n).filter(|k| eigen.eigenvalues[*k] > SEEN * most && most > 0.0).collect();
    if kept.is_empty() {
        return None;
    }
    let mut turn = eigen.eigenvectors.select_columns(&kept);
    for (mut c, k) in turn.column_iter_mut().zip(&kept) {
        c /= eigen.eigenvalues[*k].sqrt();
    }
    let rank = kept.len() as f64;
    // energy of the effect without what noise gives it
    let e2 = ((turn.tr_mul(&information)).norm_squared() / rank - 1.0).max(1.0);
    let seen: Vec<Seen> = parts
        .iter()
        .filter(|(_, p)| p.rows > 0)
        .map(|(upper, p)| {
            let g = turn.tr_mul(&(DMatrix::from_row_slice(n, n, &p.g) * &turn));
            Seen::new(*upper, g, &turn.tr_mul(&DVector::from_column_slice(&p.b)))
        })
        .collect();
    let uppers = seen.iter().map(|s| s.upper).max().map_or(0, |u| u + 1);
    let mut scales: Vec<f64> = EFFECT.iter().chain(&DISCREPANCY).copied().collect();
    scales.sort_by(f64::total_cmp);
    scales.dedup();
    // log likelihood with and without a common effect, by the scales of the upper parts and of the parts
    let mut table: Vec<Likelihood> = Vec::new();
    let m = kept.len();
    for lower in &scales {
        let mut sums: Vec<Option<(DMatrix<f64>, DVector<f64>)>> = vec![None; uppers];
        let mut zero = 0.0;
        for s in &seen {
            let message = s.message(lower * lower * e2);
            zero += message.log_zero;
            match &mut sums[s.upper] {
                Some((p, h)) => {
                    *p += message.precision;
                    *h += message.information;
                }
                none => *none = Some((message.precision, message.information)),
            }
        }
        let own: Vec<Seen> = sums
            .into_iter()
            .enumerate()
            .filter_map(|(upper, sum)| sum.map(|(p, h)| Seen::new(upper, p, &h)))
            .collect();
        for upper in &scales {
            let (mut p, mut h, mut zero) = (DMatrix::identity(m, m), DVector::zeros(m), zero);
            for u in &own {
                let message = u.message(upper * upper * e2);
                zero += message.log_zero;
                p += message.precision * e2;
                h += message.information;
            }
            let chol = Cholesky::new(p)?;
            let log_volume: f64 = chol.l_dirty().diagonal().iter().map(|d| d.ln()).sum();
            let with = zero - log_volume + 0.5 * e2 * h.dot(&chol.solve(&h));
            table.push(Likelihood { upper: *upper, lower: *lower, with, zero });
        }
    }
    let mean = |of: &[f64], value: fn(&Likelihood) -> f64| {
        let all: Vec<f64> =
            table.iter().filter(|t| of.contains(&t.upper) && of.contains(&t.lower)).map(value).collect();
        let most = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        most + (all.iter().map(|v| (v - most).exp()).sum::<f64>() / all.len() as f64).ln()
    };
    let log_bayes = mean(&EFFECT, |t| t.with) - mean(&DISCREPANCY, |t| t.zero);
    let most = table.iter().map(|t| t.with).fold(f64::NEG_INFINITY, f64::max);
    let (sum, weight) = table.iter().fold((0.0, 0.0), |(s, w), t| {
        let p = (t.with - most - (t.upper + t.lower) / EXPECTED).exp();
        (s + p * t.upper.max(t.lower), w + p)
    });
    Some(Agreement { log_bayes, between: sum / weight })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One parameter, `size` standard deviations in each part.
    fn of(sizes: &[f64]) -> Agreement {
        let parts: Vec<Part> = sizes
            .iter()
            .map(|s| {
                let mut p = Part::new(1);
                p.add(&[1.0], *s);
                p
            })
            .collect();
        let parts: Vec<(usize, &Part)> = parts.iter().enumerate().collect();
        agreement(&parts).expect("seen")
    }

    #[test]
    fn parts_that_agree_speak_for_an_effect_and_parts_that_do_not_against_it() {
        assert!(of(&[8.0, 8.5, 7.6, 8.2, 7.9, 8.1]).log_bayes > 4.0);
        assert!(of(&[8.0, -8.5, 7.6, -2.2, 0.1, 9.0]).log_bayes < -4.0);
        // one part alone tells neither
        assert!(of(&[8.0]).log_bayes.abs() < 1.5, "{}", of(&[8.0]).log_bayes);
        assert!(of(&[8.0, 8.5, 7.6, 8.2, 7.9, 8.1]).between < 0.2);
    }
}
