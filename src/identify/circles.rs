//! Tool axis and tip from two circles in space (equations 5.4).
