//! The result of a search under some noise, and its rivals: effects counted from the zero of a ball, and a slow cause in the place of
//! drift.

use std::cmp::Ordering;

use super::constants::{HALF, SIGNIFICANT};
use super::library::Library;
use super::noise::{ClassNoise, Filter};
use super::search::{self, Problem, RawColumns, Selection};
use super::session::Session;
use super::{Ablation, Options, contributions_um, remainder, slow_causes, spatial_variation};

/// What a search has found under some noise.
pub(super) struct Searched {
    pub(super) filter: Filter,
    pub(super) problem: Problem,
    pub(super) selection: Selection,
}

impl Searched {
    /// The causes of a gap, from none on, whose columns are `raw` where they are known.
    pub(super) fn under(
        session: &Session,
        library: &mut Library,
        raw: &mut RawColumns,
        (noise, used, gap): (&[ClassNoise], &[bool], &[f64]),
        options: &Options,
    ) -> Self {
        let filter = Filter::new(session, noise, used);
        let white: Vec<f64> = noise.iter().map(|c| c.white_um).collect();
        let mut problem = Problem::next(session, library, raw, &filter, gap, &white);
        let is_plain = options.ablation == Ablation::Plain;
        let grid: Vec<usize> = library.by_label().iter().map(Vec::len).collect();
        let threshold =
            if is_plain { 0.0 } else { search::threshold(&problem, library, &grid, options.seed) };
        let mut selection = Selection { threshold, grid, is_plain, ..Selection::default() };
        spatial_variation::find_causes(&mut problem, session, &filter, library, &mut selection);
        Self { filter, problem, selection }
    }

    /// Counts all that the ball of an R-test shows from where the ball was centred, where that says more of the gap than the state at
    /// each row does, for which what was found stands; true where it does so from now on.
    pub(super) fn is_likelier_from_ball_zero(
        &mut self,
        session: &mut Session,
        raw: &mut RawColumns,
        library: &Library,
        noise: &[ClassNoise],
    ) -> bool {
        let Self { filter, problem, selection } = self;
        if selection.is_plain || !session.count_from_ball_zero() {
            return false;
        }
        let score = |problem: &mut Problem, library: &Library, selection: &Selection| {
            // what is left beyond the noise, and the price of the causes
            let left = problem.y.norm_squared() - problem.len() as f64 - selection.evidence(problem, library);
            (left, selection.chosen.len())
        };
        let now = score(problem, library, selection);
        let (mut library, mut selection) = (library.clone(), selection.clone());
        let white: Vec<f64> = noise.iter().map(|c| c.white_um).collect();
        let mut raw_from_zero = raw.from_ball_zero(session);
        let mut problem =
            Problem::next(session, &library, &mut raw_from_zero, filter, &session.gap(), &white);
        problem.prepare(&selection.chosen);
        selection.merge(&mut problem, &library);
        let chosen = selection.chosen.clone();
        selection.restart(&mut problem, &library, &chosen);
        spatial_variation::find_causes(&mut problem, session, filter, &mut library, &mut selection);
        let then = score(&mut problem, &library, &selection);
        let counts = outweighs(then, now);
        if counts {
            *raw = raw_from_zero;
        } else {
            session.ball_zero = None;
        }
        counts
    }

    /// Replaces the result by one with a slow cause in the place of drift where that is likelier, and returns its noise. `next` is the
    /// noise estimated from `left`, the residuals of this search, um.
    pub(super) fn with_slow_cause(
        &mut self,
        session: &Session,
        library: &mut Library,
        raw: &mut RawColumns,
        (next, used, gap): (&[ClassNoise], &[bool], &[f64]),
        (left, lattice_um): (&[f64], &[f64]),
        options: &Options,
    ) -> Option<Vec<ClassNoise>> {
        let Self { problem, selection, .. } = &*self;
        let parts = contributions_um(session, problem, library, &selection.chosen);
        let chosen: Vec<(usize, Vec<f64>)> = selection.chosen.iter().copied().zip(parts).collect();
        let before = slow_causes::Before {
            session,
            library,
            grid: &selection.grid,
            threshold: selection.threshold,
            used,
            lattice_um,
            gap,
            left,
            noise: next,
            chosen: &chosen,
        };
        let found = before.candidates().find_map(|candidate| {
            let mut other = library.clone();
            let again = Self::under(session, &mut other, raw, (&candidate.noise, used, gap), options);
            let left = remainder(session, &again.problem, &other, &again.selection, gap);
            let has_it = again.selection.chosen.iter().any(|v| other.variants[*v].label == candidate.label);
            let count = again.selection.chosen.len();
            (has_it && before.is_likelier(&candidate.noise, &left, count)).then_some((
                other,
                again,
                candidate.noise,
            ))
        });
        let noise;
        (*library, *self, noise) = found?;
        Some(noise)
    }
}

/// True where one account of a gap is better than another: of each what it leaves beyond the noise, with the price of its causes, in
/// squares of the noise, and the number of causes. What takes as many causes to say a little more, or further ones, may only be the
/// misform of one.
fn outweighs((left, causes): (f64, usize), (left_now, causes_now): (f64, usize)) -> bool {
    let surely = left_now - SIGNIFICANT * SIGNIFICANT;
    match causes.cmp(&causes_now) {
        Ordering::Less => left < left_now - search::SWAP_GAIN,
        Ordering::Equal => left < surely,
        Ordering::Greater => left < surely.min(HALF * left_now),
    }
}

#[cfg(test)]
mod tests {
    use super::outweighs;

    #[test]
    fn further_causes_must_leave_less_than_half_and_fewer_a_little_less() {
        let now = (1000.0, 3);
        for (then, is_better) in [
            ((990.0, 2), true),
            ((999.5, 2), false),
            ((970.0, 3), true),
            ((980.0, 3), false),
            ((510.0, 4), false),
            ((490.0, 4), true),
        ] {
            assert_eq!(outweighs(then, now), is_better, "{then:?}");
        }
        // nothing is left: further causes are not asked for
        assert!(!outweighs((-10.0, 4), (5.0, 3)) && !outweighs((0.0, 4), (-40.0, 3)));
    }
}
