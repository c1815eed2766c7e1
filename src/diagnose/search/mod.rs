//! The search for causes in the whitened problem.

mod agreement;
mod beside;
mod data_partition;
mod discrepancy;
mod figures;
mod joint;
mod low_rank;
mod metric;
mod pitch_search;
mod pivot;
mod pivoted_cholesky;
mod problem;
mod raw_columns;
mod refine;
mod rival_comparison;
mod roughness;
mod select;
mod size_comparison;
mod slope_degeneracy;
mod structure;
#[cfg(test)]
mod tests;
mod variation;

pub use agreement::posterior_deviation;
pub use data_partition::count_programs;
pub use discrepancy::discrepancy;
pub use figures::{FOLDS, Figures, Whole, figures, fold_of};
pub use low_rank::LowRank;
pub use pitch_search::find_pitches;
pub use pivot::{tilt_about_pivots, turn_about_pivots};
pub use problem::{Given, Problem};
pub(crate) use raw_columns::raw;
pub use raw_columns::{RawColumns, raw_columns};
pub use refine::{one_response_per_axis, refine};
pub use rival_comparison::{challenge, one_of_two, one_worn_place};
pub(crate) use roughness::{Rough, WAVES};
pub use roughness::{Roughness, roughness};
pub use select::{CURVES, Found, SAME_NOISE, SWAP_GAIN, Selection, evidence, threshold};
pub use structure::Structure;
pub use variation::Variation;
