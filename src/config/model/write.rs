//! Writing a model so that reading it gives the same model.

use std::fmt::{Display, Write as _};

use super::axes::CORRECTION_LIMIT;
use super::keys::{PositionKeys, ValueKeys, grid_key};
use super::number::{plain, shortest};
use super::{FORMAT, ModelFile, Provenance, dynamics, thermal};
use crate::prelude::*;
use volcomp_model::curve::{Grid, Interpolation};
use volcomp_model::geometry::Vec3;
use volcomp_model::spec::ReferenceBody;
use volcomp_model::{AxisSpec, Curve, Sense};

/// Numbers of a list per line.
const PER_LINE: usize = 10;

/// Writes a model with its provenance so that [`parse_file`](super::parse_file) gives the same back; `comment` lines go on
/// top, each behind `#`. An error without curves is zero and is not written.
#[must_use]
pub fn write_file(model: &ModelFile, comment: &[String]) -> String {
    let spec = &model.spec;
    let mut out = String::new();
    for line in comment.iter().flat_map(|c| c.lines()) {
        // control characters are not allowed in comments
        let clean: String = line.chars().filter(|c| !c.is_control()).collect();
        line_of(&mut out, format_args!("# {clean}"));
    }
    entry(&mut out, "format", quoted(FORMAT));
    entry(&mut out, "machine", quoted(&spec.machine));
    entry(&mut out, "chain", quoted(&spec.chain.to_string()));
    if !model.provenance.is_empty() {
        heading(&mut out, "provenance");
        write_provenance(&mut out, &model.provenance);
    }
    heading(&mut out, "frame");
    entry(&mut out, "workpiece-origin-mm", point(&spec.workpiece_origin));
    entry(&mut out, "tool-tip-mm", point(&spec.tool_tip));
    entry_if(&mut out, "gauge-point-mm", spec.gauge_point.as_ref().map(point));
    entry_if(&mut out, "vertical", spec.vertical.map(|up| format!("\"{}\"", up.lower())));
    if !spec.datum.is_empty() {
        heading(&mut out, "frame.datum");
        for (axis, at) in &spec.datum {
            entry(&mut out, grid_key(*axis), position(*at, PositionKeys::of(*axis)));
        }
    }
    dynamics::write_tool(&mut out, &spec.tool);
    for axis in &spec.axes {
        write_axis(&mut out, axis);
    }
    // a rotary axis must say where it turns, even where the model leaves that to the default
    for axis in spec.chain.axes().iter().filter(|a| a.kind() == AxisKind::Rotary && !a.spindle) {
        if !spec.axes.iter().any(|a| a.name == axis.name) {
            write_axis(&mut out, &AxisSpec::new(axis.name));
        }
    }
    for (symbol, function) in &spec.errors {
        let origin = model.of_errors.iter().find(|(s, _)| s == symbol).map(|(_, p)| p);
        write_error(&mut out, *symbol, function, origin);
    }
    for thermal in &model.thermal {
        thermal::write(&mut out, thermal);
    }
    out
}

/// One key.
pub(super) fn entry(out: &mut String, key: &str, value: impl Display) {
    line_of(out, format_args!("{key} = {value}"));
}

/// A key that is left out where it has no value.
pub(super) fn entry_if(out: &mut String, key: &str, value: Option<impl Display>) {
    if let Some(value) = value {
        entry(out, key, value);
    }
}

pub(super) fn line_of(out: &mut String, line: core::fmt::Arguments<'_>) {
    // writing to a string cannot fail
    let _ = writeln!(out, "{line}");
}

pub(super) fn heading(out: &mut String, name: &str) {
    line_of(out, format_args!("\n[{name}]"));
}

/// The heading of a part of an error, which is one of several or the only one of its kind.
pub(super) fn part_heading(out: &mut String, name: &str, kind: &str, is_of_several: bool) {
    if is_of_several {
        line_of(out, format_args!("\n[[{name}.{kind}]]"));
    } else {
        heading(out, &format!("{name}.{kind}"));
    }
}

fn write_axis(out: &mut String, axis: &AxisSpec) {
    let keys = PositionKeys::of(axis.name);
    heading(out, &format!("axes.{}", axis.name.lower()));
    entry_if(out, keys.travel, axis.travel.map(|travel| position_list(&travel, keys)));
    if axis.name.kind() == AxisKind::Rotary {
        entry(out, "point-mm", point(&axis.point));
        if axis.correction_limit != AxisSpec::new(axis.name).correction_limit {
            let limit = axis.correction_limit;
            entry(out, CORRECTION_LIMIT, shortest(limit, arcsec_from_rad(limit), rad_from_arcsec));
        }
    }
    if axis.sense == Sense::Carriage {
        line_of(out, format_args!("sense = \"carriage\""));
    }
    if axis.name.kind() == AxisKind::Linear {
        write_reference_points(out, axis);
    }
}

fn write_reference_points(out: &mut String, axis: &AxisSpec) {
    let [x, y, z] = &axis.reference_points;
    if [x, y, z].iter().any(|r| r.point != Vec3::zeros()) {
        let (x, y, z) = (point(&x.point), point(&y.point), point(&z.point));
        line_of(out, format_args!("reference-points-mm = {{ x = {x}, y = {y}, z = {z} }}"));
    }
    let [x, y, z] = [x, y, z].map(|r| match r.body {
        ReferenceBody::Carriage => "\"carriage\"",
        ReferenceBody::Bed => "\"bed\"",
    });
    if x != y || y != z {
        line_of(out, format_args!("reference-body = {{ x = {x}, y = {y}, z = {z} }}"));
    } else if x == "\"bed\"" {
        line_of(out, format_args!("reference-body = {x}"));
    }
}

fn write_error(out: &mut String, symbol: ErrorSymbol, function: &ErrorFunction, origin: Option<&Provenance>) {
    let is_empty = function.curves.is_empty() && function.grids.is_empty() && function.live.is_empty();
    if is_empty && function.dynamics.is_empty() {
        return;
    }
    let (at, of) = (PositionKeys::of(symbol.axis()), ValueKeys::of(symbol));
    let name = format!("errors.{}", symbol.to_string().to_lowercase());
    let origin = origin.filter(|p| !p.is_empty());
    if function.std.is_some() || origin.is_some() {
        heading(out, &name);
        entry_if(out, of.std, function.std.map(|std| value(std, of)));
        if let Some(origin) = origin {
            write_provenance(out, origin);
        }
    }
    let several = |kind: &str| function.curves.iter().filter(|c| kind_of(c) == kind).count() > 1;
    for curve in &function.curves {
        let kind = kind_of(curve);
        part_heading(out, &name, kind, several(kind));
        write_curve(out, curve, at, of);
    }
    for grid in &function.grids {
        part_heading(out, &name, "grid", function.grids.len() > 1);
        write_grid(out, grid, of);
    }
    for live in &function.live {
        part_heading(out, &name, "live", function.live.len() > 1);
        entry(out, "sensor", quoted(&live.sensor));
        entry(out, of.limit, value(live.limit, of));
        entry_if(out, "reference-mm", live.reference.map(plain));
    }
    dynamics::write(out, symbol, &function.dynamics);
}

fn write_grid(out: &mut String, grid: &Grid, of: &ValueKeys) {
    let names: Vec<String> = grid.axes().map(|a| format!("\"{}\"", a.lower())).collect();
    line_of(out, format_args!("axes = [{}]", names.join(", ")));
    for (i, axis) in grid.axes().enumerate() {
        let at = PositionKeys::of(axis);
        entry(out, grid_key(axis), position_list(grid.positions(i), at));
    }
    entry(out, of.value, value_list(grid.values(), of));
}

/// The key of a curve: `constant`, `table`, `fourier`, `half-range`, `chebyshev`.
#[must_use]
pub fn kind_of(curve: &Curve) -> &'static str {
    match curve {
        Curve::Constant(_) => "constant",
        Curve::Table(_) => "table",
        Curve::Fourier(_) => "fourier",
        Curve::HalfRange(_) => "half-range",
        Curve::Chebyshev(_) => "chebyshev",
    }
}

fn write_curve(out: &mut String, curve: &Curve, at: &PositionKeys, of: &ValueKeys) {
    match curve {
        Curve::Constant(v) => entry(out, of.value, value(*v, of)),
        Curve::Table(t) => {
            let (positions, forward, reverse) = t.columns();
            entry(out, at.position, position_list(positions, at));
            entry(out, of.value, value_list(forward, of));
            entry_if(out, of.reverse, reverse.map(|list| value_list(list, of)));
            if t.interpolation() == Interpolation::MonotoneCubic {
                line_of(out, format_args!("interpolation = \"cubic\""));
            }
        }
        Curve::Fourier(f) => {
            let (mean, linear) = f.mean_and_linear();
            entry(out, at.origin, position(f.range()[0], at));
            entry(out, at.span, position(f.span(), at));
            entry(out, at.period, position(f.period(), at));
            entry(out, of.mean, value(mean, of));
            entry(out, of.linear, value(linear, of));
            let cos: Vec<f64> = f.harmonics().iter().map(|h| h[0]).collect();
            let sin: Vec<f64> = f.harmonics().iter().map(|h| h[1]).collect();
            // the sines carry the number of harmonics, so cosines that are all zero need no list
            let cos = if cos.iter().all(|&c| c == 0.0) { Vec::new() } else { cos };
            entry(out, of.cos, value_list(&cos, of));
            entry(out, of.sin, value_list(&sin, of));
        }
        Curve::HalfRange(h) => {
            let (mean, linear, sin) = h.coefficients();
            let sin: Vec<f64> = sin.collect();
            entry(out, at.range, position_list(&h.range(), at));
            entry(out, of.mean, value(mean, of));
            entry(out, of.linear, value(linear, of));
            entry(out, of.sin, value_list(&sin, of));
        }
        Curve::Chebyshev(c) => {
            entry(out, at.range, position_list(&c.range(), at));
            entry(out, of.coefficients, value_list(c.coefficients(), of));
        }
    }
}

fn write_provenance(out: &mut String, p: &Provenance) {
    let Provenance {
        instrument,
        date,
        operator,
        temperature_degc,
        expiry,
        source,
        source_hash,
        sources,
        note,
    } = p;
    for (key, text) in [
        ("instrument", instrument),
        ("date", date),
        ("operator", operator),
        ("expiry", expiry),
        ("source", source),
        ("source-hash", source_hash),
        ("note", note),
    ] {
        entry_if(out, key, text.as_deref().map(quoted));
    }
    entry_if(out, "temperature-degc", temperature_degc.map(plain));
    if sources.is_empty() {
        return;
    }
    line_of(out, format_args!("sources = ["));
    for s in sources {
        let pairs = [
            ("source", &s.source),
            ("source-hash", &s.source_hash),
            ("instrument", &s.instrument),
            ("date", &s.date),
        ];
        let written =
            pairs.iter().filter_map(|(key, text)| Some(format!("{key} = {}", quoted(text.as_ref()?))));
        line_of(out, format_args!("    {{ {} }},", written.collect::<Vec<_>>().join(", ")));
    }
    line_of(out, format_args!("]"));
}

/// A basic string of TOML.
pub(super) fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

fn point(p: &Vec3) -> String {
    format!("[{}, {}, {}]", plain(p.x), plain(p.y), plain(p.z))
}

fn position(v: f64, at: &PositionKeys) -> String {
    shortest(v, (at.write)(v), at.read)
}

fn value(v: f64, of: &ValueKeys) -> String {
    shortest(v, (of.write)(v), of.read)
}

fn position_list(list: &[f64], at: &PositionKeys) -> String {
    folded(list.iter().map(|&v| position(v, at)).collect())
}

fn value_list(list: &[f64], of: &ValueKeys) -> String {
    folded(list.iter().map(|&v| value(v, of)).collect())
}

/// A list on one line, or on several where it is long.
fn folded(items: Vec<String>) -> String {
    if items.len() <= PER_LINE {
        return format!("[{}]", items.join(", "));
    }
    let lines: Vec<String> =
        items.chunks(PER_LINE).map(|line| format!("    {},\n", line.join(", "))).collect();
    format!("[\n{}]", lines.concat())
}
