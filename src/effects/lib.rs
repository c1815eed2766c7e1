//! Effects beyond the error model: pure, may allocate.
//!
//! Equations: `docs/reference/equations.md`. [`library`] holds the effects, a file for each family, and their formulas
//! ([`Shape`]); [`machine_state`] what these depend on at a reading, [`data`] what decides which of them a session can show,
//! [`addition`] the file of diagnosed effects and its evaluation, [`extend`] what of it a model can take over, [`prediction`]
//! what a model predicts for it. Effects are found by `volcomp-diagnose`; the daemon needs what is here without that search.

#![forbid(unsafe_code)]
#![cfg_attr(not(test), forbid(clippy::disallowed_methods))]

pub mod addition;
pub mod data;
pub mod drawing;
mod effect;
pub mod extend;
mod frame;
mod lever;
pub mod library;
pub mod machine_state;
mod polynomial;
pub mod prediction;
mod prelude;
pub mod shape;
mod signal;
mod units;

pub use effect::{Effect, Kind, Label, LabelError, Measurement, Procedure, Subject, Subjects, Without};
pub use frame::RotaryFrame;
pub use lever::Lever;
pub use library::{EFFECTS, PROCEDURES, SPINDLE_S, forms, squareness_symbol};
pub use polynomial::{legendre, twist};
pub use shape::{REFERENCE_DEGC, STILL, Shape, WIDTH_MAX, line_of_sight};
pub use signal::{Follower, Signal};
pub use units::{prior_sd, unit_of};
