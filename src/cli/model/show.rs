//! `model show`: what is in a model, where it is worst, and a picture of it.

use super::report::Report;
use super::{html, picture};
use crate::files::read_model_file;
use crate::prelude::*;
use crate::progress::Progress;
use volcomp_model::extremes::search;

/// Show a model: chain, errors, worst error in the working volume, corrections; with --html or --svg as a picture
#[derive(Debug, clap::Parser)]
pub(crate) struct Args {
    /// Model file (volcomp-model/1)
    #[arg(value_name = "MODEL")]
    file: PathBuf,
    /// Write a page with everything and the pictures; it needs no other file
    #[arg(long, value_name = "OUT.html")]
    html: Option<PathBuf>,
    /// Write the pictures alone: error curves per axis and the distorted volume
    #[arg(long, value_name = "OUT.svg")]
    svg: Option<PathBuf>,
    /// List what deviates from the datum and reference-line convention
    #[arg(long)]
    verbose: bool,
    /// Print one JSON object instead of text
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let file = read_model_file(&args.file)?;
    let model = Model::new(&file.spec).map_err(|e| Failure::new(EX_CONFIG, e))?;
    let bar = Progress::of_steps();
    let found = search(&file.spec, &model, |done, of| bar.show(done, of));
    bar.finish();
    let name = args.file.display().to_string();
    let report = Report { file: &file, name: &name, found: &found };
    if let Some(out) = &args.svg {
        write_text(out, &picture::whole(&file.spec, &model)?)?;
    }
    if let Some(out) = &args.html {
        write_text(out, &html::page(&report, &model)?)?;
    }
    if args.json {
        let mut json = report.as_json();
        let path = |p: &Option<PathBuf>| p.as_ref().map(|p| p.display().to_string());
        json["html"] = path(&args.html).into();
        json["svg"] = path(&args.svg).into();
        return crate::exit::print(&format!("{json:#}\n"));
    }
    let mut lines: Vec<String> = report.lines(args.verbose).iter().map(|line| micro(line)).collect();
    let written = [&args.html, &args.svg].into_iter().flatten();
    lines.extend(written.map(|out| format!("written: {}", out.display())));
    if args.html.is_none() && args.svg.is_none() {
        let hint = Path::new(args.file.file_stem().unwrap_or_default()).with_extension("html");
        let what = "with curves and the distorted volume as a picture";
        lines.push(format!("{what}: add --html {}", hint.display()));
    }
    crate::exit::print(&(lines.join("\n") + "\n"))
}
