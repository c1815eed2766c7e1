//! The time of the estimator: the computer's, or that of a simulated control, whose cycle then waits for the estimator.
//!
//! With the control's time nothing depends on how fast computer and simulation are: a reading counts from the frame before
//! it, and a frame is answered when the estimator has seen it and all readings before it.

use core::sync::atomic::{AtomicI64, Ordering};
use core::time::Duration;
use std::sync::Arc;
use std::time::Instant;

use crossbeam_channel::{Receiver, Sender, bounded};

use super::super::clock::Clock;
use volcomp_units::MonoTime;

/// How long a frame waits for the estimator; then it is answered all the same.
const PATIENCE: Duration = Duration::from_secs(5);

/// The clock of the estimator and of arrivals.
#[derive(Debug, Clone)]
pub(crate) enum EstimatorTime {
    /// The daemon's own.
    Computer(Clock),
    /// That of the newest frame.
    Control(Arc<AtomicI64>),
}

impl EstimatorTime {
    pub(crate) fn now(&self) -> MonoTime {
        match self {
            Self::Computer(clock) => clock.now(),
            Self::Control(ns) => MonoTime::from_ns(ns.load(Ordering::Acquire)),
        }
    }
}

/// The cycle's end.
#[derive(Debug)]
pub(super) struct CycleLockStep {
    time: Arc<AtomicI64>,
    /// Time of the frame up to which the estimator has worked.
    done: Receiver<i64>,
    /// Clock of the control and the estimator's time where the link came up.
    begin: Option<(i64, i64)>,
}

/// The estimator's end.
#[derive(Debug)]
pub struct EstimatorLockStep {
    time: Arc<AtomicI64>,
    done: Sender<i64>,
}

/// Both ends.
pub(super) fn lock_step() -> (CycleLockStep, EstimatorLockStep) {
    let time = Arc::new(AtomicI64::new(0));
    let (sender, done) = bounded(16);
    (CycleLockStep { time: Arc::clone(&time), done, begin: None }, EstimatorLockStep { time, done: sender })
}

impl CycleLockStep {
    /// Time goes on from here with another clock.
    pub(super) const fn link_up(&mut self) {
        self.begin = None;
    }

    /// A frame of the control: its time for the estimator, never before that of the last one.
    pub(super) fn frame(&mut self, control_ns: i64) -> MonoTime {
        let last = self.time.load(Ordering::Relaxed);
        let (clock, time) = *self.begin.get_or_insert((control_ns, last));
        let now = time.saturating_add(control_ns.saturating_sub(clock)).max(last);
        self.time.store(now, Ordering::Release);
        MonoTime::from_ns(now)
    }

    /// Waits until the estimator has worked up to this frame.
    pub(super) fn wait(&self, now: MonoTime) {
        let until = Instant::now() + PATIENCE;
        // of a frame that was given up the word may still come
        while self.done.recv_deadline(until).is_ok_and(|done| done < now.ns) {}
    }
}

impl EstimatorLockStep {
    pub(super) fn time(&self) -> EstimatorTime {
        EstimatorTime::Control(Arc::clone(&self.time))
    }

    /// The estimator has worked up to the frame of this time.
    pub(super) fn tell(&self, now: MonoTime) {
        // one is on the way, and those that the cycle has given up
        let _ = self.done.try_send(now.ns);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_is_the_controls_and_goes_on_over_a_new_link() {
        let (mut cycle, estimator) = lock_step();
        let time = estimator.time();
        let ns = |cycle: &mut CycleLockStep, control| cycle.frame(control).ns;
        assert_eq!([7_000, 7_010, 7_005, 7_030].map(|t| ns(&mut cycle, t)), [0, 10, 10, 30]);
        assert_eq!(time.now().ns, 30);
        cycle.link_up();
        assert_eq!([100, 120].map(|t| ns(&mut cycle, t)), [30, 50]);
    }

    #[test]
    fn a_frame_waits_for_its_own_word() {
        let (mut cycle, estimator) = lock_step();
        let given_up = cycle.frame(10);
        estimator.tell(given_up);
        let now = cycle.frame(20);
        let teller = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(20));
            estimator.tell(now);
        });
        let begin = Instant::now();
        cycle.wait(now);
        assert!(begin.elapsed() >= Duration::from_millis(15), "not the word of the frame before");
        assert!(teller.join().is_ok());
    }
}
