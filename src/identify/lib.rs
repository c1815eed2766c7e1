//! Instrument data to error models: offline, pure, may allocate.
//!
//! Reading order: [`reading`] (what every instrument delivers), [`curve`] (readings of one error
//! motion to a curve of the model), then one room per measuring method. Equations: `docs/reference/equations.md`.

#![forbid(unsafe_code)]
#![cfg_attr(not(test), forbid(clippy::disallowed_methods))]

pub mod assemble;
pub mod ballbar;
pub mod circles;
pub mod curve;
pub mod diagonals;
pub mod fivedof;
mod golden;
pub mod grinder;
pub mod motion;
pub mod nineline;
mod prelude;
pub mod primitives;
pub mod probe;
pub mod ram;
pub mod reading;
pub mod start_up;
pub mod straightness;
pub mod thermal;
pub mod threepoint;

pub use primitives::twist;
pub use reading::Reading;
