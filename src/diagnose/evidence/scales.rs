//! Scales of drift and discrepancy: marginal likelihood over a ladder, component by component.

use std::collections::BTreeMap;

use nalgebra::{Cholesky, DMatrix, DVector};

use super::constants::{PRESENT, SCALES, SWEEPS};
use super::covariance::Structure;

/// Place of the scale of each component in [`SCALES`].
pub(super) type Rungs = Vec<usize>;

/// The scales, in standard deviations of the white noise.
pub(super) fn values(rungs: &[usize]) -> Vec<f64> {
    rungs.iter().map(|r| SCALES[*r]).collect()
}

/// Log prior of some scales.
pub(super) fn log_prior(rungs: &[usize]) -> f64 {
    PRESENT * rungs.iter().filter(|r| **r > 0).count() as f64
}

/// The gap and the columns of a set, scaled to unit prior variance, whose evidence the scales change.
pub(super) struct Target<'a> {
    pub(super) structure: &'a Structure,
    pub(super) weights: &'a [f64],
    /// The gap, then the columns of the set.
    pub(super) data: DMatrix<f64>,
}

impl Target<'_> {
    /// Log evidence of the set under some scales.
    fn log_evidence(&self, rungs: &[usize]) -> f64 {
        let mut c = DMatrix::from_diagonal(&DVector::from_column_slice(self.weights));
        for ((_, m), s) in self.structure.components.iter().zip(values(rungs)).filter(|(_, s)| *s > 0.0) {
            c.zip_apply(m, |a, b| *a += s * s * b);
        }
        // the prior of the effects is a part of the covariance
        let columns = self.data.columns(1, self.data.ncols() - 1);
        c.gemm(1.0, &columns, &columns.transpose(), 1.0);
        let Some(chol) = Cholesky::new(c) else { return f64::NEG_INFINITY };
        let l = chol.l_dirty();
        let n = l.nrows();
        let width = self.structure.offsets.ncols() + 1;
        let mut both = DMatrix::zeros(n, width);
        both.columns_mut(0, width - 1).copy_from(&self.structure.offsets);
        both.column_mut(width - 1).copy_from(&self.data.column(0));
        if !l.solve_lower_triangular_mut(&mut both) {
            return f64::NEG_INFINITY;
        }
        let mut log = 2.0 * l.diagonal().iter().map(|d| d.ln()).sum::<f64>();
        let mut basis: Vec<DVector<f64>> = Vec::new();
        for k in 0..width {
            let mut v = both.column(k).into_owned();
            let before = v.norm();
            for _ in 0..2 {
                for b in &basis {
                    let p = b.dot(&v);
                    v.axpy(-p, b, 1.0);
                }
            }
            let own = v.norm();
            if k + 1 == width {
                let freedom = (n - basis.len()) as f64;
                return -0.5 * log - freedom * own.max(f64::MIN_POSITIVE).ln();
            }
            if own > 1e-6 * before && own > 0.0 {
                log += 2.0 * own.ln();
                basis.push(v / own);
            }
        }
        f64::NEG_INFINITY
    }

    /// The likeliest scales from a start on, one component after the other.
    pub(super) fn ascend(&self, start: &[usize]) -> Rungs {
        let mut known: BTreeMap<Rungs, f64> = BTreeMap::new();
        let mut value = |rungs: &Rungs| -> f64 {
            if let Some(v) = known.get(rungs) {
                return *v;
            }
            let v = self.log_evidence(rungs) + log_prior(rungs);
            known.insert(rungs.clone(), v);
            v
        };
        let mut best = start.to_vec();
        let mut most = value(&best);
        for _ in 0..SWEEPS {
            let before = best.clone();
            for c in 0..best.len() {
                let now = best[c];
                let mut tried = vec![0, now.saturating_sub(1), (now + 1).min(SCALES.len() - 1)];
                if now == 0 {
                    tried.extend([3, 5]);
                }
                for rung in tried {
                    let mut next = best.clone();
                    next[c] = rung;
                    let v = value(&next);
                    if v > most + 1e-9 {
                        (best, most) = (next, v);
                    }
                }
            }
            if best == before {
                break;
            }
        }
        best
    }
}
