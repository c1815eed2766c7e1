//! Expected arrival of the next frame, for busy polling.
//!
//! A control sends at its cycle, or, in lock step, as soon as it has its answer. The next frame is therefore expected
//! one interval after the last one, where the interval is the last one seen and at most the cycle: a pause says
//! nothing about what follows it. Polling begins shortly before that and ends shortly after it, so that it costs a
//! share of a processor instead of a whole one.

use std::time::Duration;

use volcomp_units::MonoTime;

/// Times at which frames have come in.
#[derive(Debug, Clone, Copy)]
pub(super) struct PollSchedule {
    cycle_ns: i64,
    margin_ns: i64,
    last: Option<MonoTime>,
    interval_ns: i64,
}

/// What to do while nothing is there, and until when.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wait {
    /// Sleep, but wake up for data.
    Sleep(Duration),
    /// Poll without sleeping.
    Poll,
}

impl PollSchedule {
    /// A control with this cycle; polling from `margin` before the expected arrival to `margin` after it.
    pub(super) fn new(cycle: Duration, margin: Duration) -> Self {
        let cycle_ns = ns(cycle);
        Self { cycle_ns, margin_ns: ns(margin), last: None, interval_ns: cycle_ns }
    }

    /// Data have come in.
    pub(super) fn arrived(&mut self, at: MonoTime) {
        if let Some(last) = self.last {
            self.interval_ns = at.ns.saturating_sub(last.ns).clamp(0, self.cycle_ns);
        }
        self.last = Some(at);
    }

    /// What to do at `now` where nothing else is due before `end`; `None` once `end` has come.
    pub(super) fn wait(&self, now: MonoTime, end: MonoTime) -> Option<Wait> {
        if now >= end {
            return None;
        }
        let sleep_until = |then: i64| Some(Wait::Sleep(Duration::from_nanos(then.abs_diff(now.ns))));
        let Some(last) = self.last else { return sleep_until(end.ns) };
        let expected = last.ns.saturating_add(self.interval_ns);
        let [from, until] =
            [expected.saturating_sub(self.margin_ns), expected.saturating_add(self.margin_ns)];
        if now.ns < from {
            sleep_until(from.min(end.ns))
        } else if now.ns < until {
            Some(Wait::Poll)
        } else {
            sleep_until(end.ns)
        }
    }
}

fn ns(duration: Duration) -> i64 {
    i64::try_from(duration.as_nanos()).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    const US: i64 = 1_000;
    const FAR: MonoTime = MonoTime::from_ns(20_000 * US);

    fn at(us: i64) -> MonoTime {
        MonoTime::from_ns(us * US)
    }

    fn sleep(us: u64) -> Option<Wait> {
        Some(Wait::Sleep(Duration::from_micros(us)))
    }

    fn cyclic() -> PollSchedule {
        let mut poll_schedule = PollSchedule::new(Duration::from_millis(1), Duration::from_micros(100));
        poll_schedule.arrived(at(0));
        poll_schedule.arrived(at(1000));
        poll_schedule
    }

    #[test]
    fn polls_only_around_the_expected_arrival() {
        let poll_schedule = cyclic();
        assert_eq!(poll_schedule.wait(at(1010), FAR), sleep(890));
        assert_eq!(poll_schedule.wait(at(1899), FAR), sleep(1));
        assert_eq!(poll_schedule.wait(at(1900), FAR), Some(Wait::Poll));
        assert_eq!(poll_schedule.wait(at(2099), FAR), Some(Wait::Poll));
        assert_eq!(poll_schedule.wait(at(2100), FAR), sleep(17_900), "the control has stopped: do not burn");
    }

    #[test]
    fn nothing_is_slept_over() {
        let poll_schedule = cyclic();
        assert_eq!(poll_schedule.wait(at(1010), at(1200)), sleep(190));
        assert_eq!(poll_schedule.wait(at(1200), at(1200)), None);
        assert_eq!(poll_schedule.wait(at(1950), at(1960)), Some(Wait::Poll), "the caller asks again");
        assert_eq!(poll_schedule.wait(at(1960), at(1960)), None);
    }

    #[test]
    fn a_control_in_lock_step_is_polled_at_once() {
        let mut poll_schedule = cyclic();
        poll_schedule.arrived(at(1010));
        assert_eq!(poll_schedule.wait(at(1012), FAR), Some(Wait::Poll));
    }

    #[test]
    fn after_a_pause_the_cycle_counts_again() {
        let mut poll_schedule = cyclic();
        poll_schedule.arrived(at(9000));
        assert_eq!(poll_schedule.wait(at(9010), FAR), sleep(890));
    }

    #[test]
    fn before_the_first_frame_nothing_is_polled() {
        let poll_schedule = PollSchedule::new(Duration::from_millis(1), Duration::from_micros(100));
        assert_eq!(poll_schedule.wait(at(0), at(500)), sleep(500));
    }

    #[test]
    fn hostile_times_do_not_overflow() {
        let mut poll_schedule = PollSchedule::new(Duration::MAX, Duration::MAX);
        poll_schedule.arrived(MonoTime::from_ns(i64::MAX));
        poll_schedule.arrived(MonoTime::from_ns(i64::MIN));
        let _ = poll_schedule.wait(MonoTime::from_ns(i64::MIN), MonoTime::from_ns(i64::MAX));
    }
}
