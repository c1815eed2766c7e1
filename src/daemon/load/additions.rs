//! Additions of a diagnosis that the machine file names: part of the model from the start.

use std::path::Path;

use super::{LoadError, read_named, text};
use volcomp_config::{MachineConfig, ModelFile};
use volcomp_effects::addition::{Addition, Twice};
use volcomp_effects::extend::{Fate, extend};

/// Puts what the additions of the machine file `config_path` say into its model, which has this text; gives the fate of each
/// effect.
///
/// # Errors
/// An addition that cannot be read, is of another machine or model, holds what the model has already, or of which nothing can be part of a model.
pub fn with_additions(
    config_path: &Path,
    config: &MachineConfig,
    (model, text_of_model): (&mut ModelFile, &str),
) -> Result<Vec<(String, Fate)>, LoadError> {
    let mut fates = Vec::new();
    let hash = blake3::hash(text_of_model.as_bytes()).to_hex();
    for name in &config.additions {
        let path = config_path.with_file_name(name);
        let wrong =
            |why: String| LoadError::Addition { config: config_path.to_owned(), path: path.clone(), why };
        let bytes = read_named(config_path, &path, ["addition", "`additions` are"])?;
        let addition = Addition::parse(text(&path, &bytes)?).map_err(wrong)?;
        addition.is_of(&model.spec.machine).map_err(|e| wrong(e.to_string()))?;
        let twice = |e: Twice| {
            let model = config.model.display();
            wrong(format!(
                "{e}; diagnose again with --model {model}, or take the addition out of `additions`"
            ))
        };
        addition.is_beside(&hash).map_err(twice)?;
        let extended = extend(&model.spec, &model.thermal, &addition).map_err(|e| wrong(e.to_string()))?;
        extended.is_new().map_err(twice)?;
        if !extended.fates.iter().any(|(_, fate)| fate.is_taken()) {
            let each: Vec<String> =
                extended.fates.iter().map(|(of, fate)| format!("\n  {of}: {fate}")).collect();
            return Err(wrong(format!("nothing in it can be part of a model{}", each.concat())));
        }
        (model.spec, model.thermal) = (extended.spec, extended.thermal);
        fates.extend(extended.fates);
    }
    Ok(fates)
}
