//! A linear interferometer along one axis: displacement between workpiece and tool at targets, from either side.
//!
//! Zero is set at the first target on the first forward run. Plus means the tool went further than commanded.

use volcomp_units::axes::{AxisArray, AxisKind, AxisName, MAX_AXES};

use super::{InstrumentError, Noise, along, line};
use crate::truth::TruthMachine;

/// The instrument.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interferometer {
    /// Standard deviation of a reading.
    pub noise_um: f64,
    /// Seed of the noise.
    pub seed: u64,
}

/// What is measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Positioning {
    /// The axis that moves.
    pub axis: AxisName,
    /// Where the other axes stand, mm or deg in wire order.
    pub at: AxisArray,
    /// Targets in the order of the forward run.
    pub targets_mm: Vec<f64>,
    /// How often all targets are run forward and back.
    pub cycles: usize,
}

/// One reading, as `volcomp evaluate iso230-2` takes it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositioningRow {
    /// Counted from 1.
    pub cycle: usize,
    /// +1 forward, -1 back.
    pub direction: i8,
    /// Commanded coordinate.
    pub target_mm: f64,
    /// Actual minus nominal displacement from the first target.
    pub deviation_um: f64,
}

impl Interferometer {
    /// Measures an axis at rest; `offset` is added to every commanded position (compensation, or
    /// [`super::no_offset`]).
    /// # Errors
    /// [`InstrumentError`] for an axis that is not there or not linear, or fewer than two targets.
    pub fn positioning(
        &self,
        machine: &TruthMachine,
        plan: &Positioning,
        offset: impl Fn(&AxisArray) -> AxisArray,
    ) -> Result<Vec<PositioningRow>, InstrumentError> {
        let k = machine
            .index_of(plan.axis)
            .filter(|_| plan.axis.kind() == AxisKind::Linear)
            .ok_or(InstrumentError::NoLinearAxis { axis: plan.axis })?;
        let (first, last) = match plan.targets_mm.as_slice() {
            [first, .., last] => (*first, *last),
            few => return Err(InstrumentError::TooFew { count: few.len(), needed: 2 }),
        };
        let rising: i8 = if last >= first { 1 } else { -1 };
        let pose_at = |target: f64, run: i8| {
            let mut commanded = plan.at;
            commanded[k] = target;
            let mut directions = [0_i8; MAX_AXES];
            directions[k] = run * rising;
            let applied = offset(&commanded);
            let driven: AxisArray = std::array::from_fn(|i| commanded[i] + applied[i]);
            (machine.nominal(&commanded).tip_mm, machine.pose(&driven, &directions).tip_mm)
        };
        let (start_nominal, start_actual) = pose_at(first, 1);
        let (beam, _) = line(start_nominal, pose_at(last, 1).0)
            .ok_or(InstrumentError::Degenerate { what: "the direction of the beam" })?;
        let mut noise = Noise::new(self.seed);
        let mut rows = Vec::with_capacity(2 * plan.cycles * plan.targets_mm.len());
        for cycle in 1..=plan.cycles {
            for run in [1, -1] {
                let mut targets: Vec<f64> = plan.targets_mm.clone();
                if run < 0 {
                    targets.reverse();
                }
                for target_mm in targets {
                    let (nominal, actual) = pose_at(target_mm, run);
                    let error = along(start_actual, actual, beam) - along(start_nominal, nominal, beam);
                    let deviation_um = error * 1e3 + noise.draw(self.noise_um);
                    rows.push(PositioningRow { cycle, direction: run, target_mm, deviation_um });
                }
            }
        }
        Ok(rows)
    }
}

/// The rows as a table: `cycle,direction,target_mm,deviation_um`.
#[must_use]
pub fn csv(rows: &[PositioningRow]) -> String {
    let mut text = String::from("cycle,direction,target_mm,deviation_um\n");
    for r in rows {
        text.push_str(&format!("{},{},{},{:.6}\n", r.cycle, r.direction, r.target_mm, r.deviation_um));
    }
    text
}
