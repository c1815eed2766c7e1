//! The pure core: deterministic, no I/O, no clock, no logging, no allocation after construction.

pub mod axes;
pub mod engine;
pub mod estimate;
pub mod fault;
pub mod geometry;
pub mod live;
pub mod model;
pub mod protocol;
pub mod record;
pub mod statistics;
pub mod units;
