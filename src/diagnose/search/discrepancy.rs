//! Discrepancy: structure over the volume that no effect describes. A real machine has some, and small effects are named after it
//! where it is taken for noise that is independent from reading to reading.
//!
//! A displacement of the tool along each direction of the machine, a sum of products of Legendre polynomials of the linear axes with
//! normal coefficients of a common size. Sizes, and with each of them the effects that are left of those chosen, are compared as
//! models ([`super::size_comparison`]). Source: `docs/explanation/diagnosis.md` (discrepancy).

use super::super::library::Library;
use super::super::moment::Moment;
use super::super::noise::Filter;
use super::super::session::Session;
use super::low_rank::LowRank;
use super::problem::Problem;
use super::select::Selection;
use super::size_comparison::Sets;
use super::variation::{DEGREE, DEGREES, Left, powers, products, ways};

/// Sizes that are tried, in standard deviations of the white noise of the best instrument.
pub(super) const SCALES: [f64; 8] = [0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0];

/// Quantile of chi-square with one degree of freedom: twice the logarithm of the likelihood ratio at the ends of an interval of 95 %.
const CHI_SQUARE_95: f64 = 3.84;

/// The discrepancy that, with those of the effects chosen that it leaves (returned with it), says more than all of the effects chosen
/// without one; `None` where there is no such. `least_um` is the white noise of the best instrument.
#[must_use]
pub fn discrepancy(
    session: &Session,
    filter: &Filter,
    problem: &Problem,
    library: &Library,
    selection: &Selection,
    least_um: f64,
) -> Option<(LowRank, Vec<usize>)> {
    let ways = ways(session, problem);
    let mut powers = powers(ways.len());
    for degree in DEGREE + 1..=DEGREES.len() {
        let of_one = |k: usize| (0..ways.len()).map(|j| if j == k { degree } else { 0 }).collect::<Vec<_>>();
        powers.extend((0..ways.len()).map(of_one));
    }
    let sees = |m: &Moment| !m.is_angular() && !m.is_encoder;
    let along = |d: usize| -> Vec<f64> {
        session.moments.iter().map(|m| if sees(m) { m.u[d] } else { 0.0 }).collect()
    };
    let each: [Vec<f64>; 3] = core::array::from_fn(along);
    let parts: Vec<&[f64]> = each.iter().map(Vec::as_slice).collect();
    let columns = products(session, filter, problem, &parts, (&ways, &powers))?;
    // what goes with the position of one axis has a name: positioning, straightness
    let is_nameless = |k: &usize| powers[k % powers.len()].iter().filter(|d| **d > 0).count() > 1;
    let nameless: Vec<usize> = (0..columns.ncols()).filter(is_nameless).collect();
    if nameless.is_empty() {
        return None;
    }
    let left = Left::new(problem, &selection.chosen, &columns);
    let own = left.beside_rest(&nameless);
    let scales = SCALES.map(|s| s * least_um);
    let scales = possible(&possible(&scales, |s| left.gain(s)), |s| own.gain(s));
    let sets = Sets::new(problem, library, selection, &columns);
    let found = sets.most_likely(&scales)?;
    let kept = sets.kept(&found)?;
    Some((LowRank::of(&columns, &found.sizes), kept))
}

/// The sizes inside the interval of 95 % that the readings leave. `gain` is twice the logarithm of the likelihood that a size gains.
fn possible(scales: &[f64], gain: impl Fn(f64) -> f64) -> Vec<f64> {
    let all: Vec<(f64, f64)> = scales.iter().map(|s| (*s, gain(*s))).collect();
    let most = all.iter().map(|s| s.1).fold(0.0, f64::max);
    all.into_iter().filter(|s| s.1 > most - CHI_SQUARE_95).map(|s| s.0).collect()
}
