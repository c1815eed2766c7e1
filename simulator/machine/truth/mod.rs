//! The machine as it really is. Written without volcomp's model: full homogeneous transforms, own error shapes,
//! own units (mm and deg at the boundary).
//!
//! Reading order: [`chain`] (the string), [`kinematics`] (the exact product), [`shape`] (the errors), [`drive`]
//! (what moves and measures an axis), [`structure`] (what yields and winds up behind it), [`conditions`] (heat, load and wear since a survey), [`machine`] (all of it together). The file format is described in
//! `simulator/machines/vmc-850.toml`, which uses most of its keys.

pub mod axis_drift;
pub mod chain;
pub mod conditions;
pub mod drift;
pub mod drive;
pub mod error;
mod file;
pub mod kinematics;
pub mod machine;
mod params;
pub mod shape;
pub mod structure;
pub mod tool;
pub mod transform;

pub use error::TruthError;
pub use kinematics::{Deviation, Pose};
pub use machine::{GANTRY_5AX, GRINDER_AB, TruthMachine, VMC_850};

use volcomp_units::axes::AxisArray;

/// What the machine did in one control cycle.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sample {
    /// True coordinate of each axis (where the drive really stands, before geometric errors), mm or deg.
    pub axis: AxisArray,
    /// What the encoders report, mm or deg: quantised, with noise.
    pub encoder: AxisArray,
    /// Actual tool tip relative to the workpiece, in the workpiece frame, mm.
    pub tip_mm: [f64; 3],
    /// Actual tool direction relative to the workpiece.
    pub direction: [f64; 3],
}
