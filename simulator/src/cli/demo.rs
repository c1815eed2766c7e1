//! `cncsim demo` and `cncsim survey`.

use std::path::PathBuf;

use super::serve::built_in_or_file;
use super::{EX_DATAERR, EX_IOERR, EX_SOFTWARE, EX_USAGE, Failure};
use crate::demo::programs::Programs;
use crate::demo::survey::survey_to;
use crate::demo::{Options, Outcome, run};
use crate::instruments::survey::SurveyPlan;
use crate::motion::profile::checked_cycle_s;

#[derive(Debug, clap::Args)]
pub(super) struct DemoArgs {
    /// Print the figures as one JSON object.
    #[arg(long)]
    json: bool,
    /// Folder for the picture, the page and all files of the run; made where it does not exist.
    #[arg(long, value_name = "FOLDER", default_value = "demo-output")]
    out: PathBuf,
    /// Seed of the noise of machine and instruments; the same seed gives the same figures.
    #[arg(long, default_value = "1")]
    seed: u64,
    /// Control cycle in ms, 0.25 to 10.
    #[arg(long, value_name = "MS", default_value = "1")]
    cycle_ms: f64,
}

#[derive(Debug, clap::Args)]
pub(super) struct SurveyArgs {
    /// The machine: a truth file, or one of the built-in vmc-850, gantry-5ax, grinder-ab.
    #[arg(long, value_name = "FILE|NAME", default_value = "vmc-850")]
    machine: PathBuf,
    /// Folder for the tables; made where it does not exist.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Distance of positions on linear axes, mm.
    #[arg(long, value_name = "MM", default_value = "25")]
    step_mm: f64,
    /// Standard deviation of linear readings, um.
    #[arg(long, value_name = "UM", default_value = "0.2")]
    noise_um: f64,
    /// Standard deviation of angular readings, arcsec.
    #[arg(long, value_name = "ARCSEC", default_value = "0.1")]
    noise_arcsec: f64,
    /// Seed of the noise.
    #[arg(long, default_value = "1")]
    seed: u64,
}

pub(super) fn demo(args: &DemoArgs) -> Result<(), Failure> {
    let cycle_s = checked_cycle_s(args.cycle_ms * 1e-3).map_err(|e| Failure::new(EX_USAGE, e))?;
    let programs = Programs::this().map_err(|e| Failure::new(EX_SOFTWARE, format_args!("{e:#}")))?;
    let options = Options { folder: args.out.clone(), seed: args.seed, cycle_s, programs };
    let mut step = 0;
    let mut say = |what: &str| {
        step += 1;
        note!("[{step:2}] {what}");
    };
    let outcome = run(&options, &mut say).map_err(|e| Failure::new(EX_SOFTWARE, format_args!("{e:#}")))?;
    if args.json {
        say!("{}", json(&outcome));
    } else {
        print_table(&outcome);
    }
    Ok(())
}

fn json(outcome: &Outcome) -> serde_json::Value {
    serde_json::json!({
        "circle": outcome.circle,
        "diagonal": outcome.diagonal,
        "real_motion": outcome.real_motion,
        "circle_with_ideal_drives_um": outcome.circle_with_ideal_drives_um,
        "picture": outcome.picture,
        "page": outcome.page,
    })
}

fn print_table(outcome: &Outcome) {
    say!();
    say!("{:<15} {:>12} {:>12} {:>8}", "measured", "without / µm", "with / µm", "gone");
    for (name, how, pair) in outcome.table() {
        let gone = 100.0 * pair.reduction();
        say!("{name:<15} {:>12.1} {:>12.1} {gone:>6.0} %   {how}", pair.before_um, pair.after_um);
    }
    say!();
    say!("What is left, and why:");
    for line in outcome.what_is_left() {
        say!("- {line}");
    }
    say!();
    say!("picture: {}", outcome.picture.display());
    say!("page:    {}", outcome.page.display());
}

pub(super) fn survey(args: &SurveyArgs) -> Result<(), Failure> {
    let machine = built_in_or_file(&args.machine)?;
    let plan = SurveyPlan {
        step_mm: args.step_mm,
        noise_um: args.noise_um,
        noise_arcsec: args.noise_arcsec,
        seed: args.seed,
        ..SurveyPlan::default()
    };
    crate::cli::make_folder(&args.out).map_err(|e| Failure::in_file(EX_IOERR, &args.out, e))?;
    let files =
        survey_to(&machine, &plan, &args.out).map_err(|e| Failure::new(EX_DATAERR, format_args!("{e:#}")))?;
    let fit = files.fit_arguments(&args.out.join("model.toml"));
    note!("surveyed {}; now fit a model with", machine.machine());
    say!("volcomp {}", fit.join(" "));
    Ok(())
}
