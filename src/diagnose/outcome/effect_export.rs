//! What is handed on: the addition with the ranges in which it holds, and what it does to fresh data.

use std::collections::BTreeMap;

use super::super::addition::{Addition, Entry, FORMAT};
use super::super::decision::Assessed;
use super::super::library::Shape;
use super::super::moment::{Signal, Source};
use super::super::noise::all_but;
use super::super::offsets::{rms, without_offsets};
use super::super::session::Session;
use super::super::{Analysis, Options, is_predictable, raw_of, raw_of_shapes};
use super::rough_curves::RoughCurve;

/// Ranges of the data by column.
fn valid(session: &Session) -> BTreeMap<String, [f64; 2]> {
    let mut ranges = BTreeMap::new();
    let mut add = |name: String, values: &mut dyn Iterator<Item = f64>| {
        let range = values
            .filter(|v| v.is_finite())
            .fold(None, |r: Option<[f64; 2]>, v| Some(r.map_or([v, v], |[l, h]| [l.min(v), h.max(v)])));
        if let Some(r) = range {
            ranges.insert(name, r);
        }
    };
    for axis in &session.axes {
        let (i, unit) = (axis.slot(), if axis.is_linear() { 1.0 } else { 180.0 / core::f64::consts::PI });
        add(axis.column(), &mut session.moments.iter().map(|m| m.position[i] * unit));
        if axis.is_linear() {
            add(format!("v{axis}_mm_per_s"), &mut session.moments.iter().map(|m| m.velocity[i]));
            add(format!("a{axis}_mm_per_s2"), &mut session.moments.iter().map(|m| m.acceleration[i]));
        } else {
            add(format!("v{axis}_deg_per_s"), &mut session.moments.iter().map(|m| m.velocity[i] * unit));
        }
    }
    add("tool_length_mm".to_owned(), &mut session.moments.iter().map(|m| m.tool_length_mm));
    for (k, s) in session.signals.iter().enumerate().filter(|(_, s)| s.source.is_logged()) {
        // lagged values stay within those of their source: they stand in for it where it is not there itself
        let same = |other: &Signal| other.source == s.source;
        let plain = session.signals.iter().any(|other| same(other) && other.tau_s == 0.0);
        if plain && s.tau_s > 0.0 {
            continue;
        }
        let per_column = if s.source == Source::Spindle { 1000.0 } else { 1.0 };
        add(s.source.to_string(), &mut session.moments.iter().map(|m| m.signals[k] * per_column));
    }
    ranges
}

/// The ranges of an effect: a polynomial is one of the positions at which readings look along it, and steep beyond.
fn valid_for(shape: &Shape, ranges: &BTreeMap<String, [f64; 2]>) -> BTreeMap<String, [f64; 2]> {
    let mut ranges = ranges.clone();
    if let Shape::Polynomial(curve) = shape
        && let Some([low, high]) = ranges.get_mut(&curve.over.column())
    {
        (*low, *high) = (low.max(curve.centre_mm - curve.half_mm), high.min(curve.centre_mm + curve.half_mm));
    }
    ranges
}

pub(super) fn addition(
    session: &Session,
    a: &Analysis,
    assessed: &[Assessed],
    options: &Options,
    (owner, beta, covariance): (&[usize], &[f64], &[f64]),
    rough_curves: &[(usize, RoughCurve)],
) -> Addition {
    let n = beta.len();
    let ranges = valid(session);
    let effects = assessed
        .iter()
        .enumerate()
        .filter(|(_, x)| x.is_declared() && is_predictable(x.kind))
        .map(|(place, x)| {
            let (at, width) = a.problem.span[x.variant];
            let mine: Vec<usize> = (0..n).filter(|j| owner[*j] == place).take(width).collect();
            let scale = |k: usize| {
                let norm = a.problem.norm[at + k];
                if norm > 0.0 { 1.0 / norm } else { 0.0 }
            };
            let shape = a.library.variants[x.variant].shape.clone();
            let entry = Entry {
                name: x.label.effect.to_owned(),
                subject: x.label.subject.clone(),
                kind: x.kind,
                probability: x.probability,
                confounded_with: x.same.iter().map(ToString::to_string).collect(),
                parameter_names: shape.parameters(),
                values: mine.iter().enumerate().map(|(k, j)| beta[*j] * scale(k)).collect(),
                covariance: mine
                    .iter()
                    .enumerate()
                    .map(|(k, i)| {
                        mine.iter()
                            .enumerate()
                            .map(|(l, j)| covariance[i * n + j] * scale(k) * scale(l))
                            .collect()
                    })
                    .collect(),
                valid: valid_for(&shape, &ranges),
                shape,
            };
            match rough_curves.iter().find(|(of, _)| *of == place) {
                Some((_, curve)) => with_roughness(entry, curve),
                None => entry,
            }
        })
        .collect();
    Addition {
        format: FORMAT.to_owned(),
        machine: options.machine.clone(),
        sense: "actual minus nominal of the tool against the workpiece, in machine axes".to_owned(),
        base: None,
        effects,
    }
}

/// An entry with its roughness as a further parameter, taken for known.
fn with_roughness(mut entry: Entry, curve: &RoughCurve) -> Entry {
    entry.shape = curve.shape.clone().into();
    entry.parameter_names = entry.shape.parameters();
    entry.values.push(curve.roughness_um);
    entry.covariance.iter_mut().for_each(|row| row.push(0.0));
    entry.covariance.push(vec![0.0; entry.values.len()]);
    entry
}

/// Notes on causes that fresh data lack something for, such as a temperature: they are left out of what is seen there.
pub(super) fn not_seen_on(fresh: &mut Session, a: &Analysis, assessed: &[Assessed]) -> Vec<String> {
    for s in a.library.signals() {
        fresh.add_signal(&s);
    }
    let at = |s: &Signal| fresh.signal(s);
    assessed
        .iter()
        .filter(|x| x.is_declared() && is_predictable(x.kind))
        .filter_map(|x| {
            let shape = &a.library.variants[x.variant].shape;
            let lost = fresh.moments.iter().position(|m| !shape.is_known_at(m, &at))?;
            let file = &fresh.files[fresh.moments[lost].file];
            Some(format!(
                "{file}:{}: the fresh data lack what {} needs, so it is left out of the shrink seen there",
                fresh.readings[lost].line, x.label
            ))
        })
        .collect()
}

/// RMS of fresh data without and with the causes declared, beside the readings `outlying`. The length of a ballbar is estimated anew.
pub(super) fn seen_on(
    fresh: &mut Session,
    a: &Analysis,
    assessed: &[Assessed],
    (owner, beta, rough_curves): (&[usize], &[f64], &[(usize, RoughCurve)]),
    outlying: &[usize],
) -> (f64, f64) {
    let gap = fresh.gap();
    let used = all_but(gap.len(), outlying);
    for s in a.library.signals() {
        fresh.add_signal(&s);
    }
    let raw = raw_of(fresh, &a.library, &a.selection.chosen);
    let columns: Vec<usize> = a
        .selection
        .chosen
        .iter()
        .flat_map(|v| a.problem.span[*v].0..a.problem.span[*v].0 + a.problem.span[*v].1)
        .collect();
    let shape = |x: &Assessed| &a.library.variants[x.variant].shape;
    let is_length = |x: &Assessed| matches!(shape(x), Shape::BallbarLength(_));
    let mut after = gap.clone();
    for (j, values) in raw.iter().enumerate() {
        let x = &assessed[owner[j]];
        // the clock and the bar of other files say nothing of this one's
        let foreign = is_length(x) || matches!(shape(x), Shape::ClockSkew { .. });
        let norm = a.problem.norm[columns[j]];
        if x.is_declared() && !foreign && norm > 0.0 {
            for (v, r) in after.iter_mut().zip(values) {
                *v -= beta[j] / norm * r;
            }
        }
    }
    for (_, curve) in rough_curves {
        let columns = raw_of_shapes(fresh, &[&curve.shape.clone().into()]);
        for (v, beyond) in after.iter_mut().zip(columns.last().into_iter().flatten()) {
            *v -= beyond * curve.roughness_um;
        }
    }
    let before = without_offsets(fresh, &gap, &used);
    let mut after = without_offsets(fresh, &after, &used);
    if assessed.iter().any(|x| x.is_declared() && is_length(x)) {
        remove_lengths(fresh, &mut after, &used);
    }
    (rms(&before), rms(&after))
}

/// `left` (um, without offsets) without the length of the bar that is best for each setup of a ballbar.
fn remove_lengths(session: &Session, left: &mut [f64], used: &[bool]) {
    let along: Vec<f64> = session.moments.iter().map(|m| f64::from(u8::from(m.is_ballbar))).collect();
    let along = without_offsets(session, &along, used);
    for setup in 0..session.setups.len() {
        let rows: Vec<usize> =
            (0..left.len()).filter(|i| used[*i] && session.readings[*i].setup == setup).collect();
        let product = |v: &[f64]| rows.iter().map(|i| along[*i] * v[*i]).sum::<f64>();
        let (length_um, weight) = (product(left), product(&along));
        // an arc of a few degrees does not tell a length from an offset
        if weight > 1e-6 * rows.len() as f64 {
            rows.iter().for_each(|i| left[*i] -= length_um / weight * along[*i]);
        }
    }
}
