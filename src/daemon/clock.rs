//! The daemon's own monotonic clock.

use super::sync;
use volcomp_units::MonoTime;

/// Nanoseconds since the daemon was started; the one clock of the process.
#[derive(Debug, Clone, Copy)]
pub(super) struct Clock {
    origin_ns: i64,
}

impl Clock {
    pub(super) fn start() -> Self {
        Self { origin_ns: sync::now_ns() }
    }

    pub(super) fn now(self) -> MonoTime {
        MonoTime::from_ns(sync::now_ns().saturating_sub(self.origin_ns))
    }
}
