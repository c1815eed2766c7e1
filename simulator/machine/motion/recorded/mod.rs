//! Replay of recorded motion: commanded and actual positions of a real machine, cycle by cycle.
//!
//! A description (`cncsim-replay/1`, TOML) says which columns of a CSV file belong to which axis and how they are
//! shifted into the machine. Where the time stamps jump the recording is cut: nothing is interpolated or
//! differentiated across. Between the parts the control makes a smooth connecting move of its own that does not count.

mod connect;
mod description;
mod read;
mod replay;

pub use description::{Description, DescriptionError};
pub use read::{Part, RecordingError, Row, read_parts};
pub use replay::{Interpolation, Replay, ShippedError};

/// The description of the shipped recording (see `data/sinumerik-840dsl/SOURCE.md`).
pub const SHIPPED_DESCRIPTION: &str = include_str!("../../../data/sinumerik-840dsl/replay.toml");
/// The shipped recording itself.
pub const SHIPPED_DATA: &str = include_str!("../../../data/sinumerik-840dsl/capture.csv");
