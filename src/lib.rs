//! volcomp takes the geometric errors of a machine tool out while it runs.
//!
//! The rooms, from the inside out (arrows point down this list only):
//!
//! - [`core`]: pure mathematics and rules: units, model, engine, protocol. No I/O, no clock, no threads. Crates of
//!   their own: `volcomp-model`, `volcomp-protocol`, `volcomp-engine`, `volcomp-estimate`.
//! - [`config`]: text to validated types, with errors that point at the line. Takes `&str`, reads no file.
//! - [`identify`]: instrument data to error models (offline, pure).
//! - [`formats`]: files of instruments and controls, text to readings and back (offline, pure).
//! - [`diagnose`]: the gap between measurement and prediction to its causes (offline, pure).
//! - [`evaluate`]: the figures of ISO 230 from measured deviations (offline, pure).
//! - `runtime`: sockets, the real-time thread, the service around it (feature `daemon`).
//! - `cli`: arguments, human and JSON output, exit codes (feature `daemon`).
//!
//! The dependency rule is checked by `tests/repository/architecture.rs`; the reasons stand in `docs/architecture.md`.

pub mod config;
pub mod diagnose;
pub mod evaluate;
pub mod formats;
pub mod identify;

#[cfg(feature = "daemon")]
pub mod cli;
#[cfg(feature = "daemon")]
pub mod runtime;

/// The pure crates under one name.
pub mod core {
    pub use volcomp_engine as engine;
    pub use volcomp_engine::fault;
    pub use volcomp_estimate as estimate;
    pub use volcomp_estimate::live;
    pub use volcomp_model as model;
    pub use volcomp_model::{axes, geometry, statistics, units};
    pub use volcomp_protocol as protocol;
    pub use volcomp_protocol::record;
}
