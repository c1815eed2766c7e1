//! The search for causes, and the same again where curves are rough or effects are not the same everywhere.

use super::constants::{LITTLE, STRONG, TRIED};
use super::contributions_um;
use super::library::{Library, Shape, forms};
use super::noise::Filter;
use super::offsets::rms;
use super::search::{self, LowRank, Problem, Selection, Structure, Variation};
use super::session::Session;

/// The causes of a problem, from what is chosen on.
pub(super) fn find_causes(
    problem: &mut Problem,
    session: &Session,
    filter: &Filter,
    library: &mut Library,
    selection: &mut Selection,
) {
    selection.take_apart(problem, library);
    selection.search(problem, library);
    if !selection.is_plain && search::find_pitches(problem, session, filter, library, selection) {
        selection.swap(problem, library);
        selection.search(problem, library);
    }
    if !selection.is_plain {
        search::one_worn_place(problem, session, filter, library, selection);
        selection.single_out(problem, library);
    }
    for place in 0..selection.chosen.len() {
        let chosen = selection.chosen.clone();
        search::refine(problem, session, filter, library, &chosen, place);
    }
    if !selection.is_plain && !selection.chosen.is_empty() {
        search::one_response_per_axis(problem, session, filter, library, selection);
        search::challenge(problem, session, filter, library, selection);
        search::turn_about_pivots(problem, session, filter, library, selection);
        search::tilt_about_pivots(problem, session, filter, library, selection);
        selection.swap(problem, library);
        selection.search(problem, library);
        selection.single_out(problem, library);
        selection.expel(problem, library);
        search::one_of_two(problem, session, filter, library, selection);
        selection.absorb(problem, library);
    }
    // what was refined has new columns
    problem.prepare(&selection.chosen);
}

/// Where structure of the gap says more than the effects found without it, that joins the noise, and causes are looked for again: the
/// roughness of curves, then the variation of effects that are not the same everywhere, or a discrepancy that no effect describes, with
/// variation beside it. `least_um` is the white noise of the best instrument.
pub(super) fn allow_for_structure(
    problem: &mut Problem,
    session: &Session,
    filter: &Filter,
    library: &mut Library,
    selection: &mut Selection,
    least_um: f64,
) {
    allow_for_roughness(problem, session, filter, library, selection, least_um);
    let square = problem.y.norm_squared();
    let found = search::discrepancy(session, filter, problem, library, selection, least_um);
    let before = found.is_some().then(|| Found::of(problem, library, selection, square));
    allow_for_variation(problem, session, filter, library, selection);
    let (Some((found, kept)), Some(before)) = (found, before) else { return };
    let varying = Found::of(problem, library, selection, square);
    before.restore(problem, session, filter, library, selection);
    let structure = Structure { discrepancy: Some(found), variation: None, ..problem.structure().clone() };
    find_causes_beside(problem, session, filter, library, selection, (structure, &kept));
    allow_for_variation(problem, session, filter, library, selection);
    let now = Found::of(problem, library, selection, square);
    // where neither says more, fewer causes do
    let fewer = now.selection.chosen.len() < varying.selection.chosen.len();
    if now.evidence < varying.evidence + if fewer { -STRONG } else { STRONG } {
        varying.restore(problem, session, filter, library, selection);
    }
    problem.prepare(&selection.chosen);
}

/// The causes from those kept on, once structure has joined the noise.
fn find_causes_beside(
    problem: &mut Problem,
    session: &Session,
    filter: &Filter,
    library: &mut Library,
    selection: &mut Selection,
    (structure, kept): (Structure, &[usize]),
) {
    problem.join(structure);
    problem.prepare(kept);
    selection.restart(problem, library, kept);
    find_causes(problem, session, filter, library, selection);
}

/// Where curves are rougher than their polynomials, what these leave joins the noise, and causes are looked for again. It stays so where
/// this says more.
fn allow_for_roughness(
    problem: &mut Problem,
    session: &Session,
    filter: &Filter,
    library: &mut Library,
    selection: &mut Selection,
    least_um: f64,
) {
    let found = search::roughness(session, filter, problem, library, selection, least_um);
    let Some((found, kept)) = found else { return };
    let square = problem.y.norm_squared();
    let before = Found::of(problem, library, selection, square);
    let structure = Structure { roughness: Some(found), ..Structure::default() };
    find_causes_beside(problem, session, filter, library, selection, (structure, &kept));
    if Found::of(problem, library, selection, square).evidence < before.evidence + STRONG {
        before.restore(problem, session, filter, library, selection);
        problem.prepare(&selection.chosen);
    }
}

/// Share of the energy of the largest from which effects are asked whether they vary, and the most that are asked.
const ASKED: f64 = 0.2;

/// An effect with what it contributes to every row of the session, um, and how much a variation of it would show.
struct Contribution {
    variant: usize,
    part: Vec<f64>,
    energy: f64,
}

/// Those of the effects that have a share of the largest energy, the largest first. What a mounting hides of an effect, as of a
/// tool that is too long, it does not hide of its variation.
fn by_energy(
    (session, filter, problem, library): (&Session, &Filter, &Problem, &Library),
    chosen: &[usize],
    share: f64,
) -> Vec<Contribution> {
    let parts = contributions_um(session, problem, library, chosen);
    let energies = Variation::would_show(session, filter, problem, &parts);
    let all = chosen.iter().zip(parts).zip(energies);
    let mut all: Vec<Contribution> =
        all.map(|((v, part), energy)| Contribution { variant: *v, part, energy }).collect();
    all.sort_by(|a, b| b.energy.total_cmp(&a.energy).then(a.variant.cmp(&b.variant)));
    let least = share * all.first().map_or(0.0, |a| a.energy);
    all.retain(|c| c.energy >= least);
    all
}

/// Where effects are not the same everywhere, what varies joins the noise, and causes are looked for again. It stays so as
/// long as this says more than what was found before.
fn allow_for_variation(
    problem: &mut Problem,
    session: &Session,
    filter: &Filter,
    library: &mut Library,
    selection: &mut Selection,
) {
    let square = problem.y.norm_squared();
    let mut best = Found::of(problem, library, selection, square);
    let mut core = selection.chosen.clone();
    for (search_again, share) in [(true, LITTLE), (true, 0.0), (false, 0.0)] {
        problem.prepare(&core);
        let all = by_energy((session, filter, problem, library), &core, share);
        core = all.iter().map(|c| c.variant).collect();
        let least = ASKED * all.first().map_or(0.0, |c| c.energy);
        let asked = all.into_iter().take(TRIED).filter(|c| c.energy >= least);
        let parts: Vec<Vec<f64>> = asked.map(|c| c.part).collect();
        if problem.variation().is_some() {
            problem.vary(None);
            problem.prepare(&core);
        }
        let of = |v: usize| {
            let variant = &library.variants[v];
            (variant.label, variant.shape.over().filter(|_| variant.shape.is_free_curve()))
        };
        let zeros = zeros(session, problem, library, &core, &parts);
        let Some(found) = Variation::find(session, filter, problem, &core, &parts, &zeros, &of) else {
            // beside what was found with the variation before nothing asks for another one
            problem.vary(best.structure.variation.clone());
            break;
        };
        problem.vary(Some(found));
        problem.prepare(&selection.chosen);
        if search_again {
            selection.restart(problem, library, &core);
            find_causes(problem, session, filter, library, selection);
        }
        let now = Found::of(problem, library, selection, square);
        if now.evidence < best.evidence {
            best.restore(problem, session, filter, library, selection);
            break;
        }
        best = now;
        core.clone_from(&selection.chosen);
    }
    problem.prepare(&selection.chosen);
}

/// The zeros of curves among the first of the effects chosen, one for each of the `parts`: the mounting hides where a
/// straightness or a positioning error is zero, but not once it varies. They are as large as the curve itself.
fn zeros(
    session: &Session,
    problem: &Problem,
    library: &Library,
    chosen: &[usize],
    parts: &[Vec<f64>],
) -> Vec<(usize, Vec<f64>)> {
    let of = |(place, part): (usize, &Vec<f64>)| {
        let Shape::Polynomial(forms::Polynomial { along, .. }) = library.variants[chosen[place]].shape else {
            return None;
        };
        let rows = problem.rows.iter().map(|i| part[*i]).collect::<Vec<f64>>();
        let size_um = rms(&rows);
        Some((place, session.moments.iter().map(|m| size_um * m.u[along.slot()]).collect()))
    };
    parts.iter().enumerate().filter_map(of).collect()
}

/// What was found, to come back to.
struct Found {
    selection: Selection,
    library: Library,
    structure: Structure,
    /// Twice the logarithm of a likelihood, with all prices.
    evidence: f64,
}

impl Found {
    /// `square` is the sum of squares of the gap without the structure that is compared.
    fn of(problem: &mut Problem, library: &Library, selection: &Selection, square: f64) -> Self {
        let structure = problem.structure().clone();
        let log_variance: f64 = structure.noises().map(LowRank::log_variance).sum();
        let varies = square - problem.y.norm_squared() - log_variance;
        Self {
            evidence: selection.evidence(problem, library) + varies,
            selection: selection.clone(),
            library: library.clone(),
            structure,
        }
    }

    fn restore(
        self,
        problem: &mut Problem,
        session: &Session,
        filter: &Filter,
        library: &mut Library,
        selection: &mut Selection,
    ) {
        problem.join(Structure { variation: None, ..self.structure.clone() });
        for (v, (now, then)) in library.variants.iter().zip(&self.library.variants).enumerate() {
            if now.shape != then.shape {
                problem.replace(session, filter, v, &then.shape);
            }
        }
        if self.structure.variation.is_some() {
            problem.join(self.structure);
        }
        (*library, *selection) = (self.library, self.selection);
    }
}
