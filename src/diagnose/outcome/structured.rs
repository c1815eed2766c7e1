//! What of the gap is structure and no noise: roughness of curves, a discrepancy, the variation of effects.

use nalgebra::DVector;

use super::super::Analysis;
use super::super::constants::HALF;
use super::super::decision::Assessed;
use super::super::library::Shape;
use super::super::moment::Axis;
use super::super::search::Roughness;
use super::super::session::Session;
use super::{drift_rms, white_rms};

/// Whitened readings as they are before any structure joins the noise.
fn turned_back(a: &Analysis, mut rows: DVector<f64>) -> DVector<f64> {
    a.problem.structure().noises().rev().for_each(|noise| noise.turn(rows.as_mut_slice(), true));
    rows
}

/// The whitened gap beside some effects, without the structure that joined the noise.
fn beside(a: &Analysis, keep: &[usize]) -> DVector<f64> {
    let given = a.problem.given(keep);
    let beta = a.problem.fit(&given);
    turned_back(a, &a.problem.y - a.problem.contribution(&given.columns, &beta))
}

/// White noise of each row of the problem, um.
fn white_um(session: &Session, a: &Analysis) -> Vec<f64> {
    a.problem.rows.iter().map(|i| a.reading_um[session.readings[*i].instrument]).collect()
}

/// True for a displacement along a direction as a function of the position of an axis.
fn is_curve(shape: &Shape, (along, over): (Axis, Axis)) -> bool {
    shape.acts_along() == Some(along) && shape.over() == Some(over)
}

/// The roughness of curves that are all among some effects.
fn roughness<'a>(a: &'a Analysis, keep: &[usize]) -> Option<&'a Roughness> {
    let is_kept = |curve| keep.iter().any(|v| is_curve(&a.library.variants[*v].shape, curve));
    a.problem.structure().roughness.as_ref().filter(|r| r.curves().all(is_kept))
}

/// RMS of the roughness that is no noise beside what is declared, um: that of curves that are not, or where most of the gap stays;
/// `gap_um` is its RMS before and after their correction.
pub(super) fn unnamed_roughness_um(
    session: &Session,
    a: &Analysis,
    keep: &[usize],
    gap_um: [f64; 2],
) -> Option<f64> {
    let all = a.problem.structure().roughness.as_ref()?;
    let floor_um2 = white_rms(session, a).powi(2) + drift_rms(session, a).powi(2);
    let [before_um2, after_um2] = gap_um.map(|rms_um| (rms_um * rms_um - floor_um2).max(0.0));
    let is_named = roughness(a, keep).is_some() && after_um2 < HALF * before_um2;
    (!is_named).then(|| all.noise.rms(&beside(a, keep), &white_um(session, a)))
}

/// The whitened gap beside what is declared. A discrepancy is no noise, nor is the variation of an effect that is not declared, nor
/// roughness without a name (`has_rough`).
pub(super) fn left_whitened(a: &Analysis, keep: &[usize], has_rough: bool) -> Vec<f64> {
    let mut left = beside(a, keep);
    let is_declared = |label: usize| keep.iter().any(|v| a.library.variants[*v].label == label);
    let structure = a.problem.structure();
    let rough = structure.roughness.as_ref().filter(|_| !has_rough);
    let varies = structure.variation.as_ref().filter(|v| v.labels().all(is_declared));
    let stays = rough.map(|r| &r.noise).into_iter().chain(varies.map(|v| &v.noise));
    stays.for_each(|noise| noise.turn(left.as_mut_slice(), false));
    left.iter().copied().collect()
}

/// RMS of what is structured and has no name, um; `None` in a campaign in which nothing asks for it.
pub(super) fn discrepancy_um(session: &Session, a: &Analysis) -> Option<f64> {
    if let Some(c) = &a.comparison {
        return Some(c.shares.discrepancy_um2.sqrt());
    }
    let discrepancy = a.problem.structure().discrepancy.as_ref()?;
    Some(discrepancy.rms(&beside(a, &a.selection.chosen), &white_um(session, a)))
}

/// What is said of declared effects that are not the same everywhere.
pub(super) fn notes(a: &Analysis, assessed: &[Assessed]) -> Vec<String> {
    assessed.iter().filter(|x| x.is_declared()).filter_map(|x| varies(a, x)).collect()
}

/// What is said of declared curves whose roughness has their name.
pub(super) fn rough(session: &Session, a: &Analysis, keep: &[usize]) -> Option<String> {
    let roughness = roughness(a, keep)?;
    let rough_um = roughness.noise.rms(&beside(a, keep), &white_um(session, a));
    let is_rough = |v: &&usize| roughness.curves().any(|c| is_curve(&a.library.variants[**v].shape, c));
    let label = |v: &usize| a.library.labels[a.library.variants[*v].label].to_string();
    let curves: Vec<String> = keep.iter().filter(is_rough).map(label).collect();
    Some(format!(
        "roughness of {}: {rough_um:.2} µm RMS over all readings beyond the polynomial, which the addition leaves; a table at the \
         targets of a test along the axis (`volcomp fit`) takes it out",
        curves.join(", ")
    ))
}

fn varies(a: &Analysis, x: &Assessed) -> Option<String> {
    let varying = a.problem.variation()?.of(a.library.variants[x.variant].label)?;
    Some(format!(
        "{} varies by {:.0} % (RMS) over the volume: its addition is the same everywhere and leaves that much of it",
        x.label,
        100.0 * varying.rms
    ))
}
