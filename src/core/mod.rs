//! The pure core: deterministic, no I/O, no clock, no logging, no allocation after construction.

pub mod axes;
pub mod engine;
pub mod fault;
pub mod geometry;
pub mod model;
pub mod protocol;
pub mod units;
