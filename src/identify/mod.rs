//! Instrument data to error models: offline, pure, may allocate.
//!
//! Reading order: [`reading`] (what every instrument delivers), [`import`] (text of an instrument to readings),
//! [`curve`] (readings of one error motion to a curve of the model).

pub mod curve;
pub mod import;
pub mod reading;

pub use reading::Reading;
