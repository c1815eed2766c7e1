//! `evaluate iso230-2`: positioning of one axis.

use super::page;
use super::picture::positioning::{self as drawing, Shown};
use super::uncertainty_args::UncertaintyArgs;
use super::{
    CompareOptions, Compared, Figures, Output, assess, before_and_after, is_flat, show, side_by_side, values,
};
use crate::acceptance::NOT_STATED;
use crate::positioning_data::{Cycles, TestFormat, read_test};
use crate::prelude::*;
use crate::start_up::{self, StartUp, in_report_units, words};
use volcomp_evaluate::uncertainty::OfFigure;
use volcomp_evaluate::{Conditions, Placed, Positioning, PositioningReading, Spread, Uncertainties};
use volcomp_formats::positioning_test::PositioningTest;
use volcomp_identify::reading::group_by_position;

/// Positioning of one axis by ISO 230-2: reversal, repeatability, systematic deviation, accuracy
///
/// Targets and deviations as the instrument gave them: at least two targets, two runs; the standard asks for five
/// runs in both directions. Example, with the test before compensation beside the one after:
///
///   volcomp evaluate iso230-2 --data after.csv --before before.csv --html x-axis.html --title "VMC 850, X axis"
#[derive(Debug, clap::Parser)]
pub(crate) struct Args {
    /// CSV with cycle,direction,target_mm,deviation_um (rotary: target_deg,deviation_arcsec), or a .dat or .rtl file; - is stdin.
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

    fn shown(&self) -> Shown<'_> {
        let (_, unit, target_unit) = self.units();
        Shown { result: &self.result, readings: &self.readings, unit, target_unit }
    }
}

fn read(
    path: &Path,
    format: TestFormat,
    cycles: Option<&Cycles>,
    uncertainty: &UncertaintyArgs,
) -> Result<Evaluated> {
    let (mut test, stated) = read_test(path, format)?;
    if let Some(cycles) = cycles {
        cycles.select(&path.display().to_string(), &mut test)?;
    }
    check_runs(path, &test)?;
    let readings: Vec<PositioningReading> =
        test.readings.iter().map(|r| in_report_units(test.kind, r)).collect();
    let result = Positioning::evaluate(&readings).map_err(|e| data!(path, "{e}"))?;
    if result.cycles < 5 {
        note!("note: {}: {}; ISO 230-2 asks for 5", path.display(), counted(result.cycles, "cycle"));
    }
    let conditions = uncertainty.conditions(test.kind)?;
    let uncertainties = Uncertainties::of(&result, &conditions, result.length());
    check_unit(path, &test, &readings)?;
    uncertainty_note(path, &result, &uncertainties);
    let start_up = StartUp::of(&test);
    for m in start_up.iter().flat_map(|s| &s.marked) {
        note!("warning: {}:{}: {}; kept in the results", path.display(), m.line, words(m, test.kind));
    }
    Ok(Evaluated { kind: test.kind, readings, result, uncertainties, start_up, stated })
}

/// Most missing readings that are named one by one.
const NAMED: usize = 3;

/// Refuses a target that stands twice in a run, and names the readings that are missing.
fn check_runs(path: &Path, test: &PositioningTest) -> Result<()> {
    let (positions, group) = group_by_position(&test.readings);
    let text = |(cycle, is_reverse, target): (u32, bool, usize)| {
        let (direction, unit) = (if is_reverse { -1 } else { 1 }, test.kind.position_unit());
        let target = rounded(test.kind.position_out(positions[target]));
        format!("cycle {cycle}, direction {direction}, target {target} {unit}")
    };
    let file = path.display();
    let mut seen = BTreeMap::new();
    for (i, (r, target)) in test.readings.iter().zip(group).enumerate() {
        let (key, line) = ((r.cycle, r.travel == Travel::Reverse, target), test.line(i));
        if let Some(first) = seen.insert(key, line) {
            return Err(failure!(
                EX_DATAERR,
                "{file}:{line}: {} stands in line {first}, too; remove one of the two, or give a repeated run a cycle of its own",
                text(key)
            ));
        }
    }
    let cycles: BTreeSet<u32> = seen.keys().map(|key| key.0).collect();
    let directions: BTreeSet<bool> = seen.keys().map(|key| key.1).collect();
    let runs = cycles.iter().flat_map(|c| directions.iter().map(move |d| (*c, *d)));
    let expected = runs.flat_map(|(c, d)| (0..positions.len()).map(move |target| (c, d, target)));
    let missing: Vec<_> = expected.filter(|key| !seen.contains_key(key)).collect();
    if !missing.is_empty() {
        let named = missing.iter().take(NAMED).map(|key| text(*key)).joined("; ");
        let more = missing.len().saturating_sub(NAMED);
        let more = if more > 0 { format!("; and {more} more") } else { String::new() };
        note!("note: {file}: no reading of {named}{more}");
    }
    Ok(())
}

/// Looks at the unit of the deviations.
fn check_unit(path: &Path, test: &PositioningTest, readings: &[PositioningReading]) -> Result<()> {
    let values = readings.iter().enumerate().map(|(i, r)| (r.deviation, test.line(i)));
    let is_angle = test.kind == AxisKind::Rotary;
    let column = if is_angle { "deviation_arcsec" } else { "deviation_um" };
    check_size(&path.display().to_string(), column, values, is_angle)
}

/// States that the uncertainty leaves nothing of the result.
fn uncertainty_note(path: &Path, result: &Positioning, u: &Uncertainties) {
    let of_a = u.figure("a").and_then(|of| of.measurement);
    if let Some((u, a)) = of_a.zip(result.both.map(|b| b.a)).filter(|(u, a)| u > a) {
        note!(
            "note: {}: the uncertainty of A, {u:.2}, is larger than A itself, {a:.2}: check the values of --u-device-um, .. (k = 2)",
            path.display()
        );
    }
}

/// Keys of the figures that may have a tolerance, linear and rotary.
fn keys() -> Vec<String> {
    FIGURES.iter().flat_map(|(key, ..)| ["um", "arcsec"].map(|unit| format!("{key}_{unit}"))).collect()
}

/// The figures of a test with tolerances and stated uncertainties.
fn assessed(acceptance: &Acceptance, test: &Evaluated) -> Vec<Assessed> {
    let unit = format!("_{}", test.units().0);
    let u = &test.uncertainties;
    let mut figures = assess(FIGURES, &test.result, acceptance, &unit, |key| u.figure(key)?.measurement);
    for f in &mut figures {
        f.compared = u.figure(f.key.trim_end_matches(&unit)).map(|of| of.expanded.total());
    }
    figures
}

pub(super) fn run(args: &Args) -> Result<()> {
    let mut acceptance = Acceptance::load(&args.output.head, "iso230-2", &keys())?;
    let read = |path: &Path| read(path, args.format, args.cycles.as_ref(), &args.uncertainty);
    let after = read(args.output.data(&args.data))?;
    acceptance.fill(after.stated.clone());
    let judged = Judged { figures: assessed(&acceptance, &after), acceptance };
    let before = args.before.as_deref().map(read).transpose()?;
    if let (Some(before), Some(path)) = (&before, &args.before)
        && before.kind != after.kind
    {
        return Err(data!(path, "one of the two tests is linear, the other rotary; they cannot be compared"));
    }
    let old = before.as_ref().map(|b| assessed(&Acceptance::default(), b));
    let title = args.output.title("Positioning of an axis");
    let (key, ..) = after.units();
    args.output.deliver(
        &judged,
        || drawing::whole(title, &after.shown(), before.as_ref().map(Evaluated::shown).as_ref()),
        || report(args, title, &judged, &after, before.as_ref().zip(old.as_deref())),
        || {
            let mut out = as_json(&after.result, key);
            put_uncertainties(&mut out, &after.uncertainties, key);
            put_start_up(&mut out, &after, key);
            (out, before.as_ref().map(|before| as_json(&before.result, key)))
        },
        || {
            let (file, p) = (args.output.data(&args.data).display(), &after.result);
            let (targets, cycles) = (counted(p.targets.len(), "target"), counted(p.cycles, "cycle"));
            say!("ISO 230-2 of {file}: {targets}, {cycles}");
            table(p, key).print();
            print_uncertainties(p, &after.uncertainties, key);
            print_start_up(&after, key);
            if old.is_some() || judged.has_verdicts() {
                say!();
                page::figures(key, &judged.figures, old.as_deref()).print();
            }
        },
    )
}

/// How many of the figures belong to both directions.
const BOTH: usize = 6;
const STANDARD: &str = "Accuracy and repeatability of positioning, ISO 230-2:2014";

/// Key, term of ISO 230-2:2014, and how a figure is taken from a test.
const FIGURES: &Figures<Positioning> = &[
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
pub(super) fn as_json(p: &Positioning, unit: &str) -> Map<String, Value> {
    let none = |_: &str| None;
    let mut map = values(&assess(FIGURES, p, &Acceptance::default(), &format!("_{unit}"), none));
    map.insert("targets".to_owned(), json!(p.targets.len()));
    map.insert("cycles".to_owned(), json!(p.cycles));
    map
}

fn put_uncertainties(out: &mut Map<String, Value>, u: &Uncertainties, unit: &str) {
    let of = |OfFigure { key, expanded: e, measurement, .. }: OfFigure| {
        let figure = out.get(&format!("{key}_{unit}")).and_then(Value::as_f64);
        let value = json!({
            format!("measurement_{unit}"): measurement,
            format!("sampling_{unit}"): e.sampling,
            format!("sampling_bias_{unit}"): e.bias,
            format!("interval_{unit}"): figure.map(|f| e.interval(f)),
        });
        (key.to_owned(), value)
    };
    let all = u.figures().map(of).collect();
    out.insert("expanded_uncertainty_k2".to_owned(), Value::Object(all));
    let contributions = u.contributions.iter().map(|c| json!({"name": c.name, format!("std_{unit}"): c.std}));
    out.insert("contributions".to_owned(), contributions.collect());
}

/// The figures of each direction and of both.
pub(super) fn table(p: &Positioning, unit: &str) -> Table {
    let (f, b, both) = (p.forward, p.backward, p.both);
    Table::new([unit, ">forward", ">backward", ">bidirectional"]).rows(
        [
            ("reversal error B", [None, None, both.map(|x| x.b)]),
            ("mean reversal error", [None, None, both.map(|x| x.b_mean)]),
            ("repeatability R", [f.map(|x| x.r), b.map(|x| x.r), both.map(|x| x.r)]),
            ("systematic positioning error E", [f.map(|x| x.e), b.map(|x| x.e), both.map(|x| x.e)]),
            ("mean positioning error M", [None, None, both.map(|x| x.m)]),
            ("positioning accuracy A", [f.map(|x| x.a), b.map(|x| x.a), both.map(|x| x.a)]),
        ]
        .map(|(name, values)| [&[name.to_owned()], &values.map(show)[..]].concat()),
    )
}

/// The start-up outliers and the figures without them.
fn put_start_up(out: &mut Map<String, Value>, test: &Evaluated, unit: &str) {
    let Some(start_up) = &test.start_up else { return };
    let units = (test.kind.position_unit(), unit);
    let marked = start_up.marked.iter().map(|m| start_up::as_json(m, units));
    out.insert("start_up_outliers".to_owned(), marked.collect());
    let without = start_up.without.as_ref().map(|p| as_json(p, unit));
    out.insert("without_start_up_outliers".to_owned(), json!(without));
}

fn print_start_up(test: &Evaluated, unit: &str) {
    let Some(start_up) = &test.start_up else { return };
    say!();
    say!("without {}", outliers_in_words(start_up));
    match &start_up.without {
        Some(p) => with_and_without(test, p, unit).print(),
        None => say!("too few readings are left at a target"),
    }
}

/// The figures with the start-up outliers and without them.
fn with_and_without(test: &Evaluated, without: &Positioning, unit: &str) -> Table {
    let rows = FIGURES.iter().filter(|(.., get)| get(&test.result).is_some());
    Table::new(["figure".to_owned(), format!(">with them / {unit}"), format!(">without / {unit}")])
        .rows(rows.map(|(_, name, get)| [(*name).to_owned(), show(get(&test.result)), show(get(without))]))
}

/// `2 start-up outliers (lines 23, 25)`.
fn outliers_in_words(start_up: &StartUp) -> String {
    let lines: Vec<String> = start_up.marked.iter().map(|m| m.line.to_string()).collect();
    let (s, line) = if lines.len() == 1 { ("", "line") } else { ("s", "lines") };
    format!("{} start-up outlier{s} ({line} {})", lines.len(), lines.join(", "))
}

/// The expanded uncertainties of the figures: of the measurement and from few runs.
fn uncertainties(p: &Positioning, u: &Uncertainties, unit: &str) -> Table {
    let rows = u.figures().map(|OfFigure { key, name, expanded: e, measurement }| {
        let measurement = measurement.map_or_else(|| NOT_STATED.to_owned(), |u| format!("{u:.2}"));
        let figure = FIGURES.iter().find(|(k, ..)| *k == key).and_then(|(.., get)| get(p));
        let interval = figure.map_or_else(String::new, |figure| {
            let [low, high] = e.interval(figure);
            format!("{low:.2} to {high:.2}")
        });
        [name.to_owned(), measurement, format!("{:.2}", e.sampling), interval]
    });
    let heads = ["of the measurement", "from few runs", "95 % interval"].map(|h| format!(">{h} / {unit}"));
    Table::new(["expanded uncertainty, k = 2", &heads[0], &heads[1], &heads[2]]).rows(rows)
}

fn print_uncertainties(p: &Positioning, u: &Uncertainties, unit: &str) {
    say!();
    uncertainties(p, u, unit).print();
    if u.contributions.is_empty() {
        say!("nothing stated about instrument, temperature and drift (--help names the options)");
    }
}

fn report(
    args: &Args,
    title: &str,
    judged: &Judged,
    after: &Evaluated,
    before: Option<(&Evaluated, &[Assessed])>,
) -> Result<String> {
    let (_, unit, target_unit) = after.units();
    let size = |p: &Positioning| {
        let ends = p.targets.first().zip(p.targets.last());
        let [low, high] = ends.map_or([0.0; 2], |(a, b)| [a.target, b.target]);
        let short = if p.cycles < 5 { "; ISO 230-2 asks for 5 runs" } else { "" };
        let (targets, runs) = (counted(p.targets.len(), "target"), counted(p.cycles, "run"));
        format!("{targets} from {low} to {high} {target_unit}, {runs}{short}")
    };
    let mut facts = vec![("test", size(&after.result))];
    facts.extend(before.map(|(b, _)| ("test before", size(&b.result))));
    let mut page = args.output.page([&args.data, &args.before], (title, STANDARD), judged, &facts);
    page::figures(unit, &judged.figures[..BOTH], before.map(|(_, old)| &old[..BOTH])).put(&mut page);
    let caption = "Deviation = actual - target. Solid: mean of each direction, band: ± 2 s, dots: readings, dashed: mean of both \
                   directions. B and R are marked where they occur, M, E and A are the ranges at the right.";
    let own = drawing::scale([Some(&after.result)], [&after.readings[..]]);
    let plot = |test: &Evaluated, scale, height| drawing::single(&test.shown(), scale, height);
    if let Some((before, _)) = before {
        let scale = common_scale([before, after]);
        let [upper, lower] = [before, after].map(|test| plot(test, scale, drawing::HALF_HEIGHT));
        page.plots(&[("Before", upper?), ("After, same scale", lower?)], caption);
        // where the test improved much, its own scale shows what is left
        if is_flat(own, scale) {
            page.sheet("After, own scale");
            page.picture(&plot(after, own, drawing::HEIGHT)?);
        }
    } else {
        page.plots(&[("Deviations", plot(after, own, drawing::HEIGHT)?)], caption);
    }
    start_up_section(&mut page, after, unit);
    page.heading("Each direction");
    page::figures(unit, &judged.figures[BOTH..], before.map(|(_, old)| &old[BOTH..])).put(&mut page);
    uncertainty_section(&mut page, &after.result, &after.uncertainties, unit);
    targets(&mut page, "Targets", &after.result, [unit, target_unit]);
    if let Some((before, _)) = before {
        targets(&mut page, "Targets before", &before.result, [unit, target_unit]);
    }
    Ok(page::finish(page, judged))
}

/// The scale that holds both tests.
fn common_scale(tests: [&Evaluated; 2]) -> [f64; 2] {
    drawing::scale(tests.map(|t| Some(&t.result)), tests.map(|t| &t.readings[..]))
}

/// Start-up outliers with the figures with and without them.
fn start_up_section(page: &mut Page, test: &Evaluated, unit: &str) {
    let Some(start_up) = &test.start_up else { return };
    page.heading("Start-up outliers");
    let list =
        start_up.marked.iter().map(|m| format!("Line {}: {}.", m.line, words(m, test.kind))).joined(" ");
    page.note(list);
    if let Some(without) = &start_up.without {
        with_and_without(test, without, unit).put(page);
    }
    page.note("The results of this report hold all readings. Repeat the test after a warm-up.");
}

fn uncertainty_section(page: &mut Page, p: &Positioning, u: &Uncertainties, unit: &str) {
    page.heading("Uncertainty");
    if !u.contributions.is_empty() {
        let rows = u.contributions.iter().map(|c| [c.name.to_owned(), format!("{:.2}", c.std)]);
        Table::new(["contribution", &format!(">standard uncertainty / {unit}")]).rows(rows).put(page);
    }
    uncertainties(p, u, unit).put(page);
    page.note(
        "Measurement: instrument, alignment, temperature and drift, as far as they were stated. Few runs: what the scatter \
         of the readings does to means and standard deviations of so few runs. Largest values and ranges of noisy means lie above \
         those of endlessly many runs: the 95 % interval is not symmetric about the figure.",
    );
}

fn targets(page: &mut Page, heading: &str, p: &Positioning, [unit, target_unit]: [&str; 2]) {
    page.heading(format_args!("{heading}, deviations in {unit}"));
    let rows = p.targets.iter().map(|t| {
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
    });
    let heads = [">mean forward", ">s", ">mean backward", ">s", ">mean of both", ">B", ">R"];
    Table::new([format!(">target / {target_unit}")].into_iter().chain(heads.map(str::to_owned)))
        .rows(rows)
        .put(page);
}

/// Two tests for `volcomp verify`.
pub(super) fn compare(files: [&Path; 2], options: CompareOptions) -> Result<Compared> {
    let read = |path: &Path| read(path, TestFormat::Auto, None, &UncertaintyArgs::default());
    let [mut before, mut after] = [read(files[0])?, read(files[1])?];
    let conditions = Conditions { device: options.u_device, ..Conditions::default() };
    for test in [&mut before, &mut after] {
        test.uncertainties = Uncertainties::of(&test.result, &conditions, test.result.length());
    }
    if before.kind != after.kind {
        return Err(data!(files[1], "one of the two tests is linear, the other rotary"));
    }
    let scale = common_scale([&before, &after]);
    let plot = |test: &Evaluated, scale| drawing::single(&test.shown(), scale, drawing::HEIGHT);
    let own = drawing::scale([Some(&after.result)], [&after.readings[..]]);
    let plots = before_and_after([&before, &after], [scale, own], plot)?;
    let placed = |test: &Evaluated| test.readings.iter().map(|r| placed(0, r)).collect();
    Ok(Compared {
        test: "iso230-2",
        standard: STANDARD,
        keys: keys(),
        stated: after.stated.clone(),
        unit: after.units().1,
        figures: side_by_side([&before, &after].map(|test| assessed(&Acceptance::default(), test))),
        about: ["", ", about zero"],
        plots,
        caption: "Solid: mean of each direction, band: ± 2 s, dots: readings, dashed: mean of both directions.",
        readings: [placed(&before), placed(&after)],
        is_repeated: true,
        ..Compared::default()
    })
}

/// A reading at its target.
pub(super) fn placed(curve: u32, r: &PositioningReading) -> Placed {
    Placed::at_target(curve, r.target, r.travel, r.deviation)
}
