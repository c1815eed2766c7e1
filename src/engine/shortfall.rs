//! Notices offsets that stay away from the correction for longer than their limits explain.

use super::config::{AxisLimits, EngineConfig};
use volcomp_model::axes::{AxisArray, MAX_AXES};

/// Share of the size limit by which an offset may stay away from the correction.
const TOLERATED: f64 = 0.05;

/// Watches every axis; wire order.
#[derive(Debug, Clone)]
pub(super) struct Shortfall {
    /// mm or rad.
    tolerance: AxisArray,
    /// The longest that an offset may need, s.
    limit_s: AxisArray,
    /// How long each axis has been beyond its tolerance, s.
    beyond_s: AxisArray,
}

impl Shortfall {
    pub(super) fn new(config: &EngineConfig) -> Self {
        let mut watch = Self {
            tolerance: [f64::INFINITY; MAX_AXES],
            limit_s: [f64::INFINITY; MAX_AXES],
            beyond_s: [0.0; MAX_AXES],
        };
        for (k, limits) in config.limits.iter().enumerate().filter(|(_, limits)| limits.size > 0.0) {
            watch.tolerance[k] = config.read_back_tolerance[k].max(TOLERATED * limits.size);
            watch.limit_s[k] = config.ramp_s + crossing_s(limits, config.cycle_s);
        }
        watch
    }

    /// Bit k: axis k has been away for too long. `following`: the offset is on the correction or on its way there.
    ///
    /// # Cycle   no allocation, no panic
    pub(super) fn look(&mut self, wanted: &AxisArray, offset: &AxisArray, following: bool, dt: f64) -> u8 {
        let mut bits = 0;
        for (k, beyond_s) in self.beyond_s.iter_mut().enumerate() {
            let beyond = following && (wanted[k] - offset[k]).abs() > self.tolerance[k];
            *beyond_s = if beyond { *beyond_s + dt } else { 0.0 };
            bits |= u8::from(*beyond_s > self.limit_s[k]) << k;
        }
        bits
    }
}

/// Time from one size limit to the other with the limits of rate, acceleration and step, s.
fn crossing_s(limits: &AxisLimits, cycle_s: f64) -> f64 {
    let rate = limits.fastest(cycle_s);
    2.0 * limits.size / rate + 2.0 * rate / limits.acceleration
}
