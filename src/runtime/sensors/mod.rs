//! Live estimation in the daemon: sensors connect over TCP, a thread beside the cycle learns, the cycle evaluates.
//!
//! - [`listener`]: connections of sensors, on the service's event loop; bytes become readings ([`wire`]).
//! - [`worker`]: the estimator thread. Positions come from the cycle, readings from the listener; finished tables go to
//!   the cycle, health to the status, what was learned to the disk ([`keep`]).
//! - [`cycle_end`]: what the cycle does for it: a copy into a queue, and the evaluation of a table.
//! - [`report`]: health as the status tells it.

mod cycle_end;
mod keep;
mod listener;
mod report;
mod wire;
mod worker;

pub use cycle_end::{EstimatorEnd, LiveEnd, Motion, live_ends};
pub use report::{FilterStatus, GrowthStatus, MapStatus, NodeStatus, SensorStatus};

pub(super) use listener::Listener;
pub(super) use worker::{Sensors, Start};

use crate::core::live::Reading;
use crate::core::units::MonoTime;

/// A reading on its way to the estimator.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Arrived {
    /// When its bytes were in hand.
    now: MonoTime,
    /// Name of the sensor.
    sensor: String,
    reading: Reading,
}
