//! The length error of a ballbar in a campaign. A constant of the set-up says nothing of the machine, and beside a large one the evidence of
//! every other effect counts for little: it is taken off the readings for the search, and put back as the effect that it is.

use std::collections::BTreeMap;

use super::constants::{HALF, LITTLE, ROUNDS, SIGNIFICANT};
use super::decision::Assessed;
use super::library::{Label, Library, Shape};
use super::moment::Moment;
use super::noise::ClassNoise;
use super::search::{Problem, Selection};
use super::session::{Reading, Session};
use super::{Analysis, contributions_um};

/// A length of the ballbar that was put back.
pub(super) struct BarLength {
    /// What it adds to each reading, um.
    pub(super) part_um: Vec<f64>,
    /// Sum of squares that the effects found beside it explain.
    pub(super) explained_beside: f64,
}

/// Lengths taken off so far.
#[derive(Default)]
pub(super) struct BarLengths {
    /// um, by set-up.
    taken_um: BTreeMap<usize, f64>,
    /// How often.
    times: usize,
}

/// The set-ups with a length of their own (none where one serves all) of a variant that is the length of a ballbar.
fn setups_of(library: &Library, variant: usize) -> Option<&[usize]> {
    match &library.variants[variant].shape {
        Shape::BallbarLength(length) => Some(&length.setups),
        _ => None,
    }
}

impl BarLengths {
    /// Takes the length off the readings where it is an effect found that stands out, a few times at most; false elsewhere.
    pub(super) fn take_off(
        &mut self,
        session: &mut Session,
        library: &Library,
        searched: (&Problem, &Selection),
        noise: &[ClassNoise],
    ) -> bool {
        if self.times == ROUNDS {
            return false;
        }
        let Some(found) = standing_out_um(session, library, searched, noise) else { return false };
        self.times += 1;
        for (r, m) in session.readings.iter_mut().zip(&session.moments).filter(|(_, m)| m.is_ballbar) {
            r.deviation_um -= found.get(&m.setup).copied().unwrap_or_default();
        }
        found
            .into_iter()
            .for_each(|(setup, length_um)| *self.taken_um.entry(setup).or_default() += length_um);
        true
    }

    /// Puts all of it back into the readings and, as an effect found, into the gap: what was found beside it stands.
    pub(super) fn put_back(&self, session: &mut Session, analysis: &mut Analysis) {
        let Some((_, first_um)) = self.taken_um.first_key_value() else { return };
        let of = |setup: &usize| self.taken_um.get(setup).copied().unwrap_or_default();
        let part = |m: &Moment| if m.is_ballbar { of(&m.setup) } else { 0.0 };
        let part_um: Vec<f64> = session.moments.iter().map(part).collect();
        session.readings.iter_mut().zip(&part_um).for_each(|(r, part_um)| r.deviation_um += part_um);
        // sets that were compared hold no effect that was not
        let Analysis { library, problem, selection, comparison: None, .. } = analysis else { return };
        let is_own = |v: &usize| setups_of(library, *v).is_some_and(|setups| !setups.is_empty());
        let each_has_its_own =
            self.taken_um.values().any(|um| um != first_um) || selection.chosen.iter().any(is_own);
        let mut all = (0..library.variants.len()).filter(|v| setups_of(library, *v).is_some());
        let Some(variant) = all.find(|v| is_own(v) == each_has_its_own) else { return };
        let amounts_um: Vec<f64> = match setups_of(library, variant).unwrap_or_default() {
            [] => vec![*first_um],
            setups => setups.iter().map(of).collect(),
        };
        selection.chosen.retain(|v| setups_of(library, *v).is_none());
        let explained_beside = problem.given(&selection.chosen).explained;
        selection.chosen.push(variant);
        problem.add_to_gap(variant, &amounts_um);
        problem.prepare(&selection.chosen);
        analysis.bar_length = Some(BarLength { part_um, explained_beside });
        analysis.gap = session.gap();
    }
}

/// The length error by set-up, um, where it is among the effects found and larger than noise and drift.
fn standing_out_um(
    session: &Session,
    library: &Library,
    (problem, selection): (&Problem, &Selection),
    noise: &[ClassNoise],
) -> Option<BTreeMap<usize, f64>> {
    let is_length = |v: &usize| setups_of(library, *v).is_some();
    let place = selection.chosen.iter().position(is_length)?;
    let parts = contributions_um(session, problem, library, &selection.chosen);
    let of_ballbar = session.moments.iter().zip(&session.readings).zip(&parts[place]);
    let of_ballbar: Vec<_> = of_ballbar.filter(|((m, _), _)| m.is_ballbar).collect();
    let stands_out = of_ballbar.iter().any(|((_, r), length_um)| {
        let noise = noise[r.instrument];
        length_um.abs() > SIGNIFICANT * noise.white_um.hypot(noise.drift_um)
    });
    stands_out.then(|| of_ballbar.into_iter().map(|((m, _), length_um)| (m.setup, *length_um)).collect())
}

/// Marks a length error of about half a display step below zero as not separable from `quantisation`: a display that truncates its
/// readings makes each too small by half a step in the mean. `assessed` has the order of the selection.
pub(super) fn mark_truncation(session: &Session, a: &Analysis, assessed: &mut [Assessed]) {
    let Some(place) = assessed.iter().position(|x| setups_of(&a.library, x.variant).is_some()) else {
        return;
    };
    let parts = contributions_um(session, &a.problem, &a.library, &a.selection.chosen);
    let all = session.moments.iter().zip(&session.readings).zip(&parts[place]);
    let is_half_a_step = |((_, r), um): ((&Moment, &Reading), &f64)| {
        let step_um = a.lattice_um[r.instrument];
        step_um > 0.0 && (-(HALF + LITTLE) * step_um..=0.0).contains(um)
    };
    if all.filter(|((m, _), _)| m.is_ballbar).all(is_half_a_step) {
        assessed[place].same.push(Label::new("quantisation", ""));
    }
}
