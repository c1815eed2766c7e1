//! Simulated measurement campaigns, their diagnosis and correction.

mod blind;
mod closed;
mod diagnosis_loop;
mod every_kind;
mod files;
mod support;
