//! Who did what, when, why, and with which model: one line each, chained by hashes, never changed.
//!
//! [`chain`] is the file and its proof.

pub mod chain;

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::bounded_read::read_regular;

pub use chain::{Broken, Line, Summary, head_path, verify, verify_with};

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

/// Largest user list that is searched, bytes.
const USERS_BYTES_MAX: u64 = 1 << 20;

/// Name of a user id in the system's user list.
fn user_name(uid: u32) -> Option<String> {
    let bytes = read_regular(Path::new("/etc/passwd"), USERS_BYTES_MAX).ok()?;
    let text = String::from_utf8_lossy(&bytes);
    text.lines().find_map(|line| {
        let mut fields = line.split(':');
        let (name, _, id) = (fields.next()?, fields.next()?, fields.next()?);
        (id.parse() == Ok(uid)).then(|| name.to_owned())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_user_is_named_as_in_the_list_of_the_system() {
        let list = std::fs::read_to_string("/etc/passwd").expect("a list of users");
        let first: Vec<&str> = list.lines().next().expect("a user").split(':').collect();
        let uid = first[2].parse().expect("a number");
        let who = Who::client(Some(uid), Some(7));
        assert_eq!((who.uid, who.name.as_deref(), who.pid), (Some(uid), Some(first[0]), Some(7)));
        assert_eq!(Who::client(None, None), Who::default());
    }

    #[test]
    fn the_daemon_names_itself_and_its_process() {
        let who = Who::daemon();
        assert_eq!((who.uid, who.name.as_deref()), (None, Some("volcompd")));
        assert_eq!(who.pid, i32::try_from(std::process::id()).ok());
    }
}
