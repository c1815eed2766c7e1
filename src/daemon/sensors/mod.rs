//! Live estimation in the daemon: sensors connect over TCP, a thread beside the cycle learns, the cycle evaluates.
//!
//! - [`listener`]: connections of sensors, on the service's event loop; bytes become readings ([`wire`]).
//! - [`worker`]: the estimator thread. Positions come from the cycle, readings from the listener; finished tables go to
//!   the cycle, health to the status, what was learned to the disk ([`checkpoint`], written by [`map_writer`]);
//!   [`changes`] of maps go into the log.
//! - [`follower`]: positions of frames in the order and units of the estimator.
//! - [`configured`]: what each sensor is to say, for answers on the link.
//! - [`lock_step`]: the estimator's time, and a cycle that waits for it where the control is simulated.
//! - [`cycle_end`]: what the cycle does for it: a copy into a queue, and the evaluation of a table.
//! - `crate::sensor_status`: health as the status tells it.

mod changes;
mod checkpoint;
mod configured;
mod cycle_end;
mod follower;
mod listener;
mod lock_step;
mod map_writer;
mod wire;
mod worker;

pub use crate::sensor_status::{
    FilterStatus, MapStatus, NodeStatus, SensorStatus, ThermalDisplacementStatus,
};
pub use cycle_end::{EstimatorEnd, LiveEnd, Motion, live_ends, live_ends_in_lock_step};
pub use lock_step::EstimatorLockStep;

use wire::Heard;

pub(super) use listener::Listener;
pub(super) use lock_step::EstimatorTime;
pub(super) use worker::{Forgotten, Sensors, Start};

use core::fmt;
use std::sync::atomic::AtomicU64;
use std::time::SystemTime;

use volcomp_engine::fault::Code;
use volcomp_estimate::live::{LiveEstimator, Reading};
use volcomp_units::MonoTime;

/// A reading on its way to the estimator.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Arrived {
    /// When its bytes were in hand.
    now: MonoTime,
    /// Name of the sensor.
    sensor: String,
    reading: Reading,
}

/// Messages that came to nothing, counted by the listener.
#[derive(Debug, Default)]
pub(super) struct Lost {
    /// Readings that found the estimator's queue full.
    pub(super) dropped: AtomicU64,
    /// Messages that were answered with an error.
    pub(super) refused: AtomicU64,
}

/// What should be known about live estimation, with its number where something is wrong.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Note {
    code: Option<Code>,
    text: String,
}

impl Note {
    fn plain(text: impl Into<String>) -> Self {
        Self { code: None, text: text.into() }
    }

    fn numbered(code: Code, text: impl Into<String>) -> Self {
        Self { code: Some(code), text: text.into() }
    }
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(code) = self.code {
            write!(f, "{code}: ")?;
        }
        f.write_str(&self.text)
    }
}

/// What would be heard of bytes that arrive in these pieces: each message, or what is wrong with it, in words. Nothing
/// more after what ends a connection.
#[must_use]
pub fn parse_stream<'a>(
    pieces: impl IntoIterator<Item = &'a [u8]>,
) -> Vec<Result<(String, Reading), String>> {
    let (mut stream, mut heard) = (wire::Stream::default(), Vec::new());
    for piece in pieces {
        stream.push(piece);
        while let Some(said) = stream.next() {
            let lost = said.as_ref().is_err_and(wire::WireError::is_fatal);
            match said {
                Ok(Heard::Sync(_)) => {}
                Ok(Heard::Reading(s)) => heard.push(Ok((s.sensor, s.reading))),
                Err(e) => heard.push(Err(e.to_string())),
            }
            if lost {
                return heard;
            }
        }
    }
    heard
}

/// Puts the text of a `live.json` back into an estimator, as a start of the daemon does.
///
/// # Errors
/// Why it is not believed, in words.
pub fn restore_text(
    text: &[u8],
    machine: &str,
    model_hash: &str,
    estimator: &mut LiveEstimator,
    now: SystemTime,
) -> Result<String, String> {
    checkpoint::restore_text(text, machine, model_hash, estimator, now).map_err(|(why, _)| why)
}
