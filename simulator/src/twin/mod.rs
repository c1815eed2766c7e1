//! The machine of measurement campaigns as it really is: physics in time, switched by a truth file.
//!
//! A table C on the carriage X', a ram Y and a head Z: `[w C' X' b Y Z t]`. The geometric chain is [`crate::truth`]'s;
//! here is what moves, winds up, warms up and bends along it. Nothing here knows a formula of the diagnosis.
//! Reading order: [`mod@file`] (the truth file), [`quantity`] (its sizes in metrology), [`catalogue`] (what there is),
//! [`drive`], [`heat`], [`bodies`], [`machine`].

pub mod bodies;
pub mod catalogue;
pub mod drive;
pub mod file;
pub mod heat;
pub mod machine;
pub mod quantity;
pub mod random;

pub use file::{Effect, InstrumentTruth, TwinError, TwinTruth};
pub use machine::{Command, Twin};
pub use random::Dice;
