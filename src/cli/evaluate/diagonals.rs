//! `evaluate iso230-6`: four body diagonals, each like a positioning test.

use super::page;
use super::picture::positioning::{self as drawing, Shown};
use super::positioning::{as_json, table as each_direction};
use super::uncertainty_args::UncertaintyArgs;
use super::{
    CompareOptions, Compared, Figures, Get, Output, before_and_after, changed, headed, show, side_by_side,
};
use crate::positioning_data::TestColumns;
use crate::prelude::*;
use crate::report::plot::{Area, Drawn, SHEET_WIDTH, Svg, TITLE, stacked_tests, words};
use volcomp_evaluate::diagonal::about_means;
use volcomp_evaluate::{
    Conditions, Diagonal, DiagonalTest, Placed, Positioning, PositioningReading, Uncertainties,
};

/// Four body diagonals by ISO 230-6, each like a positioning test
///
/// The diagonals are named by the signs with which X, Y and Z move: ppp npp pnp ppn, or nnn etc. from the other end.
#[derive(Debug, clap::Parser)]
pub(crate) struct Args {
    /// CSV with diagonal (ppp npp pnp ppn),cycle,direction,target_mm,deviation_um; - is stdin.
    #[arg(long, value_name = "FILE", required_unless_present = "file")]
    data: Option<PathBuf>,
    /// The same test at an earlier time, to compare with.
    #[arg(long, value_name = "FILE")]
    before: Option<PathBuf>,
    #[command(flatten)]
    uncertainty: UncertaintyArgs,
    #[command(flatten)]
    output: Output,
}

/// A test in um.
struct Evaluated {
    readings: Vec<(Diagonal, PositioningReading)>,
    result: DiagonalTest,
}

fn read(path: &Path) -> Result<Evaluated> {
    let mut table = table::open(path)?;
    let name = table.require("diagonal")?;
    let columns = TestColumns::find(&table, &["diagonal"])?;
    if columns.kind == AxisKind::Rotary {
        return Err(data!(path, "a diagonal has target_mm and deviation_um, not angles"));
    }
    let mut ends: BTreeMap<Diagonal, String> = BTreeMap::new();
    let mut lines = Vec::new();
    let readings = table.some_rows(|table| {
        let word = table.word(name);
        let Some(diagonal) = Diagonal::parse(&word) else {
            let what = format_args!("invalid diagonal '{word}'; write ppp, npp, pnp or ppn (signs of X Y Z)");
            return Err(table.fail(name, what));
        };
        let end = word.to_ascii_lowercase();
        let first = ends.entry(diagonal).or_insert_with(|| end.clone());
        if *first != end {
            let what = format_args!(
                "'{end}' is the diagonal '{first}' of the rows before from its other end; count targets, signs and \
                 directions from one end"
            );
            return Err(table.fail(name, what));
        }
        let r = columns.reading(table)?;
        let (target, deviation) = (r.position, um_from_mm(r.value));
        lines.push(table.line());
        Ok((diagonal, PositioningReading { travel: r.travel, target, deviation }))
    })?;
    let values = readings.iter().map(|(_, r)| r.deviation).zip(lines);
    check_size(&path.display().to_string(), "deviation_um", values, false)?;
    let result = DiagonalTest::evaluate(&readings).map_err(|e| data!(path, "{e}"))?;
    Ok(Evaluated { readings, result })
}

/// Key, term of the standard, and how a figure is taken from one diagonal.
const WORST: &Figures<Positioning> = &[
    ("b_um", "reversal error B", |p| p.both.map(|b| b.b)),
    ("r_um", "bidirectional repeatability R", |p| p.both.map(|b| b.r)),
    ("e_um", "bidirectional systematic positioning error E", |p| p.both.map(|b| b.e)),
    ("a_um", "bidirectional positioning accuracy A", |p| p.both.map(|b| b.a)),
    ("e_fwd_um", "systematic positioning error E, forward", |p| p.forward.map(|f| f.e)),
    ("e_bwd_um", "systematic positioning error E, backward", |p| p.backward.map(|f| f.e)),
];

/// Keys of the figures that may have a tolerance.
fn keys() -> Vec<String> {
    WORST.iter().map(|(key, ..)| (*key).to_owned()).collect()
}

/// The figures of the worst diagonals with tolerances and the uncertainty of the measurement along them.
fn assessed(acceptance: &Acceptance, test: &DiagonalTest, conditions: &Conditions) -> Vec<Assessed> {
    let figure = |(key, name, get): &(&str, &'static str, Get<Positioning>)| {
        let worst = test.worst(get);
        let of_worst = worst.and_then(|(diagonal, _)| {
            let (_, p) = test.diagonals.iter().find(|(d, _)| *d == diagonal)?;
            Uncertainties::of(p, conditions, p.length()).figure(key.trim_end_matches("_um"))
        });
        let expanded = of_worst.and_then(|of| of.measurement);
        let figure = acceptance.assess(key, name, worst.map(|(_, v)| v), expanded);
        Assessed { compared: of_worst.map(|of| of.expanded.total()), ..figure }
    };
    WORST.iter().map(figure).collect()
}

pub(super) fn run(args: &Args) -> Result<()> {
    let acceptance = Acceptance::load(&args.output.head, "iso230-6", &keys())?;
    let after = read(args.output.data(&args.data))?;
    let conditions = args.uncertainty.conditions(AxisKind::Linear)?;
    let judged = Judged { figures: assessed(&acceptance, &after.result, &conditions), acceptance };
    let before = args.before.as_deref().map(read).transpose()?;
    let old = before.as_ref().map(|b| assessed(&Acceptance::default(), &b.result, &conditions));
    let title = args.output.title("Body diagonals");
    let scale = scale(&after, before.as_ref());
    args.output.deliver(
        &judged,
        || whole(title, &after, before.as_ref(), scale),
        || report(args, title, &judged, &after, before.as_ref().zip(old.as_deref()), scale),
        || (object(&after.result), before.as_ref().map(|before| object(&before.result))),
        || print(&after.result, old.as_deref(), &judged.figures),
    )
}

fn print(after: &DiagonalTest, before: Option<&[Assessed]>, figures: &[Assessed]) {
    for (d, p) in &after.diagonals {
        let (targets, cycles) = (counted(p.targets.len(), "target"), counted(p.cycles, "cycle"));
        say!("ISO 230-6, diagonal {}: {targets}, {cycles}", d.name());
        each_direction(p, "um").print();
        say!();
    }
    let heads = ["worst of the four", ">um", "diagonal", ">before", ">change"].map(str::to_owned);
    let mut worst = Table::new(heads.into_iter().chain(Assessed::heads("um")));
    for (i, (f, (.., get))) in figures.iter().zip(WORST).enumerate() {
        let Some((d, _)) = after.worst(get) else { continue };
        let old = before.and_then(|b| b.get(i));
        let was = show(old.and_then(|b| b.value));
        let row = [f.name.to_owned(), show(f.value), d.name().to_owned(), was, changed(old, f)];
        worst.row(row.into_iter().chain(f.words()));
    }
    worst.print();
}

fn object(test: &DiagonalTest) -> Map<String, Value> {
    let each: Map<_, _> =
        test.diagonals.iter().map(|(d, p)| (d.name().to_owned(), as_json(p, "um").into())).collect();
    let mut report = Map::from_iter([("diagonals".to_owned(), Value::Object(each))]);
    let mut names = Map::new();
    for (key, _, figure) in WORST {
        let found = test.worst(figure);
        report.insert((*key).to_owned(), json!(found.map(|(_, v)| v)));
        names.insert((*key).to_owned(), json!(found.map(|(d, _)| d.name())));
    }
    report.insert("worst".to_owned(), Value::Object(names));
    report
}

fn of(test: &Evaluated, diagonal: Diagonal) -> Vec<PositioningReading> {
    test.readings.iter().filter(|(d, _)| *d == diagonal).map(|(_, r)| *r).collect()
}

/// One scale for all, so that the diagonals can be compared.
fn scale(after: &Evaluated, before: Option<&Evaluated>) -> [f64; 2] {
    let tests = || [Some(after), before].into_iter().flatten();
    let all: Vec<Vec<PositioningReading>> =
        tests().map(|t| t.readings.iter().map(|(_, r)| *r).collect()).collect();
    drawing::scale(
        tests().flat_map(|t| t.result.diagonals.iter().map(|(_, p)| Some(p))),
        all.iter().map(Vec::as_slice),
    )
}

const HEIGHT: u32 = 360;

/// The four diagonals of a test, two in a row.
fn four(test: &Evaluated, y: [f64; 2], area: &Area<'_>) -> Drawn {
    let (plots, below) = area.split_vertically(2 * HEIGHT);
    for (place, (diagonal, result)) in plots.split_evenly((2, 2)).iter().zip(&test.result.diagonals) {
        let readings = of(test, *diagonal);
        let both = result.both.map_or(String::new(), |b| format!(": E {:.2}, A {:.2} µm", b.e, b.a));
        let title = format!("{} ({}){both}", diagonal.name(), diagonal.signs());
        let shown = Shown { result, readings: &readings, unit: "µm", target_unit: "mm" };
        let (head, body) = place.split_vertically(TITLE);
        words(&head, &title, (74, 12), 16)?;
        drawing::draw_deviations(&body, &shown, y, 16)?;
    }
    test.result.diagonals.first().map_or(Ok(()), |(_, result)| drawing::draw_legend(&below, result))
}

/// The diagonals, before and after below each other.
fn whole(title: &str, after: &Evaluated, before: Option<&Evaluated>, y: [f64; 2]) -> Svg {
    stacked_tests(
        SHEET_WIDTH,
        title,
        &headed(before, after),
        |_| 2 * HEIGHT + drawing::LEGEND,
        |area, test| four(test, y, area),
    )
}

fn report(
    args: &Args,
    title: &str,
    judged: &Judged,
    after: &Evaluated,
    before: Option<(&Evaluated, &[Assessed])>,
    y: [f64; 2],
) -> Result<String> {
    let standard = "Positioning along the body diagonals, ISO 230-6:2002";
    let mut page = args.output.page([&args.data, &args.before], (title, standard), judged, &[]);
    page.heading("Worst of the four diagonals");
    page::figures("µm", &judged.figures, before.map(|(_, old)| old)).put(&mut page);
    let before = before.map(|(test, _)| test);
    page.heading("Each diagonal");
    each(&mut page, after, before);
    let caption = "Deviation = actual - target along the diagonal.";
    let name = if before.is_some() { "After, same scale" } else { "Deviations" };
    for (name, test) in [("Before", before), (name, Some(after))] {
        let Some(test) = test else { continue };
        page.sheet(name);
        page.figure(&plot(test, y)?, caption);
    }
    Ok(page::finish(page, judged))
}

fn plot(test: &Evaluated, y: [f64; 2]) -> Svg {
    whole("", test, None, y)
}

/// B, R, E and A of each diagonal, before and after.
fn each(page: &mut Page, after: &Evaluated, before: Option<&Evaluated>) {
    let mut heads = vec!["diagonal".to_owned()];
    let name = |(d, _): &(Diagonal, Positioning)| vec![format!("{} ({})", d.name(), d.signs())];
    let mut rows: Vec<Vec<String>> = after.result.diagonals.iter().map(name).collect();
    for (name, test) in [("before ", before), (if before.is_some() { "after " } else { "" }, Some(after))] {
        let Some(test) = test else { continue };
        for (key, _, get) in &WORST[..4] {
            heads.push(format!(">{} {name}/ µm", key[..1].to_ascii_uppercase()));
            for (row, (_, p)) in rows.iter_mut().zip(&test.result.diagonals) {
                row.push(show(get(p)));
            }
        }
    }
    Table::new(heads).rows(rows).put(page);
}

/// The test with each diagonal about its mean: the zero of the interferometer belongs to its set-up.
fn centred(path: &Path, test: &Evaluated) -> Result<Evaluated> {
    let readings = about_means(&test.readings);
    let result = DiagonalTest::evaluate(&readings).map_err(|e| data!(path, "{e}"))?;
    Ok(Evaluated { readings, result })
}

/// Two tests for `volcomp verify`.
pub(super) fn compare(files: [&Path; 2], options: CompareOptions) -> Result<Compared> {
    let read = |path: &Path| centred(path, &read(path)?);
    let [before, after] = [read(files[0])?, read(files[1])?];
    let scales = [scale(&after, Some(&before)), scale(&after, None)];
    let plots = before_and_after([&before, &after], scales, plot)?;
    let conditions = Conditions { device: options.u_device, ..Conditions::default() };
    let placed = |test: &Evaluated| -> Vec<Placed> {
        let curve =
            |d: Diagonal| test.result.diagonals.iter().position(|(other, _)| *other == d).unwrap_or(0);
        test.readings.iter().map(|(d, r)| super::positioning::placed(curve(*d) as u32, r)).collect()
    };
    Ok(Compared {
        test: "iso230-6",
        standard: "Positioning along the body diagonals, ISO 230-6:2002; figures of the worst of the four",
        keys: keys(),
        unit: "µm",
        figures: side_by_side(
            [&before, &after].map(|test| assessed(&Acceptance::default(), &test.result, &conditions)),
        ),
        about: [", each diagonal about its mean"; 2],
        plots,
        caption: "Deviation = actual - target along the diagonal.",
        readings: [placed(&before), placed(&after)],
        is_repeated: true,
        notes: vec![
            "Range and RMS are those of all four diagonals, each about its mean, and so they are drawn: the zero of each belongs to \
             the set-up."
                .to_owned(),
        ],
        ..Compared::default()
    })
}
