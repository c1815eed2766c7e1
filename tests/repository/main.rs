//! The repository itself: dependency rule, generated pages, proofs that the pages name.

mod architecture;
mod data_sets;
mod packaging;
mod reference_pages;
mod safety_page;
mod threat_model;
