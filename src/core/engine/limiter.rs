//! Bounds the offset of one axis in size, rate and acceleration, whatever is asked of it.

/// placeholder
#[derive(Debug, Clone, Copy)]
pub struct Limiter;
