//! When a reading was taken, on the daemon's time line, although the sensor has a clock of its own.
//!
//! [`SensorClock`]: the offset is the smallest difference of arrival and stamp over the last 10 to 20 s: the quickest
//! reading has no delay but the stated one. Two half-windows keep drift out. Stamps that go back, or that jump ahead of
//! what arrival allows, are a step of the clock: what was learned is void.
//!
//! What is left (an unknown delay of the instrument) shows while the machine moves and is estimated with the map:
//! [`super::map::LiveMap::add_sensor`].

use volcomp_model::units::{MonoTime, NS_PER_S};

/// Length of one half-window, ns.
const HALF_WINDOW_NS: i64 = 10_000_000_000;
/// A difference this much below the smallest known is a step of the clock, ns; less is a quicker reading.
const STEP_NS: i64 = 20_000_000;

/// A sensor's clock against the daemon's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorClock {
    latency_ns: i64,
    half_started: MonoTime,
    current: i64,
    previous: i64,
    last_stamp_ns: Option<i64>,
}

/// A stamp on the daemon's time line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamped {
    /// When the reading was taken.
    pub at: MonoTime,
    /// The sensor's clock has stepped: nothing is known about this stamp.
    pub stepped: bool,
}

impl SensorClock {
    /// A clock of which nothing is known; readings take `latency_s` at least.
    #[must_use]
    pub fn new(latency_s: f64) -> Self {
        Self {
            latency_ns: (latency_s * NS_PER_S) as i64,
            half_started: MonoTime::ZERO,
            current: i64::MAX,
            previous: i64::MAX,
            last_stamp_ns: None,
        }
    }

    /// A reading stamped `stamp_ns` by the sensor arrived at `now`.
    pub fn stamp(&mut self, now: MonoTime, stamp_ns: i64) -> Stamped {
        let difference = now.ns.saturating_sub(stamp_ns);
        let known = self.current.min(self.previous);
        let back = self.last_stamp_ns.is_some_and(|last| stamp_ns < last);
        let ahead = known != i64::MAX && difference < known.saturating_sub(STEP_NS);
        if back || ahead {
            let fresh = Self { last_stamp_ns: None, current: i64::MAX, previous: i64::MAX, ..*self };
            *self = fresh;
        }
        self.last_stamp_ns = Some(stamp_ns);
        if now.ns.saturating_sub(self.half_started.ns) > HALF_WINDOW_NS {
            self.previous = self.current;
            self.current = i64::MAX;
            self.half_started = now;
        }
        self.current = self.current.min(difference);
        let late = difference.saturating_sub(self.current.min(self.previous));
        let age = late.saturating_add(self.latency_ns);
        Stamped { at: MonoTime::from_ns(now.ns.saturating_sub(age)), stepped: back || ahead }
    }

    /// Sensor's clock minus the daemon's, s; `None` before the first reading.
    #[must_use]
    pub fn offset_s(&self) -> Option<f64> {
        let smallest = self.current.min(self.previous);
        (smallest != i64::MAX).then(|| self.latency_ns.saturating_sub(smallest) as f64 / NS_PER_S)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    #[test]
    fn the_offset_is_that_of_the_quickest_reading() {
        let mut clock = SensorClock::new(2e-3);
        let origin = 555_000 * MS;
        let mut worst = 0;
        for k in 0..2000 {
            let taken = k * 10 * MS;
            // between 3 and 8 ms on the way; nobody can know of the 3, but 2 are stated
            let now = MonoTime::from_ns(taken + (3 + k * 7 % 6) * MS);
            let stamped = clock.stamp(now, taken + origin);
            assert!(!stamped.stepped);
            if k > 10 {
                worst = worst.max((stamped.at.ns - taken).abs());
            }
        }
        assert_eq!(worst, MS, "what was not stated of the shortest way");
        assert!((clock.offset_s().unwrap() - (555.0 - 1e-3)).abs() < 1e-9);
    }

    #[test]
    fn a_clock_that_steps_is_noticed_either_way_and_learned_anew() {
        for step in [-50 * MS, 50 * MS] {
            let mut clock = SensorClock::new(0.0);
            let mut steps = 0;
            for k in 0..200 {
                let skew = if k >= 100 { step } else { 0 };
                let taken = k * 10 * MS;
                let stamped = clock.stamp(MonoTime::from_ns(taken), taken + skew);
                steps += u32::from(stamped.stepped);
                if k > 100 {
                    assert_eq!(stamped.at.ns, taken);
                }
            }
            assert_eq!(steps, 1);
        }
    }

    #[test]
    fn drift_does_not_accumulate_and_hostile_stamps_do_not_overflow() {
        let mut clock = SensorClock::new(0.0);
        let mut worst = 0;
        for k in 0..60_000 {
            let now = k * 10 * MS;
            let stamped = clock.stamp(MonoTime::from_ns(now), now - now / 20_000);
            worst = worst.max((now - stamped.at.ns).abs());
        }
        assert!(worst < 11 * MS / 10, "{worst}");
        for stamp in [i64::MIN, i64::MAX, 0, i64::MIN] {
            let _ = clock.stamp(MonoTime::from_ns(5), stamp);
        }
    }
}
