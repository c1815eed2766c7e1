//! The shell around the core: sockets, the cycle thread, and the service beside it.
//!
//! Two threads, and nothing shared between them that could make the cycle wait:
//!
//! - the **cycle thread** ([`worker`]) connects ([`link`]), shakes hands ([`handshake`]) and cycles ([`cycle`])
//!   on a blocking socket. Between link-up and link-down it allocates nothing, takes no lock, writes no log and
//!   touches no disk; what it has to say goes by `try_send` into bounded channels, or is dropped and counted.
//! - the **service thread** ([`daemon`], tokio) drains these channels ([`service`]), logs ([`logging`]), keeps the
//!   statistics ([`board`], [`latency`]), answers the status socket ([`server`], [`socket`], [`orders`]), looks after the models ([`models`]), handles signals and feeds systemd ([`notify`]).
//!
//! - the **estimator** ([`sensors`]) is a thread that learns from sensors what the model does not know; the cycle only
//!   evaluates what it has finished.
//!
//! - the **recorder** and the **keeper** ([`recorder`], [`keeper`] with [`audit`] and [`counters`]) are threads that may
//!   wait for the disk, so that nobody else has to. [`replay`] runs what was recorded through the same [`body`].
//!
//! [`ports`] is everything that passes between the two. [`body`] is the cycle without its socket and clock, for
//! tests that count allocations. Reading order: `ports`, `body`, `link`, `cycle`, `worker`, `service`, `daemon`.

// eager arguments with a cost or an effect; for `then_some` no lint exists
#![warn(clippy::or_fun_call)]
#![expect(
    clippy::disallowed_methods,
    reason = "the runtime is the shell: clocks, files, sockets and threads"
)]

mod age;
mod arrivals;
pub mod audit;
mod backoff;
mod board;
mod body;
pub mod client;
mod clock;
mod control;
mod counters;
mod cycle;
mod daemon;
mod handshake;
mod inbox;
mod keeper;
pub mod kept;
mod latency;
mod link;
mod link_end;
mod load;
mod logging;
pub mod models;
mod notices;
mod notify;
mod orders;
mod ports;
mod realtime;
mod recorder;
mod rehearsal;
pub mod replay;
#[cfg(test)]
mod sealed;
mod sensor_status;
pub mod sensors;
mod server;
mod service;
mod signals;
#[cfg(test)]
mod simulation;
pub mod socket;
mod status;
mod sync;
mod tls;
mod worker;

pub use body::{CycleBody, Reaction};
pub use daemon::{DaemonError, run, socket_path};
pub use latency::{Bins, Histograms};
pub use load::{LoadError, Loaded, load, load_config, with_additions};
pub use logging::LogError;
pub use recorder::{ModelTexts, Tap, answer_of, command_of, request_of, tap};
pub use rehearsal::{Rehearsal, RehearsalError, rehearse};
pub use sensors::{
    EstimatorEnd, FilterStatus, GrowthStatus, LiveEnd, MapStatus, Motion, NodeStatus, SensorStatus, live_ends,
};
pub use server::SocketError;
pub use status::{Fault, Lifetime, LinkStatus, RealtimeStatus, RecordingStatus, Status};
pub use tls::{Identity, TlsFileError, identity};
pub use volcomp_state::bounded_read;
