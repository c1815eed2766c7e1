//! Estimation while the machine works: a map on the nodes of a grid, kept true by measurements.
//!
//! Reading order: [`grid`] (where a point lies among the nodes), [`noise`] (how far a sensor is believed), [`filter`]
//! (the Kalman filter on node values), [`map`] (a live map of lengths and angles about the offline one),
//! [`mod@whiten`] (readings with a covariance to rows of a batch), [`clock`] (when a reading was taken),
//! [`plausibility`] (whether it can be one), [`sensor_initialisation`] (how noisy a sensor is before anything is learned
//! from it), [`fivedof`] (readings of a 5-DOF laser), [`thermal`] (thermal displacement), [`aliasing`] (which waves a set of
//! positions shows). Textbook letters as in
//! equations 5.8 (`docs/reference/equations.md`): `x` state, `p` covariance, `h` row of the observation, `k` gain,
//! `r` measurement variance, `nu` innovation, `s` its variance.
//!
//! Time is an argument (seconds that passed). The filter works in memory made at construction; none of this runs on
//! the cycle.

#![forbid(unsafe_code)]
#![cfg_attr(not(test), forbid(clippy::disallowed_methods))]

pub mod aliasing;
pub mod clock;
pub mod filter;
pub mod fivedof;
pub mod grid;
pub mod innovation_bias;
pub mod live;
pub mod map;
pub mod noise;
pub mod plausibility;
pub mod sensor_initialisation;
pub mod thermal;
pub mod whiten;

pub use aliasing::SpectralWindow;
pub use clock::SensorClock;
pub use filter::{FilterError, NodeFilter, Observation, Process, Rules, Update, Verdict};
pub use grid::{GridError, NodeGrid, NodePlace};
pub use innovation_bias::{InnovationBias, Window};
pub use map::{Batch, Checkpoint, ComponentRules, LiveMap, MapError, MapRules, Row};
pub use noise::{Adaptation, Kind, MeasurementNoise, NoiseError};
pub use plausibility::{Plausibility, Said, SensorFault, SensorStatus, Supervisor, VALUES_MAX};
pub use sensor_initialisation::{InnovationSample, NoiseAssessment, SensorInitialisation};
pub use thermal::{
    Quantity, Thermal, ThermalDisplacement, ThermalError, ThermalInput, ThermalState, largest_change,
};
pub use whiten::whiten;
