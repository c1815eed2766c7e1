//! `volcomp export`: a model to the tables that controls load, a recording to columns. What a file is, it says itself.

mod model;
mod recording;

use clap::{Parser, ValueEnum};

use crate::prelude::*;
use volcomp_protocol::record::{EXTENSION, block};

/// Write a model as a table that a control loads, or a recording of volcompd as CSV or Parquet.
///
/// What FILE is decides: a model file (one), or recordings of one run of the daemon (any number, in any order).
///
/// Models: curves are sampled such that straight lines between the points stay within --tolerance-um of the model, as
/// controls interpolate. What the format cannot hold is named; what would be silently wrong is refused.
///
/// Recordings: one row per cycle, with the columns of session and history files (t_s, x_mm, vx_mm_per_s, dir_x ..) and
/// what the daemon did: offsets asked and applied, state, limits, lag. deviation_um stays empty: a recording knows
/// positions, it measures no deviation.
#[derive(Debug, Parser)]
#[command(after_help = include_str!("help.txt"))]
pub(super) struct Args {
    /// A model file, or recordings.
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    /// The format; csv does for both, parquet for recordings, the others for models.
    #[arg(long, visible_alias = "to", value_enum)]
    format: FormatArg,
    /// The file to write; - is stdout (not for parquet).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten, next_help_heading = "Models")]
    model: model::ModelOptions,
    #[command(flatten, next_help_heading = "Recordings")]
    recording: recording::RecordingOptions,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum FormatArg {
    /// ISG and Beckhoff volumetric compensation.
    Isg,
    /// ISG and Beckhoff leadscrew compensation.
    IsgLis,
    /// LinuxCNC screw compensation.
    #[value(name = "linuxcnc")]
    LinuxCnc,
    /// Heidenhain .COM table.
    Heidenhain,
    /// Renishaw laser test, as if the model had been measured.
    Rtl,
    /// Model: position_mm and error columns, as `volcomp fit` reads them. Recording: one row per cycle.
    Csv,
    /// Recording: columns, packed; for pandas, polars, DuckDB.
    Parquet,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let recordings = args.files.iter().map(|path| is_recording(path)).collect::<Result<Vec<_>, _>>()?;
    if recordings.iter().all(|is| *is) {
        refuse_options(args.model.first_given(), "models", "recordings")?;
        let to = match args.format {
            FormatArg::Csv => recording::Format::Csv,
            FormatArg::Parquet => recording::Format::Parquet,
            _ => return Err(mixed("this format holds models; recordings go to csv or parquet")),
        };
        return recording::run(&args.files, to, &args.out, &args.recording);
    }
    refuse_options(args.recording.first_given(), "recordings", "models")?;
    match (&args.files[..], args.format) {
        ([_], FormatArg::Parquet) => Err(mixed("parquet holds recordings; the file is none")),
        ([path], format) => model::run(path, format, &args.out, &args.model),
        _ => Err(mixed("give one model file, or only recordings")),
    }
}

fn mixed(why: &str) -> Failure {
    usage!("{why}\n  hint: volcomp export --help")
}

fn refuse_options(given: Option<&str>, of: &str, files: &str) -> Result<()> {
    given.map_or(Ok(()), |option| Err(mixed(&format!("{option} is for {of}, the files are {files}"))))
}

/// By its first bytes; one that is called so but is damaged is one all the same, and the reader says what is wrong.
fn is_recording(path: &Path) -> Result<bool> {
    // a pipe cannot be looked at first; recordings are files
    if !input::is_regular(path) {
        return Ok(path.extension().is_some_and(|e| e == EXTENSION));
    }
    let first = input::head(path, InputKind::Recording, block::FILE_MAGIC.len() as u64)?;
    Ok(first == block::FILE_MAGIC || path.extension().is_some_and(|e| e == EXTENSION))
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    fn export(args: &[&str]) -> Result<()> {
        let args = Args::try_parse_from([&["export"], args].concat()).expect("parses");
        run(&args)
    }

    #[test]
    fn options_and_formats_of_the_other_kind_of_file_are_refused_by_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name).to_str().expect("utf-8").to_owned();
        let (recording, model, out) = (path("a.vcrec"), path("m.toml"), path("out"));
        std::fs::write(&recording, block::file_header()).expect("written");
        std::fs::write(&model, "").expect("written");
        for (args, said) in [
            (vec![&*recording, "--format", "isg"], "csv or parquet"),
            (vec![&*recording, "--to", "csv", "--axis", "x"], "--axis is for models"),
            (vec![&*recording, "--to", "csv", "--tolerance-um", "1"], "--tolerance-um is for models"),
            (vec![&*model, "--format", "parquet"], "parquet holds recordings"),
            (vec![&*model, "--format", "csv", "--every", "3"], "--every is for recordings"),
            (vec![&*model, &*recording, "--format", "csv"], "one model file, or only recordings"),
        ] {
            let failure = export(&[&args[..], &["--out", &out]].concat()).expect_err("refused");
            assert!(failure.message.contains(said), "{args:?}: {}", failure.message);
        }
    }

    #[test]
    fn a_recording_is_known_by_its_bytes_whatever_its_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("renamed.bin");
        std::fs::write(&path, block::file_header()).expect("written");
        assert!(is_recording(&path).expect("readable"));
        std::fs::write(&path, b"VC").expect("written");
        assert!(!is_recording(&path).expect("readable"));
    }
}
