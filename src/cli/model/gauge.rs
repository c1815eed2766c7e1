//! The report of `check` and `model` on datums and reference lines: what the normal form would remove, and where it would go.

use crate::prelude::*;
use crate::quantities::list;
use volcomp_model::gauge::{Effect, Gauged, Moved, Part, RigidShare, Untouched, normalise};

/// The gauge by the name that a person knows.
const CONVENTION: &str = "datum and reference-line convention";

/// The report in lines, without indentation of its own heading; without `details` in one.
pub(crate) fn lines(model: &ModelSpec, details: bool) -> Vec<String> {
    let gauged = match normalise(model) {
        Ok(gauged) => gauged,
        Err(e) => return vec![format!("{CONVENTION}: the model normalised to it breaks a rule: {e}")],
    };
    let mut out = Vec::new();
    let (small, shown): (Vec<_>, Vec<_>) = gauged.moved.iter().partition(|m| is_negligible(m));
    if shown.is_empty() {
        out.push(format!("{CONVENTION}: met"));
    } else if !details {
        let mut symbols: Vec<String> = shown.iter().map(|m| key(m.symbol)).collect();
        symbols.dedup();
        let count = match shown.len() {
            1 => "1 offset or slope is".to_owned(),
            n => format!("{n} offsets and slopes are"),
        };
        out.push(format!(
            "{CONVENTION}: {count} kept as in the file ({}); --verbose lists them, docs/reference/model-files.md explains",
            symbols.join(" ")
        ));
        return out;
    } else {
        out.push(format!("{CONVENTION}: `volcomp model normalise` would move (the file is used as it is)"));
        out.extend(shown.into_iter().map(|m| format!("  {}", moved_line(m))));
        if !small.is_empty() {
            out.push(format!("  and {} of less than a nanometre or 0.001 arcsec", small.len()));
        }
        out.push("  in all:".to_owned());
        out.extend(total_lines(model, &gauged).into_iter().map(|l| format!("    {l}")));
    }
    if !details {
        return out;
    }
    out.extend(gauged.untouched.iter().map(|u| format!("  left as it is: {}", untouched_line(u))));
    out
}

/// The report for programs.
pub(crate) fn as_json(model: &ModelSpec) -> Value {
    let gauged = match normalise(model) {
        Ok(gauged) => gauged,
        Err(e) => return json!({"normal": false, "error": e.to_string()}),
    };
    let changes = gauged.total.errors.iter().map(|(symbol, amount)| {
        let (before, unit) = (constant(model, *symbol), error_unit(*symbol));
        let [before, after] = [before, before + amount].map(|v| rounded(error_out(*symbol, v)));
        json!({"symbol": key(*symbol), format!("before_{unit}"): before, format!("after_{unit}"): after})
    });
    json!({
        "normal": gauged.moved.iter().all(is_negligible),
        "moved": gauged.moved.iter().map(moved_json).collect::<Value>(),
        "changes": changes.collect::<Value>(),
        "rigid": rigid_json(&gauged.total.rigid),
        "left": gauged.untouched.iter().map(untouched_line).collect::<Vec<_>>(),
    })
}

/// True for what rounding leaves: below half a nanometre or half a thousandth of a second of arc.
fn is_negligible(moved: &Moved) -> bool {
    let amount = match moved.part {
        Part::Slope { over } => um_from_mm(moved.amount * (over[1] - over[0])),
        Part::Value { .. } => error_out(moved.symbol, moved.amount),
    };
    amount.abs() < NEGLIGIBLE
}

/// um or arcsec.
pub(super) const NEGLIGIBLE: f64 = 5e-4;

fn moved_line(moved: &Moved) -> String {
    let axis = moved.symbol.axis();
    let (amount, unit) = amount_of(moved);
    let part = match moved.part {
        Part::Value { at } => format!("value at {} {}", position_out(axis, at), position_unit(axis)),
        Part::Slope { over: [low, high] } => format!("slope over {low} to {high} mm"),
    };
    let to = effect_parts(&moved.effect);
    let to = if to.is_empty() { "nothing depends on it".to_owned() } else { to.join(", ") };
    format!("{} {part}, {} {unit} -> {to}", key(moved.symbol), short(amount))
}

fn moved_json(moved: &Moved) -> Value {
    let axis = moved.symbol.axis();
    let (amount, unit) = amount_of(moved);
    let errors = moved.effect.errors.iter().map(|(symbol, amount)| {
        let (amount, unit) = in_unit(*symbol, *amount);
        json!({"symbol": key(*symbol), format!("amount_{unit}"): amount})
    });
    let slopes = moved.effect.slopes.iter().map(
        |(symbol, slope)| json!({"symbol": key(*symbol), "part": "slope", "amount_arcsec": angle(*slope)}),
    );
    let mut out = json!({
        "symbol": key(moved.symbol),
        format!("amount_{unit}"): amount,
        "to": errors.chain(slopes).collect::<Value>(),
        "rigid": rigid_json(&moved.effect.rigid),
    });
    match moved.part {
        Part::Value { at } => {
            out["part"] = json!("value");
            out[format!("at_{}", position_unit(axis))] = json!(position_out(axis, at));
        }
        Part::Slope { over } => {
            out["part"] = json!("slope");
            out["over_mm"] = json!(over);
        }
    }
    out
}

fn total_lines(model: &ModelSpec, gauged: &Gauged) -> Vec<String> {
    let mut out = Vec::new();
    let large = |(symbol, amount): &&(ErrorSymbol, f64)| in_unit(*symbol, *amount).0.abs() >= NEGLIGIBLE;
    for (symbol, amount) in gauged.total.errors.iter().filter(large) {
        let before = constant(model, *symbol);
        let (from, unit) = in_unit(*symbol, before);
        let (to, _) = in_unit(*symbol, before + amount);
        out.push(format!("{} {} {unit} becomes {} {unit}", key(*symbol), short(from), short(to)));
    }
    for (symbol, slope) in &gauged.total.slopes {
        out.push(format!("{} gets the slope {} arcsec", key(*symbol), short(angle(*slope))));
    }
    let rigid = rigid_parts(&gauged.total.rigid);
    out.push(if rigid.is_empty() {
        "no rigid motion is left out".to_owned()
    } else {
        format!("left out, because the set-up absorbs it: {}", rigid.join(", "))
    });
    out
}

fn effect_parts(effect: &Effect) -> Vec<String> {
    let large = |(symbol, amount): &&(ErrorSymbol, f64)| in_unit(*symbol, *amount).0.abs() >= NEGLIGIBLE;
    let errors = effect.errors.iter().filter(large).map(|(symbol, amount)| {
        let (amount, unit) = in_unit(*symbol, *amount);
        format!("{} {amount:+.3} {unit}", key(*symbol))
    });
    let slope = |(symbol, slope): &(_, f64)| format!("{} slope {:+.3} arcsec", key(*symbol), angle(*slope));
    let slopes = effect.slopes.iter().map(slope);
    errors.chain(slopes).chain(rigid_parts(&effect.rigid)).collect()
}

fn rigid_parts(rigid: &RigidShare) -> Vec<String> {
    let mut out = Vec::new();
    let shift = rigid.shift.map(um_from_mm);
    if shift.amax() >= 5e-4 {
        out.push(format!("shift of the workpiece {} um", vector(&shift)));
    }
    for (what, turn) in [("turn of the workpiece", rigid.turn), ("turn of the tool", rigid.tool_turn)] {
        let turn = turn.map(arcsec_from_rad);
        if turn.amax() >= 5e-4 {
            out.push(format!("{what} {} arcsec", vector(&turn)));
        }
    }
    out
}

fn rigid_json(rigid: &RigidShare) -> Value {
    json!({
        "shift_um": list(&rigid.shift.map(um_from_mm)),
        "turn_arcsec": list(&rigid.turn.map(arcsec_from_rad)),
        "tool_turn_arcsec": list(&rigid.tool_turn.map(arcsec_from_rad)),
    })
}

fn untouched_line(untouched: &Untouched) -> String {
    match untouched {
        Untouched::BehindRotary { axis } => {
            format!("{axis} stands behind a rotary axis; its constants are its place on that axis")
        }
        Untouched::AlongItself { symbol } => {
            format!("the constant of {}, a shift of axis {} along itself", key(*symbol), symbol.axis())
        }
        Untouched::Parallelism { axis } => {
            format!("slopes of {axis}, which are its parallelism; they have no squareness")
        }
        Untouched::NoRange { axis } => {
            format!(
                "all linear axes, because {axis} has neither travel nor curves that say how far its line goes"
            )
        }
    }
}

/// The amount in the unit of the file; slopes are angles.
fn amount_of(moved: &Moved) -> (f64, &'static str) {
    match moved.part {
        Part::Value { .. } => in_unit(moved.symbol, moved.amount),
        Part::Slope { .. } => (angle(moved.amount), "arcsec"),
    }
}

fn in_unit(symbol: ErrorSymbol, value: f64) -> (f64, &'static str) {
    (rounded(error_out(symbol, value)), error_unit(symbol))
}

fn angle(rad: f64) -> f64 {
    rounded(arcsec_from_rad(rad))
}

fn constant(model: &ModelSpec, symbol: ErrorSymbol) -> f64 {
    model.error(symbol).map_or(0.0, |f| f.value(0.0, Default::default()))
}

/// Three decimals: a nanometre, or a thousandth of a second of arc.
fn short(v: f64) -> f64 {
    (v * 1e3).round() / 1e3 + 0.0
}

fn vector(v: &Vec3) -> String {
    format!("({}, {}, {})", short(v.x), short(v.y), short(v.z))
}
