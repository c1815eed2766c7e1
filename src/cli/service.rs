//! `status`, `enable`, `disable`: talk to a running daemon.

use super::Failure;

/// Placeholder.
#[derive(Debug, clap::Parser)]
pub(super) struct StatusArgs {}

/// Placeholder.
#[derive(Debug, clap::Parser)]
pub(super) struct CommandArgs {}

pub(super) fn status(_args: &StatusArgs) -> Result<(), Failure> {
    Err(Failure::new(super::EX_SOFTWARE, "not written yet"))
}

pub(super) fn enable(_args: &CommandArgs) -> Result<(), Failure> {
    Err(Failure::new(super::EX_SOFTWARE, "not written yet"))
}

pub(super) fn disable(_args: &CommandArgs) -> Result<(), Failure> {
    Err(Failure::new(super::EX_SOFTWARE, "not written yet"))
}
