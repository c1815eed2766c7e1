//! The arguments of `volcompd`, and its exit codes.

use crate::prelude::*;
use volcomp_daemon::{DaemonError, LogError};

/// Compensates the geometric errors of one machine tool: connects to its control and answers every position with
/// the origin offset that takes the error out. A quality function, not a safety function.
///
/// SIGTERM and SIGINT take the offset to its rest value, close the link and end the daemon; SIGHUP changes nothing.
#[derive(Debug, clap::Parser)]
#[command(name = "volcompd", version)]
pub(super) struct Args {
    /// The machine file; the model it names is taken relative to it.
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
}

pub(super) fn run(args: &Args) -> Result<()> {
    volcomp_daemon::run(&args.config).map_err(|error| Failure::new(exit_code(&error), &error))
}

const fn exit_code(error: &DaemonError) -> u8 {
    match error {
        DaemonError::Load(e) if e.is_io() => EX_IOERR,
        DaemonError::Load(_) | DaemonError::Log(LogError::Level { .. }) => EX_CONFIG,
        DaemonError::Log(LogError::Journald(_))
        | DaemonError::Socket(_)
        | DaemonError::Listen { .. }
        | DaemonError::System { .. } => EX_IOERR,
        DaemonError::Log(LogError::Taken(_))
        | DaemonError::CycleThread { .. }
        | DaemonError::Internal { .. } => EX_SOFTWARE,
    }
}
