//! What reports share: a page that needs no other file and prints on A4 ([`page`]), and the ground of SVG plots
//! ([`plot`]).

pub(super) mod page;
pub(super) mod plot;

pub(super) use page::Page;
