//! The causes of a report: effects chosen, their parameters and their alternatives.

use std::collections::BTreeMap;

use super::super::Analysis;
use super::super::constants::LEAST_PROBABILITY;
use super::super::decision::{Assessed, HeldOut, decide};
use super::super::forecast::{Contributions, minus};
use super::super::library::{Kind, Label};
use super::super::offsets::{rms, without_offsets};
use super::super::report::{Cause, Tests, Value};
use super::super::session::Session;
use super::rejection_text::remark;

/// Causes of the search, with their alternatives.
pub(super) fn causes(
    session: &Session,
    a: &Analysis,
    assessed: &[Assessed],
    parts: &Contributions,
    before: &[f64],
    owner: &[usize],
    (beta, covariance): (&[f64], &[f64]),
) -> Vec<Cause> {
    let mut all: Vec<Cause> = Vec::new();
    let first = rms(before).max(1e-12);
    for (place, x) in assessed.iter().enumerate() {
        let left = |take: &dyn Fn(usize) -> bool| {
            rms(&without_offsets(session, &minus(&a.gap, &parts.held_out, take), &a.used))
        };
        let mut shrink = 1.0 - left(&|j| owner[j] == place) / first;
        if x.is_declared() && shrink < 0.0 {
            // under a larger cause that goes the other way it counts by what comes back without it
            let declared = |j: usize| assessed[owner[j]].is_declared();
            shrink = ((left(&|j| declared(j) && owner[j] != place) - left(&declared)) / first).min(1.0);
        }
        let mut parameters = parameters(a, x, place, owner, beta, covariance);
        let shape = &a.library.variants[x.variant].shape;
        if let (Some(peak), Some(v)) = (shape.peak(), parameters.get("height_um").copied()) {
            parameters.insert("peak_um".to_owned(), Value { value: peak * v.value, std: peak * v.std });
        }
        for (name, value) in shape.fixed() {
            parameters.insert(name, Value { value, std: 0.0 });
        }
        all.push(cause(x, a, parameters, shrink));
    }
    let mut others: BTreeMap<String, (f64, &Label, &Assessed)> = BTreeMap::new();
    for x in assessed {
        for (label, p) in x.alternatives.iter().filter(|(_, p)| *p >= LEAST_PROBABILITY) {
            let e = others.entry(label.to_string()).or_insert((0.0, label, x));
            if *p > e.0 {
                *e = (*p, label, x);
            }
        }
    }
    for (name, (p, label, instead)) in others {
        if all.iter().any(|c| c.label() == name) {
            continue;
        }
        let at = a.library.labels.iter().position(|l| l == label);
        all.push(Cause {
            effect: label.effect.to_owned(),
            subject: label.subject.clone(),
            kind: at.map_or(Kind::Machine, |l| a.library.kinds[l]),
            probability: p,
            declared: false,
            confounded_with: if instead.same.contains(label) {
                let others = instead.same.iter().filter(|l| *l != label);
                std::iter::once(&instead.label).chain(others).map(ToString::to_string).collect()
            } else {
                Vec::new()
            },
            group_probability: None,
            re_expression_of: Vec::new(),
            sources: Vec::new(),
            parameters: BTreeMap::new(),
            shrink: 0.0,
            remark: format!("alternative to {}", instead.label),
            tests: None,
        });
    }
    all
}

/// What was taken out because it makes readings that were left out worse, unless it is listed already.
pub(super) fn rejected(a: &Analysis, listed: &[Cause]) -> Vec<Cause> {
    let pruned = decide(a.pruned.clone(), &HeldOut::default());
    let is_new = |x: &Assessed| listed.iter().all(|c| c.label() != x.label.to_string());
    pruned.iter().filter(|x| is_new(x)).map(|x| cause(x, a, BTreeMap::new(), 0.0)).collect()
}

/// A cause of the report.
fn cause(x: &Assessed, a: &Analysis, parameters: BTreeMap<String, Value>, shrink: f64) -> Cause {
    let signals = a.library.variants[x.variant].shape.signals();
    let logged = signals.iter().filter(|s| s.source.is_logged());
    let mut sources: Vec<String> = logged.map(|s| s.source.to_string()).collect();
    sources.dedup();
    Cause {
        effect: x.label.effect.to_owned(),
        subject: x.label.subject.clone(),
        kind: x.kind,
        probability: x.probability,
        declared: x.is_declared(),
        confounded_with: x.same.iter().map(ToString::to_string).collect(),
        group_probability: (!x.same.is_empty()).then_some(x.group_probability),
        re_expression_of: Vec::new(),
        sources,
        parameters,
        shrink,
        remark: remark(x),
        tests: Some(tests(x, a)),
    }
}

fn tests(x: &Assessed, a: &Analysis) -> Tests {
    Tests {
        evidence: x.found.evidence,
        threshold: a.selection.threshold,
        between: x.figures.between,
        misform: x.figures.misform,
        varies: x.figures.varies,
        held_out: x.figures.held_out,
        against: x.figures.against,
        breadth: x.figures.breadth,
        share: x.share,
    }
}

fn parameters(
    a: &Analysis,
    x: &Assessed,
    place: usize,
    owner: &[usize],
    beta: &[f64],
    covariance: &[f64],
) -> BTreeMap<String, Value> {
    let names = a.library.variants[x.variant].shape.parameters();
    let (at, _) = a.problem.span[x.variant];
    let n = beta.len();
    let mine: Vec<usize> = (0..n).filter(|j| owner[*j] == place).collect();
    let scale = |k: usize| {
        let norm = a.problem.norm[at + k];
        if norm > 0.0 { 1.0 / norm } else { 0.0 }
    };
    let value = |k: usize| beta[mine[k]] * scale(k);
    let product = |k: usize, l: usize| covariance[mine[k] * n + mine[l]] * scale(k) * scale(l);
    let names = &names[..names.len().min(mine.len())];
    let each = (0..names.len()).map(|k| {
        let std = product(k, k).max(0.0).sqrt();
        (names[k].clone(), Value { value: value(k), std })
    });
    let amplitudes = (0..names.len()).filter_map(|k| {
        let (name, sin) = amplitude_of(&names[k])?;
        let l = names.iter().position(|n| *n == sin)?;
        let (c, s) = (value(k), value(l));
        let amplitude = c.hypot(s);
        let variance = c * c * product(k, k) + 2.0 * c * s * product(k, l) + s * s * product(l, l);
        let std = variance.max(0.0).sqrt() / amplitude.max(f64::MIN_POSITIVE);
        Some((name, Value { value: amplitude, std }))
    });
    each.chain(amplitudes).collect()
}

/// Names of the amplitude and of the sine that belong to the cosine of a harmonic: `cos2_um` has `sin2_um`.
fn amplitude_of(cos: &str) -> Option<(String, String)> {
    let (harmonic, unit) = cos.strip_prefix("cos")?.split_once('_')?;
    let is_plain = !unit.contains('_') && harmonic.bytes().all(|b| b.is_ascii_digit());
    let name = match harmonic {
        "" | "1" => format!("amplitude_{unit}"),
        _ => format!("harmonic_{harmonic}_amplitude_{unit}"),
    };
    is_plain.then(|| (name, format!("sin{harmonic}_{unit}")))
}
