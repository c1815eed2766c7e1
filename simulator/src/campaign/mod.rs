//! A standard measurement campaign on the twin, written as session files (`docs/reference/session-files.md`).
//!
//! Reading order: [`plan`] (what is measured), [`legs`] (how the axes move), [`run`] (the machine moves, states are
//! taken), [`beside`] (what may offset the set points), [`instrument`] (what the instruments make of it), [`files`] (tables), [`points`] (the same for `volcomp predict`).
//! Deterministic: truth, seed and plan give the same bytes.

pub mod beside;
pub mod files;
pub mod instrument;
pub mod legs;
pub mod plan;
pub mod points;
pub mod run;

use crate::twin::{TwinError, TwinTruth};

pub use beside::Beside;
pub use instrument::Measured;
pub use plan::Plan;
pub use run::Taken;

/// A campaign: the states at which readings were taken, the machine's log, and the readings.
#[derive(Debug, Clone)]
pub struct Campaign {
    /// States in order.
    pub taken: Taken,
    /// What the instruments wrote, one per state.
    pub measured: Vec<Measured>,
}

/// Runs a plan on a machine; `seed` is the day: weather, mountings and noise.
///
/// # Errors
/// The truth names something that the twin has no physics for.
pub fn run_campaign(truth: &TwinTruth, plan: Plan, seed: u64) -> Result<Campaign, TwinError> {
    Ok(measured(run::take(truth, plan, seed, None)?, truth, seed))
}

/// The same with something beside the control that offsets its set points.
///
/// # Errors
/// As [`run_campaign`].
pub fn run_corrected(
    truth: &TwinTruth,
    plan: Plan,
    seed: u64,
    beside: Box<dyn Beside>,
) -> Result<Campaign, TwinError> {
    Ok(measured(run::take(truth, plan, seed, Some(beside))?, truth, seed))
}

fn measured(taken: Taken, truth: &TwinTruth, seed: u64) -> Campaign {
    let measured = instrument::measure(&taken, truth, seed);
    Campaign { taken, measured }
}
