//! Does the control apply what it was sent? The read-back must be one of the last offsets sent.

use crate::core::axes::{AxisArray, MAX_AXES};

/// The longest delay between an offset and its read-back that can be watched, in cycles.
pub const READ_BACK_CYCLES_MAX: usize = 64;

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
        let last =
            (0..self.filled).map(|back| &self.sent[(self.next + self.window - 1 - back) % self.window]);
        (0..axes).all(|k| {
            let (low, high) =
                last.clone().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), o| (l.min(o[k]), h.max(o[k])));
            (low - self.tolerance[k]..=high + self.tolerance[k]).contains(&applied[k])
        })
    }

    /// True once the read-back has lain outside everything sent for a whole window of cycles.
    pub(super) fn is_foreign(&mut self, applied: &AxisArray, axes: usize) -> bool {
        self.misses = if self.knows(applied, axes) { 0 } else { self.misses + 1 };
        self.misses >= self.window
    }
}
