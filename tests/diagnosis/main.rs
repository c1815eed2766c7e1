//! `volcomp diagnose`: simulated and real sessions.

mod channels;
mod circles;
mod cli;
mod effects;
mod head;
mod horizontal;
mod instruments;
mod lags;
mod noise;
mod outliers;
mod page;
mod plans;
mod points;
mod real;
mod rough;
mod rtest;
mod sensitivity;
mod structure;
mod support;
mod targets;
