//! What `volcomp fit` says about its fits: JSON, a table for people, and comments in the model file.

use std::path::PathBuf;

use serde_json::{Map, Value, json};

use super::model_out::sources;
use crate::core::axes::AxisKind;
use crate::core::model::ErrorSymbol;
use crate::core::model::curve::Curve;
use crate::core::units::{arcsec_from_rad, deg_from_rad, um_from_mm};
use crate::identify::Reading;
use crate::identify::curve::{Basis, CurveFit, Note};
use crate::identify::reading::repeatability;

/// One error motion, its readings and its curve.
pub(super) struct Fitted {
    pub(super) symbol: ErrorSymbol,
    pub(super) readings: Vec<Reading>,
    pub(super) fit: CurveFit,
}

/// Units of a symbol at the boundary.
struct Units {
    value: &'static str,
    position: &'static str,
    of_value: fn(f64) -> f64,
    of_position: fn(f64) -> f64,
}

impl Units {
    fn of(symbol: ErrorSymbol) -> Self {
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
}

/// The report of contract section 5: one object per symbol.
pub(super) fn json_report(fitted: &[Fitted]) -> String {
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
    put("coefficients".into(), json!(fit.coefficients.iter().map(|c| scaled(*c)).collect::<Vec<_>>()));
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
    put(format!("raw_rms_{unit}"), json!(scaled(raw_rms(f))));
    put(format!("repeatability_{unit}"), json!(repeatability(&f.readings).map(scaled)));
    put("condition".into(), json!(fit.condition));
    put(format!("range_{position}"), json!(fit.curve.range().map(|r| r.map(units.of_position))));
    match &fit.curve {
        Curve::Table(t) => {
            let at: Vec<f64> = t.columns().0.iter().map(|p| (units.of_position)(*p)).collect();
            put(format!("position_{position}"), json!(at));
        }
        Curve::Fourier(_) => {
            let with_linear = fit.coefficients.len() % 2 == 0;
            put("linear".into(), json!(with_linear));
        }
        _ => {}
    }
    put("notes".into(), json!(fit.notes.iter().map(|n| note_text(f.symbol, *n)).collect::<Vec<_>>()));
    map
}

fn raw_rms(f: &Fitted) -> f64 {
    (f.readings.iter().map(|r| r.value * r.value).sum::<f64>() / f.readings.len() as f64).sqrt()
}

/// A note in words.
pub(super) fn note_text(symbol: ErrorSymbol, note: Note) -> String {
    let units = Units::of(symbol);
    match note {
        Note::IllConditioned { condition } => format!(
            "the terms nearly cancel (condition {condition:.0e}): the curve holds on the data, its coefficients mean little; half-range or chebyshev, or --ridge, avoids it"
        ),
        Note::ReversalLeftOut { mean } => format!(
            "both directions were measured, this curve holds their mean; mean reversal {:.2} {} stays (--basis table keeps it)",
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
    }
}

/// One line per error motion on stdout.
pub(super) fn print_table(fitted: &[Fitted]) {
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
            show(Some(raw_rms(f))),
            show(figures.rmse_dof),
            show(Some(figures.e_max)),
            show(figures.position_rmse),
            show(repeatability(&f.readings)),
            units.value
        );
    }
}

/// Comment lines that say where the curves came from.
pub(super) fn provenance(files: &[PathBuf], fitted: &[Fitted]) -> Vec<String> {
    let mut lines = vec![format!("written by volcomp fit {}", env!("CARGO_PKG_VERSION"))];
    lines.extend(sources(files));
    for f in fitted {
        let units = Units::of(f.symbol);
        let order = match (f.fit.basis, f.fit.order) {
            (Basis::Table, _) | (_, None) => String::new(),
            (_, Some(order)) => format!(" of order {order}"),
        };
        let figures = &f.fit.figures;
        lines.push(format!(
            "{}: {}{order}, n {}, m {}, rmse {:.4} {}",
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
