//! Faults by number: the real daemon on the simulated machine while something goes wrong, and what must hold then.
//!
//! A scenario overrides a few defaults (`catalogue.toml`) and inherits the acceptance limits: largest and RMS
//! residual at the end, largest step, time to settle, late cycles, final state. Links go through a relay that injects
//! faults into the frames (seeded); daemon and control are the unmodified programs.
//!
//! Reading order: [`plan`] (what a scenario says), [`fault`] and [`relay`] (the bad link), [`tracker`] (a sensor and
//! what goes wrong with it), [`stage`] (machine, control, daemon), [`mod@run`] (a scenario from its first cycle to its verdict).

pub mod fault;
pub mod plan;
pub mod relay;
pub mod run;
pub mod stage;
pub mod tracker;
pub mod verdict;

pub use plan::{Pacing, Plan, Scenario};
pub use run::run;
pub use verdict::Verdict;
