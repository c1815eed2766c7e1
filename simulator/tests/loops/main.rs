//! Closed loops of daemon, control and machine: compensation, faults, scenarios, live estimation.

mod closed_loop;
mod closed_loop_live;
mod demo_faults;
mod fault_numbers;
mod first_run;
mod live_chains;
mod live_monte_carlo;
mod live_s_part;
mod motion_dependent;
mod papers;
mod read_write;
mod scenarios;
mod support;
mod through;
mod tutorials;

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Serialises the tests in real time and those that occupy every processor.
fn processors() -> MutexGuard<'static, ()> {
    static PROCESSORS: Mutex<()> = Mutex::new(());
    PROCESSORS.lock().unwrap_or_else(PoisonError::into_inner)
}
