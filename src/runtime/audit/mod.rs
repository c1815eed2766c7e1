//! Who did what, when, why, and with which model: one line each, chained by hashes, never changed.
//!
//! [`chain`] is the file and its proof; this is what the daemon writes through: [`Audit::write`] passes an entry to
//! the [`super::keeper`], which appends and syncs off every thread that must not wait.

pub mod chain;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use crossbeam_channel::Sender;
use serde::{Deserialize, Serialize};

use super::keeper::Job;

pub use chain::{Broken, Line, Summary, head_path, verify, verify_file, verify_with};

/// Name of the audit log in the state directory.
pub const AUDIT_FILE: &str = "audit.jsonl";

/// Who did it.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Who {
    /// User id of the client of the status socket; `null` for the daemon itself.
    pub uid: Option<u32>,
    /// Its name, where the system's user list has one.
    pub name: Option<String>,
    /// Its process id.
    pub pid: Option<i32>,
}

/// What is written about one event.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct AuditEntry {
    /// Who did it.
    pub who: Who,
    /// What: `start stop enable disable clear-fault model fault ..`.
    pub what: String,
    /// Why, in the words of who did it.
    pub why: Option<String>,
    /// Hash of the model before, where it changed.
    pub old_model: Option<String>,
    /// Hash of the model afterwards (or now).
    pub new_model: Option<String>,
    /// What came of it.
    pub result: String,
    /// Anything else, in words.
    pub detail: Option<String>,
}

/// The way into the audit log.
#[derive(Debug, Clone, Default)]
pub struct Audit {
    sender: Option<Sender<Job>>,
    lost: Arc<AtomicU64>,
}

impl Who {
    /// A client of the status socket by its credentials.
    #[must_use]
    pub fn client(uid: Option<u32>, pid: Option<i32>) -> Self {
        Self { uid, name: uid.and_then(user_name), pid }
    }

    /// The daemon itself.
    #[must_use]
    pub fn daemon() -> Self {
        Self { uid: None, name: Some("volcompd".to_owned()), pid: i32::try_from(std::process::id()).ok() }
    }
}

impl Audit {
    pub(super) fn new(sender: Sender<Job>) -> Self {
        Self { sender: Some(sender), lost: Arc::default() }
    }

    /// Passes an entry on to be written; false (and counted) where there is no audit log or its queue is full. Never
    /// waits.
    pub fn write(&self, entry: AuditEntry) -> bool {
        let Some(sender) = &self.sender else { return false };
        let sent = sender.try_send(Job::Audit(Box::new(entry))).is_ok();
        if !sent {
            self.lost.fetch_add(1, Relaxed);
        }
        sent
    }

    /// Entries that found the queue full, or that the disk did not take.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost.load(Relaxed)
    }

    /// The counter of them, for the thread that writes.
    pub(super) fn losses(&self) -> Arc<AtomicU64> {
        Arc::clone(&self.lost)
    }
}

/// Name of a user id in the system's user list.
fn user_name(uid: u32) -> Option<String> {
    let text = std::fs::read_to_string("/etc/passwd").ok()?;
    text.lines().find_map(|line| {
        let mut fields = line.split(':');
        let (name, _, id) = (fields.next()?, fields.next()?, fields.next()?);
        (id.parse() == Ok(uid)).then(|| name.to_owned())
    })
}
