//! Slow causes with a recorded source, such as a structure that follows the ambient temperature: drift of an instrument as slow as they
//! are explains them as well, and its size is found before any cause is. So both accounts are compared, each with the drift that it
//! leaves.

use super::constants::{DEGENERATE, LARGE_DRIFT};
use super::library::{Library, Variant};
use super::noise::{self, ClassNoise, Filter};
use super::search::{evidence, raw};
use super::session::Session;
use nalgebra::{DMatrix, DVector, DVectorView};
use rayon::prelude::*;

/// What is known before slow causes are asked for.
pub(super) struct Before<'a> {
    pub(super) session: &'a Session,
    pub(super) library: &'a Library,
    /// Number of variants of each label.
    pub(super) grid: &'a [usize],
    pub(super) used: &'a [bool],
    pub(super) lattice_um: &'a [f64],
    /// The gap, and what the causes found leave of it, um.
    pub(super) gap: &'a [f64],
    pub(super) left: &'a [f64],
    /// The noise that this says.
    pub(super) noise: &'a [ClassNoise],
}

impl Before<'_> {
    /// The noise beside the slow cause that leaves least, and its label, where drift is large and both together are likelier than drift by
    /// more than `threshold`. It may stand in the place of one of those `chosen`, with what each contributes: beside drift a cause has
    /// been fitted to what is faster than it.
    pub(super) fn quieter(
        &self,
        chosen: &[(usize, Vec<f64>)],
        threshold: f64,
    ) -> Option<(Vec<ClassNoise>, usize)> {
        if self.noise.iter().all(|c| c.drift_um <= LARGE_DRIFT * c.white_um) {
            return None;
        }
        let steady: Vec<ClassNoise> = self.noise.iter().map(|c| ClassNoise { drift_um: 0.0, ..*c }).collect();
        let steady = Filter::new(self.session, &steady, self.used);
        let signals =
            |label: usize, variant: &Variant| variant.label == label && !variant.shape.signals().is_empty();
        let is_slow =
            |(label, _): &&(usize, Vec<f64>)| self.library.variants.iter().any(|v| signals(*label, v));
        let instead = std::iter::once(None).chain(chosen.iter().filter(is_slow).map(Some));
        let least = instead.filter_map(|own| {
            let plus = |values: &[f64]| match own {
                Some((_, part)) => values.iter().zip(part).map(|(v, p)| v + p).collect(),
                None => values.to_vec(),
            };
            let is_free = |label: usize| {
                own.is_some_and(|(own, _)| *own == label) || chosen.iter().all(|(c, _)| *c != label)
            };
            let variants = self.library.variants.par_iter().enumerate();
            let asked = variants.filter(|(_, v)| signals(v.label, v) && is_free(v.label));
            let base = plus(self.left);
            let y = steady.column(&base);
            let all = asked.map(|(v, _)| (v, self.fitted(&steady, &y, v)));
            let (variant, (left, rank, part)) = all.min_by(|a, b| a.1.0.total_cmp(&b.1.0))?;
            let minus = |values: Vec<f64>| values.iter().zip(&part).map(|(v, p)| v - p).collect::<Vec<f64>>();
            Some((left, variant, rank, minus(base), minus(plus(self.gap))))
        });
        let (_, variant, rank, left, gap) = least.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let repeats = noise::from_repeats(self.session, &gap, self.used, self.lattice_um);
        let quiet = noise::from_remainder(self.session, &left, self.used, &repeats);
        let gain = self.minus_two_log(self.noise, self.left) - self.minus_two_log(&quiet, &left);
        let label = self.library.variants[variant].label;
        (evidence(gain, rank, self.grid[label]) > threshold).then_some((quiet, label))
    }

    /// True where other noise and what other causes leave are likelier by more than a threshold.
    pub(super) fn is_likelier(&self, noise: &[ClassNoise], left: &[f64], threshold: f64) -> bool {
        self.minus_two_log(noise, left) < self.minus_two_log(self.noise, self.left) - threshold
    }

    fn minus_two_log(&self, noise: &[ClassNoise], left: &[f64]) -> f64 {
        let filter = Filter::new(self.session, noise, self.used);
        filter.minus_two_log(&filter.column(left))
    }

    /// Sum of squares of `y` that a variant leaves beside offsets and white noise (`steady`), the number of its independent columns, and
    /// what it contributes to each reading, um.
    fn fitted(&self, steady: &Filter, y: &[f64], variant: usize) -> (f64, usize, Vec<f64>) {
        let rows: Vec<usize> = (0..self.left.len()).collect();
        let shape = &self.library.variants[variant].shape;
        let (k, own) = (shape.width(), raw(self.session, &rows, &[shape]));
        let mut data: Vec<f64> = steady.order().iter().flat_map(|i| own[i * k..][..k].to_vec()).collect();
        steady.apply(&mut data, k);
        let columns = DMatrix::from_vec(k, data.len() / k, data);
        let y = DVectorView::from_slice(y, y.len());
        let b = &columns * y;
        let products = (&columns * columns.transpose()).svd(true, true);
        let least = DEGENERATE * products.singular_values.max();
        let rank = products.rank(least);
        let values = products.solve(&b, least).unwrap_or_else(|_| DVector::zeros(k));
        let part = DMatrix::from_row_slice(self.left.len(), k, &own) * &values;
        (y.norm_squared() - b.dot(&values), rank, part.as_slice().to_vec())
    }
}
