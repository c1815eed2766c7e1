//! `cncsim measure diagonals`.

use crate::cli::{EX_SOFTWARE, Failure};

#[derive(Debug, clap::Args)]
pub(super) struct Args {}

pub(super) fn run(_args: &Args) -> Result<(), Failure> {
    Err(Failure::new(EX_SOFTWARE, "not there yet"))
}
