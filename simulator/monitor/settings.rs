//! The limits that corrections are checked against, and how they are read from a machine file.
//!
//! The file is read here on its own: a monitor that took the limits from the daemon's reader would share its mistakes.

use toml::{Table, Value};
use volcomp_units::axes::{AxisKind, AxisName};

/// Time allowed beyond ramp and rate until zero is reached, s.
const MARGIN_S: f64 = 0.2;
/// Largest offset found on a new link that is led back, in limits.
const FOUND_FACTOR: f64 = 2.0;
/// Hold time of a control, s.
const HOLD_S: f64 = 0.1;
/// Defaults of the machine file.
const CYCLE_MS: f64 = 1.0;
const RAMP_S: f64 = 2.0;
const STEP_CYCLES: f64 = 2.0;
const UM_PER_MM: f64 = 1e3;
const ARCSEC_PER_DEG: f64 = 3600.0;

/// Limits of one axis: mm or deg, per s, per s^2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisLimits {
    /// Largest offset; 0: the axis is never offset.
    pub size: f64,
    /// Largest rate of change.
    pub rate: f64,
    /// Largest change of the rate.
    pub acceleration: f64,
    /// Largest change from one answer to the next.
    pub step: f64,
}

/// Everything that the monitor is configured with.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Axes in the order of the link.
    pub axes: Vec<AxisName>,
    /// Limits, one per axis.
    pub limits: Vec<AxisLimits>,
    /// Control cycle, s.
    pub cycle_s: f64,
    /// Duration of a ramp, s of control time.
    pub ramp_s: f64,
    /// Hold time of the control: after so long without a correction it moves the offset by itself, s.
    pub hold_s: f64,
    /// Largest offset found on a new link that is led back, in limits.
    pub found_factor: f64,
    /// Time allowed beyond ramp and rate until zero is reached, s.
    pub margin_s: f64,
}

/// Why a machine file gives no limits.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the fields are what the message prints")]
pub enum SettingsError {
    /// It is no TOML.
    #[error("no TOML: {0}")]
    Toml(#[from] toml::de::Error),
    /// A key is missing or no number.
    #[error("axis {axis}: {key} is missing or not a number")]
    Key { axis: AxisName, key: String },
}

impl Settings {
    /// The limits of a machine file, for a control with these axes.
    ///
    /// # Errors
    /// The file is no TOML, or an axis in it lacks a limit.
    pub fn from_machine_file(text: &str, axes: &[AxisName]) -> Result<Self, SettingsError> {
        let file: Table = text.parse()?;
        let number = |table: Option<&Value>, key: &str| match table?.get(key)? {
            Value::Integer(v) => Some(*v as f64),
            Value::Float(v) => Some(*v),
            _ => None,
        };
        let cycle_s = number(file.get("link"), "cycle-ms").unwrap_or(CYCLE_MS) / 1e3;
        let limits = |axis: &AxisName| -> Result<AxisLimits, SettingsError> {
            let table = file.get("axes").and_then(|t| t.get(axis.lower().to_string()));
            if table.is_none() {
                return Ok(AxisLimits { size: 0.0, rate: 0.0, acceleration: 0.0, step: 0.0 });
            }
            let (unit, scale) = match axis.kind() {
                AxisKind::Linear => ("um", UM_PER_MM),
                AxisKind::Rotary => ("arcsec", ARCSEC_PER_DEG),
            };
            let required = |key: String| {
                let found = number(table, &key).map(|v| v / scale);
                found.ok_or(SettingsError::Key { axis: *axis, key })
            };
            let rate = required(format!("rate-{unit}-per-s"))?;
            Ok(AxisLimits {
                size: required(format!("limit-{unit}"))?,
                rate,
                acceleration: required(format!("acceleration-{unit}-per-s2"))?,
                step: required(format!("step-{unit}")).unwrap_or(STEP_CYCLES * rate * cycle_s),
            })
        };
        Ok(Self {
            axes: axes.to_vec(),
            limits: axes.iter().map(limits).collect::<Result<_, _>>()?,
            cycle_s,
            ramp_s: number(file.get("engine"), "ramp-s").unwrap_or(RAMP_S),
            hold_s: HOLD_S,
            found_factor: FOUND_FACTOR,
            margin_s: MARGIN_S,
        })
    }
}
