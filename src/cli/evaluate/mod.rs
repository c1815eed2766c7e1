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

use super::acceptance::HeadArgs;
use crate::prelude::*;
use crate::report::plot::Svg;
use page::Origin;
use volcomp_evaluate::{Device, Placed, Uncertain};

subcommands! {
    /// Evaluate a test by ISO 230 or a gear by ISO 1328-1, with the plots of the standards and a report to print
    ///
    /// Every test takes --before FILE, an earlier test of the same kind, and compares; --html FILE.html writes a page
    /// that needs no other file and prints on A4; --svg FILE.svg the plot alone.
    pub(super) enum Test {
        /// Positioning of one axis: reversal, repeatability, systematic deviation, accuracy.
        Iso230_2(Box<positioning::Args>) => positioning::run,
        /// Circular test: circular error G and radial error F.
        Iso230_4(circular::Args) => circular::run,
        /// Ballbar report: polar plot, causes by rank with remedy, trend over several tests.
        Ballbar(Box<ballbar::Args>) => ballbar::run,
        /// Four body diagonals, each like a positioning test.
        Iso230_6(diagonals::Args) => diagonals::run,
        /// A hole plate or ball plate: offset, rotation, scale and squareness in a plane.
        Plate(plate::Args) => plate::run,
        /// Involute gear by ISO 1328-1: profile and helix (lead) deviations and their tolerance classes.
        Gear(Box<gear::Args>) => gear::run,
    }
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

impl Output {
    /// The file of data, by `--data` or as the positional argument; the parser asks for one of them.
    fn data<'a>(&'a self, named: &'a Option<PathBuf>) -> &'a Path {
        named.as_deref().or(self.file.as_deref()).unwrap_or(Path::new("-"))
    }

    /// The heading of report and plot.
    fn title<'a>(&'a self, default: &'a str) -> &'a str {
        self.title.as_deref().unwrap_or(default)
    }

    /// The head of a page: what was tested, from which files, and how it was judged.
    fn page(
        &self,
        [data, before]: [&Option<PathBuf>; 2],
        (title, standard): (&str, &str),
        judged: &Judged,
        facts: &[(&str, String)],
    ) -> Page {
        let mut origins = vec![Origin::of("data", self.data(data))];
        origins.extend(before.as_deref().map(|path| Origin::of("before", path)));
        page::start(title, standard, judged, &origins, facts)
    }

    /// Writes what was asked for; then JSON or text goes to stdout, where that is free. `json` are the figures, and those of the
    /// test before; the verdicts and the changes are added.
    fn deliver(
        &self,
        judged: &Judged,
        svg: impl FnOnce() -> Svg,
        page: impl FnOnce() -> Result<String>,
        json: impl FnOnce() -> (Map<String, Value>, Option<Map<String, Value>>),
        print: impl FnOnce(),
    ) -> Result<()> {
        let stdout_taken = [&self.svg, &self.report].into_iter().flatten().any(|p| p.as_os_str() == "-");
        if self.json && stdout_taken {
            return Err(usage!("--json and a picture or report cannot both go to stdout"));
        }
        if let Some(path) = &self.svg {
            write_text(path, &svg()?)?;
            note!("plot written: {}", path.display());
        }
        if let Some(path) = &self.report {
            write_text(path, &page()?)?;
            note!("report written: {}", path.display());
        }
        if self.json {
            let (mut out, before) = json();
            judged.put(&mut out);
            if let Some(before) = before {
                put_before(&mut out, before);
            }
            say!("{:#}", Value::Object(out));
        } else if !stdout_taken {
            print();
        }
        Ok(())
    }
}

/// Two measurements of one kind side by side, for `volcomp verify`.
#[derive(Default)]
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
    /// Its figures, before and after.
    pub(crate) figures: Vec<[Assessed; 2]>,
    /// What the deviations of range and RMS are taken about.
    pub(crate) about: [&'static str; 2],
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

impl Compared {
    /// The standard uncertainty of an instrument with the expanded uncertainty (k = 2) `u`: ISO 230-2 and 230-6 measure
    /// distances, other tests compare readings.
    pub(crate) fn device(&self, u: f64) -> Device {
        let std = u / 2.0;
        if matches!(self.test, "iso230-2" | "iso230-6") {
            Device::Distance(std)
        } else {
            Device::Reading(std)
        }
    }
}

/// Compares two files of one test of ISO 230; `None` where the columns are of none.
pub(crate) fn compare(files: [&Path; 2], options: CompareOptions) -> Result<Option<Compared>> {
    let kinds: Vec<Option<Kind>> = files.into_iter().map(kind).collect::<Result<_, _>>()?;
    match kinds[..] {
        [Some((a, compare)), Some((b, _))] if a == b => compare.map(|of| of(files, options)).transpose(),
        [Some((a, _)), Some((b, _))] => {
            Err(data!(files[1], "{} is {a}, this is {b}; compare two files of one test", files[0].display()))
        }
        [None, None] => Ok(None),
        [None, _] => Err(no_test(files[0])),
        _ => Err(no_test(files[1])),
    }
}

fn no_test(path: &Path) -> Failure {
    data!(path, "not a table of readings of a test; volcomp verify --help names the kinds of files")
}

/// A test in words, and how two of its kind are compared; none where the standard has no figures.
type Kind = (&'static str, Option<fn([&Path; 2], CompareOptions) -> Result<Compared>>);

const POSITIONING: Kind = ("a positioning test (ISO 230-2)", Some(positioning::compare));
const CIRCLE: Kind = ("a circular test (ISO 230-4)", Some(circular::compare));
const DIAGONALS: Kind = ("a test of body diagonals (ISO 230-6)", Some(diagonals::compare));
const MOTIONS: Kind = ("a run of error motions (ISO 230-1)", None);

/// The kind of a file by its columns.
fn kind(path: &Path) -> Result<Option<Kind>> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("dat")) {
        return Ok(Some(POSITIONING));
    }
    let table = table::open(path)?;
    let has = |name: &str| table.find(name).is_some();
    let kinds = [
        (has("diagonal"), DIAGONALS),
        (has("angle_deg") && has("deviation_um"), CIRCLE),
        (has("target_mm") || has("target_deg"), POSITIONING),
        (has("position_mm"), MOTIONS),
    ];
    Ok(kinds.into_iter().find(|(is_it, _)| *is_it).map(|(_, kind)| kind))
}

/// How a figure is taken from a test; none where the data do not have it.
type Get<T> = fn(&T) -> Option<f64>;
/// Figures of a test: key of `docs/reference/json-output.md` 3, words, and how it is taken.
type Figures<T> = [(&'static str, &'static str, Get<T>)];

/// The figures of a test, by their keys with what is behind them, with what is stated; `expanded` gives computed uncertainties.
fn assess<T>(
    figures: &Figures<T>,
    result: &T,
    acceptance: &Acceptance,
    unit: &str,
    expanded: impl Fn(&str) -> Option<f64>,
) -> Vec<Assessed> {
    let of = |(key, name, get): &(&str, &'static str, Get<T>)| {
        acceptance.assess(&format!("{key}{unit}"), name, get(result), expanded(key))
    };
    figures.iter().map(of).collect()
}

/// The figures by their keys.
fn values(figures: &[Assessed]) -> Map<String, Value> {
    figures.iter().map(|f| (f.key.clone(), json!(f.value))).collect()
}

/// Figures of two tests beside each other.
fn side_by_side([before, after]: [Vec<Assessed>; 2]) -> Vec<[Assessed; 2]> {
    before.into_iter().zip(after).map(|(b, a)| [b, a]).collect()
}

/// How much a figure changed, relative to before.
fn change(before: Option<f64>, after: Option<f64>) -> Option<f64> {
    let (before, after) = (before?, after?);
    (before != 0.0).then(|| (after - before) / before)
}

/// Expanded uncertainty (k = 2) of the change of a figure.
pub(crate) fn expanded_change(before: Uncertain, after: Uncertain) -> Option<f64> {
    Some(2.0 * before.std?.hypot(after.std?))
}

/// Whether a figure changed by more than the uncertainty; none where that is not known.
pub(crate) fn is_significant(before: Uncertain, after: Uncertain) -> Option<bool> {
    expanded_change(before, after).map(|u| (after.value - before.value).abs() > u)
}

/// What stands for a change within its uncertainty.
pub(crate) const NOT_SIGNIFICANT: &str = "not significant";

/// The change of a figure in words.
fn changed(before: Option<&Assessed>, after: &Assessed) -> String {
    let two = before.and_then(Assessed::uncertain).zip(after.uncertain());
    match two.and_then(|(b, a)| is_significant(b, a)) {
        Some(false) => NOT_SIGNIFICANT.to_owned(),
        _ => percent(change(before.and_then(|b| b.value), after.value)),
    }
}

/// A share in percent with its sign, none where it rounds to zero.
fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "-".to_owned(), |s| format!("{} %", signed(100.0 * s, 0)))
}

/// Share of the common scale below which a test is drawn at its own scale, too.
const OWN_SCALE: f64 = 0.4;

/// True where a plot at the common scale hides what is left.
fn is_flat(own: [f64; 2], common: [f64; 2]) -> bool {
    own[1] - own[0] < OWN_SCALE * (common[1] - common[0])
}

/// Two tests at the common scale, and the one after at its own where little is left.
fn before_and_after<T>(
    [before, after]: [&T; 2],
    [common, own]: [[f64; 2]; 2],
    plot: impl Fn(&T, [f64; 2]) -> Svg,
) -> Result<Vec<(&'static str, String)>> {
    let mut plots = vec![("Before", plot(before, common)?), ("After, same scale", plot(after, common)?)];
    if is_flat(own, common) {
        plots.push(("After, own scale", plot(after, own)?));
    }
    Ok(plots)
}

/// A test alone, or below the one before, with their headings.
fn headed<T>(before: Option<T>, after: T) -> Vec<(&'static str, T)> {
    match before {
        Some(before) => vec![("before", before), ("after, same scale", after)],
        None => vec![("", after)],
    }
}

/// A value with two decimals, or a dash.
pub(crate) fn show(value: Option<f64>) -> String {
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
