//! report.html: the answer first, then the pictures and tables behind it.

mod charts;

use crate::prelude::*;
use crate::report::chart::{Bar, Ink, bars};
use crate::report::page::escape;
use volcomp_diagnose::Diagnosis;
use volcomp_diagnose::report::{Cause, InstrumentNoise, Report, Verdict};
use volcomp_diagnose::session::Session;

use charts::Figure;

use super::terms::{
    Compensable, capital, headline, name, name_of_label, number, of_group, parameters, peak_to_valley,
    percent, remedy, um, with_names, with_uncertainty,
};

/// Least probability of a cause that is not declared and gets a picture.
const CANDIDATE: f64 = 0.1;
/// Figures on the first sheet, at most: two rows.
const FIRST_FIGURES: usize = 6;
/// Pictures of causes that are not declared, at most.
const CANDIDATES: usize = 2;
/// Part programs listed, at most.
const PROGRAMS: usize = 16;
/// Measurements listed, at most.
const NEXT: usize = 2;
/// What the rest resembles, parts at most.
const LOOKS: usize = 4;
/// Outliers listed, at most.
const OUTLIERS: usize = 10;

/// The page.
pub(super) fn page(session: &Session, found: &Diagnosis, compensable: &Compensable) -> String {
    let r = &found.report;
    let mut page = Page::new("Diagnosis of the gap between measurement and model");
    page.html("<div class=\"compact\">");
    page.lead(headline(found));
    summary(&mut page, found);
    causes(&mut page, found, compensable);
    waterfall(&mut page, found);
    unexplained(&mut page, found);
    next(&mut page, r);
    let more = fitted(&mut page, found);
    annex(&mut page, session, found, &more);
    programs(&mut page, found);
    limits(&mut page, r);
    data(&mut page, session, r);
    page.html("</div>");
    page.finish()
}

/// Name with its label in small print: the label is what files and options use.
fn named(cause: &Cause) -> String {
    let name = escape(&capital(&name(&cause.effect, &cause.subject)));
    format!("<b>{name}</b> <br><small>{}</small>", escape(&cause.label()))
}

fn summary(page: &mut Page, found: &Diagnosis) {
    let r = &found.report;
    let (s, used, all) = (&r.shrink, r.rows_used, counted(r.rows, "reading"));
    let [gap, noise, peak_before] = [r.gap.rms_um, r.gap.noise_um, s.peak99_before_um].map(um);
    let share = percent(r.gap.explainable);
    let mut rows = vec![
        ("Gap", format!("{gap} µm RMS over {used} of {all}; 99 % of them within {peak_before} µm")),
        (
            "Measurement noise",
            format!("{noise} µm RMS, {share} of the mean square of the gap is neither noise nor drift"),
        ),
    ];
    if !found.budget.names_no_cause() {
        let [high, low] = s.ci90.map(|less| um((1.0 - less).max(0.0) * s.rms_before_um));
        let [after, peak] = [s.rms_after_um, s.peak99_after_um].map(um);
        rows.push((
            "Expected after correction",
            format!("{after} µm RMS, {low} to {high} µm (90 %); 99 % of the readings within {peak} µm"),
        ));
    }
    if let Some(f) = &r.fresh {
        let inside = if f.within_forecast { "inside" } else { "outside" };
        let ([before, after], less) = ([f.rms_before_um, f.rms_after_um].map(um), percent(f.fraction));
        rows.push((
            "Observed on fresh data",
            format!("{before} → {after} µm RMS, {less} less, {inside} the predicted interval"),
        ));
    }
    page.facts(rows);
}

fn causes(page: &mut Page, found: &Diagnosis, compensable: &Compensable) {
    let r = &found.report;
    page.heading("Causes");
    let shown = r.causes.iter().filter(|c| c.declared || c.probability >= CANDIDATE).take(14);
    let shown = found.budget.sorted(shown);
    if shown.is_empty() {
        page.paragraph("None: no effect of the library is significant in these data.");
        return;
    }
    let head = [
        "cause",
        "size, µm RMS",
        "share",
        "probability",
        "gap with only this corrected, µm",
        "physical parameters",
        "remedy",
    ];
    let rows: Vec<Vec<Cell>> = shown.iter().map(|c| cause_row(c, found, compensable)).collect();
    page.stacked_table(&head, &rows);
    let assumed = if compensable.is_assumed && !found.budget.names_no_cause() {
        " volcompd: without a model file a chain of three linear axes is assumed."
    } else {
        ""
    };
    page.note(format!(
        "Size: RMS of the effect over the readings; uncertainties are expanded (k = 2). Share: of the mean square of the gap{}, \
         as the RMS of the gap with only this corrected, and with this corrected as the last. Causes in grey are not established.{assumed}",
        if r.is_compared { "" } else { " on readings held out of the fit" }
    ));
}

fn cause_row(c: &Cause, found: &Diagnosis, compensable: &Compensable) -> Vec<Cell> {
    let label = c.label();
    let correction = found.budget.correction(&label);
    let size = correction.map(|x| x.size_um);
    let (before, after) = (found.budget.before, found.budget.after);
    let alone = correction.map_or_else(
        || "–".to_owned(),
        |x| {
            let [alone, last] = [(before, x.alone), (x.all_others, after)]
                .map(|(from, to)| format!("{} → {}", um(from.rms_um), um(to.rms_um)));
            format!("{alone} <br><small>after all others {last}</small>")
        },
    );
    let mut values = parameters(found, c);
    let has_width = c.parameters.contains_key("width_um");
    if !has_width {
        values.splice(0..0, peak_to_valley(found, &label));
    }
    let mut last = Vec::new();
    if c.declared {
        last.push(remedy(c, found).to_owned());
        last.push(format!("volcompd: {}", compensable.words(c, found)));
    } else {
        last.push(if c.remark.is_empty() {
            "not established".to_owned()
        } else {
            format!("not established: {}", with_names(&c.remark))
        });
    }
    if !c.confounded_with.is_empty() {
        let names = c.confounded_with.iter().map(|l| name_of_label(l)).joined(", ");
        last.push(format!("not separable here from: {names}{}", of_group(c)));
    }
    if !c.re_expression_of.is_empty() {
        last.push(format!("equivalent here to {}", c.re_expression_of.join(" or ")));
    }
    let cells = vec![
        Cell::html(named(c)),
        Cell::number(size.map_or_else(|| "–".to_owned(), with_uncertainty)),
        Cell::number(correction.map_or_else(|| "–".to_owned(), |x| percent(x.share))),
        Cell::number(number(c.probability, 2)),
        Cell::html(alone),
        Cell::small(values.join("; ")),
        Cell::small(last.join("; ")),
    ];
    if c.declared { cells } else { cells.into_iter().map(Cell::faint).collect() }
}

fn waterfall(page: &mut Page, found: &Diagnosis) {
    let b = &found.budget;
    page.heading("From the gap to the noise");
    let shares = b.shares();
    let mut rows = vec![Bar {
        label: "Gap as measured".to_owned(),
        from: 0.0,
        to: b.before.rms_um,
        value: format!("{} µm", um(b.before.rms_um)),
        ink: Ink::Grey,
    }];
    let mut from = b.before.rms_um;
    for x in &b.corrections {
        let to = x.cumulative.rms_um;
        rows.push(Bar {
            label: capital(&name_of_label(&x.label)),
            from,
            to,
            value: format!("→ {} µm, {}", um(to), percent(x.share)),
            ink: Ink::Blue,
        });
        from = to;
    }
    let below = b.drift_um.hypot(b.noise_um);
    let rough = b.roughness_um.hypot(below);
    let rest = [
        ("Not explained", from, rough, shares.unexplained, Ink::Orange),
        ("Roughness of curves", rough, below, shares.roughness, Ink::Blue),
        ("Drift", below, b.noise_um, shares.drift, Ink::Green),
        ("Noise", b.noise_um, 0.0, shares.noise, Ink::Grey),
    ];
    for (label, from, to, share, ink) in rest.into_iter().filter(|r| r.3 > 5e-4 || r.0 == "Noise") {
        let value = if to > 0.0 {
            format!("→ {} µm, {}", um(to), percent(share))
        } else {
            format!("{} µm, {}", um(from), percent(share))
        };
        rows.push(Bar { label: label.to_owned(), from, to, value, ink });
    }
    page.html(&bars(&rows));
    page.note(
        "RMS in µm; → what is left once this cause and those above are corrected. The share of a cause is the mean of what its correction takes \
         out of the mean square alone and beside all others; the shares add up to 100 %. A negative one: it compensates for more of another \
         cause than it adds, and goes out with it.",
    );
}

/// The largest fitted curves and measured against predicted; gives the figures for which the first sheet has no room.
fn fitted(page: &mut Page, found: &Diagnosis) -> Vec<Figure> {
    let declared = found.budget.sorted(found.report.causes.iter().filter(|c| c.declared));
    let mut figures: Vec<Figure> = declared.into_iter().flat_map(|c| curves(found, c)).collect();
    let names_causes = !found.budget.names_no_cause();
    let agreement = names_causes.then(|| charts::measured_and_predicted(found)).flatten();
    let more = figures.split_off(figures.len().min(FIRST_FIGURES - usize::from(agreement.is_some())));
    let has_curves = !figures.is_empty();
    figures.extend(agreement);
    if figures.is_empty() {
        return more;
    }
    page.heading(if has_curves { "Fitted curves of the causes" } else { "Measured against predicted" });
    page.figures(&figures);
    if has_curves {
        page.note(
            "Grey: the readings without the other causes. Line: the effect as fitted, with the 90 % band of its posterior, about its mean, which the \
             set-up offsets absorb.",
        );
    }
    more
}

/// The charts of the curves of one cause.
fn curves(found: &Diagnosis, cause: &Cause) -> Vec<Figure> {
    let label = cause.label();
    let own = found.curves.iter().filter(|c| c.label == label && !c.lines.is_empty());
    own.map(charts::fitted).collect()
}

/// Figures without room on the first sheet.
fn annex(page: &mut Page, session: &Session, found: &Diagnosis, more: &[Figure]) {
    if !more.is_empty() {
        page.heading("Further fitted curves of the causes");
        page.figures(more);
    }
    let open = |c: &&Cause| !c.declared && c.probability >= CANDIDATE;
    let candidates: Vec<Figure> =
        found.report.causes.iter().filter(open).take(CANDIDATES).flat_map(|c| curves(found, c)).collect();
    if !candidates.is_empty() {
        page.heading("Candidates that are not established");
        page.figures(&candidates);
    }
    let residuals = charts::residuals(session, found);
    if !residuals.is_empty() {
        let is_gap = found.budget.names_no_cause();
        page.heading(if is_gap { "The gap over time and axes" } else { "The residual over time and axes" });
        page.figures(&residuals);
    }
}

fn programs(page: &mut Page, found: &Diagnosis) {
    if found.programs.len() < 2 {
        return;
    }
    let is_gap = found.budget.names_no_cause();
    page.heading(if is_gap { "The gap by part program" } else { "Residual by part program" });
    let most = found.programs.iter().map(|p| p.before_um.max(p.after_um)).fold(1e-9, f64::max);
    let mut head = vec!["setup", "instrument", "axes", "feed, mm/min", "tool, mm", "readings"];
    head.extend(if is_gap { &["gap, µm", ""][..] } else { &["before, µm", "after, µm", ""] });
    let rows: Vec<Vec<Cell>> = found
        .programs
        .iter()
        .take(PROGRAMS)
        .map(|p| {
            let optional = |v: Option<f64>| v.map_or_else(|| "–".to_owned(), |v| number(v, 0));
            let mut cells = vec![
                Cell::head(charts::file_name(&p.setup)),
                Cell::text(&p.instrument),
                Cell::text(if p.axes.is_empty() { "none" } else { &p.axes }),
                Cell::number(optional(p.feed_mm_per_min)),
                Cell::number(optional(p.tool_length_mm)),
                Cell::number(p.readings),
                Cell::number(um(p.before_um)),
            ];
            // without a cause there is one size, and no after
            if !is_gap {
                cells.push(Cell::number(um(p.after_um)));
            }
            let after = if is_gap { 0.0 } else { p.after_um };
            cells.push(Cell::html(charts::before_and_after_bar(p.before_um / most, after / most)));
            cells
        })
        .collect();
    page.stacked_table(&head, &rows);
    let more = found.programs.len().saturating_sub(PROGRAMS);
    let rest = found.programs.get(PROGRAMS).map_or_else(String::new, |p| {
        let after = if is_gap { "" } else { " after" };
        format!(" Not listed: {} with at most {} µm{after}.", counted(more, "program"), um(p.after_um))
    });
    let keys = if is_gap { String::new() } else { format!("{} {}", charts::BEFORE_KEY, charts::AFTER_KEY) };
    page.html(&format!(
        "<p class=\"note\">RMS of a setup with the same moving axes, feed and tool, largest residual first. {keys}{}</p>",
        escape(&rest)
    ));
}

fn unexplained(page: &mut Page, found: &Diagnosis) {
    let u = &found.report.unexplained;
    if !u.significant {
        return;
    }
    page.heading("What is not explained");
    let mut parts: Vec<&str> = u.looks_like.split("; ").collect();
    let more = parts.len().saturating_sub(LOOKS);
    parts.truncate(LOOKS);
    let mut looks = parts.join("; ");
    if more > 0 {
        looks.push_str(&format!("; {more} more in report.json"));
    }
    let share = (u.rms_um / found.budget.before.rms_um.max(1e-9)).powi(2).min(1.0);
    let (size, share, looks) = (um(u.rms_um), percent(share), with_names(&looks));
    page.paragraph(format!("{size} µm RMS, {share} of the mean square of the gap: {looks}."));
    let places = u.places.iter().take(5);
    let places = places
        .map(|p| format!("{} {} {} ({})", p.by, p.of, percent(p.share), p.detail).replace("  ", " "))
        .joined("; ");
    if !places.is_empty() {
        page.note(format!("Share that any function of one quantity explains (shares overlap): {places}."));
    }
}

fn next(page: &mut Page, r: &Report) {
    if r.next_measurement.is_empty() {
        return;
    }
    page.heading("Next measurement");
    for (k, n) in r.next_measurement.iter().take(NEXT).enumerate() {
        let [action, decides] = [&n.action, &n.decides].map(|text| escape(&capital(&with_names(text))));
        let (k, minutes) = (k + 1, number(n.minutes, 0));
        page.html(&format!("<p><b>{k}. {action}</b>, about {minutes} min. {decides}.</p>"));
        let lines: Vec<&str> = n.gcode.lines().collect();
        if n.gcode == "(the same part programs again)" {
            continue;
        }
        if lines.iter().all(|l| l.starts_with('(')) {
            let text = lines.iter().map(|l| l.trim_matches(['(', ')'])).joined("; ");
            page.note(capital(&text));
        } else {
            page.folded(&format!("part program, {}", counted(lines.len(), "line")), &lines);
        }
    }
    if r.verdict != Verdict::NoGap {
        page.note("Duration: preparation by an experienced operator and the motion itself.");
    }
}

fn limits(page: &mut Page, r: &Report) {
    let shown = r.causes.iter().filter(|c| c.declared || c.probability >= CANDIDATE);
    let pair = |c: &Cause| {
        let others = c.confounded_with.iter().map(|l| name_of_label(l)).joined(", ");
        format!("{} from {others}", name(&c.effect, &c.subject))
    };
    let pairs = shown.filter(|c| !c.confounded_with.is_empty()).map(pair).joined("; ");
    if pairs.is_empty() && r.cannot_be_seen.is_empty() {
        return;
    }
    page.heading("What these data cannot show");
    if !pairs.is_empty() {
        page.paragraph(format!("These data do not separate {pairs}."));
    }
    let mut reasons: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for u in &r.cannot_be_seen {
        reasons.entry(&u.because).or_default().push(name_of_label(&u.effect));
    }
    let reasons = reasons.into_iter().map(|(because, effects)| {
        format!("<b>{}</b>: {}", escape(&capital(because)), escape(&effects.join(", ")))
    });
    list(page, reasons);
}

/// Short entries in small print, in columns where there is room.
fn list(page: &mut Page, entries: impl Iterator<Item = String>) {
    let entries: String = entries.map(|e| format!("<li>{e}</li>")).collect();
    if !entries.is_empty() {
        page.html(&format!("<ul class=\"fine\">{entries}</ul>"));
    }
}

fn data(page: &mut Page, session: &Session, r: &Report) {
    page.heading("Data");
    let head = ["instrument", "white noise, µm", "drift, µm", "correlation time", "resolution, µm"];
    let row = |n: &InstrumentNoise| {
        let or = |size: f64, none: &str| if size > 0.0 { number(size, 3) } else { none.to_owned() };
        let span = if n.drift_um > 0.0 { session.span(n.drift_s) } else { "–".to_owned() };
        let sizes = [number(n.white_um, 3), or(n.drift_um, "none"), span, or(n.resolution_um, "not seen")];
        [Cell::head(&n.instrument)].into_iter().chain(sizes.map(Cell::number)).collect()
    };
    page.stacked_table(&head, &r.noise.iter().map(row).collect::<Vec<_>>());
    if !r.outlying_readings.is_empty() {
        let listed = r.outlying_readings.iter().take(OUTLIERS).map(|o| o.words(um)).joined("; ");
        let more = r.outlying_readings.len().saturating_sub(OUTLIERS);
        let more = if more > 0 { format!(" and {more} more in report.json") } else { String::new() };
        let readings = counted(r.outlying_readings.len(), "reading");
        let outliers = if r.outlying_readings.len() == 1 { "outlier" } else { "outliers" };
        page.note(format!("{readings} left out as {outliers}: {listed}{more}."));
    }
    // the folder of a file says nothing on paper
    let short = |note: &String| {
        let shorter = |text: String, file: &String| text.replace(file.as_str(), charts::file_name(file));
        escape(&with_names(&session.files.iter().fold(note.clone(), shorter)))
    };
    list(page, r.notes.iter().map(short));
    let (how, share, seed) = (&r.shrink.how, percent(r.shrink.in_sample_fraction), r.seed);
    page.note(format!(
        "Forecast by {how}; in-sample the reduction would be {share} (optimistic). Seed {seed}. All figures: report.json."
    ));
}
