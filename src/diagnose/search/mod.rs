//! The search for causes in the whitened problem.

mod agreement;
mod gates;
mod instead;
mod lines;
mod pieces;
mod problem;
mod refine;
mod screw;
mod select;
mod small;
#[cfg(test)]
mod tests;
mod variation;

pub use agreement::posterior_deviation;
pub use gates::{FOLD_RIDGE, FOLDS, Figures, figures, fold_of};
pub use instead::{challenge, one_delay, one_tilt, one_worn_place};
pub use pieces::count_programs;
pub use problem::{Given, Problem, RawColumns, raw_columns};
pub use refine::refine;
pub use screw::find_pitches;
pub use select::{CURVES, Found, Selection, evidence, threshold};
pub use variation::Variation;
