//! The page of a ballbar test: head, polar plot, causes by rank with remedy, trend.

use super::trend::Trend;
use super::{Test, shown, unjudged};
use crate::evaluate::page::{self, Origin};
use crate::evaluate::picture::circular as drawing;
use crate::identify::ballbar::report::{COVERAGE, note_text, reason_text, unit_of, with_limits};
use crate::prelude::*;
use crate::report_page::{Plot, Style};
use volcomp_identify::ballbar::{Effect, Estimate, Feature, Plane};

/// Causes whose course over the tests is drawn.
const COURSES: usize = 5;

/// Name and remedy of an effect.
pub(super) fn named(effect: Effect, plane: Plane) -> (String, &'static str) {
    let name = effect.name(plane);
    let (kind, subject) = name.split_once(':').unwrap_or((&name, ""));
    let [a, b] = plane.axes().map(|a| a.to_string());
    let both = format!("{a} and {b}");
    let remedy = |effect: &str| volcomp_effects::Effect::find(effect).map_or("", |p| p.remedy);
    match kind {
        "scale-mismatch" => (format!("scale mismatch of {both}"), remedy("scale")),
        "servo-mismatch" => (format!("servo mismatch of {both}"), remedy("servo-mismatch")),
        "squareness" => (format!("squareness error of {a} to {b}"), remedy("squareness")),
        _ => volcomp_effects::Effect::find(kind).map_or_else(
            || (name.clone(), ""),
            |p| (p.title.replace("{}", &subject.to_uppercase()), p.remedy),
        ),
    }
}

/// A value with its expanded uncertainty and the end of travel where it holds.
fn value(f: &Feature) -> String {
    let end = f.end().map_or_else(String::new, |end| format!("at the {end} "));
    format!("{end}{} {}", with_limits(f.value, f.std), unit_of(f))
}

pub(super) fn page(title: &str, judged: &Judged, tests: &[Test], is_centre_stated: bool) -> Result<String> {
    let Some(newest) = tests.last() else { return Ok(String::new()) };
    let origins: Vec<Origin> = tests.iter().map(|t| Origin::of(&t.label, &t.plan.path)).collect();
    let (plane, circles) = (newest.plan.circles.plane, &newest.circles);
    let feeds: Vec<String> = circles.iter().filter_map(|c| c.feed).map(|f| format!("{f:.0}")).collect();
    let [x, y] = newest.plan.analysis.offset.map(|(v, _)| um_from_mm(v));
    let [cx, cy] = newest.plan.circles.centre;
    let assumed = if is_centre_stated { "" } else { " (assumed)" };
    let ([a, b], radius) = (plane.axes(), newest.plan.circles.radius);
    let facts = [
        ("plane", format!("{a}{b}, centre at {a} {cx} mm, {b} {cy} mm{assumed}, radius {radius} mm")),
        ("feeds", if feeds.is_empty() { "not stated".to_owned() } else { feeds.join(", ") + " mm/min" }),
        ("readings", counted(newest.plan.circles.samples.len(), "reading")),
        ("centre of the instrument", format!("{}, {} µm removed", plain(x, 1), plain(y, 1))),
    ];
    let standard = "Circular test, ISO 230-4:2022, with causes fitted to all readings";
    let mut page = page::start(title, standard, judged, &origins, &facts);
    if let Some(largest) = newest.plan.analysis.estimates.first() {
        let (name, share) = (named(largest.effect, plane).0, 100.0 * largest.share);
        page.lead(format_args!("Largest cause: {name}, {share:.0} % of what the causes add to the circle."));
    }
    for (i, circle) in circles.iter().enumerate() {
        page.heading(format_args!("Circular errors{}", circle.at_feed()));
        let others = (i > 0).then(|| unjudged(circle));
        page::figures("µm", others.as_deref().unwrap_or(&judged.figures), None).put(&mut page);
    }
    let drawn: Vec<_> = match &circles[..] {
        [first, .., last] => vec![first, last],
        all => all.iter().collect(),
    };
    let all: Vec<_> = drawn.iter().map(|c| shown(newest, c)).collect();
    let scale = drawing::scale(&all);
    let mut plots = Vec::new();
    for (circle, one) in drawn.iter().zip(&all) {
        plots.push((format!("Polar plot{}", circle.at_feed()), drawing::single(one, scale)?));
    }
    let caption = "Radial errors about the common centre, magnified; the heavy circle is the nominal path.";
    page.plots(&plots, caption);
    causes(&mut page, newest);
    if tests.len() > 1 {
        trend(&mut page, &Trend::of(tests));
    }
    Ok(page::finish(page, judged))
}

/// The causes by rank, with what could not be told.
fn causes(page: &mut Page, test: &Test) {
    let (a, plane) = (&test.plan.analysis, test.plan.circles.plane);
    page.sheet("Causes by rank");
    let values = |e: &Estimate| a.features(e).iter().map(value).joined("; ");
    let significant = || a.estimates.iter().filter(|e| e.significant);
    page.bars(significant().map(|e| {
        let percent = 100.0 * e.share;
        (named(e.effect, plane).0, percent, format!("{percent:.1} %"))
    }));
    page.note("Share: range that the cause alone adds to the circle, of the sum of all.");
    let rows = significant().enumerate().map(|(i, e)| {
        let (name, remedy) = named(e.effect, plane);
        let [adds, std] = [e.contribution, e.contribution_std].map(um_from_mm);
        [format!("{}. {name}", i + 1), with_limits(adds, std), values(e), remedy.to_owned()]
    });
    let table = Table::new(["cause", ">adds to the circle / µm", "value, U (k = 2)", "remedy"]).rows(rows);
    if !table.is_empty() {
        table.put_stacked(page);
    }
    let name = |effect: Effect| named(effect, plane).0;
    let small = a.estimates.iter().filter(|e| !e.significant);
    let small = small.map(|e| format!("{} ({})", name(e.effect), values(e))).joined(", ");
    if !small.is_empty() {
        page.note(format_args!("Not significant (99.9 %): {small}."));
    }
    for circle in &test.circles {
        let (at, all, rest) = (circle.at_feed(), um_from_mm(circle.result.widest()), circle.unexplained());
        page.paragraph(format_args!(
            "Circular error{at} {all:.2} µm; {rest} µm of the residuals, which no cause explains."
        ));
    }
    for (one, other, c) in a.confounded() {
        let (one, other) = (name(one), name(other));
        page.note(format_args!(
            "Confounded: {one} and {other} are strongly correlated in these data ({c:.2})."
        ));
    }
    for (effect, reason) in &a.missing {
        page.note(format_args!("Not determined: {}: {}.", name(*effect), reason_text(reason, plane)));
    }
    for n in &a.notes {
        page.note(note_text(n));
    }
}

fn trend(page: &mut Page, trend: &Trend) {
    page.sheet("Trend");
    let plot = |c: &super::trend::Course| {
        let (name, unit) = c.name.rsplit_once(", ").unwrap_or((&c.name, ""));
        let known = || trend.at.iter().zip(&c.values).filter_map(|(t, v)| v.map(|(v, std)| (*t, v, std)));
        let points: Vec<(f64, f64)> = known().map(|(t, v, _)| (t, v)).collect();
        let limits = known().filter_map(|(t, v, std)| Some((t, v, COVERAGE * std?)));
        let limits: Vec<(f64, f64)> = limits.flat_map(|(t, v, u)| [(t, v - u), (t, v + u)]).collect();
        let plot = Plot::new(name, &trend.axis, unit).with(Style::Discs, "test", points.clone());
        let plot = if limits.is_empty() { plot } else { plot.with(Style::Limits, "U (k = 2)", limits) };
        plot.with(Style::Reference, "", points)
    };
    page.charts(&trend.courses.iter().take(1 + COURSES).map(plot).collect::<Vec<_>>());
    trend.table().put(page);
    page.note(
        "Change: last test minus first one, with the expanded uncertainty of both fits. The instrument and how it was set up are \
         not in it. Causes that are not significant in any test are left out.",
    );
}
