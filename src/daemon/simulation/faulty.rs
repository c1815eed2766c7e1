//! The defect that this simulation must find: a refused turn that gives back what it never had, under the lock.

use crate::service::Service;
use crate::sync::{Mutex, pause};

/// The turn as it once was: the value is built before it is known whether the turn was taken.
struct FaultyTurn<'a>(&'a Mutex<Service>);

impl<'a> FaultyTurn<'a> {
    fn take(service: &'a Mutex<Service>) -> Option<Self> {
        (!service.lock().loading().swap(true, std::sync::atomic::Ordering::Relaxed)).then_some(Self(service))
    }
}

impl Drop for FaultyTurn<'_> {
    fn drop(&mut self) {
        self.0.lock().loading().store(false, std::sync::atomic::Ordering::Relaxed);
    }
}

/// A load with that turn.
pub(super) fn load(service: &Mutex<Service>) {
    let Some(_turn) = FaultyTurn::take(service) else { return };
    pause(core::time::Duration::from_millis(50));
}
