//! `volcomp diagnose`: where the gap between measurement and prediction lies, what causes it, and how far it shrinks.

mod html_report;
mod ideal;
mod input;
mod instruments;
mod logs;
mod terms;
mod text_report;

use std::fs;
use std::io::{self, IsTerminal};

use self::ideal::Rotary;
use self::input::Source;
use self::terms::Compensable;
use super::additions::{is_of, read_addition};
use super::exit;
use super::files::read_hashed_model;
use crate::prelude::*;
use volcomp_diagnose::library::{Label, Without};
use volcomp_diagnose::session::{Logs, Raw, Session};
use volcomp_diagnose::{Ablation, Dialect, Options, diagnose, plan, predict};
use volcomp_effects::addition::{Addition, Base};
use volcomp_effects::machine_state::Machine;
use volcomp_effects::prediction::machine_of;

/// Find out where the gap between measurement and prediction lies, which effects cause it, and how far it shrinks.
///
/// Files of instruments and controls are read as they are: ISO 230-2 tests (.dat, .rtl, .pos, CSV), circular tests (CSV),
/// plates measured on a CMM, points of a tracker (CSV), captures of a SINUMERIK Edge (JSON, CSV), logs of displacement. The format
/// is detected from the content; stderr and the notes of the report state what was detected and assumed.
///
/// Session files are CSV tables with one scalar reading per row in the order measured: t_s, instrument, setup, run, repeat,
/// positions, u_x u_y u_z, deviation_um; all columns: docs/reference/session-files.md.
///
/// Without --model the machine is ideal, with the axes of the data; it is written to model.toml in --out, ready for volcomp
/// model extend.
#[derive(Debug, clap::Parser)]
#[command(after_help = include_str!("help.txt"))]
pub(super) struct Args {
    /// The model file; without one an ideal machine with the axes of the data.
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// An addition found earlier; may be repeated.
    #[arg(long, value_name = "FILE")]
    add: Vec<PathBuf>,
    /// A session file, or a file of an instrument or a control; may be repeated, each has a clock of its own.
    #[arg(long, value_name = "FILE", num_args = 1.., required_unless_present_any = ["list_effects", "files"])]
    data: Vec<PathBuf>,
    /// The files of --data.
    #[arg(value_name = "FILE", conflicts_with = "data")]
    files: Vec<PathBuf>,
    /// New data of the same program, to see how far the gap really shrinks; may be repeated.
    #[arg(long, value_name = "FILE")]
    fresh: Vec<PathBuf>,
    /// A log of the machine on the clock of the sessions; may be repeated.
    #[arg(long, value_name = "CSV")]
    history: Vec<PathBuf>,
    /// A log of the machine on the clock of the fresh data, where that is another day; may be repeated. Without one those of
    /// --history count there, too.
    #[arg(long, value_name = "CSV", requires = "fresh")]
    fresh_history: Vec<PathBuf>,
    /// Take an effect out of the library, such as backlash or backlash:x; may be repeated.
    #[arg(long, value_name = "EFFECT[:SUBJECT]", value_parser = without)]
    without: Vec<Without>,
    /// Folder for report.json, report.html and addition.toml; without it nothing is written.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write the report to stdout as well, as JSON.
    #[arg(long)]
    json: bool,
    /// Seed of the random draws.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// List all effects, or explain one.
    #[arg(long, value_name = "EFFECT", num_args = 0..=1, default_missing_value = "")]
    list_effects: Option<String>,
    /// Say what a plan can see before anyone measures: --data are its rows, deviations may be missing.
    #[arg(long)]
    plan: bool,
    /// Take something away from the method, to prove that tests of it can fail.
    #[arg(long, hide = true, value_name = "WHAT", value_parser = ablation)]
    ablate: Option<Ablation>,
    /// The control for which part programs of the next measurement are written.
    #[arg(long, value_name = "CONTROL", default_value = "linuxcnc", value_parser = dialect)]
    dialect: Dialect,
    #[command(flatten)]
    instruments: instruments::InstrumentArgs,
}

fn ablation(text: &str) -> Result<Ablation, String> {
    match text {
        "no-gates" => Ok(Ablation::NoGates),
        "no-drift" => Ok(Ablation::NoDrift),
        "plain" => Ok(Ablation::Plain),
        _ => Err(format!("'{text}' is none of no-gates, no-drift, plain")),
    }
}

fn dialect(text: &str) -> Result<Dialect, String> {
    match text {
        "linuxcnc" => Ok(Dialect::LinuxCnc),
        "fanuc" => Ok(Dialect::Fanuc),
        "sinumerik" => Ok(Dialect::Sinumerik),
        _ => Err(format!("unknown control '{text}'; expected one of linuxcnc, fanuc, sinumerik")),
    }
}

fn without(text: &str) -> Result<Without, String> {
    let (effect, subject) = Label::parse(text).map_err(|e| e.to_string())?;
    Ok(Without { effect, subject })
}

pub(super) fn run(args: &Args) -> Result<()> {
    if let Some(name) = &args.list_effects {
        return text_report::list_effects(name);
    }
    let model = args.model.as_deref().map(read_hashed_model).transpose()?;
    let additions = args.add.iter().map(|p| read_addition(p)).collect::<Result<Vec<_>, _>>()?;
    let machine = model.as_ref().map_or_else(Machine::plain, |(spec, model, _)| machine_of(spec, model));
    let mut bar = Bar::new();
    bar.report(0.0, "reading");
    for (path, addition) in args.add.iter().zip(&additions) {
        if let Some((_, model, hash)) = &model {
            is_of(path, addition, (model, hash))?;
        }
    }
    let base = args.model.as_ref().zip(model.as_ref());
    let base = base.map(|(path, (.., hash))| Base { file: path.display().to_string(), hash: hash.clone() });
    let (spec, model) = model.map(|(spec, model, _)| (spec, model)).unzip();
    let data = if args.data.is_empty() { &args.files } else { &args.data };
    let logs = logs::read(&args.history)?;
    let known = (model.as_ref(), &additions[..], &machine);
    let (mut session, rotary, stated) = load(args, data, &logs, known)?;
    if args.plan {
        let seen = plan(&mut session, &args.without);
        bar.end();
        return text_report::plan(&seen, args.json);
    }
    let mut fresh = match args.fresh.as_slice() {
        [] => None,
        files => {
            let own = logs::read(&args.fresh_history)?;
            let logs = if args.fresh_history.is_empty() { &logs } else { &own };
            let (fresh, ..) = load(args, files, logs, known)?;
            let new: Vec<_> = fresh.notes.iter().filter(|n| !session.notes.contains(n)).cloned().collect();
            session.notes.extend(new);
            Some(fresh)
        }
    };
    let options = Options {
        without: args.without.clone(),
        seed: args.seed,
        machine: model.as_ref().map_or_else(String::new, |m| m.machine().to_owned()),
        ablation: args.ablate.unwrap_or_default(),
        dialect: args.dialect,
    };
    let mut found =
        diagnose(&mut session, fresh.as_mut(), &options, &mut |share, what| bar.report(share, what));
    found.addition.base = base;
    bar.end();
    let json = serde_json::to_string_pretty(&found.report)
        .map_err(|e| failure!(super::EX_SOFTWARE, "report.json: {e}"))?;
    let text =
        toml::to_string(&found.addition).map_err(|e| failure!(super::EX_SOFTWARE, "addition.toml: {e}"))?;
    let compensable = Compensable::of(&found, spec.as_ref());
    if let Some(out) = &args.out {
        #[expect(clippy::disallowed_methods, reason = "the folder of the results is made")]
        fs::create_dir_all(out).map_err(|e| Failure::io(out, &e))?;
        write_text(&out.join("report.json"), &format!("{json}\n"))?;
        write_text(&out.join("addition.toml"), &text)?;
        if model.is_none()
            && let Some(ideal) = ideal::model_file(&session, rotary)?
        {
            write_text(&out.join("model.toml"), &ideal)?;
        }
        write_text(&out.join("report.html"), &html_report::page(&session, &found, &compensable))?;
    }
    if args.json {
        exit::print(&format!("{json}\n"))
    } else {
        text_report::summary(&session, &found, &compensable, stated, args.out.as_deref())
    }
}

/// What is known of the machine: the model, what was found earlier, and the kinematics.
type Known<'a> = (Option<&'a Model>, &'a [Addition], &'a Machine);

/// A session with its predictions, the rotary axis of a test without a model, and the number of notes that stderr states.
fn load(
    args: &Args,
    files: &[PathBuf],
    logs: &Logs,
    of: Known<'_>,
) -> Result<(Session, Option<Rotary>, usize)> {
    let (model, additions, machine) = of;
    let mut raws: Vec<Raw> = Vec::with_capacity(files.len());
    let (mut detected, mut rotary) = (Vec::new(), None);
    for path in files {
        match input::session(path, &args.instruments, model, args.plan)? {
            Source::Table(raw) => raws.push(raw),
            Source::Instrument(found) => {
                detected.extend(found.announce(path));
                rotary = rotary.or(found.rotary);
                raws.push(found.raw);
            }
        }
    }
    let (history, notes) = logs.of(&raws, logs::folder_of).map_err(|e| failure!(EX_DATAERR, "{e}"))?;
    let ideal = rotary.filter(|_| model.is_none()).map(ideal::rotary_machine).transpose()?;
    let machine = ideal.as_ref().map_or(machine, |(machine, _)| machine);
    let mut session =
        Session::build(&raws, history, machine.clone()).map_err(|e| failure!(EX_DATAERR, "{e}"))?;
    let stated = detected.len();
    session.notes.splice(0..0, detected);
    session.notes.extend(notes);
    session.notes.extend(session.outside_travel(machine));
    input::chain(&mut session, model.or(ideal.as_ref().map(|(_, model)| model)))?;
    if model.is_some() || !additions.is_empty() {
        predict(&mut session, model, additions).map_err(|e| failure!(EX_DATAERR, "{e}"))?;
    }
    Ok((session, rotary, stated))
}

/// Progress on stderr: one line that is written over on a terminal, nothing otherwise.
struct Bar {
    shown: bool,
}

impl Bar {
    #[expect(clippy::disallowed_methods, reason = "progress is for a terminal")]
    fn new() -> Self {
        Self { shown: io::stderr().is_terminal() }
    }

    fn report(&mut self, share: f64, what: &str) {
        if self.shown {
            crate::note_text(format_args!("\r{:3.0} % {what:<40}", 100.0 * share));
        }
    }

    fn end(&mut self) {
        if self.shown {
            crate::note_text(format_args!("\r{:50}\r", ""));
        }
    }
}
