//! `volcomp diff`: what is different between two model files, and what it does in the working volume.
//!
//! Exit codes as of `diff`: 0 the same, 1 different, above that trouble.

mod picture;
mod text_report;

use super::progress::Progress;
use crate::prelude::*;
use volcomp_estimate::largest_change;
use volcomp_model::compare::{Comparison, compare};

/// Exit code where the models differ.
const DIFFERENT: u8 = 1;

/// Compare two model files: chain, axes, errors, provenance, and the difference in the working volume
///
/// Differences are second minus first. Exit code: 0 where both say the same (provenance and comments may differ), 1
/// where they do not, 64 and above where they could not be compared. With a tolerance, 0 where position and direction
/// differ nowhere in the working volume by more; terms that follow motion, sensors or temperatures count by their limits.
#[derive(Debug, clap::Parser)]
pub(super) struct Args {
    /// The first model file
    #[arg(value_name = "A.toml")]
    first: PathBuf,
    /// The second model file
    #[arg(value_name = "B.toml")]
    second: PathBuf,
    /// Exit with 0 where positions differ by no more than this
    #[arg(long, value_name = "UM")]
    tolerance_um: Option<f64>,
    /// And directions by no more than this
    #[arg(long, value_name = "ARCSEC")]
    tolerance_arcsec: Option<f64>,
    /// Write the curves that differ as a picture
    #[arg(long, value_name = "OUT.svg")]
    svg: Option<PathBuf>,
    /// Write a page with everything; it needs no other file and prints on A4
    #[arg(long = "html", value_name = "OUT.html", alias = "report")]
    report: Option<PathBuf>,
    /// Print one JSON object instead of text
    #[arg(long)]
    json: bool,
}

/// Two files and what is different.
struct Diff {
    names: [String; 2],
    files: [ModelFile; 2],
    found: Comparison,
}

impl Diff {
    /// True where both say the same.
    fn is_same(&self) -> bool {
        self.found.is_same() && self.thermal_names().is_empty()
    }

    /// Thermal displacements that differ, by name.
    fn thermal_names(&self) -> BTreeSet<&str> {
        let [a, b] = self.files.each_ref().map(|f| &f.thermal);
        let all = a.iter().filter(|t| !b.contains(t)).chain(b.iter().filter(|t| !a.contains(t)));
        all.map(|t| &*t.name).collect()
    }
}

pub(super) fn run(args: &Args) -> Result<()> {
    let files = [read_model_file(&args.first)?, read_model_file(&args.second)?];
    let steps = Progress::of_steps();
    let mut found = compare(&files[0].spec, &files[1].spec, |done, of| steps.show(done, of))
        .map_err(|e| failure!(super::EX_CONFIG, "{e}"))?;
    steps.finish();
    let names = [&args.first, &args.second].map(|p| p.display().to_string());
    let (specs, thermals) = (files.each_ref().map(|f| &f.spec), files.each_ref().map(|f| &f.thermal[..]));
    found.unsearched[0] += largest_change(specs, thermals);
    let diff = Diff { names, files, found };
    if let Some(path) = &args.svg {
        write_text(path, &picture::curves(&diff)?)?;
    }
    if let Some(path) = &args.report {
        write_text(path, &page(&diff)?)?;
    }
    let same = args.is_same(&diff);
    if args.json {
        let mut json = text_report::as_json(&diff);
        json["same"] = same.into();
        super::exit::print(&format!("{json:#}\n"))?;
    } else {
        super::exit::print(&(text_report::lines(&diff).iter().map(|line| micro(line)).joined("\n") + "\n"))?;
    }
    if same { Ok(()) } else { Err(Failure::new(DIFFERENT, "")) }
}

impl Args {
    fn is_same(&self, diff: &Diff) -> bool {
        let found = &diff.found;
        if self.tolerance_um.is_none() && self.tolerance_arcsec.is_none() {
            return diff.is_same();
        }
        let Some(volume) = &found.volume else { return false };
        let [shift, turn] = found.unsearched;
        let within = |tolerance: Option<f64>, value: f64| tolerance.is_none_or(|t| value <= t);
        within(self.tolerance_um.map(mm_from_um), volume.position.position.norm() + shift)
            && within(self.tolerance_arcsec.map(rad_from_arcsec), volume.rotation.rotation.norm() + turn)
    }
}

fn page(diff: &Diff) -> Result<String> {
    let [a, b] = &diff.names;
    let mut page = Page::new(&format!("{a} and {b}"));
    page.paragraph("What is different between two models. Differences are second minus first.");
    for (title, lines) in [
        ("Chain, frame and axes", text_report::changes(diff)),
        ("In the working volume", text_report::volume(diff)),
        ("Provenance", text_report::provenance(diff)),
    ] {
        page.heading(title);
        let lines = if lines.is_empty() { vec!["the same".to_owned()] } else { lines };
        page.table(&[], &lines.iter().map(|l| vec![Cell::text(l)]).collect::<Vec<_>>());
    }
    page.heading("Errors");
    if diff.found.errors.is_empty() {
        page.paragraph("the same");
    } else {
        text_report::errors(diff).put(&mut page);
        page.figure(
            &picture::curves(diff)?,
            "Curves that differ, in relative sense. Grey: first, blue: second; thin: travel towards minus.",
        );
    }
    Ok(page.finish())
}
