//! Live values of sensors: held while fresh, then faded to the static model.

use crate::core::model::SENSORS_MAX;
use crate::core::units::MonoTime;

/// The live values of a model, each with the share that it has.
#[derive(Debug, Clone)]
pub(super) struct LiveInputs {
    channels: usize,
    max_age_s: f64,
    fade_s: f64,
    values: [f64; SENSORS_MAX],
    told: [Option<MonoTime>; SENSORS_MAX],
    shares: [f64; SENSORS_MAX],
    fading: bool,
}

impl LiveInputs {
    pub(super) const fn new(channels: usize, max_age_s: f64, fade_s: f64) -> Self {
        Self {
            channels: if channels < SENSORS_MAX { channels } else { SENSORS_MAX },
            max_age_s,
            fade_s,
            values: [0.0; SENSORS_MAX],
            told: [None; SENSORS_MAX],
            shares: [0.0; SENSORS_MAX],
            fading: false,
        }
    }

    /// A value of a channel of the model, mm or rad. What is not finite says nothing.
    pub(super) fn tell(&mut self, now: MonoTime, channel: usize, value: f64) {
        if channel < self.channels && value.is_finite() {
            self.values[channel] = value;
            self.told[channel] = Some(now);
        }
    }

    /// Moves the shares on by `dt` and gives the values to add.
    pub(super) fn advance(&mut self, now: MonoTime, dt: f64) -> [f64; SENSORS_MAX] {
        let change = dt / self.fade_s;
        self.fading = false;
        let mut out = [0.0; SENSORS_MAX];
        for (k, out) in out.iter_mut().enumerate().take(self.channels) {
            let fresh = self.told[k].is_some_and(|at| now.seconds_since(at) <= self.max_age_s);
            let wanted = if fresh { 1.0 } else { 0.0 };
            self.shares[k] += (wanted - self.shares[k]).clamp(-change, change);
            self.fading |= !fresh && self.shares[k] > 0.0;
            *out = self.shares[k] * self.values[k];
        }
        out
    }

    /// True while a value that is no longer fresh is being taken back.
    pub(super) const fn is_fading(&self) -> bool {
        self.fading
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_silent_sensor_is_held_then_faded_and_comes_back_the_same_way() {
        let mut live = LiveInputs::new(1, 0.1, 0.5);
        let at = |ms: i64| MonoTime::from_ns(ms * 1_000_000);
        let mut last = 0.0;
        let mut largest_step = 0.0f64;
        for ms in 0..3000 {
            if !(1000..2000).contains(&ms) {
                live.tell(at(ms), 0, 0.01);
            }
            let value = live.advance(at(ms), 1e-3)[0];
            largest_step = largest_step.max((value - last).abs());
            last = value;
            match ms {
                999 | 1099 | 2600 => assert!((value - 0.01).abs() < 1e-12, "{ms}: {value}"),
                1300 => assert!(live.is_fading() && value < 0.01),
                1700 => assert!(!live.is_fading() && value == 0.0),
                _ => {}
            }
        }
        assert!(largest_step <= 0.01 * 1e-3 / 0.5 * 1.0001);
        live.tell(at(3000), 0, f64::NAN);
        live.tell(at(3000), 7, 1.0);
        assert!(live.advance(at(3000), 1e-3)[0] == last);
    }
}
