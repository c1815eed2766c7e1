//! `model normalise`: writes the normal form of a model (equations 1.8), once and visibly.

use crate::files::read_model_file;
use crate::prelude::*;
use volcomp_model::normalise;

/// Write the normal form of a model: no constants, no slopes, the same predictions up to one rigid motion
///
/// Constants of error motions and slopes of straightnesses go to squareness and location errors; what these cannot
/// hold is a rigid motion of the workpiece, which is printed. Running it again changes nothing.
#[derive(Debug, clap::Parser)]
pub(crate) struct Args {
    /// Model file (volcomp-model/1)
    #[arg(value_name = "IN.toml")]
    file: PathBuf,
    /// Where to write the normal form
    #[arg(long, value_name = "OUT.toml")]
    out: PathBuf,
    /// Print one JSON object instead of text
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut model = read_model_file(&args.file)?;
    let gauged = normalise(&model.spec)
        .map_err(|e| mistake!(args.file, "its normal form breaks a rule of models: {e}"))?;
    let report = if args.json {
        let mut report = super::gauge::as_json(&model.spec);
        report["out"] = args.out.display().to_string().into();
        format!("{report:#}\n")
    } else {
        let lines = super::gauge::lines(&model.spec, true);
        let mut lines: Vec<String> = lines.iter().map(|line| micro(line)).collect();
        lines.push(format!("written: {}", args.out.display()));
        lines.join("\n") + "\n"
    };
    model.spec = gauged.spec;
    let name = args.file.file_name().unwrap_or_default().to_string_lossy();
    let comment = format!("Normal form of {name}, written by volcomp model normalise.");
    write_model(&args.out, &config::model::write_file(&model, &[comment]))?;
    crate::exit::print(&report)
}
