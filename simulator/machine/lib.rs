//! A simulated machine tool with its control and instruments: the independent truth beside which volcomp is measured.
//!
//! Equations: `docs/reference/equations.md`.
//!
//! - [`truth`]: the machine as it really is: exact rotations, own error shapes, servo, sensors.
//! - [`instruments`]: what a ballbar, an interferometer or a diagonal measurement sees of it.
//! - [`motion`]: part programs and recorded motion to positions per cycle.
//! - [`control`]: the control's end of the link.
//!
//! It must never share a model with the compensator, or a sign error would cancel itself: of volcomp this crate depends on
//! the units, the protocol and the monitor only.

pub mod control;
pub mod instruments;
pub mod motion;
pub mod truth;
