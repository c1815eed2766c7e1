//! The search for causes, and the same again where effects are not the same everywhere.

use super::assess::cancels;
use super::contributions_um;
use super::library::Library;
use super::noise::Filter;
use super::search::{self, Problem, Selection, Variation};
use super::session::Session;

/// The causes of a problem, from what is chosen on.
pub(super) fn find_causes(
    problem: &mut Problem,
    session: &Session,
    filter: &Filter,
    library: &mut Library,
    selection: &mut Selection,
) {
    selection.search(problem, library);
    if !selection.is_plain {
        selection.single_out(problem, library);
    }
    for place in 0..selection.chosen.len() {
        let chosen = selection.chosen.clone();
        search::refine(problem, session, filter, library, &chosen, place);
    }
    if !selection.is_plain && !selection.chosen.is_empty() {
        for place in 0..selection.chosen.len() {
            search::challenge(problem, session, filter, library, selection, place);
        }
        selection.swap(problem, library);
        selection.search(problem, library);
        selection.single_out(problem, library);
        selection.expel(problem, library);
        selection.absorb(problem, library);
    }
    // what was refined has new columns
    selection.chosen.iter().for_each(|v| problem.prepare(*v));
}

/// The search begins again with effects that have this share of the energy of the largest: smaller ones may be what varies.
const CORE: f64 = 0.05;
/// Share of the energy of the largest from which effects are asked whether they vary, and the most that are asked.
const ASKED: f64 = 0.2;
const ASKED_MAX: usize = 3;

/// Those of the effects that have a share of the energy of the largest, the largest first.
fn by_energy(problem: &Problem, chosen: &[usize], share: f64) -> Vec<usize> {
    let given = problem.given(chosen);
    let beta = problem.fit(&given);
    let energy = |v: &usize| (problem.part(&given, &beta, *v).norm_squared(), *v);
    let mut all: Vec<(f64, usize)> = chosen.iter().map(energy).collect();
    all.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let least = share * all.first().map_or(0.0, |a| a.0);
    all.into_iter().filter(|(e, _)| *e >= least).map(|(_, v)| v).collect()
}

/// Where effects are not the same everywhere, what varies joins the noise, and causes are looked for again. It stays so where
/// this says more than further effects that are the same everywhere do, and without power series that cancel themselves.
pub(super) fn allow_for_variation(
    problem: &mut Problem,
    session: &Session,
    filter: &Filter,
    library: &mut Library,
    selection: &mut Selection,
) {
    let same = Same { chosen: selection.clone(), library: library.clone(), square: problem.y.norm_squared() };
    let evidence = selection.evidence(problem, library);
    let cancelled = cancels(problem, library, selection);
    let mut core = by_energy(problem, &selection.chosen, CORE);
    for search_again in [true, true, false] {
        let mut parts = contributions_um(session, problem, library, &core);
        parts.truncate(by_energy(problem, &core, ASKED).len().min(ASKED_MAX));
        let before = problem.variation().cloned();
        if before.is_some() {
            problem.vary(None);
            core.iter().for_each(|v| problem.prepare(*v));
        }
        let own_axis = |v: usize| {
            let shape = &library.variants[v].shape;
            shape.over().filter(|_| shape.is_free_curve())
        };
        let found = Variation::find(session, filter, problem, &core, &parts, &own_axis);
        let is_new = found.is_some();
        if is_new || before.is_some() {
            problem.vary(found.or(before));
        }
        if !is_new {
            break;
        }
        if search_again {
            selection.restart(&core);
            find_causes(problem, session, filter, library, selection);
            let says_less = selection.evidence(problem, library) + same.explained(problem) < evidence;
            if says_less || !cancelled && cancels(problem, library, selection) {
                same.restore(problem, session, filter, library, selection);
                break;
            }
            core = by_energy(problem, &selection.chosen, 0.0);
        }
        core.iter().for_each(|v| problem.prepare(*v));
    }
    selection.chosen.iter().for_each(|v| problem.prepare(*v));
}

/// What was found with effects that are the same everywhere.
struct Same {
    chosen: Selection,
    library: Library,
    /// Sum of squares of the gap.
    square: f64,
}

impl Same {
    /// What the variation explains, twice the logarithm of a likelihood.
    fn explained(&self, problem: &Problem) -> f64 {
        self.square - problem.y.norm_squared() - problem.variation().map_or(0.0, Variation::log_variance)
    }

    fn restore(
        self,
        problem: &mut Problem,
        session: &Session,
        filter: &Filter,
        library: &mut Library,
        selection: &mut Selection,
    ) {
        problem.vary(None);
        for (v, (now, then)) in library.variants.iter().zip(&self.library.variants).enumerate() {
            if now.shape != then.shape {
                problem.replace(session, filter, v, &then.shape);
            }
        }
        (*library, *selection) = (self.library, self.chosen);
    }
}
