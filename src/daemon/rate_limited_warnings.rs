//! Warnings about events that the cycle only counts: at the first occurrence, then at most once a minute.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Duration;

use tracing::warn;

use super::channels::Progress;
use super::logging::LogLimiter;
use super::recent::interval;
use volcomp_engine::fault::Code;
use volcomp_units::MonoTime;

/// Pause between two lines about the same thing.
const PAUSE: Duration = Duration::from_secs(60);
/// Interval over which the share of late cycles is judged, s.
const WINDOW_S: f64 = 2.0;
/// More late cycles than one in so many are worth a line.
const LATE_ONE_IN: u64 = 50;

/// A counter of the cycle thread that has a line of its own.
#[derive(Debug)]
struct Counted {
    code: Code,
    counter: fn(&Progress) -> &AtomicU64,
    seen: u64,
    lines: LogLimiter,
}

/// Looks after all of them.
#[derive(Debug)]
pub(super) struct RateLimitedWarnings {
    counted: [Counted; 8],
    /// Beginning of the present window, with cycles and late cycles until then.
    window: (MonoTime, u64, u64),
    late: LogLimiter,
    records: LogLimiter,
    records_lost: u64,
    records_seen: u64,
}

impl RateLimitedWarnings {
    pub(super) fn new(now: MonoTime) -> Self {
        let counted = |code, counter| Counted { code, counter, seen: 0, lines: LogLimiter::new(1, PAUSE) };
        Self {
            counted: [
                counted(Code::SEQUENCE, |p| &p.out_of_order),
                counted(Code::LIMITED, |p| &p.limited),
                counted(Code::SOFT_LIMIT, |p| &p.at_soft_limit),
                counted(Code::OUT_OF_TRAVEL, |p| &p.out_of_travel),
                counted(Code::CONTROL_LIMITED, |p| &p.control_limited),
                counted(Code::OFFSET_BEHIND, |p| &p.lagging),
                counted(Code::UNLISTED_OFFSET, |p| &p.unlisted),
                counted(Code::CYCLE_TIME, |p| &p.off_cycle),
            ],
            window: (now, 0, 0),
            late: LogLimiter::new(1, PAUSE),
            records: LogLimiter::new(1, PAUSE),
            records_lost: 0,
            records_seen: 0,
        }
    }

    /// Logs entries that the recording has lost; `lost` counts from the start. Returns those lost since the last call.
    pub(super) fn look_at_recording(&mut self, now: MonoTime, lost: u64) -> u64 {
        if lost > self.records_lost && self.records.admit(now).is_some() {
            warn_about(Code::RECORDS_LOST, lost - self.records_lost, None);
            self.records_lost = lost;
        }
        let new = lost.saturating_sub(self.records_seen);
        self.records_seen = lost;
        new
    }

    /// Logs what is new. Returns the late cycles of a window that has just ended with too many of them, else 0.
    pub(super) fn look(&mut self, now: MonoTime, progress: &Progress) -> u64 {
        for counted in &mut self.counted {
            let count = (counted.counter)(progress).load(Relaxed);
            if count > counted.seen && counted.lines.admit(now).is_some() {
                let numbers = (counted.code == Code::CYCLE_TIME).then(|| interval(progress));
                warn_about(counted.code, count - counted.seen, numbers.as_deref());
                counted.seen = count;
            }
        }
        let (begin, cycles, late) = self.window;
        if now.seconds_since(begin) < WINDOW_S {
            return 0;
        }
        self.window = (now, progress.cycles.load(Relaxed), progress.late.load(Relaxed));
        let (cycles, late) = (self.window.1.saturating_sub(cycles), self.window.2.saturating_sub(late));
        if late <= cycles / LATE_ONE_IN || late == 0 {
            return 0;
        }
        if self.late.admit(now).is_some() {
            warn_about(Code::LATE_CYCLES, late, None);
        }
        late
    }
}

fn warn_about(code: Code, cycles: u64, numbers: Option<&str>) {
    let text = code.entry().map_or("", |entry| entry.text);
    warn!(cycles, numbers, code = %code, "{text}");
}
