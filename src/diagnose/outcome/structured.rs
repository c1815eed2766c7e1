//! What of the gap is structure and no noise: roughness of curves, a discrepancy, the variation of effects.

use nalgebra::DVector;

use super::super::Analysis;
use super::super::constants::HALF;
use super::super::decision::Assessed;
use super::super::search::LowRank;
use super::super::session::Session;
use super::{drift_rms, white_rms};

/// RMS of effects that failed a gate, or of roughness without a name, in units of the noise, from which they count as unexplained.
pub(super) const PROXY: f64 = 0.15;

/// The gap beside some effects, whitened by all noise.
fn beside(a: &Analysis, keep: &[usize]) -> DVector<f64> {
    let given = a.problem.given(keep);
    let beta = a.problem.fit(&given);
    &a.problem.y - a.problem.contribution(&given.columns, &beta)
}

/// RMS of the posterior mean of the structure at a place among the noises beside some effects, um.
fn posterior_um(session: &Session, a: &Analysis, keep: &[usize], place: usize) -> f64 {
    let mean = a.problem.structure().posterior_mean(place, &beside(a, keep));
    let white_um = a.problem.rows.iter().map(|i| a.reading_um[session.readings[*i].instrument]);
    let square: f64 = mean.iter().zip(white_um).map(|(mean, white_um)| (mean * white_um).powi(2)).sum();
    (square / mean.len().max(1) as f64).sqrt()
}

/// RMS of the roughness, um.
#[derive(Clone, Copy, Default)]
pub(super) struct Rough {
    /// That of declared curves.
    pub(super) named_um: Option<f64>,
    /// That of curves that are not declared, or where most of the gap stays: it is no noise.
    pub(super) unnamed_um: Option<f64>,
}

impl Rough {
    /// Beside what is declared; `gap_um` is the RMS of the gap before and after its correction.
    pub(super) fn beside(session: &Session, a: &Analysis, keep: &[usize], gap_um: [f64; 2]) -> Self {
        let Some(roughness) = &a.problem.structure().roughness else { return Self::default() };
        let shapes = || keep.iter().map(|v| &a.library.variants[*v].shape);
        let is_declared = roughness.curves.iter().all(|curve| shapes().any(|shape| curve.is(shape)));
        let white_um = white_rms(session, a);
        let floor_um2 = white_um.powi(2) + drift_rms(session, a).powi(2);
        let [before_um2, after_um2] = gap_um.map(|rms_um| (rms_um * rms_um - floor_um2).max(0.0));
        let is_named = is_declared && after_um2 <= HALF * before_um2;
        let rough_um = posterior_um(session, a, keep, 0);
        let is_unnamed = !is_named && rough_um > PROXY * white_um;
        Self {
            named_um: (is_declared && !is_unnamed).then_some(rough_um),
            unnamed_um: is_unnamed.then_some(rough_um),
        }
    }
}

/// The noise of structure that has the name of what is declared: roughness but where it `has_rough` without one, and the variation of
/// effects that are all declared. A discrepancy has none.
pub(super) fn named<'a>(a: &'a Analysis, keep: &[usize], has_rough: bool) -> Vec<&'a LowRank> {
    let is_declared = |label: usize| keep.iter().any(|v| a.library.variants[*v].label == label);
    let structure = a.problem.structure();
    let rough = structure.roughness.as_ref().filter(|_| !has_rough);
    let varies = structure.variation.as_ref().filter(|v| v.labels().all(is_declared));
    rough.map(|r| &r.noise).into_iter().chain(varies.map(|v| &v.noise)).collect()
}

/// The gap beside what is declared, whitened by the noise of structure that has its name (`named`) alone.
pub(super) fn left_whitened(a: &Analysis, keep: &[usize], named: &[&LowRank]) -> Vec<f64> {
    let mut left = beside(a, keep);
    a.problem.structure().noises().rev().for_each(|noise| noise.turn(left.as_mut_slice(), true));
    named.iter().for_each(|noise| noise.turn(left.as_mut_slice(), false));
    left.iter().copied().collect()
}

/// RMS of what is structured and has no name, um; `None` in a campaign in which nothing asks for it.
pub(super) fn discrepancy_um(session: &Session, a: &Analysis) -> Option<f64> {
    if let Some(c) = &a.comparison {
        return Some(c.shares.discrepancy_um2.sqrt());
    }
    let structure = a.problem.structure();
    let place = usize::from(structure.roughness.is_some());
    structure.discrepancy.as_ref().map(|_| posterior_um(session, a, &a.selection.chosen, place))
}

/// The names of the curves that are rough.
pub(super) fn rough_names(a: &Analysis) -> Option<String> {
    let curves = &a.problem.structure().roughness.as_ref()?.curves;
    Some(curves.iter().map(|c| a.library.labels[c.label].to_string()).collect::<Vec<_>>().join(", "))
}

/// What is said of declared effects that are not the same everywhere, and of curves whose roughness (`rough_um`) has their name;
/// `is_joined`: it is a part of them.
pub(super) fn notes(
    a: &Analysis,
    assessed: &[Assessed],
    rough_um: Option<f64>,
    is_joined: bool,
) -> Vec<String> {
    let mut all: Vec<String> =
        assessed.iter().filter(|x| x.is_declared()).filter_map(|x| varies(a, x)).collect();
    if let Some((curves, rough_um)) = rough_names(a).zip(rough_um) {
        let held = if is_joined {
            "the addition holds its posterior mean as a table"
        } else {
            "the addition leaves it"
        };
        all.push(format!(
            "roughness of {curves}: {rough_um:.2} µm RMS over all readings beyond the polynomial; {held}; a test at the targets of its \
             table (`volcomp fit`) knows it best"
        ));
    }
    all
}

fn varies(a: &Analysis, x: &Assessed) -> Option<String> {
    let varying = a.problem.variation()?.of(a.library.variants[x.variant].label)?;
    Some(format!(
        "{} varies by {:.0} % (RMS) over the volume: its addition is the same everywhere and leaves that much of it",
        x.label,
        100.0 * varying.rms
    ))
}
