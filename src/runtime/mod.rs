//! The shell around the core: sockets, the cycle thread, and the service beside it.
//!
//! Two threads, and nothing shared between them that could make the cycle wait:
//!
//! - the **cycle thread** ([`worker`]) connects ([`link`]), shakes hands ([`handshake`]) and cycles ([`cycle`])
//!   on a blocking socket. Between link-up and link-down it allocates nothing, takes no lock, writes no log and
//!   touches no disk; what it has to say goes by `try_send` into bounded channels, or is dropped and counted.
//! - the **service thread** ([`daemon`], tokio) drains these channels ([`service`]), logs ([`logging`]), keeps the
//!   statistics ([`board`]), answers the status socket ([`server`]), handles signals and feeds systemd ([`notify`]).
//!
//! [`ports`] is everything that passes between the two. [`body`] is the cycle without its socket and clock, for
//! tests that count allocations. Reading order: `ports`, `body`, `link`, `cycle`, `worker`, `service`, `daemon`.

#![expect(
    clippy::disallowed_methods,
    reason = "the runtime is the shell: clocks, files, sockets and threads"
)]

mod age;
mod backoff;
mod board;
mod body;
pub mod client;
mod clock;
mod cycle;
mod daemon;
mod handshake;
mod link;
mod load;
mod logging;
mod notices;
mod notify;
mod ports;
mod realtime;
mod server;
mod service;
mod status;
mod worker;

pub use body::{CycleBody, Reaction};
pub use daemon::{DaemonError, run};
pub use load::{LoadError, Loaded, load, load_config};
pub use logging::LogError;
pub use server::SocketError;
pub use status::{Fault, LinkStatus, RealtimeStatus, Status};
