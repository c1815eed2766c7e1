//! The product of an effect with the position of another axis: a cause is the same wherever the other axes stand, a part of
//! something that acts through two axes at once grows along the other one. The same with temperatures: a function of a position
//! is the same when it is warm, an expansion is not.

use nalgebra::{DMatrix, DVector};

use super::super::Analysis;
use super::super::assess::Assessed;
use super::super::forecast::Contributions;
use super::super::library::{Shape, forms};
use super::super::moment::{Axis, Signal, Source};
use super::super::session::Session;

/// Standard deviations that are taken off before an effect is said to grow.
const SURE: f64 = 2.0;
/// Least range of a temperature that says anything, K.
const WARMER_K: f64 = 2.0;
/// Share of the mean square of an effect from which it acts at a reading.
pub(super) const ACTS_SHARE: f64 = 0.05;
/// Added to the products of columns, as a share of their size.
const RIDGE: f64 = 1e-9;

/// Finds how much each effect grows along the other linear axes; `owner` is the effect of each column.
pub(super) fn weigh(
    session: &Session,
    a: &Analysis,
    parts: &Contributions,
    owner: &[usize],
    assessed: &mut [Assessed],
) {
    let fit = Fit::new(a);
    for (place, x) in assessed.iter_mut().enumerate() {
        let shape = &a.library.variants[x.variant].shape;
        let over = shape.over();
        let part: Vec<f64> = (0..session.readings.len())
            .map(|i| (0..owner.len()).filter(|j| owner[*j] == place).map(|j| parts.in_sample[j][i]).sum())
            .collect();
        if let Shape::Thermal(forms::Thermal { axis, .. }) = shape {
            let scale = Shape::Scale(forms::Scale { axis: *axis });
            let own = owner.iter().position(|o| *o == place);
            let column = a.problem.whitened(session, &a.filter, &scale).swap_remove(0);
            if let Some(own) = own {
                x.reject_staying(fit.stays(own, &DVector::from_vec(column)));
            }
        } else if over.is_some() && shape.signals().is_empty() {
            x.reject_warming(fit.warmth(session, a, &part));
        }
        let varying = a.problem.variation().and_then(|v| v.of(a.library.variants[x.variant].label));
        let most = match (varying, a.problem.variation()) {
            (Some(v), _) => {
                let others = v.grows.iter().filter(|(axis, _)| Some(*axis) != over);
                others.copied().max_by(|a, b| a.1.total_cmp(&b.1))
            }
            // beside something much larger that varies nobody can tell
            (None, Some(_)) => None,
            (None, None) => fit.most(session, a, &part, over),
        };
        x.gates.grows = most.map_or(0.0, |m| m.1);
        let most = most.filter(|m| m.1 > 0.0).map(|m| m.0);
        // what is no function of a position has a gate of its own for that
        if let (Some(along), true) = (most, over.is_some_and(Axis::is_linear)) {
            x.reject_growing(&along.to_string());
        }
        x.settle();
    }
}

/// The columns chosen, ready for one more.
struct Fit {
    columns: DMatrix<f64>,
    factor: Option<nalgebra::Cholesky<f64, nalgebra::Dyn>>,
    /// What was found of each column.
    values: DVector<f64>,
    left: DVector<f64>,
    /// Variance of what is left, at least that of the noise.
    variance: f64,
}

impl Fit {
    fn new(a: &Analysis) -> Self {
        let given = a.problem.given(&a.selection.chosen);
        let beta = a.problem.fit(&given);
        let left = &a.problem.y - a.problem.contribution(&given.columns, &beta);
        let columns: Vec<DVector<f64>> =
            given.columns.iter().map(|c| a.problem.contribution(&[*c], &[1.0])).collect();
        let columns =
            if columns.is_empty() { DMatrix::zeros(left.len(), 0) } else { DMatrix::from_columns(&columns) };
        let gram = columns.tr_mul(&columns);
        let ridge = DMatrix::from_diagonal(&gram.diagonal().map(|d| RIDGE * d + 1e-12));
        let variance = (left.norm_squared() / left.len().max(1) as f64).max(1.0);
        Self { columns, factor: (gram + ridge).cholesky(), values: DVector::from_vec(beta), left, variance }
    }

    /// The axis along which an effect that contributes `part` grows most, and by how much.
    fn most(&self, session: &Session, a: &Analysis, part: &[f64], over: Option<Axis>) -> Option<(Axis, f64)> {
        let growth = |axis: Axis| {
            let (middle, half) = a.problem.way(session, axis)?;
            let along = |i: &usize| part[*i] * (session.moments[*i].position[axis.slot()] - middle) / half;
            Some((axis, self.share(&whitened(a, a.filter.order().iter().map(along).collect()))))
        };
        let axes = Axis::ALL.into_iter().filter(|axis| axis.is_linear() && Some(*axis) != over);
        axes.filter_map(growth).max_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// By how much an effect that contributes `part` grows from the middle of the temperatures to their ends, of that sensor with
    /// which it grows most.
    fn warmth(&self, session: &Session, a: &Analysis, part: &[f64]) -> f64 {
        let plain = session.signals.iter().enumerate().filter(|(_, s)| {
            matches!(s.source, Source::Temperature(_))
                && session.signals.iter().all(|o| o.source != s.source || o.tau_s >= s.tau_s)
        });
        // a test that took minutes says nothing of what a day's warmth would do
        let mean_square = part.iter().map(|p| p * p).sum::<f64>() / part.len().max(1) as f64;
        let acts = |i: &&usize| part[**i] * part[**i] > ACTS_SHARE * mean_square;
        let growth = |(at, _): (usize, &Signal)| {
            let degc = |i: &usize| session.moments[*i].signals[at];
            let seen = a.filter.order().iter().filter(acts).map(degc);
            let [low, high] = seen.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], t| [l.min(t), h.max(t)]);
            if !(high - low).is_finite() || high - low < WARMER_K {
                return 0.0;
            }
            let along = |i: &usize| part[*i] * (2.0 * degc(i) - low - high) / (high - low);
            let product: Vec<f64> = a.filter.order().iter().map(along).collect();
            if product.iter().all(|v| v.is_finite()) { self.share(&whitened(a, product)) } else { 0.0 }
        };
        plain.map(growth).fold(0.0, f64::max)
    }

    /// The value of one more column, drawn towards zero by what it is not sure of.
    fn share(&self, column: &DVector<f64>) -> f64 {
        let Some(more) = self.more(column) else { return 0.0 };
        (more.value.abs() - SURE * (self.variance / more.size).sqrt()).max(0.0)
    }

    /// The share of a column that one more column says in its place, at most 1, less what it is not sure of.
    fn stays(&self, own: usize, column: &DVector<f64>) -> f64 {
        let (Some(factor), Some(more)) = (&self.factor, self.more(column)) else { return 0.0 };
        let unit = DVector::from_fn(self.values.len(), |i, _| f64::from(u8::from(i == own)));
        let (moved, size) = (more.known[own], self.values[own].abs());
        let variance = self.variance * (factor.solve(&unit)[own] + moved * moved / more.size);
        let now = self.values[own] - moved * more.value;
        (1.0 - (now * self.values[own].signum() + SURE * variance.sqrt()) / size.max(1e-300)).clamp(0.0, 1.0)
    }

    /// One more column fitted beside all; nothing where they say it already.
    fn more(&self, column: &DVector<f64>) -> Option<More> {
        let known = self.factor.as_ref()?.solve(&self.columns.tr_mul(column));
        let own = column - &self.columns * &known;
        let size = own.norm_squared();
        let is_new = size >= 1e-6 * column.norm_squared() && size > 0.0;
        is_new.then(|| More { value: own.dot(&self.left) / size, known, size })
    }
}

/// One more column beside those chosen.
struct More {
    value: f64,
    /// What of each column it takes per unit.
    known: DVector<f64>,
    /// Energy of what is new in it.
    size: f64,
}

/// A column whitened as those of the problem are: for drift and for what varies.
fn whitened(a: &Analysis, mut column: Vec<f64>) -> DVector<f64> {
    a.filter.apply(&mut column, 1);
    let mut column = DVector::from_vec(column);
    if let Some(variation) = a.problem.variation() {
        variation.apply(&mut column);
    }
    column
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One effect, the same in all of 200 readings, that grows by `growth` from the middle of a way to its end.
    fn growth(growth: f64) -> f64 {
        let n = 200;
        let way = |i: usize| 2.0 * i as f64 / (n - 1) as f64 - 1.0;
        let effect = DVector::from_fn(n, |i, _| 5.0 * (0.7 * i as f64).sin());
        let product = DVector::from_fn(n, |i, _| effect[i] * way(i));
        let noise = DVector::from_fn(n, |i, _| 1.4 * (2.9 * (i * i) as f64).sin());
        let y = &effect + &product * growth + noise;
        let known = effect.dot(&y) / effect.norm_squared();
        let columns = DMatrix::from_columns(std::slice::from_ref(&effect));
        let factor = columns.tr_mul(&columns).cholesky();
        let values = DVector::from_element(1, known);
        Fit { columns, factor, values, left: y - effect * known, variance: 1.0 }.share(&product)
    }

    #[test]
    fn growth_is_what_two_standard_deviations_leave_of_it() {
        assert_eq!(growth(0.0), 0.0);
        assert!((0.35..0.5).contains(&growth(0.5)), "{}", growth(0.5));
        assert!((0.85..1.0).contains(&growth(-1.0)), "{}", growth(-1.0));
    }

    /// What stays of an expansion about 20 degC whether it is warm or cold: readings along an axis on a day on which it gets
    /// warmer by `range` from 21 degC on, of what `truth` says at a position (-1 to 1) and a temperature.
    fn staying(range: f64, truth: impl Fn(f64, f64) -> f64) -> f64 {
        let n = 400;
        let degc = |i: usize| 21.0 + range * i as f64 / n as f64;
        let x = |i: usize| (0.7 * i as f64).sin();
        let expansion = DVector::from_fn(n, |i, _| x(i) * (degc(i) - 20.0));
        let scale = DVector::from_fn(n, |i, _| x(i));
        let y = DVector::from_fn(n, |i, _| truth(x(i), degc(i)) + 1.4 * (2.9 * (i * i) as f64).sin());
        let known = expansion.dot(&y) / expansion.norm_squared();
        let columns = DMatrix::from_columns(std::slice::from_ref(&expansion));
        let factor = columns.tr_mul(&columns).cholesky();
        let values = DVector::from_element(1, known);
        Fit { columns, factor, values, left: y - expansion * known, variance: 1.0 }.stays(0, &scale)
    }

    #[test]
    fn an_expansion_comes_and_goes_and_a_scale_stays() {
        let expands = staying(4.0, |x, t| 3.0 * x * (t - 20.0));
        assert!(expands < 0.05, "{expands}");
        // about another temperature, or more than in proportion: it does come and go
        assert!(staying(4.0, |x, t| 3.0 * x * (t - 22.0)) < 0.05);
        assert!(staying(4.0, |x, t| x * (t - 20.0).powi(2)) < 0.05);
        let stays = staying(4.0, |x, _| 9.0 * x);
        assert!(stays > 0.8, "{stays}");
        assert!(staying(4.0, |x, _| -9.0 * x) > 0.8, "of either sign");
        // some hundredths of a kelvin cannot tell
        assert_eq!(staying(0.02, |x, _| 9.0 * x), 0.0);
    }
}
