//! `cncsim campaign`: a standard measurement campaign on the twin, as files for `volcomp diagnose`.

use std::path::{Path, PathBuf};

use super::tool::Tool;
use super::{EX_CONFIG, EX_DATAERR, EX_IOERR, EX_SOFTWARE, EX_USAGE, Failure, InputKind, read};
use crate::campaign::files::Files;
use crate::campaign::points::points;
use crate::campaign::{Campaign, Plan, run_campaign};
use crate::twin::catalogue::CATALOGUE;
use crate::twin::machine::nominal_model;
use crate::twin::quantity::Quantity;
use crate::twin::{TwinError, TwinTruth};

#[derive(Debug, clap::Args)]
#[command(
    after_help = "The truth file (volcomp-twin/1) says what is wrong with machine and instruments; without one, nothing \
    is:\n\n  \
    format = \"volcomp-twin/1\"\n  seed = 7                      # draws all constants that are not given\n  \
    [instruments]\n  heavy-tails = true            # all keys: docs/development/blind-tests.md\n  \
    [[effect]]\n  name = \"backlash\"\n  subject = \"x\"\n  width-um = 6.0                # the reversal error; size-um = 3.0 is the same\n  with = { length-mm = 0.2 }\n\n\
    Examples:\n  cncsim campaign --truth twin.toml --seed 1 --out monday\n  \
    cncsim campaign --truth twin.toml --seed 2 --out tuesday     the same machine on another day\n  \
    volcomp diagnose --model monday/model.toml --data monday/laser.csv --data monday/ballbar.csv \\\n    \
    --history monday/history.csv --out gap\n  \
    cncsim campaign --add gap/addition.toml --seed 3 --out twin  what the diagnosis has found, on a twin without other \
    faults\n  \
    cncsim campaign --list-effects"
)]
pub(super) struct Args {
    /// What is wrong with the machine; never given to the diagnosis.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// The day: weather, mountings, noise. The machine's own constants have the seed of the truth file.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Folder for the session files, history.csv, model.toml and campaign.json; made where it is missing.
    #[arg(long, value_name = "DIR", required_unless_present = "list_effects")]
    out: Option<PathBuf>,
    /// What is measured.
    #[arg(long, value_enum, default_value = "full")]
    plan: Plan,
    /// What volcomp diagnose has found (addition.toml), put on the twin as volcomp predicts it; may be repeated. Without
    /// --truth: what the simulation says of the real machine now.
    #[arg(long, value_name = "FILE")]
    add: Vec<PathBuf>,
    /// The volcomp that predicts for --add [default: the one of this program].
    #[arg(long, value_name = "VOLCOMP", requires = "add")]
    tool: Option<PathBuf>,
    /// Print what was written as one JSON object.
    #[arg(long)]
    json: bool,
    /// List the effects that the twin has physics for, with their subjects and constants.
    #[arg(long)]
    list_effects: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    if args.list_effects {
        list();
        return Ok(());
    }
    let Some(out) = &args.out else {
        return Err(Failure::new(EX_USAGE, "--out DIR is missing"));
    };
    let truth = match &args.truth {
        Some(path) => TwinTruth::read(&read(path, InputKind::Description)?)
            .map_err(|e| Failure::in_file(EX_CONFIG, path, e))?,
        None => TwinTruth::perfect(0),
    };
    let campaign = run_campaign(&truth, args.plan, args.seed).map_err(|e| match e {
        TwinError::Chain(_) => Failure::new(EX_SOFTWARE, e),
        e => Failure::new(EX_DATAERR, e),
    })?;
    let mut campaign = campaign;
    if !args.add.is_empty() {
        add(args, out, &mut campaign)?;
    }
    let names = write_all(out, Files::of(&campaign))?;
    let first = campaign.taken.states.first().map_or(0.0, |s| s.t_s);
    let last = campaign.taken.states.last().map_or(0.0, |s| s.t_s);
    let summary = serde_json::json!({
        "format": "volcomp-campaign/1",
        "plan": format!("{:?}", args.plan),
        "seed": args.seed,
        "rows": campaign.measured.len(),
        "machine_time_s": last - first,
        "model": out.join("model.toml"),
        "history": out.join("history.csv"),
        "data": names.iter().map(|n| out.join(n)).collect::<Vec<_>>(),
    });
    let text = serde_json::to_string_pretty(&summary).map_err(|e| Failure::new(EX_SOFTWARE, e))?;
    save(&out.join("campaign.json"), &format!("{text}\n"))?;
    if args.json {
        say!("{text}");
    } else {
        let data: Vec<String> = names.iter().map(|n| format!("--data {}", out.join(n).display())).collect();
        for effect in &truth.effects {
            say!("truth: {}", Quantity::line(effect));
        }
        say!("{} readings of {:.1} h", campaign.measured.len(), (last - first) / 3600.0);
        say!(
            "volcomp diagnose --model {} {} --history {} --out gap",
            out.join("model.toml").display(),
            data.join(" "),
            out.join("history.csv").display()
        );
    }
    Ok(())
}

/// Adds what `volcomp predict` says of additions to the readings; the twin itself knows nothing of them.
fn add(args: &Args, out: &Path, campaign: &mut Campaign) -> Result<(), Failure> {
    crate::cli::make_folder(out).map_err(|e| Failure::in_file(EX_IOERR, out, e))?;
    let points = points(campaign);
    save(&out.join("points.csv"), &points.text)?;
    save(&out.join("model.toml"), &nominal_model())?;
    let mut words: Vec<String> =
        ["predict", "--model", "model.toml", "--points", "points.csv", "--out", "-"].map(String::from).into();
    for path in &args.add {
        // the tool runs in the folder of the campaign
        let path = path.canonicalize().map_err(|e| Failure::in_file(EX_IOERR, path, e))?;
        words.extend(["--add".to_owned(), path.display().to_string()]);
    }
    let said = Tool::new(args.tool.as_deref())?.run(out, &words)?;
    let wrong = |e: &dyn std::fmt::Display| Failure::new(EX_SOFTWARE, format_args!("volcomp predict: {e}"));
    let mut table = csv::Reader::from_reader(said.as_bytes());
    let header = table.headers().map_err(|e| wrong(&e))?.clone();
    let at = |name: &str| header.iter().position(|h| h == name).ok_or_else(|| wrong(&format!("no {name}")));
    // the offsets of the axes that oppose the deviation: its components along the machine's axes, with the other sign
    let columns = [at("cx_um")?, at("cy_um")?, at("cz_um")?];
    for (row, state) in table.records().zip(&points.states) {
        let row = row.map_err(|e| wrong(&e))?;
        let Some(state) = *state else { continue };
        let mut along_um = 0.0;
        for (column, u) in columns.into_iter().zip(campaign.taken.states[state].u) {
            let text = row.get(column).unwrap_or_default();
            along_um -= u * text.parse::<f64>().map_err(|e| wrong(&format!("{text:?}: {e}")))?;
        }
        let measured = &mut campaign.measured[state];
        measured.deviation_um = measured.deviation_um.map(|d| d + along_um);
    }
    Ok(())
}

/// Writes what a day's measurement gives into a folder, made where it is missing; the names of its session files.
pub(super) fn write_all(out: &Path, files: Files) -> Result<Vec<String>, Failure> {
    crate::cli::make_folder(out).map_err(|e| Failure::in_file(EX_IOERR, out, e))?;
    for file in files.sessions.iter().chain([&files.history, &files.model]) {
        save(&out.join(&file.name), &file.text)?;
    }
    Ok(files.sessions.into_iter().map(|f| f.name).collect())
}

/// Writes a text file.
pub(super) fn save(path: &Path, text: &str) -> Result<(), Failure> {
    crate::cli::write_file(path, text).map_err(|e| Failure::in_file(EX_IOERR, path, e))
}

fn list() {
    for e in CATALOGUE {
        let subjects = e.subjects.list().join(" ");
        let with =
            if e.constants.is_empty() { String::new() } else { format!("  with: {}", e.constants.join(" ")) };
        say!("{:20} {}", e.name, e.physics);
        if !(subjects.is_empty() && with.is_empty()) {
            say!("{:20}   {subjects}{with}", "");
        }
    }
}
