//! The same deviation with full rotations, for verification and `--exact`; not used on the cycle.
//!
//! `T_wt = Trans(-w0) PROD_k Trans(P_k) J_k Trans(-P_k) Trans(t0)`; linear tool side `J = Trans(q d) e`,
//! workpiece side `J = e Trans(q d)`; rotary tool side `J = L e Rot(q)`, workpiece side `J = Rot(q) e L^-1`.
//!
//! Source: equations 2; `e` of 1.5, `d` of 1.7, `L` of 1.9.

use super::kinematics::{Deviation, Joint, MotionValues, PointFlags};
use crate::geometry::{Rigid, rotation_vector, small_rotation};
use crate::prelude::*;

impl Model {
    /// Deviation of the tool at `pose` with exact rotations.
    #[must_use]
    pub fn deviation_exact(&self, pose: &Pose) -> Deviation {
        let tip = pose.tool_tip.unwrap_or_else(|| self.tool_tip());
        let mut flags = PointFlags::default();
        let mut actual = Rigid::shift(-self.workpiece_origin());
        let mut nominal = actual;
        for (k, joint) in self.joints.iter().enumerate() {
            let q = pose.position[k];
            let values = joint.motions_at(k, pose, &mut flags);
            actual = actual.then_inner(&joint.transform(q, Some(&values)));
            nominal = nominal.then_inner(&joint.transform(q, None));
        }
        let end = nominal.apply(&tip);
        let (shift, turn) = self.tool_error(pose).unwrap_or_default();
        let tip = tip + shift;
        Deviation {
            position: actual.apply(&tip) - end - self.datum_exact(),
            rotation: rotation_vector(
                &(actual.rotation * small_rotation(&turn) * nominal.rotation.transpose()),
            ),
            flags,
        }
    }
}

impl Joint {
    /// The joint's transform in home-frame coordinates; without `values` the nominal one.
    fn transform(&self, q: f64, values: Option<&MotionValues>) -> Rigid {
        let nominal_direction = unit(self.axis.name.direction());
        let Some(values) = values else {
            return match self.axis.kind() {
                AxisKind::Linear => Rigid::shift(nominal_direction * q),
                AxisKind::Rotary => {
                    Rigid::turn_about(rotation_about(self.axis.name.direction(), q), self.point)
                }
            };
        };
        let mut error = values.rigid(&self.reference_points_at(q));
        if self.inverted {
            error = error.inverse();
        }
        match self.axis.kind() {
            AxisKind::Linear => {
                let motion = Rigid::shift(small_rotation(&self.squareness) * nominal_direction * q);
                match self.axis.side {
                    Side::Tool => motion.then_inner(&error),
                    Side::Workpiece => error.then_inner(&motion),
                }
            }
            AxisKind::Rotary => {
                let motion = Rigid::turn_about(rotation_about(self.axis.name.direction(), q), self.point);
                let turn = Rigid::turn_about(small_rotation(&self.location_turn), self.point);
                let location = Rigid::shift(self.location_shift).then_inner(&turn);
                match self.axis.side {
                    Side::Tool => location.then_inner(&error).then_inner(&motion),
                    Side::Workpiece => motion.then_inner(&error).then_inner(&location.inverse()),
                }
            }
        }
    }
}

impl MotionValues {
    /// `v -> R v + p` with `p_i = E_i - ((R - I) r_i)_i`.
    fn rigid(&self, reference: &[Vec3; 3]) -> Rigid {
        let rotation = small_rotation(&self.turn);
        let translation = Vec3::from_fn(|i, _| self.shift[i] - (rotation * reference[i] - reference[i])[i]);
        Rigid { rotation, translation }
    }
}
