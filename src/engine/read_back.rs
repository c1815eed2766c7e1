//! Does the control apply what it was sent? The read-back must be one of the last offsets sent.

use volcomp_model::axes::{AxisArray, MAX_AXES};

/// The longest delay between an offset and its read-back that can be watched, in cycles.
pub const READ_BACK_CYCLES_MAX: usize = 64;

/// So many of the newest offsets are looked at before all of them.
const QUICK: usize = 4;

/// Remembers the last offsets and compares. mm and rad.
#[derive(Debug, Clone)]
pub(super) struct ReadBack {
    sent: [AxisArray; READ_BACK_CYCLES_MAX],
    next: usize,
    filled: usize,
    window: usize,
    tolerance: AxisArray,
    misses: usize,
}

impl ReadBack {
    pub(super) fn new(window: usize, tolerance: AxisArray) -> Self {
        Self {
            sent: [[0.0; MAX_AXES]; READ_BACK_CYCLES_MAX],
            next: 0,
            filled: 0,
            window: window.clamp(1, READ_BACK_CYCLES_MAX),
            tolerance,
            misses: 0,
        }
    }

    /// Forgets everything.
    pub(super) const fn restart(&mut self) {
        self.filled = 0;
        self.misses = 0;
    }

    /// Remembers an offset that was sent.
    pub(super) fn sent(&mut self, offset: &AxisArray) {
        self.sent[self.next] = *offset;
        self.next = (self.next + 1) % self.window;
        self.filled = (self.filled + 1).min(self.window);
    }

    /// So many cycles have passed in which nothing was sent: the control goes on with the last offset.
    pub(super) fn pass(&mut self, cycles: u32) {
        if self.filled > 0 {
            let last = self.sent[(self.next + self.window - 1) % self.window];
            for _ in 0..(cycles as usize).min(self.window) {
                self.sent(&last);
            }
        }
    }

    /// True where `applied` is one of the last offsets sent, or too few were sent to tell.
    pub(super) fn knows(&self, applied: &AxisArray, axes: usize) -> bool {
        self.filled < self.window || self.was_sent(applied, axes)
    }

    /// The same after `gap` cycles without a frame: beyond the window nothing is on its way any more, so few are enough.
    pub(super) fn knows_after(&self, gap: u32, applied: &AxisArray, axes: usize) -> bool {
        (self.filled < self.window && gap as usize <= self.window) || self.was_sent(applied, axes)
    }

    /// True where `applied` lies among the last offsets sent, however few they are.
    fn was_sent(&self, applied: &AxisArray, axes: usize) -> bool {
        // the ordinary case: exactly one of the newest
        self.newest().take(QUICK).any(|o| (0..axes).all(|k| (o[k] - applied[k]).abs() <= self.tolerance[k]))
            || (0..axes).all(|k| self.beyond(applied, k) <= self.tolerance[k])
    }

    /// The offsets sent, the newest first.
    fn newest(&self) -> impl Iterator<Item = &AxisArray> {
        (0..self.filled).map(|back| &self.sent[(self.next + self.window - 1 - back) % self.window])
    }

    /// How far what axis `k` holds lies outside the last offsets sent; infinite where none were.
    fn beyond(&self, applied: &AxisArray, k: usize) -> f64 {
        if !applied[k].is_finite() {
            return f64::INFINITY;
        }
        let (low, high) =
            self.newest().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), o| (l.min(o[k]), h.max(o[k])));
        (low - applied[k]).max(applied[k] - high).max(0.0)
    }

    /// The first axis that does not hold what it was sent: by how much, and the tolerance.
    pub(super) fn foreign(&self, applied: &AxisArray, axes: usize) -> Option<(usize, f64, f64)> {
        let found = |k: usize| (k, self.beyond(applied, k), self.tolerance[k]);
        (0..axes).map(found).find(|(_, beyond, tolerance)| beyond > tolerance)
    }

    /// True once the read-back has lain outside everything sent for a whole window of cycles.
    pub(super) fn is_foreign(&mut self, applied: &AxisArray, axes: usize) -> bool {
        self.misses = if self.knows(applied, axes) { 0 } else { self.misses + 1 };
        self.misses >= self.window
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WINDOW: usize = 10;
    const TOLERANCE: f64 = 1e-4;

    fn x(value: f64) -> AxisArray {
        let mut offset = [0.0; MAX_AXES];
        offset[0] = value;
        offset
    }

    fn watch() -> ReadBack {
        ReadBack::new(WINDOW, [TOLERANCE; MAX_AXES])
    }

    /// So many offsets, 1 um apart; the last one is 0.03 mm.
    fn after(offsets: usize) -> ReadBack {
        let mut r = watch();
        (0..offsets).rev().for_each(|back| r.sent(&x(0.03 - 1e-3 * back as f64)));
        r
    }

    #[test]
    fn nothing_is_judged_before_a_window_has_been_sent() {
        let mut r = watch();
        for _ in 0..WINDOW {
            assert!(r.knows(&x(5.0), 1), "whatever the control held before");
            r.sent(&x(0.01));
        }
        assert!(!r.knows(&x(5.0), 1));
        assert!(r.knows(&x(0.01), 1));
    }

    #[test]
    fn anything_among_the_offsets_of_the_window_is_known_and_older_ones_are_not() {
        let r = after(2 * WINDOW);
        for back in 0..WINDOW {
            assert!(r.knows(&x(0.03 - 1e-3 * back as f64), 1), "{back} cycles ago");
        }
        assert!(!r.knows(&x(0.03 - 1e-3 * WINDOW as f64), 1));
        assert!(!r.knows(&x(0.03 + 2e-4), 1));
        assert!(!r.knows(&x(f64::NAN), 1));
    }

    #[test]
    fn a_difference_of_just_the_tolerance_is_tolerated() {
        let mut r = watch();
        (0..WINDOW).for_each(|_| r.sent(&x(0.0)));
        assert!(r.knows(&x(TOLERANCE), 1) && r.knows(&x(-TOLERANCE), 1));
        assert_eq!(r.foreign(&x(TOLERANCE), 1), None);
        assert_eq!(r.foreign(&x(2.0 * TOLERANCE), 1), Some((0, 2.0 * TOLERANCE, TOLERANCE)));
        assert_eq!(r.foreign(&x(-2.0 * TOLERANCE), 1), Some((0, 2.0 * TOLERANCE, TOLERANCE)));
    }

    #[test]
    fn only_axes_of_the_link_count() {
        let mut r = watch();
        (0..WINDOW).for_each(|_| r.sent(&x(0.0)));
        let mut applied = x(0.0);
        applied[1] = 1.0;
        assert!(r.knows(&applied, 1) && !r.knows(&applied, 2));
    }

    #[test]
    fn it_is_a_fault_after_a_whole_window_of_misses_that_follow_each_other() {
        let mut r = after(WINDOW);
        for _ in 1..WINDOW {
            assert!(!r.is_foreign(&x(5.0), 1));
        }
        assert!(!r.is_foreign(&x(0.03), 1), "one that fits starts the count again");
        for _ in 1..WINDOW {
            assert!(!r.is_foreign(&x(5.0), 1));
        }
        assert!(r.is_foreign(&x(5.0), 1));
    }

    #[test]
    fn after_a_restart_it_knows_nothing_of_before() {
        let mut r = after(WINDOW + 3);
        (1..WINDOW).for_each(|_| assert!(!r.is_foreign(&x(5.0), 1)));
        r.restart();
        assert!(r.knows(&x(5.0), 1), "too few were sent to tell");
        (0..WINDOW).for_each(|_| r.sent(&x(0.0)));
        for _ in 1..WINDOW {
            assert!(!r.is_foreign(&x(5.0), 1), "the misses of before do not count");
        }
        assert!(r.is_foreign(&x(5.0), 1));
    }

    #[test]
    fn after_a_long_gap_a_few_offsets_are_enough_to_tell() {
        // offsets of before the restart lie around, and must not count
        for before in WINDOW..2 * WINDOW {
            let mut r = after(before);
            r.restart();
            r.sent(&x(-0.02));
            r.sent(&x(-0.01));
            for gap in [0, 3, WINDOW as u32] {
                assert!(r.knows_after(gap, &x(5.0), 1), "an offset of before may still be on its way");
            }
            let long = WINDOW as u32 + 1;
            for (applied, known) in
                [(-0.02, true), (-0.01, true), (-0.015, true), (0.0, false), (0.03, false)]
            {
                assert_eq!(r.knows_after(long, &x(applied), 1), known, "{applied} after {before}");
            }
        }
        let full = after(WINDOW);
        for gap in [0, 3, 10, 11, 300] {
            assert!(full.knows_after(gap, &x(0.03), 1) && !full.knows_after(gap, &x(5.0), 1));
        }
    }

    #[test]
    fn cycles_without_an_answer_repeat_the_last_offset() {
        for before in WINDOW..2 * WINDOW {
            let mut r = after(before);
            r.pass(4);
            // the newest six are left
            assert!(r.knows(&x(0.025), 1) && !r.knows(&x(0.024), 1), "{before}");
            r.pass(u32::MAX);
            assert!(r.knows(&x(0.03), 1) && !r.knows(&x(0.029), 1), "{before}");
        }
        let mut r = watch();
        r.pass(u32::MAX);
        assert!(r.knows(&x(5.0), 1), "nothing was sent that could go on");
    }
}
