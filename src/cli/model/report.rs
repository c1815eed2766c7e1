//! What `model show` says, in words and for programs.

use serde_json::{Map, Value, json};

use super::super::check::{Size, kinds_of, offset_out, offset_unit, position_out, position_unit, rounded};
use super::worst::{Extreme, Found, kept_in_place};
use super::{drawing, gauge};
use crate::numerals::{plain, signed};
use volcomp_config::model::FORMAT;
use volcomp_config::{ModelFile, Provenance};
use volcomp_model::geometry::Vec3;
use volcomp_model::spec::ReferenceBody;
use volcomp_model::{AxisSpec, ErrorFunction, ErrorSymbol, ModelSpec, Sense, Side};
use volcomp_units::axes::{AxisKind, AxisName, Travel};
use volcomp_units::{arcsec_from_rad, um_from_mm};

/// A model with what was found out about it.
pub(super) struct Report<'a> {
    pub(super) file: &'a ModelFile,
    pub(super) name: &'a str,
    pub(super) found: &'a Found,
}

/// One row of the table of errors, everything in words.
pub(super) struct ErrorRow {
    pub(super) symbol: String,
    pub(super) kinds: String,
    pub(super) range: String,
    /// Lowest, highest, peak to peak.
    pub(super) size: [String; 3],
    pub(super) unit: &'static str,
    /// Standard uncertainty, or nothing.
    pub(super) std: String,
    pub(super) origin: String,
}

/// What is said about a pose: a name, the value, and where.
pub(super) struct Fact {
    pub(super) what: String,
    pub(super) value: String,
    pub(super) place: String,
}

impl Report<'_> {
    pub(super) const fn spec(&self) -> &ModelSpec {
        &self.file.spec
    }

    pub(super) fn lines(&self) -> Vec<String> {
        let spec = self.spec();
        let mut out =
            vec![format!("{}: model of {}, chain {}", self.name, spec.machine, spec.chain), String::new()];
        out.extend(drawing::chain(spec).into_iter().map(|l| format!("  {l}")));
        out.push(String::new());
        out.extend(self.frame_lines().into_iter().map(|l| format!("  {l}")));
        out.push("axes".to_owned());
        out.extend(spec.chain.axes().iter().map(|a| format!("  {}: {}", a.name, self.axis_words(a.name))));
        self.push_errors(&mut out);
        out.push("in the working volume".to_owned());
        for fact in self.worst() {
            out.push(format!("  {:<28} {:>24}  {}", fact.what, fact.value, fact.place));
        }
        out.push("largest corrections".to_owned());
        for fact in self.corrections() {
            out.push(format!("  {:<28} {:>24}  {}", fact.what, fact.value, fact.place));
        }
        out.extend(gauge::lines(spec));
        out
    }

    fn push_errors(&self, out: &mut Vec<String>) {
        let (motions, constants) = self.error_rows();
        if motions.is_empty() && constants.is_empty() {
            out.push("no errors: nothing will be corrected".to_owned());
        }
        if !motions.is_empty() {
            out.push("error motions".to_owned());
            let head = ["lowest", "highest", "range"];
            out.push(format!(
                "  {:<5} {:<22} {:<18} {:>9} {:>9} {:>9} {:<6} {:>8}",
                "", "kind", "over", head[0], head[1], head[2], "", "u (k=1)"
            ));
            for r in motions {
                let [low, high, range] = &r.size;
                let line = format!(
                    "  {:<5} {:<22} {:<18} {low:>9} {high:>9} {range:>9} {:<6} {:>8}  {}",
                    r.symbol, r.kinds, r.range, r.unit, r.std, r.origin
                );
                out.push(line.trim_end().to_owned());
            }
        }
        if !constants.is_empty() {
            out.push("squareness and location".to_owned());
            for r in constants {
                let std = if r.std.is_empty() { String::new() } else { format!(", u (k=1) {}", r.std) };
                let line = format!("  {:<5} {:>9} {}{std}  {}", r.symbol, r.size[0], r.unit, r.origin);
                out.push(line.trim_end().to_owned());
            }
        }
    }

    /// Frame and origin of the file.
    pub(super) fn frame_lines(&self) -> Vec<String> {
        let spec = self.spec();
        let mut out = vec![format!(
            "workpiece origin {} mm, tool tip {} mm{}",
            point(&spec.workpiece_origin),
            point(&spec.tool_tip),
            spec.gauge_point.map_or(String::new(), |g| format!(", gauge point {} mm", point(&g)))
        )];
        let origin = origin_words(&self.file.provenance);
        if !origin.is_empty() {
            out.push(origin);
        }
        out
    }

    /// Side, travel, sense and points of an axis.
    pub(super) fn axis_words(&self, name: AxisName) -> String {
        let spec = self.spec();
        let axis = spec.axis(name);
        let unit = position_unit(name);
        let entry = spec.chain.axes().iter().find(|a| a.name == name);
        let mut out = vec![match entry.map(|a| (a.side, a.spindle)) {
            Some((Side::Workpiece, _)) => "workpiece side".to_owned(),
            Some((Side::Tool, true)) => "spindle".to_owned(),
            _ => "tool side".to_owned(),
        }];
        out.push(match axis.travel.map(|t| t.map(|v| position_out(name, v))) {
            Some([low, high]) => format!("travel {low} to {high} {unit}"),
            None => "travel not stated".to_owned(),
        });
        if axis.sense == Sense::Carriage {
            out.push("errors in the carriage's own sense".to_owned());
        }
        match name.kind() {
            AxisKind::Rotary => out.push(format!("turns about {} mm", point(&axis.point))),
            AxisKind::Linear => out.extend(reference_words(&axis)),
        }
        out.join(", ")
    }

    /// The rows of error motions, and those of squareness and location.
    pub(super) fn error_rows(&self) -> (Vec<ErrorRow>, Vec<ErrorRow>) {
        let rows = self.spec().errors.iter().map(|(s, f)| (s.is_constant(), self.error_row(*s, f)));
        let (constants, motions): (Vec<_>, Vec<_>) = rows.partition(|(constant, _)| *constant);
        let bare = |rows: Vec<(bool, ErrorRow)>| rows.into_iter().map(|(_, r)| r).collect();
        (bare(motions), bare(constants))
    }

    fn error_row(&self, symbol: ErrorSymbol, function: &ErrorFunction) -> ErrorRow {
        let size = Size::of(symbol, function, self.spec());
        let unit = position_unit(symbol.axis());
        let own = self.file.of_errors.iter().find(|(s, _)| *s == symbol);
        ErrorRow {
            symbol: symbol.to_string().to_lowercase(),
            kinds: kinds_words(function),
            range: size.range.map_or(String::new(), |[low, high]| format!("{low} to {high} {unit}")),
            size: [size.low, size.high, size.high - size.low].map(|v| plain(v, 2)),
            unit: size.unit,
            std: function.std.map_or(String::new(), |s| format!("{:.2}", error_out(symbol, s))),
            origin: own.map_or(String::new(), |(_, p)| origin_words(p)),
        }
    }

    /// The worst errors and where they are.
    pub(super) fn worst(&self) -> Vec<Fact> {
        let (p, r) = (&self.found.position, &self.found.rotation);
        let (e, t) = (p.deviation.position.map(um_from_mm), r.deviation.rotation.map(arcsec_from_rad));
        let fact = |what: &str, value: String, place: String| Fact { what: what.to_owned(), value, place };
        let mut out = vec![
            fact(
                "largest position error",
                format!("{:.2} um", e.norm()),
                format!("at {}: {} um", self.place(p), triple(&e)),
            ),
            fact(
                "largest error of direction",
                format!("{:.2} arcsec", t.norm()),
                format!("at {}: {} arcsec", self.place(r), triple(&t)),
            ),
            fact(
                "root mean square of position",
                format!("{:.2} um", um_from_mm(self.found.rms)),
                format!("{} poses", self.found.poses),
            ),
        ];
        let kept = kept_in_place(self.spec());
        if !kept.is_empty() {
            out.push(fact("without travel and curves, so kept", String::new(), kept.join(", ")));
        }
        out
    }

    /// The largest correction of every axis and where it is.
    pub(super) fn corrections(&self) -> Vec<Fact> {
        let axes = self.spec().chain.axes().iter().zip(&self.found.offsets).enumerate();
        axes.filter_map(|(k, (axis, found))| {
            let extreme = found.as_ref()?;
            let offset = extreme.correction.offset[k];
            let corrected = offset != 0.0;
            Some(Fact {
                what: axis.name.to_string(),
                value: if corrected {
                    format!("{} {}", signed(offset_out(axis.name, offset), 2), offset_unit(axis.name))
                } else {
                    "never corrected".to_owned()
                },
                place: if corrected { format!("at {}", self.place(extreme)) } else { String::new() },
            })
        })
        .collect()
    }

    /// A pose in words; a minus behind an axis means travel towards minus.
    fn place(&self, extreme: &Extreme) -> String {
        let axes = self.spec().chain.axes().iter().enumerate().filter(|(_, a)| !a.spindle);
        let words = axes.map(|(k, axis)| {
            let q = position_out(axis.name, extreme.pose.position[k]);
            let back = if extreme.pose.travel[k] == Travel::Reverse { " (towards minus)" } else { "" };
            format!("{} {}{back}", axis.name, (q * 1e2).round() / 1e2)
        });
        words.collect::<Vec<_>>().join("  ")
    }

    pub(super) fn as_json(&self) -> Value {
        let spec = self.spec();
        let errors: Vec<Value> = spec.errors.iter().map(|(s, f)| self.error_json(*s, f)).collect();
        let axes: Vec<Value> = spec.chain.axes().iter().map(|a| axis_json(spec, a.name)).collect();
        let corrections: Map<String, Value> = spec
            .chain
            .axes()
            .iter()
            .zip(&self.found.offsets)
            .enumerate()
            .filter_map(|(k, (axis, found))| {
                let extreme = found.as_ref()?;
                let key = format!("largest_{}", offset_unit(axis.name));
                let value = offset_out(axis.name, extreme.correction.offset[k]);
                Some((axis.name.lower().to_string(), json!({key: value, "at": self.pose_json(extreme)})))
            })
            .collect();
        let (p, r) = (&self.found.position, &self.found.rotation);
        json!({
            "format": FORMAT,
            "file": self.name,
            "machine": spec.machine,
            "chain": spec.chain.to_string(),
            "workpiece_origin_mm": list(&spec.workpiece_origin),
            "tool_tip_mm": list(&spec.tool_tip),
            "gauge_point_mm": spec.gauge_point.as_ref().map(list),
            "provenance": provenance_json(&self.file.provenance),
            "axes": axes,
            "errors": errors,
            "worst": {
                "position": {
                    "size_um": rounded(um_from_mm(p.deviation.position.norm())),
                    "error_um": list(&p.deviation.position.map(um_from_mm)),
                    "at": self.pose_json(p),
                },
                "rotation": {
                    "size_arcsec": rounded(arcsec_from_rad(r.deviation.rotation.norm())),
                    "error_arcsec": list(&r.deviation.rotation.map(arcsec_from_rad)),
                    "at": self.pose_json(r),
                },
                "rms_um": rounded(um_from_mm(self.found.rms)),
                "poses": self.found.poses,
            },
            "corrections": corrections,
            "gauge": gauge::as_json(spec),
        })
    }

    fn error_json(&self, symbol: ErrorSymbol, function: &ErrorFunction) -> Value {
        let size = Size::of(symbol, function, self.spec());
        let unit = size.unit;
        let own = self.file.of_errors.iter().find(|(s, _)| *s == symbol);
        json!({
            "symbol": symbol.to_string().to_lowercase(),
            "kinds": kinds_of(function),
            format!("range_{}", position_unit(symbol.axis())): size.range,
            format!("lowest_{unit}"): size.low,
            format!("highest_{unit}"): size.high,
            format!("peak_to_peak_{unit}"): rounded(size.high - size.low),
            format!("std_{unit}"): function.std.map(|s| rounded(error_out(symbol, s))),
            "provenance": own.map(|(_, p)| provenance_json(p)),
        })
    }

    /// A pose in the columns of points.
    fn pose_json(&self, extreme: &Extreme) -> Value {
        let mut out = Map::new();
        for (k, axis) in self.spec().chain.axes().iter().enumerate().filter(|(_, a)| !a.spindle) {
            let letter = axis.name.lower();
            let key = format!("{letter}_{}", position_unit(axis.name));
            out.insert(key, json!(position_out(axis.name, extreme.pose.position[k])));
            let dir = if extreme.pose.travel[k] == Travel::Reverse { -1 } else { 1 };
            out.insert(format!("dir_{letter}"), json!(dir));
        }
        Value::Object(out)
    }
}

fn axis_json(spec: &ModelSpec, name: AxisName) -> Value {
    let axis = spec.axis(name);
    let mut out = json!({
        "axis": name.lower().to_string(),
        "workpiece_side": spec.is_workpiece_side(name),
        format!("travel_{}", position_unit(name)): axis.travel.map(|t| t.map(|v| position_out(name, v))),
        "sense": if axis.sense == Sense::Carriage { "carriage" } else { "relative" },
    });
    match name.kind() {
        AxisKind::Rotary => out["point_mm"] = list(&axis.point),
        AxisKind::Linear => {
            let [x, y, z] = axis.reference_points.map(|r| list(&r.point));
            out["reference_points_mm"] = json!({"x": x, "y": y, "z": z});
            let [x, y, z] = axis.reference_points.map(|r| body(r.body));
            out["reference_body"] = json!({"x": x, "y": y, "z": z});
        }
    }
    out
}

const fn body(body: ReferenceBody) -> &'static str {
    match body {
        ReferenceBody::Carriage => "carriage",
        ReferenceBody::Bed => "bed",
    }
}

/// The reference points of an axis that are not the origin on the carriage; equal ones once.
fn reference_words(axis: &AxisSpec) -> Option<String> {
    let words = axis.reference_points.map(|r| {
        let on = if r.body == ReferenceBody::Bed { " on the bed" } else { "" };
        format!("{}{on}", point(&r.point))
    });
    let [x, y, z] = &words;
    if axis.reference_points.iter().all(|r| *r == Default::default()) {
        None
    } else if x == y && y == z {
        Some(format!("measured at {x} mm"))
    } else {
        Some(format!("measured at x: {x}, y: {y}, z: {z} mm"))
    }
}

/// The kinds of the terms of an error, each once with how often it occurs.
pub(super) fn kinds_words(function: &ErrorFunction) -> String {
    let mut counted: Vec<(&str, usize)> = Vec::new();
    for kind in kinds_of(function) {
        match counted.iter_mut().find(|(k, _)| *k == kind) {
            Some((_, n)) => *n += 1,
            None => counted.push((kind, 1)),
        }
    }
    let words =
        counted.into_iter().map(|(kind, n)| if n > 1 { format!("{n} {kind}") } else { kind.to_owned() });
    words.collect::<Vec<_>>().join(" + ")
}

fn origin_words(p: &Provenance) -> String {
    let mut out: Vec<String> = [&p.instrument, &p.date, &p.operator].into_iter().flatten().cloned().collect();
    out.extend(p.temperature_degc.map(|t| format!("{t} degC")));
    out.extend(p.source.as_ref().map(|s| format!("from {s}")));
    if !p.sources.is_empty() {
        let files = p.sources.iter().filter_map(|s| s.source.as_deref());
        out.push(format!("from {}", files.collect::<Vec<_>>().join(" and ")));
    }
    out.extend(p.expiry.as_ref().map(|e| format!("use until {e}")));
    out.extend(p.note.clone());
    out.join(", ")
}

fn provenance_json(p: &Provenance) -> Value {
    json!({
        "instrument": p.instrument,
        "date": p.date,
        "operator": p.operator,
        "temperature_degc": p.temperature_degc,
        "expiry": p.expiry,
        "source": p.source,
        "source_hash": p.source_hash,
        "sources": p.sources.iter().map(|s| json!({
            "source": s.source, "source_hash": s.source_hash, "instrument": s.instrument, "date": s.date,
        })).collect::<Vec<_>>(),
        "note": p.note,
    })
}

/// A value of an error in the unit of the file.
pub(super) fn error_out(symbol: ErrorSymbol, value: f64) -> f64 {
    if symbol.is_angle() { arcsec_from_rad(value) } else { um_from_mm(value) }
}

fn triple(v: &Vec3) -> String {
    format!("({}, {}, {})", plain(v.x, 2), plain(v.y, 2), plain(v.z, 2))
}

fn point(v: &Vec3) -> String {
    format!("({}, {}, {})", rounded(v.x), rounded(v.y), rounded(v.z))
}

fn list(v: &Vec3) -> Value {
    json!([rounded(v.x), rounded(v.y), rounded(v.z)])
}
