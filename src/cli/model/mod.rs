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

/// Reads a model file with its provenance.
fn load(path: &Path) -> Result<ModelFile> {
    let bytes = input::read(path, InputKind::Model)?;
    let file = path.display().to_string();
    let text = String::from_utf8(bytes).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        mistake!(file, "byte {at} is not UTF-8; save the file as UTF-8")
    })?;
    Ok(config::model::parse_file(&file, &text)?)
}
