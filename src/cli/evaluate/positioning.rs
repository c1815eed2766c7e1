//! `evaluate iso230-2`: positioning of one axis.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use super::page::{self, Origin};
use super::picture::positioning::Shown;
use super::uncertainty_args::UncertaintyArgs;
use super::{
    CompareOptions, Compared, Figure, Output, bad_data, change, drawn, percent, picture, put_before, show,
    side_by_side,
};
use crate::acceptance::verdicts::{self, Assessed, NOT_STATED};
use crate::acceptance::{Acceptance, Stated};
use crate::numerals::counted;
use crate::positioning_data::{Cycles, TestFormat, read_test};
use crate::report::page::Cell;
use crate::start_up::{StartUp, in_report_units};
use crate::{EX_USAGE, Failure};
use volcomp_evaluate::uncertainty::Expanded;
use volcomp_evaluate::{Conditions, Placed, Positioning, PositioningReading, Spread, Uncertainties};
use volcomp_units::axes::{AxisKind, Travel};

/// Positioning of one axis by ISO 230-2: reversal, repeatability, systematic deviation, accuracy
///
/// Targets and deviations as the instrument gave them: at least two targets, two runs; the standard asks for five
/// runs in both directions. Example, with the test before compensation beside the one after:
///
///   volcomp evaluate iso230-2 --data after.csv --before before.csv --html x-axis.html --title "VMC 850, X axis"
#[derive(Debug, clap::Parser)]
pub(super) struct Args {
    /// CSV with cycle,direction,target_mm,deviation_um (rotary: target_deg,deviation_arcsec), or a .dat file; - is stdin.
    #[arg(long, value_name = "FILE", required_unless_present = "file")]
    data: Option<PathBuf>,
    /// The same test at an earlier time, to compare with.
    #[arg(long, value_name = "FILE")]
    before: Option<PathBuf>,
    /// How the files are written.
    #[arg(long, value_enum, default_value = "auto")]
    format: TestFormat,
    /// Only these cycles, such as 1-4 or 1,3,5.
    #[arg(long)]
    cycles: Option<Cycles>,
    #[command(flatten)]
    uncertainty: UncertaintyArgs,
    #[command(flatten)]
    output: Output,
}

/// A test in the units of the report, so that messages name the targets in them too.
pub(super) struct Evaluated {
    pub(super) kind: AxisKind,
    pub(super) readings: Vec<PositioningReading>,
    pub(super) result: Positioning,
    pub(super) uncertainties: Uncertainties,
    /// Readings of the first cycle that the others contradict, and the figures without them.
    pub(super) start_up: Option<StartUp>,
    /// What the file states about the test.
    stated: Stated,
}

impl Evaluated {
    /// Unit of deviations in keys, of deviations and of targets in words.
    const fn units(&self) -> (&'static str, &'static str, &'static str) {
        match self.kind {
            AxisKind::Linear => ("um", "µm", "mm"),
            AxisKind::Rotary => ("arcsec", "arcsec", "deg"),
        }
    }

    fn shown<'a>(&'a self, title: &'a str) -> Shown<'a> {
        let (_, unit, target_unit) = self.units();
        Shown { title, result: &self.result, readings: &self.readings, unit, target_unit }
    }
}

fn read(args: &Args, path: &Path) -> Result<Evaluated, Failure> {
    let (mut test, stated) = read_test(path, args.format)?;
    if let Some(cycles) = &args.cycles {
        cycles.select(&path.display().to_string(), &mut test)?;
    }
    let readings: Vec<PositioningReading> =
        test.readings.iter().map(|r| in_report_units(test.kind, r)).collect();
    let result = Positioning::evaluate(&readings).map_err(|e| bad_data(path, e))?;
    if result.cycles < 5 {
        note!("note: {}: {}; ISO 230-2 asks for 5", path.display(), counted(result.cycles, "cycle"));
    }
    let conditions = args.uncertainty.conditions(test.kind)?;
    let uncertainties = Uncertainties::of(&result, &conditions, length(&result));
    let start_up = StartUp::of(&test);
    for m in start_up.iter().flat_map(|s| &s.marked) {
        note!("warning: {}:{}: {}; kept in the results", path.display(), m.line, m.words(test.kind));
    }
    Ok(Evaluated { kind: test.kind, readings, result, uncertainties, start_up, stated })
}

/// Range of the targets.
pub(super) fn length(test: &Positioning) -> f64 {
    test.targets.first().zip(test.targets.last()).map_or(0.0, |(a, b)| b.target - a.target)
}

/// Keys of the figures that may have a tolerance, linear and rotary.
fn keys() -> Vec<String> {
    FIGURES.iter().flat_map(|(key, ..)| ["um", "arcsec"].map(|unit| format!("{key}_{unit}"))).collect()
}

/// The figures of a test with tolerances and stated uncertainties.
fn assessed(acceptance: &Acceptance, test: &Evaluated) -> Vec<Assessed> {
    let (unit, ..) = test.units();
    let stated = stated(&test.uncertainties);
    figures(&test.result)
        .into_iter()
        .map(|f| {
            let expanded = stated.iter().find(|(key, _)| *key == f.key).map(|(_, u)| *u);
            acceptance.assess(&format!("{}_{unit}", f.key), f.name, f.value, expanded)
        })
        .collect()
}

/// Expanded uncertainties of the measurement by the keys of the figures; none where nothing was stated.
pub(super) fn stated(u: &Uncertainties) -> Vec<(&'static str, f64)> {
    uncertain(u).into_iter().filter_map(|(key, _, e)| measured(u, key, &e).map(|u| (key, u))).collect()
}

/// The expanded uncertainty of the measurement. Reversal and repeatability compare readings at one place: only drift belongs to
/// them, and without it theirs is not stated.
fn measured(u: &Uncertainties, key: &str, e: &Expanded) -> Option<f64> {
    let is_stated = if key.starts_with(['b', 'r']) {
        u.contributions.iter().any(|c| c.name == "drift")
    } else {
        !u.contributions.is_empty()
    };
    is_stated.then_some(e.measurement)
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let mut acceptance = Acceptance::load(&args.output.head, "iso230-2", &keys())?;
    let after = read(args, args.output.data(&args.data))?;
    acceptance.fill(after.stated.clone());
    let assessed = assessed(&acceptance, &after);
    let before = args.before.as_deref().map(|path| read(args, path)).transpose()?;
    if let (Some(before), Some(path)) = (&before, &args.before)
        && before.kind != after.kind
    {
        return Err(bad_data(
            path,
            "one of the two tests is linear, the other rotary; they cannot be compared",
        ));
    }
    let title = args.output.title.as_deref().unwrap_or("Positioning of an axis");
    args.output.write(
        || {
            picture::positioning::whole(
                &after.shown(title),
                before.as_ref().map(|b| b.shown("before")).as_ref(),
            )
        },
        || report(args, title, &acceptance, &assessed, &after, before.as_ref()),
    )?;
    let (key, ..) = after.units();
    if args.output.json {
        let mut out = as_json(&after.result, key, |v| v);
        put_uncertainties(&mut out, &after.uncertainties, key);
        put_start_up(&mut out, &after, key);
        verdicts::put(&mut out, &assessed);
        if let Some(before) = &before {
            put_before(&mut out, as_json(&before.result, key, |v| v));
        }
        say!("{:#}", Value::Object(out));
        return Ok(());
    }
    let stdout_taken =
        [&args.output.svg, &args.output.report].into_iter().flatten().any(|p| p.as_os_str() == "-");
    if !stdout_taken {
        let (file, p) = (args.output.data(&args.data).display(), &after.result);
        let (targets, cycles) = (counted(p.targets.len(), "target"), counted(p.cycles, "cycle"));
        say!("ISO 230-2 of {file}: {targets}, {cycles}");
        print(p, key, |v| v);
        print_uncertainties(&after.uncertainties, key);
        verdicts::print(&assessed, key);
        print_start_up(&after, key);
        if let Some(before) = &before {
            print_change(&before.result, p, key);
        }
    }
    Ok(())
}

/// How many of the figures belong to both directions.
const BOTH: usize = 6;
/// Share of the common scale below which a test is drawn at its own scale, too.
const OWN_SCALE: f64 = 0.4;
const STANDARD: &str = "Accuracy and repeatability of positioning, ISO 230-2:2014";

/// The figures of a test by their keys.
fn figures(p: &Positioning) -> [Figure; 12] {
    FIGURES.map(|(key, name, of)| Figure { key, name, value: of(p) })
}

type Get = fn(&Positioning) -> Option<f64>;
/// Key, term of ISO 230-2:2014, and how a figure is taken from a test.
const FIGURES: [(&str, &str, Get); 12] = [
    ("b", "reversal error B", |p| p.both.map(|b| b.b)),
    ("b_mean", "mean reversal error", |p| p.both.map(|b| b.b_mean)),
    ("r", "bidirectional repeatability R", |p| p.both.map(|b| b.r)),
    ("e", "bidirectional systematic positioning error E", |p| p.both.map(|b| b.e)),
    ("m", "mean bidirectional positioning error M", |p| p.both.map(|b| b.m)),
    ("a", "bidirectional positioning accuracy A", |p| p.both.map(|b| b.a)),
    ("e_fwd", "systematic positioning error E, forward", |p| p.forward.map(|d| d.e)),
    ("a_fwd", "positioning accuracy A, forward", |p| p.forward.map(|d| d.a)),
    ("r_fwd", "repeatability R, forward", |p| p.forward.map(|d| d.r)),
    ("e_bwd", "systematic positioning error E, backward", |p| p.backward.map(|d| d.e)),
    ("a_bwd", "positioning accuracy A, backward", |p| p.backward.map(|d| d.a)),
    ("r_bwd", "repeatability R, backward", |p| p.backward.map(|d| d.r)),
];

/// The keys of `docs/reference/json-output.md` 3.
pub(super) fn as_json(p: &Positioning, unit: &str, scale: fn(f64) -> f64) -> Map<String, Value> {
    let mut map: Map<String, Value> =
        figures(p).into_iter().map(|f| (format!("{}_{unit}", f.key), json!(f.value.map(scale)))).collect();
    map.insert("targets".to_owned(), json!(p.targets.len()));
    map.insert("cycles".to_owned(), json!(p.cycles));
    map
}

/// Figures with an uncertainty, in the order of [`Uncertainties`].
fn uncertain(u: &Uncertainties) -> Vec<(&'static str, &'static str, Expanded)> {
    let mut out = Vec::new();
    let names = [("b", "B"), ("r", "R"), ("e", "E"), ("m", "M"), ("a", "A")];
    out.extend(u.both.into_iter().flat_map(|b| names.into_iter().zip(b).map(|((k, n), e)| (k, n, e))));
    for (side, keys) in [
        (u.forward, [("e_fwd", "E, forward"), ("a_fwd", "A, forward"), ("r_fwd", "R, forward")]),
        (u.backward, [("e_bwd", "E, backward"), ("a_bwd", "A, backward"), ("r_bwd", "R, backward")]),
    ] {
        out.extend(side.into_iter().flat_map(|s| keys.into_iter().zip(s).map(|((k, n), e)| (k, n, e))));
    }
    out
}

fn put_uncertainties(out: &mut Map<String, Value>, u: &Uncertainties, unit: &str) {
    let mut map = Map::new();
    for (key, _, e) in uncertain(u) {
        let of = json!({format!("measurement_{unit}"): measured(u, key, &e), format!("sampling_{unit}"): e.sampling});
        map.insert(key.to_owned(), of);
    }
    out.insert("expanded_uncertainty_k2".to_owned(), Value::Object(map));
    let contributions: Vec<Value> =
        u.contributions.iter().map(|c| json!({"name": c.name, format!("std_{unit}"): c.std})).collect();
    out.insert("contributions".to_owned(), Value::Array(contributions));
}

pub(super) fn print(p: &Positioning, unit: &str, scale: fn(f64) -> f64) {
    let row = |name: &str, values: [Option<f64>; 3]| {
        let [f, b, both] = values.map(|v| show(v.map(scale)));
        say!("{name:<32}{f:>12}{b:>12}{both:>16}");
    };
    let (f, b, both) = (p.forward, p.backward, p.both);
    say!("{:<32}{:>12}{:>12}{:>16}", unit, "forward", "backward", "bidirectional");
    row("reversal error B", [None, None, both.map(|x| x.b)]);
    row("mean reversal error", [None, None, both.map(|x| x.b_mean)]);
    row("repeatability R", [f.map(|x| x.r), b.map(|x| x.r), both.map(|x| x.r)]);
    row("systematic positioning error E", [f.map(|x| x.e), b.map(|x| x.e), both.map(|x| x.e)]);
    row("mean positioning error M", [None, None, both.map(|x| x.m)]);
    row("positioning accuracy A", [f.map(|x| x.a), b.map(|x| x.a), both.map(|x| x.a)]);
}

/// The start-up outliers and the figures without them.
fn put_start_up(out: &mut Map<String, Value>, test: &Evaluated, unit: &str) {
    let Some(start_up) = &test.start_up else { return };
    let target = if test.kind == AxisKind::Linear { "target_mm" } else { "target_deg" };
    let marked: Vec<Value> = start_up
        .marked
        .iter()
        .map(|m| {
            json!({
                "line": m.line,
                target: m.target,
                "direction": if m.travel == Travel::Forward { 1 } else { -1 },
                "cycle": m.cycle,
                format!("deviation_{unit}"): m.deviation,
                format!("apart_{unit}"): m.apart,
                format!("limit_{unit}"): m.limit,
            })
        })
        .collect();
    out.insert("start_up_outliers".to_owned(), Value::Array(marked));
    let without = start_up.without.as_ref().map(|p| Value::Object(as_json(p, unit, |v| v)));
    out.insert("without_start_up_outliers".to_owned(), without.unwrap_or(Value::Null));
}

fn print_start_up(test: &Evaluated, unit: &str) {
    let Some(start_up) = &test.start_up else { return };
    say!();
    say!("without {}", outliers_in_words(start_up));
    match &start_up.without {
        Some(p) => print(p, unit, |v| v),
        None => say!("too few readings are left at a target"),
    }
}

/// `2 start-up outliers (lines 23, 25)`.
fn outliers_in_words(start_up: &StartUp) -> String {
    let lines: Vec<String> = start_up.marked.iter().map(|m| m.line.to_string()).collect();
    let (s, line) = if lines.len() == 1 { ("", "line") } else { ("s", "lines") };
    format!("{} start-up outlier{s} ({line} {})", lines.len(), lines.join(", "))
}

fn print_uncertainties(u: &Uncertainties, unit: &str) {
    let Some(both) = u.both else { return };
    let stated = !u.contributions.is_empty();
    say!();
    say!("{:<28}{:>12}{:>12}{:>8}{:>8}{:>8}", format!("expanded, k = 2, {unit}"), "B", "R", "E", "M", "A");
    let row = |name: &str, values: [Option<f64>; 5]| {
        let [b, r, e, m, a] = values.map(show);
        say!("{name:<28}{b:>12}{r:>12}{e:>8}{m:>8}{a:>8}");
    };
    if stated {
        let [b, r, e, m, a] = both.each_ref();
        row(
            "measurement",
            [("b", b), ("r", r), ("e", e), ("m", m), ("a", a)].map(|(key, e)| measured(u, key, e)),
        );
    }
    row("few runs", both.each_ref().map(|e| Some(e.sampling)));
    if !stated {
        say!(
            "measurement: nothing stated about instrument, temperature and drift (--help names the options)"
        );
    }
}

fn print_change(before: &Positioning, after: &Positioning, unit: &str) {
    say!();
    say!("{:<46}{:>12}{:>12}{:>10}", format!("change, {unit}"), "before", "after", "");
    for (b, a) in figures(before).into_iter().zip(figures(after)).filter(|(_, a)| a.value.is_some()) {
        let share = percent(change(b.value, a.value));
        say!("{:<46}{:>12}{:>12}{share:>10}", a.name, show(b.value), show(a.value));
    }
}

fn report(
    args: &Args,
    title: &str,
    acceptance: &Acceptance,
    assessed: &[Assessed],
    after: &Evaluated,
    before: Option<&Evaluated>,
) -> Result<String, Box<dyn std::error::Error>> {
    let (_, unit, target_unit) = after.units();
    let mut origins = vec![Origin::of("data", args.output.data(&args.data))];
    origins.extend(args.before.as_deref().map(|p| Origin::of("before", p)));
    let size = |p: &Positioning| {
        let ends = p.targets.first().zip(p.targets.last());
        let [low, high] = ends.map_or([0.0; 2], |(a, b)| [a.target, b.target]);
        let short = if p.cycles < 5 { "; ISO 230-2 asks for 5 runs" } else { "" };
        let (targets, runs) = (counted(p.targets.len(), "target"), counted(p.cycles, "run"));
        format!("{targets} from {low} to {high} {target_unit}, {runs}{short}")
    };
    let mut facts = vec![("test", size(&after.result))];
    facts.extend(before.map(|b| ("test before", size(&b.result))));
    let mut page = page::start(title, STANDARD, acceptance, assessed, &origins, &facts);
    let old = before.map(|b| figures(&b.result));
    let old = |range: core::ops::Range<usize>| old.as_ref().map(|o| &o[range]);
    page::figures(&mut page, unit, &assessed[..BOTH], old(0..BOTH));
    let caption = "Deviation = actual - target. Solid: mean of each direction, band: ± 2 s, dots: readings, dashed: mean of both \
                   directions. B and R are marked where they occur, M, E and A are the ranges at the right.";
    let own = picture::positioning::scale([Some(&after.result)], [&after.readings[..]]);
    let mut scale = own;
    let height = match before {
        Some(_) => picture::positioning::HALF_HEIGHT,
        None => picture::positioning::HEIGHT,
    };
    if let Some(before) = before {
        let both = [Some(&after.result), Some(&before.result)];
        scale = picture::positioning::scale(both, [&after.readings[..], &before.readings[..]]);
        page.heading("Before");
        page.picture(&picture::positioning::single(&before.shown(""), scale, height)?);
        page.heading("After, same scale");
    } else {
        page.heading("Deviations");
    }
    page.figure(&picture::positioning::single(&after.shown(""), scale, height)?, caption);
    // where the test improved much, its own scale shows what is left
    if own[1] - own[0] < OWN_SCALE * (scale[1] - scale[0]) {
        page.sheet("After, own scale");
        page.picture(&picture::positioning::single(&after.shown(""), own, picture::positioning::HEIGHT)?);
    }
    start_up_section(&mut page, after, unit);
    page.heading("Each direction");
    page::figures(&mut page, unit, &assessed[BOTH..], old(BOTH..assessed.len()));
    uncertainty_section(&mut page, &after.uncertainties, unit);
    page.heading("Targets");
    targets(&mut page, &after.result, unit, target_unit);
    if let Some(before) = before {
        page.heading("Targets before");
        targets(&mut page, &before.result, unit, target_unit);
    }
    Ok(page::finish(page, assessed))
}

/// Start-up outliers with the figures with and without them.
fn start_up_section(page: &mut crate::report::Page, test: &Evaluated, unit: &str) {
    let Some(start_up) = &test.start_up else { return };
    page.heading("Start-up outliers");
    let list: Vec<String> =
        start_up.marked.iter().map(|m| format!("Line {}: {}.", m.line, m.words(test.kind))).collect();
    page.note(list.join(" "));
    if let Some(without) = &start_up.without {
        let head = [
            Cell::head("figure"),
            Cell::number(format!("with them / {unit}")),
            Cell::number(format!("without / {unit}")),
        ];
        let rows: Vec<Vec<Cell>> = figures(&test.result)
            .into_iter()
            .zip(figures(without))
            .filter(|(f, _)| f.value.is_some())
            .map(|(with, without)| {
                vec![Cell::head(with.name), Cell::number(show(with.value)), Cell::number(show(without.value))]
            })
            .collect();
        page.table(&head, &rows);
    }
    page.note("The results of this report hold all readings. Repeat the test after a warm-up.");
}

fn uncertainty_section(page: &mut crate::report::Page, u: &Uncertainties, unit: &str) {
    page.heading("Uncertainty");
    let stated = !u.contributions.is_empty();
    if stated {
        let rows: Vec<Vec<Cell>> = u
            .contributions
            .iter()
            .map(|c| vec![Cell::head(c.name), Cell::number(format!("{:.2}", c.std))])
            .collect();
        page.table(
            &[Cell::head("contribution"), Cell::number(format!("standard uncertainty / {unit}"))],
            &rows,
        );
    }
    let head = [
        Cell::head("expanded uncertainty, k = 2"),
        Cell::number(format!("of the measurement / {unit}")),
        Cell::number(format!("from few runs / {unit}")),
    ];
    let rows: Vec<Vec<Cell>> = uncertain(u)
        .into_iter()
        .map(|(key, name, e)| {
            let measurement =
                measured(u, key, &e).map_or_else(|| NOT_STATED.to_owned(), |u| format!("{u:.2}"));
            vec![Cell::head(name), Cell::number(measurement), Cell::number(format!("{:.2}", e.sampling))]
        })
        .collect();
    page.table(&head, &rows);
    page.note(
        "Measurement: instrument, alignment, temperature and drift, as far as they were stated. Few runs: what the scatter \
         of the readings does to means and standard deviations of so few runs (first order).",
    );
}

fn targets(page: &mut crate::report::Page, p: &Positioning, unit: &str, target_unit: &str) {
    let head: Vec<Cell> = [
        format!("target / {target_unit}"),
        format!("mean forward / {unit}"),
        "s".to_owned(),
        "mean backward".to_owned(),
        "s".to_owned(),
        "mean of both".to_owned(),
        "B".to_owned(),
        "R".to_owned(),
    ]
    .into_iter()
    .map(Cell::number)
    .collect();
    let rows: Vec<Vec<Cell>> = p
        .targets
        .iter()
        .map(|t| {
            let mean = |s: Option<Spread>| show(s.map(|s| s.mean));
            let spread = |s: Option<Spread>| show(s.map(|s| s.s));
            [
                format!("{}", (t.target * 1e6).round() / 1e6),
                mean(t.forward),
                spread(t.forward),
                mean(t.backward),
                spread(t.backward),
                show(t.mean()),
                show(t.reversal()),
                show(t.repeatability()),
            ]
            .into_iter()
            .map(Cell::number)
            .collect()
        })
        .collect();
    page.table(&head, &rows);
}

/// Two tests for `volcomp verify`.
pub(super) fn compare(files: [&Path; 2], options: CompareOptions) -> Result<Compared, Failure> {
    let read = |path: &Path| -> Result<Evaluated, Failure> {
        let words = ["iso230-2".as_ref(), "--data".as_ref(), path.as_os_str()];
        let args = <Args as clap::Parser>::try_parse_from(words).map_err(|e| Failure::new(EX_USAGE, e))?;
        read(&args, path)
    };
    let [before, mut after] = [read(files[0])?, read(files[1])?];
    let conditions = Conditions { device: options.u_device, ..Conditions::default() };
    after.uncertainties = Uncertainties::of(&after.result, &conditions, length(&after.result));
    if before.kind != after.kind {
        return Err(bad_data(files[1], "one of the two tests is linear, the other rotary"));
    }
    let (_, unit, _) = after.units();
    let figures = side_by_side(&figures(&before.result), assessed(&Acceptance::default(), &after));
    let scale = picture::positioning::scale(
        [Some(&before.result), Some(&after.result)],
        [&before.readings[..], &after.readings[..]],
    );
    let plot = |test: &Evaluated| {
        picture::positioning::single(&test.shown(""), scale, picture::positioning::HEIGHT).map_err(drawn)
    };
    let placed = |test: &Evaluated| test.readings.iter().map(|r| placed(0, r)).collect();
    Ok(Compared {
        test: "iso230-2",
        standard: STANDARD,
        keys: keys(),
        stated: after.stated.clone(),
        unit,
        figures,
        plots: vec![("Before", plot(&before)?), ("After, same scale", plot(&after)?)],
        caption: "Solid: mean of each direction, band: ± 2 s, dots: readings, dashed: mean of both directions.",
        readings: [placed(&before), placed(&after)],
        is_repeated: true,
        notes: Vec::new(),
    })
}

/// A reading at its target, each direction a place of its own.
pub(super) fn placed(curve: u32, r: &PositioningReading) -> Placed {
    let reverse = i64::from(r.travel == Travel::Reverse);
    Placed { curve, place: 2 * (r.target * 1e3).round() as i64 + reverse, value: r.deviation }
}
