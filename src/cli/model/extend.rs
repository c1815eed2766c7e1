//! `model extend`: what a diagnosis has found becomes part of the model that volcompd corrects with.

use super::forecast::Forecast;
use crate::additions::read_addition;
use crate::prelude::*;
use volcomp_effects::addition::Twice;
use volcomp_effects::extend::{Fate, extend};

/// Put effects that `volcomp diagnose` has found into a model, so that volcompd takes them out
///
/// Effects of position become tables or constants of an error motion; effects of direction, velocity and acceleration become
/// dynamic terms of it ([errors.exx.reversal], .velocity, ..); effects of the tool length go to the section `tool`; effects
/// of temperature or spindle speed become growths ([thermal.NAME]; volcompd needs a sensor of that name). The model is
/// compared with the addition over the working volume before it is written. Effects that stay out are listed with the
/// reason. With the report of the diagnosis (report.json beside the addition, or --report) each line states how much of
/// the forecast shrink the model can deliver. volcompd takes the new model through its change guard.
///
///   volcomp model extend --model model.toml --add diagnosis/addition.toml --out better.toml
#[derive(Debug, clap::Parser)]
pub(crate) struct Args {
    /// The model with which the effects were found (volcomp-model/1)
    #[arg(long, value_name = "MODEL.toml")]
    model: PathBuf,
    /// An addition (volcomp-addition/1); may be repeated
    #[arg(long, value_name = "ADDITION.toml", required = true)]
    add: Vec<PathBuf>,
    /// The report of the diagnosis (default: report.json beside the first addition, where there is one)
    #[arg(long, value_name = "REPORT.json")]
    report: Option<PathBuf>,
    /// Where to write the model; - is stdout
    #[arg(long, value_name = "OUT.toml")]
    out: PathBuf,
    /// Add effects that were found with another model; terms that the model has already stay single
    #[arg(long)]
    force: bool,
    /// Print one JSON object instead of text
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let (mut model, hash) = read_hashed_model_file(&args.model)?;
    let mut fates: Vec<(String, Fate)> = Vec::new();
    for path in &args.add {
        let addition = read_addition(path)?;
        // found without a model it holds the whole deviation: that of a model without errors
        let beside_none =
            addition.machine.is_empty() && model.spec.errors.is_empty() && model.thermal.is_empty();
        if !beside_none {
            addition.is_of(&model.spec.machine).map_err(|e| mistake!(path, "{e}"))?;
        }
        let twice = |e: Twice| {
            let model = args.model.display();
            let force = match e {
                Twice::OtherBase { .. } => "to add it all the same",
                Twice::Held { .. } => "to add its other effects",
            };
            mistake!(path, "{e}; diagnose again with --model {model}, or state --force {force}")
        };
        if !args.force {
            addition.is_beside(&hash).map_err(twice)?;
        }
        let extended = extend(&model.spec, &model.thermal, &addition)
            .map_err(|e| failure!(EX_CONFIG, "{} with {}: {e}", args.model.display(), path.display()))?;
        if !args.force {
            extended.is_new().map_err(twice)?;
        }
        (model.spec, model.thermal) = (extended.spec, extended.thermal);
        fates.extend(extended.fates);
    }
    if !fates.iter().any(|(_, fate)| fate.is_taken()) {
        let why = fates.iter().map(|f| format!("\n  {}", line(f))).joined("");
        let files = args.add.iter().map(|p| p.display()).joined(", ");
        let what = "nothing in it can be part of a model; the model stays as it is";
        return Err(failure!(EX_DATAERR, "{files}: {what}{why}"));
    }
    let forecast = args.add.first().map(|path| Forecast::read(args.report.as_ref(), path));
    let forecast = forecast.transpose()?.flatten();
    let delivered = forecast.as_ref().map(|f| f.delivered(&fates));
    let added = args.add.iter().map(|p| file_name(p)).joined(", ");
    let comment = format!("{} with {added}, written by volcomp model extend.", file_name(&args.model));
    write_model(&args.out, &config::model::write_file(&model, &[comment]))?;
    if args.json {
        let report = serde_json::json!({
            "effects": fates.iter().map(|fate| as_json(fate, forecast.as_ref())).collect::<Vec<_>>(),
            "shrink": delivered.map(|d| d.json()),
            "sensors": model.growths_in_use().flat_map(|t| t.inputs.iter().map(|i| i.sensor.clone()))
                .collect::<BTreeSet<_>>(),
            "out": args.out.display().to_string(),
        });
        return say(args, &format!("{report:#}\n"));
    }
    let mut lines: Vec<String> = fates.iter().map(|fate| with_shrink(fate, forecast.as_ref())).collect();
    let is_delay = |(effect, fate): &(String, Fate)| effect == "latency" && fate.is_taken();
    lines.extend(fates.iter().any(is_delay).then(|| DELAY.to_owned()));
    lines.extend(delivered.map(|d| d.line()));
    lines.push(format!("written: {}", args.out.display()));
    say(args, &(lines.join("\n") + "\n"))
}

/// Where the model goes to stdout, words go beside it.
fn say(args: &Args, text: &str) -> Result<()> {
    if args.out.as_os_str() == "-" {
        crate::note_text(format_args!("{text}"));
        return Ok(());
    }
    crate::exit::print(text)
}

fn line((effect, fate): &(String, Fate)) -> String {
    format!("{effect}: {fate}")
}

/// A delay of the machine and one of the recording look the same.
const DELAY: &str = "note: a delay of the recording looks like one of the machine; measure again with the new model before use";

/// The line of an effect with its part of the forecast shrink.
fn with_shrink(one: &(String, Fate), forecast: Option<&Forecast>) -> String {
    let (effect, fate) = one;
    match forecast.and_then(|f| f.of_effect(effect)) {
        Some(shrink) => {
            let deliverable = if fate.is_taken() { shrink } else { 0.0 };
            format!("{}; shrink {deliverable:.2} of {shrink:.2}", line(one))
        }
        None => line(one),
    }
}

fn as_json((effect, fate): &(String, Fate), forecast: Option<&Forecast>) -> serde_json::Value {
    let why = match fate {
        Fate::Taken(_) => None,
        Fate::Left(why) => Some(why),
    };
    let shrink = forecast.and_then(|f| f.of_effect(effect));
    serde_json::json!({
        "effect": effect,
        "taken": fate.is_taken(),
        "symbols": fate.symbols(),
        "why": why,
        "shrink_forecast": shrink,
        "shrink_deliverable": shrink.map(|s| if fate.is_taken() { s } else { 0.0 }),
    })
}
