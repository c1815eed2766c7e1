//! Readings of a 5-DOF laser to error motions (equations 5.2).
