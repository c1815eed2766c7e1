//! Part programs and recorded motion to positions per control cycle.
//!
//! Reading order: [`axes`] (what the axes can do), [`gcode`] (text to segments), [`segment`] (their geometry),
//! [`profile`] (segments to positions in time), [`tool_centre`] (tip to axes in five-axis motion), [`paths`] (standard programs as text), [`recorded`] (replay).
//! Positions are in mm and degrees, in the wire order of the axes; times in s, feeds in mm/min (deg/min for blocks
//! that only move rotary axes).

pub mod axes;
pub mod gcode;
pub mod paths;
pub mod profile;
pub mod recorded;
pub mod segment;
pub mod tool_centre;

use volcomp_units::axes::AxisArray;

pub use axes::{AxisSetup, MachineAxes};
pub use profile::{Dynamics, Trajectory};
pub use tool_centre::ToolCentre;

/// What the motion asks for in one control cycle.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MotionCycle {
    /// Commanded positions, without any offset, mm or deg.
    pub commanded: AxisArray,
    /// Where the axes really were when this motion was recorded; `None` where the machine model decides.
    pub measured: Option<AxisArray>,
    /// Speed along the path, mm/min.
    pub feed_mm_per_min: f64,
    /// An axis is moving.
    pub moving: bool,
    /// This cycle counts when results are computed (no rapid, feed-in, overshoot or inserted move).
    pub scored: bool,
    /// Line of the part program or row of the recording, 1-based; 0 where there is none.
    pub line: u32,
}

/// A source of commanded positions, one per control cycle.
pub trait MotionSource {
    /// Where the motion starts; the machine must stand there.
    fn start(&self) -> AxisArray;
    /// The next cycle; `None` after the last.
    fn next_cycle(&mut self) -> Option<MotionCycle>;
    /// Begins again at the start.
    fn rewind(&mut self);
}
