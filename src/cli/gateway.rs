//! `gateway`: the status for shop-floor systems.

use std::sync::Arc;

use super::status::{machine, socket_of};
use crate::prelude::*;
use volcomp_gateway::GatewayError;

/// Publish the status by MQTT and as an MTConnect adapter (SHDR), read-only, until stopped
///
/// The machine file of the daemon says where: section `mqtt` with `broker`, section `mtconnect` with `listen`; both are off by default. It is
/// a process of its own, which asks the daemon's status socket, so that the cycle does not know of it.
///
/// Example:
///
///   volcomp gateway --config /etc/volcomp/machine.toml
#[derive(Debug, clap::Parser)]
pub(super) struct Args {
    /// The daemon's machine file.
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
    /// The daemon's socket [default: that of the machine file].
    #[arg(long, value_name = "PATH")]
    socket: Option<PathBuf>,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let config = machine(&args.config)?;
    let socket = match &args.socket {
        Some(socket) => socket.clone(),
        None => socket_of(&args.config, &config)?,
    };
    volcomp_gateway::run(&config, &args.config, socket, Arc::new(|line| note!("{line}"))).map_err(|error| {
        let code = match error {
            GatewayError::NothingToDo { .. } => EX_CONFIG,
            GatewayError::Listen { .. } | GatewayError::Password { .. } | GatewayError::System(_) => EX_IOERR,
        };
        Failure::new(code, error)
    })
}
