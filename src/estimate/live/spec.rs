//! What sensors and maps there are. Lengths mm, angles rad, times s.

use super::axis::LaserAlignment;
use crate::fivedof::{Head, HeadError};
use crate::{GridError, MapError};
use volcomp_model::axes::AxisName;

/// Everything about live estimation.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LiveSpec {
    /// The sensors.
    pub sensors: Vec<SensorSpec>,
    /// The maps that they feed.
    pub maps: Vec<MapSpec>,
}

/// What a sensor measures.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "a handful of them in a whole program")]
pub enum SensorKind {
    /// The tool: poses, points on it, deviations along a direction, touches; feeds the map of this number.
    Tool {
        /// Index in [`LiveSpec::maps`].
        map: usize,
    },
    /// A 5-DOF laser along an axis.
    FiveDof {
        /// The axis.
        axis: AxisName,
        /// The instrument, for raw readings.
        head: Option<Head>,
        /// Time constant of smoothing, s.
        smooth_s: f64,
        /// What it grows to while the axis rests, s; below `smooth_s`: it does not.
        rest_smooth_s: f64,
        /// Share of the travel that must have been seen before the alignment counts as known.
        reference_share: f64,
        /// What the readings refer to.
        alignment: LaserAlignment,
    },
    /// A live value of the model of the sensor's own name, worked out by somebody else.
    Value,
    /// Temperatures: inputs of thermal displacements.
    Temperature,
    /// The speed of a spindle: an input of thermal displacements.
    Speed,
}

impl SensorKind {
    /// Its name in files and status.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Tool { .. } => "tool",
            Self::FiveDof { .. } => "five-dof",
            Self::Value => "value",
            Self::Temperature => "temperature",
            Self::Speed => "speed",
        }
    }
}

/// A sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorSpec {
    /// Its name, on the link and everywhere else.
    pub name: String,
    /// What it measures.
    pub kind: SensorKind,
    /// Standard deviation of a length, where the reading states none.
    pub std_mm: f64,
    /// Standard deviation of an angle, where the reading states none.
    pub std_rad: f64,
    /// Whether its noise is learned from what its readings leave behind.
    pub adapt: bool,
    /// Readings looked at before any is used.
    pub initialisation: usize,
    /// Shortest time from measurement to arrival.
    pub latency_s: f64,
    /// Age at which a reading is too old, and silence at which the sensor is silent.
    pub age_limit_s: f64,
    /// Largest plausible length, angle (temperatures: degrees Celsius; speeds: 1/min).
    pub range: [f64; 2],
    /// Largest plausible change from one reading to the next.
    pub jump: [f64; 2],
    /// Largest plausible rate per second.
    pub rate: [f64; 2],
    /// Time for which readings may stay exactly the same.
    pub frozen_s: f64,
    /// Lowest quality believed, 0 to 1.
    pub quality_min: f64,
    /// Time for which an excluded sensor must be plausible.
    pub return_s: f64,
}

impl SensorSpec {
    /// A sensor with everything at its default.
    #[must_use]
    pub fn new(name: &str, kind: SensorKind) -> Self {
        Self {
            name: name.to_owned(),
            kind,
            std_mm: 0.01,
            std_rad: 1e-5,
            adapt: true,
            initialisation: 25,
            latency_s: 0.0,
            age_limit_s: 0.5,
            range: [1.0, 1e-3],
            jump: [0.2, 2e-4],
            rate: [f64::INFINITY; 2],
            frozen_s: 1.0,
            quality_min: 0.0,
            return_s: 2.0,
        }
    }
}

/// A map: its components are the live values of the model that are called `NAME.SYMBOL`.
#[derive(Debug, Clone, PartialEq)]
pub struct MapSpec {
    /// Its name.
    pub name: String,
    /// Coordinates of the nodes along X, Y and Z.
    pub nodes: [Vec<f64>; 3],
    /// Standard deviation of the offline map: lengths, angles.
    pub std: [f64; 2],
    /// Distance over which its errors go together.
    pub correlation_mm: f64,
    /// Standard deviation that a random walk reaches in an hour: lengths, angles.
    pub drift_per_h: [f64; 2],
    /// Time constant of the return to the offline map; `None`: a random walk.
    pub return_s: Option<f64>,
    /// The map is never believed to differ by more: lengths, angles.
    pub limit: [f64; 2],
    /// Largest `nu^2 / S` that is used.
    pub gate: f64,
    /// Readings beyond the gate on end that make an alarm.
    pub rejections_to_alarm: u32,
    /// Time for which an alarm holds the map before it is given up for the static model.
    pub alarm_hold_s: f64,
}

impl MapSpec {
    /// A map with everything but its nodes at its default.
    #[must_use]
    pub fn new(name: &str, nodes: [Vec<f64>; 3]) -> Self {
        Self {
            name: name.to_owned(),
            nodes,
            std: [0.02, 2e-5],
            correlation_mm: 500.0,
            drift_per_h: [0.02, 2e-5],
            return_s: None,
            limit: [0.05, 5e-5],
            gate: 10.8,
            rejections_to_alarm: 5,
            alarm_hold_s: 10.0,
        }
    }
}

/// Why sensors, maps and model do not go together.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LiveError {
    /// A map without components.
    #[error(
        "map {map}: the model has no live value called \"{map}.SYMBOL\"; add for example [errors.eaz.live] with sensor = \"{map}.eaz\" to the model"
    )]
    NoChannel {
        /// The map.
        map: String,
    },
    /// A live value whose name says nothing about what it is.
    #[error(
        "live value \"{channel}\" of the model: \"{found}\" is not an error symbol; write for example {name}.eaz"
    )]
    BadChannel {
        /// The channel.
        channel: String,
        /// Map or sensor.
        name: String,
        /// What stands behind the dot.
        found: String,
    },
    /// More than six components.
    #[error("map {map}: {found} live values, a map has at most 6")]
    TooManyChannels {
        /// The map.
        map: String,
        /// Live values found.
        found: usize,
    },
    /// A sensor names a map that is not there.
    #[error("sensor {sensor} feeds a map that is not there")]
    NoMap {
        /// The sensor.
        sensor: String,
    },
    /// An axis that the chain does not have.
    #[error("sensor {sensor}: axis {axis} is not a linear axis of the model")]
    NoAxis {
        /// The sensor.
        sensor: String,
        /// The axis.
        axis: AxisName,
    },
    /// A thermal displacement whose input nobody measures.
    #[error(
        "thermal {growth} depends on \"{sensor}\", an unknown sensor; add [[sensor]] with name = \"{name}\" and kind = \"{kind}\""
    )]
    NoInput {
        /// The thermal displacement.
        growth: String,
        /// The input.
        sensor: String,
        /// The sensor that would tell it.
        name: String,
        /// Its kind.
        kind: &'static str,
    },
    /// A thermal displacement whose input is something else.
    #[error("thermal {growth} takes \"{sensor}\" for a {wanted}, but the sensor is of kind \"{found}\"")]
    InputKind {
        /// The thermal displacement.
        growth: String,
        /// The input.
        sensor: String,
        /// What the thermal displacement wants.
        wanted: &'static str,
        /// What the sensor is.
        found: &'static str,
    },
    /// A live value of the model with two sources.
    #[error(
        "live value \"{channel}\" of the model has two sources: a sensor or map, and a thermal displacement"
    )]
    TwoSources {
        /// The live value.
        channel: String,
    },
    /// Two of one name.
    #[error("two sensors or maps are called {name}")]
    Twice {
        /// The name.
        name: String,
    },
    /// The grid.
    #[error("map {map}: {source}")]
    Grid {
        /// The map.
        map: String,
        /// What is wrong.
        source: GridError,
    },
    /// The map.
    #[error("map {map}: {source}")]
    Map {
        /// The map.
        map: String,
        /// What is wrong.
        source: MapError,
    },
    /// The instrument.
    #[error("sensor {sensor}: {source}")]
    Head {
        /// The sensor.
        sensor: String,
        /// What is wrong.
        source: HeadError,
    },
}
