//! Reference lines of straightness (equations 5.6).
