//! A second generator of session files, independent of the twin: other machine, other plan, other formulas, other noise.
//!
//! A tool that is only tested on one generator learns that generator. Here nothing moves in time: the states of the axes
//! and of the heat follow from closed formulas, every effect is one formula of the state, and none of these formulas is in
//! the tool's library. The machine is `[w C' A' b X Y Z t]`, a swivelling table under three linear axes.
//! Reading order: [`truth`] (what is wrong), [`catalogue`] (what there is), [`machine`], [`mod@row`], [`course`] and [`programs`] (what is
//! measured), [`heat`], [`laws`] (the effects), [`instrument`] (noise and mountings), [`files`].
//! Deterministic: truth and day give the same bytes.

pub mod catalogue;
pub mod chance;
pub mod course;
pub mod curve;
pub mod files;
pub mod heat;
pub mod instrument;
pub mod laws;
pub mod machine;
pub mod programs;
pub mod row;
pub mod truth;

pub use instrument::Reading;
pub use row::Row;
pub use truth::{Fault, FormulaError, FormulaTruth};

use course::Course;
use heat::Heat;

/// What was measured on one day.
#[derive(Debug, Clone, PartialEq)]
pub struct Measurement {
    /// The states, in order.
    pub rows: Vec<Row>,
    /// What the instruments wrote, one per state.
    pub readings: Vec<Reading>,
    /// The heat, for the machine's log.
    pub heat: Heat,
}

/// Measures a machine on a day: `day` draws dwell times, weather, mountings and noise.
///
/// # Errors
/// An effect that there is no formula for.
pub fn measure(truth: &FormulaTruth, day: u64) -> Result<Measurement, FormulaError> {
    truth.check()?;
    let course: Course = programs::all(day);
    let heat = Heat::new(&course, day);
    let world = laws::World { rows: &course.rows, heat: &heat, day };
    let laws = laws::all(truth, &world)?;
    let readings = instrument::measure(truth, &laws, &world);
    Ok(Measurement { rows: course.rows, readings, heat })
}
