//! Where a rotary axis stands among the others, and where what it carries is.

use serde::{Deserialize, Serialize};

use crate::machine_state::{Axis, MachineState};
use volcomp_model::geometry::{Mat3, Vec3, rotation_about, unit};
use volcomp_units::{RAD_PER_ARCSEC, UM_PER_MM};

/// Where a rotary axis stands in the machine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct RotaryFrame {
    /// The axis.
    pub axis: Axis,
    /// It carries the workpiece.
    pub workpiece_side: bool,
    /// A point on it, mm.
    pub point_mm: [f64; 3],
    /// Rotary axes between the bed and it, from the bed outwards.
    pub outer: Vec<Axis>,
    /// A point on each of these, mm; the origin where nothing is said.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub outer_points_mm: Vec<[f64; 3]>,
    /// Rotary axes beyond it, from it outwards.
    pub inner: Vec<Axis>,
    /// A point on each of these, mm; the origin where nothing is said.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub inner_points_mm: Vec<[f64; 3]>,
    /// Tool tip at home from the origin, mm: the point where no target is given.
    pub tip_mm: [f64; 3],
    /// Spindle nose at home, mm, from which stated tool lengths are counted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nose_mm: Option<[f64; 3]>,
}

impl RotaryFrame {
    /// Physical rotation by an axis: a table turns the other way than its coordinate counts.
    fn turn(&self, axis: Axis, m: &MachineState) -> Mat3 {
        let q = m.position[axis.slot()];
        rotation_about(axis.direction(), if self.workpiece_side { -q } else { q })
    }

    pub(super) fn product(&self, axes: &[Axis], m: &MachineState) -> Mat3 {
        axes.iter().fold(Mat3::identity(), |r, a| r * self.turn(*a, m))
    }

    /// A point at home, carried to where the axes beyond this one take it.
    fn carried(&self, home: Vec3, m: &MachineState) -> Vec3 {
        self.inner.iter().enumerate().rev().fold(home, |x, (i, a)| {
            let p = point(&self.inner_points_mm, i);
            p + self.turn(*a, m) * (x - p)
        })
    }

    /// A point in machine axes, taken back to where it was before the axes between the bed and this one turned.
    fn before_outer(&self, now: Vec3, m: &MachineState) -> Vec3 {
        self.before((&self.outer, &self.outer_points_mm), now, m)
    }

    fn before(&self, (axes, points): (&[Axis], &[[f64; 3]]), now: Vec3, m: &MachineState) -> Vec3 {
        axes.iter().enumerate().fold(now, |x, (i, a)| {
            let p = point(points, i);
            p + self.turn(*a, m).transpose() * (x - p)
        })
    }

    /// Rotation of what the axis carries by the axes beyond it, and where the point `p` of [`Self::state`] was before, from the axis.
    pub(super) fn carried_by(&self, p: Vec3, m: &MachineState) -> (Mat3, Vec3) {
        let (turn, point) = (self.product(&self.inner, m), Vec3::from(self.point_mm));
        if m.is_angular() {
            return (turn, turn.transpose() * p);
        }
        (turn, self.before((&self.inner, &self.inner_points_mm), p + point, m) - point)
    }

    /// Rotation of what lies between bed and axis, own rotation, and the point before own rotation, from the axis.
    pub(super) fn state(&self, m: &MachineState) -> (Mat3, Mat3, Vec3) {
        let (outer, own) = (self.product(&self.outer, m), self.turn(self.axis, m));
        if m.is_angular() {
            return (outer, own, own.transpose() * (outer.transpose() * m.lever_mm));
        }
        let point = Vec3::from(self.point_mm);
        let home = if self.workpiece_side && m.target_mm.iter().all(|v| v.is_finite()) {
            self.carried(m.target_mm, m) - point
        } else if self.workpiece_side {
            let tip = m.head.carries(Vec3::from(self.tip_mm)) + m.carriage_mm();
            own.transpose() * (self.before_outer(tip, m) - point)
        } else {
            let mut tip = Vec3::from(self.nose_mm.unwrap_or(self.tip_mm));
            if m.tool_length_mm.is_finite() {
                tip.z -= m.tool_length_mm;
            }
            self.carried(tip, m) - point
        };
        (outer, own, home)
    }

    /// Displacement of the tool by a turn about the axis itself, um per rad.
    pub(crate) fn um_per_rad(&self, m: &MachineState) -> Vec3 {
        let (outer, own, p) = self.state(m);
        // a table turns against its coordinate, so the sign cancels in the angle of tool against workpiece
        outer * unit(self.axis.direction()).cross(&(own * p)) * UM_PER_MM
    }

    /// Displacements by turns about the axis itself, um for each turn in arcsec.
    pub(crate) fn turn_by(
        &self,
        m: &MachineState,
        turns_arcsec: impl Iterator<Item = f64>,
        out: &mut [Vec3],
    ) {
        let arm = self.um_per_rad(m) * RAD_PER_ARCSEC;
        out.iter_mut().zip(turns_arcsec).for_each(|(o, v)| *o = arm * v);
    }

    /// Motion of tool against workpiece for a motion of what the axis carries.
    pub(super) fn sign(&self) -> f64 {
        if self.workpiece_side { -1.0 } else { 1.0 }
    }
}

fn point(points: &[[f64; 3]], i: usize) -> Vec3 {
    points.get(i).map_or_else(Vec3::zeros, |p| Vec3::from(*p))
}

#[cfg(test)]
mod tests {
    use core::f64::consts::FRAC_PI_2;

    use super::*;

    /// A table on a swivel, neither through the origin.
    fn swivel(axis: Axis) -> RotaryFrame {
        let (swivel, table) = ([0.0, 25.0, 60.0], [30.0, 40.0, 0.0]);
        let of_table = axis == Axis::C;
        RotaryFrame {
            axis,
            workpiece_side: true,
            point_mm: if of_table { table } else { swivel },
            outer: if of_table { vec![Axis::A] } else { vec![] },
            outer_points_mm: if of_table { vec![swivel] } else { vec![] },
            inner: if of_table { vec![] } else { vec![Axis::C] },
            inner_points_mm: if of_table { vec![] } else { vec![table] },
            tip_mm: [0.0, 0.0, -10.0],
            nose_mm: None,
        }
    }

    #[test]
    fn what_a_table_on_a_swivel_carries_turns_about_its_own_point() {
        let mut m = MachineState { target_mm: Vec3::new(100.0, 40.0, 20.0), ..MachineState::default() };
        m.position = [0.0, 0.0, 0.0, 0.4, 0.0, FRAC_PI_2];
        let (_, _, from_swivel) = swivel(Axis::A).state(&m);
        // a table turns against its coordinate: 70 mm along x become -70 mm along y
        assert!((from_swivel - Vec3::new(30.0, -30.0 - 25.0, 20.0 - 60.0)).norm() < 1e-9, "{from_swivel}");
        let (_, _, from_table) = swivel(Axis::C).state(&m);
        assert!((from_table - Vec3::new(70.0, 0.0, 20.0)).norm() < 1e-9, "{from_table}");
    }

    #[test]
    fn the_place_under_the_tool_is_the_target_that_stands_there() {
        let home = Vec3::new(80.0, -35.0, 47.0);
        let mut m = MachineState { target_mm: home, ..MachineState::default() };
        m.position = [0.0, 0.0, 0.0, -0.7, 0.0, 1.1];
        let (outer, own, p) = swivel(Axis::C).state(&m);
        let a = Vec3::new(0.0, 25.0, 60.0);
        let now = a + outer * (own * p + Vec3::new(30.0, 40.0, 0.0) - a);
        let tip = now - Vec3::new(0.0, 0.0, -10.0);
        m.position[..3].copy_from_slice(tip.as_slice());
        m.target_mm = Vec3::repeat(f64::NAN);
        for axis in [Axis::A, Axis::C] {
            let (_, _, seen) = swivel(axis).state(&m);
            let (_, _, known) = swivel(axis).state(&MachineState { target_mm: home, ..m.clone() });
            assert!((seen - known).norm() < 1e-9, "{axis}: {seen}, not {known}");
        }
    }
}
