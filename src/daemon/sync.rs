//! Locks, threads, waiting and the clock of the service: the one door to what decides the order of its threads.
//!
//! In a test the same calls run under the scheduler of `shuttle` where `simulated` is switched on, so that orders,
//! links, stops, kills and disk faults are tried in many orders that can be repeated.

#[cfg(test)]
pub(super) mod simulated;

#[cfg(test)]
pub(super) use simulated::{Condvar, Mutex, now_ns, pause, point, sleep, spawn, spawn_blocking, timeout};

#[cfg(not(test))]
pub(super) use real::{Condvar, Mutex, now_ns, pause, point, sleep, spawn, spawn_blocking, timeout};

/// A time limit has passed, or the work has panicked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Gone;

mod real {
    use std::future::Future;
    use std::io;
    use std::sync::{OnceLock, PoisonError};
    use std::time::{Duration, Instant};

    use super::Gone;

    pub(crate) use std::sync::MutexGuard;

    /// A mutex that goes on after a panic of its holder.
    #[derive(Debug, Default)]
    pub(crate) struct Mutex<T>(std::sync::Mutex<T>);

    impl<T> Mutex<T> {
        pub(crate) const fn new(value: T) -> Self {
            Self(std::sync::Mutex::new(value))
        }

        pub(crate) fn lock(&self) -> MutexGuard<'_, T> {
            self.0.lock().unwrap_or_else(PoisonError::into_inner)
        }
    }

    /// A condition variable.
    #[derive(Debug, Default)]
    pub(crate) struct Condvar(std::sync::Condvar);

    impl Condvar {
        pub(crate) fn wait<'a, T>(&self, guard: MutexGuard<'a, T>) -> MutexGuard<'a, T> {
            self.0.wait(guard).unwrap_or_else(PoisonError::into_inner)
        }

        pub(crate) fn notify_all(&self) {
            self.0.notify_all();
        }
    }

    /// Nanoseconds since the first call.
    pub(crate) fn now_ns() -> i64 {
        static ORIGIN: OnceLock<Instant> = OnceLock::new();
        i64::try_from(ORIGIN.get_or_init(Instant::now).elapsed().as_nanos()).unwrap_or(i64::MAX)
    }

    /// A place where a simulation may let another thread run.
    #[inline]
    #[cfg(not(test))]
    pub(crate) const fn point() {}

    /// Sleeps on a thread of its own.
    pub(crate) fn pause(duration: Duration) {
        std::thread::sleep(duration);
    }

    /// Starts a thread that nobody joins.
    pub(crate) fn spawn(name: &str, body: impl FnOnce() + Send + 'static) -> io::Result<()> {
        std::thread::Builder::new().name(name.to_owned()).spawn(body).map(|_| ())
    }

    /// Waits without keeping the thread.
    pub(crate) async fn sleep(duration: Duration) {
        tokio::time::sleep(duration).await;
    }

    /// Waits for `work`, no longer than `limit`.
    pub(crate) async fn timeout<T>(limit: Duration, work: impl Future<Output = T>) -> Result<T, Gone> {
        tokio::time::timeout(limit, work).await.map_err(|_| Gone)
    }

    /// Runs work that takes its time on a thread of its own.
    pub(crate) async fn spawn_blocking<T: Send + 'static>(
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, Gone> {
        tokio::task::spawn_blocking(work).await.map_err(|_| Gone)
    }
}
