//! report.html: one file with its pictures.

use plotters::prelude::*;

use crate::report::Page;
use crate::report::page::Cell;
use crate::report::plot::{
    Area, Axes, BLUE, Drawn, GREY, INK, Key, SHEET_WIDTH, VERMILLION, legend, svg_of, with_room,
};
use crate::{EX_SOFTWARE, Failure};
use volcomp_diagnose::Diagnosis;
use volcomp_diagnose::library::page as effect_page;
use volcomp_diagnose::machine_state::MachineState;
use volcomp_diagnose::report::{Cause, Place, Report};
use volcomp_diagnose::session::Session;

/// Points of one series of a picture: at most, at least, and on the whole page, so that a browser stays fast.
const POINTS: [usize; 3] = [1200, 100, 24_000];
/// Points of each series of a fitted effect.
const CURVE_POINTS: usize = 500;
/// Height of a picture of the gap over one quantity.
const HEIGHT: u32 = 210;
/// Width of a picture below which fewer numbers fit under it, pixels.
const NARROW: u32 = 500;
/// Causes that get a picture.
const CURVES: usize = 8;

/// The page.
pub(super) fn page(session: &Session, found: &Diagnosis) -> Result<String, Failure> {
    let r = &found.report;
    let mut page = Page::new("Gap between measurement and prediction");
    head(&mut page, r);
    page.heading("Causes");
    causes(&mut page, r);
    let failed = |e: Box<dyn std::error::Error>| {
        Failure::new(EX_SOFTWARE, format_args!("error: report.html: a picture could not be drawn: {e}"))
    };
    if !r.causes.is_empty() {
        page.picture(&probabilities(&r.causes).map_err(failed)?);
    }
    for curve in found.curves.iter().take(CURVES).filter(|c| c.points.len() > 1) {
        let svg = fitted(curve).map_err(failed)?;
        let stands = r.causes.iter().any(|c| c.declared && c.label() == curve.label);
        let caption = format!(
            "{}{}: the gap without the other effects (grey), and the effect as fitted (red)",
            curve.label,
            if stands { "" } else { ", not declared" }
        );
        page.figure(&svg, caption);
    }
    page.sheet("How far it shrinks");
    page.picture(&shrink(r).map_err(failed)?);
    shrink_words(&mut page, r);
    page.heading("Where it lies");
    places(&mut page, &r.places);
    if !r.places.is_empty() {
        page.picture(&shares(&r.places).map_err(failed)?);
    }
    page.sheet("The gap before and after");
    let quantities = quantities(session);
    let most = points_of(quantities.len());
    for (label, values) in quantities {
        let svg = before_after(session, found, &label, &values, most).map_err(failed)?;
        page.figure(&svg, format!("over {label}: before (blue) and without the causes declared (red)"));
    }
    page.sheet("What stays");
    stays(&mut page, r);
    measure(&mut page, r);
    data(&mut page, r);
    Ok(page.finish())
}

fn head(page: &mut Page, r: &Report) {
    page.paragraph(format!(
        "Verdict: {}. The gap is {:.2} um RMS without the offsets of the mountings, the noise {:.2} um; {} of {} rows were used.",
        r.verdict.words(), r.gap.rms_um, r.gap.noise_um, r.rows_used, r.rows
    ));
    page.paragraph(format!(
        "{:.0} % of its mean square is neither noise nor drift; the best possible explanation would leave {:.2} um.",
        100.0 * r.gap.explainable,
        r.gap.floor_um
    ));
}

fn values(c: &Cause) -> String {
    let all: Vec<String> = c
        .parameters
        .iter()
        .map(|(n, v)| {
            if v.std > 0.0 {
                format!("{n} {:.4} ± {:.4}", v.value, v.std)
            } else {
                format!("{n} {:.4}", v.value)
            }
        })
        .collect();
    all.join(", ")
}

fn causes(page: &mut Page, r: &Report) {
    if r.causes.is_empty() {
        page.paragraph("None: nothing that the library knows stands out of the noise.");
        return;
    }
    let head = ["effect", "probability", "declared", "alone shrinks by", "parameters", "remarks"];
    let head: Vec<Cell> = head.iter().map(Cell::head).collect();
    let rows: Vec<Vec<Cell>> = r
        .causes
        .iter()
        .map(|c| {
            let mut remarks = Vec::new();
            if !c.confounded_with.is_empty() {
                remarks.push(format!("cannot be told from {}", c.confounded_with.join(", ")));
            }
            if !c.re_expression_of.is_empty() {
                remarks.push(format!("says here what {} would say", c.re_expression_of.join(" or ")));
            }
            if !c.remark.is_empty() {
                remarks.push(c.remark.clone());
            }
            if let Some(p) = effect_page(&c.effect).filter(|_| c.declared) {
                remarks.push(p.cause.to_owned());
            }
            vec![
                Cell::head(c.label()),
                Cell::number(format!("{:.2}", c.probability)),
                Cell::text(if c.declared { "yes" } else { "no" }),
                Cell::number(format!("{:.0} %", 100.0 * c.shrink)),
                Cell::small(values(c)),
                Cell::small(remarks.join("; ")),
            ]
        })
        .collect();
    page.table(&head, &rows);
}

fn places(page: &mut Page, places: &[Place]) {
    if places.is_empty() {
        page.paragraph("Nowhere in particular: it is not above the noise.");
        return;
    }
    page.note("Shares of the structured gap. Those by axis, instrument and setup add up to 100 %; the others overlap.");
    let head = [Cell::head("by"), Cell::head("of"), Cell::number("share"), Cell::head("where")];
    let rows: Vec<Vec<Cell>> = places
        .iter()
        .map(|p| {
            let share = Cell::number(format!("{:.0} %", 100.0 * p.share));
            vec![Cell::head(p.by), Cell::text(&p.of), share, Cell::small(&p.detail)]
        })
        .collect();
    page.table(&head, &rows);
}

fn shrink_words(page: &mut Page, r: &Report) {
    let s = &r.shrink;
    page.paragraph(format!(
        "Expected on new data of the same programme: {:.2} um to {:.2} um, {:.0} % less (90 % interval {:.0} to {:.0} %), by {}. \
         On the data of the fit it would be {:.0} %: too good. 99 % of the readings: {:.2} um to {:.2} um.",
        s.rms_before_um, s.rms_after_um, 100.0 * s.fraction, 100.0 * s.ci90[0], 100.0 * s.ci90[1], s.how,
        100.0 * s.in_sample_fraction, s.peak99_before_um, s.peak99_after_um
    ));
    if let Some(f) = &r.fresh {
        let inside = if f.within_forecast { "inside the interval" } else { "outside the interval" };
        page.paragraph(format!(
            "Seen on fresh data: {:.2} um to {:.2} um, {:.0} % less, {inside}.",
            f.rms_before_um,
            f.rms_after_um,
            100.0 * f.fraction
        ));
    }
}

fn stays(page: &mut Page, r: &Report) {
    let u = &r.unexplained;
    if u.significant {
        page.paragraph(format!(
            "{:.2} um RMS ({:.0} % of the structured gap) is not explained: {}.",
            u.rms_um,
            100.0 * u.share,
            u.looks_like
        ));
        places(page, &u.places);
    } else {
        page.paragraph("Nothing above the noise is left.");
    }
}

fn measure(page: &mut Page, r: &Report) {
    if r.next_measurement.is_empty() {
        return;
    }
    page.heading("What to measure next");
    for n in &r.next_measurement {
        page.paragraph(format!(
            "{} (separates {}; {:.2} nats)",
            n.action,
            n.separates.join(", "),
            n.information
        ));
        page.lines(&n.gcode.lines().map(str::to_owned).collect::<Vec<_>>());
    }
}

fn data(page: &mut Page, r: &Report) {
    page.heading("Data");
    let head: Vec<Cell> = ["instrument", "white noise, um", "drift, um", "over, s", "rounding, um"]
        .iter()
        .map(Cell::head)
        .collect();
    let rows: Vec<Vec<Cell>> = r
        .noise
        .iter()
        .map(|n| {
            vec![
                Cell::head(&n.instrument),
                Cell::number(format!("{:.3}", n.white_um)),
                Cell::number(format!("{:.3}", n.drift_um)),
                Cell::number(format!("{:.0}", n.drift_s)),
                Cell::number(format!("{:.3}", n.resolution_um)),
            ]
        })
        .collect();
    page.table(&head, &rows);
    for o in &r.outlying_readings {
        page.note(format!("left out: {}, {:.1} um apart from its repeats", o.at, o.apart_um));
    }
    for n in &r.notes {
        page.note(n);
    }
    if !r.cannot_be_seen.is_empty() {
        page.heading("Effects that these data cannot show");
        for u in &r.cannot_be_seen {
            page.note(format!("{}: {}", u.effect, u.because));
        }
    }
}

/// Quantities over which the gap is drawn.
fn quantities(session: &Session) -> Vec<(String, Vec<f64>)> {
    let mut all: Vec<(String, Vec<f64>)> = Vec::new();
    let mut add = |label: String, of: &dyn Fn(&MachineState) -> f64| {
        let values: Vec<f64> = session.moments.iter().map(of).collect();
        let [low, high] = range(&values);
        if high - low > 1e-9 {
            all.push((label, values));
        }
    };
    for axis in &session.axes {
        let i = axis.slot();
        if axis.is_linear() {
            add(format!("{axis}, mm"), &|m| m.position[i]);
            add(format!("velocity of {axis}, mm/s"), &|m| m.velocity[i]);
            add(format!("acceleration of {axis}, mm/s2"), &|m| m.acceleration[i]);
        } else {
            add(format!("{axis}, deg"), &|m| m.position[i].to_degrees());
        }
        // directions are two values: spread a little, so that the points can be told apart
        add(format!("direction of {axis} (spread)"), &|m| m.direction[i] + 0.3 * spread(m.t_s));
    }
    add("time, s".to_owned(), &|m| m.t_s);
    for (k, s) in session.signals.iter().enumerate().filter(|(_, s)| s.tau_s == 0.0) {
        add(s.source.to_string(), &|m| m.signals[k]);
    }
    all
}

/// A number in [-1, 1] that looks like chance and is the same for the same time.
fn spread(t_s: f64) -> f64 {
    let v = (t_s * 12.9898).sin() * 43_758.545;
    2.0 * (v - v.floor()) - 1.0
}

fn range(values: &[f64]) -> [f64; 2] {
    values
        .iter()
        .filter(|v| v.is_finite())
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], v| [l.min(*v), h.max(*v)])
}

/// Points of a series where a page has so many pictures of six series each.
fn points_of(pictures: usize) -> usize {
    let [most, least, all] = POINTS;
    (all / (6 * pictures.max(1))).clamp(least, most)
}

/// Every so many points, `most` of them.
fn thinned(points: &[(f64, f64)], most: usize) -> Vec<(f64, f64)> {
    let step = points.len().div_ceil(most).max(1);
    points.iter().step_by(step).copied().collect()
}

fn draw(area: &Area<'_>, x_label: &str, y_label: &str, series: &[(Vec<(f64, f64)>, RGBColor)]) -> Drawn {
    let all = || series.iter().flat_map(|(p, _)| p.iter());
    let axes = Axes {
        title: "",
        x_label,
        y_label,
        x: with_room(all().map(|p| p.0), 0.03),
        y: with_room(all().map(|p| p.1), 0.08),
        right: 16,
        x_ticks: if area.dim_in_pixel().0 < NARROW { 5 } else { 9 },
    };
    let mut chart = axes.draw(area)?;
    for (points, colour) in series {
        chart.draw_series(points.iter().map(|p| Circle::new(*p, 2, colour.mix(0.55).filled())))?;
    }
    Ok(())
}

fn before_after(
    session: &Session,
    found: &Diagnosis,
    label: &str,
    values: &[f64],
    most: usize,
) -> Result<String, Box<dyn std::error::Error>> {
    let letters = ["x", "y", "z"];
    let along = |axis: usize, gap: &[f64]| -> Vec<(f64, f64)> {
        let points: Vec<(f64, f64)> = values
            .iter()
            .zip(gap)
            .zip(&session.moments)
            .filter(|((v, g), m)| v.is_finite() && g.is_finite() && m.u[axis].abs() > 0.7)
            .map(|((v, g), m)| (*v, g * m.u[axis].signum()))
            .collect();
        thinned(&points, most)
    };
    let seen: Vec<usize> = (0..3).filter(|a| !along(*a, &found.before_um).is_empty()).collect();
    let width = SHEET_WIDTH;
    svg_of((width, HEIGHT), |area| {
        for (part, axis) in area.split_evenly((1, seen.len().max(1))).iter().zip(&seen) {
            let series =
                [(along(*axis, &found.before_um), BLUE), (along(*axis, &found.after_um), VERMILLION)];
            draw(part, label, &format!("along {}, um", letters[*axis]), &series)?;
        }
        Ok(())
    })
}

fn fitted(curve: &volcomp_diagnose::Curve) -> Result<String, Box<dyn std::error::Error>> {
    let data: Vec<(f64, f64)> = curve.points.iter().map(|p| (p[0], p[1])).collect();
    let fit: Vec<(f64, f64)> = curve.points.iter().map(|p| (p[0], p[2])).collect();
    svg_of((SHEET_WIDTH, 240), |area| {
        let series = [(thinned(&data, CURVE_POINTS), GREY), (thinned(&fit, CURVE_POINTS), VERMILLION)];
        draw(area, &curve.x_label, &curve.y_label, &series)
    })
}

/// Horizontal bars with a label each, 0 to 1.
fn bars(rows: &[(String, f64, bool)], title: &str) -> Result<String, Box<dyn std::error::Error>> {
    let height = 34 + 22 * rows.len() as u32;
    svg_of((SHEET_WIDTH, height), |area| {
        crate::report::plot::words(area, title, (8, 6), 14)?;
        for (i, (label, share, strong)) in rows.iter().enumerate() {
            let y = 30 + 22 * i as i32;
            crate::report::plot::words(area, label, (8, y), 13)?;
            let colour = if *strong { BLUE } else { GREY };
            let end = 300 + (480.0 * share.clamp(0.0, 1.0)) as i32;
            area.draw(&Rectangle::new([(300, y), (end.max(301), y + 15)], colour.filled()))?;
            crate::report::plot::words(area, &format!("{:.0} %", 100.0 * share), (end + 6, y), 13)?;
        }
        Ok(())
    })
}

fn probabilities(causes: &[Cause]) -> Result<String, Box<dyn std::error::Error>> {
    let rows: Vec<_> = causes.iter().take(14).map(|c| (c.label(), c.probability, c.declared)).collect();
    bars(&rows, "Probability of each cause (blue: declared)")
}

fn shares(places: &[Place]) -> Result<String, Box<dyn std::error::Error>> {
    let name = |p: &Place| if p.of.is_empty() { p.by.to_owned() } else { format!("{} {}", p.by, p.of) };
    let rows: Vec<_> = places
        .iter()
        .take(14)
        .map(|p| {
            (name(p).chars().take(42).collect(), p.share, ["axis", "instrument", "setup"].contains(&p.by))
        })
        .collect();
    bars(&rows, "Share of the structured gap (blue: these add up)")
}

fn shrink(r: &Report) -> Result<String, Box<dyn std::error::Error>> {
    let s = &r.shrink;
    let mut rows =
        vec![("now".to_owned(), s.rms_before_um, GREY), ("expected".to_owned(), s.rms_after_um, BLUE)];
    if let Some(f) = &r.fresh {
        rows.push(("fresh data, before".to_owned(), f.rms_before_um, GREY));
        rows.push(("fresh data, after".to_owned(), f.rms_after_um, VERMILLION));
    }
    rows.push(("best possible".to_owned(), r.gap.floor_um, INK));
    rows.push(("noise".to_owned(), r.gap.noise_um, INK));
    let most = rows.iter().map(|r| r.1).fold(1e-9, f64::max);
    svg_of((SHEET_WIDTH, 40 + 26 * rows.len() as u32), |area| {
        let pixels = |v: f64| 200 + (540.0 * (v / most).clamp(0.0, 1.0)) as i32;
        for (i, (label, value, colour)) in rows.iter().enumerate() {
            let y = 10 + 26 * i as i32;
            crate::report::plot::words(area, label, (8, y), 13)?;
            area.draw(&Rectangle::new(
                [(200, y), (pixels(*value).max(201), y + 17)],
                colour.mix(0.8).filled(),
            ))?;
            let mut right = pixels(*value);
            if i == 1 {
                let ends = [0, 1].map(|k| pixels(s.rms_before_um * (1.0 - s.ci90[k])));
                right = right.max(ends[0]).max(ends[1]);
                area.draw(&PathElement::new(vec![(ends[0], y + 8), (ends[1], y + 8)], INK.stroke_width(3)))?;
            }
            crate::report::plot::words(area, &format!("{value:.2} um"), (right + 8, y), 13)?;
        }
        let y = 16 + 26 * rows.len() as i32;
        legend(area, &[Key::line(INK, 3, "90 % interval of what is left")], 200, y)
    })
}
