//! Validation of the files of a state directory from their text alone; nothing is used or changed.
//! The audit log is checked by [`super::audit::verify`].

use volcomp_state::counters::Counters;

use super::models::store;

/// `counters.json` of machine `machine`.
///
/// # Errors
/// What is wrong with it, in words.
pub fn counters(text: &[u8], machine: &str) -> Result<(), String> {
    Counters::parse(text, machine).map(|_| ())
}

/// `models.json` of machine `machine`.
///
/// # Errors
/// What is wrong with it, in words.
pub fn models(text: &[u8], machine: &str) -> Result<(), String> {
    store::check(text, machine)
}
