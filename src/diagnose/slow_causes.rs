//! Slow causes with a logged source, such as a structure that follows the ambient temperature. Drift of an instrument explains what they
//! do as well, and its size is estimated before any cause is selected: so the two are compared, each cause with the drift left beside it.

use super::constants::{DEGENERATE, LARGE_DRIFT, TRIED};
use super::library::{Library, Shape};
use super::noise::{self, ClassNoise, Filter};
use super::search::{evidence, raw};
use super::session::Session;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// The result of a search under some noise.
pub(super) struct Before<'a> {
    pub(super) session: &'a Session,
    pub(super) library: &'a Library,
    /// Number of variants of each label.
    pub(super) grid: &'a [usize],
    /// Evidence that noise alone reaches.
    pub(super) threshold: f64,
    pub(super) used: &'a [bool],
    pub(super) lattice_um: &'a [f64],
    /// The gap, um.
    pub(super) gap: &'a [f64],
    /// The gap without the selected effects, um.
    pub(super) left: &'a [f64],
    /// Noise estimated from it.
    pub(super) noise: &'a [ClassNoise],
    /// Variants selected, with the contribution of each to every reading, um.
    pub(super) chosen: &'a [(usize, Vec<f64>)],
}

/// A slow cause, and the noise estimated beside it.
pub(super) struct Candidate {
    pub(super) label: usize,
    pub(super) noise: Vec<ClassNoise>,
}

/// A variant fitted beside offsets and white noise alone.
struct Fitted {
    variant: usize,
    /// Place of the selected effect that it replaces.
    instead: Option<usize>,
    evidence: f64,
    rank: usize,
    values: DVector<f64>,
}

impl Before<'_> {
    /// The slow causes, best first, that are likelier together with the drift left beside them than the drift alone; none where no
    /// instrument drifts much. A candidate is added, or replaces a selected slow cause, which beside drift was fitted to its fast part.
    pub(super) fn candidates(&self) -> impl Iterator<Item = Candidate> {
        let drifts = self.noise.iter().any(|c| c.drift_um > LARGE_DRIFT * c.white_um);
        let mut all = if drifts { self.fitted() } else { Vec::new() };
        all.sort_by(|a, b| b.evidence.total_cmp(&a.evidence).then(a.variant.cmp(&b.variant)));
        let mut labels: Vec<usize> = Vec::new();
        all.retain(|f| {
            let label = self.library.variants[f.variant].label;
            let is_first = !labels.contains(&label);
            labels.push(label);
            is_first
        });
        all.truncate(TRIED);
        all.into_iter().filter_map(|f| self.beside_drift(&f))
    }

    /// True where other noise and other residuals are likelier, less the price of further causes.
    pub(super) fn is_likelier(&self, noise: &[ClassNoise], left: &[f64], causes: usize) -> bool {
        let further = 1 + causes.saturating_sub(self.chosen.len() + 1);
        let gain = self.minus_two_log(self.noise, self.left) - self.minus_two_log(noise, left);
        gain > self.threshold * further as f64
    }

    fn minus_two_log(&self, noise: &[ClassNoise], left: &[f64]) -> f64 {
        let filter = Filter::new(self.session, noise, self.used);
        filter.minus_two_log(&filter.column(left))
    }

    /// All slow variants, each fitted beside the selected effects, and in the place of those that are slow.
    fn fitted(&self) -> Vec<Fitted> {
        let steady: Vec<ClassNoise> = self.noise.iter().map(|c| ClassNoise { drift_um: 0.0, ..*c }).collect();
        let steady = Filter::new(self.session, &steady, self.used);
        let label = |variant: usize| self.library.variants[variant].label;
        let slow =
            (0..self.chosen.len()).filter(|p| is_slow(&self.library.variants[self.chosen[*p].0].shape));
        let places: Vec<Option<usize>> = std::iter::once(None).chain(slow.map(Some)).collect();
        let bases: Vec<DVector<f64>> =
            places.iter().map(|place| DVector::from_vec(steady.column(&self.base(*place)))).collect();
        let of_variant = |(variant, shape): (usize, &Shape)| -> Vec<Fitted> {
            let k = shape.width();
            let mut data = raw(self.session, steady.order(), &[shape]);
            steady.apply(&mut data, k);
            let columns = DMatrix::from_vec(k, steady.order().len(), data);
            let products = (&columns * columns.transpose()).svd(true, true);
            let least = DEGENERATE * products.singular_values.max();
            let rank = products.rank(least);
            let fits = places.iter().zip(&bases).filter(|(place, _)| {
                let others = self.chosen.iter().enumerate().filter(|(p, _)| Some(*p) != **place);
                others.into_iter().all(|(_, (v, _))| label(*v) != label(variant))
            });
            fits.map(|(place, base)| {
                let b = &columns * base;
                let values = products.solve(&b, least).unwrap_or_else(|_| DVector::zeros(k));
                // in the place of another cause what that one explains is no gain
                let gain = bases[0].norm_squared() - base.norm_squared() + b.dot(&values);
                let evidence = evidence(gain, rank, self.grid[label(variant)]);
                Fitted { variant, instead: *place, evidence, rank, values }
            })
            .collect()
        };
        let variants = self.library.variants.par_iter().enumerate();
        let asked = variants.filter(|(_, v)| is_slow(&v.shape) && v.shape.width() > 0);
        asked.flat_map_iter(|(variant, v)| of_variant((variant, &v.shape))).collect()
    }

    /// The gap without the selected effects but one, um.
    fn base(&self, but: Option<usize>) -> Vec<f64> {
        but.map_or_else(
            || self.left.to_vec(),
            |place| self.left.iter().zip(&self.chosen[place].1).map(|(v, p)| v + p).collect(),
        )
    }

    /// The noise beside a fitted variant, where both are likelier than the noise alone.
    fn beside_drift(&self, f: &Fitted) -> Option<Candidate> {
        let rows: Vec<usize> = (0..self.left.len()).collect();
        let variant = &self.library.variants[f.variant];
        let columns = raw(self.session, &rows, &[&variant.shape]);
        let part = DMatrix::from_row_slice(rows.len(), f.values.len(), &columns) * &f.values;
        let minus = |values: &[f64]| values.iter().zip(&part).map(|(v, p)| v - p).collect::<Vec<f64>>();
        let left = minus(&self.base(f.instead));
        let repeats = noise::from_repeats(self.session, &minus(self.gap), self.used, self.lattice_um);
        let noise = noise::from_remainder(self.session, &left, self.used, &repeats);
        let gain = self.minus_two_log(self.noise, self.left) - self.minus_two_log(&noise, &left);
        let is_likelier = evidence(gain, f.rank, self.grid[variant.label]) > self.threshold;
        is_likelier.then_some(Candidate { label: variant.label, noise })
    }
}

/// True for effects that follow a logged temperature or the spindle.
fn is_slow(shape: &Shape) -> bool {
    shape.signals().iter().any(|s| s.source.is_logged())
}
