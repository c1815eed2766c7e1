//! A simulated control, machine tool and instruments, written independently of volcomp's own model.
//!
//! - [`truth`]: the machine as it really is: exact rotations, own error shapes, servo, sensors. No model code of volcomp.
//! - [`instruments`]: what a ballbar, an interferometer or a diagonal measurement sees of it.
//! - [`twin`]: that machine in time: servo, friction, heat, bending, each switched by a truth file.
//! - [`campaign`]: a standard measurement campaign on the twin, as session files.
//! - [`formulas`]: a second generator of session files, with another machine, plan, formulas and noise.
//! - [`blind`]: machines with sealed faults, and how often the diagnosis names them.
//! - [`motion`]: part programmes and recorded motion to positions per cycle.
//! - [`control`]: the control's end of the link.
//! - [`monitor`]: an invariant monitor at the socket, for every correction of the daemon.
//! - [`certificates`]: an authority and its certificates, to try the secure link with.
//! - [`demo`]: the main job end to end; starts the product's own programs as processes.
//! - [`mod@bench`]: the daemon's round trips beside a bare echo's.
//! - [`cli`]: the program `cncsim`.
//!
//! From volcomp only `core::{axes, units, protocol}` may be used here, and `cli` in the front rooms (`demo`, `cli`), to
//! start its programs; `tests/repository/architecture.rs` checks it.

pub mod bench;
pub mod blind;
pub mod campaign;
pub mod certificates;
pub mod cli;
pub mod control;
pub mod demo;
pub mod formulas;
pub mod instruments;
pub mod motion;
pub mod scenarios;
pub mod truth;
pub mod twin;

pub use volcomp_monitor as monitor;
