//! From the analysis to the report, the addition and the curves for pictures.

mod budget;
mod causes;
mod compared;
mod curves;
mod effect_export;
mod fitted;
mod misform;
mod re_expression;
mod rejection_text;
mod rough_curves;
mod structured;
mod unexplained;
mod views;

use super::addition::Addition;
use super::assessment::assess;
use super::bar_length;
use super::constants::{HALF, LISTED, LITTLE, NEARLY};
use super::decision::{Assessed, Evidence, HeldOut, Reason, decide, declare_all};
use super::forecast::{Contributions, contributions, forecast, minus};
use super::library::Kind;
use super::localise::localise;
use super::noise::{
    ClassNoise, Filter, beside_repeats, cycle, from_partners, is_revisited, lattices, outliers,
};
use super::offsets::{residuals, rms, without_offsets};
use super::prediction_interval::{Day, varies_between_days};
use super::report::{Cause, Fresh, InstrumentNoise, Outlying, Report, Size, Unseen, Value, Verdict};
use super::residual_structure::structure;
use super::session::Session;
use super::stochastic;
use super::{Analysis, Options, raw_of};

pub use budget::{Budget, Correction, Level, ProgramResidual, Shares};

use budget::{budget, programs};
use curves::curves;
use effect_export::{addition, not_seen_on, seen_on};
use fitted::Fitted;
use rejection_text::words;
use rough_curves::Columns;
use unexplained::unexplained;

/// A fitted effect over the data, for a picture; an effect that is seen in several directions has a curve in each.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// `effect:subject`.
    pub label: String,
    /// Quantity and unit of the first number of a point.
    pub x_label: String,
    /// Quantity and unit of the other two.
    pub y_label: String,
    /// Where; the gap without the declared causes but with this effect; the effect fitted; both in `unit`. At most some hundred of the
    /// readings.
    pub points: Vec<[f64; 3]>,
    /// The effect as fitted, one line per direction of travel, tool or file where it differs between them.
    pub lines: Vec<FittedLine>,
    /// Highest minus lowest fitted value on the lines.
    pub range: Value,
    /// Unit of the ordinate: `µm`, or `″` of a rotation, whatever the lever of each reading.
    pub unit: &'static str,
    /// Readings that show the effect.
    pub readings: usize,
    /// What is scaled or averaged in the picture; may be empty.
    pub note: String,
}

/// A line of a [`Curve`].
#[derive(Debug, Clone, PartialEq)]
pub struct FittedLine {
    /// What tells it from the other lines; empty where there is only one.
    pub name: String,
    /// Where; the effect fitted; lower and upper end of its 90 % band, in the unit of the curve.
    pub points: Vec<[f64; 4]>,
}

/// Everything that a diagnosis gives.
#[derive(Debug, Clone, PartialEq)]
pub struct Diagnosis {
    /// The report.
    pub report: Report,
    /// The effects found.
    pub addition: Addition,
    /// Causes over the data.
    pub curves: Vec<Curve>,
    /// The gap of each reading without the offsets of the setups, um; NaN where it was left out.
    pub before_um: Vec<f64>,
    /// The same without the causes declared.
    pub after_um: Vec<f64>,
    /// The gap from its size down to the noise.
    pub budget: Budget,
    /// The gap of each part program, the largest residual first.
    pub programs: Vec<ProgramResidual>,
    /// Angular readings are given as displacement at this radius, mm; none where there are others, or several radii.
    pub radius_mm: Option<f64>,
}

impl Diagnosis {
    /// Width of a backlash that changes with the position, in the middle of the data (mm, um): that at zero may lie far outside.
    #[must_use]
    pub fn width_in_the_middle(&self, cause: &Cause) -> Option<(f64, Value)> {
        let entry =
            self.addition.effects.iter().find(|e| e.name == cause.effect && e.subject == cause.subject)?;
        let at = |name: &str| entry.parameter_names.iter().position(|n| n == name);
        let (width, slope) = (at("width_um")?, at("width_slope_um_per_m")?);
        let [low, high] = *entry.valid.get(&format!("{}_mm", cause.subject))?;
        let (place, metres) = (0.5 * (low + high), 0.5e-3 * (low + high));
        let c = |i: usize, j: usize| entry.covariance[i][j];
        let variance = c(width, width) + 2.0 * metres * c(width, slope) + metres * metres * c(slope, slope);
        let value = entry.values[width] + metres * entry.values[slope];
        Some((place, Value { value, std: variance.max(0.0).sqrt() }))
    }
}

/// The radius of the levers, where all readings are angular and have one.
fn radius_mm(session: &Session) -> Option<f64> {
    let radius = session.moments.first()?.lever_mm.norm();
    session.moments.iter().all(|m| (m.lever_mm.norm() - radius).abs() < 1e-6 * radius).then_some(radius)
}

/// What is known of the day of the session, for the forecast of another one.
fn day<'a>(
    session: &'a Session,
    a: &'a Analysis,
    parts: &Contributions,
    owner: &[usize],
    assessed: &[Assessed],
) -> Day<'a> {
    let sum = |take: &dyn Fn(&Assessed) -> bool| {
        let mut out = vec![0.0; a.gap.len()];
        for (part, o) in parts.in_sample.iter().zip(owner) {
            if assessed[*o].is_declared() && take(&assessed[*o]) {
                out.iter_mut().zip(part).for_each(|(s, p)| *s += p);
            }
        }
        out
    };
    let changes = |x: &Assessed| varies_between_days(&a.library.variants[x.variant].shape).is_some();
    Day { session, used: &a.used, noise: &a.noise, causes: sum(&|_| true), changing: sum(&changes) }
}

/// Everything that the decision is made from.
fn evidence(session: &Session, a: &Analysis, parts: &Contributions, owner: &[usize]) -> Vec<Evidence> {
    let mut all = assess(&a.problem, &a.library, &a.selection);
    // the control's own encoders see the servo, which depends on no place
    let forms = if a.problem.precise { Vec::new() } else { misform::misforms(session, a, parts, owner) };
    for (e, form) in all.iter_mut().zip(forms) {
        e.figures.misform = form;
    }
    all
}

/// Mean products of what is left out of the fits: of the gap and of what each effect says of it.
fn held_out(session: &Session, a: &Analysis, parts: &Contributions, owner: &[usize]) -> HeldOut {
    let effect = |place: usize| {
        let mut sum = vec![0.0; a.gap.len()];
        for (part, _) in parts.held_out.iter().zip(owner).filter(|(_, o)| **o == place) {
            sum.iter_mut().zip(part).for_each(|(s, p)| *s += p);
        }
        without_offsets(session, &sum, &a.used)
    };
    let gap = without_offsets(session, &a.gap, &a.used);
    let all: Vec<Vec<f64>> = std::iter::once(gap).chain((0..a.selection.chosen.len()).map(effect)).collect();
    HeldOut { products: all.iter().map(|x| all.iter().map(|y| mean_product(x, y)).collect()).collect() }
}

pub(super) fn conclude(
    session: &mut Session,
    fresh: Option<&mut Session>,
    options: &Options,
    a: &Analysis,
    tell: &mut dyn FnMut(f64, &str),
) -> Diagnosis {
    let given = a.problem.given(&a.selection.chosen);
    let beta = a.problem.fit(&given);
    let raw = raw_of(session, &a.library, &a.selection.chosen);
    let mut parts = contributions(session, &a.problem, &given.columns, &beta, (&raw, &a.used));
    if a.comparison.is_some() {
        // few readings: a fold takes the places away that only its own columns see; the posterior states the uncertainty
        parts.held_out.clone_from(&parts.in_sample);
    }
    // place of each column's effect in the selection
    let owner: Vec<usize> = a
        .selection
        .chosen
        .iter()
        .enumerate()
        .flat_map(|(place, v)| std::iter::repeat_n(place, a.problem.span[*v].1))
        .collect();
    tell(0.9, "forecast");
    let mut assessed = match &a.comparison {
        Some(c) => compared::assessed(a, c, &held_out(session, a, &parts, &owner)),
        None if options.ablation.has_gates() => {
            decide(evidence(session, a, &parts, &owner), &held_out(session, a, &parts, &owner))
        }
        None => declare_all(assess(&a.problem, &a.library, &a.selection)),
    };
    bar_length::mark_truncation(session, a, &mut assessed);
    let norm: Vec<f64> = given.columns.iter().map(|j| a.problem.norm[*j]).collect();
    let covariance = given.covariance(&a.problem);
    let mut columns = Columns { raw, parts, owner, beta, covariance, norm, rough: Vec::new(), left_um2: 0.0 };
    let before = without_offsets(session, &a.gap, &a.used);
    let keep: Vec<usize> = assessed.iter().filter(|x| x.is_declared()).map(|x| x.variant).collect();
    let is_declared = |place: usize| assessed[place].is_declared();
    let mut after = columns.left(session, a, is_declared);
    let apart_from_bar = without_offsets(session, &a.without_bar_length(), &a.used);
    let rough = structured::Rough::beside(session, a, &keep, [rms(&apart_from_bar), rms(&after)]);
    if rough.named_um.is_some() {
        columns.join_roughness((session, a, &given), &assessed);
        after = columns.left(session, a, is_declared);
    }
    let chosen = columns.left(session, a, |_| true);
    let undeclared_um2 = (rms(&after).powi(2) - rms(&chosen).powi(2)).max(0.0);
    let Columns { raw, parts, owner, beta, covariance, norm, rough: rough_curves, left_um2 } = columns;
    let rough_left_um =
        if rough_curves.is_empty() { rough.named_um.unwrap_or_default() } else { left_um2.sqrt() };
    let declared = |j: usize| assessed[owner[j]].is_declared();
    let day = day(session, a, &parts, &owner, &assessed);
    let fit = (&beta[..], &covariance[..]);
    let mut shrink = match &a.comparison {
        Some(c) => compared::forecast(session, a, c, &parts, &declared, fit, options.seed),
        None => forecast(&a.problem, &a.gap, &parts, &declared, &day, options.seed),
    };
    let named = structured::named(a, &keep, rough.unnamed_um.is_some());
    let left = structured::left_whitened(a, &keep, &named);
    let y = a.filter.column(&a.gap);
    let total = structure(session, &a.problem, &a.filter.column(&a.without_bar_length()));
    let leftover = structure(session, &a.problem, &left);
    let without_causes = minus(&a.gap, &parts.in_sample, declared);
    let mut causes = causes::causes(session, a, &assessed, &parts, &before, &owner, (&beta, &covariance));
    re_expression::mark(session, a, &options.without, &assessed, &mut causes);
    causes.extend(causes::rejected(a, &causes));
    let noise: Vec<ClassNoise> = a
        .noise
        .iter()
        .zip(&a.reading_um)
        .map(|(n, white_um)| ClassNoise { white_um: *white_um, ..*n })
        .collect();
    // means over several readings show no vibration
    let are_means = a.comparison.as_ref().is_some_and(|c| c.groups.iter().any(|g| g.len() > 1));
    let by_reading = are_means.then(|| Filter::new(session, &noise, &a.used));
    let filter = by_reading.as_ref().unwrap_or(&a.filter);
    let left_of_readings = by_reading.as_ref().map(|f| f.column(&without_causes));
    let rows = by_reading.as_ref().map_or(&a.problem.rows[..], Filter::order);
    let left_of_readings = left_of_readings.as_ref().unwrap_or(&left);
    causes.extend(stochastic::causes(
        &stochastic::Evidence {
            session,
            left_um: &without_causes,
            used: &a.used,
            outlying: &a.outlying,
            lattice_um: &a.lattice_um,
            noise: &noise,
            rows,
            left: left_of_readings,
            beside: &filter.column(&beside_repeats(session, &a.used, &without_causes)),
            rms_um: rms(&before),
        },
        &options.without,
    ));
    if let Some(drift) = unexplained::drift(session, a)
        && causes.iter().all(|c| c.effect != drift.effect)
        && !options.without.iter().any(|w| w.effect == drift.effect)
    {
        causes.push(drift);
    }
    causes.sort_by(|x, y| {
        y.probability
            .total_cmp(&x.probability)
            .then(y.declared.cmp(&x.declared))
            .then(x.label().cmp(&y.label()))
    });
    tell(0.94, "where the gap lies");
    let places = localise(session, &a.problem, &|data, width| a.filter.apply(data, width), &y);
    let mut unexplained = match &a.comparison {
        Some(c) => compared::unexplained(session, a, c, &left, (&assessed, undeclared_um2)),
        None => unexplained(
            session,
            a,
            &assessed,
            (&left, &named),
            (&total, &leftover, rough.unnamed_um),
            (shrink.rms_before_um, shrink.rms_after_um),
        ),
    };
    let slow = cycle(session, rows, left_of_readings, &without_causes);
    let cycle_um2 = unexplained.add_cycle(session, slow, rms(&before));
    // what does not repeat explains nothing of a gap that does
    let any = causes.iter().any(|c| c.declared && c.kind != Kind::Stochastic);
    let is_little = shrink.fraction <= LITTLE;
    let verdict = match (any && !(is_little && a.comparison.is_some()), unexplained.significant) {
        (true, false) if !is_little => Verdict::Explained,
        (true, _) => Verdict::PartlyExplained,
        (false, true) => Verdict::Unexplained,
        (false, false) => Verdict::NoGap,
    };
    if let (Verdict::NoGap, Some(c)) = (verdict, &a.comparison) {
        let because = Reason::Little { shrink: shrink.fraction };
        assessed.iter_mut().for_each(|x| x.withdraw(because));
        for cause in causes.iter_mut().filter(|c| c.declared && c.kind != Kind::Stochastic) {
            (cause.declared, cause.remark) = (false, words(because));
        }
        shrink = compared::forecast(session, a, c, &parts, &|_| false, fit, options.seed);
    }
    let addition = addition(session, a, &assessed, options, (&owner, &beta, &covariance), &rough_curves);
    let mut notes = notes(session);
    notes.extend(structured::notes(a, &assessed, rough.named_um, !rough_curves.is_empty()));
    notes.extend(subtracted_twice(session, a, rms(&before)));
    let discrepancy_um = structured::discrepancy_um(session, a);
    if let (Some(size_um), None) = (discrepancy_um, &a.comparison) {
        notes.push(format!(
            "discrepancy: smooth structure over the volume that no effect of the library describes, {size_um:.2} µm RMS; it counts as \
             noise when effects are compared, and as unexplained in the result"
        ));
    }
    let fresh = fresh.map(|f| {
        notes.extend(not_seen_on(f, a, &assessed));
        let outlying = outliers(f, &f.gap(), &lattices(f));
        if !outlying.is_empty() {
            notes.push(format!(
                "fresh data: {} of {} readings are marked as outliers or lie apart from their repeats or their path; they are left out",
                outlying.len(),
                f.readings.len()
            ));
        }
        let seen = seen_on(f, a, &assessed, (&owner, &beta, &rough_curves), &outlying);
        let fraction = 1.0 - seen.1 / seen.0.max(1e-12);
        Fresh {
            rms_before_um: seen.0,
            rms_after_um: seen.1,
            fraction,
            within_forecast: (shrink.ci90[0]..=shrink.ci90[1]).contains(&fraction),
        }
    });
    let fitted = Fitted::new(&raw, &parts, &owner, (&beta, &covariance), &norm);
    let curves = curves(session, a, &assessed, &fitted);
    let budget = budget(session, a, &assessed, &fitted, (undeclared_um2 + cycle_um2, rough_left_um));
    if unexplained.significant && a.comparison.is_none() {
        // one figure for what stays, as in the budget
        let drift_um = if unexplained::drifting(a).is_empty() { 0.0 } else { budget.drift_um };
        unexplained.rms_um = budget.unexplained_um.hypot(drift_um).max(cycle_um2.sqrt());
    }
    unexplained.rms_um = unexplained.rms_um.min(shrink.rms_after_um);
    let kept = (1.0 - cycle_um2 / rms(&after).powi(2).max(1e-18)).max(LITTLE * LITTLE);
    let programs = programs(session, a, &before, &after);
    let next_measurement = super::next::next(session, &causes, &unexplained, &a.library, options.dialect);
    let report = Report {
        format: "volcomp-gap/1",
        rows: session.rows_read,
        rows_used: a.used.iter().filter(|u| **u).count(),
        is_compared: a.comparison.is_some(),
        discrepancy_um,
        verdict,
        gap: size(session, a, &before, (shrink.rms_after_um, kept)),
        places,
        causes,
        shrink,
        fresh,
        unexplained,
        next_measurement,
        noise: instrument_noise(session, a),
        outlying_readings: outlying(session, a, &minus(&a.gap, &parts.in_sample, |_| true)),
        cannot_be_seen: a
            .library
            .blind
            .iter()
            .map(|b| Unseen { effect: b.label.clone(), because: b.because.clone() })
            .collect(),
        notes,
        seed: options.seed,
    };
    tell(1.0, "done");
    let radius_mm = radius_mm(session);
    Diagnosis { report, addition, curves, before_um: before, after_um: after, budget, programs, radius_mm }
}

/// Mean product of the readings that both know.
pub(super) fn mean_product(a: &[f64], b: &[f64]) -> f64 {
    let (sum, n) = a
        .iter()
        .zip(b)
        .filter(|(a, b)| a.is_finite() && b.is_finite())
        .fold((0.0, 0usize), |(s, n), (a, b)| (s + a * b, n + 1));
    sum / n.max(1) as f64
}

fn notes(session: &Session) -> Vec<String> {
    let mut notes: Vec<String> = session
        .notes
        .iter()
        .map(|n| {
            if n.unidentifiable.is_empty() {
                n.text.clone()
            } else {
                format!("{}; cannot be identified from them: {}", n.text, n.unidentifiable.join(", "))
            }
        })
        .collect();
    if session.setups.len() == 1 {
        notes.push(
            "one set-up only: constant terms (its offset, tilts of a single tool) are not identifiable: absorbed by the mounting"
                .to_owned(),
        );
    }
    let has_repeats = session.readings.iter().any(|r| r.pair.is_some());
    if !has_repeats && is_revisited(session) {
        notes.push(
            "no repeats in one set-up: noise is taken from the same places in other set-ups".to_owned(),
        );
    } else if !has_repeats {
        notes.push(
            "no repeats: noise is taken from neighbouring readings, so probabilities and the unexplained part are rougher"
                .to_owned(),
        );
    }
    notes
}

/// Says that the model may have been subtracted twice: the readings are much smaller than their gap to it (um RMS).
fn subtracted_twice(session: &Session, a: &Analysis, gap_um: f64) -> Option<String> {
    let read: Vec<f64> = session.readings.iter().map(|r| r.deviation_um).collect();
    let read_um = rms(&without_offsets(session, &read, &a.used));
    (read_um < HALF * gap_um).then(|| {
        format!(
            "the deviations ({read_um:.2} µm RMS) are smaller than their gap to the model ({gap_um:.2} µm): was the model at work while they were measured? then diagnose with its geometry alone, without [errors] and [thermal]"
        )
    })
}

/// RMS of the white noise over the readings used, um.
fn white_rms(session: &Session, a: &Analysis) -> f64 {
    let sum: f64 = a.problem.rows.iter().map(|i| a.reading_um[session.readings[*i].instrument].powi(2)).sum();
    (sum / a.problem.len().max(1) as f64).sqrt()
}

/// RMS of the drift over the readings used, um.
fn drift_rms(session: &Session, a: &Analysis) -> f64 {
    let of = |i: &usize| a.noise[session.readings[*i].instrument].drift_um;
    let sum: f64 = a.problem.rows.iter().map(|i| of(i).powi(2)).sum();
    (sum / a.problem.len().max(1) as f64).sqrt()
}

/// The gap beside the noise, of which `kept` of the mean square is no cycle.
fn size(session: &Session, a: &Analysis, before: &[f64], (after_um, kept): (f64, f64)) -> Size {
    let (rms_um, noise_um) = (rms(before), white_rms(session, a) * kept.sqrt());
    // the floor: noise and drift, which nothing that repeats can take away
    let floor = noise_um.hypot(drift_rms(session, a)).min(after_um).min(rms_um);
    Size {
        rms_um,
        noise_um,
        rms_over_noise: rms_um / noise_um,
        floor_um: floor,
        explainable: 1.0 - (floor / rms_um.max(1e-12)).powi(2),
    }
}

fn instrument_noise(session: &Session, a: &Analysis) -> Vec<InstrumentNoise> {
    session
        .instruments
        .iter()
        .zip(&a.noise)
        .zip(&a.reading_um)
        .zip(&a.lattice_um)
        .map(|(((name, n), white_um), step)| InstrumentNoise {
            instrument: name.clone(),
            white_um: *white_um,
            drift_um: n.drift_um,
            drift_s: n.drift_s,
            resolution_um: *step,
        })
        .collect()
}

/// The readings left out; `rest` is the gap without the effects.
fn outlying(session: &Session, a: &Analysis, rest: &[f64]) -> Vec<Outlying> {
    let repeats = from_partners(session, &a.gap, &vec![true; a.gap.len()]);
    let from_fit = residuals(session, rest, &a.used);
    let one = |i: &usize| {
        let (u, repeat) = (session.moments[*i].u, repeats[*i]);
        let axis = u.iamax();
        let (apart_um, from) = if repeat.is_finite() { (repeat, "repeats") } else { (from_fit[*i], "fit") };
        Outlying {
            at: format!("{}:{}", session.files[session.moments[*i].file], session.readings[*i].line),
            along: if u[axis].abs() > NEARLY { ["x", "y", "z"][axis].to_owned() } else { String::new() },
            gap_um: a.gap[*i],
            apart_um,
            apart_from: from.to_owned(),
        }
    };
    a.outlying.iter().take(LISTED).map(one).collect()
}
