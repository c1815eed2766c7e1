//! The daemon's own monotonic clock.

use std::time::Instant;

use crate::core::units::MonoTime;

/// Nanoseconds since the daemon was started; the one clock of the process.
#[derive(Debug, Clone, Copy)]
pub(super) struct Clock {
    origin: Instant,
}

impl Clock {
    pub(super) fn start() -> Self {
        Self { origin: Instant::now() }
    }

    pub(super) fn now(self) -> MonoTime {
        MonoTime::from_ns(i64::try_from(self.origin.elapsed().as_nanos()).unwrap_or(i64::MAX))
    }
}
