//! Exact forward kinematics of any serial chain with erroneous joints.
//!
//! `T_wt = Trans(-w0) PROD J_k Trans(t0)`, one 4x4 matrix per joint in the order of the string:
//! - linear axis: tool side `Trans(q d) e`, workpiece side `e Trans(q d)`, d the direction with squareness;
//! - rotary axis about the point P: tool side `L e Rot(q)`, workpiece side `Rot(q) e L^-1`, all about P;
//! - `e`: rotation `Rz Ry Rx` and the shift that makes component i of the displacement of r_i equal to E_i.
//!
//! Source: equations 1.4 to 1.9 and 2. Every factor is built as a matrix and multiplied; nothing is simplified by
//! hand, so that a sign error elsewhere cannot hide here.

use nalgebra::{Matrix4, Vector3};
use volcomp_units::axes::{AxisKind, AxisName};

use super::chain::Side;
use super::transform::{
    about_point, inverse, rotation_about, rotation_part, rotation_vector, rotation_zyx, translation,
    translation_part,
};

/// Whose motion the error motions of an axis describe.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sense {
    /// The tool-side body relative to the workpiece-side body.
    #[default]
    Relative,
    /// The carriage or rotor in the machine frame; differs on the workpiece side only.
    Carriage,
}

/// The geometry of one joint; all points in the machine frame at home.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Its letter.
    pub axis: AxisName,
    /// Its side of the bed.
    pub side: Side,
    /// A point on a rotary axis; of no effect on a linear one.
    pub point_mm: [f64; 3],
    /// The points at which the x, y and z components of the error motion are given.
    pub reference_mm: [[f64; 3]; 3],
    /// Whose motion the error values describe.
    pub sense: Sense,
    /// Location errors of a rotary axis: XO YO ZO in mm, AO BO CO in rad.
    pub location: [f64; 6],
}

/// Angles between the lines of motion, rad.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Squareness {
    /// Turns the line of Y about z.
    pub c0y_rad: f64,
    /// Turns the line of Z about y.
    pub b0z_rad: f64,
    /// Turns the line of Z about x.
    pub a0z_rad: f64,
}

/// One joint at one moment.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointState {
    /// Programmed coordinate, mm or rad.
    pub q: f64,
    /// Error motion at this pose: EX EY EZ in mm, EA EB EC in rad.
    pub motion: [f64; 6],
}

/// The joints of a machine between its workpiece and its tool.
#[derive(Debug, Clone, PartialEq)]
pub struct Kinematics {
    /// The joints in the order of the chain.
    pub joints: Vec<Joint>,
    /// Angles between the lines of motion.
    pub squareness: Squareness,
    /// Origin of the workpiece frame, in the machine frame at home.
    pub workpiece_origin_mm: [f64; 3],
    /// Tool tip, in the machine frame at home.
    pub tool_tip_mm: [f64; 3],
}

/// Where the tool is relative to the workpiece.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Tool tip in the workpiece frame.
    pub tip_mm: [f64; 3],
    /// Unit vector along the tool, from the tip to the spindle, in the workpiece frame.
    pub direction: [f64; 3],
    /// Tool-tip frame to workpiece frame, mm.
    pub matrix: Matrix4<f64>,
}

/// Actual minus nominal pose, in the workpiece frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Deviation {
    /// Of the tool tip.
    pub tip_mm: [f64; 3],
    /// Rotation vector of R_actual R_nominal^T.
    pub rotation_rad: [f64; 3],
}

impl Joint {
    /// A joint without offsets: point and reference points at the machine origin, relative sense.
    #[must_use]
    pub const fn plain(axis: AxisName, side: Side) -> Self {
        Self {
            axis,
            side,
            point_mm: [0.0; 3],
            reference_mm: [[0.0; 3]; 3],
            sense: Sense::Relative,
            location: [0.0; 6],
        }
    }

    /// Tool-side body to workpiece-side body: the factor of this joint.
    pub(super) fn transform(&self, state: &JointState, squareness: Squareness) -> Matrix4<f64> {
        let error = self.error(&state.motion);
        match self.axis.kind() {
            AxisKind::Linear => {
                let along = translation((line_of_motion(self.axis, squareness) * state.q).into());
                match self.side {
                    Side::Tool => along * error,
                    Side::Workpiece => error * along,
                }
            }
            AxisKind::Rotary => {
                let [x, y, z, a, b, c] = self.location;
                let place = about_point(self.point_mm, &(translation([x, y, z]) * rotation_zyx([a, b, c])));
                let turn = about_point(self.point_mm, &rotation_about(self.axis.direction(), state.q));
                match self.side {
                    Side::Tool => place * error * turn,
                    Side::Workpiece => turn * error * inverse(&place),
                }
            }
        }
    }

    /// The error motion as the tool-side body's motion relative to the workpiece-side body.
    fn error(&self, motion: &[f64; 6]) -> Matrix4<f64> {
        let rotation = rotation_zyx([motion[3], motion[4], motion[5]]);
        let turn_only = rotation_part(&rotation) - nalgebra::Matrix3::identity();
        let shift = std::array::from_fn(|i| motion[i] - (turn_only * Vector3::from(self.reference_mm[i]))[i]);
        let body = translation(shift) * rotation;
        match (self.sense, self.side) {
            (Sense::Carriage, Side::Workpiece) => inverse(&body),
            _ => body,
        }
    }
}

impl Kinematics {
    /// The pose at the given joint states, one per joint and in their order.
    #[must_use]
    pub fn pose(&self, states: &[JointState]) -> Pose {
        self.pose_with_tip(states, self.tool_tip_mm)
    }

    /// The same with the tool tip elsewhere in the machine frame at home.
    #[must_use]
    pub fn pose_with_tip(&self, states: &[JointState], tip_mm: [f64; 3]) -> Pose {
        self.product(states, tip_mm, |joint, state| joint.transform(state, self.squareness))
    }

    /// The pose of the same joints without any error.
    #[must_use]
    pub fn nominal(&self, states: &[JointState]) -> Pose {
        self.product(states, self.tool_tip_mm, |joint, state| {
            let plain = Joint { point_mm: joint.point_mm, ..Joint::plain(joint.axis, joint.side) };
            plain.transform(&JointState { q: state.q, motion: [0.0; 6] }, Squareness::default())
        })
    }

    fn product(
        &self,
        states: &[JointState],
        tip_mm: [f64; 3],
        factor: impl Fn(&Joint, &JointState) -> Matrix4<f64>,
    ) -> Pose {
        debug_assert_eq!(states.len(), self.joints.len(), "one state per joint");
        let start = translation(self.workpiece_origin_mm.map(|v| -v));
        let branch = self
            .joints
            .iter()
            .zip(states)
            .fold(start, |so_far, (joint, state)| so_far * factor(joint, state));
        Pose::from(branch * translation(tip_mm))
    }
}

impl From<Matrix4<f64>> for Pose {
    fn from(matrix: Matrix4<f64>) -> Self {
        let tip_mm = translation_part(&matrix).into();
        let direction = rotation_part(&matrix).column(2).into_owned().into();
        Self { tip_mm, direction, matrix }
    }
}

impl Pose {
    /// This pose minus a nominal one.
    #[must_use]
    pub fn minus(&self, nominal: &Self) -> Deviation {
        let turn = rotation_part(&self.matrix) * rotation_part(&nominal.matrix).transpose();
        Deviation {
            tip_mm: std::array::from_fn(|i| self.tip_mm[i] - nominal.tip_mm[i]),
            rotation_rad: rotation_vector(&turn),
        }
    }
}

/// Unit vector of the line along which a linear axis really moves.
fn line_of_motion(axis: AxisName, squareness: Squareness) -> Vector3<f64> {
    let ideal = Vector3::ith(axis.direction(), 1.0);
    let turn = match axis {
        AxisName::Y => rotation_about(2, squareness.c0y_rad),
        AxisName::Z => rotation_about(1, squareness.b0z_rad) * rotation_about(0, squareness.a0z_rad),
        _ => return ideal,
    };
    rotation_part(&turn) * ideal
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one_axis(axis: AxisName, side: Side) -> Kinematics {
        Kinematics {
            joints: vec![Joint::plain(axis, side)],
            squareness: Squareness::default(),
            workpiece_origin_mm: [0.0; 3],
            tool_tip_mm: [0.0; 3],
        }
    }

    #[test]
    fn plus_moves_the_tool_plus_on_either_side() {
        for side in [Side::Workpiece, Side::Tool] {
            let pose = one_axis(AxisName::Y, side).nominal(&[JointState { q: 12.0, motion: [0.0; 6] }]);
            assert_eq!(pose.tip_mm, [0.0, 12.0, 0.0]);
        }
    }

    #[test]
    fn plus_exx_means_tool_too_far_on_either_side() {
        let state = [JointState { q: 100.0, motion: [0.01, 0.0, 0.0, 0.0, 0.0, 0.0] }];
        for side in [Side::Workpiece, Side::Tool] {
            let machine = one_axis(AxisName::X, side);
            let deviation = machine.pose(&state).minus(&machine.nominal(&state));
            assert!((deviation.tip_mm[0] - 0.01).abs() < 1e-13);
        }
    }

    #[test]
    fn a_reference_point_keeps_its_displacement() {
        let mut machine = one_axis(AxisName::X, Side::Tool);
        machine.tool_tip_mm = [30.0, -200.0, 70.0];
        machine.joints[0].reference_mm = [[30.0, -200.0, 70.0]; 3];
        let state = [JointState { q: 0.0, motion: [0.001, 0.002, 0.003, 1e-4, 2e-4, 3e-4] }];
        let deviation = machine.pose(&state).minus(&machine.nominal(&state));
        for (got, want) in deviation.tip_mm.iter().zip([0.001, 0.002, 0.003]) {
            assert!((got - want).abs() < 1e-13);
        }
    }

    #[test]
    fn squareness_opens_the_angle_for_plus_c0y() {
        let mut machine = one_axis(AxisName::Y, Side::Tool);
        machine.squareness.c0y_rad = 1e-4;
        let state = [JointState { q: 100.0, motion: [0.0; 6] }];
        assert!(machine.pose(&state).tip_mm[0] < -0.0099);
    }
}
