//! Causes, forecast and remainder where all sets of effects were compared by their evidence.

use nalgebra::{DMatrix, DVector};

use super::super::Analysis;
use super::super::constants::{DRAWS, LARGE_DRIFT, LENGTHS, LITTLE};
use super::super::decision::{Assessed, Cost, Evidence, HeldOut, Reason, decide_by_posterior};
use super::super::evidence::{Comparison, Component, Contender};
use super::super::forecast::{Contributions, minus};
use super::super::library::Label;
use super::super::localise::localise;
use super::super::noise::{Random, spacing};
use super::super::offsets::{peak99, rms, without_offsets};
use super::super::prediction_interval::{DAY_FACTORS, varies_between_days};
use super::super::report::{Shrink, Unexplained};
use super::super::search::{Figures, Found};
use super::super::session::Session;
use super::mean_product;

/// The members of the likeliest set, in the order of the selection.
pub(super) fn assessed(a: &Analysis, c: &Comparison, left: &HeldOut) -> Vec<Assessed> {
    let label = |l: usize| a.library.labels[l].clone();
    let chosen: Vec<&Contender> = c.contenders.iter().filter(|x| x.chosen).collect();
    let evidence = |x: &Contender| {
        let mut same: Vec<Label> = Vec::new();
        let rivals = x.rivals.iter().map(|(r, _)| *r).chain(x.sums.iter().flatten().copied());
        for l in x.aliases.iter().copied().chain(rivals).map(label) {
            if !same.contains(&l) {
                same.push(l);
            }
        }
        let shape = &a.library.variants[x.variant].shape;
        same.extend(a.library.behind(shape).cloned());
        // from which line a table is counted is a choice
        let scale = shape.holds_scale_of().map(|axis| Label::new("scale", axis));
        same.extend(scale.filter(|l| a.library.labels.contains(l) && !same.contains(l)));
        let relative = |(r, p): &(usize, f64)| (label(*r), p / x.probability.max(f64::MIN_POSITIVE));
        Evidence {
            variant: x.variant,
            label: label(x.label),
            kind: a.library.kinds[x.label],
            found: Found {
                variant: x.variant,
                gain: 2.0 * x.log_evidence.max(0.0),
                rank: a.problem.span[x.variant].1,
                evidence: 2.0 * x.log_evidence,
            },
            figures: Figures::UNASKED,
            same,
            sums: x.sums.iter().map(|pair| pair.map(label)).collect(),
            share: x.probability,
            group_share: x.group_probability,
            rivals: x.rivals.iter().map(relative).collect(),
            is_pruned: false,
        }
    };
    let members = chosen.iter().map(|x| (evidence(x), *x)).collect();
    let mut all = decide_by_posterior(members, left, c.discrepancy);
    // whatever else some likely set holds is listed beside the likeliest effect
    let known: Vec<Label> = all.iter().flat_map(|x| &x.alternatives).map(|(l, _)| l.clone()).collect();
    let others = c.contenders.iter().filter(|x| !x.chosen).map(|x| (label(x.label), x.probability));
    let likeliest = all.iter_mut().reduce(|best, x| if x.probability > best.probability { x } else { best });
    if let Some(first) = likeliest {
        // in its place they are doubted as it is
        let real = first.probability / first.share.max(f64::MIN_POSITIVE);
        first.alternatives.extend(others.filter(|(l, _)| !known.contains(l)).map(|(l, p)| (l, real * p)));
    }
    all
}

/// The forecast for new data of the same program, from the posterior: what is no cause comes again, in another course.
pub(super) fn forecast(
    session: &Session,
    a: &Analysis,
    c: &Comparison,
    parts: &Contributions,
    take: &dyn Fn(usize) -> bool,
    (beta, covariance): (&[f64], &[f64]),
    seed: u64,
) -> Shrink {
    let before = without_offsets(session, &a.gap, &a.used);
    let left = without_offsets(session, &minus(&a.gap, &parts.in_sample, take), &a.used);
    let n = beta.len();
    let taken: Vec<usize> = (0..n).filter(|j| take(*j)).collect();
    let columns: Vec<Vec<f64>> = taken
        .iter()
        .map(|j| {
            let unit: Vec<f64> = parts.in_sample[*j].iter().map(|v| v / nonzero(beta[*j])).collect();
            without_offsets(session, &unit, &a.used)
        })
        .collect();
    let k = taken.len();
    let gram = DMatrix::from_fn(k, k, |i, j| mean_product(&columns[i], &columns[j]));
    let own = DMatrix::from_fn(k, k, |i, j| covariance[taken[i] * n + taken[j]]);
    let mean = DVector::from_iterator(k, taken.iter().map(|j| beta[*j]));
    // what the fit took of the noise is missing in what is left
    let fit_um2 = (&gram * &own).trace().max(0.0);
    let rest_um2 = rms(&left).powi(2) + fit_um2;
    let named_um2 = (mean.transpose() * &gram * &mean)[(0, 0)].max(0.0);
    let shrink =
        |rest: f64, error: f64, named: f64| 1.0 - ((rest + error) / (rest + named).max(1e-300)).sqrt();
    let rms_before = rms(&before);
    // against the gap that was seen: drift may have hidden a part of the effects, or shown more of them
    let fraction = if k == 0 { 0.0 } else { 1.0 - (rest_um2 + fit_um2).sqrt() / rms_before.max(1e-12) };
    let shift = fraction - shrink(rest_um2, fit_um2, named_um2);
    let ci90 = if k == 0 {
        [0.0, 0.0]
    } else {
        let half = own.clone().symmetric_eigen();
        let root = &half.eigenvectors * DMatrix::from_diagonal(&half.eigenvalues.map(|v| v.max(0.0).sqrt()));
        let mut random = Random::new(seed ^ 0x9057);
        // few independent readings: another run's drift and discrepancy may be larger or smaller
        let scatter = (2.0 / c.effective.max(2.0)).sqrt();
        let of_columns = a.selection.chosen.iter().flat_map(|v| std::iter::repeat_n(v, a.problem.span[*v].1));
        let varying: Vec<Option<usize>> =
            of_columns.map(|v| varies_between_days(&a.library.variants[*v].shape)).collect();
        let is_steady = taken.iter().all(|j| varying[*j].is_none());
        let mut draws: Vec<f64> = (0..DRAWS)
            .map(|_| {
                let error = &root * DVector::from_fn(k, |_, _| random.normal());
                let [least, most] = DAY_FACTORS;
                let mut factor = || if is_steady { 1.0 } else { least + (most - least) * random.uniform() };
                let factors = [factor(), factor()];
                let on_the_day = |v: DVector<f64>| {
                    DVector::from_fn(k, |i, _| varying[taken[i]].map_or(1.0, |what| factors[what]) * v[i])
                };
                let (truth, error) = (on_the_day(&mean + &error), on_the_day(error));
                let square = |v: &DVector<f64>| (v.transpose() * &gram * v)[(0, 0)].max(0.0);
                let rest = rest_um2 * (scatter * random.normal()).exp();
                shrink(rest, square(&error), square(&truth))
            })
            .collect();
        draws.sort_by(f64::total_cmp);
        let [low, high] = [draws[DRAWS / 20], draws[DRAWS - 1 - DRAWS / 20]].map(|d| d + shift);
        [low.min(fraction), high.max(fraction).min(1.0)]
    };
    Shrink {
        rms_before_um: rms_before,
        rms_after_um: rms_before * (1.0 - fraction),
        fraction,
        ci90,
        how: "posterior of the effects, drift and discrepancy".to_owned(),
        in_sample_fraction: if k == 0 { 0.0 } else { 1.0 - rms(&left) / rms_before.max(1e-12) },
        peak99_before_um: peak99(&before),
        peak99_after_um: peak99(&left),
    }
}

fn nonzero(v: f64) -> f64 {
    if v == 0.0 { f64::INFINITY } else { v }
}

/// What no effect explains, with what several effects explain alike (`undeclared_um2`).
pub(super) fn unexplained(
    session: &Session,
    a: &Analysis,
    c: &Comparison,
    left: &[f64],
    (assessed, undeclared_um2): (&[Assessed], f64),
) -> Unexplained {
    let drifts = c.scales.iter().any(|(k, scale)| !k.is_discrepancy() && *scale > LARGE_DRIFT);
    let finer_um2 = c.finer_um2();
    let discrepant = c.discrepancy > 1.0 - LITTLE && c.shares.discrepancy_um2 > 0.0;
    let s = &c.shares;
    let drift_um2 = if drifts { s.drift_um2 } else { 0.0 };
    let whole = s.named_um2 + s.discrepancy_um2 + s.drift_um2;
    let is_undecided = undeclared_um2 > LITTLE * whole;
    let significant = discrepant || drifts || is_undecided || finer_um2 > 0.0;
    let structured =
        s.discrepancy_um2 + finer_um2 + drift_um2 + if is_undecided { undeclared_um2 } else { 0.0 };
    let whiten = |data: &mut [f64], width: usize| a.problem.whiten(&a.filter, data, width);
    let places = if significant { localise(session, &a.problem, &whiten, left) } else { Vec::new() };
    let mut words = Vec::new();
    let mut is_pointwise = false;
    if discrepant {
        let over =
            |wanted: &dyn Fn(&Component) -> bool| c.scales.iter().any(|(k, scale)| *scale > 0.0 && wanted(k));
        let mut kinds = Vec::new();
        if over(&|k| matches!(k, Component::LackOfFit)) {
            kinds.push("comes back at each programmed point");
        }
        // of places further apart than it reaches, neighbours share nothing
        let spacing = spacing(session);
        let smooth = |k: &Component| matches!(k, Component::Place(l) if LENGTHS[*l] > spacing);
        if over(&smooth) {
            kinds.push("varies smoothly over the place");
        } else if over(&|k| matches!(k, Component::Place(_))) {
            kinds.push("differs from place to place without a shape that neighbours share");
        }
        if over(&|k| matches!(k, Component::Direction(_))) {
            kinds.push("depends on place and direction of travel");
        }
        if over(&|k| matches!(k, Component::Speed(_))) {
            kinds.push("depends on place and velocity");
        }
        is_pointwise = kinds.len() == 1 && over(&|k| matches!(k, Component::LackOfFit));
        let values = format!(
            ": a value for each point and direction leaves {:.2} µm at these points; between them nothing is known",
            (s.drift_um2 + s.noise_um2).sqrt()
        );
        words.push(format!(
            "a discrepancy of {:.2} µm RMS that {}{}",
            s.discrepancy_um2.sqrt(),
            if kinds.is_empty() { "is of no effect established".to_owned() } else { kinds.join(" and ") },
            if is_pointwise { &values } else { "" }
        ));
    }
    if finer_um2 > 0.0 {
        words.push(format!(
            "{:.2} µm RMS that change faster than the {} means compared, while readings that follow each other scatter by {:.2} µm",
            finer_um2.sqrt(),
            c.groups.len(),
            c.reading_um()
        ));
    }
    if is_undecided {
        let is_aliased =
            |x: &Assessed| matches!(x.reason, Some(Reason::Improbable { cost: Cost::Discrepancy(_), .. }));
        let of = |aliased: bool, alternative: &str| {
            let open = assessed.iter().filter(|x| !x.is_declared() && is_aliased(x) == aliased);
            let names: Vec<String> = open.map(|x| format!("{} ({:.2})", x.label, x.probability)).collect();
            (!names.is_empty()).then(|| format!("{} or {alternative}", names.join(", ")))
        };
        let open = [of(true, "a part of the discrepancy"), of(false, "what stands for it")];
        words.push(format!(
            "{:.2} µm RMS of an effect whose name these data leave open: {}",
            undeclared_um2.sqrt(),
            open.into_iter().flatten().collect::<Vec<_>>().join("; ")
        ));
    }
    if drifts {
        let time = if c.drift.1 > 0.0 {
            format!(" over {}", session.span(c.drift.1))
        } else {
            " from cycle to cycle".to_owned()
        };
        let temperature = if session.temperatures.is_empty() {
            "without a temperature"
        } else {
            "because no temperature of these data correlates with what is left"
        };
        words.push(format!(
            "slow drift of {:.2} µm RMS{time}, of unknown source: machine, instrument and air are not distinguishable {temperature}",
            s.drift_um2.sqrt()
        ));
    }
    Unexplained {
        significant,
        rms_um: structured.sqrt(),
        share: if significant { (structured / whole.max(1e-12)).clamp(0.0, 1.0) } else { 0.0 },
        z: 0.0,
        looks_like: if words.is_empty() { "nothing above the noise".to_owned() } else { words.join("; ") },
        places,
        is_pointwise,
    }
}
