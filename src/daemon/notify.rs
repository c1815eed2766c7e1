//! systemd: READY, STATUS, STOPPING, and a watchdog that is fed only by real progress.

use std::time::Duration;

use sd_notify::NotifyState;

use volcomp_units::MonoTime;

/// Time between two STATUS lines.
const STATUS_INTERVAL_S: f64 = 1.0;

/// What happened to the watchdog at one look.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fed {
    /// Not due.
    NotDue,
    /// Fed.
    Yes,
    /// Due, but the cycle thread has not moved since the last time.
    Stuck,
}

/// Decides when the watchdog may be fed.
#[derive(Debug, Clone)]
pub(super) struct Watchdog {
    interval: Option<Duration>,
    fed: MonoTime,
    beats: u64,
}

impl Watchdog {
    /// From the environment that systemd gives; without one, nothing is ever due.
    pub(super) fn from_environment() -> Self {
        Self::new(sd_notify::watchdog_enabled())
    }

    fn new(timeout: Option<Duration>) -> Self {
        Self { interval: timeout.map(|t| t / 2), fed: MonoTime::ZERO, beats: 0 }
    }

    /// `beats` is the cycle thread's own counter.
    pub(super) fn look(&mut self, now: MonoTime, beats: u64) -> Fed {
        let Some(interval) = self.interval else { return Fed::NotDue };
        // a tick ahead of half the timeout, so that the half is never missed by one tick
        if now.seconds_since(self.fed) < interval.as_secs_f64() * 0.9 {
            return Fed::NotDue;
        }
        if beats == self.beats {
            return Fed::Stuck;
        }
        self.beats = beats;
        self.fed = now;
        Fed::Yes
    }
}

/// Tells systemd; without `NOTIFY_SOCKET` nothing happens.
pub(super) fn notify(states: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(states) {
        tracing::debug!(%error, "the service manager could not be told");
    }
}

/// Sends the STATUS line when it has changed, at most once a second.
#[derive(Debug, Default)]
pub(super) struct Headline {
    text: String,
    at: Option<MonoTime>,
}

impl Headline {
    pub(super) fn show(&mut self, now: MonoTime, text: impl FnOnce() -> String) {
        if self.at.is_some_and(|at| now.seconds_since(at) < STATUS_INTERVAL_S) {
            return;
        }
        self.at = Some(now);
        let text = text();
        if text != self.text {
            notify(&[NotifyState::Status(&text)]);
            self.text = text;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fed_at_half_the_timeout_and_only_by_progress() {
        let mut dog = Watchdog::new(Some(Duration::from_secs(2)));
        let at = |s: f64| MonoTime::ZERO.plus_seconds(s);
        assert_eq!(dog.look(at(0.5), 10), Fed::NotDue);
        assert_eq!(dog.look(at(1.0), 20), Fed::Yes);
        assert_eq!(dog.look(at(1.5), 30), Fed::NotDue);
        assert_eq!(dog.look(at(2.0), 20), Fed::Stuck);
        assert_eq!(dog.look(at(2.5), 20), Fed::Stuck);
        assert_eq!(dog.look(at(2.6), 21), Fed::Yes);
    }

    #[test]
    fn nothing_is_due_without_a_watchdog() {
        assert_eq!(Watchdog::new(None).look(MonoTime::from_ns(i64::MAX), 1), Fed::NotDue);
    }
}
