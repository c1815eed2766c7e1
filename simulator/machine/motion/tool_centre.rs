//! Tool-centre-point motion (`G43.4`): from the programmed tool tip to the positions of the axes, with the nominal kinematics
//! of the control.
//!
//! Programmed X, Y, Z are the positions that the linear axes would have with every rotary axis at zero, so that switching on
//! with the head at zero changes nothing; with the head tilted they lead the tip, relative to the workpiece, to where these
//! positions would. The tip moves on the programmed line or arc at the programmed feed; rotary axes follow in proportion to
//! the path. The rotations are exact, and nothing is known of the machine's errors.

use nalgebra::{Matrix3, Vector3};
use volcomp_units::axes::{AxisArray, AxisKind, AxisName, MAX_AXES};

use super::segment::{SHORTEST, Segment};
use crate::truth::TruthMachine;

/// Parts of a segment whose ends are looked at for limits.
const PARTS: u32 = 8;
/// Half of the step for slopes, as a fraction of the path.
const STEP: f64 = 1e-4;

/// Nominal kinematics of a machine with rotary axes.
#[derive(Debug, Clone)]
pub struct ToolCentre {
    /// Of its errors, drives and time nothing is used.
    machine: TruthMachine,
    /// Wire indices of X, Y and Z.
    linear: [usize; 3],
    /// Nominal tip with every axis at zero, mm.
    home: Vector3<f64>,
}

impl PartialEq for ToolCentre {
    fn eq(&self, other: &Self) -> bool {
        self.linear == other.linear
            && self.home == other.home
            && self.machine.chain().text() == other.machine.chain().text()
            && self.machine.axes() == other.machine.axes()
            && (0..MAX_AXES).all(|k| self.machine.drawing(k) == other.machine.drawing(k))
    }
}

impl ToolCentre {
    /// The kinematics of a machine; none where X, Y, Z or a rotary axis is missing.
    #[must_use]
    pub fn of(machine: &TruthMachine) -> Option<Self> {
        machine.axes().iter().find(|a| a.kind() == AxisKind::Rotary)?;
        let [x, y, z] = [AxisName::X, AxisName::Y, AxisName::Z].map(|a| machine.index_of(a));
        let home = machine.nominal(&[0.0; MAX_AXES]).tip_mm.into();
        Some(Self { machine: machine.clone(), linear: [x?, y?, z?], home })
    }

    fn tip(&self, axes: &AxisArray) -> Vector3<f64> {
        self.machine.nominal(axes).tip_mm.into()
    }

    /// Tip with X, Y and Z at zero, and what a millimetre of each does to it.
    fn head(&self, axes: &AxisArray) -> (Vector3<f64>, Matrix3<f64>) {
        let mut at = *axes;
        self.linear.iter().for_each(|k| at[*k] = 0.0);
        let tip = self.tip(&at);
        let columns = self.linear.map(|k| {
            let mut moved = at;
            moved[k] = 1.0;
            self.tip(&moved) - tip
        });
        (tip, Matrix3::from_columns(&columns))
    }

    /// Positions of the axes that lead the tip to the programmed place; rotary axes stand where they are programmed.
    #[must_use]
    pub fn axes(&self, programmed: &AxisArray) -> AxisArray {
        let (tip, effect) = self.head(programmed);
        let wanted = self.home + Vector3::from(self.linear.map(|k| programmed[k]));
        // X, Y and Z span space in every pose of the rotary axes: the effect is a rotation
        let solution = effect.transpose() * (wanted - tip);
        let mut axes = *programmed;
        self.linear.iter().zip(solution.iter()).for_each(|(k, value)| axes[*k] = *value);
        axes
    }

    /// What to program for positions of the axes.
    #[must_use]
    pub fn programmed(&self, axes: &AxisArray) -> AxisArray {
        let place = self.tip(axes) - self.home;
        let mut programmed = *axes;
        self.linear.iter().zip(place.iter()).for_each(|(k, value)| programmed[*k] = *value);
        programmed
    }

    /// Change of every axis per unit of path.
    pub(super) fn tangent(&self, segment: &Segment, fraction: f64, length: f64) -> AxisArray {
        let mut u = [0.0; MAX_AXES];
        if length <= SHORTEST {
            return u;
        }
        let [from, to] = [(fraction - STEP).max(0.0), (fraction + STEP).min(1.0)];
        let [a, b] = [from, to].map(|f| self.axes(&segment.point(f)));
        for (value, (a, b)) in u.iter_mut().zip(a.iter().zip(&b)) {
            *value = (b - a) / ((to - from) * length);
        }
        u
    }

    /// Largest absolute change of every axis per unit of path, at the ends and between equal parts.
    pub(super) fn steepest(&self, segment: &Segment, length: f64) -> AxisArray {
        let mut largest = [0.0_f64; MAX_AXES];
        for i in 0..=PARTS {
            let u = self.tangent(segment, f64::from(i) / f64::from(PARTS), length);
            largest.iter_mut().zip(u).for_each(|(l, u)| *l = l.max(u.abs()));
        }
        largest
    }

    /// Lowest and highest position of every axis, at the ends and between equal parts.
    pub(super) fn extent(&self, segment: &Segment) -> [AxisArray; 2] {
        let (mut low, mut high) = ([f64::INFINITY; MAX_AXES], [f64::NEG_INFINITY; MAX_AXES]);
        for i in 0..=PARTS {
            let q = self.axes(&segment.point(f64::from(i) / f64::from(PARTS)));
            for k in 0..MAX_AXES {
                low[k] = low[k].min(q[k]);
                high[k] = high[k].max(q[k]);
            }
        }
        [low, high]
    }
}

#[cfg(test)]
mod tests;
