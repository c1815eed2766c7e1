//! What can go wrong at the control, and what it notices on the link.

use core::net::SocketAddr;
use core::time::Duration;
use std::io;

use volcomp_protocol::{CloseReason, ErrorCode, FrameError, Name};
use volcomp_units::axes::AxisName;

use super::config::ConfigError;
use super::wire::Insecure;

/// Why a control cannot run.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the fields are what the message prints")]
pub enum ControlError {
    /// A configuration that makes no sense.
    #[error("control: {0}")]
    Config(#[from] ConfigError),
    /// The port is in use.
    #[error("address {address} is in use; stop the other control or choose another port with --listen")]
    InUse { address: SocketAddr },
    /// The socket cannot be set up.
    #[error("cannot listen on {address}: {source}")]
    Listen { address: SocketAddr, source: io::Error },
    /// Nobody came.
    #[error("no daemon connected within {waited:?}; start volcompd with this address")]
    NoDaemon { waited: Duration },
    /// The motion does not start where the machine stands.
    #[error(
        "motion starts with axis {axis} at {start}, but the machine stands at {stands}; move it there first"
    )]
    Start { axis: AxisName, start: f64, stands: f64 },
    /// The observer gave up, for instance because a file cannot be written.
    #[error("{0}")]
    Observer(io::Error),
}

/// Something that happened on the link.
#[derive(Debug, Clone, PartialEq)]
pub enum LinkEvent {
    /// A daemon is connected.
    Connected {
        /// Where it is.
        peer: SocketAddr,
        /// What it is.
        software: Name,
    },
    /// A connection was refused.
    Refused {
        /// Who asked.
        peer: SocketAddr,
        /// What it was told.
        code: ErrorCode,
        /// Why.
        detail: Name,
    },
    /// A connection that did not become secure.
    Insecure {
        /// Who asked.
        peer: SocketAddr,
        /// Why.
        why: Insecure,
    },
    /// The daemon left in order.
    Closed {
        /// Why.
        reason: CloseReason,
    },
    /// The daemon reported an error and left.
    ErrorReceived {
        /// Which.
        code: ErrorCode,
        /// A word about it.
        detail: Name,
    },
    /// The link was ended by the control.
    Ended(LinkEnd),
}

/// Why a link ended without a close.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum LinkEnd {
    /// Bytes that are no frame.
    #[error("bytes that are not a frame: {0}")]
    BadFrame(FrameError),
    /// A message at a moment when it is not expected.
    #[error("a message that is not expected here")]
    Unexpected,
    /// End of stream.
    #[error("the daemon is gone")]
    EndOfStream,
    /// Nothing heard.
    #[error("the daemon is silent")]
    Silence,
    /// The operating system reports an error.
    #[error("{0}")]
    Io(io::ErrorKind),
}

impl core::fmt::Display for LinkEvent {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Connected { peer, software } => write!(f, "daemon connected from {peer}: {software}"),
            Self::Refused { peer, code, detail } => write!(f, "refused {peer}: {code:?} ({detail})"),
            Self::Insecure { peer, why } => write!(f, "refused {peer}: {why}"),
            Self::Closed { reason } => write!(f, "daemon left in order: {reason:?}"),
            Self::ErrorReceived { code, detail } => write!(f, "daemon reports an error: {code:?} ({detail})"),
            Self::Ended(end) => write!(f, "link ended: {end}"),
        }
    }
}
