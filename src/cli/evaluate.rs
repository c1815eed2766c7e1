//! `volcomp evaluate`: the figures of ISO 230 from measured deviations.

use std::path::PathBuf;

use clap::{Parser, Subcommand, ValueEnum};
use serde_json::{Map, Value, json};

use super::positioning_data::{Cycles, TestColumns, TestFormat, no_rows, read_test};
use super::{EX_DATAERR, Failure, table};
use crate::core::axes::AxisKind;
use crate::core::units::{arcsec_from_rad, deg_from_rad, mm_from_um, rad_from_deg, um_from_mm};
use crate::evaluate::{
    Centring, CircularReading, Circularity, Diagonal, DiagonalTest, Positioning, PositioningReading,
};

/// Evaluate a test by ISO 230.
#[derive(Debug, Parser)]
pub(super) struct Args {
    #[command(subcommand)]
    test: Test,
}

#[derive(Debug, Subcommand)]
enum Test {
    /// Positioning of one axis: reversal, repeatability, systematic deviation, accuracy.
    Iso230_2(PositioningArgs),
    /// Circular test: circular deviation G and radial deviation F.
    Iso230_4(CircularArgs),
    /// Four body diagonals, each like a positioning test.
    Iso230_6(DiagonalArgs),
}

#[derive(Debug, Parser)]
struct PositioningArgs {
    /// CSV with cycle,direction,target_mm,deviation_um (rotary: target_deg,deviation_arcsec), or a .dat file; - is stdin.
    #[arg(long, value_name = "FILE")]
    data: PathBuf,
    /// How the file is written.
    #[arg(long, value_enum, default_value = "auto")]
    format: TestFormat,
    /// Only these cycles, such as 1-4 or 1,3,5.
    #[arg(long)]
    cycles: Option<Cycles>,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum CentringArg {
    /// Take the eccentricity out with the geometric least-squares circle.
    LeastSquares,
    /// Keep the instrument's own centre.
    None,
}

#[derive(Debug, Parser)]
struct CircularArgs {
    /// CSV with angle_deg,deviation_um,direction (1 counter-clockwise, -1 clockwise); - is stdin.
    #[arg(long, value_name = "FILE")]
    data: PathBuf,
    /// How the centre is found.
    #[arg(long, value_enum, default_value = "least-squares")]
    centring: CentringArg,
    /// Nominal radius; makes the centring exact for large eccentricities.
    #[arg(long, value_name = "MM")]
    radius_mm: Option<f64>,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Parser)]
struct DiagonalArgs {
    /// CSV with diagonal (ppp npp pnp ppn),cycle,direction,target_mm,deviation_um; - is stdin.
    #[arg(long, value_name = "FILE")]
    data: PathBuf,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    match &args.test {
        Test::Iso230_2(a) => positioning(a),
        Test::Iso230_4(a) => circular(a),
        Test::Iso230_6(a) => diagonals(a),
    }
}

fn bad_data(file: &std::path::Path, what: impl core::fmt::Display) -> Failure {
    Failure::new(EX_DATAERR, format_args!("error: {}: {what}", file.display()))
}

fn positioning(args: &PositioningArgs) -> Result<(), Failure> {
    let mut test = read_test(&args.data, args.format)?;
    let file = args.data.display().to_string();
    if let Some(cycles) = &args.cycles {
        cycles.select(&file, &mut test.readings)?;
    }
    // evaluated in the units of the report, so that messages name the targets in them too
    type Convert = fn(f64) -> f64;
    let (unit, to_target, to_value): (&str, Convert, Convert) = match test.kind {
        AxisKind::Linear => ("um", |v| v, um_from_mm),
        AxisKind::Rotary => ("arcsec", deg_from_rad, arcsec_from_rad),
    };
    let readings: Vec<PositioningReading> = test
        .readings
        .iter()
        .map(|r| PositioningReading {
            travel: r.travel,
            target: to_target(r.position),
            deviation: to_value(r.value),
        })
        .collect();
    let scale: Convert = |v| v;
    let result = Positioning::evaluate(&readings).map_err(|e| bad_data(&args.data, e))?;
    if result.cycles < 5 {
        eprintln!("note: {} cycles; ISO 230-2 asks for 5", result.cycles);
    }
    if args.json {
        say!("{:#}", Value::Object(figures(&result, unit, scale)));
        return Ok(());
    }
    say!("ISO 230-2 of {file}: {} targets, {} cycles", result.targets.len(), result.cycles);
    print_positioning(&result, unit, scale);
    Ok(())
}

/// The keys of contract section 6.
fn figures(p: &Positioning, unit: &str, scale: fn(f64) -> f64) -> Map<String, Value> {
    let mut map = Map::new();
    let mut put = |key: &str, value: Option<f64>| {
        map.insert(format!("{key}_{unit}"), json!(value.map(scale)));
    };
    let both = p.both.as_ref();
    put("b", both.map(|b| b.b));
    put("b_mean", both.map(|b| b.b_mean));
    put("r", both.map(|b| b.r));
    put("e", both.map(|b| b.e));
    put("m", both.map(|b| b.m));
    put("a", both.map(|b| b.a));
    for (name, direction) in [("fwd", p.forward), ("bwd", p.backward)] {
        put(&format!("e_{name}"), direction.map(|d| d.e));
        put(&format!("a_{name}"), direction.map(|d| d.a));
        put(&format!("r_{name}"), direction.map(|d| d.r));
    }
    map.insert("targets".to_owned(), json!(p.targets.len()));
    map.insert("cycles".to_owned(), json!(p.cycles));
    map
}

fn print_positioning(p: &Positioning, unit: &str, scale: fn(f64) -> f64) {
    let show = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), |v| format!("{:.2}", scale(v)));
    let row = |name: &str, values: [Option<f64>; 3]| {
        let [f, b, both] = values.map(show);
        say!("{name:<28}{f:>12}{b:>12}{both:>16}");
    };
    let (f, b, both) = (p.forward, p.backward, p.both);
    say!("{:<28}{:>12}{:>12}{:>16}", unit, "forward", "backward", "bidirectional");
    row("reversal B", [None, None, both.map(|x| x.b)]);
    row("mean reversal", [None, None, both.map(|x| x.b_mean)]);
    row("repeatability R", [f.map(|x| x.r), b.map(|x| x.r), both.map(|x| x.r)]);
    row("systematic deviation E", [f.map(|x| x.e), b.map(|x| x.e), both.map(|x| x.e)]);
    row("mean systematic deviation M", [None, None, both.map(|x| x.m)]);
    row("accuracy A", [f.map(|x| x.a), b.map(|x| x.a), both.map(|x| x.a)]);
}

fn circular(args: &CircularArgs) -> Result<(), Failure> {
    let mut table = table::open(&args.data)?;
    let (angle, deviation, direction) =
        (table.require("angle_deg")?, table.require("deviation_um")?, table.require("direction")?);
    only(&table, &["angle_deg", "deviation_um", "direction"])?;
    let mut readings = Vec::new();
    while table.advance()? {
        readings.push(CircularReading {
            angle: rad_from_deg(table.number(angle)?),
            deviation: mm_from_um(table.number(deviation)?),
            travel: table.travel(direction)?,
        });
    }
    if readings.is_empty() {
        return Err(no_rows(table.file()));
    }
    let centring = match args.centring {
        CentringArg::LeastSquares => Centring::LeastSquares { radius: args.radius_mm },
        CentringArg::None => Centring::None,
    };
    let c = Circularity::evaluate(&readings, centring).map_err(|e| bad_data(&args.data, e))?;
    let um = |v: Option<f64>| v.map(um_from_mm);
    if args.json {
        let report = json!({
            "g_fwd_um": um(c.g_forward), "g_bwd_um": um(c.g_backward), "g_bi_um": um(c.g_both),
            "fmax_um": um_from_mm(c.f_max), "fmin_um": um_from_mm(c.f_min),
            "centre_um": [um_from_mm(c.centre[0]), um_from_mm(c.centre[1])], "readings": readings.len(),
        });
        say!("{report:#}");
        return Ok(());
    }
    say!("ISO 230-4 of {}: {} readings", args.data.display(), readings.len());
    let show = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), |v| format!("{v:.2} um"));
    say!("{:<40}{:>14}", "circular deviation G, counter-clockwise", show(um(c.g_forward)));
    say!("{:<40}{:>14}", "circular deviation G, clockwise", show(um(c.g_backward)));
    say!("{:<40}{:>14}", "circular deviation G(b), both", show(um(c.g_both)));
    say!("{:<40}{:>14}", "radial deviation Fmax", show(Some(um_from_mm(c.f_max))));
    say!("{:<40}{:>14}", "radial deviation Fmin", show(Some(um_from_mm(c.f_min))));
    let [x, y] = c.centre.map(um_from_mm);
    say!("{:<40}{:>14}", "centre taken out", format!("{x:.1}, {y:.1} um"));
    Ok(())
}

/// Refuses columns that the test does not know.
fn only<R: std::io::BufRead>(table: &table::Table<R>, known: &[&str]) -> Result<(), Failure> {
    match table.columns().iter().position(|c| !known.contains(&c.as_str())) {
        Some(i) => Err(table.fail(i, format_args!("unknown column; columns are {}", known.join(", ")))),
        None => Ok(()),
    }
}

fn diagonals(args: &DiagonalArgs) -> Result<(), Failure> {
    let mut table = table::open(&args.data)?;
    let name = table.require("diagonal")?;
    let columns = TestColumns::find(&table, &["diagonal"])?;
    if columns.kind == AxisKind::Rotary {
        return Err(bad_data(&args.data, "a diagonal has target_mm and deviation_um, not angles"));
    }
    let mut readings = Vec::new();
    while table.advance()? {
        let word = table.word(name);
        let Some(diagonal) = Diagonal::parse(&word) else {
            let what = format_args!("'{word}' is no diagonal; write ppp, npp, pnp or ppn (signs of X Y Z)");
            return Err(table.fail(name, what));
        };
        let r = columns.reading(&table)?;
        let (target, deviation) = (r.position, r.value);
        readings.push((diagonal, PositioningReading { travel: r.travel, target, deviation }));
    }
    if readings.is_empty() {
        return Err(no_rows(table.file()));
    }
    let test = DiagonalTest::evaluate(&readings).map_err(|e| bad_data(&args.data, e))?;
    type Figure = (&'static str, fn(&Positioning) -> Option<f64>);
    let worst: [Figure; 6] = [
        ("b_um", |p| p.both.map(|b| b.b)),
        ("r_um", |p| p.both.map(|b| b.r)),
        ("e_um", |p| p.both.map(|b| b.e)),
        ("a_um", |p| p.both.map(|b| b.a)),
        ("e_fwd_um", |p| p.forward.map(|f| f.e)),
        ("e_bwd_um", |p| p.backward.map(|f| f.e)),
    ];
    if args.json {
        let mut report = Map::new();
        let mut each = Map::new();
        for (d, p) in &test.diagonals {
            each.insert(d.name().to_owned(), Value::Object(figures(p, "um", um_from_mm)));
        }
        report.insert("diagonals".to_owned(), Value::Object(each));
        let mut names = Map::new();
        for (key, figure) in worst {
            let found = test.worst(figure);
            report.insert(key.to_owned(), json!(found.map(|(_, v)| um_from_mm(v))));
            names.insert(key.to_owned(), json!(found.map(|(d, _)| d.name())));
        }
        report.insert("worst".to_owned(), Value::Object(names));
        say!("{:#}", Value::Object(report));
        return Ok(());
    }
    for (d, p) in &test.diagonals {
        say!("ISO 230-6, diagonal {}: {} targets, {} cycles", d.name(), p.targets.len(), p.cycles);
        print_positioning(p, "um", um_from_mm);
        say!();
    }
    for (key, figure) in worst {
        if let Some((d, v)) = test.worst(figure) {
            say!("worst {key:<10}{:>12.2}  on {}", um_from_mm(v), d.name());
        }
    }
    Ok(())
}
