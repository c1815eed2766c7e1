//! Text and JSON of `check`: contents of a machine or model file, and remarks on what is allowed but unusual.

use super::plausibility;
use crate::identity;
use crate::model::gauge;
use crate::model::report::{axis_words, errors};
use crate::prelude::*;
use volcomp_config::Policy;
use volcomp_config::model::{kind_of, section_of};
use volcomp_daemon::models::guard::is_expired;
use volcomp_estimate::Thermal;
use volcomp_formats::axis_table::positioning_symbol;
use volcomp_model::extremes::Bounds;

pub(super) fn describe_machine(lines: &mut Vec<String>, machine: &MachineConfig) {
    let (address, protection) = (machine.link.address, identity::protection(machine));
    let (name, cycle_ms) = (&machine.machine, rounded(machine.link.cycle_s * 1e3));
    lines.push(format!("  machine {name}, control at {address}{protection}, cycle {cycle_ms} ms"));
    for axis in &machine.axes {
        let (name, unit, limits) = (axis.name, offset_unit(axis.name), &axis.limits);
        let [size, warning, rate, acceleration] =
            [limits.size, limits.warning, limits.rate, limits.acceleration].map(|v| offset_out(name, v));
        lines.push(format!(
            "  axis {name}: offset up to {size} {unit}, warning at {warning} {unit}, {rate} {unit}/s, {acceleration} {unit}/s^2"
        ));
    }
}

pub(super) fn describe_model(lines: &mut Vec<String>, file: &ModelFile, hash: &str, details: bool) {
    let model = &file.spec;
    lines.push(format!("  model of {}, chain {}", model.machine, model.chain));
    lines.push(format!("  hash {hash}"));
    let axes = model.chain.axes().iter();
    lines.extend(axes.map(|a| format!("  axis {}: {}", a.name, axis_words(model, a.name))));
    lines.push(match model.errors.len() {
        0 => "  no errors: nothing will be corrected".to_owned(),
        1 => "  1 error:".to_owned(),
        n => format!("  {n} errors:"),
    });
    let (motions, constants) = errors(file);
    lines.extend([motions, constants].iter().flat_map(Table::lines).map(|line| format!("    {line}")));
    for thermal in &file.thermal {
        let (name, sensors) = (&thermal.name, sensors_of(thermal).join(", "));
        let kind = if thermal.expansion { "expansion" } else { "growth" };
        lines.push(format!("  thermal {name}: {kind} from {} terms of {sensors}", thermal.terms()));
    }
    lines.extend(model_notes(file).into_iter().map(|n| format!("  note: {n}")));
    lines.extend(gauge::lines(model, details).into_iter().map(|l| format!("  {l}")));
}

/// The sensors of a growth, each once.
fn sensors_of(thermal: &Thermal) -> Vec<&str> {
    let mut names: Vec<&str> = thermal.inputs.iter().map(|i| i.sensor.as_str()).collect();
    names.dedup();
    names
}

pub(super) fn model_as_json(file: &ModelFile, hash: &str) -> Value {
    let model = &file.spec;
    let thermal = file.thermal.iter();
    let thermal = thermal.map(
        |t| json!({"name": t.name, "expansion": t.expansion, "terms": t.terms(), "sensors": sensors_of(t)}),
    );
    let errors = model.errors.iter().map(|(s, f)| error_json(*s, f, &Size::of(*s, f, model)));
    let axes = model.chain.axes().iter().map(|axis| {
        let mut json = axis_json(model, axis.name);
        json["spindle"] = json!(axis.spindle);
        json
    });
    json!({
        "machine": model.machine,
        "hash": hash,
        "chain": model.chain.to_string(),
        "axes": axes.collect::<Value>(),
        "errors": errors.collect::<Value>(),
        "thermal": thermal.collect::<Value>(),
        "gauge": gauge::as_json(model),
    })
}

/// Side and travel of an axis, for programs.
pub(crate) fn axis_json(model: &ModelSpec, name: AxisName) -> Value {
    json!({
        "axis": name.lower().to_string(),
        "workpiece_side": model.is_workpiece_side(name),
        format!("travel_{}", position_unit(name)): model.axis(name).travel.map(|t| t.map(|v| position_out(name, v))),
    })
}

/// Kinds and bounds of an error, for programs.
pub(crate) fn error_json(symbol: ErrorSymbol, function: &ErrorFunction, size: &Size) -> Value {
    json!({
        "symbol": key(symbol),
        "kinds": kinds_of(function),
        format!("range_{}", position_unit(symbol.axis())): size.range,
        format!("lowest_{}", size.unit): size.low,
        format!("highest_{}", size.unit): size.high,
    })
}

/// Bounds of an error over its range, in the units of the file.
pub(crate) struct Size {
    pub(crate) range: Option<[f64; 2]>,
    pub(crate) low: f64,
    pub(crate) high: f64,
    pub(crate) unit: &'static str,
}

impl Size {
    pub(crate) fn of(symbol: ErrorSymbol, function: &ErrorFunction, model: &ModelSpec) -> Self {
        let bounds = Bounds::of(function, model.axis(symbol.axis()).travel);
        let range = bounds.range.map(|r| r.map(|v| position_out(symbol.axis(), v)));
        let [low, high] = [bounds.low, bounds.high].map(|v| rounded(error_out(symbol, v)));
        Self { range, low, high, unit: error_unit(symbol) }
    }
}

/// The kinds of the terms of an error.
pub(crate) fn kinds_of(function: &ErrorFunction) -> Vec<&'static str> {
    let grids = function.grids.iter().map(|_| "grid");
    let live = function.live.iter().map(|_| "live");
    let dynamics = function.dynamics.iter().map(|d| section_of(&d.law));
    function.curves.iter().map(kind_of).chain(grids).chain(live).chain(dynamics).collect()
}

/// What is allowed but worth knowing about a machine file and its model.
pub(super) fn machine_notes(machine: &MachineConfig, file: &ModelFile) -> Vec<String> {
    let model = &file.spec;
    let idle = |axis: AxisName| {
        format!("axis {axis} is in the chain but has no [axes.{}]: it is never offset", axis.lower())
    };
    let mut out: Vec<String> = machine.uncorrected_axes(model).into_iter().map(idle).collect();
    out.extend(expiry_note(file, Some(machine.guard.expired)));
    let ladder_s = machine.engine.stale_s + machine.engine.hold_s + machine.engine.ramp_s;
    if machine.link.silence_s < ladder_s {
        out.push(format!(
            "link.silence-s {} s ends before stale-ms, hold-s and ramp-s together ({ladder_s} s): of a silent control the \
             offset is then taken out by the control itself",
            machine.link.silence_s
        ));
    }
    out.extend(plausibility::notes(machine, model));
    let used = file.growths_in_use().map(|t| t.name.as_str()).joined(", ");
    if machine.sensors.spec.sensors.is_empty() && !used.is_empty() {
        out.push(format!(
            "thermal {used} stays zero: the machine file lists no [[sensor]] for its temperatures and speeds"
        ));
    }
    if machine.link.is_exposed() {
        out.push(identity::exposed(machine));
    }
    let unlimited = machine.axes.iter().filter(|a| a.soft_limits.iter().all(|end| end.is_infinite()));
    let unlimited: Vec<AxisName> = unlimited.map(|a| a.name).collect();
    if !unlimited.is_empty() {
        let names = unlimited.iter().joined(", ");
        let keys = [(AxisKind::Linear, "soft-limit-mm"), (AxisKind::Rotary, "soft-limit-deg")];
        let missing = |kind: AxisKind| unlimited.iter().any(|a| a.kind() == kind);
        let keys = keys.into_iter().filter(|(k, _)| missing(*k)).map(|(_, key)| key).joined(" and ");
        out.push(format!(
            "no {keys} for {names}: nothing here keeps an offset from carrying an axis over a soft limit of the machine; the control \
             has to"));
    }
    let mut cut_off = Vec::new();
    for axis in &machine.axes {
        let terms = model.errors.iter().filter(|(s, _)| s.axis() == axis.name && !s.is_angle());
        let transient = terms.flat_map(|(_, f)| &f.dynamics).filter(|d| d.law.is_transient());
        let asked: f64 = transient.map(|d| d.limit).sum();
        let (name, limit) = (axis.name, offset_out(axis.name, axis.limits.size));
        if axis.limits.size > 0.0 && asked > axis.limits.size {
            let (asked, unit) = (offset_out(name, asked), offset_unit(name));
            out.push(format!(
                "axis {name}: terms that follow velocity and acceleration may ask for {asked} {unit}; the limit is {limit} {unit}: \
                 beyond it they are cut and the correction is reported as limited"
            ));
        }
        // the largest offset that positioning alone asks for must fit below the limit
        let positioning = positioning_symbol(name);
        if let Some(function) = model.error(positioning) {
            let Size { low, high, unit, .. } = Size::of(positioning, function, model);
            let largest = low.abs().max(high.abs());
            if largest > limit {
                let largest = plain(largest, 2);
                cut_off.push(format!(
                    "{positioning} alone reaches {largest} {unit}, above the limit of {limit} {unit} of axis {name}: it will be cut off"
                ));
            }
        }
    }
    [cut_off, out].concat()
}

/// A model whose last day has passed, and what a daemon makes of it; without a machine file the policy is not known.
pub(super) fn expiry_note(file: &ModelFile, policy: Option<Policy>) -> Option<String> {
    #[expect(clippy::disallowed_methods, reason = "whether a model has expired is a matter of today")]
    let now = std::time::SystemTime::now();
    let expiry = file.earliest_expiry().filter(|day| is_expired(day, now))?;
    let follows = match policy {
        Some(Policy::Warn) => "the daemon warns of it",
        Some(_) => "compensation stays off until it is enabled with --accept-expired and --reason",
        None => {
            "what follows is said by `expired` in [guard] of the machine file; by default compensation stays off"
        }
    };
    Some(format!("VC-5003: the model expired on {expiry}: {follows}"))
}

/// What is allowed but worth knowing about a model.
pub(crate) fn model_notes(file: &ModelFile) -> Vec<String> {
    let model = &file.spec;
    let mut out = Vec::new();
    let names = file.thermal.iter().map(|t| t.name.as_str());
    for name in names.filter(|name| !model.sensors().contains(name)) {
        out.push(format!("thermal {name} feeds no error: add [errors.SYMBOL.live] with sensor = \"{name}\""));
    }
    for (symbol, function) in &model.errors {
        let spec = model.axis(symbol.axis());
        let (Some(travel), Some(mut covered)) = (spec.travel, function.range()) else { continue };
        if model.is_mirrored(symbol.axis()) {
            covered = [-covered[1], -covered[0]];
        }
        let slack = 1e-9 * (travel[1] - travel[0]);
        if covered[0] > travel[0] + slack || covered[1] < travel[1] - slack {
            let [covered, travel] = [covered, travel].map(|r| range_words(symbol.axis(), r));
            out.push(format!(
                "{symbol} covers {covered} of the travel {travel}; beyond, its end value is held"
            ));
        }
    }
    for axis in model.chain.axes().iter().filter(|a| !a.spindle && model.axis(a.name).travel.is_none()) {
        out.push(format!("axis {} has no travel, so leaving it cannot be noticed", axis.name));
    }
    out
}
