//! The shell around the core: sockets, the cycle thread, and the service beside it.
//!
//! Two threads, and nothing shared between them that could make the cycle wait:
//!
//! - the **cycle thread** ([`worker`]) connects ([`connection`], [`link`] and its two drivers), shakes hands ([`handshake`]) and cycles ([`cycle`])
//!   on a blocking socket. Between link-up and link-down it allocates nothing, takes no lock, writes no log and
//!   touches no disk; what it has to say goes by `try_send` into bounded channels, or is dropped and counted.
//! - the **service thread** ([`daemon`], tokio) drains these channels ([`service`]), logs ([`logging`]), keeps the
//!   statistics ([`status_collector`], [`latency`]), answers the status socket ([`server`], [`socket`],
//!   [`command_handler`]), looks after the models ([`models`]), handles signals and feeds systemd ([`notify`]).
//!
//! - the **estimator** ([`sensors`]) is a thread that learns from sensors what the model does not know; the cycle only
//!   evaluates what it has finished.
//!
//! - the **recorder** and the **state writer** ([`recorder`], [`state_writer`] with [`audit`] and [`counters`]) are
//!   threads that may wait for the disk, so that nobody else has to. [`replay`] runs what was recorded through the
//!   same [`link_session`].
//!
//! - the **HTTP service** ([`http`]), where the machine file asks for it, is a thread that shows snapshots; its commands
//!   go to the service thread and from there the way of those of the status socket.
//!
//! [`channels`] is everything that passes between the two. [`link_session`] is the cycle without its socket and
//! clock, for tests that count allocations. Reading order: `channels`, `link_session`, `link`, `cycle`, `worker`,
//! `service`, `daemon`.

// eager arguments with a cost or an effect; for `then_some` no lint exists
#![warn(clippy::or_fun_call)]
#![expect(
    clippy::disallowed_methods,
    reason = "the runtime is the shell: clocks, files, sockets and threads"
)]

mod age;
pub mod audit;
mod backoff;
mod benefit;
mod channels;
pub mod client;
mod clock;
mod command_handler;
mod connection;
mod control;
mod counters;
mod cycle;
mod cycle_time;
mod daemon;
mod frame_link;
mod handshake;
mod health;
mod http;
mod latency;
mod link;
mod link_end;
mod link_session;
mod load;
mod logging;
mod model_errors;
pub mod models;
mod notify;
mod poll_schedule;
mod private_file;
mod rate_limited_warnings;
mod read_write_link;
mod realtime;
mod recent;
mod recorder;
pub mod replay;
#[cfg(test)]
mod seccomp_tests;
mod self_benchmark;
mod sensor_status;
pub mod sensors;
mod server;
mod service;
mod signals;
#[cfg(test)]
mod simulation;
pub mod socket;
pub mod state_validation;
mod state_writer;
mod status;
mod status_collector;
mod sync;
mod tls;
mod worker;
mod write_queue;

pub use benefit::BenefitStatus;
pub use daemon::{DaemonError, run, socket_path};
pub use health::Health;
pub use http::{Token, TokenError, Verification, http_token};
pub use latency::{Bins, Histograms};
pub use link_session::{LinkSession, Reaction};
pub use load::{LoadError, Loaded, load, with_additions};
pub use logging::LogError;
pub use realtime::last_processor;
pub use recent::{CodeCount, EventStatus, RecentStatus};
pub use recorder::{ModelTexts, Tap, answer_of, command_of, request_of, tap};
pub use self_benchmark::{SelfBenchmark, SelfBenchmarkError, run_self_benchmark};
pub use sensors::{
    EstimatorEnd, EstimatorLockStep, FilterStatus, LiveEnd, MapStatus, Motion, NodeStatus, SensorStatus,
    ThermalDisplacementStatus, live_ends, live_ends_in_lock_step,
};
pub use server::SocketError;
pub use status::{
    AxisLimitStatus, Fault, Lifetime, LinkStatus, ModelErrors, ModelStatus, RealtimeStatus, RecordingStatus,
    ShadowAxis, ShadowStatus, StateReason, Status,
};
pub use tls::{Identity, TlsFileError, identity};
pub use volcomp_state::bounded_read;
