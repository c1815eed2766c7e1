//! The misform of an effect: its products with smooth functions of everything else that changes. A cause is the same wherever the
//! other axes stand, however fast they move and however warm it is; what stands for something outside the library is not.
//!
//! Each product has a coefficient `c ~ N(0, s^2)` relative to the effect, beside all that was chosen; the posterior mean of `s`
//! says how far the effect is from its formula (random effects, as between programs). The quantity with which it differs most
//! counts. Of effects whose variation over the volume stands among the noise, that variation counts, too.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::super::Analysis;
use super::super::constants::{DEVIATION_EXPECTED, DEVIATIONS, LITTLE};
use super::super::forecast::Contributions;
use super::super::library::legendre;
use super::super::moment::{Axis, Moment};
use super::super::search::{Given, posterior_deviation};
use super::super::session::Session;

/// Highest degree of the polynomials of one quantity.
const DEGREE: usize = 2;

/// The deviation of each chosen effect from its formula, relative to itself.
pub(super) fn misforms(session: &Session, a: &Analysis, parts: &Contributions, owner: &[usize]) -> Vec<f64> {
    let given = a.problem.given(&a.selection.chosen);
    let beta = a.problem.fit(&given);
    let left = &a.problem.y - a.problem.contribution(&given.columns, &beta);
    let of = |(place, v): (usize, &usize)| {
        let variant = &a.library.variants[*v];
        let part =
            |i: &usize| (0..owner.len()).filter(|j| owner[*j] == place).map(|j| parts.in_sample[j][*i]).sum();
        let part: Vec<f64> = a.filter.order().iter().map(part).collect();
        // along its own axis a curve bends to anything anyhow
        let own = variant.shape.over().filter(|_| variant.shape.is_free_curve());
        let most = deviation(a, &given, &left, &products(session, a, &part, own));
        // what is no function of a position varies with it as every real effect does
        let varying = a.problem.variation().filter(|_| variant.shape.over().is_some_and(Axis::is_linear));
        let varying = varying.and_then(|v| v.of(variant.label));
        let varies = varying.map_or(0.0, |v| v.most(variant.shape.over()));
        most.max(varies).min(DEVIATIONS[DEVIATIONS.len() - 1])
    };
    a.selection.chosen.iter().enumerate().map(of).collect()
}

/// A quantity of the machine's state.
type Quantity<'a> = Box<dyn Fn(&Moment) -> f64 + 'a>;

/// What an effect is not said to depend on: positions but for that of one axis, speed, temperatures, time, tool.
fn quantities(session: &Session, but: Option<Axis>) -> Vec<Quantity<'_>> {
    let mut all: Vec<Quantity<'_>> = Vec::new();
    for axis in Axis::ALL.into_iter().filter(|axis| Some(*axis) != but) {
        all.push(Box::new(move |m| m.position[axis.slot()]));
    }
    all.push(Box::new(|m| m.velocity[..3].iter().map(|v| v * v).sum::<f64>().sqrt()));
    for (at, s) in session.signals.iter().enumerate() {
        // of each source the least lagged
        if session.signals.iter().all(|o| o.source != s.source || o.tau_s >= s.tau_s) {
            all.push(Box::new(move |m| m.signals[at]));
        }
    }
    all.push(Box::new(|m| m.t_s));
    all.push(Box::new(|m| m.tool_length_mm));
    all
}

/// Products of a contribution with polynomials of each quantity, [`DEGREE`] columns each.
fn products(session: &Session, a: &Analysis, part: &[f64], but: Option<Axis>) -> Vec<Vec<f64>> {
    let by = |quantity: Quantity<'_>| {
        let values: Vec<f64> = a.filter.order().iter().map(|i| quantity(&session.moments[*i])).collect();
        times_polynomials(part, &values)
    };
    quantities(session, but).into_iter().flat_map(by).collect()
}

/// Products of a contribution with polynomials of a quantity: orthogonal to it and to each other, as large as those with Legendre
/// polynomials over an even range, so that a coefficient says the same wherever in the range it acts. None of what is not known or does
/// not change where it acts.
fn times_polynomials(part: &[f64], values: &[f64]) -> Vec<Vec<f64>> {
    let least = LITTLE * part.iter().map(|p| p * p).sum::<f64>() / part.len().max(1) as f64;
    let acts = values.iter().zip(part).filter(|(_, p)| *p * *p > least);
    let [low, high] = acts.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], (v, _)| [l.min(*v), h.max(*v)]);
    let is_known = values.iter().all(|v| v.is_finite());
    if !is_known || high - low <= f64::EPSILON.sqrt() * (1.0 + high.abs()) {
        return Vec::new();
    }
    let powers = DMatrix::from_fn(part.len(), DEGREE + 1, |i, degree| {
        let mut l = [0.0; DEGREE + 1];
        legendre(((2.0 * values[i] - low - high) / (high - low)).clamp(-1.0, 1.0), &mut l);
        part[i] * l[degree]
    });
    let size = powers.column(0).norm();
    let (basis, r) = powers.qr().unpack();
    let of_degree = |degree: usize| {
        let even = size / (2.0 * degree as f64 + 1.0).sqrt();
        // two values of a quantity show no second degree
        let scale = if r[(degree, degree)].powi(2) > LITTLE * even * even { even } else { 0.0 };
        basis.column(degree).iter().map(|v| scale * v).collect()
    };
    (1..=DEGREE).map(of_degree).collect()
}

/// The largest posterior mean deviation by one quantity, beside what is given.
fn deviation(a: &Analysis, given: &Given, left: &DVector<f64>, columns: &[Vec<f64>]) -> f64 {
    let width = columns.len();
    let mut data = vec![0.0; left.len() * width];
    for (k, c) in columns.iter().enumerate() {
        data.iter_mut().skip(k).step_by(width).zip(c).for_each(|(d, v)| *d = *v);
    }
    a.problem.whiten(&a.filter, &mut data, width);
    let own = a.problem.beside(given, &DMatrix::from_row_slice(left.len(), width, &data));
    let (gram, seen) = (own.tr_mul(&own), own.tr_mul(left));
    // tails, and what nobody knows
    let noise = (left.norm_squared() / left.len().max(1) as f64).max(1.0);
    let by_one = |k: usize| {
        let eigen = SymmetricEigen::new(gram.view((k, k), (DEGREE, DEGREE)).into_owned());
        let along = eigen.eigenvectors.tr_mul(&seen.rows(k, DEGREE));
        posterior_deviation(eigen.eigenvalues.as_slice(), along.as_slice(), noise)
    };
    (0..width).step_by(DEGREE).map(by_one).fold(DEVIATION_EXPECTED, f64::max)
}

#[cfg(test)]
mod tests {
    use super::times_polynomials;

    fn dot(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| a * b).sum()
    }

    /// An effect that acts mostly at one end of a range.
    fn part() -> Vec<f64> {
        (0..100).map(|i| if i < 90 { 5.0 } else { 2.0 }).collect()
    }

    #[test]
    fn products_are_orthogonal_to_an_effect_and_of_its_size_wherever_it_acts() {
        let values: Vec<f64> =
            (0..100).map(|i| if i < 90 { 0.01 * f64::from(i) } else { f64::from(i) }).collect();
        let (part, products) = (part(), times_polynomials(&part(), &values));
        let size = dot(&part, &part);
        for (product, degree) in products.iter().zip([1.0, 2.0]) {
            assert!(dot(product, &part).abs() < 1e-9 * size);
            let share = dot(product, product) / size * (2.0 * degree + 1.0);
            assert!((share - 1.0).abs() < 1e-9 || share == 0.0, "{degree}: {share}");
        }
        assert!(dot(&products[0], &products[0]) > 0.0 && dot(&products[0], &products[1]).abs() < 1e-9 * size);
    }

    #[test]
    fn two_values_show_no_second_degree_and_one_or_none_nothing() {
        let two: Vec<f64> = (0..100).map(|i| f64::from(i % 2)).collect();
        let products = times_polynomials(&part(), &two);
        assert!(dot(&products[0], &products[0]) > 0.0 && dot(&products[1], &products[1]) == 0.0);
        assert!(times_polynomials(&part(), &[3.0; 100]).is_empty());
        assert!(times_polynomials(&part(), &[f64::NAN; 100]).is_empty());
    }
}
