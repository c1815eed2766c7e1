//! `volcomp diagnose`: simulated and real sessions.

mod circles;
mod cli;
mod effects;
mod head;
mod instruments;
mod lags;
mod page;
mod points;
mod real;
mod rough;
mod sensitivity;
mod support;
mod targets;
