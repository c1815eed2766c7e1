//! From the daemon's status to the values of nodes: pure.

use opcua::types::{UAString, Variant};
use serde_json::Value;

/// What a value is measured in: unit id of UNECE Recommendation 20, symbol, name.
pub type Unit = (i32, &'static str, &'static str);
/// Micrometre.
pub const UM: Unit = (13384, "µm", "micrometre");
/// Second of angle.
pub const ARCSEC: Unit = (4_470_322, "″", "second [unit of angle]");
/// Microsecond.
pub const US: Unit = (4_340_024, "µs", "microsecond");
/// Degree Celsius.
pub const CELSIUS: Unit = (4_408_652, "°C", "degree Celsius");

/// One variable of the compensation.
#[derive(Debug, Clone, Copy)]
pub struct Item {
    /// Browse name.
    pub name: &'static str,
    /// Where the status holds it: a JSON pointer.
    pub pointer: &'static str,
    /// What it is.
    pub kind: Kind,
    /// Unit, where it is a quantity.
    pub unit: Option<Unit>,
    /// For people.
    pub description: &'static str,
}

/// The data types that occur.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// `Boolean`
    Yes,
    /// `Double`
    Number,
    /// `UInt64`
    Count,
    /// `String`
    Text,
    /// `String`: the last part of a path
    FileName,
    /// `String[]`
    Texts,
}

const fn item(
    name: &'static str,
    pointer: &'static str,
    kind: Kind,
    unit: Option<Unit>,
    description: &'static str,
) -> Item {
    Item { name, pointer, kind, unit, description }
}

/// The variables that every machine has. Meaning: docs/reference/json-output.md, 1.
pub const ITEMS: &[Item] = &[
    item(
        "State",
        "/state",
        Kind::Text,
        None,
        "disconnected, off, armed, ramping-in, active, holding, ramping-out or faulted",
    ),
    item("Enabled", "/enabled", Kind::Yes, None, "Compensation is requested"),
    item("Gain", "/gain", Kind::Number, None, "Share of the compensation that is applied, 0 to 1"),
    item("Health", "/health/verdict", Kind::Text, None, "ok, warning, held, disconnected or faulted"),
    item("HealthCode", "/health/code", Kind::Text, None, "Number of the cause, as VC-4001"),
    item("HealthCause", "/health/cause", Kind::Text, None, "What is wrong"),
    item("HealthRemedy", "/health/remedy", Kind::Text, None, "What to do"),
    item("LatchedFaults", "/faults", Kind::Texts, None, "Numbers of the faults that wait for a person"),
    item("LinkUp", "/link/up", Kind::Yes, None, "The control is connected"),
    item("Model", "/model", Kind::FileName, None, "File of the error model in use"),
    item("ModelHash", "/model_hash", Kind::Text, None, "BLAKE3 of this file"),
    item(
        "ErrorMotionsCovered",
        "/model_errors/covered",
        Kind::Count,
        None,
        "Error motions that the model corrects",
    ),
    item(
        "ErrorMotionsPossible",
        "/model_errors/possible",
        Kind::Count,
        None,
        "Error motions that the machine can have",
    ),
    item(
        "ToolTipErrorWithout",
        "/benefit/without_um",
        Kind::Number,
        Some(UM),
        "Predicted error of the tool tip without compensation",
    ),
    item("ToolTipErrorWith", "/benefit/with_um", Kind::Number, Some(UM), "The same with compensation"),
    item("Cycles", "/cycles", Kind::Count, None, "Position frames since the start"),
    item("LateCycles", "/late_cycles", Kind::Count, None, "Of these, answered late or not at all"),
    item(
        "LateShare",
        "/recent/late_share",
        Kind::Number,
        None,
        "Share of late cycles of the last minute, 0 to 1",
    ),
    item(
        "AgeP99",
        "/recent/age_us_p99",
        Kind::Number,
        Some(US),
        "Age of corrections in the last minute, 99th percentile",
    ),
    item(
        "MachineTemperature",
        "/temperature_degc",
        Kind::Number,
        Some(CELSIUS),
        "Temperature that the model counts with",
    ),
    item("SoftwareVersion", "/version", Kind::Text, None, "Version of volcompd"),
];

/// The value of an item; `None` where the status has none.
pub fn value(item: &Item, status: &Value) -> Option<Variant> {
    let found = status.pointer(item.pointer)?;
    match item.kind {
        Kind::Yes => found.as_bool().map(Variant::from),
        Kind::Number => found.as_f64().map(Variant::from),
        Kind::Count => found.as_u64().map(Variant::from),
        Kind::Text => found.as_str().map(Variant::from),
        Kind::FileName => {
            let path = std::path::Path::new(found.as_str()?);
            path.file_name().and_then(|name| name.to_str()).map(Variant::from)
        }
        Kind::Texts => {
            let codes =
                found.as_array()?.iter().filter_map(|fault| fault.get("code").and_then(Value::as_str));
            Some(Variant::from(codes.map(UAString::from).collect::<Vec<_>>()))
        }
    }
}

/// Name of the machine.
pub fn machine(status: &Value) -> &str {
    status.get("machine").and_then(Value::as_str).unwrap_or("machine")
}

/// Offsets: folder, axis, value, unit; requested and read back.
pub fn offsets(status: &Value) -> Vec<(&'static str, String, f64, Unit)> {
    let sources = [
        ("Offsets", "correction_um", UM),
        ("Offsets", "correction_arcsec", ARCSEC),
        ("AppliedOffsets", "applied_um", UM),
        ("AppliedOffsets", "applied_arcsec", ARCSEC),
    ];
    let mut all = Vec::new();
    for (folder, key, unit) in sources {
        for (axis, value) in status.get(key).and_then(Value::as_object).into_iter().flatten() {
            if let Some(value) = value.as_f64() {
                all.push((folder, axis.clone(), value, unit));
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status() -> Value {
        serde_json::json!({
            "machine": "m", "state": "active", "enabled": true, "gain": 0.5, "model": "/etc/volcomp/model.toml",
            "health": {"verdict": "ok", "code": null}, "faults": [{"code": "VC-4001"}], "cycles": 12,
            "correction_um": {"X": -1.5}, "applied_arcsec": {"C": 2.0}, "temperature_degc": null
        })
    }

    #[test]
    fn values_have_the_type_of_their_kind_and_none_is_made_up() {
        let status = status();
        for item in ITEMS {
            let fits = match (item.kind, value(item, &status)) {
                (_, None) => status.pointer(item.pointer).is_none_or(Value::is_null),
                (Kind::Yes, Some(v)) => matches!(v, Variant::Boolean(_)),
                (Kind::Number, Some(v)) => matches!(v, Variant::Double(_)),
                (Kind::Count, Some(v)) => matches!(v, Variant::UInt64(_)),
                (Kind::Text | Kind::FileName, Some(v)) => matches!(v, Variant::String(_)),
                (Kind::Texts, Some(v)) => matches!(v, Variant::Array(_)),
            };
            assert!(fits, "{item:?}");
        }
        let named = |name: &str| ITEMS.iter().find(|i| i.name == name).and_then(|i| value(i, &status));
        assert_eq!(named("Model"), Some(Variant::from("model.toml")));
        assert_eq!(named("HealthCode"), None);
        assert_eq!(named("Gain"), Some(Variant::from(0.5)));
    }

    #[test]
    fn offsets_keep_unit_and_sign() {
        let all = offsets(&status());
        assert_eq!(all.len(), 2);
        assert!(all.contains(&("Offsets", "X".to_owned(), -1.5, UM)));
        assert!(all.contains(&("AppliedOffsets", "C".to_owned(), 2.0, ARCSEC)));
    }

    /// The unit id is the code of UNECE Recommendation 20 read as a number (OPC 10000-8, 5.6.3).
    #[test]
    fn unit_ids_are_the_codes_of_unece() {
        for (unit, code) in [(UM, "4H"), (ARCSEC, "D62"), (US, "B98"), (CELSIUS, "CEL")] {
            let id = code.bytes().fold(0, |id, byte| id << 8 | i32::from(byte));
            assert_eq!(unit.0, id, "{code}");
        }
    }
}
