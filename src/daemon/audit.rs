//! The way into the audit log for whoever has something to write; [`super::keeper`] appends and syncs.

use std::sync::Arc;

use super::inbox::Inbox;

pub use volcomp_state::audit::*;

/// The way into the audit log.
#[derive(Debug, Clone, Default)]
pub struct Audit {
    inbox: Option<Arc<Inbox>>,
}

impl Audit {
    pub(super) const fn new(inbox: Arc<Inbox>) -> Self {
        Self { inbox: Some(inbox) }
    }

    /// Passes an entry on to be written; false (and counted) where there is no audit log or its queue is full. Never
    /// waits for the disk.
    pub(super) fn write(&self, entry: AuditEntry) -> bool {
        self.inbox.as_ref().is_some_and(|inbox| inbox.audit(entry))
    }

    /// Entries that found the queue full, or that the disk did not take.
    #[must_use]
    pub(super) fn lost(&self) -> u64 {
        self.inbox.as_ref().map_or(0, |inbox| inbox.lost())
    }
}
