//! Probe calibration on a gauge bar.
