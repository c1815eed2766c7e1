//! Recordings to CSV with the columns of sessions and histories, or Parquet.
//!
//! A recording holds positions and offsets, no measured deviation: `deviation_um` and the direction of sensitivity are
//! there and empty, so that a reading can be joined by time.

#[cfg(feature = "parquet")]
mod parquet;
mod rows;
mod sensors;

use std::io::Write;

use crate::files;
use crate::prelude::*;
use crate::recordings;
use rows::{Cell, Column, Rows};
use sensors::Sensors;

/// What a recording becomes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Format {
    /// Text, one row per cycle.
    Csv,
    /// Columns, packed.
    Parquet,
}

/// What only recordings need.
#[derive(Debug, clap::Args)]
pub(super) struct RecordingOptions {
    /// Only rows from this time on, s since the first record.
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    from_s: Option<f64>,
    /// Only rows up to this time, s since the first record.
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    to_s: Option<f64>,
    /// Only every N-th cycle.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    every: Option<u64>,
}

impl RecordingOptions {
    /// An option that was given, for a file that is no recording.
    pub(super) fn first_given(&self) -> Option<&'static str> {
        let Self { from_s, to_s, every } = self;
        [(from_s.is_some(), "--from-s"), (to_s.is_some(), "--to-s"), (every.is_some(), "--every")]
            .into_iter()
            .find_map(|(given, name)| given.then_some(name))
    }
}

/// Where rows go.
trait Sink {
    /// The columns; called once, first.
    fn begin(&mut self, columns: &[Column]) -> Result<()>;
    /// One row, a cell per column.
    fn row(&mut self, cells: &[Cell]) -> Result<()>;
}

pub(super) fn run(files: &[PathBuf], to: Format, out: &Path, args: &RecordingOptions) -> Result<()> {
    if let (Some(from), Some(to)) = (args.from_s, args.to_s)
        && from > to
    {
        return Err(usage!("--from-s {from} is behind --to-s {to}; exchange them"));
    }
    let mut parsed = recordings::read(files)?;
    let (rows, walked) = match to {
        Format::Csv => {
            let mut sink = Csv(files::Rows::create(out)?);
            let done = convert(args, &mut parsed, &mut sink)?;
            sink.0.finish()?;
            done
        }
        #[cfg(feature = "parquet")]
        Format::Parquet => {
            let output = files::Output::create(out)?;
            let files::Output::Beside { file, .. } = &output else {
                return Err(usage!(
                    "Parquet is written to a file, not to a stream\n  hint: name a file with --out"
                ));
            };
            let file = file.try_clone().map_err(|e| Failure::io(out, &e))?;
            let mut sink = parquet::Table::new(file, out, &recordings::first(&parsed)?.meta);
            let done = convert(args, &mut parsed, &mut sink)?;
            sink.finish()?;
            output.finish()?;
            done
        }
        #[cfg(not(feature = "parquet"))]
        Format::Parquet => {
            return Err(usage!(
                "this program was built without Parquet\n  hint: build it with the feature parquet, or use --format csv"
            ));
        }
    };
    for note in walked.notes {
        note!("note: {note}");
    }
    note!(
        "{rows} rows; deviation_um is empty: a recording knows positions and offsets, it measures no deviation"
    );
    Ok(())
}

/// Turns items into rows; gives their number and what was noted.
fn convert(
    args: &RecordingOptions,
    parsed: &mut [recordings::Parsed],
    sink: &mut dyn Sink,
) -> Result<(u64, recordings::Walked)> {
    let first = recordings::first(parsed)?;
    let name = first.path.display().to_string();
    // the dead band decides what a reversal is; without the machine file every change of sign is one
    let config = recordings::machine(first).ok();
    // without the models nobody knows whose values the live ones are
    let models = recordings::models(parsed).unwrap_or_default();
    let mut rows = Rows::new(config, Sensors::new(&models));
    let (mut cycles, mut written, mut begun) = (0_u64, 0, false);
    let mut last_s = 0.0;
    let walked = recordings::walk(parsed, |item| {
        let told = rows.feed(item).map_err(|why| data!(name, "{why}"))?;
        if !told {
            return Ok(());
        }
        if !begun {
            sink.begin(&rows.columns)?;
            begun = true;
        }
        let t_s = rows.t_s;
        last_s = t_s;
        let wanted = args.from_s.is_none_or(|from| t_s >= from) && args.to_s.is_none_or(|to| t_s <= to);
        if wanted && cycles % args.every.unwrap_or(1) == 0 {
            sink.row(&rows.cells)?;
            written += 1;
        }
        cycles += 1;
        Ok(())
    })?;
    if written == 0 {
        // the file is not made: an empty one would look like a machine that did nothing
        let why = if cycles == 0 {
            "holds no cycle".to_owned()
        } else {
            format!(
                "no row selected; the cycles are between 0 s and {last_s:.3} s: correct --from-s and --to-s"
            )
        };
        return Err(data!(name, "{why}"));
    }
    Ok((written, walked))
}

/// Comma-separated values.
struct Csv(files::Rows);

impl Csv {
    fn line(&mut self, fields: impl Iterator<Item = impl core::fmt::Display>) -> Result<()> {
        for (k, field) in fields.enumerate() {
            // writing to memory cannot fail
            let _ = write!(self.0.block, "{}{field}", if k > 0 { "," } else { "" });
        }
        self.0.row_end()
    }
}

impl Sink for Csv {
    fn begin(&mut self, columns: &[Column]) -> Result<()> {
        self.line(columns.iter().map(|column| &column.name))
    }

    fn row(&mut self, cells: &[Cell]) -> Result<()> {
        self.line(cells.iter())
    }
}
