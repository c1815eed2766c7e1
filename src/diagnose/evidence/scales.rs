//! Scales of drift and discrepancy: marginal likelihood over a ladder, component by component.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{DMatrix, DVector};
use rayon::iter::{IntoParallelIterator, ParallelIterator};

use super::super::constants::{MOST, NOISE_SCALES, TRIED};
use super::super::dense::{cholesky, inverse_lower, product, solve_lower};
use super::covariance::{Basis, Component, Structure};

/// Place of the scale of each component in [`NOISE_SCALES`].
pub(super) type Rungs = Vec<usize>;

/// The scales, in standard deviations of the white noise.
pub(super) fn values(rungs: &[usize]) -> Vec<f64> {
    rungs.iter().map(|r| NOISE_SCALES[*r]).collect()
}

/// Log prior of some scales, against all zero: half-Cauchy about the white noise (Gelman 2006), over the intervals of the ladder.
pub(super) fn log_prior(rungs: &[usize]) -> f64 {
    let up_to = |rung: usize| {
        let top = match NOISE_SCALES.get(rung + 1) {
            Some(next) if rung > 0 => (NOISE_SCALES[rung] * next).sqrt(),
            Some(next) => next * 0.5f64.sqrt(),
            None => f64::INFINITY,
        };
        top.atan()
    };
    let mass = |rung: usize| if rung > 0 { up_to(rung) - up_to(rung - 1) } else { up_to(0) };
    rungs.iter().map(|r| (mass(*r) / mass(0)).ln()).sum()
}

/// The gap and the columns of a set, scaled to unit prior variance, whose evidence the scales change.
pub(super) struct Target<'a> {
    pub(super) structure: &'a Structure,
    pub(super) weights: &'a [f64],
    /// The gap, then the columns of the set.
    pub(super) data: DMatrix<f64>,
}

/// The covariance of a target, decomposed.
struct Decomposed {
    l: DMatrix<f64>,
    /// Orthonormal basis of the whitened offsets.
    basis: Vec<DVector<f64>>,
    /// The gap, whitened, without the offsets.
    left: DVector<f64>,
    log_determinant: f64,
}

impl Decomposed {
    fn freedom(&self) -> f64 {
        (self.l.nrows() - self.basis.len()) as f64
    }

    fn log_evidence(&self) -> f64 {
        -0.5 * self.log_determinant - self.freedom() * self.left.norm().max(f64::MIN_POSITIVE).ln()
    }
}

impl Target<'_> {
    fn decompose(&self, rungs: &[usize]) -> Option<Decomposed> {
        let mut c = self.structure.sum(&values(rungs), self.weights);
        // the prior of the effects is a part of the covariance
        let columns = self.data.columns(1, self.data.ncols() - 1);
        c.gemm(1.0, &columns, &columns.transpose(), 1.0);
        let l = cholesky(c)?;
        let width = self.structure.offsets.ncols();
        let mut both = DMatrix::zeros(l.nrows(), width + 1);
        both.columns_mut(0, width).copy_from(&self.structure.offsets);
        both.column_mut(width).copy_from(&self.data.column(0));
        solve_lower(&l, &mut both);
        let mut log_determinant = 2.0 * l.diagonal().iter().map(|d| d.ln()).sum::<f64>();
        let mut basis = Basis::default();
        both.columns(0, width).column_iter().for_each(|column| basis.add(column.into_owned()));
        let left = basis.beside(both.column(width).into_owned());
        log_determinant += basis.log_determinant;
        Some(Decomposed { l, basis: basis.vectors, left, log_determinant })
    }

    fn log_posterior(&self, rungs: &[usize]) -> f64 {
        self.decompose(rungs).map_or(f64::NEG_INFINITY, |d| d.log_evidence()) + log_prior(rungs)
    }

    /// Derivative of the log evidence by the variance of each component, over the curvature that noise alone gives it.
    fn slopes(&self, rungs: &[usize]) -> Option<Vec<f64>> {
        let d = self.decompose(rungs)?;
        let mut half = inverse_lower(&d.l);
        if !d.basis.is_empty() {
            let basis = DMatrix::from_columns(&d.basis);
            let known = product(&basis, &half);
            half.gemm(-1.0, &basis, &known, 1.0);
        }
        let precision = product(&half, &half);
        let pulled = half.tr_mul(&d.left);
        let scale = d.freedom() / d.left.norm_squared().max(f64::MIN_POSITIVE);
        let slope = |m: &DMatrix<f64>| {
            let trace = precision.dot(m);
            (scale * pulled.dot(&(m * &pulled)) - trace) / trace.max(f64::MIN_POSITIVE)
        };
        Some(self.structure.components.iter().map(|(_, m)| slope(m)).collect())
    }

    /// The likeliest scales from a start on, one component at a time.
    pub(super) fn ascend(&self, start: &[usize]) -> Rungs {
        self.ascend_among(start, &|_| true)
    }

    /// The same with only some components beside those of the start.
    pub(super) fn ascend_among(&self, start: &[usize], may_enter: &dyn Fn(Component) -> bool) -> Rungs {
        let enters = |c: &usize| may_enter(self.structure.components[*c].0);
        let mut best = start.to_vec();
        let mut most = self.log_posterior(&best);
        let mut known = BTreeMap::from([(best.clone(), most)]);
        for _ in 0..MOST {
            let Some(slopes) = self.slopes(&best) else { break };
            let mut steep: Vec<usize> =
                (0..best.len()).filter(|c| best[*c] == 0 && slopes[*c] > 0.0 && enters(c)).collect();
            steep.sort_by(|a, b| slopes[*b].total_cmp(&slopes[*a]));
            steep.truncate(TRIED);
            let mut tried: Vec<Rungs> = Vec::new();
            for (c, now) in best.iter().copied().enumerate() {
                let top = self.structure.top(c);
                let places = match now {
                    0 if steep.contains(&c) => [1, 3, 5],
                    0 => continue,
                    _ => [0, now - 1, now + 1],
                };
                for rung in places {
                    let mut next = best.clone();
                    next[c] = rung.min(top);
                    tried.push(next);
                }
            }
            let fresh: BTreeSet<&Rungs> = tried.iter().filter(|rungs| !known.contains_key(*rungs)).collect();
            let values: Vec<(Rungs, f64)> =
                fresh.into_par_iter().map(|rungs| (rungs.clone(), self.log_posterior(rungs))).collect();
            known.extend(values);
            let before = most;
            for next in tried {
                let value = known[&next];
                if value > most + 1e-9 {
                    (best, most) = (next, value);
                }
            }
            if most <= before {
                break;
            }
        }
        best
    }
}
