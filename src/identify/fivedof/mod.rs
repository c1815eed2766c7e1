//! Runs of a 5-DOF laser: calibration of the instrument, alignment of whole runs.
//!
//! The reduction of one reading, and what the numbers of the instrument mean, stand in [`volcomp_estimate::fivedof`]:
//! the live evaluation uses the same.
//!
//! Source: equations 5.2, 4.2 ((11)). Reading order: `core::estimate::fivedof`, [`align`] (end points
//! and level), [`resting`] (calibration), [`scatter`] (what the drift
//! compensation is worth).

pub mod align;
pub mod resting;
pub mod scatter;

pub use volcomp_estimate::fivedof::{
    BEAM_DISTANCE_MIN_MM, Channels, Detector, FiveDof, Head, HeadError, Readings, lateral, to_machine,
};

#[cfg(test)]
mod tests;
