//! Effects beyond the error model: pure, may allocate.
//!
//! Equations: `docs/reference/equations.md`. [`shape`] their formulas, [`machine_state`] what they depend on at a
//! reading, [`pages`] a page of text for each, [`addition`] the file of diagnosed effects and its evaluation,
//! [`extend`] what of it a model can take over, [`prediction`] what a model predicts for it. Effects are found by
//! `volcomp-diagnose`; the daemon needs what is here without that search.

#![forbid(unsafe_code)]
#![cfg_attr(not(test), forbid(clippy::disallowed_methods))]

pub mod addition;
pub mod extend;
mod frame;
mod label;
mod lever;
pub mod machine_state;
pub mod pages;
mod parameters;
mod polynomial;
pub mod prediction;
pub mod shape;

pub use frame::RotaryFrame;
pub use label::{Kind, Label, LabelError, Without};
pub use lever::Lever;
pub use pages::{PAGES, Page, page};
pub use polynomial::{legendre, twist};
pub use shape::{BELL, REFERENCE_DEGC, STILL, Shape, WIDTH_MAX, line_of_sight};
