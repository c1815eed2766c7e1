//! The way into the audit log for whoever has something to write; [`super::state_writer`] appends and syncs.

use std::sync::Arc;

use super::write_queue::WriteQueue;

pub use volcomp_state::audit::*;

/// An entry of the daemon's own.
pub(super) fn own(what: &str, result: &str) -> AuditEntry {
    AuditEntry {
        who: Who::daemon(),
        what: what.to_owned(),
        result: result.to_owned(),
        ..AuditEntry::default()
    }
}

/// The way into the audit log.
#[derive(Debug, Clone, Default)]
pub struct Audit {
    write_queue: Option<Arc<WriteQueue>>,
}

impl Audit {
    pub(super) const fn new(write_queue: Arc<WriteQueue>) -> Self {
        Self { write_queue: Some(write_queue) }
    }

    /// Passes an entry on to be written; false (and counted) where there is no audit log or its queue is full. Never
    /// waits for the disk.
    pub(super) fn write(&self, entry: AuditEntry) -> bool {
        self.write_queue.as_ref().is_some_and(|write_queue| write_queue.audit(entry))
    }

    /// Entries that found the queue full, or that the disk did not take.
    #[must_use]
    pub(super) fn lost(&self) -> u64 {
        self.write_queue.as_ref().map_or(0, |write_queue| write_queue.lost())
    }
}
