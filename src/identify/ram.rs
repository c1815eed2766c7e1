//! Ram errors from poses of the tool (equations 5.5).
