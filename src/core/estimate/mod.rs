//! Estimation while the machine works: a map on the nodes of a grid, kept true by measurements.
//!
//! Reading order: [`grid`] (where a point lies among the nodes), [`noise`] (how far a sensor is believed), [`filter`]
//! (the Kalman filter on node values), [`thermal`] (growth by heat). Textbook letters as in equations 5.8: `x` state,
//! `p` covariance, `h` row of the observation, `k` gain, `r` measurement variance, `nu` innovation, `s` its variance.
//!
//! Time is an argument (seconds that passed); everything is allocated at construction.

pub mod filter;
pub mod grid;
pub mod noise;
pub mod thermal;

pub use filter::{FilterError, NodeFilter, Observation, Process, Rules, Update, Verdict};
pub use grid::{GridError, NodeGrid, NodePlace};
pub use noise::{Adaptation, MeasurementNoise, NoiseError};
pub use thermal::{Growth, Quantity, Thermal, ThermalError, ThermalInput, ThermalState};
