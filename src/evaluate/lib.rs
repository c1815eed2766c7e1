//! The figures of ISO 230 and ISO 1328-1 from measured deviations: offline, pure.
//!
//! [`positioning`] ISO 230-2 (its [`uncertainty`]), [`circular`] ISO 230-4 ([`circle_prediction`] against a model), [`diagonal`] ISO 230-6, [`plate`] for hole and
//! ball plates, [`gear`] ISO 1328-1; [`conformity`] with a tolerance by ISO 14253-1. Deviations are actual minus nominal;
//! every figure has the unit of the deviations that went in. Equations: `docs/reference/equations.md`.

#![forbid(unsafe_code)]
#![cfg_attr(not(test), forbid(clippy::disallowed_methods))]

pub mod circle_prediction;
pub mod circular;
pub mod conformity;
pub mod diagonal;
mod few_runs;
pub mod gear;
pub mod plate;
pub mod positioning;
pub mod reduction;
pub mod uncertainty;

pub use circle_prediction::CirclePrediction;
pub use circular::{Centring, CircularReading, Circularity};
pub use conformity::Conformity;
pub use diagonal::{Diagonal, DiagonalTest};
pub use plate::{PlateFit, PlateModel, PlateNorm, PlatePoint};
pub use positioning::{AtTarget, Positioning, PositioningReading, Spread};
pub use reduction::{Device, Placed, Reduction, Size, Uncertain};
pub use uncertainty::{CircularUncertainties, Conditions, Uncertainties};
