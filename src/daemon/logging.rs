//! Where log lines go, and how many a peer can cause.

use std::io::{self, IsTerminal};
use std::time::Duration;

use tracing_subscriber::filter::{EnvFilter, ParseError};
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::{SubscriberInitExt, TryInitError};

use volcomp_config::{LogConfig, LogTarget};
use volcomp_units::MonoTime;

/// Why logging could not be set up.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The filter does not parse.
    #[error("log level `{level}`: {source}; expected e.g. `info` or `volcomp=debug`")]
    Level {
        /// The filter.
        level: String,
        /// What is wrong with it.
        source: ParseError,
    },
    /// journald cannot be reached.
    #[error("journald: {0}; set the log target to `stderr` or `auto`")]
    Journald(io::Error),
    /// Another subscriber is already installed.
    #[error(transparent)]
    Taken(#[from] TryInitError),
}

/// Installs the subscriber of the process.
///
/// # Errors
/// See [`LogError`].
pub(super) fn init(config: &LogConfig) -> Result<(), LogError> {
    let filter = EnvFilter::try_new(&config.level)
        .map_err(|source| LogError::Level { level: config.level.clone(), source })?;
    let journald = match config.target {
        LogTarget::Journald => true,
        LogTarget::Stderr => false,
        LogTarget::Auto => stderr_is_the_journal(),
    };
    let registry = tracing_subscriber::registry().with(filter);
    if journald {
        let layer = tracing_journald::layer().map_err(LogError::Journald)?;
        registry.with(layer.with_field_prefix(Some("VOLCOMP".to_owned()))).try_init()?;
    } else {
        let layer = tracing_subscriber::fmt::layer()
            .with_writer(io::stderr)
            .with_ansi(io::stderr().is_terminal())
            .with_target(false);
        registry.with(layer).try_init()?;
    }
    Ok(())
}

/// systemd puts device and inode of the journal's stream into the environment; a redirected stderr differs.
fn stderr_is_the_journal() -> bool {
    use std::os::unix::fs::MetadataExt;
    let Ok(expected) = std::env::var("JOURNAL_STREAM") else { return false };
    std::fs::metadata("/proc/self/fd/2")
        .is_ok_and(|stderr| expected == format!("{}:{}", stderr.dev(), stderr.ino()))
}

/// Bounds the lines of one kind: a bucket of lines that refills with time. What is held back is counted.
#[derive(Debug, Clone)]
pub(super) struct LogLimiter {
    capacity: f64,
    lines_per_s: f64,
    level: f64,
    at: MonoTime,
    held_back: u64,
}

impl LogLimiter {
    /// `burst` lines at once, then one every `interval`.
    pub(super) fn new(burst: u32, interval: Duration) -> Self {
        let capacity = f64::from(burst);
        Self {
            capacity,
            lines_per_s: 1.0 / interval.as_secs_f64(),
            level: capacity,
            at: MonoTime::ZERO,
            held_back: 0,
        }
    }

    /// Whether a line may be written now; with the number of lines held back since the last one.
    pub(super) fn admit(&mut self, now: MonoTime) -> Option<u64> {
        let refill = now.seconds_since(self.at).max(0.0) * self.lines_per_s;
        self.level = (self.level + refill).min(self.capacity);
        self.at = now;
        if self.level < 1.0 {
            self.held_back += 1;
            return None;
        }
        self.level -= 1.0;
        Some(std::mem::take(&mut self.held_back))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_burst_then_one_line_per_interval_and_the_rest_counted() {
        let mut limiter = LogLimiter::new(3, Duration::from_secs(10));
        let at = |s: f64| MonoTime::ZERO.plus_seconds(s);
        let admitted = (0..100).filter(|k| limiter.admit(at(f64::from(*k) * 0.01)).is_some()).count();
        assert_eq!(admitted, 3);
        assert_eq!(limiter.admit(at(10.5)), Some(97));
        assert_eq!(limiter.admit(at(10.6)), None);
    }

    #[test]
    fn an_endless_storm_is_bounded_by_the_rate() {
        let mut limiter = LogLimiter::new(5, Duration::from_secs(1));
        let lines = (0..100_000)
            .filter(|k| limiter.admit(MonoTime::from_ns(i64::from(*k) * 1_000_000)).is_some())
            .count();
        assert!((100..=105).contains(&lines), "{lines} lines in 100 s");
    }

    #[test]
    fn a_wrong_filter_is_named() {
        let config = LogConfig { target: LogTarget::Stderr, level: "volcomp=loud".to_owned() };
        let error = init(&config).expect_err("refused").to_string();
        assert!(error.contains("volcomp=loud"), "{error}");
    }
}
