//! Text and JSON of `diff`.

use super::Diff;
use crate::prelude::*;
use crate::quantities::{corrections_json, list, point, pose_json, pose_words, vector};
use volcomp_model::compare::{Change, Difference, ErrorDifference, VolumeDifference};
use volcomp_model::spec::{ReferenceBody, ReferencePoint};

/// Everything in lines.
pub(super) fn lines(diff: &Diff) -> Vec<String> {
    let [a, b] = &diff.names;
    let mut out = vec![format!("{a} -> {b}")];
    if diff.is_same() {
        out.push("the same model".to_owned());
    }
    let mut section = |title: &str, lines: Vec<String>| {
        if !lines.is_empty() {
            out.push(title.to_owned());
            out.extend(lines.into_iter().map(|l| format!("  {l}")));
        }
    };
    section("chain, frame and axes", changes(diff));
    section("errors, second minus first", errors(diff).lines());
    if !diff.is_same() {
        section("in the working volume, second minus first", volume(diff));
    }
    section("provenance", provenance(diff));
    out
}

/// Chain, frame and axes.
pub(super) fn changes(diff: &Diff) -> Vec<String> {
    let thermal = diff.thermal_names().into_iter().map(|name| {
        let [a, b] = diff.files.each_ref().map(|f| f.thermal.iter().any(|t| t.name == name));
        format!("thermal displacement {name}: {}", stated_in([a, b]))
    });
    diff.found.changes.iter().map(change_words).chain(thermal).collect()
}

fn change_words(change: &Change) -> String {
    let of = |what: String, [a, b]: [String; 2]| format!("{what}: {a} -> {b}");
    let point = |p: &Vec3| format!("{} mm", point(p));
    match change {
        Change::Machine(m) => of("machine".to_owned(), m.clone()),
        Change::Chain(c) => of("chain".to_owned(), c.each_ref().map(ToString::to_string)),
        Change::WorkpieceOrigin(p) => of("workpiece origin".to_owned(), p.each_ref().map(point)),
        Change::ToolTip(p) => of("tool tip".to_owned(), p.each_ref().map(point)),
        Change::GaugePoint(p) => {
            let words = p.each_ref().map(|p| p.as_ref().map_or_else(|| "none".to_owned(), point));
            of("gauge point".to_owned(), words)
        }
        Change::Vertical(v) => {
            let words = v.map(|v| v.map_or_else(|| "not stated".to_owned(), |v| v.to_string()));
            of("vertical axis".to_owned(), words)
        }
        Change::Tool(t) => {
            let words = t.map(|t| {
                let [a, b] = t.tilt.map(|v| rounded(arcsec_from_rad(v)));
                format!("spindle tilt ({a}, {b}) arcsec, length error {} um/m", rounded(t.length * 1e6))
            });
            of("tool".to_owned(), words)
        }
        Change::Datum(d) => {
            let words = d.each_ref().map(|d| {
                let at = |(axis, v): &(AxisName, f64)| {
                    format!("{axis} {} {}", position_out(*axis, *v), position_unit(*axis))
                };
                if d.is_empty() { "none".to_owned() } else { d.iter().map(at).joined(" ") }
            });
            of("datum".to_owned(), words)
        }
        Change::Travel { axis, values } => {
            let words = values.map(|t| t.map_or_else(|| "not stated".to_owned(), |t| range_words(*axis, t)));
            of(format!("travel of {axis}"), words)
        }
        Change::AxisPoint { axis, values } => {
            of(format!("point on the axis of {axis}"), values.each_ref().map(point))
        }
        Change::Sense { axis, values } => of(format!("sense of {axis}"), values.map(|s| s.name().to_owned())),
        Change::Reference { axis, component, values } => {
            let words = values.each_ref().map(|r: &ReferencePoint| {
                let on = if r.body == ReferenceBody::Bed { " on the bed" } else { "" };
                format!("{}{on}", point(&r.point))
            });
            of(format!("reference point of {axis} for {}", component.letter()), words)
        }
        Change::CorrectionLimit { axis, values } => {
            let words = values.map(|v| format!("{} arcsec", rounded(arcsec_from_rad(v))));
            of(format!("correction limit of {axis}"), words)
        }
    }
}

/// The errors that differ.
pub(super) fn errors(diff: &Diff) -> Table {
    let heads = ["", "", ">largest", ">rms", "", "where"];
    Table::new(heads).rows(diff.found.errors.iter().map(error_row))
}

const fn stated_in(stated: [bool; 2]) -> &'static str {
    match stated {
        [false, true] => "only in second",
        [true, false] => "only in first",
        _ => "changed",
    }
}

fn error_row(e: &ErrorDifference) -> [String; 6] {
    let axis = e.symbol.axis();
    let mut place = match e.over {
        None => String::new(),
        Some(_) => {
            let back = if e.travel == Travel::Reverse { " (towards minus)" } else { "" };
            format!("at {axis} {}{back}", short(position_out(axis, e.at)))
        }
    };
    if e.std[0] != e.std[1] {
        let word = |s| format!("{:.3}", error_out(e.symbol, s));
        let [a, b] = e.std.map(|s| s.map_or_else(|| "none".to_owned(), word));
        place = format!("{place}  u (k=1) {a} -> {b}").trim_start().to_owned();
    }
    if e.unsearched > 0.0 {
        let most = error_out(e.symbol, e.unsearched);
        place = format!("{place}  terms of motion or sensors: up to {most:.3} {} more", error_unit(e.symbol));
        place = place.trim_start().to_owned();
    }
    let [largest, rms] = [e.largest, e.rms].map(|v| error_out(e.symbol, v));
    let (symbol, what, unit) =
        (e.symbol.to_string(), stated_in(e.stated).to_owned(), error_unit(e.symbol).to_owned());
    [symbol, what, signed(largest, 3), format!("{rms:.3}"), unit, place]
}

/// The working volume.
pub(super) fn volume(diff: &Diff) -> Vec<String> {
    let Some(v) = &diff.found.volume else {
        return vec!["the chains have different axes; there is no common working volume".to_owned()];
    };
    let chain = &diff.files[0].spec.chain;
    let axes = || chain.axes().iter().map(|a| a.name);
    let ranges = axes().zip(&v.ranges).filter(|(_, [low, high])| low < high).map(|(axis, range)| {
        let [low, high] = range.map(|q| short(position_out(axis, q)));
        format!("{axis} {low} to {high} {}", position_unit(axis))
    });
    let ranges = ranges.joined(", ");
    let mut out = vec![if ranges.is_empty() {
        "no axis has a travel: compared at home only".to_owned()
    } else {
        format!("searched {ranges} ({} poses)", v.poses)
    }];
    let bound = |b: Option<f64>, f: fn(f64) -> f64, unit: &str| {
        b.map_or(String::new(), |b| format!("; nowhere above {:.2} {unit}", f(b)))
    };
    let located = |d: &Difference, v: &Vec3| format!("at {}: {}", pose_words(chain, &d.pose), vector(v));
    let [shift, turn] = diff.found.unsearched;
    if shift > 0.0 || turn > 0.0 {
        let (shift, turn) = (um_from_mm(shift), arcsec_from_rad(turn));
        out.push(format!(
            "without terms of motion, sensors and temperature that differ: they may add {shift:.2} um, {turn:.2} arcsec"
        ));
    }
    let (e, t) = (v.position.position.map(um_from_mm), v.rotation.rotation.map(arcsec_from_rad));
    let (largest, at, rms) = (e.norm(), located(&v.position, &e), um_from_mm(v.rms_position));
    let beyond = bound(v.bound_position, um_from_mm, "um");
    out.push(format!("position   largest {largest:.2} um {at}, rms {rms:.2} um{beyond}"));
    let (largest, at, rms) = (t.norm(), located(&v.rotation, &t), arcsec_from_rad(v.rms_rotation));
    let beyond = bound(v.bound_rotation, arcsec_from_rad, "arcsec");
    out.push(format!("direction  largest {largest:.2} arcsec {at}, rms {rms:.2} arcsec{beyond}"));
    let ([shift, turn], rest) = (v.rigid, v.without_rigid.without_rigid.map(um_from_mm));
    let (largest, at, rms) = (rest.norm(), located(&v.without_rigid, &rest), um_from_mm(v.rms_without_rigid));
    let (shift, turn) = (vector(&shift.map(um_from_mm)), vector(&turn.map(arcsec_from_rad)));
    out.push(format!(
        "without the best rigid motion of the workpiece: largest {largest:.2} um {at}, rms {rms:.2} um; the motion: shift {shift} um, turn {turn} arcsec"
    ));
    for (k, (axis, found)) in axes().zip(&v.offsets).enumerate() {
        let Some(found) = found.filter(|f| f.offset[k] != 0.0) else { continue };
        let (offset, unit) = (offset_out(axis, found.offset[k]), offset_unit(axis));
        let at = pose_words(chain, &found.pose);
        out.push(format!("correction of {axis}  largest {offset:+.2} {unit} at {at}"));
    }
    out
}

fn short(v: f64) -> f64 {
    (v * 1e2).round() / 1e2 + 0.0
}

/// What the files say about where the numbers come from, where it differs.
pub(super) fn provenance(diff: &Diff) -> Vec<String> {
    let [a, b] = &diff.files;
    let mut out = Vec::new();
    describe(&mut out, "file", &a.provenance, &b.provenance);
    let symbols: BTreeSet<ErrorSymbol> = a.of_errors.iter().chain(&b.of_errors).map(|(s, _)| *s).collect();
    for symbol in symbols {
        let of = |list: &[(ErrorSymbol, Provenance)]| {
            list.iter().find(|(s, _)| *s == symbol).map(|(_, p)| p.clone()).unwrap_or_default()
        };
        describe(&mut out, &symbol.to_string(), &of(&a.of_errors), &of(&b.of_errors));
    }
    out
}

fn describe(out: &mut Vec<String>, whose: &str, a: &Provenance, b: &Provenance) {
    let fields = |p: &Provenance| -> Vec<(&'static str, String)> {
        let text = |t: &Option<String>| t.clone().unwrap_or_else(|| "-".to_owned());
        let sources = p.sources.iter().map(|s| s.to_string()).joined("; ");
        vec![
            ("instrument", text(&p.instrument)),
            ("date", text(&p.date)),
            ("operator", text(&p.operator)),
            ("temperature", p.temperature_degc.map_or_else(|| "-".to_owned(), |t| format!("{t} degC"))),
            ("expiry", text(&p.expiry)),
            ("source", text(&p.source)),
            ("source hash", text(&p.source_hash)),
            ("sources", if sources.is_empty() { "-".to_owned() } else { sources }),
            ("note", text(&p.note)),
        ]
    };
    let changed = fields(a).into_iter().zip(fields(b)).filter(|(x, y)| x != y);
    out.extend(changed.map(|((name, x), (_, y))| format!("{whose} {name}: {x} -> {y}")));
}

/// Everything for programs.
pub(super) fn as_json(diff: &Diff) -> Value {
    let errors: Vec<Value> = diff.found.errors.iter().map(error_json).collect();
    let mut json = json!({
        "first": diff.names[0],
        "second": diff.names[1],
        "changes": changes(diff),
        "errors": errors,
        "volume": diff.found.volume.as_ref().map(|v| volume_json(diff, v)),
        "provenance": provenance(diff),
    });
    let [shift, turn] = diff.found.unsearched;
    if shift > 0.0 {
        json["unsearched_um"] = rounded(um_from_mm(shift)).into();
        json["unsearched_arcsec"] = rounded(arcsec_from_rad(turn)).into();
    }
    json
}

fn error_json(e: &ErrorDifference) -> Value {
    let (axis, unit, place) = (e.symbol.axis(), error_unit(e.symbol), position_unit(e.symbol.axis()));
    let out = |v: f64| rounded(error_out(e.symbol, v));
    let mut json = json!({
        "symbol": key(e.symbol),
        "what": stated_in(e.stated),
        format!("largest_{unit}"): out(e.largest),
        format!("rms_{unit}"): out(e.rms),
        format!("at_{place}"): e.over.map(|_| position_out(axis, e.at)),
        "direction": if e.travel == Travel::Reverse { -1 } else { 1 },
        format!("over_{place}"): e.over.map(|o| o.map(|q| position_out(axis, q))),
        format!("std_{unit}"): e.std.map(|s| s.map(out)),
    });
    if e.unsearched > 0.0 {
        json[format!("unsearched_{unit}")] = out(e.unsearched).into();
    }
    json
}

fn volume_json(diff: &Diff, v: &VolumeDifference) -> Value {
    let chain = &diff.files[0].spec.chain;
    let pose = |pose| pose_json(chain, pose);
    let um = |v: f64| rounded(um_from_mm(v));
    let arcsec = |v: f64| rounded(arcsec_from_rad(v));
    let offsets = v.offsets.iter().map(|d| d.as_ref().map(|d| (&d.offset[..], &d.pose)));
    json!({
        "position": {
            "largest_um": um(v.position.position.norm()),
            "difference_um": list(&v.position.position.map(um_from_mm)),
            "at": pose(&v.position.pose),
            "rms_um": um(v.rms_position),
            "bound_um": v.bound_position.map(um),
        },
        "rotation": {
            "largest_arcsec": arcsec(v.rotation.rotation.norm()),
            "difference_arcsec": list(&v.rotation.rotation.map(arcsec_from_rad)),
            "at": pose(&v.rotation.pose),
            "rms_arcsec": arcsec(v.rms_rotation),
            "bound_arcsec": v.bound_rotation.map(arcsec),
        },
        "without_rigid": {
            "largest_um": um(v.without_rigid.without_rigid.norm()),
            "at": pose(&v.without_rigid.pose),
            "rms_um": um(v.rms_without_rigid),
            "shift_um": list(&v.rigid[0].map(um_from_mm)),
            "turn_arcsec": list(&v.rigid[1].map(arcsec_from_rad)),
        },
        "corrections": corrections_json(chain, offsets),
        "poses": v.poses,
    })
}
