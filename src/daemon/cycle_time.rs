//! Compares the interval between position frames with the cycle time that the control announced.
//!
//! Two intervals per control cycle are measured over windows of 2 s: by this computer's clock, and by the control's time
//! stamps. Cycles are counted by the sequence numbers, so frames that were lost or passed over change nothing. The interval
//! is off where either is, in three windows in a row: a pause of the control or a burst of frames is one window.

use volcomp_protocol::Position;
use volcomp_units::{MonoTime, NS_PER_S};

/// Length of a window, s.
const WINDOW_S: f64 = 2.0;
/// Windows in a row that decide.
const WINDOWS: u8 = 3;
/// Fewest cycles of a window that says something.
const CYCLES_MIN: u32 = 10;
/// Relative difference from which the interval is off.
const OFF: f64 = 0.10;
/// Relative difference below which it is right again.
const RIGHT: f64 = 0.05;

/// Watches the frames of one link.
#[derive(Debug, Clone, Copy)]
pub(super) struct CycleTimeMonitor {
    cycle_ns: f64,
    begin: Option<Begin>,
    /// Windows in a row that speak against the present verdict.
    against: u8,
    off: bool,
    /// The interval of the newest window that is further from the announced one, ns.
    interval_ns: i64,
}

/// The first frame of a window.
#[derive(Debug, Clone, Copy)]
struct Begin {
    received: MonoTime,
    control_ns: i64,
    sequence: u32,
}

impl CycleTimeMonitor {
    /// A control that announces a cycle of `cycle_s` seconds.
    pub(super) const fn new(cycle_s: f64) -> Self {
        Self { cycle_ns: cycle_s * NS_PER_S, begin: None, against: 0, off: false, interval_ns: 0 }
    }

    /// One frame, received at `received`; the interval found, ns, while it is off.
    ///
    /// # Cycle   no allocation, no panic, bounded time
    pub(super) fn look(&mut self, received: MonoTime, frame: &Position) -> Option<i64> {
        let here = Begin { received, control_ns: frame.control_ns, sequence: frame.sequence };
        let begin = *self.begin.get_or_insert(here);
        let passed_s = received.seconds_since(begin.received);
        if !(0.0..WINDOW_S).contains(&passed_s) {
            self.begin = Some(here);
            let cycles = frame.sequence.wrapping_sub(begin.sequence);
            if (CYCLES_MIN..=u32::MAX / 2).contains(&cycles) && passed_s > 0.0 {
                let stamped_ns = frame.control_ns.saturating_sub(begin.control_ns) as f64;
                self.judge([passed_s * NS_PER_S, stamped_ns].map(|ns| ns / f64::from(cycles)));
            }
        }
        self.off.then_some(self.interval_ns)
    }

    /// Takes in the intervals of a window, ns.
    fn judge(&mut self, [received, stamped]: [f64; 2]) {
        let difference = |ns: f64| (ns / self.cycle_ns - 1.0).abs();
        let worse = if difference(stamped) > difference(received) { stamped } else { received };
        let speaks_against = if self.off { difference(worse) < RIGHT } else { difference(worse) > OFF };
        self.against = if speaks_against { self.against + 1 } else { 0 };
        if self.against == WINDOWS {
            (self.off, self.against) = (!self.off, 0);
        }
        self.interval_ns = worse as i64;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Announced cycle, ns.
    const CYCLE_NS: i64 = 2_000_000;

    /// A control and the monitor of its link.
    struct Link {
        monitor: CycleTimeMonitor,
        frame: Position,
        now_ns: i64,
    }

    impl Link {
        fn new() -> Self {
            let monitor = CycleTimeMonitor::new(CYCLE_NS as f64 / NS_PER_S);
            Self { monitor, frame: Position::default(), now_ns: 5_000_000_000 }
        }

        /// `seconds` of frames `sent_ns` apart, stamped `stamped_ns` apart; the last verdict.
        fn run(&mut self, seconds: f64, sent_ns: i64, stamped_ns: i64) -> Option<i64> {
            let mut found = None;
            for _ in 0..(seconds * NS_PER_S / sent_ns as f64) as u32 {
                self.now_ns += sent_ns;
                self.frame.control_ns += stamped_ns;
                self.frame.sequence = self.frame.sequence.wrapping_add(1);
                found = self.monitor.look(MonoTime::from_ns(self.now_ns), &self.frame);
            }
            found
        }
    }

    #[test]
    fn a_control_at_its_announced_cycle_is_right() {
        let mut link = Link::new();
        link.frame.sequence = u32::MAX - 100;
        assert_eq!(link.run(60.0, CYCLE_NS, CYCLE_NS), None);
        assert_eq!(link.run(60.0, CYCLE_NS * 108 / 100, CYCLE_NS), None, "8 % is inside the tolerance");
    }

    #[test]
    fn one_that_sends_at_another_interval_is_off_until_it_is_right_again() {
        // honest stamps, and stamps that go by the announced cycle
        for (sent, stamped) in [(4, 4), (1, 1), (4, 2), (1, 2), (2, 4), (2, 1)] {
            let mut link = Link::new();
            let (sent, stamped) = (sent * 1_000_000, stamped * 1_000_000);
            assert_eq!(link.run(4.5, sent, stamped), None, "two windows are not enough");
            let found = link.run(3.0, sent, stamped);
            let expected = if sent == CYCLE_NS { stamped } else { sent };
            assert!(
                found.is_some_and(|ns| (ns - expected).abs() < 5_000),
                "{found:?} of {sent} and {stamped}"
            );
            assert!(link.run(20.0, CYCLE_NS * 107 / 100, CYCLE_NS).is_some(), "not yet right");
            assert!(link.run(5.0, CYCLE_NS, CYCLE_NS).is_some(), "not at once");
            assert_eq!(link.run(6.0, CYCLE_NS, CYCLE_NS), None);
        }
    }

    #[test]
    fn pauses_lost_frames_and_damage_are_no_other_cycle() {
        let mut link = Link::new();
        for _ in 0..20 {
            assert_eq!(link.run(3.0, CYCLE_NS, CYCLE_NS), None);
            // the control stands still
            link.now_ns += 5_000_000_000;
            assert_eq!(link.run(3.0, CYCLE_NS, CYCLE_NS), None);
            // frames are lost
            let lost = 700;
            link.frame.sequence = link.frame.sequence.wrapping_add(lost);
            (link.now_ns, link.frame.control_ns) = (
                link.now_ns + i64::from(lost) * CYCLE_NS,
                link.frame.control_ns + i64::from(lost) * CYCLE_NS,
            );
        }
        for damage in [i64::MIN, i64::MAX, 0] {
            link.frame.control_ns = damage;
            let _ = link.monitor.look(MonoTime::from_ns(i64::MAX), &link.frame);
            let _ = link.monitor.look(MonoTime::from_ns(i64::MIN), &link.frame);
        }
    }
}
