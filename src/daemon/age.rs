//! How old a position is when it is used, although the two clocks have nothing in common.
//!
//! The offset between the control's clock and ours is taken from the quickest frame of the last 10 to 20 s: its
//! age counts as zero. Ages are therefore relative to the fastest transport seen. Two half-windows of minima keep
//! clock drift out (50 ppm over 20 s is 1 ms at the very worst, and only in the direction of too old). A control
//! that runs faster than real time (simulation) makes ages small without meaning.

use volcomp_units::MonoTime;

/// Length of one half-window, ns.
const HALF_WINDOW_NS: i64 = 10_000_000_000;

/// Windowed-minimum estimator of the age of position frames.
#[derive(Debug, Clone, Copy)]
pub(super) struct AgeEstimator {
    half_started: MonoTime,
    current: i64,
    previous: i64,
    last_control_ns: i64,
}

impl AgeEstimator {
    pub(super) const fn new() -> Self {
        Self {
            half_started: MonoTime::ZERO,
            current: i64::MAX,
            previous: i64::MAX,
            last_control_ns: i64::MIN,
        }
    }

    /// Age in ns of a sample stamped `control_ns`, received at `now`.
    pub(super) fn age_ns(&mut self, now: MonoTime, control_ns: i64) -> i64 {
        if control_ns < self.last_control_ns {
            // the control's clock went back: what was learnt about it is void
            *self = Self::new();
        }
        self.last_control_ns = control_ns;
        if now.ns.saturating_sub(self.half_started.ns) > HALF_WINDOW_NS {
            self.previous = self.current;
            self.current = i64::MAX;
            self.half_started = now;
        }
        let difference = now.ns.saturating_sub(control_ns);
        self.current = self.current.min(difference);
        difference.saturating_sub(self.current.min(self.previous))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    #[test]
    fn the_quickest_frame_has_age_zero_and_a_late_one_its_delay() {
        let mut ages = AgeEstimator::new();
        let control_origin = 987_654_321_000;
        assert_eq!(ages.age_ns(MonoTime::from_ns(100 * MS), control_origin), 0);
        assert_eq!(ages.age_ns(MonoTime::from_ns(104 * MS), control_origin + MS), 3 * MS);
        assert_eq!(ages.age_ns(MonoTime::from_ns(102 * MS), control_origin + 2 * MS), 0);
    }

    #[test]
    fn slow_drift_does_not_accumulate() {
        // the control's clock runs 100 ppm slow: differences grow by 0.1 ms each second
        let mut ages = AgeEstimator::new();
        let mut worst = 0;
        for second in 0..600_i64 {
            let now = second * 1_000 * MS;
            worst = worst.max(ages.age_ns(MonoTime::from_ns(now), now - now / 10_000));
        }
        assert!(worst <= 21 * MS / 10, "worst age {worst} ns");
    }

    #[test]
    fn a_control_clock_that_goes_back_starts_afresh() {
        let mut ages = AgeEstimator::new();
        let _ = ages.age_ns(MonoTime::from_ns(0), 50_000 * MS);
        assert_eq!(ages.age_ns(MonoTime::from_ns(MS), 0), 0);
    }

    #[test]
    fn hostile_stamps_do_not_overflow() {
        let mut ages = AgeEstimator::new();
        for stamp in [i64::MIN, i64::MAX, 0, i64::MIN] {
            assert!(ages.age_ns(MonoTime::from_ns(5), stamp) >= 0);
        }
    }
}
