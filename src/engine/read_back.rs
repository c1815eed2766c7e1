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
