//! Pose errors of a carriage from the positions of three or more points on it (equations 5.1).
