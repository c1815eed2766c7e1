//! Health of live estimation on its way into recordings: the newest word, put by the estimator, taken by the recorder.

use std::sync::{Mutex, PoisonError};

use volcomp_units::MonoTime;

/// The newest word that has not been recorded. Never locked by the cycle.
#[derive(Debug, Default)]
pub(crate) struct HealthSlot(Mutex<Option<(MonoTime, String)>>);

impl HealthSlot {
    /// A newer word; one that was not taken is of no use any more.
    pub(crate) fn put(&self, now: MonoTime, text: String) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some((now, text));
    }

    pub(super) fn take(&self) -> Option<(MonoTime, String)> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}
