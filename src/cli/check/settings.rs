//! The settings of a machine file that are in force, stated or default.

use crate::prelude::*;
use volcomp_config::{AxisConfig, place_of};
use volcomp_engine::LimitTime;

/// One setting in the unit of its key.
pub(super) struct Setting {
    /// Table and key, for example `["axes", "x", "step-um"]`.
    path: Vec<String>,
    value: Value,
    unit: &'static str,
    /// The same in another unit.
    also: Option<String>,
    stated: bool,
}

impl Setting {
    fn new(text: &str, path: &[&str], value: Value, unit: &'static str) -> Self {
        let stated = place_of(text, path).is_some();
        Self { path: path.iter().map(|&key| key.to_owned()).collect(), value, unit, also: None, stated }
    }

    fn as_text(&self) -> String {
        let key = self.path.last().map_or("", String::as_str);
        let value = self.value.as_str().map_or_else(|| self.value.to_string(), str::to_owned);
        let unit = if self.unit.is_empty() { String::new() } else { format!(" {}", self.unit) };
        let also = self.also.as_ref().map_or_else(String::new, |also| format!(" = {also}"));
        format!("{key} {value}{unit}{also} ({})", if self.stated { "stated" } else { "default" })
    }

    pub(super) fn as_json(&self) -> Value {
        json!({"key": self.path.join("."), "value": self.value, "unit": self.unit, "stated": self.stated})
    }
}

/// What decides when and how an offset moves, and which positions are believed; `text` is that of the file.
pub(super) fn settings(text: &str, machine: &MachineConfig) -> Vec<Setting> {
    let engine = &machine.engine;
    let start = machine.start.name();
    let limit_time = match engine.limit_time {
        LimitTime::Control => "control",
        LimitTime::Computer => "computer",
    };
    let mut all = vec![
        Setting::new(text, &["engine", "start"], json!(start), ""),
        Setting::new(text, &["engine", "limit-time"], json!(limit_time), ""),
        Setting::new(text, &["engine", "ramp-s"], number(engine.ramp_s), "s"),
        Setting::new(text, &["engine", "stale-ms"], number(engine.stale_s * 1e3), "ms"),
        Setting::new(text, &["engine", "hold-s"], number(engine.hold_s), "s"),
    ];
    all.extend(machine.axes.iter().flat_map(|axis| of_axis(text, axis, machine.link.cycle_s)));
    all
}

fn of_axis(text: &str, axis: &AxisConfig, cycle_s: f64) -> [Setting; 3] {
    let (name, letter) = (axis.name, axis.name.lower().to_string());
    let [step, stop, jump] = match name.kind() {
        AxisKind::Linear => ["step-um", "stop-um", "jump-mm"],
        AxisKind::Rotary => ["step-arcsec", "stop-arcsec", "jump-deg"],
    };
    let setting = |key, value, unit| Setting::new(text, &["axes", &letter, key], number(value), unit);
    let jump_limit = position_out(name, axis.jump_limit);
    let per_minute = jump_limit / cycle_s * 60.0;
    let speed = match name.kind() {
        AxisKind::Linear => format!("{} m/min", rounded(per_minute / 1e3)),
        AxisKind::Rotary => format!("{} deg/min", rounded(per_minute)),
    };
    [
        setting(step, offset_out(name, axis.limits.step), offset_unit(name)),
        setting(stop, offset_out(name, axis.limits.stop), offset_unit(name)),
        Setting { also: Some(speed), ..setting(jump, jump_limit, position_unit(name)) },
    ]
}

/// Lines of the text: one for the engine, one for each axis.
pub(super) fn lines(settings: &[Setting]) -> Vec<String> {
    let mut lines: Vec<(String, Vec<String>)> = Vec::new();
    for setting in settings {
        let table = setting.path[..setting.path.len() - 1].join(".");
        match lines.last_mut().filter(|(last, _)| *last == table) {
            Some((_, texts)) => texts.push(setting.as_text()),
            None => lines.push((table, vec![setting.as_text()])),
        }
    }
    lines.iter().map(|(table, texts)| format!("  [{table}] {}", texts.join(", "))).collect()
}

fn number(value: f64) -> Value {
    let value = rounded(value);
    // whole numbers without ".0", as they are written
    if value.fract() == 0.0 && value.abs() < 1e15 { json!(value as i64) } else { json!(value) }
}
