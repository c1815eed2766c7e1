//! Live values of sensors: held while fresh, then faded to the static model.

use volcomp_model::SENSORS_MAX;
use volcomp_model::units::{MonoTime, NS_PER_S};

/// The live values of a model, each with the share that it has.
#[derive(Debug, Clone)]
pub(super) struct LiveInputs {
    used: usize,
    max_age_ns: i64,
    fade_s: f64,
    channels: [Channel; SENSORS_MAX],
    fading: bool,
}

#[derive(Debug, Clone, Copy)]
struct Channel {
    value: f64,
    /// When it was received last, ns; [`NEVER`] before.
    told_ns: i64,
    share: f64,
}

/// So long ago that any age limit has passed.
const NEVER: i64 = i64::MIN;

impl LiveInputs {
    pub(super) const fn new(channels: usize, max_age_s: f64, fade_s: f64) -> Self {
        Self {
            used: if channels < SENSORS_MAX { channels } else { SENSORS_MAX },
            max_age_ns: (max_age_s * NS_PER_S) as i64,
            fade_s,
            channels: [Channel { value: 0.0, told_ns: NEVER, share: 0.0 }; SENSORS_MAX],
            fading: false,
        }
    }

    /// A value of a channel of the model, mm or rad. What is not finite says nothing.
    #[inline]
    pub(super) fn update(&mut self, now: MonoTime, channel: usize, value: f64) {
        if let Some(channel) = self.channels[..self.used].get_mut(channel)
            && value.is_finite()
        {
            (channel.value, channel.told_ns) = (value, now.ns);
        }
    }

    /// Moves the shares on by `dt` and writes the values to add.
    #[inline]
    pub(super) fn advance(&mut self, now: MonoTime, dt: f64, out: &mut [f64; SENSORS_MAX]) {
        let mut fading = false;
        for (channel, out) in self.channels[..self.used].iter_mut().zip(out) {
            let fresh = channel.told_ns != NEVER && now.ns.saturating_sub(channel.told_ns) <= self.max_age_ns;
            let wanted = if fresh { 1.0 } else { 0.0 };
            if channel.share != wanted {
                let change = dt / self.fade_s;
                channel.share += (wanted - channel.share).clamp(-change, change);
                fading |= !fresh && channel.share > 0.0;
            }
            *out = channel.share * channel.value;
        }
        self.fading = fading;
    }

    /// True while a value that is no longer fresh is being taken back.
    pub(super) const fn is_fading(&self) -> bool {
        self.fading
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn advanced(live: &mut LiveInputs, now: MonoTime) -> f64 {
        let mut values = [0.0; SENSORS_MAX];
        live.advance(now, 1e-3, &mut values);
        values[0]
    }

    #[test]
    fn a_silent_sensor_is_held_then_faded_and_comes_back_the_same_way() {
        let mut live = LiveInputs::new(1, 0.1, 0.5);
        let at = |ms: i64| MonoTime::from_ns(ms * 1_000_000);
        let mut last = 0.0;
        let mut largest_step = 0.0f64;
        for ms in 0..3000 {
            if !(1000..2000).contains(&ms) {
                live.update(at(ms), 0, 0.01);
            }
            let value = advanced(&mut live, at(ms));
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
        live.update(at(3000), 0, f64::NAN);
        live.update(at(3000), 7, 1.0);
        assert!(advanced(&mut live, at(3000)) == last);
    }
}
