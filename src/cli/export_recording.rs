//! `export` of recordings: CSV with the columns of sessions and histories, or Parquet.
//!
//! A recording holds positions and offsets, no measured deviation: `deviation_um` and the direction of sensitivity are
//! there and empty, so that a reading can be joined by time.

mod parquet;
mod rows;

use std::io::Write;
use std::path::{Path, PathBuf};

use super::files::Output;
use super::recordings;
use super::{EX_DATAERR, EX_USAGE, Failure};
use rows::{Cell, Column, Rows};

/// What a recording becomes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Format {
    /// Text, one row per cycle.
    Csv,
    /// Columns, packed; for pandas, polars, DuckDB.
    Parquet,
}

/// Converts recordings of volcompd to CSV or Parquet, one row per cycle.
///
/// Columns are those of session and history files (`t_s`, `x_mm`, `vx_mm_per_s`, `dir_x`, `since_reversal_x_mm` ..),
/// and what the daemon did: offsets asked and applied, state, limits. `deviation_um` stays empty: a recording knows
/// positions, it measures no deviation.
#[derive(Debug, clap::Parser)]
pub(super) struct Args {
    /// Recordings of one run of the daemon, in any order.
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// What to write.
    #[arg(long, value_enum)]
    to: Format,
    /// The file to write; `-` is standard output (CSV only).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Only rows from this time on, s since the first record.
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    from_s: Option<f64>,
    /// Only rows up to this time, s since the first record.
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    to_s: Option<f64>,
    /// Only every N-th cycle.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
    every: u64,
}

/// Where rows go.
trait Sink {
    /// The columns; called once, first.
    fn begin(&mut self, columns: &[Column]) -> Result<(), Failure>;
    /// One row, a cell per column.
    fn row(&mut self, cells: &[Cell]) -> Result<(), Failure>;
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    for (name, value) in [("--from-s", args.from_s), ("--to-s", args.to_s)] {
        if value.is_some_and(|v| !v.is_finite()) {
            return Err(Failure::new(EX_USAGE, format_args!("error: {name} must be a finite number")));
        }
    }
    let bytes = recordings::read(&args.recordings)?;
    let parsed = recordings::parse(&bytes)?;
    let mut output = Output::create(&args.out)?;
    let (rows, notes) = match args.to {
        Format::Csv => {
            let mut sink =
                Csv { out: std::io::BufWriter::with_capacity(1 << 16, &mut output), line: String::new() };
            let done = convert(args, &parsed, &mut sink)?;
            sink.out.flush().map_err(|e| Failure::io(&args.out, &e))?;
            drop(sink);
            done
        }
        Format::Parquet => {
            let Output::Beside { file, .. } = &output else {
                return Err(Failure::new(
                    EX_USAGE,
                    "error: Parquet is written to a file, not to a stream\n  hint: name a file with --out",
                ));
            };
            let file = file.try_clone().map_err(|e| Failure::io(&args.out, &e))?;
            let mut sink = parquet::Table::new(file, &args.out, recordings::first(&parsed)?.1);
            let done = convert(args, &parsed, &mut sink)?;
            sink.finish()?;
            done
        }
    };
    output.finish()?;
    for note in notes {
        eprintln!("note: {note}");
    }
    eprintln!(
        "{rows} rows; deviation_um is empty: a recording knows positions and offsets, it measures no deviation"
    );
    Ok(())
}

/// Turns items into rows; gives their number and what was noted.
fn convert(
    args: &Args,
    parsed: &[recordings::Parsed<'_>],
    sink: &mut dyn Sink,
) -> Result<(u64, Vec<String>), Failure> {
    let first = recordings::first(parsed)?.0;
    // the dead band decides what a reversal is; without the machine file every change of sign is one
    let config = recordings::machine(first.path, &first.recording).ok();
    let mut rows = Rows::new(config);
    let (mut cycles, mut written, mut begun) = (0_u64, 0, false);
    let notes = recordings::walk(parsed, |item| {
        let told = rows.feed(item).map_err(|why| {
            Failure::new(EX_DATAERR, format_args!("error: {}: {why}", first.path.display()))
        })?;
        if !told {
            return Ok(());
        }
        if !begun {
            sink.begin(rows.columns())?;
            begun = true;
        }
        let t_s = rows.t_s();
        let wanted = args.from_s.is_none_or(|from| t_s >= from) && args.to_s.is_none_or(|to| t_s <= to);
        if wanted && cycles % args.every == 0 {
            sink.row(rows.cells())?;
            written += 1;
        }
        cycles += 1;
        Ok(())
    })?;
    if !begun {
        sink.begin(rows.columns())?;
    }
    Ok((written, notes))
}

/// CSV; no cell of ours needs quotes.
struct Csv<W: Write> {
    out: W,
    line: String,
}

impl<W: Write> Csv<W> {
    fn write(&mut self) -> Result<(), Failure> {
        self.line.push('\n');
        self.out.write_all(self.line.as_bytes()).map_err(|e| Failure::io(Path::new("output"), &e))?;
        self.line.clear();
        Ok(())
    }
}

impl<W: Write> Sink for Csv<W> {
    fn begin(&mut self, columns: &[Column]) -> Result<(), Failure> {
        for (k, column) in columns.iter().enumerate() {
            if k > 0 {
                self.line.push(',');
            }
            self.line.push_str(&column.name);
        }
        self.write()
    }

    fn row(&mut self, cells: &[Cell]) -> Result<(), Failure> {
        use std::fmt::Write as _;
        for (k, cell) in cells.iter().enumerate() {
            if k > 0 {
                self.line.push(',');
            }
            let _ = match cell {
                Cell::Empty => Ok(()),
                Cell::Number(v) => write!(self.line, "{v}"),
                Cell::Whole(v) => write!(self.line, "{v}"),
                Cell::Text(v) => self.line.write_str(v),
            };
        }
        self.write()
    }
}
