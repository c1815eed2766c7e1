//! What compensation gains: the predicted tool-tip error without it and with it. Belongs to the service thread.
//!
//! Once a second the newest cycle is taken: its position, the correction that the model asks for there and the offset
//! that the control has applied. The nominal kinematics turn axis offsets into displacements of the tool tip. It is a
//! prediction: errors that the model does not know are in neither figure.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use super::channels::CycleRecord;
use volcomp_model::geometry::Vec3;
use volcomp_model::{Model, Pose};
use volcomp_units::axes::{AxisArray, AxisName, MAX_AXES};
use volcomp_units::{MonoTime, um_from_mm};

/// Length of a slot, s.
const SLOT_S: f64 = 60.0;
/// Slots: one hour.
const SLOTS: usize = 60;
/// Smallest gain at which the correction asked for tells the error.
const GAIN_MIN: f64 = 0.01;

/// Predicted error of the tool tip, um.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct BenefitStatus {
    /// Without compensation, now.
    pub without_um: f64,
    /// With the offset that the control has applied, now.
    pub with_um: f64,
    /// RMS of the same over the last hour, one value a second.
    pub without_rms_um: f64,
    /// RMS of the same over the last hour.
    pub with_rms_um: f64,
    /// Largest in the last hour.
    pub without_max_um: f64,
    /// Largest in the last hour.
    pub with_max_um: f64,
    /// Values of the last hour.
    pub values: u64,
    /// X, Y, Z of the error without compensation, now; in workpiece coordinates.
    #[serde(default)]
    pub without_xyz_um: [f64; 3],
    /// X, Y, Z of the error with the offset that the control has applied, now.
    #[serde(default)]
    pub with_xyz_um: [f64; 3],
}

/// Sums of one minute.
#[derive(Debug, Clone, Copy)]
struct Slot {
    begun: MonoTime,
    values: u64,
    squares: [f64; 2],
    largest: [f64; 2],
}

/// The last hour.
#[derive(Debug, Default)]
pub(super) struct Benefit {
    slots: VecDeque<Slot>,
    now: Option<[Vec3; 2]>,
}

impl Benefit {
    /// Takes one value; `axes` in wire order, `gain` the share of the correction that is asked for.
    pub(super) fn look(
        &mut self,
        now: MonoTime,
        model: &Model,
        axes: &[AxisName],
        record: Option<&CycleRecord>,
        gain: f64,
    ) {
        self.now = record.and_then(|record| tip_errors(model, axes, record, gain));
        while self.slots.front().is_some_and(|slot| now.seconds_since(slot.begun) >= SLOT_S * SLOTS as f64) {
            self.slots.pop_front();
        }
        let Some(errors) = self.now else { return };
        if self.slots.back().is_none_or(|slot| now.seconds_since(slot.begun) >= SLOT_S) {
            if self.slots.len() == SLOTS {
                self.slots.pop_front();
            }
            self.slots.push_back(Slot { begun: now, values: 0, squares: [0.0; 2], largest: [0.0; 2] });
        }
        let Some(slot) = self.slots.back_mut() else { return };
        slot.values += 1;
        for (k, error) in errors.iter().map(Vec3::norm).enumerate() {
            slot.squares[k] += error * error;
            slot.largest[k] = slot.largest[k].max(error);
        }
    }

    /// Forgets everything: another model.
    pub(super) fn reset(&mut self) {
        *self = Self::default();
    }

    /// The figures; `None` while no position has come that the model can be evaluated at.
    pub(super) fn status(&self) -> Option<BenefitStatus> {
        let [without, with] = self.now?;
        let values: u64 = self.slots.iter().map(|slot| slot.values).sum();
        let rms = |k: usize| {
            let squares: f64 = self.slots.iter().map(|slot| slot.squares[k]).sum();
            (squares / values.max(1) as f64).sqrt()
        };
        let largest = |k: usize| self.slots.iter().map(|slot| slot.largest[k]).fold(0.0, f64::max);
        Some(BenefitStatus {
            without_um: without.norm(),
            with_um: with.norm(),
            without_rms_um: rms(0),
            with_rms_um: rms(1),
            without_max_um: largest(0),
            with_max_um: largest(1),
            values,
            without_xyz_um: without.into(),
            with_xyz_um: with.into(),
        })
    }
}

/// Errors of the tool tip, um: opposite to its displacements by the whole correction, and by the part of it that is not
/// applied.
fn tip_errors(model: &Model, axes: &[AxisName], record: &CycleRecord, gain: f64) -> Option<[Vec3; 2]> {
    if gain < GAIN_MIN {
        return None;
    }
    let wire_index = |name: AxisName| axes.iter().take(MAX_AXES).position(|axis| *axis == name);
    let mut pose = Pose::at([0.0; MAX_AXES]);
    let [mut whole, mut left]: [AxisArray; 2] = [[0.0; MAX_AXES]; 2];
    for (k, axis) in model.axes().enumerate() {
        let Some(wire) = wire_index(axis.name) else { continue };
        let wanted = record.wanted[wire] / gain;
        pose.position[k] = axis.name.kind().position_in(record.position[wire]);
        whole[k] = wanted;
        left[k] = wanted - axis.name.kind().position_in(record.applied[wire]);
    }
    let tip = |offset: &AxisArray| {
        let mut moved = pose;
        for (at, offset) in moved.position.iter_mut().zip(offset) {
            *at += offset;
        }
        model.nominal_tool(&moved).tip
    };
    let nominal = tip(&[0.0; MAX_AXES]);
    let errors = [whole, left].map(|offset| (nominal - tip(&offset)).map(um_from_mm));
    errors.iter().all(|error| error.norm().is_finite()).then_some(errors)
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_config::model;
    use volcomp_engine::State;

    #[test]
    fn the_error_without_compensation_is_the_deviation_of_the_model() {
        let text = "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w X' b Y Z t]\"\n\
            [errors.exx.table]\nposition-mm = [-200, 200]\nvalue-um = [-30, 50]\n\
            [errors.eyx.constant]\nvalue-um = 4\n[errors.ezz.table]\nposition-mm = [-200, 200]\nvalue-um = [9, -7]\n";
        let model = Model::new(&model::parse("m.toml", text).expect("a model")).expect("consistent");
        let axes = [AxisName::X, AxisName::Y, AxisName::Z];
        let place = [120.0, -50.0, 80.0];
        let mut pose = Pose::at([0.0; MAX_AXES]);
        for (k, axis) in model.axes().enumerate() {
            let wire = axes.iter().position(|a| *a == axis.name).expect("one of three");
            pose.position[k] = place[wire];
        }
        let deviation = model.deviation(&pose).position;
        assert!(deviation.norm() > 0.01, "{deviation}");
        // what the engine asks for takes the deviation out, axis by axis
        let mut wanted = [0.0; MAX_AXES];
        let mut position = [0.0; MAX_AXES];
        for k in 0..3 {
            (wanted[k], position[k]) = (-deviation[k] / 2.0, place[k]);
        }
        let mut record = CycleRecord {
            answered: true,
            state: State::Active,
            offset: wanted,
            wanted,
            position,
            ..CycleRecord::default()
        };
        let [without, with] = tip_errors(&model, &axes, &record, 0.5).expect("a position");
        assert!((without - deviation.map(um_from_mm)).norm() < 1e-6, "{without} {deviation}");
        assert!((with - without).norm() < 1e-9, "nothing is applied: {with}");
        // half the gain leaves half of it
        record.applied = wanted;
        let [_, with] = tip_errors(&model, &axes, &record, 0.5).expect("a position");
        assert!((with - without / 2.0).norm() < 1e-6, "{with}");
        assert!(tip_errors(&model, &axes, &record, 0.0).is_none());
    }
}
