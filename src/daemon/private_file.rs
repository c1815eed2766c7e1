//! Files with a secret: who may read them.

use std::fs::Metadata;
use std::os::unix::fs::MetadataExt;

/// Permissions that are too wide: those found, and the most that is allowed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Exposed {
    pub(super) mode: u32,
    pub(super) allowed: u32,
}

/// Only its owner may read a secret; where that is root, a group may read it too, because the service is not root.
pub(super) fn check(metadata: &Metadata) -> Result<(), Exposed> {
    let mode = metadata.mode() & 0o7777;
    let allowed = if metadata.uid() == 0 { 0o640 } else { 0o600 };
    // execution bits open nothing
    if mode & 0o777 & !(allowed | 0o111) == 0 { Ok(()) } else { Err(Exposed { mode, allowed }) }
}
