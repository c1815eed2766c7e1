//! The cyclic engine: positions and commands in, bounded corrections out.
//!
//! Pure: time is an argument, every output is a fixed-size value. States and reactions: `docs/safety.md`.

mod compensator;
mod config;
mod limiter;
mod output;

pub use compensator::Compensator;
pub use config::{AxisLimits, EngineConfig, EngineError, OutOfTravel, PositionSource, RestOffset};
pub use limiter::Limiter;
pub use output::{Command, CycleOutput, Event, Reason, State};
