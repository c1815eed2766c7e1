//! The cyclic engine: positions and commands in, bounded corrections out.
//!
//! Pure: time is an argument, every output is a fixed-size value. States and reactions: `docs/explanation/safety.md`.

#![forbid(unsafe_code)]
#![cfg_attr(not(test), forbid(clippy::disallowed_methods))]

mod compensator;
mod config;
pub mod fault;
mod input_validation;
mod limiter;
mod live;
mod lookahead;
mod motion;
mod output;
mod ramp;
mod read_back;
mod setpoint;
mod shadow;
mod shortfall;
#[cfg(test)]
mod tests;
mod time_budget;
pub mod transitions;

pub use compensator::Compensator;
pub use config::{
    AfterLoss, AxisLimits, EngineConfig, EngineError, FOUND_FACTOR, LimitTime, OutOfTravel, PositionSource,
    RestOffset, UNLISTED_MAX_DEG, UNLISTED_MAX_MM,
};
pub use limiter::Limiter;
pub use lookahead::{LAG_CYCLES_MAX, Lag};
pub use output::{Command, CycleOutput, Detail, Event, Quantity, Reason, State};
pub use read_back::READ_BACK_CYCLES_MAX;
pub use shadow::{AxisScore, Shadow, ShadowScore};
