//! Fitted effects over the quantity they depend on, with their band, for pictures.
//!
//! A picture shows the effect as fitted plus the residual of each reading (a component-plus-residual plot). The mean over the
//! readings is set to zero, because the offsets of the mountings absorb it. The band is 90 % of the posterior of the
//! parameters, of the curve against that mean.

use std::collections::BTreeMap;

use super::super::Analysis;
use super::super::constants::{HALF, LITTLE, NINETY};
use super::super::decision::Assessed;
use super::super::moment::{Axis, Moment};
use super::super::noise::Random;
use super::super::report::Value;
use super::super::session::Session;
use super::views::View;
use super::{Curve, Fitted, FittedLine};

/// Points of a picture at most.
const POINTS: usize = 600;
/// Values of the abscissa that are drawn as they are; more are averaged in so many groups of equal size.
const GROUPS: usize = 48;
/// Least component of the direction of measurement along the direction drawn.
const ALONG: f64 = 0.7;
/// Scatter of the fitted values about their line, as a share of the effect, that is worth a note.
const SCATTER_NOTED: f64 = 0.25;
/// Lever at which an arcsecond is a micrometre, mm.
const ARCSEC_LEVER_MM: f64 = 206.264_806;
/// Lines of a picture at most.
const LINES: usize = 3;

/// A reading of a picture: its index, abscissa, factor from um along `u` to the ordinate, and line.
struct Shown {
    at: usize,
    x: f64,
    factor: f64,
    line: i64,
}

pub(super) fn curves(
    session: &Session,
    a: &Analysis,
    assessed: &[Assessed],
    fitted: &Fitted<'_>,
) -> Vec<Curve> {
    let mut random = Random::new(1);
    let declared: Vec<bool> = assessed.iter().map(|x| x.is_declared()).collect();
    let mut all = Vec::new();
    for (place, x) in assessed.iter().enumerate() {
        let shape = &a.library.variants[x.variant].shape;
        let view = View::of(shape);
        let residual = fitted.residual(session, a, |o| declared[o] || o == place);
        let effect = fitted.effect(place);
        for direction in directions(session, &view, &effect) {
            let (shown, weight) = shown(session, &view, direction, &residual, &effect);
            if shown.is_empty() {
                continue;
            }
            let mut curve = curve(session, fitted, place, &shown, &residual, &mut random);
            curve.label = x.label.to_string();
            curve.x_label = view.x_label();
            curve.unit = if view.is_rotation() { "″" } else { "µm" };
            curve.y_label = match direction {
                _ if view.is_rotation() => "rotation, ″".to_owned(),
                Some(d) => format!("along {}, µm", Axis::LINEAR[d]),
                None => "in measuring direction, µm".to_owned(),
            };
            let scaled = view.weight_text().zip(weight).map(|(text, w)| text.replace("{}", &w.to_string()));
            let notes = [scaled.unwrap_or_default(), view.end_text().to_owned(), curve.note];
            curve.note = notes.into_iter().filter(|n| !n.is_empty()).collect::<Vec<_>>().join("; ");
            all.push(curve);
        }
    }
    all
}

/// Directions of which each gets a picture: one, or those in which the effect is seen.
fn directions(session: &Session, view: &View, effect: &[f64]) -> Vec<Option<usize>> {
    if view.along.is_some() || view.is_along_u {
        return vec![view.along];
    }
    let energy = |d: usize| -> f64 {
        let seen = session.moments.iter().zip(effect).filter(|(m, _)| m.u[d].abs() > ALONG);
        seen.map(|(_, e)| e * e).sum()
    };
    let all = [0, 1, 2].map(energy);
    let least = LITTLE * all.iter().sum::<f64>();
    (0..3).filter(|d| all[*d] > least.max(1e-12)).map(Some).collect()
}

/// The readings that show an effect in a direction, and the weight that is drawn.
fn shown(
    session: &Session,
    view: &View,
    direction: Option<usize>,
    residual: &[f64],
    effect: &[f64],
) -> (Vec<Shown>, Option<f64>) {
    let share = |m: &Moment| view.component(m, direction);
    let weights: Vec<f64> = session.moments.iter().map(|m| view.weight(m, session)).collect();
    let reference = view.is_weighted().then(|| {
        let mut sizes: Vec<f64> =
            weights.iter().map(|w| w.abs()).filter(|w| w.is_finite() && *w > 1e-9).collect();
        sizes.sort_by(f64::total_cmp);
        rounded(sizes.get(sizes.len() / 2).copied().unwrap_or(1.0))
    });
    let weight = reference.unwrap_or(1.0);
    let drawn = if view.is_rotation() { ARCSEC_LEVER_MM } else { weight };
    let lines = view.lines(session);
    let shown = session
        .moments
        .iter()
        .enumerate()
        .filter(|(i, m)| {
            residual[*i].is_finite()
                && effect[*i] != 0.0
                && share(m).abs() > ALONG
                && weights[*i].abs() >= HALF * weight
        })
        .map(|(at, m)| Shown { at, x: view.x(m), factor: drawn / (weights[at] * share(m)), line: lines[at] })
        .filter(|s| s.x.is_finite() && s.factor.is_finite())
        .collect();
    (shown, reference)
}

/// Two significant figures.
fn rounded(v: f64) -> f64 {
    let power = 10f64.powf(v.abs().max(1e-12).log10().floor() - 1.0);
    let digits = (-power.log10()).ceil().max(0.0) as usize;
    format!("{:.digits$}", (v / power).round() * power).parse().unwrap_or(v)
}

fn curve(
    session: &Session,
    fitted: &Fitted<'_>,
    place: usize,
    shown: &[Shown],
    residual: &[f64],
    random: &mut Random,
) -> Curve {
    let columns = fitted.columns_of(place);
    let rows: Vec<Vec<f64>> =
        shown.iter().map(|s| columns.iter().map(|j| fitted.raw[*j][s.at] * s.factor).collect()).collect();
    let centre = mean(rows.iter(), columns.len());
    let value = |h: &[f64]| fitted.value(&columns, &less(h, &centre));
    let of_row: Vec<f64> = rows.iter().map(|h| value(h)).collect();
    let mut lines: BTreeMap<i64, Vec<usize>> = BTreeMap::new();
    for (k, s) in shown.iter().enumerate() {
        lines.entry(s.line).or_default().push(k);
    }
    let (mut drawn, mut low, mut high) = (Vec::new(), None, None);
    let mut scatter = 0.0;
    for (line, members) in lines {
        let mut points: Vec<[f64; 4]> = Vec::new();
        for group in groups(shown, members) {
            let h = mean(group.iter().map(|k| &rows[*k]), columns.len());
            let x = group.iter().map(|k| shown[*k].x).sum::<f64>() / group.len() as f64;
            let (fit, half) = (value(&h), NINETY * fitted.std(&columns, &less(&h, &centre)));
            scatter += group.iter().map(|k| (of_row[*k] - fit).powi(2)).sum::<f64>();
            if low.as_ref().is_none_or(|(v, _)| fit < *v) {
                low = Some((fit, h.clone()));
            }
            if high.as_ref().is_none_or(|(v, _)| fit > *v) {
                high = Some((fit, h));
            }
            points.push([x, fit, fit - half, fit + half]);
        }
        let fits = points.iter().map(|p| p[1]);
        let [least, most] = fits.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, m], v| [l.min(v), m.max(v)]);
        drawn.push((most - least, FittedLine { name: View::line_name(session, line), points }));
    }
    // what changes most is drawn, in the order of the files
    let mut spans: Vec<f64> = drawn.iter().map(|(span, _)| *span).collect();
    spans.sort_by(|a, b| b.total_cmp(a));
    let least = spans.get(LINES - 1).copied().unwrap_or(f64::NEG_INFINITY);
    let drawn: Vec<FittedLine> =
        drawn.into_iter().filter(|(span, _)| *span >= least).take(LINES).map(|(_, line)| line).collect();
    let range = low.zip(high).map_or(Value { value: 0.0, std: 0.0 }, |((l, hl), (h, hh))| Value {
        value: h - l,
        std: fitted.std(&columns, &less(&hh, &hl)),
    });
    let energy: f64 = of_row.iter().map(|v| v * v).sum();
    let note = if scatter > SCATTER_NOTED.powi(2) * energy {
        "depends on other quantities, too: the line is the mean over the readings"
    } else {
        ""
    };
    let share = POINTS as f64 / shown.len() as f64;
    let points = shown
        .iter()
        .zip(&of_row)
        .filter(|_| random.uniform() < share)
        .map(|(s, fit)| [s.x, fit + residual[s.at] * s.factor, *fit])
        .collect();
    Curve {
        label: String::new(),
        x_label: String::new(),
        y_label: String::new(),
        points,
        lines: drawn,
        range,
        unit: "µm",
        readings: shown.len(),
        note: note.to_owned(),
    }
}

/// Readings of equal abscissa, or neighbouring ones where there are many values, in the order of the abscissa.
fn groups(shown: &[Shown], mut members: Vec<usize>) -> Vec<Vec<usize>> {
    members.sort_by(|a, b| shown[*a].x.total_cmp(&shown[*b].x));
    let extent = members.last().map_or(0.0, |l| shown[*l].x) - members.first().map_or(0.0, |f| shown[*f].x);
    let mut equal: Vec<Vec<usize>> = Vec::new();
    for k in &members {
        match equal.last_mut() {
            Some(group) if shown[*k].x - shown[group[0]].x <= 1e-3 * extent => group.push(*k),
            _ => equal.push(vec![*k]),
        }
    }
    if equal.len() <= GROUPS {
        return equal;
    }
    members.chunks(members.len().div_ceil(GROUPS)).map(<[usize]>::to_vec).collect()
}

fn mean<'a>(rows: impl Iterator<Item = &'a Vec<f64>>, width: usize) -> Vec<f64> {
    let mut sum = vec![0.0; width];
    let mut n = 0.0;
    for row in rows {
        sum.iter_mut().zip(row).for_each(|(s, v)| *s += v);
        n += 1.0;
    }
    sum.into_iter().map(|s| s / f64::max(n, 1.0)).collect()
}

fn less(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}
