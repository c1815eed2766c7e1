//! The effects as fitted: their columns, values and covariance in um per unit of parameter.

use super::super::Analysis;
use super::super::forecast::{Contributions, minus};
use super::super::offsets::without_offsets;
use super::super::report::Value;
use super::super::session::Session;

/// Chosen effects with their columns; `owner` is the place of the effect of each column in the selection.
pub(super) struct Fitted<'a> {
    /// Per column, per row of the session: um along `u` per unit of the parameter.
    pub(super) raw: &'a [Vec<f64>],
    /// What each column contributes.
    pub(super) parts: &'a Contributions,
    /// Effect of each column.
    pub(super) owner: &'a [usize],
    values: Vec<f64>,
    /// Row by row.
    covariance: Vec<f64>,
}

impl<'a> Fitted<'a> {
    /// From values and covariance in the whitened scale of the problem; `norm` is the length of each column there.
    pub(super) fn new(
        raw: &'a [Vec<f64>],
        parts: &'a Contributions,
        owner: &'a [usize],
        (beta, covariance): (&[f64], &[f64]),
        norm: &[f64],
    ) -> Self {
        let n = beta.len();
        let scale: Vec<f64> = norm.iter().map(|v| if *v > 0.0 { 1.0 / v } else { 0.0 }).collect();
        let scaled = (0..n * n).map(|k| covariance[k] * scale[k / n] * scale[k % n]).collect();
        let values = beta.iter().zip(&scale).map(|(b, s)| b * s).collect();
        Self { raw, parts, owner, values, covariance: scaled }
    }

    /// Columns of an effect.
    pub(super) fn columns_of(&self, place: usize) -> Vec<usize> {
        (0..self.owner.len()).filter(|j| self.owner[*j] == place).collect()
    }

    /// What an effect contributes to each reading, um along `u`.
    pub(super) fn effect(&self, place: usize) -> Vec<f64> {
        let rows = self.raw.first().map_or(0, Vec::len);
        let mut sum = vec![0.0; rows];
        for j in self.columns_of(place) {
            sum.iter_mut().zip(&self.parts.in_sample[j]).for_each(|(s, p)| *s += p);
        }
        sum
    }

    /// The gap without the effects that `take` names and without the offsets of the mountings, um; NaN where a reading is not
    /// used.
    pub(super) fn residual(&self, session: &Session, a: &Analysis, take: impl Fn(usize) -> bool) -> Vec<f64> {
        without_offsets(session, &minus(&a.gap, &self.parts.in_sample, |j| take(self.owner[j])), &a.used)
    }

    /// A linear form of the parameters of some columns.
    pub(super) fn value(&self, columns: &[usize], h: &[f64]) -> f64 {
        columns.iter().zip(h).map(|(j, h)| h * self.values[*j]).sum()
    }

    /// Its standard deviation.
    pub(super) fn std(&self, columns: &[usize], h: &[f64]) -> f64 {
        let n = self.values.len();
        let mut sum = 0.0;
        for (j, a) in columns.iter().zip(h) {
            for (k, b) in columns.iter().zip(h) {
                sum += a * b * self.covariance[j * n + k];
            }
        }
        sum.max(0.0).sqrt()
    }

    /// RMS of an effect over the readings used, without what the mountings absorb, um.
    pub(super) fn size_um(&self, session: &Session, a: &Analysis, place: usize) -> Value {
        let columns = self.columns_of(place);
        let seen: Vec<Vec<f64>> =
            columns.iter().map(|j| without_offsets(session, &self.raw[*j], &a.used)).collect();
        let at = |i: usize| columns.iter().zip(&seen).map(|(j, s)| s[i] * self.values[*j]).sum::<f64>();
        let rows: Vec<usize> = (0..a.gap.len()).filter(|i| a.used[*i]).collect();
        let n = rows.len().max(1) as f64;
        let fit: Vec<f64> = rows.iter().map(|i| at(*i)).collect();
        let value = (fit.iter().map(|v| v * v).sum::<f64>() / n).sqrt();
        // derivative of the RMS by each parameter
        let slope: Vec<f64> = seen
            .iter()
            .map(|s| rows.iter().zip(&fit).map(|(i, f)| f * s[*i]).sum::<f64>() / (n * value.max(1e-12)))
            .collect();
        Value { value, std: self.std(&columns, &slope) }
    }
}
