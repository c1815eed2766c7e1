//! The axis corrections that oppose a deviation.
//!
//! Rotary axes first turn the tool back to its direction (rotation about the tool axis itself is irrelevant),
//! then the linear axes bring the tip back. What the chain cannot control is reported, not hidden.
//!
//! Source: equations 2.2 (five-axis correction with its singularity guard) and 2.4.

use super::kinematics::{Deviation, Nominal};
use crate::prelude::*;

/// Largest correction of a rotary axis, rad, where the axis states none. Where more would be needed (close to a pole) the
/// correction of that axis falls, continuously, to zero at three times the limit, and the axis is left alone beyond.
pub const ROTARY_CORRECTION_LIMIT: f64 = 1e-3;

/// Determinant of the products of the directions of the linear axes below which two of them count as nearly parallel: 10 deg apart,
/// where a rotary axis stands between them. Their corrections are then damped, so that none is larger than some twelve times the
/// deviation, and a third axis loses up to 0.25 %; what they leave is residual.
const NEARLY_PARALLEL: f64 = 0.03;
/// Damping where they are parallel.
const PARALLEL_DAMPING: f64 = 0.0025;
/// Cosine from which an axis shares the direction of another.
const SHARED: f64 = 0.4;

/// Corrections to add to the programmed coordinates, one per axis in chain order.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisCorrection {
    /// mm or rad, opposing the deviation.
    pub offset: AxisArray,
    /// Position error that stays, to first order, mm, in W.
    pub residual: Vec3,
    /// Tilt of the tool direction that stays, to first order, rad, in W.
    pub residual_tilt: Vec3,
    /// Bit k: axis k was corrected by less than it needs, or left alone, because the pose is close to a pole; a linear axis, because
    /// another one moves in nearly the same direction.
    pub singular: u16,
}

/// One axis that can be used: its index and what a unit of it does.
#[derive(Clone, Copy)]
struct Lever {
    index: usize,
    effect: Vec3,
    /// Largest correction, rad.
    limit: f64,
}

impl Model {
    /// Deviation at `pose` and the corrections that oppose it, first order.
    ///
    /// # Cycle   no allocation
    #[must_use]
    pub fn correct(&self, pose: &Pose) -> (Deviation, AxisCorrection) {
        if !self.rotary {
            let deviation = self.deviation_without_rotation(pose);
            return (deviation, self.oppose_without_rotation(pose, &deviation));
        }
        let nominal = self.nominal(pose);
        let deviation = self.deviation_at(&nominal, pose);
        (deviation, self.oppose(&nominal, pose, &deviation))
    }

    /// Where no axis turns, X Y Z act along x y z: the correction is the deviation with its sign changed.
    fn oppose_without_rotation(&self, pose: &Pose, deviation: &Deviation) -> AxisCorrection {
        let mut out = AxisCorrection {
            offset: [0.0; MAX_AXES],
            residual: deviation.position,
            residual_tilt: deviation.rotation.cross(&unit(2)),
            singular: 0,
        };
        for (k, joint) in self.joints.iter().enumerate() {
            if joint.moves_tip() && !pose.is_fixed(k) {
                let direction = joint.axis.name.direction();
                out.offset[k] = -deviation.position[direction];
                out.residual[direction] = 0.0;
            }
        }
        out
    }

    /// The same with the deviation of full rotations; the corrections oppose it to first order. Not for the cycle.
    #[must_use]
    pub fn correct_exact(&self, pose: &Pose) -> (Deviation, AxisCorrection) {
        let deviation = self.deviation_exact(pose);
        (deviation, self.oppose(&self.nominal(pose), pose, &deviation))
    }

    /// The corrections that oppose a deviation at `pose` that was found elsewhere, first order. Not for the cycle.
    #[must_use]
    pub fn opposing(&self, pose: &Pose, deviation: &Deviation) -> AxisCorrection {
        if self.rotary {
            self.oppose(&self.nominal(pose), pose, deviation)
        } else {
            self.oppose_without_rotation(pose, deviation)
        }
    }

    fn oppose(&self, nominal: &Nominal, pose: &Pose, deviation: &Deviation) -> AxisCorrection {
        let mut out = AxisCorrection {
            offset: [0.0; MAX_AXES],
            residual: deviation.position,
            residual_tilt: Vec3::zeros(),
            singular: 0,
        };
        self.turn_back(nominal, pose, deviation, &mut out);
        self.bring_back(nominal, pose, &mut out);
        out
    }

    /// Rotary axes: `[w_k x a] d = -theta x a` by least squares, with the singularity guard.
    fn turn_back(&self, nominal: &Nominal, pose: &Pose, deviation: &Deviation, out: &mut AxisCorrection) {
        let tool = nominal.left[self.joints.len()] * unit(2);
        out.residual_tilt = deviation.rotation.cross(&tool);
        let mut levers = [Lever { index: 0, effect: Vec3::zeros(), limit: 0.0 }; 2];
        let mut used = 0;
        for (k, joint) in self.joints.iter().enumerate() {
            let turns = joint.axis.kind() == AxisKind::Rotary && !joint.axis.spindle;
            if turns && !pose.is_fixed(k) && used < 2 {
                let about = nominal.left[k] * unit(joint.axis.name.direction());
                levers[used] = Lever { index: k, effect: about.cross(&tool), limit: joint.correction_limit };
                used += 1;
            }
        }
        let target = -out.residual_tilt;
        let mut angles = match used {
            0 => return,
            1 => [along(&levers[0], &target), 0.0],
            _ => both(&levers, &target),
        };
        // the axis with the smaller effect is the one that runs away at a pole
        let weak = if used == 1 || levers[0].effect.norm_squared() < levers[1].effect.norm_squared() {
            0
        } else {
            1
        };
        // not finite counts as too large
        if !angles.iter().zip(&levers).all(|(a, lever)| a.abs() <= lever.limit) {
            out.singular |= 1 << levers[weak].index;
            let strong = 1 - weak;
            let reduced = reduced(angles[weak], levers[weak].limit);
            angles = [0.0; 2];
            if used == 2 {
                let angle = along(&levers[strong], &(target - levers[weak].effect * reduced));
                if angle.abs() <= levers[strong].limit {
                    angles[strong] = angle;
                    angles[weak] = reduced;
                } else {
                    out.singular |= 1 << levers[strong].index;
                }
            }
        }
        for (lever, angle) in levers.iter().zip(angles).take(used) {
            out.offset[lever.index] = angle;
            out.residual_tilt += lever.effect * angle;
            let joint = &self.joints[lever.index];
            let swing = unit(joint.axis.name.direction()).cross(&(nominal.tip[lever.index] - joint.point));
            out.residual += nominal.left[lever.index] * swing * angle;
        }
    }

    /// Linear axes X Y Z: least squares on the directions that the chain has.
    fn bring_back(&self, nominal: &Nominal, pose: &Pose, out: &mut AxisCorrection) {
        let mut effects = Mat3::zeros();
        let mut indices = [None; 3];
        for (k, joint) in self.joints.iter().enumerate() {
            let slot = joint.axis.name.direction();
            if joint.moves_tip() && !pose.is_fixed(k) {
                effects.set_column(slot, &(nominal.left[k] * unit(slot)));
                indices[slot] = Some(k);
            }
        }
        let mut normal = effects.transpose() * effects;
        for slot in 0..3 {
            if indices[slot].is_none() {
                normal[(slot, slot)] = 1.0;
            }
        }
        // 0 where two axes are 10 deg and more apart, 1 where they are parallel
        let missing = (1.0 - normal.determinant() / NEARLY_PARALLEL).max(0.0);
        if missing > 0.0 {
            for (slot, index) in indices.iter().enumerate() {
                let is_near = (0..3).any(|other| other != slot && normal[(slot, other)].abs() > SHARED);
                out.singular |= index.filter(|_| is_near).map_or(0, |k| 1 << k);
            }
            normal += Mat3::identity() * (PARALLEL_DAMPING * missing * missing);
        }
        let Some(inverse) = normal.try_inverse() else { return };
        let solution = inverse * (effects.transpose() * -out.residual);
        for (slot, index) in indices.iter().enumerate() {
            if let Some(k) = *index {
                out.offset[k] = solution[slot];
            }
        }
        out.residual += effects * solution;
    }
}

/// What is left of a correction beyond the limit: the limit there, zero from three times the limit on and where it is no
/// number.
fn reduced(angle: f64, limit: f64) -> f64 {
    let size = angle.abs();
    if size > limit && size < 3.0 * limit { 0.5 * (3.0 * limit - size) * angle.signum() } else { 0.0 }
}

/// Least squares with one axis; zero where it has no effect.
fn along(lever: &Lever, target: &Vec3) -> f64 {
    let size = lever.effect.norm_squared();
    if size > 1e-24 { lever.effect.dot(target) / size } else { 0.0 }
}

/// Least squares with two axes; not finite where they do the same or nothing.
fn both(levers: &[Lever; 2], target: &Vec3) -> [f64; 2] {
    let [a, b] = [levers[0].effect, levers[1].effect];
    let (aa, ab, bb) = (a.norm_squared(), a.dot(&b), b.norm_squared());
    let (at, bt) = (a.dot(target), b.dot(target));
    let determinant = aa * bb - ab * ab;
    [(at * bb - bt * ab) / determinant, (bt * aa - at * ab) / determinant]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AxisSpec, Chain, Curve, ErrorFunction, ErrorSymbol, ModelSpec};

    #[test]
    fn towards_a_pole_the_correction_is_continuous_and_bounded() {
        let mut spec = ModelSpec::new("head", Chain::parse("[w b X Y Z C A (S) t]").unwrap());
        spec.tool_tip = Vec3::new(0.0, 0.0, -500.0);
        for (name, z) in [(AxisName::C, -100.0), (AxisName::A, -180.0)] {
            spec.axes.push(AxisSpec { point: Vec3::new(0.0, 0.0, z), ..AxisSpec::new(name) });
        }
        for (symbol, value) in [("ea0c", 6e-5), ("eb0a", 9e-5)] {
            let function = ErrorFunction::single(Curve::Constant(value));
            spec.errors.push((ErrorSymbol::parse(symbol).unwrap(), function));
        }
        let model = Model::new(&spec).unwrap();
        let (mut last, mut largest, mut reached): (Option<AxisArray>, f64, [bool; 2]) =
            (None, 0.0, [false; 2]);
        for k in 0..=20_000 {
            let tilt = (10.0 - 5e-4 * f64::from(k)).to_radians();
            let mut position = [0.0; MAX_AXES];
            (position[3], position[4]) = (0.4, tilt);
            let (_, correction) = model.correct(&Pose::at(position));
            let offset = correction.offset;
            reached[0] |= correction.singular == 0;
            reached[1] |= correction.singular != 0 && offset[3] == 0.0;
            if let Some(last) = last {
                for (k, (now, before)) in offset.iter().zip(last).enumerate() {
                    let step = if k < 3 { 1e-4 } else { 1e-5 };
                    assert!((now - before).abs() < step, "axis {k} steps by {} at {tilt} rad", now - before);
                }
            }
            largest = largest.max(offset[3].abs());
            assert!(correction.residual.norm() < 1e-12, "the tip is corrected everywhere");
            last = Some(offset);
        }
        assert_eq!(reached, [true; 2]);
        assert!(largest > 0.9 * ROTARY_CORRECTION_LIMIT && largest <= ROTARY_CORRECTION_LIMIT, "{largest}");
    }

    #[test]
    fn what_a_fixed_axis_does_not_correct_the_others_bring_back() {
        let mut spec = ModelSpec::new("head", Chain::parse("[w b X Y Z C A (S) t]").unwrap());
        spec.tool_tip = Vec3::new(0.0, 0.0, -500.0);
        for (symbol, value) in [("ea0c", 6e-5), ("eb0a", 9e-5), ("eyx", 0.02)] {
            let function = ErrorFunction::single(Curve::Constant(value));
            spec.errors.push((ErrorSymbol::parse(symbol).unwrap(), function));
        }
        let model = Model::new(&spec).unwrap();
        let free = Pose::at([100.0, 50.0, -20.0, 0.4, 0.6, 0.0, 0.0, 0.0]);
        // rotary axes that are never offset leave the tilt, the tip is where it should be
        let fixed = Pose { fixed: 0b1_1000, ..free };
        let (_, turned) = model.correct(&free);
        let (deviation, correction) = model.correct(&fixed);
        assert!(turned.offset[3].abs() > 1e-5 && turned.residual.norm() < 1e-12);
        assert_eq!(correction.offset[3..5], [0.0, 0.0]);
        assert!(correction.residual.norm() < 1e-12 && correction.residual_tilt.norm() > 1e-5);
        assert!((0..3).all(|k| (correction.offset[k] + deviation.position[k]).abs() < 1e-12));
        // a linear one leaves what it alone moves
        for spec in [spec, no_rotary()] {
            let model = Model::new(&spec).unwrap();
            let (deviation, correction) = model.correct(&Pose { fixed: 0b1_1010, ..free });
            assert_eq!(correction.offset[1], 0.0);
            assert!(
                (correction.residual.y - deviation.position.y).abs() < 1e-12 && deviation.position.y != 0.0
            );
            assert!(correction.residual.x.abs() < 1e-12 && correction.residual.z.abs() < 1e-12);
        }
    }

    fn no_rotary() -> ModelSpec {
        let mut spec = ModelSpec::new("mill", Chain::parse("[w b X Y Z t]").unwrap());
        spec.errors.push((ErrorSymbol::parse("eyx").unwrap(), ErrorFunction::single(Curve::Constant(0.02))));
        spec
    }

    #[test]
    fn linear_axes_that_become_parallel_are_corrected_by_little() {
        let mut spec = ModelSpec::new("turned", Chain::parse("[w X' C' b Y Z t]").unwrap());
        spec.axes.push(AxisSpec::new(AxisName::C));
        for symbol in ["exx", "eyx", "exy", "ezz"] {
            spec.errors
                .push((ErrorSymbol::parse(symbol).unwrap(), ErrorFunction::single(Curve::Constant(5e-3))));
        }
        let model = Model::new(&spec).unwrap();
        let mut last: Option<AxisArray> = None;
        for k in 0..=20_000 {
            let angle = (70.0 + 2e-3 * f64::from(k)).to_radians();
            let mut position = [0.0; MAX_AXES];
            position[1] = angle;
            let (deviation, correction) = model.correct(&Pose::at(position));
            let largest = correction.offset.iter().fold(0.0f64, |a, v| a.max(v.abs()));
            assert!(largest < 13.0 * deviation.position.norm(), "{largest} mm at {angle} rad");
            if let Some(last) = last {
                let steps = correction.offset.iter().zip(last).map(|(a, b)| (a - b).abs());
                assert!(steps.fold(0.0, f64::max) < 2e-4, "a step at {angle} rad");
            }
            // 10 deg from parallel
            let is_near = (angle.to_degrees() - 90.0).abs() < 9.9;
            assert_eq!(
                correction.singular,
                if is_near { 0b101 } else { correction.singular & 0b101 },
                "{angle}"
            );
            let is_far = (angle.to_degrees() - 90.0).abs() > 10.1;
            assert!(!is_far || (correction.singular == 0 && correction.residual.norm() < 1e-12));
            last = Some(correction.offset);
        }
    }
}
