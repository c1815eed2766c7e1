//! The axes of a simulated machine as its control knows them: order on the wire, travel, speed, acceleration.

use std::sync::Arc;

use volcomp_units::axes::{AxisKind, AxisName, MAX_AXES};

use super::tool_centre::ToolCentre;
use crate::truth::TruthMachine;

/// One axis of the control. Linear: mm; rotary: deg.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisSetup {
    /// Its letter.
    pub name: AxisName,
    /// Software limits, lower and upper.
    pub travel: [f64; 2],
    /// Rapid rate per minute.
    pub rapid_per_min: f64,
    /// Largest acceleration per s^2.
    pub acceleration: f64,
    /// Largest jerk per s^3.
    pub jerk: f64,
    /// Largest step of speed per s where one block meets the next.
    pub corner_step: f64,
}

impl AxisSetup {
    /// An axis with the usual dynamics of a machining centre.
    #[must_use]
    pub fn new(name: AxisName, travel: [f64; 2]) -> Self {
        match name.kind() {
            AxisKind::Linear => Self {
                name,
                travel,
                rapid_per_min: 24_000.0,
                acceleration: 4_000.0,
                jerk: 80_000.0,
                corner_step: 2.0,
            },
            AxisKind::Rotary => Self {
                name,
                travel,
                rapid_per_min: 7_200.0,
                acceleration: 1_000.0,
                jerk: 20_000.0,
                corner_step: 0.5,
            },
        }
    }
}

/// Why a list of axes is refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum AxesError {
    /// None, or more than the link carries.
    #[error("{count} axes; a control has 1 to {MAX_AXES}")]
    Count {
        /// How many.
        count: usize,
    },
    /// A letter twice.
    #[error("axis {name} is listed twice; leave one out")]
    Twice {
        /// Its letter.
        name: AxisName,
    },
    /// A number that makes no sense.
    #[error("axis {name}: {what} is {value}; give a finite number above {limit}")]
    Value {
        /// Its letter.
        name: AxisName,
        /// Which setting.
        what: &'static str,
        /// What was given.
        value: f64,
        /// What it must exceed.
        limit: f64,
    },
}

/// The axes in wire order.
#[derive(Debug, Clone, PartialEq)]
pub struct MachineAxes {
    axes: Vec<AxisSetup>,
    /// Nominal kinematics for tool-centre-point motion; none on a control without it.
    tool_centre: Option<Arc<ToolCentre>>,
}

impl MachineAxes {
    /// Axes in wire order.
    ///
    /// # Errors
    /// None or too many, a letter twice, numbers that make no sense.
    pub fn new(axes: Vec<AxisSetup>) -> Result<Self, AxesError> {
        if axes.is_empty() || axes.len() > MAX_AXES {
            return Err(AxesError::Count { count: axes.len() });
        }
        for (k, axis) in axes.iter().enumerate() {
            if axes[..k].iter().any(|a| a.name == axis.name) {
                return Err(AxesError::Twice { name: axis.name });
            }
            for (what, value, limit) in [
                ("lower end of travel", axis.travel[0], f64::NEG_INFINITY),
                ("upper end of travel", axis.travel[1], axis.travel[0]),
                ("rapid rate", axis.rapid_per_min, 0.0),
                ("acceleration", axis.acceleration, 0.0),
                ("jerk", axis.jerk, 0.0),
                ("corner step", axis.corner_step, 0.0),
            ] {
                if !value.is_finite() || value <= limit {
                    return Err(AxesError::Value { name: axis.name, what, value, limit });
                }
            }
        }
        Ok(Self { axes, tool_centre: None })
    }

    /// The axes of a machine with the usual dynamics and, where it has rotary axes beside X, Y and Z, its nominal
    /// kinematics for tool-centre-point motion.
    ///
    /// # Errors
    /// None or too many, a travel without length.
    pub fn of(machine: &TruthMachine) -> Result<Self, AxesError> {
        let axes = machine.axes().into_iter().enumerate();
        let plain = Self::new(axes.map(|(k, name)| AxisSetup::new(name, machine.travel(k))).collect())?;
        Ok(Self { tool_centre: ToolCentre::of(machine).map(Arc::new), ..plain })
    }

    /// Nominal kinematics for tool-centre-point motion.
    #[must_use]
    pub fn tool_centre(&self) -> Option<&ToolCentre> {
        self.tool_centre.as_deref()
    }

    /// X, Y and Z with these travels, mm.
    ///
    /// # Errors
    /// A travel without length.
    pub fn three_axis(x: [f64; 2], y: [f64; 2], z: [f64; 2]) -> Result<Self, AxesError> {
        Self::new(vec![
            AxisSetup::new(AxisName::X, x),
            AxisSetup::new(AxisName::Y, y),
            AxisSetup::new(AxisName::Z, z),
        ])
    }

    /// The middle of the travel of linear axes, and zero (or the end next to it) of rotary axes.
    #[must_use]
    pub fn middle(&self) -> [f64; MAX_AXES] {
        let mut q = [0.0; MAX_AXES];
        for (value, axis) in q.iter_mut().zip(&self.axes) {
            *value = match axis.name.kind() {
                AxisKind::Linear => 0.5 * (axis.travel[0] + axis.travel[1]),
                AxisKind::Rotary => 0.0_f64.clamp(axis.travel[0], axis.travel[1]),
            };
        }
        q
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.axes.len()
    }

    /// Never true; a control has an axis.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.axes.is_empty()
    }

    /// The axes in wire order.
    #[must_use]
    pub fn as_slice(&self) -> &[AxisSetup] {
        &self.axes
    }

    /// Place of an axis on the wire.
    #[must_use]
    pub fn index(&self, name: AxisName) -> Option<usize> {
        self.axes.iter().position(|a| a.name == name)
    }

    /// True where the axis at this place is linear.
    #[must_use]
    pub fn is_linear(&self, index: usize) -> bool {
        self.axes.get(index).is_some_and(|a| a.name.kind() == AxisKind::Linear)
    }

    /// The letters, for messages.
    #[must_use]
    pub fn letters(&self) -> String {
        let letters: Vec<String> = self.axes.iter().map(|a| a.name.to_string()).collect();
        letters.join(" ")
    }

    /// The first axis outside its travel at this position: index and value.
    #[must_use]
    pub fn outside(&self, position: &[f64; MAX_AXES]) -> Option<(usize, f64)> {
        self.axes.iter().zip(position).enumerate().find_map(|(k, (axis, &value))| {
            (value < axis.travel[0] - 1e-9 || value > axis.travel[1] + 1e-9).then_some((k, value))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mistakes_are_named() {
        let x = AxisSetup::new(AxisName::X, [0.0, 100.0]);
        assert_eq!(MachineAxes::new(vec![]), Err(AxesError::Count { count: 0 }));
        assert_eq!(MachineAxes::new(vec![x, x]), Err(AxesError::Twice { name: AxisName::X }));
        let flat = AxisSetup { travel: [5.0, 5.0], ..x };
        assert!(MachineAxes::new(vec![flat]).unwrap_err().to_string().contains("upper end of travel is 5"));
        let bad = AxisSetup { jerk: f64::NAN, ..x };
        assert!(MachineAxes::new(vec![bad]).is_err());
    }

    #[test]
    fn positions_outside_travel_are_found() {
        let axes = MachineAxes::three_axis([0.0, 10.0], [0.0, 10.0], [-5.0, 0.0]).unwrap();
        let mut q = [0.0; MAX_AXES];
        assert_eq!(axes.outside(&q), None);
        q[2] = 0.1;
        assert_eq!(axes.outside(&q), Some((2, 0.1)));
    }
}
