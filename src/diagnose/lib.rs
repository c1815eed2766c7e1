//! Diagnosis of the gap between simulation and reality: where it lies, which unmodelled effects cause it, and how far it
//! shrinks once they are added.
//!
//! Gap = measured deviation minus predicted one, per reading, along the direction in which the instrument measures.
//! Assumption: it is a sum of effects of the library ([`library`]), the offset of each mounting, a drift and noise
//! ([`noise`]). Effects are searched in whitened space ([`search`]), their evidence is collected ([`assessment`]) and
//! decided on ([`decision`]); what is left is tested against what repeats show of the noise ([`residual_structure`]). Pure: no files, no clock; random draws have a
//! seed. Source: docs/explanation/diagnosis.md; equations: `docs/reference/equations.md`.

#![forbid(unsafe_code)]
#![cfg_attr(not(test), forbid(clippy::disallowed_methods))]

pub mod assessment;
mod bar_length;
mod constants;
pub mod decision;
mod dense;
pub mod evidence;
mod forecast;
pub mod library;
mod localise;
mod next;
pub mod noise;
mod offsets;
mod orthonormal;
mod outcome;
pub mod plan;
mod predict;
mod prediction_interval;
pub mod report;
mod residual_structure;
pub mod search;
mod searched;
pub mod session;
mod slow_causes;
mod spatial_variation;
mod stochastic;

use bar_length::{BarLength, BarLengths};
use constants::{HALF, LITTLE, ROUNDS, SIGNIFICANT, STRONG, SURE};
use evidence::Comparison;
use library::{Kind, Library, Shape, Variant, Without};
use noise::{ClassNoise, Filter};
use search::{Problem, RawColumns, Selection};
use searched::Searched;
use session::{Note, Session};

pub use next::Dialect;
pub use outcome::{Budget, Correction, Curve, Diagnosis, FittedLine, Level, ProgramResidual, Shares};
pub use plan::plan;
pub use predict::{PredictError, predict};
pub use volcomp_effects::{addition, machine_state};

/// The machine state under the name that this crate uses, and what it follows.
mod moment {
    pub(crate) use volcomp_effects::machine_state::{MachineState as Moment, *};
    pub(crate) use volcomp_effects::{Follower, Signal};
}

/// Something taken away from the method, to prove that tests of it can fail.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Ablation {
    /// Nothing.
    #[default]
    None,
    /// No gates: whatever the search finds is declared.
    NoGates,
    /// No drift: mountings are taken to stand still.
    NoDrift,
    /// Neither, and forward selection without swap, merge, backward steps and threshold.
    Plain,
}

impl Ablation {
    const fn has_gates(self) -> bool {
        matches!(self, Self::None | Self::NoDrift)
    }

    const fn has_drift(self) -> bool {
        matches!(self, Self::None | Self::NoGates)
    }
}

/// Choices of the user.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Options {
    /// Effects taken out of the library.
    pub without: Vec<Without>,
    /// Seed of the random draws.
    pub seed: u64,
    /// The machine of the model, for the addition.
    pub machine: String,
    /// What the method does without.
    pub ablation: Ablation,
    /// The control for which part programs are written.
    pub dialect: Dialect,
}

/// Everything that the search has found.
struct Analysis {
    library: Library,
    problem: Problem,
    filter: Filter,
    selection: Selection,
    noise: Vec<ClassNoise>,
    /// White noise of a reading of each class, um.
    reading_um: Vec<f64>,
    used: Vec<bool>,
    outlying: Vec<usize>,
    lattice_um: Vec<f64>,
    gap: Vec<f64>,
    /// What was taken out because readings that were left out fit worse with it.
    pruned: Vec<decision::Evidence>,
    /// Where few programs allow all sets of effects to be compared.
    comparison: Option<Comparison>,
    /// A length of the ballbar that was taken off for the search.
    bar_length: Option<BarLength>,
}

impl Analysis {
    /// The gap without a length of the ballbar beside which nothing else would count, um.
    fn without_bar_length(&self) -> Vec<f64> {
        let Some(bar) = &self.bar_length else { return self.gap.clone() };
        self.gap.iter().zip(&bar.part_um).map(|(gap, part)| gap - part).collect()
    }
}

/// Diagnoses a session whose predictions are filled in; `tell` hears of the progress (share done, what is done).
pub fn diagnose(
    session: &mut Session,
    mut fresh: Option<&mut Session>,
    options: &Options,
    tell: &mut dyn FnMut(f64, &str),
) -> Diagnosis {
    let mut known = Known::of(session);
    let mut analysis = analyse(session, options, &mut known, tell);
    while let Analysis { library, problem, selection, noise, comparison: None, .. } = &analysis
        && known.bar_lengths.take_off(session, library, (problem, selection), noise)
    {
        analysis = analyse(session, options, &mut known, tell);
    }
    known.bar_lengths.put_back(session, &mut analysis);
    if session.ball_zero.is_some() {
        session.notes.push(Note::new(
            "readings of the R-test fit better where all errors, not those of rotary axes alone, count from the centring of the ball: \
             so they are counted"
                .to_owned(),
        ));
    }
    let is_drop = |v: &Variant| matches!(v.shape, Shape::Sag(_) | Shape::Ram(_));
    let machine = &session.machine;
    if machine.vertical.is_none()
        && machine.table_about_y().is_some()
        && analysis.library.variants.iter().any(is_drop)
    {
        let up = machine.up();
        session.notes.push(Note::new(format!(
            "{up} is taken for the axis that points up, beside a table that turns about y; `vertical` in [frame] of the model says it"
        )));
    }
    // fresh readings count as those of the session do
    if session.ball_zero.is_some()
        && let Some(fresh) = &mut fresh
    {
        fresh.count_from_ball_zero();
    }
    tell(0.85, "tests of the causes");
    outcome::conclude(session, fresh, options, &analysis, tell)
}

/// What one analysis of a session leaves to the next.
struct Known {
    /// Step of each instrument class, um: what is taken off later is no multiple of it.
    lattice_um: Vec<f64>,
    raw: RawColumns,
    bar_lengths: BarLengths,
}

impl Known {
    fn of(session: &Session) -> Self {
        Self {
            lattice_um: noise::lattices(session),
            raw: RawColumns::default(),
            bar_lengths: BarLengths::default(),
        }
    }
}

fn analyse(
    session: &mut Session,
    options: &Options,
    known: &mut Known,
    tell: &mut dyn FnMut(f64, &str),
) -> Analysis {
    tell(0.0, "noise from repeats");
    let lattice_um = &known.lattice_um.clone()[..];
    let gap = session.gap();
    let mut outlying = noise::outliers(session, &gap, lattice_um);
    let mut used = noise::all_but(gap.len(), &outlying);
    let ablation = options.ablation;
    let steady = |mut classes: Vec<ClassNoise>| {
        if !ablation.has_drift() {
            classes.iter_mut().for_each(|c| c.drift_um = 0.0);
        }
        classes
    };
    let mut class_noise = steady(noise::from_repeats(session, &gap, &used, lattice_um));
    let mut library = Library::new(session, &options.without);
    take_signals(session, &mut library);
    if ablation == Ablation::None && evidence::applies(session) {
        tell(0.2, "comparison of all sets of effects");
        let white: Vec<f64> = class_noise.iter().map(|c| c.white_um).collect();
        let mut named = library.clone();
        // a slope is a squareness or a scale and a reversal is a backlash: each has its own name
        named.variants.retain(|v| v.shape.has_own_name());
        let left_out = beyond_the_noise(session, &gap, lattice_um, &outlying);
        if let Some(analysis) = compare(session, named.clone(), &left_out, (&gap, lattice_um, &white)) {
            // one of two that are compared on the same readings
            if session.ball_zero.is_some() {
                return analysis;
            }
            let likelier = likelier_zero(session, options, known, analysis, tell);
            return beside_causes(session, &named, &white, likelier);
        }
    }
    // the search weighs all columns alike: of the processes that have the same columns one stands for all
    library.variants.retain(|v| !v.shape.is_process() || v.shape.is_plain_table());
    let mut round = 0;
    loop {
        tell(0.1 + 0.25 * round as f64, "search for causes");
        let mut found =
            Searched::under(session, &mut library, &mut known.raw, (&class_noise, &used, &gap), options);
        round += 1;
        let left = remainder(session, &found.problem, &library, &found.selection, &gap);
        if round == 1 {
            let next = steady(noise::from_remainder(session, &left, &used, &class_noise));
            let searched = (&found.problem, &found.selection);
            if known.bar_lengths.take_off(session, &library, searched, &next)
                || found.is_likelier_from_ball_zero(session, &mut known.raw, &library, &class_noise)
            {
                return analyse(session, options, known, tell);
            }
        }
        let is_judged = !found.selection.is_plain && !found.problem.precise;
        let further = if is_judged && round < ROUNDS {
            noise::off_the_fit(session, &found.filter, &left, lattice_um, (&class_noise, &used))
        } else {
            Vec::new()
        };
        if !further.is_empty() {
            outlying.extend(&further);
            outlying.sort_unstable();
            used = noise::all_but(gap.len(), &outlying);
            class_noise = steady(noise::from_repeats(session, &gap, &used, lattice_um));
        }
        let next = steady(noise::from_remainder(session, &left, &used, &class_noise));
        let settled = further.is_empty() && class_noise.iter().zip(&next).all(|(a, b)| alike(a, b));
        if settled || round >= ROUNDS {
            // the control's own encoders see the servo, which depends on no place
            if is_judged {
                let data = (&next[..], &used[..], &gap[..]);
                let rest = (&left[..], lattice_um);
                if let Some(quieter) =
                    found.with_slow_cause(session, &mut library, &mut known.raw, data, rest, options)
                {
                    class_noise = quieter;
                }
                tell(0.8, "structure over the volume");
                let least_um = class_noise.iter().map(|c| c.white_um).fold(f64::INFINITY, f64::min);
                spatial_variation::allow_for_structure(
                    &mut found.problem,
                    session,
                    &found.filter,
                    &mut library,
                    &mut found.selection,
                    least_um,
                );
            }
            let Searched { filter, problem, mut selection } = found;
            let blind = problem.unseen(&library);
            library.blind.extend(blind);
            let pruned = if ablation.has_gates() {
                assessment::prune(&problem, &library, &mut selection)
            } else {
                Vec::new()
            };
            return Analysis {
                library,
                problem,
                filter,
                selection,
                reading_um: class_noise.iter().map(|c| c.white_um).collect(),
                noise: class_noise,
                used,
                outlying,
                lattice_um: lattice_um.to_vec(),
                gap,
                pruned,
                comparison: None,
                bar_length: None,
            };
        }
        class_noise = next;
    }
}

/// An analysis by comparison of all sets of effects, or, where that is likelier, one that counts all that the ball of an R-test shows
/// from where the ball was centred; the session then does so from now on.
fn likelier_zero(
    session: &mut Session,
    options: &Options,
    known: &mut Known,
    analysis: Analysis,
    tell: &mut dyn FnMut(f64, &str),
) -> Analysis {
    if !session.count_from_ball_zero() {
        return analysis;
    }
    let from_zero = analyse(session, options, known, tell);
    let log = |a: &Analysis| a.comparison.as_ref().map_or(f64::NEG_INFINITY, |c| c.log_evidence);
    if log(&from_zero) > log(&analysis) + STRONG {
        return from_zero;
    }
    session.ball_zero = None;
    analysis
}

/// The analysis by comparison of all sets of effects, and again with what was found between the values of the grid: a coarse grid
/// must not decide between sets. `outlying`: readings that are marked, or lie apart from their repeats or their path.
fn compare(
    session: &Session,
    mut library: Library,
    outlying: &[usize],
    (gap, lattice_um, white_um): (&[f64], &[f64], &[f64]),
) -> Option<Analysis> {
    let mut before = None;
    let ordinary = noise::all_but(gap.len(), outlying);
    for round in 1.. {
        let comparison = evidence::compare(session, &library, gap, &ordinary, white_um)?;
        let chosen: Vec<usize> =
            comparison.contenders.iter().filter(|c| c.chosen).map(|c| c.variant).collect();
        let settled = round == ROUNDS || before.as_ref() == Some(&chosen);
        let data = (gap.to_vec(), lattice_um.to_vec(), white_um);
        let analysis = compared(session, library.clone(), (comparison, &chosen, settled), outlying, data);
        if settled || analysis.library.variants == library.variants {
            return Some(analysis);
        }
        library.variants.clone_from(&analysis.library.variants);
        before = Some(chosen);
    }
    None
}

/// The analysis again with the noise of each instrument, and without the outliers, that only show beside its causes: what warms differs
/// from its repeats, and what is periodic from its neighbours.
fn beside_causes(session: &Session, library: &Library, white_um: &[f64], first: Analysis) -> Analysis {
    let (mut analysis, mut before) = (first, white_um.to_vec());
    for _ in 1..ROUNDS {
        let Analysis { problem, library: refined, selection, gap, lattice_um, .. } = &analysis;
        let left = remainder(session, problem, refined, selection, gap);
        let found = noise::outliers(session, &left, lattice_um);
        let mut outlying = beyond_the_noise(session, &left, lattice_um, &found);
        outlying.retain(|i| analysis.used[*i]);
        let has_more = !outlying.is_empty();
        outlying.extend(&analysis.outlying);
        let used = noise::all_but(gap.len(), &outlying);
        let white: Vec<f64> =
            noise::from_repeats(session, &left, &used, lattice_um).iter().map(|c| c.white_um).collect();
        let ratios = || white.iter().zip(&before).map(|(now, before)| now / before);
        let is_alike =
            ratios().fold(f64::INFINITY, f64::min) >= HALF * ratios().fold(f64::NEG_INFINITY, f64::max);
        if is_alike && !has_more {
            break;
        }
        match compare(session, library.clone(), &outlying, (gap, lattice_um, &white)) {
            Some(again) => (analysis, before) = (again, white),
            None => break,
        }
    }
    analysis
}

/// The outliers of `left` that are more than the tails of its noise, which are judged beside the effects, and those marked.
fn beyond_the_noise(session: &Session, left: &[f64], lattice_um: &[f64], outlying: &[usize]) -> Vec<usize> {
    let tails = noise::tails(session, left, lattice_um, &noise::all_but(left.len(), outlying));
    let are_outliers = tails.iter().flat_map(|t| t.beyond.into_iter().zip(t.expected)).any(|(b, e)| b > e);
    outlying.iter().copied().filter(|i| are_outliers || session.readings[*i].is_marked).collect()
}

/// The analysis that a comparison of all sets of effects gives.
fn compared(
    session: &Session,
    mut library: Library,
    (mut comparison, chosen, jointly): (Comparison, &[usize], bool),
    outlying: &[usize],
    (gap, lattice_um, white_um): (Vec<f64>, Vec<f64>, &[f64]),
) -> Analysis {
    let found =
        comparison.outlying.iter().filter(|(_, w)| *w > (SIGNIFICANT / SURE).powi(2)).map(|(i, _)| *i);
    let mut outlying: Vec<usize> = outlying.iter().copied().chain(found).collect();
    outlying.sort_unstable();
    let used = noise::all_but(gap.len(), &outlying);
    let least = white_um.iter().copied().fold(f64::INFINITY, f64::min);
    let noise: Vec<ClassNoise> = white_um
        .iter()
        .map(|w| ClassNoise {
            white_um: comparison.white_um * w / least,
            drift_um: comparison.drift.0,
            drift_s: comparison.drift.1,
        })
        .collect();
    let filter = Filter::dense(comparison.covariance.clone(), comparison.groups.clone(), comparison.white_um);
    let white: Vec<f64> = noise.iter().map(|c| c.white_um).collect();
    let mut problem = Problem::new(session, &library, &filter, &gap, &white);
    let mut ordered = chosen.to_vec();
    let alone: Vec<f64> = chosen.iter().map(|v| problem.gain_beside(&[], *v).0).collect();
    let place = |v: &usize| chosen.iter().position(|c| c == v).map_or(0.0, |k| -alone[k]);
    ordered.sort_by(|a, b| place(a).total_cmp(&place(b)));
    for k in 0..ordered.len() {
        // a weaker effect may be the misfit of a stronger one: that is found without it, and then all together
        let beside = if jointly { &ordered[..] } else { &ordered[..=k] };
        search::refine(&mut problem, session, &filter, &mut library, beside, k);
    }
    problem.prepare(chosen);
    let grid = library.by_label().iter().map(Vec::len).collect();
    let blind = problem.unseen(&library);
    library.blind.extend(blind);
    let selection = Selection { chosen: chosen.to_vec(), grid, ..Selection::default() };
    let left = remainder(session, &problem, &library, &selection, &gap);
    let white_of = |i: usize| white_um[session.readings[i].instrument] / least;
    comparison.within_um = evidence::white_within(&left, white_of, &comparison.groups);
    let reading_um = white_um.iter().map(|w| comparison.reading_um() * w / least).collect();
    Analysis {
        selection,
        library,
        problem,
        filter,
        noise,
        reading_um,
        used,
        outlying,
        lattice_um,
        gap,
        pruned: Vec::new(),
        comparison: Some(comparison),
        bar_length: None,
    }
}

fn alike(a: &ClassNoise, b: &ClassNoise) -> bool {
    (a.drift_um - b.drift_um).abs() <= LITTLE * a.white_um.max(a.drift_um.min(b.drift_um))
        && (a.drift_um < 0.1 * a.white_um || (a.drift_s / b.drift_s).ln().abs() < 0.5)
}

/// Lagged signals of the library; variants whose source some file lacks are left out.
fn take_signals(session: &mut Session, library: &mut Library) {
    let known: Vec<_> = library.signals().into_iter().filter(|s| session.add_signal(s)).collect();
    let before = library.by_label();
    library.variants.retain(|v| v.shape.signals().iter().all(|s| known.contains(s)));
    let after = library.by_label();
    for (l, variants) in after.iter().enumerate() {
        if variants.is_empty() && !before[l].is_empty() {
            library.blind.push(library::Blind {
                label: library.labels[l].to_string(),
                because: "a file lacks the temperature or speed that it needs".to_owned(),
                is_unrecorded: true,
            });
        }
    }
}

/// What each of some effects, fitted together, contributes to every row of the session, um.
fn contributions_um(
    session: &Session,
    problem: &Problem,
    library: &Library,
    chosen: &[usize],
) -> Vec<Vec<f64>> {
    let given = problem.given(chosen);
    let beta = problem.fit(&given);
    let raw = raw_of(session, library, chosen);
    let mut columns = given.columns.iter().zip(&beta).zip(&raw);
    let sum = |v: &usize| {
        let mut out = vec![0.0; session.readings.len()];
        for ((column, b), values) in columns.by_ref().take(problem.span[*v].1) {
            let norm = problem.norm[*column];
            let scale = if norm > 0.0 { b / norm } else { 0.0 };
            out.iter_mut().zip(values).for_each(|(o, v)| *o += scale * v);
        }
        out
    };
    chosen.iter().map(sum).collect()
}

/// The gap without the effects chosen, um.
fn remainder(
    session: &Session,
    problem: &Problem,
    library: &Library,
    selection: &Selection,
    gap: &[f64],
) -> Vec<f64> {
    let mut left = gap.to_vec();
    for part in contributions_um(session, problem, library, &selection.chosen) {
        left.iter_mut().zip(part).for_each(|(l, p)| *l -= p);
    }
    left
}

/// Raw columns of some variants, for every row of the session, um per unit of parameter.
fn raw_of(session: &Session, library: &Library, chosen: &[usize]) -> Vec<Vec<f64>> {
    raw_of_shapes(session, &chosen.iter().map(|v| &library.variants[*v].shape).collect::<Vec<_>>())
}

/// The same of some shapes.
fn raw_of_shapes(session: &Session, shapes: &[&Shape]) -> Vec<Vec<f64>> {
    let rows: Vec<usize> = (0..session.readings.len()).collect();
    let width = shapes.iter().map(|shape| shape.width()).sum();
    let data = search::raw(session, &rows, shapes);
    (0..width).map(|j| data.iter().skip(j).step_by(width).copied().collect()).collect()
}

/// True for effects that a prediction can take over.
fn is_predictable(kind: Kind) -> bool {
    kind != Kind::Stochastic
}
