//! `volcomp evaluate`: the figures of ISO 230 and ISO 1328-1 from measured deviations, their plots, and reports before and after.
//!
//! One file per test; `picture` draws, `page` puts what all reports say in their heads.

mod ballbar;
pub(crate) mod circular;
mod diagonals;
mod gear;
pub(crate) mod page;
mod picture;
mod plate;
mod positioning;
mod uncertainty_args;

use std::path::{Path, PathBuf};

use clap::{Parser, Subcommand};
use serde_json::{Map, Value, json};

use super::acceptance::HeadArgs;
use super::files::write_text;
use super::numerals::{plain, signed};
use super::{EX_DATAERR, EX_SOFTWARE, EX_USAGE, Failure, table};
use crate::acceptance::Stated;
use crate::acceptance::verdicts::Assessed;
use volcomp_evaluate::Placed;

/// Evaluate a test by ISO 230 or a gear by ISO 1328-1, with the plots of the standards and a report to print
///
/// Every test takes --before FILE, an earlier test of the same kind, and compares; --html FILE.html writes a page
/// that needs no other file and prints on A4; --svg FILE.svg the plot alone.
#[derive(Debug, Parser)]
pub(super) struct Args {
    #[command(subcommand)]
    test: Test,
}

#[derive(Debug, Subcommand)]
enum Test {
    /// Positioning of one axis: reversal, repeatability, systematic deviation, accuracy.
    Iso230_2(Box<positioning::Args>),
    /// Circular test: circular deviation G and radial deviation F.
    Iso230_4(circular::Args),
    /// Ballbar report: polar plot, causes by rank with remedy, trend over several tests.
    Ballbar(Box<ballbar::Args>),
    /// Four body diagonals, each like a positioning test.
    Iso230_6(diagonals::Args),
    /// A hole plate or ball plate: offset, rotation, scale and squareness in a plane.
    Plate(plate::Args),
    /// Involute gear by ISO 1328-1: profile and helix (lead) deviations and their tolerance classes.
    Gear(Box<gear::Args>),
}

/// What is written beside the figures.
#[derive(Debug, clap::Args)]
struct Output {
    /// The file of --data.
    #[arg(value_name = "FILE", conflicts_with = "data")]
    file: Option<PathBuf>,
    /// Write a report as one HTML page that needs no other file and prints on A4.
    #[arg(long = "html", value_name = "FILE.html", alias = "report")]
    report: Option<PathBuf>,
    /// Write the plot alone.
    #[arg(long, value_name = "FILE.svg")]
    svg: Option<PathBuf>,
    /// Heading of report and plot, for example machine, axis and date.
    #[arg(long, value_name = "TEXT")]
    title: Option<String>,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    head: HeadArgs,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    match &args.test {
        Test::Iso230_2(a) => positioning::run(a),
        Test::Iso230_4(a) => circular::run(a),
        Test::Ballbar(a) => ballbar::run(a),
        Test::Iso230_6(a) => diagonals::run(a),
        Test::Plate(a) => plate::run(a),
        Test::Gear(a) => gear::run(a),
    }
}

impl Output {
    /// The file of data, by `--data` or as the positional argument; the parser asks for one of them.
    fn data<'a>(&'a self, named: &'a Option<PathBuf>) -> &'a Path {
        named.as_deref().or(self.file.as_deref()).unwrap_or(Path::new("-"))
    }

    /// Writes what was asked for.
    fn write(
        &self,
        svg: impl FnOnce() -> super::report::plot::Svg,
        page: impl FnOnce() -> Result<String, Box<dyn std::error::Error>>,
    ) -> Result<(), Failure> {
        if self.json && [&self.svg, &self.report].into_iter().flatten().any(|p| p.as_os_str() == "-") {
            return Err(Failure::new(
                EX_USAGE,
                "error: --json and a picture or report cannot both go to stdout",
            ));
        }
        if let Some(path) = &self.svg {
            write_text(path, &svg().map_err(drawn)?)?;
            note!("plot written: {}", path.display());
        }
        if let Some(path) = &self.report {
            write_text(path, &page().map_err(drawn)?)?;
            note!("report written: {}", path.display());
        }
        Ok(())
    }
}

/// Two measurements of one kind side by side, for `volcomp verify`.
pub(crate) struct Compared {
    /// Name of the test in JSON.
    pub(crate) test: &'static str,
    /// The standard.
    pub(crate) standard: &'static str,
    /// Keys of the figures that may have a tolerance.
    pub(crate) keys: Vec<String>,
    /// What the file of the test after states.
    pub(crate) stated: Stated,
    /// Unit in words.
    pub(crate) unit: &'static str,
    /// Its figures.
    pub(crate) figures: Vec<Pair>,
    /// Plots at one scale: heading and picture.
    pub(crate) plots: Vec<(&'static str, String)>,
    /// What the plots show.
    pub(crate) caption: &'static str,
    /// The readings by place, before and after.
    pub(crate) readings: [Vec<Placed>; 2],
    /// Readings at one place are of different runs.
    pub(crate) is_repeated: bool,
    /// Remarks.
    pub(crate) notes: Vec<String>,
}

/// A figure of two tests.
pub(crate) struct Pair {
    /// Key in JSON.
    pub(crate) key: String,
    /// In words.
    pub(crate) name: &'static str,
    /// Of the test before.
    pub(crate) before: Option<f64>,
    /// Of the test after.
    pub(crate) after: Option<f64>,
    /// Expanded uncertainty (k = 2) of the measurement of the test after, where stated.
    pub(crate) expanded: Option<f64>,
}

/// Options of [`compare`] beside the files.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CompareOptions {
    /// Plane of a circle.
    pub(crate) plane: [char; 2],
    /// Nominal radius of a circle.
    pub(crate) radius_mm: Option<f64>,
    /// Feed of a circle.
    pub(crate) feed_mm_per_min: Option<f64>,
    /// Expanded uncertainty (k = 2) of a reading by the instrument, um or arcsec.
    pub(crate) u_device: Option<f64>,
}

/// Compares two files of one test of ISO 230; `None` where the columns are of none.
pub(crate) fn compare(files: [&Path; 2], options: CompareOptions) -> Result<Option<Compared>, Failure> {
    let kinds: Vec<Option<Kind>> = files.into_iter().map(kind).collect::<Result<_, _>>()?;
    match kinds[..] {
        [Some(a), Some(b)] if a == b => match a {
            Kind::Positioning => positioning::compare(files, options).map(Some),
            Kind::Circle => circular::compare(files, options).map(Some),
            Kind::Diagonals => diagonals::compare(files, options).map(Some),
        },
        [None, None] => Ok(None),
        _ => Err(bad_data(files[1], format_args!("not the same test as {}", files[0].display()))),
    }
}

/// A test by the columns of its file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Positioning,
    Circle,
    Diagonals,
}

fn kind(path: &Path) -> Result<Option<Kind>, Failure> {
    let is_dat = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("dat"));
    if is_dat {
        return Ok(Some(Kind::Positioning));
    }
    let table = table::open(path)?;
    let has = |name: &str| table.find(name).is_some();
    Ok(if has("diagonal") {
        Some(Kind::Diagonals)
    } else if has("angle_deg") && has("deviation_um") {
        Some(Kind::Circle)
    } else if has("target_mm") || has("target_deg") {
        Some(Kind::Positioning)
    } else {
        None
    })
}

/// Figures of two tests beside each other.
fn side_by_side(before: &[Figure], after: Vec<Assessed>) -> Vec<Pair> {
    let pair = |(b, a): (&Figure, Assessed)| Pair {
        key: a.key,
        name: a.name,
        before: b.value,
        after: a.value,
        expanded: a.expanded,
    };
    before.iter().zip(after).map(pair).collect()
}

fn drawn(e: Box<dyn std::error::Error>) -> Failure {
    Failure::new(EX_SOFTWARE, format_args!("error: picture: {e}"))
}

fn bad_data(file: &Path, what: impl core::fmt::Display) -> Failure {
    Failure::new(EX_DATAERR, format_args!("error: {}: {what}", file.display()))
}

/// Refuses columns that the test does not know.
fn only<R: std::io::BufRead>(table: &table::Table<R>, known: &[&str]) -> Result<(), Failure> {
    match table.columns().iter().position(|c| !known.contains(&c.as_str())) {
        Some(i) => Err(table.fail(i, format_args!("unknown column; columns are {}", known.join(", ")))),
        None => Ok(()),
    }
}

/// One figure of a test: key of `docs/reference/json-output.md` 3, words, and value where the data have it.
struct Figure {
    key: &'static str,
    name: &'static str,
    value: Option<f64>,
}

/// How much a figure changed, relative to before.
fn change(before: Option<f64>, after: Option<f64>) -> Option<f64> {
    let (before, after) = (before?, after?);
    (before != 0.0).then(|| (after - before) / before)
}

/// A share in percent with its sign, none where it rounds to zero.
fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "-".to_owned(), |s| format!("{} %", signed(100.0 * s, 0)))
}

/// A value with two decimals, or a dash.
fn show(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |v| plain(v, 2))
}

/// Adds `before` and `change` to a report: `change.KEY` is after/before - 1.
fn put_before(report: &mut Map<String, Value>, before: Map<String, Value>) {
    let of = |map: &Map<String, Value>, key: &String| map.get(key).and_then(Value::as_f64);
    let changes: Map<String, Value> = before
        .keys()
        .filter(|k| {
            report.get(*k).is_some_and(Value::is_number) && !matches!(k.as_str(), "targets" | "cycles")
        })
        .filter_map(|k| Some((k.clone(), json!(change(of(&before, k), of(report, k))?))))
        .collect();
    report.insert("before".to_owned(), Value::Object(before));
    report.insert("change".to_owned(), Value::Object(changes));
}
