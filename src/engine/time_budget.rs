//! Bounds the time that offsets may use by this computer's clock.
//!
//! A token bucket (ITU-T I.371): computer time flows in, control time flows out, and what is left over is kept up to a
//! capacity, so that frames that arrive in a burst after a pause are used in full. Over any interval `T` of this computer's
//! clock an offset moves by no more than `rate (T + capacity)`, whatever the control's time stamps say.

use volcomp_model::units::MonoTime;

/// Computer time that no offset has used yet.
#[derive(Debug, Clone, Copy)]
pub(super) struct TimeBudget {
    capacity_s: f64,
    available_s: f64,
    last: Option<MonoTime>,
}

impl TimeBudget {
    /// Nothing is available yet; at most `capacity_s` seconds are kept.
    pub(super) const fn new(capacity_s: f64) -> Self {
        Self { capacity_s, available_s: 0.0, last: None }
    }

    /// The part of `wanted_s` seconds of control time that may be used at `now`.
    ///
    /// # Cycle   no allocation, no panic, bounded time
    pub(super) fn grant(&mut self, now: MonoTime, wanted_s: f64) -> f64 {
        let passed_s = self.last.map_or(0.0, |last| now.seconds_since(last).max(0.0));
        self.last = Some(now);
        let available_s = (self.available_s + passed_s).min(self.capacity_s);
        let granted_s = wanted_s.min(available_s);
        self.available_s = available_s - granted_s;
        granted_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CAPACITY_S: f64 = 0.02;

    #[test]
    fn a_burst_after_a_pause_is_granted_in_full() {
        let mut budget = TimeBudget::new(CAPACITY_S);
        assert_eq!(budget.grant(MonoTime::ZERO, 0.001), 0.0, "no time has passed");
        let now = MonoTime::ZERO.plus_seconds(0.015);
        let granted: f64 = (0..15).map(|_| budget.grant(now, 0.001)).sum();
        assert!((granted - 0.015).abs() < 1e-12, "{granted}");
        assert!(budget.grant(now, 0.001) < 1e-12);
    }

    proptest! {
        #[test]
        fn no_interval_uses_more_than_itself_and_the_capacity(
            frames in prop::collection::vec((-0.01..0.05f64, 0.0..0.01f64), 1..200),
        ) {
            let mut budget = TimeBudget::new(CAPACITY_S);
            let mut now = MonoTime::ZERO.plus_seconds(10.0);
            let mut used = Vec::new();
            for (passed, wanted) in frames {
                now = now.plus_seconds(passed);
                used.push((passed.max(0.0), budget.grant(now, wanted)));
                prop_assert!((0.0..=wanted).contains(&used[used.len() - 1].1));
            }
            for from in 0..used.len() {
                let (mut passed, mut granted) = (0.0, used[from].1);
                prop_assert!(granted <= CAPACITY_S);
                for (step, more) in &used[from + 1..] {
                    passed += step;
                    granted += more;
                    prop_assert!(granted <= passed + CAPACITY_S + 1e-9);
                }
            }
        }
    }
}
