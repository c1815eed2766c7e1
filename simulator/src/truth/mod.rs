//! The machine as it really is. Written without volcomp's model: full homogeneous transforms, own error shapes,
//! own units (mm and deg at the boundary).

use volcomp::core::axes::AxisArray;

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
