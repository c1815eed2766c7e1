//! Six error motions of an axis from nine interferometer lines (equations 5.7).
