//! The chain A, B, X, Y of a grinder, identified axis by axis.
