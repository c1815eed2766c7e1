//! `cncsim`: measurement campaigns, blind tests, scenarios, benches and the demo around the simulated machine.
//!
//! - [`simulated_machine`]: truth, instruments, motion, control: a crate of its own without the product's model.
//! - [`twin`]: that machine in time: servo, friction, heat, bending, each switched by a truth file.
//! - [`campaign`]: a standard measurement campaign on the twin, as session files.
//! - [`formulas`]: a second generator of session files, with another machine, plan, formulas and noise.
//! - [`blind`]: machines with sealed faults, and how often the diagnosis names them.
//! - [`monitor`]: an invariant monitor at the socket, for every correction of the daemon.
//! - [`certificates`]: an authority and its certificates, to try the secure link with.
//! - [`demo`]: the main job end to end; starts the product's own programs as processes.
//! - [`drawing`]: a machine as a model file without errors.
//! - [`papers`]: the experiments of the source papers, their figures and limits.
//! - [`mod@bench`]: the daemon's round trips beside a bare echo's.
//! - [`cli`]: the program `cncsim`.
//!
//! Equations: `docs/reference/equations.md`. From volcomp it uses units and protocol, and the front rooms (`demo`, `cli`) start its programs.

pub mod bench;
pub mod blind;
pub mod campaign;
pub mod certificates;
pub mod cli;
pub mod demo;
pub mod drawing;
pub mod formulas;
pub mod papers;
pub mod scenarios;
pub mod through;
pub mod twin;

pub use simulated_machine::{control, instruments, motion, truth};
pub use volcomp_monitor as monitor;
