//! The description of a recording: columns, units, offsets.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::Deserialize;
use volcomp_units::axes::{AxisKind, AxisName};

/// How a CSV file is to be read as the motion of a machine.
#[derive(Debug, Clone, PartialEq)]
pub struct Description {
    /// The CSV file, as written (relative to the description).
    pub file: PathBuf,
    /// Column of time.
    pub time_column: String,
    /// Seconds per unit of that column.
    pub time_unit_s: f64,
    /// Interval between samples, s.
    pub interval_s: f64,
    /// The axes.
    pub axes: Vec<AxisColumn>,
    /// Speed of connecting moves, mm/s.
    pub connect_speed_mm_per_s: f64,
    /// Acceleration of connecting moves, mm/s^2.
    pub connect_acceleration_mm_per_s2: f64,
}

/// One axis of the recording: machine position = sign * recorded + offset.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisColumn {
    /// The axis of the machine.
    pub name: AxisName,
    /// Column of commanded positions.
    pub commanded: String,
    /// Column of actual positions.
    pub actual: String,
    /// +1 or -1.
    pub sign: f64,
    /// Added after the sign, mm or deg.
    pub offset: f64,
}

/// What is wrong with a description.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the fields are what the message prints")]
pub enum DescriptionError {
    /// Not the TOML that is expected; the message shows line and column.
    #[error("{0}")]
    Toml(#[from] toml::de::Error),
    /// Another format.
    #[error("format is {found:?}; this program reads \"cncsim-replay/1\"")]
    Format { found: String },
    /// Not an axis letter.
    #[error("[axes.{found}]: no axis letter; use x y z u v w a b c")]
    Axis { found: String },
    /// No axis at all.
    #[error("no [axes.*]; name at least one axis")]
    NoAxes,
    /// A number out of range.
    #[error("{key} is {value}; {rule}")]
    Value { key: String, value: f64, rule: &'static str },
    /// The wrong unit.
    #[error("[axes.{axis}]: {wrong} does not fit the kind of this axis; use {right}")]
    Unit { axis: AxisName, wrong: &'static str, right: &'static str },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct Raw {
    format: String,
    file: PathBuf,
    time: RawTime,
    axes: BTreeMap<String, RawAxis>,
    connect: Option<RawConnect>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct RawTime {
    column: String,
    unit_s: f64,
    interval_s: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct RawAxis {
    commanded: String,
    actual: String,
    sign: Option<f64>,
    offset_mm: Option<f64>,
    offset_deg: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct RawConnect {
    speed_mm_per_s: f64,
    acceleration_mm_per_s2: f64,
}

impl Description {
    /// Reads a description.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn from_toml(text: &str) -> Result<Self, DescriptionError> {
        let raw: Raw = toml::from_str(text.strip_prefix('\u{feff}').unwrap_or(text))?;
        if raw.format != "cncsim-replay/1" {
            return Err(DescriptionError::Format { found: raw.format });
        }
        if raw.axes.is_empty() {
            return Err(DescriptionError::NoAxes);
        }
        let connect =
            raw.connect.unwrap_or(RawConnect { speed_mm_per_s: 100.0, acceleration_mm_per_s2: 500.0 });
        for (key, value) in [
            ("time.unit-s", raw.time.unit_s),
            ("time.interval-s", raw.time.interval_s),
            ("connect.speed-mm-per-s", connect.speed_mm_per_s),
            ("connect.acceleration-mm-per-s2", connect.acceleration_mm_per_s2),
        ] {
            if !value.is_finite() || value <= 0.0 {
                let rule = "give a finite number above 0";
                return Err(DescriptionError::Value { key: key.to_owned(), value, rule });
            }
        }
        let axes = raw.axes.into_iter().map(|(key, axis)| column(&key, axis)).collect::<Result<_, _>>()?;
        Ok(Self {
            file: raw.file,
            time_column: raw.time.column,
            time_unit_s: raw.time.unit_s,
            interval_s: raw.time.interval_s,
            axes,
            connect_speed_mm_per_s: connect.speed_mm_per_s,
            connect_acceleration_mm_per_s2: connect.acceleration_mm_per_s2,
        })
    }
}

fn column(key: &str, raw: RawAxis) -> Result<AxisColumn, DescriptionError> {
    let mut letters = key.chars();
    let name = match (letters.next(), letters.next()) {
        (Some(letter), None) => AxisName::from_letter(letter).filter(|n| *n != AxisName::S),
        _ => None,
    };
    let Some(name) = name else { return Err(DescriptionError::Axis { found: key.to_owned() }) };
    let (offset, unit) = match (name.kind(), raw.offset_mm, raw.offset_deg) {
        (AxisKind::Linear, _, Some(_)) => {
            return Err(DescriptionError::Unit { axis: name, wrong: "offset-deg", right: "offset-mm" });
        }
        (AxisKind::Rotary, Some(_), _) => {
            return Err(DescriptionError::Unit { axis: name, wrong: "offset-mm", right: "offset-deg" });
        }
        (AxisKind::Linear, mm, None) => (mm.unwrap_or(0.0), "offset-mm"),
        (AxisKind::Rotary, None, deg) => (deg.unwrap_or(0.0), "offset-deg"),
    };
    if !offset.is_finite() {
        let rule = "give a finite number";
        return Err(DescriptionError::Value { key: format!("axes.{key}.{unit}"), value: offset, rule });
    }
    let sign = raw.sign.unwrap_or(1.0);
    if sign.abs() != 1.0 {
        let rule = "give 1 or -1";
        return Err(DescriptionError::Value { key: format!("axes.{key}.sign"), value: sign, rule });
    }
    Ok(AxisColumn { name, commanded: raw.commanded, actual: raw.actual, sign, offset })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_description_is_read() {
        let d = Description::from_toml(super::super::SHIPPED_DESCRIPTION).unwrap();
        assert_eq!(d.axes.len(), 3);
        assert_eq!(d.axes[0].commanded, "DES_POS|2");
        assert_eq!(d.interval_s, 0.002);
    }

    #[test]
    fn mistakes_are_named() {
        let good = super::super::SHIPPED_DESCRIPTION;
        for (from, to, says) in [
            ("cncsim-replay/1", "cncsim-replay/9", "cncsim-replay/1"),
            ("[axes.x]", "[axes.q]", "no axis letter"),
            ("offset-mm = -255.0", "offset-deg = 1.0", "use offset-mm"),
            ("offset-mm = -255.0", "offset-mm = nan", "finite"),
            ("sign = 1\noffset-mm = 280.0", "sign = 2\noffset-mm = 280.0", "give 1 or -1"),
            ("interval-s = 0.002 ", "interval-s = 0 ", "above 0"),
            ("column = ", "colum = ", "unknown field"),
        ] {
            assert!(good.contains(from), "{from}");
            let e = Description::from_toml(&good.replace(from, to)).unwrap_err().to_string();
            assert!(e.contains(says), "{e}");
        }
    }
}
