//! `volcomp diagnose`: simulated and real sessions.

mod cli;
mod effects;
mod head;
mod real;
mod support;
