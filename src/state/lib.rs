//! The state directory: what outlives a restart of the daemon, and how it is read back fail-closed.
//!
//! - [`counters`]: `counters.json` with the operator's last orders and the latched fault ([`counters::RetainedState`]), and
//!   [`counters::recall`], which tells a first start from a known and an unknown state.
//! - [`models`]: `models.json` and the model files in `models/`.
//! - [`audit`]: `audit.jsonl`, chained by hashes.
//! - [`disk`]: the file operations behind all of them; `tests/support/memory_disk.rs` is a disk with faults.
//! - [`bounded_read`]: files of a bounded size. [`utc`]: time as text.
//!
//! Nothing here depends on the rest of volcomp. Reading order: `disk`, `counters`, `models`, `audit`.

// eager arguments with a cost or an effect; for `then_some` no lint exists
#![warn(clippy::or_fun_call)]
#![expect(clippy::disallowed_methods, reason = "files and the clock are this crate's subject")]

pub mod audit;
pub mod bounded_read;
pub mod counters;
pub mod disk;
pub mod models;
pub mod utc;

// the file included names this crate as others do
#[cfg(test)]
extern crate self as volcomp_state;
#[cfg(test)]
#[path = "tests/support/memory_disk.rs"]
mod memory_disk;
