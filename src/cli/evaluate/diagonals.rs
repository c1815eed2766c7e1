//! `evaluate iso230-6`: four body diagonals, each like a positioning test.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use super::page::{self, Origin};
use super::picture::positioning::{self as drawing, Shown};
use super::positioning::{as_json, print};
use super::positioning::{length, stated};
use super::uncertainty_args::UncertaintyArgs;
use super::{
    CompareOptions, Compared, Figure, Output, bad_data, change, drawn, percent, put_before, show,
    side_by_side,
};
use crate::acceptance::verdicts::{self, Assessed};
use crate::acceptance::{Acceptance, Stated};
use crate::numerals::counted;
use crate::positioning_data::{TestColumns, no_rows};
use crate::report::page::Cell;
use crate::report::plot::{Drawn, SHEET_WIDTH, Svg, svg_of, words};
use crate::{Failure, table};
use volcomp_evaluate::{
    Conditions, Diagonal, DiagonalTest, Placed, Positioning, PositioningReading, Uncertainties,
};
use volcomp_units::axes::AxisKind;
use volcomp_units::um_from_mm;

/// Four body diagonals by ISO 230-6, each like a positioning test
///
/// The diagonals are named by the signs with which X, Y and Z move: ppp npp pnp ppn.
#[derive(Debug, clap::Parser)]
pub(super) struct Args {
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

fn read(path: &Path) -> Result<Evaluated, Failure> {
    let mut table = table::open(path)?;
    let name = table.require("diagonal")?;
    let columns = TestColumns::find(&table, &["diagonal"])?;
    if columns.kind == AxisKind::Rotary {
        return Err(bad_data(path, "a diagonal has target_mm and deviation_um, not angles"));
    }
    let mut readings = Vec::new();
    while table.advance()? {
        let word = table.word(name);
        let Some(diagonal) = Diagonal::parse(&word) else {
            let what = format_args!("invalid diagonal '{word}'; write ppp, npp, pnp or ppn (signs of X Y Z)");
            return Err(table.fail(name, what));
        };
        let r = columns.reading(&table)?;
        let (target, deviation) = (r.position, um_from_mm(r.value));
        readings.push((diagonal, PositioningReading { travel: r.travel, target, deviation }));
    }
    if readings.is_empty() {
        return Err(no_rows(table.file()));
    }
    let result = DiagonalTest::evaluate(&readings).map_err(|e| bad_data(path, e))?;
    Ok(Evaluated { readings, result })
}

type Get = fn(&Positioning) -> Option<f64>;
/// Key, term of the standard, and how a figure is taken from one diagonal.
const WORST: [(&str, &str, Get); 6] = [
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

fn figures(test: &DiagonalTest) -> Vec<Figure> {
    WORST
        .iter()
        .map(|(key, name, get)| Figure { key, name, value: test.worst(get).map(|(_, v)| v) })
        .collect()
}

/// The figures of the worst diagonals with tolerances and the uncertainty of the measurement along them.
fn assessed(acceptance: &Acceptance, test: &DiagonalTest, conditions: &Conditions) -> Vec<Assessed> {
    WORST
        .iter()
        .map(|(key, name, get)| {
            let worst = test.worst(get);
            let expanded = worst.and_then(|(diagonal, _)| {
                let (_, p) = test.diagonals.iter().find(|(d, _)| *d == diagonal)?;
                let u = stated(&Uncertainties::of(p, conditions, length(p)));
                u.iter().find(|(k, _)| format!("{k}_um") == **key).map(|(_, u)| *u)
            });
            acceptance.assess(key, name, worst.map(|(_, v)| v), expanded)
        })
        .collect()
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let acceptance = Acceptance::load(&args.output.head, "iso230-6", &keys())?;
    let after = read(args.output.data(&args.data))?;
    let conditions = args.uncertainty.conditions(AxisKind::Linear)?;
    let assessed = assessed(&acceptance, &after.result, &conditions);
    let before = args.before.as_deref().map(read).transpose()?;
    let title = args.output.title.as_deref().unwrap_or("Body diagonals");
    let scale = scale(&after, before.as_ref());
    args.output.write(
        || whole(title, &after, before.as_ref(), scale),
        || report(args, title, (&acceptance, &assessed), &after, before.as_ref(), scale),
    )?;
    if args.output.json {
        let mut report = object(&after.result);
        verdicts::put(&mut report, &assessed);
        if let Some(before) = &before {
            put_before(&mut report, object(&before.result));
        }
        say!("{:#}", Value::Object(report));
        return Ok(());
    }
    let stdout_taken =
        [&args.output.svg, &args.output.report].into_iter().flatten().any(|p| p.as_os_str() == "-");
    if !stdout_taken {
        print_all(&after.result, before.as_ref().map(|b| &b.result));
        verdicts::print(&assessed, "um");
    }
    Ok(())
}

fn print_all(after: &DiagonalTest, before: Option<&DiagonalTest>) {
    for (d, p) in &after.diagonals {
        let (targets, cycles) = (counted(p.targets.len(), "target"), counted(p.cycles, "cycle"));
        say!("ISO 230-6, diagonal {}: {targets}, {cycles}", d.name());
        print(p, "um", |v| v);
        say!();
    }
    for (key, _, figure) in WORST {
        let Some((d, v)) = after.worst(figure) else { continue };
        let old = before.and_then(|b| b.worst(figure)).map(|(_, v)| v);
        let change =
            old.map_or(String::new(), |o| format!(", before {o:.2} ({})", percent(change(Some(o), Some(v)))));
        say!("worst {key:<10}{v:>12.2}  on {}{change}", d.name());
    }
}

fn object(test: &DiagonalTest) -> Map<String, Value> {
    let mut report = Map::new();
    let mut each = Map::new();
    for (d, p) in &test.diagonals {
        each.insert(d.name().to_owned(), Value::Object(as_json(p, "um", |v| v)));
    }
    report.insert("diagonals".to_owned(), Value::Object(each));
    let mut names = Map::new();
    for (key, _, figure) in WORST {
        let found = test.worst(figure);
        report.insert(key.to_owned(), json!(found.map(|(_, v)| v)));
        names.insert(key.to_owned(), json!(found.map(|(d, _)| d.name())));
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
const TITLE: u32 = 34;

/// The four diagonals of a test, two in a row.
fn four(test: &Evaluated, y: [f64; 2], area: &crate::report::plot::Area<'_>) -> Drawn {
    for (place, (diagonal, result)) in area.split_evenly((2, 2)).iter().zip(&test.result.diagonals) {
        let readings = of(test, *diagonal);
        let both = result.both.map_or(String::new(), |b| format!(": E {:.2}, A {:.2} µm", b.e, b.a));
        let title = format!("{} ({}){both}", diagonal.name(), signs(*diagonal));
        let shown = Shown { title: "", result, readings: &readings, unit: "µm", target_unit: "mm" };
        let (head, body) = place.split_vertically(TITLE);
        words(&head, &title, (74, 12), 16)?;
        drawing::draw_deviations(&body, &shown, y, 16)?;
    }
    Ok(())
}

/// The signs of X, Y, Z.
fn signs(diagonal: Diagonal) -> String {
    let sign = |(c, axis): (char, char)| format!("{}{axis}", if c == 'p' { '+' } else { '-' });
    diagonal.name().chars().zip(['X', 'Y', 'Z']).map(sign).collect::<Vec<_>>().join(" ")
}

fn whole(title: &str, after: &Evaluated, before: Option<&Evaluated>, y: [f64; 2]) -> Svg {
    let parts: Vec<(&str, &Evaluated)> = match before {
        Some(before) => vec![("before", before), ("after, same scale", after)],
        None => vec![("", after)],
    };
    svg_of((SHEET_WIDTH, TITLE + (TITLE + 2 * HEIGHT) * parts.len() as u32), |area| {
        let (head, mut rest) = area.split_vertically(TITLE);
        words(&head, title, (14, 10), 20)?;
        for (name, test) in parts {
            let (here, below) = rest.split_vertically(TITLE + 2 * HEIGHT);
            let (head, body) = here.split_vertically(TITLE);
            words(&head, name, (14, 10), 18)?;
            four(test, y, &body)?;
            rest = below;
        }
        Ok(())
    })
}

fn report(
    args: &Args,
    title: &str,
    (acceptance, assessed): (&Acceptance, &[Assessed]),
    after: &Evaluated,
    before: Option<&Evaluated>,
    y: [f64; 2],
) -> Result<String, Box<dyn std::error::Error>> {
    let mut origins = vec![Origin::of("data", args.output.data(&args.data))];
    origins.extend(args.before.as_deref().map(|p| Origin::of("before", p)));
    let standard = "Positioning along the body diagonals, ISO 230-6:2002";
    let mut page = page::start(title, standard, acceptance, assessed, &origins, &[]);
    page.heading("Worst of the four diagonals");
    page::figures(&mut page, "µm", assessed, before.map(|b| figures(&b.result)).as_deref());
    page.heading("Each diagonal");
    each(&mut page, after, before);
    let caption = "Deviation = actual - target along the diagonal. Blue: forward, vermillion: backward; solid: mean, band: ± 2 s, \
                   dots: readings, dashed: mean of both directions.";
    for (name, test) in
        [("Before", before), (if before.is_some() { "After, same scale" } else { "Deviations" }, Some(after))]
    {
        if let Some(test) = test {
            page.sheet(name);
            page.figure(&svg_of((SHEET_WIDTH, 2 * HEIGHT), |area| four(test, y, area))?, caption);
        }
    }
    Ok(page::finish(page, assessed))
}

fn each(page: &mut crate::report::Page, after: &Evaluated, before: Option<&Evaluated>) {
    let mut head = vec![Cell::head("diagonal")];
    let mut rows: Vec<Vec<Cell>> = after
        .result
        .diagonals
        .iter()
        .map(|(d, _)| vec![Cell::head(format!("{} ({})", d.name(), signs(*d)))])
        .collect();
    for (name, test) in [("before", before), (if before.is_some() { "after" } else { "" }, Some(after))] {
        let Some(test) = test else { continue };
        for (key, _, get) in &WORST[..4] {
            let letter = key.chars().take(1).map(|c| c.to_ascii_uppercase()).collect::<String>();
            head.push(Cell::number(format!("{letter} {name} / µm").replace("  ", " ")));
            for (row, (_, p)) in rows.iter_mut().zip(&test.result.diagonals) {
                row.push(Cell::number(show(get(p))));
            }
        }
    }
    page.table(&head, &rows);
}

/// Two tests for `volcomp verify`.
pub(super) fn compare(files: [&Path; 2], options: CompareOptions) -> Result<Compared, Failure> {
    let [before, after] = [read(files[0])?, read(files[1])?];
    let y = scale(&after, Some(&before));
    let plot =
        |test: &Evaluated| svg_of((SHEET_WIDTH, 2 * HEIGHT), |area| four(test, y, area)).map_err(drawn);
    let conditions = Conditions { device: options.u_device, ..Conditions::default() };
    let placed = |test: &Evaluated| -> Vec<Placed> {
        let curve =
            |d: Diagonal| test.result.diagonals.iter().position(|(other, _)| *other == d).unwrap_or(0);
        let own_mean = |d: Diagonal| {
            let own = of(test, d);
            own.iter().map(|r| r.deviation).sum::<f64>() / own.len().max(1) as f64
        };
        // the zero of the interferometer belongs to its set-up
        let zeros: Vec<f64> = test.result.diagonals.iter().map(|(d, _)| own_mean(*d)).collect();
        let about_zero = |d: Diagonal, r: &PositioningReading| {
            let k = curve(d);
            let deviation = r.deviation - zeros.get(k).copied().unwrap_or(0.0);
            super::positioning::placed(k as u32, &PositioningReading { deviation, ..*r })
        };
        test.readings.iter().map(|(d, r)| about_zero(*d, r)).collect()
    };
    Ok(Compared {
        test: "iso230-6",
        standard: "Positioning along the body diagonals, ISO 230-6:2002; figures of the worst of the four",
        keys: keys(),
        stated: Stated::default(),
        unit: "µm",
        figures: side_by_side(
            &figures(&before.result),
            assessed(&Acceptance::default(), &after.result, &conditions),
        ),
        plots: vec![("Before", plot(&before)?), ("After, same scale", plot(&after)?)],
        caption: "Blue: forward, vermillion: backward; solid: mean, band: ± 2 s, dots: readings.",
        readings: [placed(&before), placed(&after)],
        is_repeated: true,
        notes: vec![
            "Range and RMS are those of all four diagonals, each about its mean: the zero of each belongs to the set-up."
                .to_owned(),
        ],
    })
}
