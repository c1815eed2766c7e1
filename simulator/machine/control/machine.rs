//! The machine that a control drives.

use volcomp_units::axes::AxisArray;

use crate::truth::{Sample, TruthMachine};

/// A machine: takes set points, tells where it really went.
pub trait Machine {
    /// One cycle with set points (commanded plus offset, mm or deg) for the drives.
    fn step(&mut self, dt_s: f64, drive: &AxisArray) -> Sample;
    /// One cycle in which the axes are known to stand at `axis` (replay of recorded encoder positions).
    fn step_measured(&mut self, dt_s: f64, axis: &AxisArray) -> Sample;
}

impl Machine for TruthMachine {
    fn step(&mut self, dt_s: f64, drive: &AxisArray) -> Sample {
        TruthMachine::step(self, dt_s, drive)
    }

    fn step_measured(&mut self, dt_s: f64, axis: &AxisArray) -> Sample {
        TruthMachine::step_measured(self, dt_s, axis)
    }
}

/// A machine without any error: every axis stands where it should, the tip is X, Y, Z (the first three axes).
#[derive(Debug, Clone, Copy, Default)]
pub struct IdealMachine;

impl Machine for IdealMachine {
    fn step(&mut self, _dt_s: f64, drive: &AxisArray) -> Sample {
        Sample {
            axis: *drive,
            encoder: *drive,
            tip_mm: [drive[0], drive[1], drive[2]],
            direction: [0.0, 0.0, 1.0],
        }
    }

    fn step_measured(&mut self, dt_s: f64, axis: &AxisArray) -> Sample {
        self.step(dt_s, axis)
    }
}
