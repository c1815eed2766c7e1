//! What optics on the carriage of one axis see, whatever the other axes do.
//!
//! The head stands on the body that the carriage moves on: on the bed side, or, with relative mounting, on the workpiece
//! side while the optics are on the tool side. All in M at home.

use nalgebra::{Matrix4, Point3, Vector3};
use volcomp_units::axes::{AxisArray, AxisKind, AxisName};

use super::InstrumentError;
use crate::truth::TruthMachine;
use crate::truth::chain::Side;
use crate::truth::transform::{inverse, rotation_part, rotation_vector};

/// Where instrument and optics stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mount {
    /// Instrument on the bed side, optics on the carriage.
    Carriage,
    /// Instrument on the workpiece side, optics on the tool side.
    Relative,
}

/// One axis that can be moved and looked at.
#[derive(Debug, Clone)]
pub struct Carriage<'a> {
    machine: &'a TruthMachine,
    k: usize,
    /// The workpiece side moves and the instrument looks at it from the bed.
    inverted: bool,
}

/// The moved body at one position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Where home points of the body went, with all errors.
    pub actual: Matrix4<f64>,
    /// The same without errors.
    pub nominal: Matrix4<f64>,
}

impl<'a> Carriage<'a> {
    /// Optics on `axis` of a machine.
    /// # Errors
    /// [`InstrumentError::NoLinearAxis`].
    pub fn new(machine: &'a TruthMachine, axis: AxisName, mount: Mount) -> Result<Self, InstrumentError> {
        let no_axis = InstrumentError::NoLinearAxis { axis };
        let k = machine
            .index_of(axis)
            .filter(|_| axis.kind() == AxisKind::Linear)
            .ok_or_else(|| no_axis.clone())?;
        let side = machine.drawing(k).ok_or(no_axis)?.side;
        Ok(Self { machine, k, inverted: mount == Mount::Carriage && side == Side::Workpiece })
    }

    /// Travel of the axis.
    #[must_use]
    pub fn travel(&self) -> [f64; 2] {
        self.machine.travel(self.k)
    }

    /// +1 where the body that is looked at moves by plus the programmed coordinate, -1 by minus.
    #[must_use]
    pub const fn sense(&self) -> f64 {
        if self.inverted { -1.0 } else { 1.0 }
    }

    /// The body with the axis at `q`, arrived in `direction`, the others at home.
    #[must_use]
    pub fn at(&self, q: f64, direction: i8) -> Seen {
        let mut position = AxisArray::default();
        position[self.k] = q;
        self.at_position(&position, direction)
    }

    /// The body with the axes at `position`, this one arrived in `direction`.
    #[must_use]
    pub fn at_position(&self, position: &AxisArray, direction: i8) -> Seen {
        // tool side seen from the workpiece side: home points to where they went
        let [actual, nominal] = self
            .machine
            .joint_poses(self.k, position, direction)
            .map(|moved| if self.inverted { inverse(&moved) } else { moved });
        Seen { actual, nominal }
    }
}

impl Seen {
    /// Displacement of the point of the body that stands at `point_mm` at home, actual minus nominal, mm.
    #[must_use]
    pub fn displacement(&self, point_mm: [f64; 3]) -> [f64; 3] {
        let p = Point3::from(point_mm);
        (self.actual.transform_point(&p) - self.nominal.transform_point(&p)).into()
    }

    /// Rotation vector of the body, rad.
    #[must_use]
    pub fn rotation(&self) -> Vector3<f64> {
        let turn = rotation_part(&self.actual) * rotation_part(&self.nominal).transpose();
        rotation_vector(&turn).into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truth::VMC_850;

    #[test]
    fn a_table_seen_from_the_bed_does_the_opposite() {
        let machine = TruthMachine::from_toml(VMC_850).unwrap().with_ideal_drives();
        let see = |mount| Carriage::new(&machine, AxisName::X, mount).unwrap().at(600.0, 0);
        let (relative, carriage) = (see(Mount::Relative), see(Mount::Carriage));
        assert!((relative.rotation() + carriage.rotation()).norm() < 1e-9);
        // the same material point: 600 mm apart at home and under the tool
        let (a, b) = (relative.displacement([0.0, 0.0, -100.0]), carriage.displacement([600.0, 0.0, -100.0]));
        assert!((0..3).all(|i| (a[i] + b[i]).abs() < 5e-6), "{a:?} {b:?}");
        assert!((carriage.nominal[(0, 3)] + 600.0).abs() < 1e-12);
        assert!(Carriage::new(&machine, AxisName::C, Mount::Relative).is_err());
    }
}
