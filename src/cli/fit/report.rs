//! What `volcomp fit` says about its fits: JSON, a table for people, and comments in the model file.

use super::input::Measured;
use super::start_up;
use crate::prelude::*;
use volcomp_identify::curve::{Basis, Course, CurveFit, CycleDrift, Figures, Hidden, Note, Outlier};

/// Positions of the band in the report.
const BAND_POINTS: u32 = 100;

/// One error motion, its readings and its curve.
pub(crate) struct Fitted {
    pub(crate) symbol: ErrorSymbol,
    pub(crate) measured: Measured,
    pub(crate) fit: CurveFit,
    raw_rms: f64,
}

impl Fitted {
    pub(crate) fn new(symbol: ErrorSymbol, measured: Measured, fit: CurveFit) -> Self {
        let readings = &measured.readings;
        let squares: f64 = readings.iter().map(|r| r.value * r.value).sum();
        let raw_rms = (squares / readings.len() as f64).sqrt();
        Self { symbol, measured, fit, raw_rms }
    }

    /// True where the curve differs between the directions of travel.
    pub(crate) fn is_directed(&self) -> bool {
        let directed = |c: &Curve| matches!(c, Curve::Table(t) if t.columns().2.is_some());
        directed(&self.fit.curve) || self.fit.more.iter().any(directed)
    }
}

/// The report of `docs/reference/json-output.md` 2: one object per symbol.
pub(crate) fn json_report(fitted: &[Fitted]) -> String {
    let report: Value = fitted.iter().map(|f| (key(f.symbol), one_report(f))).collect();
    format!("{report:#}\n")
}

fn one_report(f: &Fitted) -> Value {
    let (units, fit, figures) = (Units::of(f.symbol), &f.fit, &f.fit.figures);
    let Units { value: unit, position, of_value, of_position, .. } = units;
    let scale = of_value(1.0);
    let mut json = fields!(fit; order, period_fitted, condition;
        "basis": fit.basis.name(),
        format!("period_{position}"): fit.period.map(of_position),
        "coefficients": units.values(&fit.coefficients),
        format!("sse_{unit}2"): figures.sse * scale.powi(2),
        format!("rmse_n_{unit}"): of_value(figures.rmse_n),
        format!("rmse_dof_{unit}"): figures.rmse_dof.map(of_value),
        "r2": figures.r2,
        format!("emax_{unit}"): of_value(figures.e_max),
        "aicc": figures.aicc_in_unit(scale),
        format!("loo_rmse_{unit}"): figures.loo_rmse.map(of_value),
        format!("left_out_position_rmse_{unit}"): figures.position_rmse.map(of_value),
        "n": figures.n,
        "m": figures.m,
        format!("raw_rms_{unit}"): of_value(f.raw_rms),
        format!("repeatability_{unit}"): figures.repeatability.map(of_value),
        format!("std_{unit}"): fit.standard_uncertainty().map(of_value),
        format!("lack_of_fit_{unit}"): of_value(fit.lack_of_fit),
        format!("range_{position}"): fit.curve.range().map(|r| r.map(of_position)),
        "outliers": outliers(f, &units),
        "notes": fit.notes.iter().map(|n| note_text(f.symbol, *n)).chain(start_up::remedy(f)).collect::<Vec<_>>(),
    );
    let kept = start_up::as_json(f);
    if !kept.is_empty() {
        json["start_up_outliers"] = json!(kept);
    }
    match &fit.curve {
        Curve::Table(t) => {
            json[format!("position_{position}")] = json!(units.positions(t.columns().0));
            json["smoothing"] = json!(fit.smoothing);
        }
        Curve::Fourier(_) => {
            json["linear"] = json!(fit.coefficients.len() % 2 == 0);
            json[format!("periods_{position}")] = json!(units.positions(&fit.periods));
        }
        _ => {}
    }
    if let Some(reversal) = &fit.reversal {
        json[format!("reversal_half_coefficients_{unit}")] = json!(units.values(&reversal.coefficients));
    }
    if let Some(reversal) = fit.mean_reversal {
        json[format!("mean_reversal_{unit}")] = json!(of_value(reversal.value));
        json[format!("mean_reversal_std_{unit}")] = json!(reversal.std.map(of_value));
    }
    json["drift"] = json!(fit.drift.map(|d| json!({
        "course": course_name(d.course),
        format!("per_cycle_{unit}"): of_value(d.per_cycle),
        format!("per_cycle_std_{unit}"): of_value(d.per_cycle_std),
        "p_value": d.p_value,
        format!("in_mean_reversal_{unit}"): of_value(d.in_reversal),
        "subtracted": d.subtracted,
    })));
    uncertainty(f, &units, &mut json);
    json
}

/// Standard deviations of the numbers and of the curve.
fn uncertainty(f: &Fitted, units: &Units, json: &mut Value) {
    let Some(band) = &f.fit.band else { return };
    let (unit, position) = (units.value, units.position);
    let mut std = band.parameter_std();
    let of_reversal = f.fit.reversal.as_ref().map_or(0, |r| r.coefficients.len());
    // a table has none, and values more: those that close a turn
    let all_but_periods =
        if f.fit.period_fitted { f.fit.coefficients.len() + of_reversal } else { std.len() };
    let of_periods = std.split_off(all_but_periods.min(std.len()));
    if !of_periods.is_empty() {
        json[format!("periods_fitted_std_{position}")] = json!(units.positions(&of_periods));
    }
    if of_reversal > 0 {
        let of_reversal = std.split_off(std.len() - of_reversal);
        json[format!("reversal_half_coefficients_std_{unit}")] = json!(units.values(&of_reversal));
    }
    json[format!("coefficients_std_{unit}")] = json!(units.values(&std));
    let [low, high] = f.fit.curve.range().unwrap_or([0.0, 1.0]);
    let at: Vec<f64> =
        (0..=BAND_POINTS).map(|i| low + (high - low) * f64::from(i) / f64::from(BAND_POINTS)).collect();
    let mut line = json!({
        format!("position_{position}"): units.positions(&at),
        "factor_95": band.factor_95(),
    });
    let mut put = |value: &str, std: &str, travel| {
        let values = at.iter().map(|x| (units.of_value)(f.fit.value(*x, travel)));
        line[format!("{value}_{unit}")] = values.collect();
        let stds = at.iter().map(|x| (units.of_value)(band.std_at(*x, travel)));
        line[format!("{std}_{unit}")] = stds.collect();
    };
    put("value", "std", Travel::Forward);
    if f.is_directed() {
        put("reverse", "reverse_std", Travel::Reverse);
    }
    json["band"] = line;
}

fn outliers(f: &Fitted, units: &Units) -> Vec<Value> {
    let one = |o: &Outlier| {
        let (r, (file, line)) = (&f.measured.readings[o.index], f.measured.place(o.index));
        json!({
            "file": file,
            "line": (line > 0).then_some(line),
            "reading": o.index + 1,
            "cycle": r.cycle,
            "direction": if r.travel == Travel::Forward { 1 } else { -1 },
            format!("position_{}", units.position): (units.of_position)(r.position),
            format!("deviation_{}", units.value): (units.of_value)(o.deviation),
        })
    };
    f.fit.outliers.iter().map(one).collect()
}

/// One line per outlier, for people.
pub(crate) fn outlier_lines(f: &Fitted) -> Vec<String> {
    let (symbol, Units { value: unit, position, of_value, of_position, .. }) =
        (f.symbol, Units::of(f.symbol));
    let one = |o: &Outlier| {
        let (r, (file, line)) = (&f.measured.readings[o.index], f.measured.place(o.index));
        let place = if line > 0 { format!("{file}:{line}") } else { file.to_owned() };
        let towards = if r.travel == Travel::Forward { "plus" } else { "minus" };
        let (cycle, at, off) = (r.cycle, of_position(r.position), of_value(o.deviation));
        format!(
            "{place}: {symbol} at {at} {position}, cycle {cycle}, towards {towards}: {off:+.2} {unit} off the curve, left out"
        )
    };
    f.fit.outliers.iter().map(one).collect()
}

/// What the targets of an axis cannot show, in words.
pub(crate) fn hidden_text(hidden: &Hidden) -> Option<String> {
    let looks = [(&hidden.constant, "an offset"), (&hidden.slower, "a slower wave")].into_iter();
    let parts = looks.filter(|(pitches, _)| !pitches.is_empty()).map(|(pitches, what)| {
        format!("of {} mm pitch looks like {what}", pitches.iter().map(f64::to_string).joined(", "))
    });
    let (spacing, parts) = ((hidden.spacing * 1e6).round() / 1e6, parts.joined(", one "));
    (!parts.is_empty()).then(|| format!(
        "targets every {spacing} mm cannot show every screw: an error {parts}; measure one stretch closer than half the pitch, at uneven distances (--screw-pitch-mm names the pitch, none silences this)"
    ))
}

/// A note in words.
pub(crate) fn note_text(symbol: ErrorSymbol, note: Note) -> String {
    let show = |v: f64| Units::of(symbol).text(v, 2);
    match note {
        Note::IllConditioned { condition } => format!(
            "the terms nearly cancel (condition {condition:.0e}): the curve holds on the data, its coefficients mean little; half-range or chebyshev, or --ridge, avoids it"
        ),
        Note::ReversalLeftOut { mean } => format!(
            "both directions were measured, this curve holds their mean; mean reversal {} stays (--reversal auto or --basis table keeps it)",
            show(mean)
        ),
        Note::ReversalKept { mean } => format!(
            "both directions were measured; a table beside the curve holds the reversal, {} in the mean (--reversal mean leaves it out)",
            show(mean)
        ),
        Note::Drift(drift) => drift_text(symbol, &drift),
        Note::SparseTargets { error, lower } => format!(
            "the targets are too far apart for this error: left-out targets are predicted to {} only, and better by order {lower}; measure closer, or use --basis table",
            show(error)
        ),
        Note::OrderLowered { from, to } => {
            format!("order {to} instead of {from}: it predicts left-out positions better")
        }
        Note::TurnLeftOpen { step } => format!(
            "a whole turn was measured, but this basis does not close: {} between its ends; --basis fourier or table does",
            show(step)
        ),
    }
}

/// A drift over the cycles in words.
fn drift_text(symbol: ErrorSymbol, drift: &CycleDrift) -> String {
    let show = |v: f64| Units::of(symbol).text(v, 2);
    let (mean, u) = (show(drift.per_cycle), show(2.0 * drift.per_cycle_std));
    let (course, p) = (course_name(drift.course), small(drift.p_value));
    let found =
        format!("the readings drift over the cycles ({course}): {mean} per cycle, U {u} (k = 2), p {p}");
    match (drift.course, drift.subtracted) {
        (Course::Steps, true) => {
            format!("{found}; the offsets of the cycles were subtracted, the reversal is unchanged")
        }
        (Course::Steps, false) => format!("{found}; kept: the reversal error does not contain it"),
        (_, true) => format!(
            "{found}; subtracted, with {} in the mean reversal error (--drift keep leaves it in); without time stamps the cycles are \
             taken as equally long, out and back without a pause",
            show(drift.in_reversal)
        ),
        (_, false) => format!(
            "{found}; kept: {} of the mean reversal error is drift; subtract it (--drift auto), measure again when the machine is \
             warm, or fit one direction (--direction forward)",
            show(drift.in_reversal)
        ),
    }
}

const fn course_name(course: Course) -> &'static str {
    match course {
        Course::Steps => "steps between cycles",
        Course::Linear => "linear",
        Course::Walk => "random walk",
    }
}

/// The notes of the fits.
pub(crate) fn print_notes(fitted: &[Fitted]) {
    for f in fitted {
        start_up::print(f);
        for note in &f.fit.notes {
            note!("note: {}: {}", f.symbol, note_text(f.symbol, *note));
        }
    }
}

/// One line per error motion.
pub(crate) fn table(fitted: &[Fitted]) -> String {
    let mut text = String::from(
        "error  basis       order    period     n   m    raw rms       rmse    u (k=1)    largest   left out  repeatable to  unit\n",
    );
    for f in fitted {
        let Units { value: unit, of_value, of_position, .. } = Units::of(f.symbol);
        let (figures, symbol, basis) = (&f.fit.figures, f.symbol, f.fit.basis.name());
        let period = or_dash(f.fit.period.map(of_position), 2);
        let order = f.fit.order.map_or_else(|| "-".to_owned(), |o| o.to_string());
        let [raw, rmse, u, largest, left_out, repeatable] = [
            Some(f.raw_rms),
            figures.rmse_dof,
            f.fit.standard_uncertainty(),
            Some(figures.e_max),
            figures.position_rmse,
            figures.repeatability,
        ]
        .map(|v| or_dash(v.map(of_value), 3));
        let Figures { n, m, .. } = figures;
        text.push_str(&format!(
            "{symbol:<7}{basis:<11}{order:>6}{period:>10}{n:>6}{m:>4}{raw:>11}{rmse:>11}{u:>11}{largest:>11}{left_out:>11}{repeatable:>15}  {unit}\n"
        ));
    }
    text.push_str("n: readings; m: numbers of the curve; rmse: scatter of the readings; u: standard uncertainty of the curve\n");
    text
}

/// Comment lines that say where the curves came from; `command` is that of volcomp.
pub(crate) fn comments(command: &str, sources: &Sources, fitted: &[Fitted]) -> Vec<String> {
    let mut lines = sources.heading(command);
    for f in fitted {
        let (symbol, basis, Figures { n, m, rmse_dof, rmse_n, .. }) =
            (f.symbol, f.fit.basis.name(), &f.fit.figures);
        let order = match (f.fit.basis, f.fit.order) {
            (Basis::Table, _) | (_, None) => String::new(),
            (_, Some(order)) => format!(" of order {order}"),
        };
        let reversal = if f.fit.reversal.is_some() { " with reversal" } else { "" };
        let out = match f.fit.outliers.len() {
            0 => String::new(),
            n => format!(", {n} outliers left out"),
        };
        let text = |v: f64| Units::of(symbol).text(v, 4);
        let rmse = text(rmse_dof.unwrap_or(*rmse_n));
        let u = f.fit.standard_uncertainty();
        let u = u.map_or_else(String::new, |u| format!(", u of the curve {} (k = 1)", text(u)));
        lines.push(format!("{symbol}: {basis}{order}{reversal}, n {n}, m {m}, rmse {rmse}{u}{out}"));
    }
    lines
}
