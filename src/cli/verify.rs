//! `volcomp verify`: two measurements of a machine, before and after compensation, as one report.

mod motions;
mod record;

use crate::acceptance::HeadArgs;
use crate::evaluate::circular::plane;
use crate::evaluate::page::{self, Origin};
use crate::evaluate::{CompareOptions, Compared, NOT_SIGNIFICANT, compare, expanded_change, is_significant};
use crate::prelude::*;
use crate::report_page::Plot;
use volcomp_evaluate::{Placed, Reduction, Size, Uncertain};

/// Compare two measurements: reduction with its uncertainty, figures of ISO 230, plots at one scale
///
/// Both files are of one kind, which their columns tell: positioning (ISO 230-2), circle (ISO 230-4), body diagonals (ISO
/// 230-6), or error motions over position_mm in columns such as eyx_um: straightnesses are compared about their end-point lines,
/// positioning and angular errors about zero. The uncertainty (k = 2) is that of the scatter of readings at one place and, where
/// --u-device-um states it, of the instrument.
///
/// Example:
///
///   volcomp verify --before before/positioning-x.csv --after after/positioning-x.csv --html x.html
#[derive(Debug, clap::Parser)]
pub(super) struct Args {
    /// The measurement without compensation.
    #[arg(long, value_name = "FILE")]
    before: PathBuf,
    /// The same measurement with compensation.
    #[arg(long, value_name = "FILE")]
    after: PathBuf,
    /// The plane of a circle, for the plot.
    #[arg(long, value_name = "AXES", default_value = "xy", value_parser = plane)]
    plane: [char; 2],
    /// Nominal radius of a circle.
    #[arg(long, value_name = "MM")]
    radius_mm: Option<f64>,
    /// The feed to compare, of files with several.
    #[arg(long, value_name = "FEED")]
    feed_mm_per_min: Option<f64>,
    /// The error motions to compare, of files with positioning, straightness and angular errors.
    #[arg(long, value_name = "COLUMN,..", value_delimiter = ',')]
    columns: Vec<String>,
    /// Expanded uncertainty (k = 2) of the instrument: of a distance over the measured length in ISO 230-2 and 230-6
    /// (certificate, alignment, temperature; arcsec for a rotary axis), where the range takes it once, as E does; of a
    /// single reading in circles and error motions, where the range compares two. Independent in both measurements.
    #[arg(long, value_name = "UM", visible_alias = "u-device-arcsec")]
    u_device_um: Option<f64>,
    /// Write a report as one HTML page that needs no other file and prints on A4.
    #[arg(long = "html", value_name = "FILE.html", alias = "report")]
    report: Option<PathBuf>,
    /// Heading of the report, for example machine, axis and date.
    #[arg(long, value_name = "TEXT")]
    title: Option<String>,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    head: HeadArgs,
    #[command(flatten)]
    record: record::RecordArgs,
}

/// A comparison with its reductions.
struct Verified {
    test: Compared,
    judged: Judged,
    sizes: [Size; 2],
    /// Of range and RMS.
    reductions: [Option<Reduction>; 2],
    /// Plots of tests that have none of a standard.
    charts: Vec<Plot>,
    /// Expanded uncertainty of the instrument, where stated.
    device: Option<f64>,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let files = [args.before.as_path(), args.after.as_path()];
    if args.json && args.report.as_ref().is_some_and(|p| p.as_os_str() == "-") {
        return Err(usage!("--json and the report cannot both go to stdout"));
    }
    let [before, after] = files.map(|path| input::hash(path, InputKind::Stream));
    if before.is_some() && before == after {
        let before = files[0].display();
        return Err(data!(args.after, "holds the same data as {before}; name the test after compensation"));
    }
    let options = CompareOptions {
        plane: args.plane,
        radius_mm: args.radius_mm,
        feed_mm_per_min: args.feed_mm_per_min,
        u_device: args.u_device_um,
    };
    let (mut test, charts) = match compare(files, options)? {
        Some(_) if !args.columns.is_empty() => {
            return Err(usage!("--columns names error motions such as eyx_um; these files hold none"));
        }
        Some(test) => (test, Vec::new()),
        None => motions::compare(files, &args.columns)?,
    };
    test.notes.extend(other_range(&test));
    let size = |i: usize| {
        let size =
            Size::of(&test.readings[i], test.is_repeated).ok_or_else(|| data!(files[i], "no data rows"))?;
        Ok::<_, Failure>(args.u_device_um.map_or(size, |u| size.with_device(test.device(u))))
    };
    let sizes @ [before, after] = [size(0)?, size(1)?];
    let reductions = [Reduction::of(before.range, after.range), Reduction::of(before.rms, after.rms)];
    let mut acceptance = Acceptance::load(&args.head, test.test, &test.keys)?;
    acceptance.fill(test.stated.clone());
    let assess = |[_, a]: &[Assessed; 2]| acceptance.assess(&a.key, a.name, a.value, a.expanded);
    let judged = Judged { figures: test.figures.iter().map(assess).collect(), acceptance };
    let verified = Verified { test, judged, sizes, reductions, charts, device: args.u_device_um };
    if let Some(path) = &args.report {
        write_text(path, &verified.page(args))?;
        note!("report written: {}", path.display());
        if path.as_os_str() == "-" {
            return Ok(());
        }
    }
    record::write(args, &verified)?;
    if args.json {
        say!("{:#}", Value::Object(verified.json()));
    } else {
        verified.print();
    }
    Ok(())
}

/// Share of the range by which the ends of two measurements may differ.
const SAME_RANGE: f64 = 0.05;

/// Says where the two measurements do not cover the same places.
fn other_range(test: &Compared) -> Option<String> {
    // places of circles are sectors
    if test.test == "iso230-4" {
        return None;
    }
    if test.readings.iter().any(Vec::is_empty) {
        return None;
    }
    let [[a, b], [c, d]] = test.readings.each_ref().map(|all| hull(all.iter().map(Placed::target)));
    let limit = SAME_RANGE * (b - a).max(d - c);
    let unit = if test.unit == "arcsec" && test.test != motions::ANGULAR { "deg" } else { "mm" };
    ((c - a).abs() > limit || (d - b).abs() > limit).then(|| {
        format!(
            "before covers {a} to {b} {unit}, after {c} to {d} {unit}: figures of different ranges do not compare; measure the same \
             targets before and after"
        )
    })
}

impl Verified {
    /// Name, before, after and reduction of range and RMS.
    fn rows(&self) -> [(&'static str, [Uncertain; 2], Option<Reduction>); 2] {
        let [before, after] = self.sizes;
        [
            ("range", [before.range, after.range], self.reductions[0]),
            ("rms", [before.rms, after.rms], self.reductions[1]),
        ]
    }

    fn json(&self) -> Map<String, Value> {
        let key = if self.test.unit == "arcsec" { "arcsec" } else { "um" };
        let figure = |([b, a], two): (&[Assessed; 2], [Option<Uncertain>; 2])| {
            let significant = two[0].zip(two[1]).and_then(|(b, a)| is_significant(b, a));
            let entry = json!({
                "before": b.value, "before_u95": b.compared, "after": a.value, "after_u95": a.compared,
                "significant": significant,
            });
            (a.key.clone(), entry)
        };
        let figures: Map<_, _> = self.test.figures.iter().zip(self.uncertain()).map(figure).collect();
        let [before, after] = self.sizes.map(|s| json!([s.low, s.high]));
        let mut out = Map::from_iter([
            ("test".to_owned(), json!(self.test.test)),
            (format!("extremes_before_{key}"), before),
            (format!("extremes_after_{key}"), after),
            ("figures".to_owned(), Value::Object(figures)),
            ("readings".to_owned(), json!(self.test.readings.each_ref().map(Vec::len))),
        ]);
        for (name, [before, after], reduction) in self.rows() {
            let entry = json!({
                format!("before_{key}"): before.value,
                format!("before_u95_{key}"): before.std.map(|s| 2.0 * s),
                format!("after_{key}"): after.value,
                format!("after_u95_{key}"): after.std.map(|s| 2.0 * s),
                "reduction": reduction.map(|r| r.fraction),
                "significant": is_significant(before, after),
                "reduction_u95": reduction.and_then(|r| r.std).map(|s| 2.0 * s),
            });
            out.insert(name.to_owned(), entry);
        }
        self.judged.put(&mut out);
        out
    }

    /// Range and RMS, before and after.
    fn sizes(&self) -> Vec<Vec<String>> {
        let row = |(name, [before, after], reduction): (&str, [Uncertain; 2], _)| {
            let [of_range, of_rms] = self.test.about;
            let name = if name == "range" {
                format!("range of the mean deviations{of_range}")
            } else {
                format!("RMS of the mean deviations{of_rms}")
            };
            vec![name, with_limits(before), with_limits(after), change(before, after, reduction)]
        };
        self.rows().map(row).to_vec()
    }

    /// Each figure of the standard before and after, with its uncertainty.
    fn uncertain(&self) -> impl Iterator<Item = [Option<Uncertain>; 2]> {
        self.test.figures.iter().map(|two| two.each_ref().map(Assessed::uncertain))
    }

    /// What the two measurements make doubtful.
    fn doubts(&self) -> Option<&'static str> {
        let [before, after] = self.sizes.map(|s| s.range);
        let grown = after.value - before.value;
        let limit = match expanded_change(before, after) {
            Some(u) => FAR * u,
            None => before.value,
        };
        (grown > limit).then_some(
            "after is worse than before by far more than the uncertainty: are --before and --after exchanged, or does the \
             correction act with the wrong sign?",
        )
    }

    /// The figures of the standard, before and after, with how they are judged.
    fn judged_figures(&self) -> Vec<Vec<String>> {
        let row = |(([_, a], two), judged): ((&[Assessed; 2], [Option<Uncertain>; 2]), &Assessed)| {
            let show = |u: Option<Uncertain>| u.map_or_else(|| "-".to_owned(), with_limits);
            let change = match two {
                [Some(b), Some(a)] => change(b, a, Reduction::of(b, a)),
                _ => "-".to_owned(),
            };
            let figures = [a.name.to_owned(), show(two[0]), show(two[1]), change];
            figures.into_iter().chain(judged.words()).collect()
        };
        self.test.figures.iter().zip(self.uncertain()).zip(&self.judged.figures).map(row).collect()
    }

    fn print(&self) {
        let unit = self.test.unit;
        say!("{}", self.test.standard);
        let heads = [unit, ">before", ">after", ">reduction"].map(str::to_owned);
        let nothing = [""; 3].map(str::to_owned).to_vec();
        Table::new(heads.into_iter().chain(Assessed::heads(unit)))
            .rows(self.sizes().into_iter().map(|row| [row, nothing.clone()].concat()))
            .rows(self.judged_figures())
            .print();
        let figures = self.test.figures.iter().flatten().any(|f| f.compared.is_some());
        if figures || self.sizes.iter().any(|s| s.range.std.is_some()) {
            say!("± expanded uncertainty, k = 2: {}", self.what_limits());
        }
        for note in self.doubts().into_iter().chain(self.test.notes.iter().map(String::as_str)) {
            note!("note: {note}");
        }
    }

    /// What the limits behind the figures hold.
    fn what_limits(&self) -> &'static str {
        match (self.device.is_some(), self.test.figures.is_empty() || self.test.test == "iso230-4") {
            (true, true) => "scatter of readings at one place and instrument",
            (true, false) => "scatter of readings at one place, few runs and instrument",
            (false, true) => "scatter of readings at one place; the instrument is not stated (--u-device-um)",
            (false, false) => {
                "scatter of readings at one place and few runs; the instrument is not stated (--u-device-um)"
            }
        }
    }

    fn page(&self, args: &Args) -> String {
        let unit = self.test.unit;
        let title = args.title.as_deref().unwrap_or("Before and after compensation");
        let origins = [Origin::of("before", &args.before), Origin::of("after", &args.after)];
        let mut page = page::start(title, self.test.standard, &self.judged, &origins, &[]);
        if let Some(range) = self.reductions[0] {
            let changed = if range.fraction < 0.0 { "increased" } else { "reduced" };
            page.lead(format_args!("Range of the mean deviations {changed} by {}.", share(range)));
        }
        page.heading("Reduction");
        let heads = ["".into(), format!(">before / {unit}"), format!(">after / {unit}"), ">reduction".into()];
        Table::new(&heads).rows(self.sizes()).put(&mut page);
        let of_device = args.u_device_um.map_or_else(String::new, |u| {
            format!(" ({u} {unit}, taken as independent in both measurements)")
        });
        page.note(format!("± expanded uncertainty, k = 2: {}{of_device}.", self.what_limits()));
        if let Some(doubts) = self.doubts() {
            page.note(doubts);
        }
        for note in &self.test.notes {
            page.note(note);
        }
        if !self.test.figures.is_empty() {
            page.heading("Figures of the standard");
            Table::new(heads.into_iter().chain(Assessed::heads(unit)))
                .rows(self.judged_figures())
                .put(&mut page);
        }
        page.plots(&self.test.plots, self.test.caption);
        if !self.charts.is_empty() {
            page.heading("Deviations");
            page.charts(&self.charts);
        }
        page::finish(page, &self.judged)
    }
}

/// A range that grows by more than so many times the expanded uncertainty of the change is far worse.
const FAR: f64 = 2.0;

/// Reduction in percent, or that the change is within its uncertainty.
fn change(before: Uncertain, after: Uncertain, reduction: Option<Reduction>) -> String {
    if is_significant(before, after) == Some(false) {
        return NOT_SIGNIFICANT.to_owned();
    }
    percent(reduction)
}

fn with_limits(u: Uncertain) -> String {
    match u.std {
        Some(std) => format!("{} ± {:.2}", plain(u.value, 2), 2.0 * std),
        None => plain(u.value, 2),
    }
}

/// A reduction as a cell of a table; an increase is named.
fn percent(reduction: Option<Reduction>) -> String {
    let Some(reduction) = reduction else { return "-".to_owned() };
    let increased = if reduction.fraction < 0.0 { "increased by " } else { "" };
    increased.to_owned() + &share(reduction)
}

/// The size of a reduction or increase in percent.
fn share(Reduction { fraction, std }: Reduction) -> String {
    let limits = std.map_or_else(String::new, |std| format!(" ± {:.1}", 200.0 * std));
    format!("{}{limits} %", plain(100.0 * fraction.abs(), 1))
}
