//! Text to validated types: the machine file and the model file. Takes `&str`; the shell reads the files.
//!
//! A wire struct mirrors the file to the letter (unknown keys are errors); a validated type is what the rest uses.
//! Every mistake becomes a [`Diagnostic`] that names file, line, column, value, limit and remedy.

pub mod diagnostic;
pub mod machine;
pub mod model;

pub use diagnostic::{ConfigErrors, Diagnostic};
pub use machine::{
    AxisConfig, EngineSettings, LinkConfig, LogConfig, LogTarget, MachineConfig, RealtimeConfig, StartMode,
    StatusConfig,
};
