//! The charts of the page.

use crate::prelude::*;
use crate::report::chart::{Chart, HALF, Ink, Labels, Mark, key};
use crate::report::page::escape;
use volcomp_diagnose::session::Session;
use volcomp_diagnose::{Curve, Diagnosis};

use crate::diagnose::terms::{capital, name_of_label};

/// Readings of a chart, at most.
const POINTS: usize = 700;
/// Least component of the direction of measurement along an axis.
const ALONG: f64 = 0.7;
/// Letters of the directions.
const LETTERS: [&str; 3] = ["x", "y", "z"];

/// Legend of a bar before correction.
pub(super) const BEFORE_KEY: &str = "<span class=\"key\"><i class=\"bar g\"></i> before</span>";
/// Legend of a bar after correction.
pub(super) const AFTER_KEY: &str = "<span class=\"key\"><i class=\"bar a\"></i> after</span>";

/// Readings along one direction, or oblique ones.
type Series = (Option<usize>, Vec<(f64, f64)>);
/// A chart with its caption, both markup.
pub(super) type Figure = (String, String);

/// Two bars, one above the other, as shares of the largest.
pub(super) fn before_and_after_bar(before: f64, after: f64) -> String {
    let [before, after] = [before, after].map(|v| 100.0 * v.clamp(0.0, 1.0));
    format!(
        "<span class=\"pair\"><i class=\"bar g\" style=\"width:{before:.1}%\"></i><i class=\"bar a\" style=\"width:{after:.1}%\"></i></span>"
    )
}

fn caption(title: &str, keys: &[String], note: &str) -> String {
    let note = if note.is_empty() { String::new() } else { format!(" {}.", escape(&capital(note))) };
    format!("<b>{}</b>{} {}", escape(title), note, keys.join(" "))
}

/// An effect as fitted over its readings.
pub(super) fn fitted(curve: &Curve) -> Figure {
    let title = capital(&name_of_label(&curve.label));
    let lines = || curve.lines.iter().flat_map(|l| l.points.iter());
    let mut chart = Chart::new(
        HALF,
        Labels { title: &title, x: &curve.x_label, y: &curve.y_label },
        curve.points.iter().map(|p| p[0]).chain(lines().map(|p| p[0])),
        curve.points.iter().map(|p| p[1]).chain(lines().flat_map(|p| [p[2], p[3]])),
    );
    chart.marks(Mark::Dot, Ink::Grey, curve.points.iter().map(|p| (p[0], p[1])));
    let drawn = curve.points.len();
    let readings = if drawn < curve.readings {
        format!("{drawn} of {}", counted(curve.readings, "reading"))
    } else {
        counted(drawn, "reading")
    };
    let mut keys = vec![key(Mark::Dot, Ink::Grey, &readings)];
    for (line, ink) in curve.lines.iter().zip(Ink::LINES) {
        for stretch in stretches(&line.points, curve.x_label.starts_with("time, ")) {
            let band: Vec<[f64; 3]> = stretch.iter().map(|p| [p[0], p[2], p[3]]).collect();
            let middle = stretch.iter().map(|p| (p[0], p[1]));
            chart.band(ink, &band);
            if stretch.len() == 1 {
                chart.marks(Mark::Cross, ink, middle);
            } else {
                chart.line(ink, middle);
            }
        }
        let name = if line.name.is_empty() { "fitted" } else { file_name(&line.name) };
        keys.push(key(Mark::Line, ink, name));
    }
    keys.push(key(Mark::Band, Ink::Blue, "90 % band"));
    (chart.finish(), caption(&title, &keys, &curve.note))
}

/// Parts of a line over time between which nothing was measured for long: nothing is drawn there. Other lines are whole.
fn stretches(points: &[[f64; 4]], is_time: bool) -> Vec<&[[f64; 4]]> {
    if !is_time {
        return vec![points];
    }
    let extent = points.last().zip(points.first()).map_or(0.0, |(l, f)| l[0] - f[0]);
    let least = (0.15 * extent).max(5.0 * extent / points.len().max(1) as f64);
    points.chunk_by(|a, b| b[0] - a[0] <= least).collect()
}

/// A path without its folders.
pub(super) fn file_name(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or(path)
}

/// The gap as measured over the gap that the declared causes predict, each without the set-up offsets.
pub(super) fn measured_and_predicted(found: &Diagnosis) -> Option<Figure> {
    let both = found.before_um.iter().zip(&found.after_um).filter(|(b, a)| b.is_finite() && a.is_finite());
    let points = thinned(&both.map(|(b, a)| (b - a, *b)).collect::<Vec<_>>());
    if points.len() < 2 {
        return None;
    }
    let (title, x, y) = ("Measured against predicted", "gap predicted by the causes, µm", "gap measured, µm");
    let (xs, ys) = (points.iter().map(|p| p.0), points.iter().map(|p| p.1));
    let mut chart = Chart::new(HALF, Labels { title, x, y }, xs, ys);
    chart.marks(Mark::Dot, Ink::Blue, points.iter().copied());
    let [low, high] = chart.shared_range();
    chart.reference([(low, low), (high, high)]);
    let keys = [
        key(Mark::Dot, Ink::Blue, &counted(points.len(), "reading")),
        key(Mark::Reference, Ink::Text, "measured = predicted"),
    ];
    // the comparison of few readings fits all of them
    let how = if found.report.is_compared { "" } else { "each reading predicted from the others" };
    Some((chart.finish(), caption(title, &keys, how)))
}

/// The gap before and after over time and over each axis that moves.
pub(super) fn residuals(session: &Session, found: &Diagnosis) -> Vec<Figure> {
    let mut figures = Vec::new();
    let times: Vec<f64> = session.moments.iter().map(|m| m.t_s).collect();
    if session.is_ordinal() {
        // no duration holds: the order is all there is
        let order: Vec<f64> = (1..=times.len()).map(|k| k as f64).collect();
        figures.extend(residual(session, found, ("the order measured", "number of the reading", &order)));
    }
    let span = extent(&times);
    let (factor, unit) = if span > 10_800.0 {
        (3600.0, "h")
    } else if span > 300.0 {
        (60.0, "min")
    } else {
        (1.0, "s")
    };
    let times: Vec<f64> = times.iter().map(|t| t / factor).collect();
    let clock = if session.files.len() > 1 { ", on the clock of each file" } else { "" };
    if !session.is_ordinal() {
        figures.extend(residual(session, found, ("time", &format!("time{clock}, {unit}"), &times)));
    }
    for axis in &session.axes {
        let slot = axis.slot();
        let letter = axis.to_string().to_uppercase();
        let (unit, of): (_, fn(f64) -> f64) =
            if axis.is_linear() { ("mm", |v| v) } else { ("°", f64::to_degrees) };
        let values: Vec<f64> = session.moments.iter().map(|m| of(m.position[slot])).collect();
        figures.extend(residual(session, found, (&letter, &format!("{letter}, {unit}"), &values)));
    }
    figures
}

fn extent(values: &[f64]) -> f64 {
    let [low, high] = hull(values.iter().copied().filter(|v| v.is_finite()));
    if high > low { high - low } else { 0.0 }
}

/// Over what, the label of its axis, and its values.
type Abscissa<'a> = (&'a str, &'a str, &'a [f64]);

fn residual(session: &Session, found: &Diagnosis, (over, x_label, values): Abscissa<'_>) -> Option<Figure> {
    if extent(values) <= 1e-9 {
        return None;
    }
    let along = |direction: Option<usize>, gap: &[f64]| -> Vec<(f64, f64)> {
        let rows = values.iter().zip(gap).zip(&session.moments);
        rows.filter(|((v, g), _)| v.is_finite() && g.is_finite())
            .filter_map(|((v, g), m)| {
                let main = (0..3).find(|d| m.u[*d].abs() > ALONG);
                (main == direction).then(|| (*v, g * main.map_or(1.0, |d| m.u[d].signum())))
            })
            .collect()
    };
    let is_gap = found.budget.names_no_cause();
    let all = [Some(0), Some(1), Some(2), None];
    let before: Vec<(f64, f64)> =
        thinned(&all.iter().flat_map(|d| along(*d, &found.before_um)).collect::<Vec<_>>());
    let after: Vec<Series> =
        all.iter().map(|d| (*d, along(*d, &found.after_um))).filter(|(_, p)| !p.is_empty()).collect();
    let most = POINTS / after.len().max(1);
    let after: Vec<Series> = after.into_iter().map(|(d, p)| (d, thinned_to(&p, most))).collect();
    let shown = || before.iter().filter(|_| !is_gap).chain(after.iter().flat_map(|(_, p)| p));
    if shown().count() < 2 {
        return None;
    }
    let what = if is_gap { "gap" } else { "residual" };
    let title = capital(&format!("{what} over {over}"));
    let labels = Labels { title: &title, x: x_label, y: &format!("{what}, µm") };
    let mut chart = Chart::new(HALF, labels, shown().map(|p| p.0), shown().map(|p| p.1));
    let mut keys = Vec::new();
    if !is_gap {
        chart.marks(Mark::Dot, Ink::Grey, before.iter().copied());
        keys.push(key(Mark::Dot, Ink::Grey, "before"));
    }
    let series = [
        (Mark::Dot, Ink::Blue),
        (Mark::Cross, Ink::Orange),
        (Mark::Ring, Ink::Green),
        (Mark::Dot, Ink::Text),
    ];
    for ((direction, points), (mark, ink)) in after.iter().zip(series) {
        chart.marks(mark, ink, points.iter().copied());
        let of = direction.map_or("oblique", |d| LETTERS[d]);
        let when = if is_gap { "" } else { "after, " };
        keys.push(key(mark, ink, &format!("{when}along {of}")));
    }
    Some((chart.finish(), caption(&title, &keys, "")))
}

fn thinned(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    thinned_to(points, POINTS)
}

/// Some of the points, spread over all of them without a fixed stride that a pattern of the data could follow.
fn thinned_to(points: &[(f64, f64)], most: usize) -> Vec<(f64, f64)> {
    if points.len() <= most {
        return points.to_vec();
    }
    // multiples of the golden ratio fill an interval evenly and never repeat
    let golden = 0.618_033_988_749_894_9;
    let share = most as f64 / points.len() as f64;
    let kept = |k: usize| (k as f64 * golden).fract() < share;
    points.iter().enumerate().filter(|(k, _)| kept(*k)).map(|(_, p)| *p).collect()
}
