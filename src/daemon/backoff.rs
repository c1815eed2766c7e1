//! Pauses between attempts to connect: doubling from the first to the longest.

use std::time::Duration;

/// Exponential back-off.
#[derive(Debug, Clone, Copy)]
pub(super) struct Backoff {
    first: Duration,
    longest: Duration,
    next: Duration,
}

impl Backoff {
    /// From the configured `[first, longest]` in s.
    pub(super) fn new([first_s, longest_s]: [f64; 2]) -> Self {
        let first = Duration::try_from_secs_f64(first_s).unwrap_or(Duration::from_millis(100));
        let longest = Duration::try_from_secs_f64(longest_s).unwrap_or(Duration::from_secs(10)).max(first);
        Self { first, longest, next: first }
    }

    /// The pause after a failure that may pass.
    pub(super) fn pause(&mut self) -> Duration {
        let pause = self.next;
        self.next = (self.next * 2).min(self.longest);
        pause
    }

    /// The pause after a failure that only a change of configuration ends.
    pub(super) fn longest(&mut self) -> Duration {
        self.next = self.longest;
        self.longest
    }

    /// The link has proved itself.
    pub(super) fn reset(&mut self) {
        self.next = self.first;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doubles_up_to_the_longest_and_starts_again() {
        let mut backoff = Backoff::new([0.1, 0.5]);
        let pauses: Vec<u128> = (0..5).map(|_| backoff.pause().as_millis()).collect();
        assert_eq!(pauses, [100, 200, 400, 500, 500]);
        backoff.reset();
        assert_eq!(backoff.pause().as_millis(), 100);
        assert_eq!(backoff.longest().as_millis(), 500);
        assert_eq!(backoff.pause().as_millis(), 500);
    }
}
