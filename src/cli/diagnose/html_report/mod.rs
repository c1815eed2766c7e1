//! report.html: the answer first, then the pictures and tables behind it.

mod charts;

use crate::report::Page;
use crate::report::chart::{Bar, Ink, bars};
use crate::report::page::{Cell, escape};
use volcomp_diagnose::report::{Cause, Report, Verdict};
use volcomp_diagnose::session::Session;
use volcomp_diagnose::{Diagnosis, Level};

use super::terms::{
    Compensable, Shares, capital, headline, name, name_of_label, number, parameters, peak_to_valley, percent,
    remedy, um, with_names, with_uncertainty,
};
use crate::numerals::counted;

/// Least probability of a cause that is not declared and gets a picture.
const CANDIDATE: f64 = 0.1;
/// Pictures of causes that are not declared, at most.
const CANDIDATES: usize = 2;
/// Part programs listed, at most.
const PROGRAMS: usize = 16;
/// Measurements listed, at most.
const NEXT: usize = 3;
/// Outliers listed, at most.
const OUTLIERS: usize = 10;

/// The page.
pub(super) fn page(session: &Session, found: &Diagnosis, compensable: &Compensable) -> String {
    let r = &found.report;
    let mut page = Page::new("Diagnosis of the gap between measurement and model");
    page.lead(headline(found));
    summary(&mut page, found);
    causes(&mut page, found);
    waterfall(&mut page, found);
    fitted(&mut page, found);
    corrections(&mut page, found, compensable);
    agreement(&mut page, session, found);
    programs(&mut page, found);
    unexplained(&mut page, found);
    next(&mut page, r);
    limits(&mut page, r);
    data(&mut page, r);
    page.finish()
}

/// Name with its label in small print: the label is what files and options use.
fn named(cause: &Cause) -> String {
    format!(
        "<b>{}</b><br><small>{}</small>",
        escape(&capital(&name(&cause.effect, &cause.subject))),
        escape(&cause.label())
    )
}

fn summary(page: &mut Page, found: &Diagnosis) {
    let r = &found.report;
    let s = &r.shrink;
    let mut rows = vec![
        (
            "Gap",
            format!("{} µm RMS; 99 % of the readings within {} µm", um(r.gap.rms_um), um(s.peak99_before_um)),
        ),
        (
            "Measurement noise",
            format!(
                "{} µm RMS, {} of the mean square of the gap is neither noise nor drift",
                um(r.gap.noise_um),
                percent(r.gap.explainable)
            ),
        ),
    ];
    if !found.budget.steps.is_empty() {
        rows.push((
            "Expected after correction",
            format!(
                "{} µm RMS, {} to {} µm (90 %); 99 % of the readings within {} µm",
                um(s.rms_after_um),
                um((1.0 - s.ci90[1]).max(0.0) * s.rms_before_um),
                um((1.0 - s.ci90[0]).max(0.0) * s.rms_before_um),
                um(s.peak99_after_um)
            ),
        ));
    }
    if let Some(f) = &r.fresh {
        let inside = if f.within_forecast { "inside" } else { "outside" };
        rows.push((
            "Observed on fresh data",
            format!(
                "{} → {} µm RMS, {} less, {inside} the predicted interval",
                um(f.rms_before_um),
                um(f.rms_after_um),
                percent(f.fraction)
            ),
        ));
    }
    rows.push(("Data", format!("{} of {} used", r.rows_used, counted(r.rows, "reading"))));
    let rows: Vec<Vec<Cell>> =
        rows.into_iter().map(|(head, text)| vec![Cell::head(head), Cell::text(text)]).collect();
    page.table(&[], &rows);
}

fn causes(page: &mut Page, found: &Diagnosis) {
    let r = &found.report;
    page.heading("Causes");
    let shown: Vec<&Cause> =
        r.causes.iter().filter(|c| c.declared || c.probability >= CANDIDATE).take(14).collect();
    if shown.is_empty() {
        page.paragraph("None: no effect of the library is significant in these data.");
        return;
    }
    let shares = Shares::of(&found.budget);
    let head = ["cause", "size, µm RMS", "share", "probability", "physical parameters", "remedy"];
    let rows: Vec<Vec<Cell>> = shown.iter().map(|c| cause_row(c, found, &shares)).collect();
    page.stacked_table(&head, &rows);
    page.note(
        "The size is the RMS of the effect over the readings. Uncertainties are expanded (k = 2). The share is that of the mean square of the gap which the cause takes out of readings \
         held out of its fit; the shares of all causes, of drift, of noise and of what is unexplained add up to 100 %. Causes in \
         grey are not established.",
    );
}

fn cause_row(c: &Cause, found: &Diagnosis, shares: &Shares) -> Vec<Cell> {
    let label = c.label();
    let size = found.budget.corrections.iter().find(|x| x.label == label).map(|x| x.size_um);
    let mut values = parameters(c);
    let has_width = c.parameters.contains_key("width_um");
    if let Some(v) = peak_to_valley(found, &label).filter(|_| !has_width) {
        values.insert(0, format!("peak to valley {} µm", with_uncertainty(v)));
    }
    let mut last = Vec::new();
    if c.declared {
        last.push(remedy(&c.effect).to_owned());
    } else {
        last.push(if c.remark.is_empty() {
            "not established".to_owned()
        } else {
            format!("not established: {}", with_names(&c.remark))
        });
    }
    if !c.confounded_with.is_empty() {
        let names: Vec<String> = c.confounded_with.iter().map(|l| name_of_label(l)).collect();
        last.push(format!("not separable here from: {}", names.join(", ")));
    }
    if !c.re_expression_of.is_empty() {
        last.push(format!("equivalent here to {}", c.re_expression_of.join(" or ")));
    }
    let cells = vec![
        Cell::html(named(c)),
        Cell::number(size.map_or_else(|| "–".to_owned(), with_uncertainty)),
        Cell::number(shares.cause(&label).map_or_else(|| "–".to_owned(), percent)),
        Cell::number(number(c.probability, 2)),
        Cell::small(values.join("; ")),
        Cell::small(last.join("; ")),
    ];
    if c.declared { cells } else { cells.into_iter().map(Cell::faint).collect() }
}

fn waterfall(page: &mut Page, found: &Diagnosis) {
    let b = &found.budget;
    page.heading("From the gap to the noise");
    let shares = Shares::of(b);
    let mut rows = vec![Bar {
        label: "Gap as measured".to_owned(),
        from: 0.0,
        to: b.before.rms_um,
        value: format!("{} µm", um(b.before.rms_um)),
        ink: Ink::Grey,
    }];
    let mut from = b.before.rms_um;
    for (label, left) in &b.steps {
        let share = shares.cause(label).unwrap_or(0.0);
        rows.push(Bar {
            label: capital(&name_of_label(label)),
            from,
            to: left.rms_um,
            value: format!("→ {} µm, {}", um(left.rms_um), percent(share)),
            ink: Ink::Blue,
        });
        from = left.rms_um;
    }
    let below = b.drift_um.hypot(b.noise_um);
    let rest = [
        ("Not explained", from, below, shares.unexplained, Ink::Orange),
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
        "Bars are RMS in µm: each begins where the one above ends. Mean squares are subtracted in the order shown, so the shares (% of \
         the mean square) add up to 100 %; where causes are correlated, their single steps depend on the order, their sum does not.",
    );
}

fn fitted(page: &mut Page, found: &Diagnosis) {
    let r = &found.report;
    let of = |declared: bool, most: usize, least: f64| {
        let causes = r.causes.iter().filter(move |c| c.declared == declared && c.probability >= least);
        let labels: Vec<String> = causes.map(Cause::label).collect();
        let mut curves = Vec::new();
        for label in labels.into_iter().take(most) {
            curves.extend(found.curves.iter().filter(|c| c.label == label && !c.lines.is_empty()));
        }
        curves
    };
    let (declared, candidates) = (of(true, usize::MAX, 0.0), of(false, CANDIDATES, CANDIDATE));
    if !declared.is_empty() {
        page.heading("Fitted curves of the causes");
        page.figures(&declared.iter().map(|c| charts::fitted(c)).collect::<Vec<_>>());
        page.note(
            "Grey: the readings without the other causes. Line: the effect as fitted, with the 90 % band of its posterior. The mean over \
             the readings is set to zero because the set-up offsets absorb it.",
        );
    }
    if !candidates.is_empty() {
        page.heading("Candidates that are not established");
        page.figures(&candidates.iter().map(|c| charts::fitted(c)).collect::<Vec<_>>());
    }
}

fn corrections(page: &mut Page, found: &Diagnosis, compensable: &Compensable) {
    let b = &found.budget;
    if b.corrections.is_empty() {
        return;
    }
    page.heading("What correcting a single cause achieves");
    let step = |from: Level, to: Level| {
        [
            format!("{} → {}", um(from.rms_um), um(to.rms_um)),
            format!("{} → {}", um(from.peak99_um), um(to.peak99_um)),
        ]
    };
    let head = [
        "cause",
        "alone: RMS, µm",
        "alone: peak, µm",
        "last of all: RMS, µm",
        "last of all: peak, µm",
        "volcompd corrects it",
    ];
    let rows: Vec<Vec<Cell>> = b
        .corrections
        .iter()
        .map(|c| {
            let [alone, alone_peak] = step(b.before, c.alone);
            let [last, last_peak] = step(c.all_others, b.after);
            let cause = found.report.causes.iter().find(|x| x.label() == c.label);
            vec![
                Cell::head(capital(&name_of_label(&c.label))),
                Cell::number(alone),
                Cell::number(alone_peak),
                Cell::number(last),
                Cell::number(last_peak),
                Cell::small(cause.map_or_else(String::new, |x| compensable.words(x))),
            ]
        })
        .collect();
    page.stacked_table(&head, &rows);
    let assumed = if compensable.is_assumed {
        " Without a model file a chain of three linear axes is assumed."
    } else {
        ""
    };
    page.note(format!(
        "On readings held out of the fit. Peak: size that 99 % of the readings do not exceed.{assumed}"
    ));
}

fn agreement(page: &mut Page, session: &Session, found: &Diagnosis) {
    let mut figures = Vec::new();
    if !found.budget.steps.is_empty() {
        figures.extend(charts::measured_and_predicted(found));
    }
    figures.extend(charts::residuals(session, found));
    if figures.is_empty() {
        return;
    }
    page.heading(if found.budget.steps.is_empty() {
        "The gap over time and axes"
    } else {
        "Measured against predicted, and the residual"
    });
    page.figures(&figures);
}

fn programs(page: &mut Page, found: &Diagnosis) {
    if found.programs.len() < 2 {
        return;
    }
    page.heading("Residual by part program");
    let most = found.programs.iter().map(|p| p.before_um.max(p.after_um)).fold(1e-9, f64::max);
    let head = [
        "setup",
        "instrument",
        "axes",
        "feed, mm/min",
        "tool, mm",
        "readings",
        "before, µm",
        "after, µm",
        "",
    ];
    let rows: Vec<Vec<Cell>> = found
        .programs
        .iter()
        .take(PROGRAMS)
        .map(|p| {
            let optional = |v: Option<f64>| v.map_or_else(|| "–".to_owned(), |v| number(v, 0));
            vec![
                Cell::head(charts::file_name(&p.setup)),
                Cell::text(&p.instrument),
                Cell::text(if p.axes.is_empty() { "none" } else { &p.axes }),
                Cell::number(optional(p.feed_mm_per_min)),
                Cell::number(optional(p.tool_length_mm)),
                Cell::number(p.readings),
                Cell::number(um(p.before_um)),
                Cell::number(um(p.after_um)),
                Cell::html(charts::before_and_after_bar(p.before_um / most, p.after_um / most)),
            ]
        })
        .collect();
    page.stacked_table(&head, &rows);
    let more = found.programs.len().saturating_sub(PROGRAMS);
    let rest = found.programs.get(PROGRAMS).map_or_else(String::new, |p| {
        format!(" Not listed: {} with at most {} µm after.", counted(more, "program"), um(p.after_um))
    });
    page.html(&format!(
        "<p class=\"note\">RMS of a setup with the same moving axes, feed and tool, largest residual first. {} {}{}</p>",
        charts::BEFORE_KEY,
        charts::AFTER_KEY,
        escape(&rest)
    ));
}

fn unexplained(page: &mut Page, found: &Diagnosis) {
    let (u, b) = (&found.report.unexplained, &found.budget);
    if !u.significant {
        return;
    }
    page.heading("What is not explained");
    page.paragraph(format!(
        "{} µm RMS, {} of the mean square of the gap: {}.",
        um(b.unexplained_um),
        percent(Shares::of(b).unexplained),
        with_names(&u.looks_like)
    ));
    let places: Vec<String> = u
        .places
        .iter()
        .take(5)
        .map(|p| format!("{} {} {} ({})", p.by, p.of, percent(p.share), p.detail).replace("  ", " "))
        .collect();
    if !places.is_empty() {
        page.note(format!(
            "Share that any function of one quantity explains (shares overlap): {}.",
            places.join("; ")
        ));
    }
}

fn next(page: &mut Page, r: &Report) {
    if r.next_measurement.is_empty() {
        return;
    }
    page.heading("Next measurement");
    for (k, n) in r.next_measurement.iter().take(NEXT).enumerate() {
        page.html(&format!(
            "<p><b>{}. {}</b>, about {} min. {}.</p>",
            k + 1,
            escape(&capital(&with_names(&n.action))),
            number(n.minutes, 0),
            escape(&capital(&with_names(&n.decides)))
        ));
        let lines: Vec<&str> = n.gcode.lines().collect();
        if n.gcode == "(the same part programs again)" {
            continue;
        }
        if lines.iter().all(|l| l.starts_with('(')) {
            let text: Vec<&str> = lines.iter().map(|l| l.trim_matches(['(', ')'])).collect();
            page.note(capital(&text.join("; ")));
        } else {
            page.folded(&format!("part program, {}", counted(lines.len(), "line")), &lines);
        }
    }
    if r.verdict != Verdict::NoGap {
        page.note("Duration: preparation by an experienced operator and the motion itself.");
    }
}

fn limits(page: &mut Page, r: &Report) {
    let mut pairs: Vec<String> = Vec::new();
    for c in r.causes.iter().filter(|c| c.declared || c.probability >= CANDIDATE) {
        if !c.confounded_with.is_empty() {
            let others: Vec<String> = c.confounded_with.iter().map(|l| name_of_label(l)).collect();
            pairs.push(format!("{} from {}", name(&c.effect, &c.subject), others.join(", ")));
        }
    }
    if pairs.is_empty() && r.cannot_be_seen.is_empty() {
        return;
    }
    page.heading("What these data cannot show");
    if !pairs.is_empty() {
        page.paragraph(format!("These data do not separate {}.", pairs.join("; ")));
    }
    let mut reasons: std::collections::BTreeMap<&str, Vec<String>> = std::collections::BTreeMap::new();
    for u in &r.cannot_be_seen {
        reasons.entry(&u.because).or_default().push(name_of_label(&u.effect));
    }
    let rows: Vec<Vec<Cell>> = reasons
        .into_iter()
        .map(|(because, effects)| vec![Cell::text(because), Cell::small(effects.join(", "))])
        .collect();
    if !rows.is_empty() {
        page.table(&[Cell::text("because"), Cell::text("not identifiable")], &rows);
    }
}

fn data(page: &mut Page, r: &Report) {
    page.heading("Data");
    let head = ["instrument", "white noise, µm", "drift, µm", "correlation time, s", "resolution, µm"];
    let rows: Vec<Vec<Cell>> = r
        .noise
        .iter()
        .map(|n| {
            let drifts = n.drift_um > 0.0;
            vec![
                Cell::head(&n.instrument),
                Cell::number(number(n.white_um, 3)),
                Cell::number(if drifts { number(n.drift_um, 3) } else { "none".to_owned() }),
                Cell::number(if drifts { number(n.drift_s, 0) } else { "–".to_owned() }),
                Cell::number(if n.resolution_um > 0.0 {
                    number(n.resolution_um, 3)
                } else {
                    "not seen".to_owned()
                }),
            ]
        })
        .collect();
    page.stacked_table(&head, &rows);
    if !r.outlying_readings.is_empty() {
        let listed: Vec<String> = r
            .outlying_readings
            .iter()
            .take(OUTLIERS)
            .map(|o| format!("{} ({} µm from its repeats)", o.at, um(o.apart_um)))
            .collect();
        let more = r.outlying_readings.len().saturating_sub(OUTLIERS);
        let more = if more > 0 { format!(" and {more} more in report.json") } else { String::new() };
        page.note(format!(
            "{} left out as {}: {}{more}.",
            counted(r.outlying_readings.len(), "reading"),
            if r.outlying_readings.len() == 1 { "outlier" } else { "outliers" },
            listed.join(", ")
        ));
    }
    for n in &r.notes {
        page.note(with_names(n));
    }
    page.note(format!(
        "Forecast by {}; in-sample the reduction would be {} (optimistic). Seed {}. All figures: report.json.",
        r.shrink.how,
        percent(r.shrink.in_sample_fraction),
        r.seed
    ));
}
