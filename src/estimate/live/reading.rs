//! What sensors say. Lengths mm, angles rad; positions and directions in the workpiece frame W unless stated.

use nalgebra::Matrix6;

use crate::Kind;
use crate::fivedof::Readings;
use volcomp_model::geometry::Vec3;

/// One message of a sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// When it was taken, on the sensor's own clock, ns.
    pub stamp_ns: i64,
    /// How good the sensor finds it, 0 to 1.
    pub quality: f64,
    /// What it says.
    pub body: Body,
}

/// What a reading says.
#[derive(Debug, Clone, PartialEq)]
#[expect(
    clippy::large_enum_variant,
    reason = "poses are what comes most often; a box each would be freed as often"
)]
pub enum Body {
    /// A pose of the tool.
    Tool(ToolReading),
    /// Points that ride on the tool.
    Points(Vec<PointReading>),
    /// The deviation of the tool tip along a direction: a touch, a ball bar, a comparator.
    Deviation {
        /// Unit vector in machine axes M.
        direction: Vec3,
        /// Actual minus nominal.
        value: f64,
        /// Its standard deviation, where known.
        std: Option<f64>,
    },
    /// Detectors of a 5-DOF laser.
    FiveDofRaw(Readings),
    /// EY EZ EA EB EC of the carriage in laser coordinates.
    FiveDof([f64; 5]),
    /// A live value of the model.
    Value {
        /// mm or rad.
        value: f64,
        /// What the sensor takes it for, where it says so.
        unit: Option<Kind>,
    },
    /// Temperatures, degrees Celsius.
    Temperatures(Vec<f64>),
    /// Speed of a spindle, 1/min.
    Speed(f64),
}

/// A vector that was measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Seen {
    /// As it is.
    Absolute(Vec3),
    /// Actual minus nominal at the commanded position.
    Deviation(Vec3),
}

/// A pose of the tool.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToolReading {
    /// The tool tip.
    pub tip: Seen,
    /// The unit vector along the tool, from the tip to the spindle, where measured.
    pub direction: Option<Seen>,
    /// Covariance of tip (mm) and direction (per component), where known.
    pub covariance: Option<Matrix6<f64>>,
}

/// A point that rides on the tool.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointReading {
    /// From the tool tip, in machine axes with all axes at zero.
    pub offset: Vec3,
    /// Where it was seen.
    pub position: Seen,
    /// Standard deviation per component, where known.
    pub std: Option<f64>,
}

impl Reading {
    /// Its numbers, as far as they are looked at for a sensor that is frozen.
    #[must_use]
    pub fn numbers(&self) -> Vec<f64> {
        let of = |seen: &Seen| match seen {
            Seen::Absolute(v) | Seen::Deviation(v) => [v.x, v.y, v.z],
        };
        match &self.body {
            Body::Tool(tool) => of(&tool.tip).into_iter().chain(tool.direction.iter().flat_map(of)).collect(),
            Body::Points(points) => points.iter().take(3).flat_map(|p| of(&p.position)).collect(),
            Body::Deviation { value, .. } | Body::Value { value, .. } | Body::Speed(value) => vec![*value],
            Body::FiveDofRaw(readings) => readings.change.iter().flatten().copied().collect(),
            Body::FiveDof(motion) => motion.to_vec(),
            Body::Temperatures(list) => list.clone(),
        }
    }
}
