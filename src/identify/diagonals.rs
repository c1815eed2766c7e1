//! Squareness from four body diagonals (equations 5.3).
