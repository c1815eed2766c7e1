//! Where the machine stands: from frames of the cycle to moments of the estimator.

use volcomp_estimate::SensorClock;
use volcomp_estimate::live::MotionSample;
use volcomp_model::geometry::Vec3;
use volcomp_units::axes::{AxisArray, AxisKind, AxisName, MAX_AXES};
use volcomp_units::{MonoTime, rad_from_deg};

/// Where the machine stands, from frames in wire order to moments in chain order.
#[derive(Debug, Default)]
pub(super) struct Follower {
    /// Wire index and kind of each axis of the model.
    axes: Vec<Option<(usize, AxisKind)>>,
    wire: [Option<AxisName>; MAX_AXES],
    pub(super) tip: Option<Vec3>,
    clock: Option<SensorClock>,
}

impl Follower {
    /// Of frames with these axes.
    pub(super) fn new(wire: [Option<AxisName>; MAX_AXES]) -> Self {
        Self { wire, ..Self::default() }
    }

    pub(super) fn fit(&mut self, names: &[AxisName]) {
        let find = |name: &AxisName| {
            let k = self.wire.iter().position(|wire| *wire == Some(*name))?;
            Some((k, name.kind()))
        };
        self.axes = names.iter().map(find).collect();
    }

    fn chain(&self, wire: &AxisArray) -> AxisArray {
        let mut out = [0.0; MAX_AXES];
        for (slot, axis) in out.iter_mut().zip(&self.axes) {
            *slot = match axis {
                Some((k, AxisKind::Linear)) => wire[*k],
                Some((k, AxisKind::Rotary)) => rad_from_deg(wire[*k]),
                None => 0.0,
            };
        }
        out
    }

    pub(super) fn sample(
        &mut self,
        now: MonoTime,
        control_ns: i64,
        commanded: &AxisArray,
        actual: &AxisArray,
    ) -> Option<MotionSample> {
        if !commanded.iter().chain(actual).all(|v| v.is_finite()) {
            return None;
        }
        let clock = self.clock.get_or_insert_with(|| SensorClock::new(0.0));
        let at = clock.stamp(now, control_ns).at;
        Some(MotionSample {
            at,
            commanded: self.chain(commanded),
            actual: self.chain(actual),
            tool_tip: self.tip,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_become_moments_in_chain_order() {
        let mut wire = [None; MAX_AXES];
        wire[..3].copy_from_slice(&[Some(AxisName::C), Some(AxisName::Y), Some(AxisName::X)]);
        let mut follower = Follower::new(wire);
        follower.fit(&[AxisName::X, AxisName::Y, AxisName::Z, AxisName::C, AxisName::S]);
        let mut frame = [0.0; MAX_AXES];
        frame[..3].copy_from_slice(&[180.0, 20.0, 10.0]);
        let sample = follower.sample(MonoTime::ZERO, 5, &frame, &frame).unwrap();
        assert_eq!(&sample.commanded[..3], &[10.0, 20.0, 0.0]);
        assert!((sample.commanded[3] - core::f64::consts::PI).abs() < 1e-12);
        frame[1] = f64::NAN;
        assert!(follower.sample(MonoTime::ZERO, 5, &frame, &frame).is_none());
    }
}
