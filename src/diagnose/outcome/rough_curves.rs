//! What declared curves are beyond their polynomials or tables: the posterior mean of their waves joins them as further columns, so that picture,
//! forecast and addition hold the whole curve.
//!
//! `c ~ N(0, S^2)`, readings whitened by all noise, that of the waves among it: `c = S^2 W'(y - X b)` with covariance `S^2 - S^2 W'W S^2` at
//! known parameters `b` of the effects. Readings of a fold are predicted by the waves of the others, from readings whitened by the filter
//! alone: `(W'W + S^-2) c = W'(y - X b)` over their rows. What else has structure is not told apart there.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::super::Analysis;
use super::super::constants::SEES;
use super::super::decision::Assessed;
use super::super::dense::product;
use super::super::forecast::{Contributions, folds, held_out, minus};
use super::super::library::{Shape, Variant, WIDTH_MAX, forms};
use super::super::moment::Moment;
use super::super::offsets::{rms, without_offsets};
use super::super::search::{Given, Rough, Roughness, WAVES, fold_of};
use super::super::session::Session;

/// Points of a table in the shortest of the waves.
const PER_WAVE: usize = 8;

/// The columns of the effects chosen, in their order, and behind them the waves of rough curves.
pub(super) struct Columns {
    /// Per column, per row of the session: um along `u` per unit of the parameter.
    pub(super) raw: Vec<Vec<f64>>,
    /// What each contributes.
    pub(super) parts: Contributions,
    /// Place of the effect of each in the selection.
    pub(super) owner: Vec<usize>,
    /// Values in the scale of the problem.
    pub(super) beta: Vec<f64>,
    /// Their covariance, row by row.
    pub(super) covariance: Vec<f64>,
    /// The length of each column in that scale.
    pub(super) norm: Vec<f64>,
    /// Curves with their roughness, by their places in the selection.
    pub(super) rough: Vec<(usize, RoughCurve)>,
    /// Mean square of the roughness that their waves leave: its posterior variance, um^2.
    pub(super) left_um2: f64,
}

/// A curve with its roughness.
pub(super) struct RoughCurve {
    pub(super) shape: forms::RoughCurve,
    pub(super) roughness_um: f64,
}

impl Columns {
    /// The gap of readings held out, um, without the effects that `take` names by their places and without offsets.
    pub(super) fn left(&self, session: &Session, a: &Analysis, take: impl Fn(usize) -> bool) -> Vec<f64> {
        without_offsets(session, &minus(&a.gap, &self.parts.held_out, |j| take(self.owner[j])), &a.used)
    }

    /// Adds the waves of the rough curves where all of these are declared; else they stay noise.
    pub(super) fn join_roughness(
        &mut self,
        (session, a, given): (&Session, &Analysis, &Given),
        assessed: &[Assessed],
    ) {
        let Some(roughness) = &a.problem.structure().roughness else { return };
        // a difference to the state at the zero of the ball is no function of one position
        if session.ball_zero.is_some() {
            return;
        }
        let variant = |place: usize| &a.library.variants[assessed[place].variant];
        let place_of = |rough: &Rough| {
            let is_it = |p: &usize| {
                let Variant { label, shape } = variant(*p);
                let fits = *label == rough.label && rough.is(shape) && shape.width() < WIDTH_MAX;
                assessed[*p].is_declared() && fits
            };
            (0..assessed.len()).find(is_it)
        };
        let Some(places) = roughness.curves.iter().map(place_of).collect::<Option<Vec<usize>>>() else {
            return;
        };
        let fit = Posterior::new(a, given, roughness, (&self.beta, &self.parts.folds));
        self.covariance = fit.joint_covariance(&self.covariance);
        let fold = folds(session, &a.problem);
        for (k, (rough, place)) in roughness.curves.iter().zip(places).enumerate() {
            let waves_at = |m: &Moment| {
                rough.seen_by(m).map(|along| rough.waves_at(m.position[rough.over.slot()]) * along)
            };
            let seen: Vec<Option<DVector<f64>>> = session.moments.iter().map(waves_at).collect();
            let own = fit.own.view((k * WAVES, k * WAVES), (WAVES, WAVES));
            self.left_um2 += mean_variance(&seen, &own.into_owned(), &a.used);
            for (h, wave) in (k * WAVES..(k + 1) * WAVES).enumerate() {
                let raw: Vec<f64> = seen.iter().map(|s| s.as_ref().map_or(0.0, |s| s[h])).collect();
                self.parts.in_sample.push(raw.iter().map(|v| v * fit.mean[wave]).collect());
                self.parts.held_out.push(held_out(session, &a.used, &raw, |i| fit.folds[fold[i]][wave]));
                self.raw.push(raw);
                self.owner.push(place);
                self.beta.push(fit.mean[wave]);
                self.norm.push(1.0);
            }
            let coefficients = fit.mean.rows(k * WAVES, WAVES).into_owned();
            self.rough.push((place, RoughCurve::new(session, &variant(place).shape, rough, &coefficients)));
        }
    }
}

/// Posterior of the coefficients of all waves.
struct Posterior {
    mean: DVector<f64>,
    /// The mean without the readings of each fold.
    folds: Vec<DVector<f64>>,
    /// Covariance at known parameters of the effects.
    own: DMatrix<f64>,
    /// How the mean follows these parameters, with the sign turned.
    follows: DMatrix<f64>,
}

impl Posterior {
    fn new(
        a: &Analysis,
        given: &Given,
        roughness: &Roughness,
        (beta, fold_fits): (&[f64], &[DVector<f64>]),
    ) -> Self {
        let problem = &a.problem;
        let variance = DVector::from_iterator(roughness.sizes.len(), roughness.sizes.iter().map(|s| s * s));
        let prior = DMatrix::from_diagonal(&variance);
        let turned = problem.turned(&roughness.waves);
        let columns = problem.whitened_rows(&given.columns);
        let left = &problem.y - columns.tr_mul(&DVector::from_column_slice(beta));
        let weighted = product(&turned, &turned);
        Self {
            mean: variance.component_mul(&turned.tr_mul(&left)),
            folds: without_folds(a, given, roughness, fold_fits),
            own: &prior - &prior * weighted * &prior,
            follows: &prior * turned.tr_mul(&columns.transpose()),
        }
    }

    /// Covariance of the parameters of the effects (given, row by row) and the coefficients behind them, row by row.
    fn joint_covariance(&self, of_effects: &[f64]) -> Vec<f64> {
        let (waves, n) = self.follows.shape();
        let effects = DMatrix::from_row_slice(n, n, of_effects);
        let across = -&self.follows * &effects;
        let mut all = DMatrix::zeros(n + waves, n + waves);
        all.view_mut((n, n), (waves, waves)).copy_from(&(&self.own - &across * self.follows.transpose()));
        all.view_mut((n, 0), (waves, n)).copy_from(&across);
        all.view_mut((0, n), (n, waves)).copy_from(&across.transpose());
        all.view_mut((0, 0), (n, n)).copy_from(&effects);
        // symmetric: by column is by row
        all.as_slice().to_vec()
    }
}

/// The posterior mean of the coefficients without the readings of each fold.
fn without_folds(
    a: &Analysis,
    given: &Given,
    roughness: &Roughness,
    fold_fits: &[DVector<f64>],
) -> Vec<DVector<f64>> {
    let problem = &a.problem;
    let (columns, gap) = problem.filtered(&given.columns);
    let waves = &*roughness.waves;
    let precision = DVector::from_iterator(waves.ncols(), roughness.sizes.iter().map(|s| 1.0 / (s * s)));
    let of_fold = |fit: &DVector<f64>, fold: usize| {
        let kept = (0..problem.len()).filter(|i| fold_of(problem.block[*i], problem.blocks) != fold);
        let kept: Vec<usize> = kept.collect();
        let left = (gap - columns.tr_mul(fit)).select_rows(&kept);
        let waves = waves.select_rows(&kept);
        let mut normal = product(&waves, &waves);
        normal.set_diagonal(&(normal.diagonal() + &precision));
        let factor = Cholesky::new(normal);
        factor.map_or_else(|| DVector::zeros(waves.ncols()), |factor| factor.solve(&waves.tr_mul(&left)))
    };
    fold_fits.iter().enumerate().map(|(fold, fit)| of_fold(fit, fold)).collect()
}

/// Mean over the readings used of the variance of what waves with coefficients of this covariance add, um^2.
fn mean_variance(waves: &[Option<DVector<f64>>], covariance: &DMatrix<f64>, used: &[bool]) -> f64 {
    let rows = used.iter().filter(|u| **u).count().max(1) as f64;
    let seen = waves.iter().zip(used).filter(|(_, used)| **used).filter_map(|(waves, _)| waves.as_ref());
    seen.map(|waves| waves.dot(&(covariance * waves)).max(0.0)).sum::<f64>() / rows
}

impl RoughCurve {
    /// A table of what the waves with these coefficients add to a curve, over the positions at which readings look along it.
    fn new(session: &Session, curve: &Shape, rough: &Rough, coefficients: &DVector<f64>) -> Self {
        let looks = |m: &&Moment| rough.seen_by(m).is_some_and(|along| along.abs() > SEES);
        let at = session.moments.iter().filter(looks).map(|m| m.position[rough.over.slot()]);
        let [from, to] = at.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], x| [l.min(x), h.max(x)]);
        let points = PER_WAVE * WAVES / 2;
        let step_mm = (to - from) / points as f64;
        let positions_mm: Vec<f64> = (0..=points).map(|k| from + step_mm * k as f64).collect();
        let values = positions_mm.iter().map(|at| rough.waves_at(*at).dot(coefficients));
        let mut beyond_um: Vec<f64> = values.collect();
        let roughness_um = rms(&beyond_um);
        if roughness_um > 0.0 {
            beyond_um.iter_mut().for_each(|v| *v /= roughness_um);
        }
        Self {
            shape: forms::RoughCurve { curve: Box::new(curve.clone()), positions_mm, beyond_um },
            roughness_um,
        }
    }
}
