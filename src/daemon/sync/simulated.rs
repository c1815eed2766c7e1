//! The same calls under the scheduler of `shuttle`, in virtual time, while [`simulate`] runs; otherwise the real ones.

use std::cell::Cell;
use std::future::Future;
use std::io;
use std::ops::{Deref, DerefMut};
use std::pin::pin;
use std::sync::Arc;
use std::task::Poll;
use std::time::Duration;

use super::{Gone, real};

thread_local! {
    /// Virtual time, ns, while a simulation runs on this thread.
    static NOW_NS: Cell<Option<i64>> = const { Cell::new(None) };
}

/// Time that passes at every point of the schedule, ns.
const POINT_NS: i64 = 1_000_000;

/// Ends the simulation on return and on panic alike.
struct Simulation;

impl Drop for Simulation {
    fn drop(&mut self) {
        NOW_NS.set(None);
    }
}

/// Runs `body` with a scheduler: everything below it is simulated on this thread.
pub(crate) fn simulate(
    scheduler: impl shuttle::scheduler::Scheduler + 'static,
    body: impl Fn() + Send + Sync + 'static,
) -> usize {
    let mut config = shuttle::Config::new();
    config.stack_size = 1 << 20;
    config.max_steps = shuttle::MaxSteps::FailAfter(1_000_000);
    config.silence_warnings = true;
    config.failure_persistence = shuttle::FailurePersistence::None;
    config.ungraceful_shutdown_config.immediately_return_on_panic = true;
    let _simulation = Simulation;
    NOW_NS.set(Some(0));
    shuttle::Runner::new(scheduler, config).run(move || {
        NOW_NS.set(Some(0));
        body();
    })
}

fn is_simulated() -> bool {
    NOW_NS.get().is_some()
}

/// Lets virtual time pass.
fn advance(ns: i64) {
    if let Some(now) = NOW_NS.get() {
        NOW_NS.set(Some(now + ns));
    }
}

pub(crate) fn now_ns() -> i64 {
    NOW_NS.get().unwrap_or_else(real::now_ns)
}

/// A place where another thread may run.
pub(crate) fn point() {
    // a simulation that has failed unwinds through here
    if is_simulated() && !std::thread::panicking() {
        advance(POINT_NS);
        shuttle::thread::yield_now();
    }
}

pub(crate) fn pause(duration: Duration) {
    if !is_simulated() {
        return real::pause(duration);
    }
    let until = now_ns() + i64::try_from(duration.as_nanos()).unwrap_or(i64::MAX);
    while now_ns() < until {
        point();
    }
}

pub(crate) fn spawn(name: &str, body: impl FnOnce() + Send + 'static) -> io::Result<()> {
    if is_simulated() {
        drop(shuttle::thread::spawn(body));
        return Ok(());
    }
    real::spawn(name, body)
}

pub(crate) async fn sleep(duration: Duration) {
    if !is_simulated() {
        return real::sleep(duration).await;
    }
    let until = now_ns() + i64::try_from(duration.as_nanos()).unwrap_or(i64::MAX);
    while now_ns() < until {
        advance(POINT_NS);
        shuttle::future::yield_now().await;
    }
}

pub(crate) async fn timeout<T>(limit: Duration, work: impl Future<Output = T>) -> Result<T, Gone> {
    if !is_simulated() {
        return real::timeout(limit, work).await;
    }
    let until = now_ns() + i64::try_from(limit.as_nanos()).unwrap_or(i64::MAX);
    let mut work = pin!(work);
    std::future::poll_fn(|context| match work.as_mut().poll(context) {
        Poll::Ready(done) => Poll::Ready(Ok(done)),
        Poll::Pending if now_ns() >= until => Poll::Ready(Err(Gone)),
        Poll::Pending => {
            advance(POINT_NS);
            context.waker().wake_by_ref();
            Poll::Pending
        }
    })
    .await
}

pub(crate) async fn spawn_blocking<T: Send + 'static>(
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, Gone> {
    if !is_simulated() {
        return real::spawn_blocking(work).await;
    }
    let slot = Arc::new(std::sync::Mutex::new(None));
    let theirs = Arc::clone(&slot);
    drop(shuttle::thread::spawn(move || {
        point();
        let done = work();
        *theirs.lock().expect("not poisoned") = Some(done);
    }));
    loop {
        let done = slot.lock().expect("not poisoned").take();
        if let Some(done) = done {
            return Ok(done);
        }
        advance(POINT_NS);
        shuttle::future::yield_now().await;
    }
}

/// A mutex; a simulated one is a place where another thread may run, and a deadlock of several is found.
#[derive(Debug)]
pub(crate) struct Mutex<T> {
    order: Option<shuttle::sync::Mutex<()>>,
    value: real::Mutex<T>,
}

impl<T: Default> Default for Mutex<T> {
    fn default() -> Self {
        Self::new(T::default())
    }
}

impl<T> Mutex<T> {
    pub(crate) fn new(value: T) -> Self {
        Self { order: is_simulated().then(|| shuttle::sync::Mutex::new(())), value: real::Mutex::new(value) }
    }

    pub(crate) fn lock(&self) -> MutexGuard<'_, T> {
        let order = match &self.order {
            Some(order) if is_simulated() => {
                Some(order.lock().unwrap_or_else(std::sync::PoisonError::into_inner))
            }
            _ => None,
        };
        MutexGuard { value: Some(self.value.lock()), order, mutex: self }
    }
}

/// A held lock; the value goes before the order.
#[derive(Debug)]
pub(crate) struct MutexGuard<'a, T> {
    value: Option<real::MutexGuard<'a, T>>,
    order: Option<shuttle::sync::MutexGuard<'a, ()>>,
    mutex: &'a Mutex<T>,
}

impl<T> Deref for MutexGuard<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        self.value.as_ref().expect("held")
    }
}

impl<T> DerefMut for MutexGuard<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        self.value.as_mut().expect("held")
    }
}

/// A condition variable.
#[derive(Debug)]
pub(crate) struct Condvar {
    order: Option<shuttle::sync::Condvar>,
    value: real::Condvar,
}

impl Default for Condvar {
    fn default() -> Self {
        Self { order: is_simulated().then(shuttle::sync::Condvar::new), value: real::Condvar::default() }
    }
}

impl Condvar {
    pub(crate) fn wait<'a, T>(&self, mut guard: MutexGuard<'a, T>) -> MutexGuard<'a, T> {
        let mutex = guard.mutex;
        let value = guard.value.take().expect("held");
        match (&self.order, guard.order.take()) {
            (Some(wake), Some(order)) => {
                drop(value);
                let order = wake.wait(order).unwrap_or_else(std::sync::PoisonError::into_inner);
                MutexGuard { value: Some(mutex.value.lock()), order: Some(order), mutex }
            }
            (_, order) => MutexGuard { value: Some(self.value.wait(value)), order, mutex },
        }
    }

    pub(crate) fn notify_all(&self) {
        match &self.order {
            Some(wake) if is_simulated() => wake.notify_all(),
            _ => self.value.notify_all(),
        }
    }
}
