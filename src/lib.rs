//! volcomp compensates the geometric errors of a machine tool in real time.
//!
//! Its crates under one name, for the tests and for whoever builds upon it. What may use what is a fact of their manifests
//! (`cargo tree -p volcomp -e normal`); the reasons stand in `docs/explanation/architecture.md`. From the inside out:
//!
//! - [`model`] (with units and axes), [`protocol`], [`engine`], [`estimate`]: mathematics and rules of the cycle. Pure: no
//!   I/O, no clock, no threads.
//! - [`effects`], [`identify`], [`evaluate`], [`diagnose`]: offline mathematics, pure.
//! - [`config`], [`formats`]: text to validated types and back, with errors that point at the line. They read no file.
//! - [`state`]: the state directory of the daemon.
//! - [`daemon`]: sockets, the real-time thread, the service around it.
//! - [`cli`]: arguments, human and JSON output, exit codes.

pub use volcomp_cli as cli;
pub use volcomp_config as config;
pub use volcomp_daemon as daemon;
#[cfg(feature = "diagnosis")]
pub use volcomp_diagnose as diagnose;
pub use volcomp_effects as effects;
pub use volcomp_engine as engine;
pub use volcomp_estimate as estimate;
pub use volcomp_evaluate as evaluate;
pub use volcomp_formats as formats;
pub use volcomp_identify as identify;
pub use volcomp_model as model;
pub use volcomp_protocol as protocol;
pub use volcomp_state as state;
