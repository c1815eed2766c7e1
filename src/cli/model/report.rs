//! What `model show` says, in words and for programs.

use super::{drawing, gauge};
use crate::check::{self, Size, kinds_of};
use crate::prelude::*;
use crate::quantities::{corrections_json, list, point, pose_json, pose_words, vector};
use volcomp_config::model::FORMAT;
use volcomp_model::extremes::{Extreme, Found, kept_in_place};
use volcomp_model::spec::ReferenceBody;

/// A model with what was found out about it.
pub(super) struct Report<'a> {
    pub(super) file: &'a ModelFile,
    pub(super) name: &'a str,
    pub(super) found: &'a Found,
}

impl Report<'_> {
    pub(super) const fn spec(&self) -> &ModelSpec {
        &self.file.spec
    }

    pub(super) fn lines(&self, details: bool) -> Vec<String> {
        let spec = self.spec();
        let mut out =
            vec![format!("{}: model of {}, chain {}", self.name, spec.machine, spec.chain), String::new()];
        out.extend(drawing::chain(spec).into_iter().map(|l| format!("  {l}")));
        out.push(String::new());
        out.extend(self.frame_lines().into_iter().map(|l| format!("  {l}")));
        out.push("axes".to_owned());
        out.extend(spec.chain.axes().iter().map(|a| format!("  {}: {}", a.name, axis_words(spec, a.name))));
        let (motions, constants) = errors(self.file);
        if motions.is_empty() && constants.is_empty() {
            out.push("no errors: nothing will be corrected".to_owned());
        }
        for (title, table) in [
            ("error motions", motions),
            ("squareness and location", constants),
            ("in the working volume", self.worst()),
            ("largest corrections", self.corrections()),
        ] {
            if !table.is_empty() {
                out.push(title.to_owned());
                out.extend(table.lines().into_iter().map(|l| format!("  {l}")));
            }
        }
        out.extend(gauge::lines(spec, details));
        out
    }

    /// Frame and origin of the file.
    pub(super) fn frame_lines(&self) -> Vec<String> {
        let spec = self.spec();
        let gauge = spec.gauge_point.map_or(String::new(), |g| format!(", gauge point {} mm", point(&g)));
        let [origin, tip] = [spec.workpiece_origin, spec.tool_tip].map(|p| point(&p));
        let vertical = spec.vertical.map_or(String::new(), |up| format!(", {up} vertical"));
        let frame = format!("workpiece origin {origin} mm, tool tip {tip} mm{gauge}{vertical}");
        let stated = Some(origin_words(&self.file.provenance)).filter(|words| !words.is_empty());
        [frame].into_iter().chain(stated).collect()
    }

    /// The largest deviations: what, how large, where.
    pub(super) fn worst(&self) -> Table {
        let (p, r) = (&self.found.position, &self.found.rotation);
        let (e, t) = (p.deviation.position.map(um_from_mm), r.deviation.rotation.map(arcsec_from_rad));
        let of = |what: &str, at: &Extreme, v: &Vec3, unit: &str| {
            let place = format!("at {}: {} {unit}", self.place(at), vector(v));
            [what.to_owned(), format!("{:.2} {unit}", v.norm()), place]
        };
        let (rms, poses) = (um_from_mm(self.found.rms), self.found.poses);
        let mut table = Table::new(["", ">", ""]).rows([
            of("largest position error", p, &e, "um"),
            of("largest error of direction", r, &t, "arcsec"),
            ["root mean square of position".to_owned(), format!("{rms:.2} um"), format!("{poses} poses")],
        ]);
        let word = |axis: AxisName| format!("{axis} at 0 {}", position_unit(axis));
        let kept: Vec<String> = kept_in_place(self.spec()).into_iter().map(word).collect();
        if !kept.is_empty() {
            table.row(["without travel and curves, so kept", "", &kept.join(", ")]);
        }
        table
    }

    /// The largest deviations in a sentence.
    pub(super) fn worst_words(&self) -> String {
        let table = self.worst();
        let words = table.cells().iter().take(2).map(|row| format!("{} {}", row[0], row[1]));
        words.joined("; ")
    }

    /// The largest correction of each axis: how large, where.
    pub(super) fn corrections(&self) -> Table {
        let mut table = Table::new(["", ">", ""]);
        for (k, (axis, found)) in self.spec().chain.axes().iter().zip(&self.found.offsets).enumerate() {
            let Some(extreme) = found else { continue };
            let (name, offset) = (axis.name, extreme.correction.offset[k]);
            let [value, place] = if offset == 0.0 {
                ["never corrected".to_owned(), String::new()]
            } else {
                let size = signed(offset_out(name, offset), 2);
                [format!("{size} {}", offset_unit(name)), format!("at {}", self.place(extreme))]
            };
            table.row([name.to_string(), value, place]);
        }
        table
    }

    fn place(&self, extreme: &Extreme) -> String {
        pose_words(&self.spec().chain, &extreme.pose)
    }

    pub(super) fn as_json(&self) -> Value {
        let spec = self.spec();
        let offsets = self.found.offsets.iter();
        let offsets = offsets.map(|e| e.as_ref().map(|e| (&e.correction.offset[..], &e.pose)));
        let corrections = corrections_json(&spec.chain, offsets);
        let (p, r) = (&self.found.position, &self.found.rotation);
        json!({
            "format": FORMAT,
            "file": self.name,
            "machine": spec.machine,
            "chain": spec.chain.to_string(),
            "workpiece_origin_mm": list(&spec.workpiece_origin),
            "tool_tip_mm": list(&spec.tool_tip),
            "gauge_point_mm": spec.gauge_point.as_ref().map(list),
            "vertical": spec.vertical.map(AxisName::lower),
            "provenance": provenance_json(&self.file.provenance),
            "axes": spec.chain.axes().iter().map(|a| axis_json(spec, a.name)).collect::<Value>(),
            "errors": spec.errors.iter().map(|(s, f)| self.error_json(*s, f)).collect::<Value>(),
            "worst": {
                "position": {
                    "size_um": rounded(um_from_mm(p.deviation.position.norm())),
                    "error_um": list(&p.deviation.position.map(um_from_mm)),
                    "at": pose_json(&spec.chain, &p.pose),
                },
                "rotation": {
                    "size_arcsec": rounded(arcsec_from_rad(r.deviation.rotation.norm())),
                    "error_arcsec": list(&r.deviation.rotation.map(arcsec_from_rad)),
                    "at": pose_json(&spec.chain, &r.pose),
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
        let mut json = check::error_json(symbol, function, &size);
        json[format!("peak_to_peak_{}", size.unit)] = json!(rounded(size.high - size.low));
        json[format!("std_{}", size.unit)] = json!(function.std.map(|s| rounded(error_out(symbol, s))));
        json["provenance"] = json!(self.file.origin_of(symbol).map(provenance_json));
        json
    }
}

/// Side, travel, sense and points of an axis.
pub(crate) fn axis_words(spec: &ModelSpec, name: AxisName) -> String {
    let axis = spec.axis(name);
    let entry = spec.chain.axes().iter().find(|a| a.name == name);
    let mut out = vec![match entry.map(|a| (a.side, a.spindle)) {
        Some((Side::Workpiece, _)) => "workpiece side".to_owned(),
        Some((Side::Tool, true)) => "spindle".to_owned(),
        _ => "tool side".to_owned(),
    }];
    out.push(match axis.travel {
        Some(travel) => format!("travel {}", range_words(name, travel)),
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

/// The error motions, and the squarenesses and locations, which are one value each.
pub(crate) fn errors(file: &ModelFile) -> (Table, Table) {
    let heads = ["", "kind", "over", ">lowest", ">highest", ">range", "", ">u (k=1)", ""];
    let mut motions = Table::new(heads);
    let mut constants = Table::new(["", ">", "", ">u (k=1)", ""]);
    for (symbol, function) in &file.spec.errors {
        let row = error_row(file, *symbol, function);
        if symbol.is_constant() {
            constants.row([0, 3, 6, 7, 8].map(|k| &row[k]));
        } else {
            motions.row(row);
        }
    }
    (motions, constants)
}

fn error_row(file: &ModelFile, symbol: ErrorSymbol, function: &ErrorFunction) -> [String; 9] {
    let size = Size::of(symbol, function, &file.spec);
    let unit = position_unit(symbol.axis());
    let [low, high, range] = [size.low, size.high, size.high - size.low].map(|v| plain(v, 2));
    [
        key(symbol),
        kinds_words(function),
        size.range.map_or(String::new(), |[low, high]| format!("{low} to {high} {unit}")),
        low,
        high,
        range,
        size.unit.to_owned(),
        function.std.map_or(String::new(), |s| format!("{:.2}", error_out(symbol, s))),
        file.origin_of(symbol).map_or(String::new(), origin_words),
    ]
}

fn axis_json(spec: &ModelSpec, name: AxisName) -> Value {
    let axis = spec.axis(name);
    let mut out = check::axis_json(spec, name);
    out["sense"] = json!(axis.sense.name());
    match name.kind() {
        AxisKind::Rotary => out["point_mm"] = json!(list(&axis.point)),
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
    words.joined(" + ")
}

fn origin_words(p: &Provenance) -> String {
    let mut out: Vec<String> = [&p.instrument, &p.date, &p.operator].into_iter().flatten().cloned().collect();
    out.extend(p.temperature_degc.map(|t| format!("{t} degC")));
    out.extend(p.source.as_ref().map(|s| format!("from {s}")));
    if !p.sources.is_empty() {
        let files = p.sources.iter().filter_map(|s| s.source.as_deref());
        out.push(format!("from {}", files.joined(" and ")));
    }
    out.extend(p.expiry.as_ref().map(|e| format!("use until {e}")));
    out.extend(p.note.clone());
    out.join(", ")
}

fn provenance_json(p: &Provenance) -> Value {
    let mut json =
        fields!(p; instrument, date, operator, temperature_degc, expiry, source, source_hash, note);
    json["sources"] = p.sources.iter().map(|s| fields!(s; source, source_hash, instrument, date)).collect();
    json
}
