//! Readings of sensors that a prediction holds for: the live values of the model's thermal displacements.

use crate::prelude::*;
use volcomp_estimate::thermal::{Thermal, ThermalState};
use volcomp_model::SENSORS_MAX;

/// One reading, as `--reading` gives it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Reading {
    sensor: String,
    value: f64,
}

/// `SENSOR=VALUE`.
pub(super) fn reading(text: &str) -> Result<Reading, String> {
    let parsed = text.rsplit_once('=').and_then(|(sensor, value)| {
        let value = value.parse().ok().filter(|v: &f64| v.is_finite())?;
        (!sensor.is_empty()).then(|| Reading { sensor: sensor.to_owned(), value })
    });
    parsed.ok_or_else(|| "give SENSOR=VALUE, for instance scales.1=21.5".to_owned())
}

/// Live values of the model for sensors that have stood at these readings for long, mm or mm/mm; zero without readings.
pub(super) fn live_values(path: &Path, model: &Model, readings: &[Reading]) -> Result<[f64; SENSORS_MAX]> {
    let mut live = [0.0; SENSORS_MAX];
    if readings.is_empty() {
        return Ok(live);
    }
    let file = read_model_file(path)?;
    let used: Vec<&Thermal> = file.growths_in_use().collect();
    let inputs: Vec<&str> = used.iter().flat_map(|t| &t.inputs).map(|i| i.sensor.as_str()).collect();
    if let Some(stranger) = readings.iter().find(|r| !inputs.contains(&r.sensor.as_str())) {
        let known = if inputs.is_empty() {
            "it has no [thermal.NAME] that an error names".to_owned()
        } else {
            format!("its [thermal.NAME] depend on {}", inputs.join(", "))
        };
        let (sensor, model) = (&stranger.sensor, path.display());
        return Err(usage!("--reading {sensor}: nothing in {model} depends on this sensor; {known}"));
    }
    for thermal in used {
        let find = |sensor: &str| readings.iter().rfind(|r| r.sensor == sensor).map(|r| r.value);
        let values: Option<Vec<f64>> = thermal.inputs.iter().map(|i| find(&i.sensor)).collect();
        let Some(values) = values else {
            let names = thermal.inputs.iter().map(|i| i.sensor.as_str()).joined(", ");
            return Err(usage!("thermal \"{}\" depends on {names}; give --reading for each", thermal.name));
        };
        let mut state = ThermalState::new(thermal);
        state.advance(thermal, 0.0, &values);
        for (value, _) in live.iter_mut().zip(model.sensors()).filter(|(_, name)| **name == thermal.name) {
            *value = state.growth(thermal).value;
        }
    }
    Ok(live)
}
