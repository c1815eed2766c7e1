//! `model`: what is in a model file, in words, numbers and pictures; its normal form; several put together.

mod assemble;
mod documentation;
mod drawing;
mod extend;
mod forecast;
pub(super) mod gauge;
mod html;
mod normalise;
mod picture;
pub(super) mod report;
mod show;

use crate::prelude::*;

subcommands! {
    /// Show what is in a model file, document it, write its normal form, put measurements together, or add what a diagnosis has found
    pub(super) enum Verb {
        Show(show::Args) => show::run,
        Report(documentation::Args) => documentation::run,
        Assemble(Box<assemble::Args>) => assemble::run,
        Extend(extend::Args) => extend::run,
        #[command(alias = "normalize")]
        Normalise(normalise::Args) => normalise::run,
    }
}
