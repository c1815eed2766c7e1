//! `check`: placeholder.

use super::Failure;

/// Placeholder.
#[derive(Debug, clap::Parser)]
pub(super) struct Args {}

pub(super) fn run(_args: &Args) -> Result<(), Failure> {
    Err(Failure::new(super::EX_SOFTWARE, "not written yet"))
}
