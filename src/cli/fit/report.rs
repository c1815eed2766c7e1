//! What `volcomp fit` says about its fits: JSON, a table for people, and comments in the model file.

use serde_json::{Map, Value, json};

use super::input::Measured;
use crate::model_writer::Sources;
use volcomp_identify::curve::{Basis, CurveFit, Hidden, Note};
use volcomp_model::ErrorSymbol;
use volcomp_model::curve::Curve;
use volcomp_units::axes::{AxisKind, Travel};
use volcomp_units::{arcsec_from_rad, deg_from_rad, um_from_mm};

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

/// Units of a symbol at the boundary.
pub(crate) struct Units {
    pub(crate) value: &'static str,
    pub(crate) position: &'static str,
    pub(crate) of_value: fn(f64) -> f64,
    pub(crate) of_position: fn(f64) -> f64,
}

impl Units {
    pub(crate) fn of(symbol: ErrorSymbol) -> Self {
        let (value, of_value): (_, fn(f64) -> f64) =
            if symbol.is_angle() { ("arcsec", arcsec_from_rad) } else { ("um", um_from_mm) };
        let (position, of_position): (_, fn(f64) -> f64) = match symbol.axis().kind() {
            AxisKind::Linear => ("mm", |v| v),
            AxisKind::Rotary => ("deg", deg_from_rad),
        };
        Self { value, position, of_value, of_position }
    }

    /// Units per mm or rad.
    fn scale(&self) -> f64 {
        (self.of_value)(1.0)
    }

    fn values(&self, list: &[f64]) -> Value {
        json!(list.iter().map(|v| (self.of_value)(*v)).collect::<Vec<_>>())
    }

    fn positions(&self, list: &[f64]) -> Value {
        json!(list.iter().map(|v| (self.of_position)(*v)).collect::<Vec<_>>())
    }
}

/// The report of `docs/reference/json-output.md` 2: one object per symbol.
pub(crate) fn json_report(fitted: &[Fitted]) -> String {
    let report: Map<String, Value> =
        fitted.iter().map(|f| (f.symbol.to_string().to_lowercase(), Value::Object(one_report(f)))).collect();
    format!("{:#}\n", Value::Object(report))
}

fn one_report(f: &Fitted) -> Map<String, Value> {
    let (units, fit, figures) = (Units::of(f.symbol), &f.fit, &f.fit.figures);
    let (unit, position) = (units.value, units.position);
    let scaled = |v: f64| (units.of_value)(v);
    let mut map = Map::new();
    let mut put = |key: String, value: Value| map.insert(key, value);
    put("basis".into(), json!(fit.basis.name()));
    put("order".into(), json!(fit.order));
    put(format!("period_{position}"), json!(fit.period.map(units.of_position)));
    put("period_fitted".into(), json!(fit.period_fitted));
    put("coefficients".into(), units.values(&fit.coefficients));
    put(format!("sse_{unit}2"), json!(figures.sse * units.scale().powi(2)));
    put(format!("rmse_n_{unit}"), json!(scaled(figures.rmse_n)));
    put(format!("rmse_dof_{unit}"), json!(figures.rmse_dof.map(scaled)));
    put("r2".into(), json!(figures.r2));
    put(format!("emax_{unit}"), json!(scaled(figures.e_max)));
    put("aicc".into(), json!(figures.aicc_in_unit(units.scale())));
    put(format!("loo_rmse_{unit}"), json!(figures.loo_rmse.map(scaled)));
    put(format!("left_out_position_rmse_{unit}"), json!(figures.position_rmse.map(scaled)));
    put("n".into(), json!(figures.n));
    put("m".into(), json!(figures.m));
    put(format!("raw_rms_{unit}"), json!(scaled(f.raw_rms)));
    put(format!("repeatability_{unit}"), json!(figures.repeatability.map(scaled)));
    put("condition".into(), json!(fit.condition));
    put(format!("range_{position}"), json!(fit.curve.range().map(|r| r.map(units.of_position))));
    match &fit.curve {
        Curve::Table(t) => {
            put(format!("position_{position}"), units.positions(t.columns().0));
            put("smoothing".into(), json!(fit.smoothing));
        }
        Curve::Fourier(_) => {
            let with_linear = fit.coefficients.len() % 2 == 0;
            put("linear".into(), json!(with_linear));
            put(format!("periods_{position}"), units.positions(&fit.periods));
        }
        _ => {}
    }
    if let Some(reversal) = &fit.reversal {
        put(format!("reversal_half_coefficients_{unit}"), units.values(&reversal.coefficients));
    }
    put("outliers".into(), Value::Array(outliers(f, &units)));
    uncertainty(f, &units, &mut map);
    map.insert("notes".into(), json!(fit.notes.iter().map(|n| note_text(f.symbol, *n)).collect::<Vec<_>>()));
    map
}

/// Standard deviations of the numbers and of the curve.
fn uncertainty(f: &Fitted, units: &Units, map: &mut Map<String, Value>) {
    let Some(band) = &f.fit.band else { return };
    let (unit, position) = (units.value, units.position);
    let mut std = band.parameter_std();
    let periods = f.fit.periods.len();
    let given = f.fit.periods.iter().position(|p| f.fit.period_fitted && Some(*p) == f.fit.period);
    let fitted = given.map_or(0, |first| periods - first);
    if fitted > 0 && std.len() >= fitted {
        let of_periods = std.split_off(std.len() - fitted);
        map.insert(format!("periods_fitted_std_{position}"), units.positions(&of_periods));
    }
    if let Some(reversal) = &f.fit.reversal {
        let of_reversal = std.split_off(std.len() - reversal.coefficients.len());
        map.insert(format!("reversal_half_coefficients_std_{unit}"), units.values(&of_reversal));
    }
    map.insert(format!("coefficients_std_{unit}"), units.values(&std));
    let [low, high] = f.fit.curve.range().unwrap_or([0.0, 1.0]);
    let at: Vec<f64> =
        (0..=BAND_POINTS).map(|i| low + (high - low) * f64::from(i) / f64::from(BAND_POINTS)).collect();
    let value = |travel| at.iter().map(|x| f.fit.value(*x, travel)).collect::<Vec<_>>();
    let std = |travel| at.iter().map(|x| band.std_at(*x, travel)).collect::<Vec<_>>();
    let mut line = Map::new();
    line.insert(format!("position_{position}"), units.positions(&at));
    line.insert(format!("value_{unit}"), units.values(&value(Travel::Forward)));
    line.insert(format!("std_{unit}"), units.values(&std(Travel::Forward)));
    if f.is_directed() {
        line.insert(format!("reverse_{unit}"), units.values(&value(Travel::Reverse)));
        line.insert(format!("reverse_std_{unit}"), units.values(&std(Travel::Reverse)));
    }
    line.insert("factor_95".into(), json!(band.factor_95()));
    map.insert("band".into(), Value::Object(line));
}

fn outliers(f: &Fitted, units: &Units) -> Vec<Value> {
    f.fit
        .outliers
        .iter()
        .map(|o| {
            let (r, (file, line)) = (&f.measured.readings[o.index], f.measured.place(o.index));
            let mut map = Map::new();
            map.insert("file".into(), json!(file));
            map.insert("line".into(), if line > 0 { json!(line) } else { Value::Null });
            map.insert("reading".into(), json!(o.index + 1));
            map.insert("cycle".into(), json!(r.cycle));
            map.insert("direction".into(), json!(if r.travel == Travel::Forward { 1 } else { -1 }));
            map.insert(format!("position_{}", units.position), json!((units.of_position)(r.position)));
            map.insert(format!("deviation_{}", units.value), json!((units.of_value)(o.deviation)));
            Value::Object(map)
        })
        .collect()
}

/// One line per outlier, for people.
pub(crate) fn outlier_lines(f: &Fitted) -> Vec<String> {
    let units = Units::of(f.symbol);
    f.fit
        .outliers
        .iter()
        .map(|o| {
            let (r, (file, line)) = (&f.measured.readings[o.index], f.measured.place(o.index));
            let place = if line > 0 { format!("{file}:{line}") } else { file.to_owned() };
            format!(
                "{place}: {} at {} {}, cycle {}, towards {}: {:+.2} {} off the curve, left out",
                f.symbol,
                (units.of_position)(r.position),
                units.position,
                r.cycle,
                if r.travel == Travel::Forward { "plus" } else { "minus" },
                (units.of_value)(o.deviation),
                units.value
            )
        })
        .collect()
}

/// What the targets of an axis cannot show, in words.
pub(crate) fn hidden_text(hidden: &Hidden) -> Option<String> {
    let list = |pitches: &[f64]| pitches.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
    let mut parts = Vec::new();
    if !hidden.constant.is_empty() {
        parts.push(format!("of {} mm pitch looks like an offset", list(&hidden.constant)));
    }
    if !hidden.slower.is_empty() {
        parts.push(format!("of {} mm pitch looks like a slower wave", list(&hidden.slower)));
    }
    (!parts.is_empty()).then(|| {
        format!(
            "targets every {} mm cannot show every screw: an error {}; measure one stretch closer than half the pitch, at uneven distances (--screw-pitch-mm names the pitch, none silences this)",
            (hidden.spacing * 1e6).round() / 1e6,
            parts.join(", one ")
        )
    })
}

/// A note in words.
pub(crate) fn note_text(symbol: ErrorSymbol, note: Note) -> String {
    let units = Units::of(symbol);
    match note {
        Note::IllConditioned { condition } => format!(
            "the terms nearly cancel (condition {condition:.0e}): the curve holds on the data, its coefficients mean little; half-range or chebyshev, or --ridge, avoids it"
        ),
        Note::ReversalLeftOut { mean } => format!(
            "both directions were measured, this curve holds their mean; mean reversal {:.2} {} stays (--reversal auto or --basis table keeps it)",
            (units.of_value)(mean),
            units.value
        ),
        Note::ReversalKept { mean } => format!(
            "both directions were measured; a table beside the curve holds the reversal, {:.2} {} in the mean (--reversal mean leaves it out)",
            (units.of_value)(mean),
            units.value
        ),
        Note::SparseTargets { error, lower } => format!(
            "the targets are too far apart for this error: left-out targets are predicted to {:.2} {} only, and better by order {lower}; measure closer, or use --basis table",
            (units.of_value)(error),
            units.value
        ),
        Note::OrderLowered { from, to } => {
            format!("order {to} instead of {from}: it predicts left-out positions better")
        }
        Note::TurnLeftOpen { step } => format!(
            "a whole turn was measured, but this basis does not close: {:.2} {} between its ends; --basis fourier or table does",
            (units.of_value)(step),
            units.value
        ),
    }
}

/// One line per error motion on stdout.
pub(crate) fn print_table(fitted: &[Fitted]) {
    say!(
        "{:<7}{:<11}{:>6}{:>10}{:>6}{:>4}{:>11}{:>11}{:>11}{:>11}{:>15}  unit",
        "error",
        "basis",
        "order",
        "period",
        "n",
        "m",
        "raw rms",
        "rmse",
        "largest",
        "left out",
        "repeatable to"
    );
    for f in fitted {
        let units = Units::of(f.symbol);
        let show =
            |v: Option<f64>| v.map_or_else(|| "-".to_owned(), |v| format!("{:.3}", (units.of_value)(v)));
        let period =
            f.fit.period.map_or_else(|| "-".to_owned(), |p| format!("{:.2}", (units.of_position)(p)));
        let order = f.fit.order.map_or_else(|| "-".to_owned(), |o| o.to_string());
        let figures = &f.fit.figures;
        say!(
            "{:<7}{:<11}{order:>6}{period:>10}{:>6}{:>4}{:>11}{:>11}{:>11}{:>11}{:>15}  {}",
            f.symbol.to_string(),
            f.fit.basis.name(),
            figures.n,
            figures.m,
            show(Some(f.raw_rms)),
            show(figures.rmse_dof),
            show(Some(figures.e_max)),
            show(figures.position_rmse),
            show(figures.repeatability),
            units.value
        );
    }
}

/// Comment lines that say where the curves came from; `command` is that of volcomp.
pub(crate) fn comments(command: &str, sources: &Sources, fitted: &[Fitted]) -> Vec<String> {
    let mut lines = vec![format!("written by volcomp {command} {}", env!("CARGO_PKG_VERSION"))];
    lines.extend(sources.comments());
    for f in fitted {
        let units = Units::of(f.symbol);
        let order = match (f.fit.basis, f.fit.order) {
            (Basis::Table, _) | (_, None) => String::new(),
            (_, Some(order)) => format!(" of order {order}"),
        };
        let reversal = if f.fit.reversal.is_some() { " with reversal" } else { "" };
        let out = match f.fit.outliers.len() {
            0 => String::new(),
            n => format!(", {n} outliers left out"),
        };
        let figures = &f.fit.figures;
        lines.push(format!(
            "{}: {}{order}{reversal}, n {}, m {}, rmse {:.4} {}{out}",
            f.symbol,
            f.fit.basis.name(),
            figures.n,
            figures.m,
            (units.of_value)(figures.rmse_dof.unwrap_or(figures.rmse_n)),
            units.value
        ));
    }
    lines
}
