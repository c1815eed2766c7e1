//! Blind tests of the diagnosis: machines with known faults, sealed labels, and what the tool says.
//!
//! [`mod@generator`] has three kinds of machines; [`cases`] draws them and scales their effects to the noise; the diagnosis runs as a process on the session files
//! alone; [`mod@judge`] opens the labels afterwards, [`columns`] finds re-expressions, and [`score`] counts.

pub mod cases;
pub mod columns;
pub mod generator;
pub mod judge;
pub mod score;

pub use cases::{Case, Draw, Kind, Mode, Origin};
pub use columns::{Column, Rows};
pub use generator::{Generator, Truth};
pub use judge::{Judged, Said, judge};
pub use score::{Score, Standing};
