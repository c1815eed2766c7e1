//! Queue of audit entries and counters between the service and the state writer thread.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use volcomp_state::audit::AuditEntry;
use volcomp_state::counters::Counters;

use super::sync::{Condvar, Mutex};

/// Audit entries that wait for the disk.
const QUEUE: usize = 256;

/// What waits for the disk.
#[derive(Debug, Default)]
pub(super) struct WriteQueue {
    pub(super) waiting: Mutex<Waiting>,
    pub(super) wake: Condvar,
    pub(super) lost: AtomicU64,
}

#[derive(Debug, Default)]
pub(super) struct Waiting {
    /// The newest counters; older ones are superseded.
    pub(super) counters: Option<Box<Counters>>,
    /// Number of the newest counters handed over.
    pub(super) asked: u64,
    /// Number of the newest counters that are durable.
    pub(super) saved: u64,
    /// Number of the newest counters that the disk refused, and why.
    pub(super) refused: (u64, String),
    pub(super) audit: VecDeque<AuditEntry>,
    /// Nothing more comes.
    pub(super) end: bool,
    pub(super) ended: bool,
    /// Why audit log and counters are not kept at present.
    pub(super) problems: [Option<String>; 2],
}

/// What has become of counters that were handed over.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Saved {
    /// They are durable.
    Yes,
    /// They are on their way.
    Waiting,
    /// They are not kept: why.
    No(String),
    /// There is no state directory.
    Nowhere,
}

impl WriteQueue {
    /// Queues an entry; false and counted where the queue is full.
    pub(super) fn audit(&self, entry: AuditEntry) -> bool {
        let mut waiting = self.waiting.lock();
        if waiting.audit.len() >= QUEUE || waiting.end {
            self.lost.fetch_add(1, Relaxed);
            return false;
        }
        waiting.audit.push_back(entry);
        drop(waiting);
        self.wake.notify_all();
        true
    }

    /// Entries that were not written.
    pub(super) fn lost(&self) -> u64 {
        self.lost.load(Relaxed)
    }

    pub(super) fn save(&self, counters: Counters) -> u64 {
        let mut waiting = self.waiting.lock();
        waiting.asked += 1;
        waiting.counters = Some(Box::new(counters));
        let number = waiting.asked;
        drop(waiting);
        self.wake.notify_all();
        number
    }

    pub(super) fn saved(&self, number: u64) -> Saved {
        let waiting = self.waiting.lock();
        if waiting.saved >= number {
            Saved::Yes
        } else if waiting.refused.0 >= number {
            Saved::No(waiting.refused.1.clone())
        } else if waiting.ended {
            Saved::No("the thread that writes has ended".to_owned())
        } else {
            Saved::Waiting
        }
    }

    /// The next job; counters first, because orders and faults wait for them.
    pub(super) fn next(&self) -> Option<WriteRequest> {
        let mut waiting = self.waiting.lock();
        loop {
            if let Some(counters) = waiting.counters.take() {
                return Some(WriteRequest::Counters(waiting.asked, counters));
            }
            if let Some(entry) = waiting.audit.pop_front() {
                return Some(WriteRequest::Audit(entry));
            }
            if waiting.end {
                return None;
            }
            waiting = self.wake.wait(waiting);
        }
    }
}

/// Something to be kept.
pub(super) enum WriteRequest {
    Audit(AuditEntry),
    Counters(u64, Box<Counters>),
}
