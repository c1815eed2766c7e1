//! Simulated measurement campaigns, their diagnosis and correction.

mod blind;
mod diagnosis_loop;
mod files;
mod support;
