//! Causes of the deviations on a ballbar circle.
