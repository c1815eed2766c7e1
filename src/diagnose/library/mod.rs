//! The effects that are searched for: the formulas of `volcomp-effects` on grids over what is not linear ([`candidates`]).

mod candidates;

pub use candidates::{Blind, Library, Variant};
pub use volcomp_effects::{
    Kind, Label, LabelError, Lever, PAGES, Page, REFERENCE_DEGC, RotaryFrame, STILL, Shape, WIDTH_MAX,
    Without, legendre, line_of_sight, page,
};
