//! The figures of ISO 230 from measured deviations: offline, pure.
//!
//! [`positioning`] ISO 230-2, [`circular`] ISO 230-4, [`diagonal`] ISO 230-6. Deviations are actual minus nominal;
//! every figure has the unit of the deviations that went in.

pub mod circular;
pub mod diagonal;
pub mod positioning;

pub use circular::{Centring, CircularReading, Circularity};
pub use diagonal::{Diagonal, DiagonalTest};
pub use positioning::Positioning;
