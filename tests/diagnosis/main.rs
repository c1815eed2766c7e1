//! `volcomp diagnose`: simulated and real sessions.

#![cfg(feature = "daemon")]

mod cli;
mod effects;
mod head;
mod real;
mod support;
