//! `model extend`: what a diagnosis has found becomes part of the model that volcompd corrects with.

use std::path::{Path, PathBuf};

use super::super::{EX_CONFIG, EX_DATAERR, Failure};
use crate::additions::read_addition;
use crate::files::write_text;
use volcomp_config as config;
use volcomp_effects::extend::{Fate, extend};

/// Put effects that `volcomp diagnose` has found into a model, so that volcompd takes them out
///
/// What follows from position and direction of travel becomes a table or a constant of the error motion that acts alike,
/// what follows from temperatures or the spindle's speed a growth ([thermal.NAME]; volcompd needs a sensor of that name).
/// Effects that no offset from these can take out are named, each with the reason. The model is compared with the
/// addition all over the volume before it is written. volcompd takes the new model through its change guard.
///
///   volcomp model extend --model model.toml --add diagnosis/addition.toml --out better.toml
#[derive(Debug, clap::Parser)]
pub(super) struct Args {
    /// The model beside which the effects were found (volcomp-model/1)
    #[arg(long, value_name = "MODEL.toml")]
    model: PathBuf,
    /// An addition (volcomp-addition/1); may be repeated
    #[arg(long, value_name = "ADDITION.toml", required = true)]
    add: Vec<PathBuf>,
    /// Where to write the model; - is stdout
    #[arg(long, value_name = "OUT.toml")]
    out: PathBuf,
    /// Print one JSON object instead of text
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let mut model = super::load(&args.model)?;
    let mut fates: Vec<(String, Fate)> = Vec::new();
    for path in &args.add {
        let addition = read_addition(path)?;
        // found without a model it holds the whole deviation: that of a model without errors
        let beside_none =
            addition.machine.is_empty() && model.spec.errors.is_empty() && model.thermal.is_empty();
        if !beside_none {
            addition
                .is_of(&model.spec.machine)
                .map_err(|e| Failure::new(EX_CONFIG, format_args!("error: {}: {e}", path.display())))?;
        }
        let extended = extend(&model.spec, &model.thermal, &addition).map_err(|e| {
            Failure::new(
                EX_CONFIG,
                format_args!("error: {} with {}: {e}", args.model.display(), path.display()),
            )
        })?;
        (model.spec, model.thermal) = (extended.spec, extended.thermal);
        fates.extend(extended.fates);
    }
    if !fates.iter().any(|(_, fate)| fate.is_taken()) {
        let why: Vec<String> = fates.iter().map(|f| format!("\n  {}", line(f))).collect();
        let files: Vec<String> = args.add.iter().map(|p| p.display().to_string()).collect();
        return Err(Failure::new(
            EX_DATAERR,
            format_args!(
                "error: {}: nothing in it can be part of a model; the model stays as it is{}",
                files.join(", "),
                why.concat()
            ),
        ));
    }
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let added: Vec<String> = args.add.iter().map(|p| name(p)).collect();
    let comment =
        format!("{} with {}, written by volcomp model extend.", name(&args.model), added.join(", "));
    write_text(&args.out, &config::model::write_file(&model, &[comment]))?;
    if args.json {
        let report = serde_json::json!({
            "effects": fates.iter().map(as_json).collect::<Vec<_>>(),
            "sensors": model.growths_in_use().flat_map(|t| t.inputs.iter().map(|i| i.sensor.clone()))
                .collect::<std::collections::BTreeSet<_>>(),
            "out": args.out.display().to_string(),
        });
        return say(args, &format!("{report:#}\n"));
    }
    let mut lines: Vec<String> = fates.iter().map(line).collect();
    lines.push(format!("written: {}", args.out.display()));
    say(args, &(lines.join("\n") + "\n"))
}

/// Where the model goes to stdout, words go beside it.
fn say(args: &Args, text: &str) -> Result<(), Failure> {
    if args.out.as_os_str() == "-" {
        crate::note_text(format_args!("{text}"));
        return Ok(());
    }
    crate::exit::print(text)
}

fn line((effect, fate): &(String, Fate)) -> String {
    format!("{effect}: {fate}")
}

fn as_json((effect, fate): &(String, Fate)) -> serde_json::Value {
    let why = match fate {
        Fate::Taken(_) => None,
        Fate::Left(why) => Some(why),
    };
    serde_json::json!({ "effect": effect, "taken": fate.is_taken(), "symbols": fate.symbols(), "why": why })
}
