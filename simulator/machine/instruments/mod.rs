//! What instruments on the simulated machine see of it. They look at poses of the tool relative to the workpiece,
//! never at the numbers that the machine was made from.
//!
//! - [`ballbar`]: a circle, from recorded samples; circularity of ISO 230-4.
//! - [`interferometer`]: positioning along an axis at rest; rows for ISO 230-2.
//! - [`diagonal`]: displacement along a space diagonal; ISO 230-6.
//! - [`grinder`]: tips of several styli relative to an artefact, pose by pose.
//! - [`probe`]: contacts of a touch probe with a gauge bar.
//! - [`carriage`]: what optics on the carriage of one axis see; [`fivedof`] and [`sixd`] look at it.
//! - [`live`]: a tracker and a 5-DOF laser that measure while the machine works, with all their faults.
//! - [`tracker`]: range and angles to targets on a carriage or the tool.
//! - [`survey`]: six error motions of every axis with one instrument, squareness and axis locations.
//!
//! Angles in deg and arcsec, deviations in um, as the instruments print them. Noise is seeded.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use volcomp_units::axes::{AxisArray, AxisName};

pub mod ballbar;
pub mod carriage;
pub mod diagonal;
pub mod fivedof;
pub mod grinder;
pub mod interferometer;
pub mod link;
pub mod live;
pub mod probe;
pub mod sixd;
pub mod survey;
pub mod tracker;

/// Refuses a plan with more points than its instrument takes.
///
/// # Errors
/// [`InstrumentError::TooMany`].
pub(crate) fn at_most(
    count: f64,
    limit: f64,
    what: &'static str,
    remedy: &'static str,
) -> Result<(), InstrumentError> {
    // a NaN is no number of points
    if count <= limit { Ok(()) } else { Err(InstrumentError::TooMany { count, what, limit, remedy }) }
}

/// Why a measurement is not possible.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum InstrumentError {
    /// Too few readings.
    #[error("{count} readings, at least {needed} are needed")]
    TooFew {
        /// How many there are.
        count: usize,
        /// How many there must be.
        needed: usize,
    },
    /// The readings do not spread enough to fit what is asked.
    #[error("the readings do not spread enough to fit {what}")]
    Degenerate {
        /// What was to be fitted.
        what: &'static str,
    },
    /// The machine has no such linear axis.
    #[error("the machine has no linear axis {axis}; an interferometer measures along a linear axis")]
    NoLinearAxis {
        /// The axis.
        axis: AxisName,
    },
    /// The plan has more points than a measurement can have.
    #[error("{count:.0} {what}; the limit is {limit:.0}: {remedy}")]
    TooMany {
        /// How many there would be.
        count: f64,
        /// Of what.
        what: &'static str,
        /// How many there may be.
        limit: f64,
        /// What to change.
        remedy: &'static str,
    },
    /// A number of the measuring plan is out of range.
    #[error("{what} = {value} is out of range; it must be {limit}")]
    Plan {
        /// Which number.
        what: &'static str,
        /// Its value.
        value: f64,
        /// The condition in words.
        limit: &'static str,
    },
}

/// One stop of one run along an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stop {
    /// Position of the axis, mm or deg.
    pub position: f64,
    /// Run, from 1.
    pub cycle: u32,
    /// Direction of approach, 1 or -1.
    pub direction: i8,
}

/// Runs over positions there and back.
#[must_use]
pub fn there_and_back(positions: &[f64], runs: u32) -> Vec<Stop> {
    let mut all = Vec::with_capacity(2 * positions.len() * runs as usize);
    for cycle in 1..=runs {
        all.extend(positions.iter().map(|p| Stop { position: *p, cycle, direction: 1 }));
        all.extend(positions.iter().rev().map(|p| Stop { position: *p, cycle, direction: -1 }));
    }
    all
}

/// An offset that is added to a commanded position before the machine goes there; none at all.
#[must_use]
pub fn no_offset(_commanded: &AxisArray) -> AxisArray {
    AxisArray::default()
}

/// Seeded normal noise.
#[derive(Debug, Clone)]
struct Noise {
    random: ChaCha8Rng,
}

impl Noise {
    fn new(seed: u64) -> Self {
        Self { random: ChaCha8Rng::seed_from_u64(seed) }
    }

    fn draw(&mut self, standard_deviation: f64) -> f64 {
        let unit: f64 = StandardNormal.sample(&mut self.random);
        standard_deviation * unit
    }
}

fn along(from: [f64; 3], to: [f64; 3], unit: [f64; 3]) -> f64 {
    (0..3).map(|i| (to[i] - from[i]) * unit[i]).sum()
}

/// Unit vector and length from one point to another.
fn line(from: [f64; 3], to: [f64; 3]) -> Option<([f64; 3], f64)> {
    let length = (0..3).map(|i| (to[i] - from[i]).powi(2)).sum::<f64>().sqrt();
    (length > 1e-9).then(|| (std::array::from_fn(|i| (to[i] - from[i]) / length), length))
}
