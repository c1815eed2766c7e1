//! The quantity over which an effect is drawn, and what is divided out so that it is one curve.

use crate::Signal;
use crate::lever::Lever;
use crate::machine_state::Axis;

/// Quantity of an abscissa.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Over {
    /// Position.
    Position(Axis),
    /// Position within one period, mm or rad.
    Period(Axis, f64),
    /// Distance since the last reversal, no more than so many mm.
    SinceReversal(Axis, f64),
    /// Time since the last reversal, no more than so many s.
    TimeSinceReversal(Axis, f64),
    /// Velocity.
    Velocity(Axis),
    /// Velocity along the direction of measurement.
    VelocityAlongU,
    /// Acceleration.
    Acceleration(Axis),
    /// Tool length.
    ToolLength,
    /// Distance from instrument to target.
    Range,
    /// Force along an axis.
    Force(Axis),
    /// Time.
    Time,
}

/// What tells the lines of one picture apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Branch {
    /// One line.
    None,
    /// Direction of travel.
    Direction(Axis),
    /// Length of the tool.
    Tool,
    /// File of the session, each with a clock of its own.
    File,
}

/// Factor of an effect that is no abscissa.
#[derive(Debug, Clone, PartialEq)]
pub enum Weight {
    /// None.
    One,
    /// Component of the lever that turns into a displacement along `u`, mm.
    Lever(Axis, Lever),
    /// Temperature above a reference, K.
    Warmth(Signal, f64),
}

/// How an effect is drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawing {
    /// Abscissa.
    pub over: Over,
    /// Lines.
    pub branch: Branch,
    /// Factor that is divided out.
    pub weight: Weight,
}

impl From<Over> for Drawing {
    fn from(over: Over) -> Self {
        Self { over, branch: Branch::None, weight: Weight::One }
    }
}

impl Drawing {
    /// Columns of a session (`docs/reference/session-files.md` 1) that it takes; the time where the readings state the rest.
    pub(crate) fn columns(&self) -> Vec<String> {
        let abscissa = match self.over {
            Over::Position(axis) | Over::Period(axis, _) => axis.column(),
            Over::Velocity(axis) => axis.velocity_column(),
            Over::Acceleration(axis) => axis.acceleration_column(),
            Over::Force(axis) => format!("force_{axis}_n"),
            Over::ToolLength => "tool_length_mm".to_owned(),
            _ => "t_s".to_owned(),
        };
        let mut columns = vec![abscissa];
        if let Branch::Direction(axis) = self.branch {
            columns.push(format!("dir_{axis}"));
        }
        if let Weight::Lever(_, lever) = &self.weight {
            columns.extend(lever.columns());
        }
        columns
    }

    pub(crate) fn by(self, branch: Branch) -> Self {
        Self { branch, ..self }
    }

    pub(crate) fn scaled(self, weight: Weight) -> Self {
        Self { weight, ..self }
    }
}
