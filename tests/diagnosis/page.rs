//! What `report.html` holds: a curve for each cause, no empty chart, nothing from elsewhere; and the data behind it.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::BTreeMap;

use serde_json::Value;
use volcomp::diagnose::session::{Raw, Session};
use volcomp::diagnose::{Options, diagnose};

use crate::support::{Campaign, Lagged, NOISE, State, history_of, machine, raw, run};

const ARCSEC_UM_PER_MM: f64 = 4.848_136_811e-3;

/// Elements of one kind with what is inside them.
fn elements<'a>(page: &'a str, start: &str, end: &str) -> Vec<&'a str> {
    page.split(start).skip(1).map(|rest| rest.split(end).next().unwrap()).collect()
}

/// Checks a page against its report; gives the number of its charts.
pub(crate) fn is_a_page(page: &str, report: &Value) -> usize {
    for foreign in ["http:", "https:", "src=", "<script", "<link", "url(", "@import"] {
        assert!(!page.contains(foreign), "{foreign}");
    }
    assert!(page.contains("name=\"viewport\"") && page.contains("@page{size:A4"));
    let body = page.split("<body>").nth(1).unwrap();
    for wrong in [
        "NaN",
        "inf ",
        "-0.0",
        "\u{2212}0.0 ",
        "\u{2212}0 %",
        "+0 ",
        ">1 readings",
        "p2_um",
        "reversal_p",
        " um ",
        "(spread)",
    ] {
        assert!(!body.contains(wrong), "{wrong} in {body}");
    }
    // series have names; a colour in words would have to be the one that is drawn
    let named = |word: &str| ["red", "orange", "blue", "green"].contains(&word);
    assert!(!body.split(|c: char| !c.is_ascii_alphabetic()).any(named), "a colour in words: {body}");
    let charts = elements(body, "<svg class=\"chart\"", "</svg>");
    for chart in &charts {
        let series = elements(chart, "<path class=\"", "/>");
        let drawn = |kind: char| {
            series.iter().any(|s| s.starts_with(kind) && s.contains("d=\"M") && !s.starts_with("ref"))
        };
        assert!(drawn('p') || drawn('x') || drawn('o'), "a chart without readings: {chart}");
        assert!(chart.contains("µm</text>"), "an axis without a unit: {chart}");
        assert!(!chart.contains("class=\"key\""), "a legend over the data: {chart}");
    }
    let captions = elements(body, "<figcaption>", "</figcaption>");
    assert_eq!(captions.len(), charts.len());
    for cause in report["causes"].as_array().unwrap() {
        if cause["declared"] == true && cause["kind"] != "stochastic" {
            let (effect, subject) = (cause["effect"].as_str().unwrap(), cause["subject"].as_str().unwrap());
            let label = if subject.is_empty() { effect.to_owned() } else { format!("{effect}:{subject}") };
            let row = body.split(&format!("<small>{label}</small>")).next().unwrap();
            let name = row.rsplit("<b>").next().unwrap().split("</b>").next().unwrap();
            let own = |caption: &&&str| caption.starts_with(&format!("<b>{name}</b>"));
            let caption = captions.iter().find(own).unwrap_or_else(|| panic!("no curve of {label}, {name}"));
            assert!(caption.contains("90 % band"), "{caption}");
        }
    }
    // part programs are shown on request and not printed
    let listed = elements(body, "<pre>", "</pre>").len();
    assert_eq!(
        listed,
        elements(body, "<details>", "</details>").iter().filter(|d| d.contains("<pre>")).count()
    );
    charts.len()
}

/// Levers from millimetres to half a metre: a displacement at one of them says nothing.
#[test]
fn an_angular_error_motion_is_drawn_as_an_angle() {
    let roll = |s: &State| 4.0 * (s.p[0] / 500.0) * ARCSEC_UM_PER_MM;
    let truth = |s: &State| [0.0, -roll(s) * (s.p[2] - s.tool), roll(s) * s.p[1]];
    let found = run(&Campaign::full(), &truth, NOISE, &[]);
    let curve = found.curves.iter().find(|c| c.label == "angular:eax").unwrap();
    let [first, last] = [0, curve.lines[0].points.len() - 1].map(|k| curve.lines[0].points[k]);
    let seen_arcsec = 4.0 * (last[0] - first[0]) / 500.0;
    assert_eq!((curve.unit, curve.y_label.as_str()), ("″", "rotation, ″"));
    assert!(
        (last[1] - first[1] - seen_arcsec).abs() < 4.0 * curve.range.std,
        "{seen_arcsec} {first:?} {last:?}"
    );
    assert!(curve.range.std < 0.2 * seen_arcsec, "{:?}", curve.range);
}

#[test]
fn each_declared_cause_has_a_curve_whose_band_holds_the_truth() {
    let truth = |s: &State| [-2.5 * s.dir[0] + 4.0 * ARCSEC_UM_PER_MM * s.p[1], 0.0, 0.0];
    let found = run(&Campaign::full(), &truth, NOISE, &[]);
    let declared: Vec<String> =
        found.report.causes.iter().filter(|c| c.declared).map(|c| c.label()).collect();
    assert_eq!(declared.len(), 2, "{declared:?}");
    let curve = |label: &str| found.curves.iter().find(|c| c.label == label).unwrap();
    let backlash = curve("backlash:x");
    assert_eq!(backlash.lines.len(), 2, "a line per direction");
    let size = backlash.range;
    assert!(size.std > 0.0 && (size.value - 5.0).abs() < 4.0 * size.std, "{size:?}");
    let square = curve("squareness:xy");
    let points = &square.lines[0].points;
    let (first, last) = (points[0], points[points.len() - 1]);
    let slope = 4.0 * ARCSEC_UM_PER_MM * (last[0] - first[0]);
    assert!((last[1] - first[1] - slope).abs() < 4.0 * square.range.std, "{slope} {first:?} {last:?}");
    for line in found.curves.iter().flat_map(|c| &c.lines) {
        assert!(line.points.windows(2).all(|w| w[0][0] <= w[1][0]), "lines run from left to right");
        assert!(line.points.iter().all(|p| p[2] <= p[1] && p[1] <= p[3]), "the band is about the line");
    }
}

#[test]
fn mean_squares_add_up_from_the_gap_to_the_noise_and_programs_hold_every_reading() {
    let truth = |s: &State| [-2.5 * s.dir[0], 0.015 * s.p[1], 0.0];
    let found = run(&Campaign::full(), &truth, NOISE, &[]);
    let b = &found.budget;
    assert!(b.corrections.len() >= 2, "{b:?}");
    let shares = b.corrections.iter().map(|c| c.share).sum::<f64>();
    assert!((1.0 - shares - (b.after.rms_um / b.before.rms_um).powi(2)).abs() < 1e-9, "{b:?}");
    assert!(b.corrections.windows(2).all(|w| w[0].share >= w[1].share), "{b:?}");
    let rest = [b.unexplained_um, b.roughness_um, b.drift_um, b.noise_um].iter().map(|v| v * v).sum::<f64>();
    assert!((rest - b.after.rms_um.powi(2)).abs() < 1e-9, "{b:?}");
    for c in &b.corrections {
        assert!(c.alone.rms_um < b.before.rms_um && c.all_others.rms_um > b.after.rms_um, "{c:?}");
        assert!(c.size_um.std > 0.0 && c.size_um.std < 0.2 * c.size_um.value, "{c:?}");
    }
    let readings: usize = found.programs.iter().map(|p| p.readings).sum();
    assert_eq!(readings, found.report.rows_used);
    assert!(found.programs.windows(2).all(|w| w[0].after_um >= w[1].after_um));
}

#[test]
fn of_many_files_those_are_drawn_in_which_a_growth_shows() {
    let campaign = Campaign::full();
    let lagged = Lagged::of_the_campaign();
    let growth = |t: f64| 2.0 * lagged.at(t);
    let whole = raw(&campaign, &|s: &State| [0.0, 0.0, growth(s.t)], NOISE);
    let mut files: Vec<Raw> = Vec::new();
    let mut spans: BTreeMap<String, [f64; 2]> = BTreeMap::new();
    for (row, instrument) in whole.instruments.iter().enumerate() {
        let place = files.iter().position(|f| f.file == *instrument).unwrap_or_else(|| {
            let columns = vec![Vec::new(); whole.names.len()];
            files.push(Raw {
                file: instrument.clone(),
                names: whole.names.clone(),
                columns,
                ..Raw::default()
            });
            files.len() - 1
        });
        for (to, from) in files[place].columns.iter_mut().zip(&whole.columns) {
            to.push(from[row]);
        }
        files[place].instruments.push(instrument.clone());
        files[place].lines.push(whole.lines[row]);
        let state = &campaign.states[row];
        if state.u[2].abs() > 0.7 {
            let span = spans.entry(instrument.clone()).or_insert([f64::INFINITY, f64::NEG_INFINITY]);
            *span = [span[0].min(growth(state.t)), span[1].max(growth(state.t))];
        }
    }
    let mut session = Session::build(&files, history_of(files.len()), machine()).unwrap();
    let found = diagnose(&mut session, None, &Options::default(), &mut |_, _| {});
    let curve = found.curves.iter().find(|c| c.label == "spindle-growth" && c.y_label.contains('z')).unwrap();
    let width = |s: &[f64; 2]| s[1] - s[0];
    let widest = spans.iter().max_by(|a, b| width(a.1).total_cmp(&width(b.1))).unwrap();
    assert!(spans.len() > 3 && curve.lines.len() == 3, "{spans:?}");
    assert!(curve.lines.iter().any(|l| l.name == *widest.0), "{widest:?} among {:?}", curve.lines);
    let whole =
        spans.values().fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], s| [l.min(s[0]), h.max(s[1])]);
    let size = curve.range;
    assert!((size.value - width(&whole)).abs() < 0.25 * width(&whole), "{size:?} of {whole:?}");
}
