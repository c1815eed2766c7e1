//! What reports share: a page that needs no other file and prints on A4 ([`page`]), charts
//! that follow its light or dark scheme ([`chart`]), and the ground of other SVG plots ([`plot`]).

pub(super) mod chart;
pub(super) mod page;
pub(super) mod plot;

pub(super) use page::Page;
