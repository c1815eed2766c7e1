//! What a run tells while it runs and at its end.

use volcomp_units::axes::AxisArray;

use super::record::CycleRecord;

/// What an observer wants.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flow {
    /// Another cycle.
    GoOn,
    /// No more.
    Stop,
}

/// Sees every cycle and says whether to go on; an error ends the run.
pub type Observer<'a> = &'a mut dyn FnMut(&CycleRecord) -> std::io::Result<Flow>;

/// What a run was like.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RunSummary {
    /// Cycles run.
    pub cycles: u64,
    /// Simulated time, s.
    pub duration_s: f64,
    /// Good corrections received.
    pub corrections: u64,
    /// Corrections that were not used: not finite, too old, out of order.
    pub rejected: u64,
    /// Lock step: positions without an answer in time while a daemon was connected.
    pub unanswered: u64,
    /// Cycles in which the control held part of an offset back.
    pub limited: u64,
    /// Cycles in which the control took the offset back by itself.
    pub ramping_out: u64,
    /// Real time: cycles that began more than one cycle late.
    pub late: u64,
    /// Position frames left out because the send buffer was full.
    pub left_out: u64,
    /// Links that ended.
    pub links_ended: u64,
    /// Largest offset in force per axis, mm or deg.
    pub largest_offset: AxisArray,
}
