//! The one place for a model that is being read and compared: several at once would take the memory of the machine.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::AcqRel, Ordering::Release};

use crate::sync;

/// The place, held. It is given back on drop; no lock is taken there.
#[derive(Debug)]
pub(super) struct ExclusiveAccess(Arc<AtomicBool>);

impl ExclusiveAccess {
    /// Takes the place; `None` where somebody else has it.
    pub(super) fn take(taken: Arc<AtomicBool>) -> Option<Self> {
        sync::point();
        if taken.swap(true, AcqRel) {
            return None;
        }
        // a value exists only where the place was taken by it: what is refused has nothing to give back
        Some(Self(taken))
    }
}

impl Drop for ExclusiveAccess {
    fn drop(&mut self) {
        sync::point();
        self.0.store(false, Release);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::Ordering::Relaxed;

    use super::*;

    #[test]
    fn a_refused_turn_neither_waits_nor_ends_that_of_another() {
        let place = Arc::new(AtomicBool::new(false));
        let first = ExclusiveAccess::take(Arc::clone(&place)).expect("free");
        assert!(ExclusiveAccess::take(Arc::clone(&place)).is_none());
        assert!(place.load(Relaxed), "still the first one's");
        assert!(ExclusiveAccess::take(Arc::clone(&place)).is_none());
        drop(first);
        assert!(ExclusiveAccess::take(place).is_some());
    }
}
