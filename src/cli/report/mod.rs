//! What reports share: a page that needs no other file and prints on A4 ([`page`]), charts
//! that follow its light or dark scheme ([`chart`]), and the ground of other SVG plots ([`plot`]).

#[cfg_attr(
    not(feature = "diagnosis"),
    expect(dead_code, reason = "the report of the diagnosis uses all of it")
)]
pub(super) mod chart;
#[cfg_attr(
    not(feature = "diagnosis"),
    expect(dead_code, reason = "the report of the diagnosis uses all of it")
)]
pub(super) mod page;
pub(super) mod plot;
pub(super) mod table;

pub(crate) use page::Cell;
pub use page::Page;
pub use table::Table;
