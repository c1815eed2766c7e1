//! `volcomp identify kalman`: the filter on node values, on a case or on a recording.

use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde_json::{Map, Value, json};

use super::case::{CaseArgs, print_json};
use crate::arg_parsers::linear_axis;
use crate::model_writer::{ModelWriter, Sources, axis_entry, default_chain, put};
use crate::table::{self, Table};
use crate::{EX_DATAERR, EX_USAGE, Failure};
use volcomp_config::ModelFile;
use volcomp_estimate::filter::COMPONENTS_MAX;
use volcomp_estimate::{
    Adaptation, MeasurementNoise, NodeFilter, NodeGrid, Observation, Process, Rules, Verdict,
};
use volcomp_model::curve::{ErrorFunction, Grid};
use volcomp_model::{ErrorSymbol, Sense};
use volcomp_units::axes::{AxisName, Travel};
use volcomp_units::{arcsec_from_rad, mm_from_um, rad_from_arcsec, um_from_mm};

/// Kalman filter on the node values of a grid of hexahedral cells.
///
/// Takes measurements of one error at many places (a tracker on the ram, a 5-DOF laser) and turns them into a map: a grid
/// in the model that adds to what the model says already. Between measurements the map may wander (--walk). Readings beyond
/// a 99.9 % gate are left out; --adaptive learns the noise of the instrument.
///
/// Table: t_s (optional), x_mm y_mm z_mm (or the columns of --axes), and one column such as eaz_arcsec or ezz_um, the
/// measured error (actual minus nominal).
///
///   volcomp identify kalman --data ram.csv --axes y,z,x --first 0,400,800 --second 0,300 --third 0,250 --sigma 2.5
///   --correlation-mm 500 --noise 0.8 --adaptive --into model.toml --out model-new.toml
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    case: CaseArgs,
    /// Measurements as a table.
    #[arg(long, value_name = "FILE", conflicts_with = "input", required_unless_present_any = ["input", "file"])]
    data: Option<PathBuf>,
    /// The three linear axes of the grid.
    #[arg(long, value_delimiter = ',', default_value = "x,y,z", value_parser = linear_axis)]
    axes: Vec<AxisName>,
    /// Nodes along the first axis, mm.
    #[arg(
        long,
        value_delimiter = ',',
        value_name = "MM",
        required_unless_present_any = ["input", "file"],
        allow_negative_numbers = true
    )]
    first: Vec<f64>,
    /// Nodes along the second axis, mm.
    #[arg(
        long,
        value_delimiter = ',',
        value_name = "MM",
        required_unless_present_any = ["input", "file"],
        allow_negative_numbers = true
    )]
    second: Vec<f64>,
    /// Nodes along the third axis, mm.
    #[arg(
        long,
        value_delimiter = ',',
        value_name = "MM",
        required_unless_present_any = ["input", "file"],
        allow_negative_numbers = true
    )]
    third: Vec<f64>,
    /// How far the model may be wrong (k = 1), um or arcsec.
    #[arg(long, value_name = "STD", required_unless_present_any = ["input", "file"])]
    sigma: Option<f64>,
    /// Distance over which nodes move together; 0: each on its own.
    #[arg(long, value_name = "MM", default_value_t = 0.0)]
    correlation_mm: f64,
    /// Noise of the instrument (k = 1), um or arcsec.
    #[arg(long, value_name = "STD", required_unless_present_any = ["input", "file"])]
    noise: Option<f64>,
    /// Learn the noise from the data, between a tenth and ten times --noise.
    #[arg(long)]
    adaptive: bool,
    /// Random walk of every node: standard deviation after one hour, um or arcsec; needs t_s.
    #[arg(long, value_name = "STD", default_value_t = 0.0)]
    walk_per_sqrt_h: f64,
    /// Largest change against the model, um or arcsec.
    #[arg(long, value_name = "SIZE")]
    limit: Option<f64>,
    #[command(flatten)]
    model: ModelWriter,
}

/// A case of the reference vectors: mm and rad, one step of the process before every observation.
#[derive(Debug, Deserialize)]
struct Case {
    grid: CaseGrid,
    x0: Vec<f64>,
    #[serde(rename = "P0")]
    p0: Prior,
    #[serde(rename = "Q_diag")]
    q_diag: f64,
    #[serde(rename = "R")]
    r: f64,
    adaptive: Option<CaseAdaptive>,
    observations: Vec<CaseObservation>,
    /// Optional: `nu^2/S` above which a reading is left out.
    gate: Option<f64>,
}

#[derive(Debug, Deserialize)]
struct CaseGrid {
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
}

#[derive(Debug, Deserialize)]
struct Prior {
    sigma: f64,
    #[serde(default)]
    correlation_length: f64,
}

#[derive(Debug, Deserialize)]
struct CaseAdaptive {
    d: f64,
    #[serde(rename = "R_min")]
    r_min: f64,
    #[serde(rename = "R_max")]
    r_max: f64,
}

#[derive(Debug, Deserialize)]
struct CaseObservation {
    position: [f64; 3],
    value: f64,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    match (args.case.file(), args.case.data(&args.data)) {
        (Some(file), _) => {
            file.writes_no_model(args.model.target().is_some())?;
            let result = of_case(&file.read()?).map_err(|e| file.bad(e))?;
            if args.case.json {
                print_json(&Value::Object(result));
            } else {
                report_case(&result);
            }
            Ok(())
        }
        (None, Some(path)) => of_table(args, path),
        (None, None) => Err(Failure::new(EX_USAGE, "error: neither --input nor --data is given")),
    }
}

fn only_first() -> [f64; COMPONENTS_MAX] {
    let mut weights = [0.0; COMPONENTS_MAX];
    weights[0] = 1.0;
    weights
}

fn of_case(case: &Case) -> Result<Map<String, Value>, String> {
    let CaseGrid { x, y, z } = &case.grid;
    let grid = NodeGrid::new(x.clone(), y.clone(), z.clone()).map_err(|e| e.to_string())?;
    let adaptation = case.adaptive.as_ref().map(|a| Adaptation { share: a.d, low: a.r_min, high: a.r_max });
    let mut noise = MeasurementNoise::new(case.r, adaptation).map_err(|e| e.to_string())?;
    if !(case.q_diag.is_finite() && case.q_diag >= 0.0) {
        return Err(format!("Q_diag {} is not a number from 0 up", case.q_diag));
    }
    let rules = Rules { gate: case.gate.unwrap_or(f64::INFINITY), cap_at_prior: false, ..Rules::default() };
    let process = Process::RandomWalk { variance_per_s: case.q_diag };
    let sigma = [case.p0.sigma];
    let mut filter = NodeFilter::new(&grid, &case.x0, &sigma, case.p0.correlation_length, process, rules)
        .map_err(|e| e.to_string())?;
    let mut sequence = Vec::with_capacity(case.observations.len());
    let (mut ratios, mut rejected) = (0.0, 0);
    for o in &case.observations {
        filter.predict(1.0);
        let seen = Observation {
            place: grid.place(o.position),
            weights: only_first(),
            value: o.value,
            nuisance: None,
        };
        let update = filter.update(&seen, &mut noise);
        match update.verdict {
            Verdict::Accepted => ratios += update.ratio(),
            _ => rejected += 1,
        }
        sequence.push(update.measurement_variance);
    }
    let mut map = Map::new();
    map.insert("state".into(), json!(filter.state()));
    map.insert("variance".into(), json!(filter.variances().collect::<Vec<_>>()));
    if case.adaptive.is_some() {
        map.insert("R_sequence".into(), json!(sequence));
    }
    map.insert("mean_ratio".into(), json!(ratios / (case.observations.len() - rejected) as f64));
    map.insert("rejected".into(), json!(rejected));
    Ok(map)
}

fn report_case(map: &Map<String, Value>) {
    let list = |key: &str| map.get(key).and_then(Value::as_array).cloned().unwrap_or_default();
    say!("node          value           std");
    for (i, (x, v)) in list("state").iter().zip(&list("variance")).enumerate() {
        let (x, v) = (x.as_f64().unwrap_or(f64::NAN), v.as_f64().unwrap_or(f64::NAN));
        say!("{i:>4}{x:>15.6e}{:>14.6e}", v.sqrt());
    }
    if let Some(r) = list("R_sequence").last().and_then(Value::as_f64) {
        say!("measurement std at the end {:.6e}", r.sqrt());
    }
    say!(
        "nu^2/S in the mean {:.3}, rejected {}",
        map["mean_ratio"].as_f64().unwrap_or(f64::NAN),
        map["rejected"]
    );
}

/// One error motion in the units of its column.
struct Unit {
    name: &'static str,
    to_inner: fn(f64) -> f64,
    to_outer: fn(f64) -> f64,
}

impl Unit {
    fn of(symbol: ErrorSymbol) -> Self {
        if symbol.is_angle() {
            Self { name: "arcsec", to_inner: rad_from_arcsec, to_outer: arcsec_from_rad }
        } else {
            Self { name: "um", to_inner: mm_from_um, to_outer: um_from_mm }
        }
    }
}

/// Where a table keeps what.
struct Columns {
    time: Option<usize>,
    positions: [usize; 3],
    value: usize,
    symbol: ErrorSymbol,
}

impl Columns {
    fn find<R: std::io::BufRead>(table: &Table<R>, axes: &[AxisName; 3]) -> Result<Self, Failure> {
        let time = table.find("t_s");
        let mut positions = [0; 3];
        for (place, axis) in positions.iter_mut().zip(axes) {
            *place = table.require(&format!("{}_mm", axis.lower()))?;
        }
        let mut found = None;
        for (i, column) in table.columns().iter().enumerate() {
            if Some(i) == time || positions.contains(&i) {
                continue;
            }
            let (name, unit) = column.rsplit_once('_').unwrap_or((column, ""));
            match ErrorSymbol::parse(name).filter(|s| !s.is_constant() && Unit::of(*s).name == unit) {
                Some(symbol) if found.is_none() => found = Some((i, symbol)),
                Some(_) => return Err(table.fail(i, "a second error; filter one error at a time")),
                None => {
                    return Err(table.fail(i, "unknown column; columns are t_s, the axes in mm, and one error such as eaz_arcsec or ezz_um"));
                }
            }
        }
        let Some((value, symbol)) = found else {
            return Err(Failure::new(
                EX_DATAERR,
                format_args!(
                    "error: {}: no column with an error, such as eaz_arcsec or ezz_um",
                    table.file()
                ),
            ));
        };
        Ok(Self { time, positions, value, symbol })
    }
}

/// What the filter made of a table.
struct Outcome {
    readings: usize,
    rejected: usize,
    alarm: bool,
    mean_ratio: f64,
    before: f64,
    after: f64,
    outside: usize,
}

fn of_table(args: &Args, path: &Path) -> Result<(), Failure> {
    let axes: [AxisName; 3] = args.axes.as_slice().try_into().map_err(|_| {
        Failure::new(EX_USAGE, format_args!("error: --axes names {} axes; a grid has three", args.axes.len()))
    })?;
    if axes[0] == axes[1] || axes[0] == axes[2] || axes[1] == axes[2] {
        return Err(Failure::new(EX_USAGE, "error: --axes names an axis twice"));
    }
    let grid = NodeGrid::new(args.first.clone(), args.second.clone(), args.third.clone())
        .map_err(|e| Failure::new(EX_USAGE, format_args!("error: {e}")))?;
    let mut table = table::open(path)?;
    let columns = Columns::find(&table, &axes)?;
    let (symbol, unit) = (columns.symbol, Unit::of(columns.symbol));
    if args.walk_per_sqrt_h > 0.0 && columns.time.is_none() {
        return Err(Failure::new(
            EX_DATAERR,
            format_args!("error: {}: --walk-per-sqrt-h needs the column t_s", table.file()),
        ));
    }
    let mut model = args.model.base(|| default_chain(axes))?;
    let before = offline(&model, symbol)?;
    let (sigma, std) = (args.sigma.unwrap_or(0.0), args.noise.unwrap_or(0.0));
    let variance = (unit.to_inner)(std).powi(2);
    let adaptation =
        args.adaptive.then_some(Adaptation { share: 0.02, low: 0.01 * variance, high: 100.0 * variance });
    let mut noise = MeasurementNoise::new(variance, adaptation)
        .map_err(|e| Failure::new(EX_USAGE, format_args!("error: --noise: {e}")))?;
    let rules =
        Rules { limit: args.limit.map_or(f64::INFINITY, |l| (unit.to_inner)(l.abs())), ..Rules::default() };
    let walk = (unit.to_inner)(args.walk_per_sqrt_h).powi(2) / 3600.0;
    let mut filter = NodeFilter::new(
        &grid,
        &vec![0.0; grid.nodes()],
        &[(unit.to_inner)(sigma)],
        args.correlation_mm,
        Process::RandomWalk { variance_per_s: walk },
        rules,
    )
    .map_err(|e| Failure::new(EX_USAGE, format_args!("error: {e}")))?;
    let offline_at = |at: [f64; 3]| value_at(&before, symbol, &axes, at);
    let outcome = filter_table(&mut table, &columns, &unit, &grid, (&mut filter, &mut noise), offline_at)?;
    let function = with_grid(before, &axes, &grid, &filter)
        .map_err(|e| Failure::new(EX_DATAERR, format_args!("error: {symbol}: {e}")))?;
    if args.case.json {
        print_json(&json_of(symbol, &unit, &grid, &filter, &noise, &outcome));
    } else if !args.model.takes_stdout() {
        report(symbol, &unit, &grid, &filter, &noise, &outcome);
    }
    if args.model.target().is_some() {
        let sources = Sources::of(&[path.to_owned()]);
        put(&mut model, symbol, function, sources.provenance());
        for name in axes.into_iter().chain([symbol.axis()]) {
            axis_entry(&mut model.spec, name);
        }
        let mut comment = vec![format!("written by volcomp identify kalman {}", env!("CARGO_PKG_VERSION"))];
        comment.extend(sources.comments());
        args.model.write(&model, &comment, &path.display().to_string())?;
    }
    Ok(())
}

/// What the model says about the error already.
fn offline(model: &ModelFile, symbol: ErrorSymbol) -> Result<ErrorFunction, Failure> {
    let axis = model.spec.axis(symbol.axis());
    if axis.sense == Sense::Carriage {
        return Err(Failure::new(
            EX_DATAERR,
            format_args!(
                "error: {symbol}: axis {} of the model is in the carriage sense; the measurements are relative: convert the model first",
                axis.name
            ),
        ));
    }
    Ok(model
        .spec
        .errors
        .iter()
        .find(|(s, _)| *s == symbol)
        .map_or_else(ErrorFunction::default, |(_, f)| f.clone()))
}

/// The offline error at a place; axes that the table does not have stand at 0.
fn value_at(function: &ErrorFunction, symbol: ErrorSymbol, axes: &[AxisName; 3], at: [f64; 3]) -> f64 {
    let coordinate = |name: AxisName| axes.iter().position(|a| *a == name).map_or(0.0, |i| at[i]);
    let grids = function.grids.iter().map(|g| {
        let own: Vec<f64> = g.axes().map(coordinate).collect();
        g.value(&own).0
    });
    function.value(coordinate(symbol.axis()), Travel::Forward) + grids.sum::<f64>()
}

fn filter_table<R: std::io::BufRead>(
    table: &mut Table<R>,
    columns: &Columns,
    unit: &Unit,
    grid: &NodeGrid,
    (filter, noise): (&mut NodeFilter, &mut MeasurementNoise),
    offline_at: impl Fn([f64; 3]) -> f64,
) -> Result<Outcome, Failure> {
    let mut last: Option<f64> = None;
    let mut ratios = 0.0;
    let mut seen: Vec<([f64; 3], f64)> = Vec::new();
    let mut outcome = Outcome {
        readings: 0,
        rejected: 0,
        alarm: false,
        mean_ratio: 0.0,
        before: 0.0,
        after: 0.0,
        outside: 0,
    };
    while table.advance()? {
        let mut at = [0.0; 3];
        for (at, column) in at.iter_mut().zip(columns.positions) {
            *at = table.number(column)?;
        }
        let value = (unit.to_inner)(table.number(columns.value)?) - offline_at(at);
        if let Some(column) = columns.time {
            let now = table.number(column)?;
            let passed = last.map_or(0.0, |last| now - last);
            if passed < 0.0 {
                return Err(table
                    .fail(column, format_args!("{now} s is before the row above; sort the rows by time")));
            }
            filter.predict(passed);
            last = Some(now);
        }
        let place = grid.place(at);
        outcome.outside += usize::from(place.outside);
        let update =
            filter.update(&Observation { place, weights: only_first(), value, nuisance: None }, noise);
        outcome.readings += 1;
        outcome.alarm |= filter.alarm();
        if update.verdict == Verdict::Accepted {
            // one reading that is far off says nothing about the noise of the others
            ratios += update.ratio();
            outcome.before += value * value;
            seen.push((at, value));
        } else {
            outcome.rejected += 1;
        }
    }
    if seen.is_empty() {
        return Err(Failure::new(
            EX_DATAERR,
            format_args!(
                "error: {}: no reading was accepted; check --sigma and --noise, and the units",
                table.file()
            ),
        ));
    }
    let n = seen.len() as f64;
    let squares = |(at, value): &([f64; 3], f64)| (value - filter.value(0, &grid.place(*at))).powi(2);
    outcome.after = (seen.iter().map(squares).sum::<f64>() / n).sqrt();
    outcome.before = (outcome.before / n).sqrt();
    outcome.mean_ratio = ratios / n;
    Ok(outcome)
}

/// The function with the map as one more grid, or in place of a grid over the same nodes.
fn with_grid(
    mut function: ErrorFunction,
    axes: &[AxisName; 3],
    grid: &NodeGrid,
    filter: &NodeFilter,
) -> Result<ErrorFunction, volcomp_model::curve::CurveError> {
    // the grid of the model has its last axis fastest, the filter its first
    let edges = |i: usize| (axes[i], grid.positions(i).to_vec());
    let mut values: Vec<f64> = filter.map().collect();
    let same = |g: &Grid| {
        g.axes().eq([axes[2], axes[1], axes[0]]) && (0..3).all(|i| g.positions(i) == grid.positions(2 - i))
    };
    if let Some(at) = function.grids.iter().position(same) {
        let old = function.grids.remove(at);
        values.iter_mut().zip(old.values()).for_each(|(new, old)| *new += old);
    }
    function.grids.push(Grid::new(vec![edges(2), edges(1), edges(0)], values)?);
    let variances: f64 = filter.variances().sum();
    function.std = Some((variances / filter.state().len() as f64).sqrt());
    Ok(function)
}

fn json_of(
    symbol: ErrorSymbol,
    unit: &Unit,
    grid: &NodeGrid,
    filter: &NodeFilter,
    noise: &MeasurementNoise,
    outcome: &Outcome,
) -> Value {
    let u = unit.name;
    let nodes: Vec<[f64; 3]> = (0..grid.nodes()).map(|i| grid.node(i)).collect();
    let map: Vec<f64> = filter.map().map(unit.to_outer).collect();
    let std: Vec<f64> = filter.variances().map(|v| (unit.to_outer)(v.sqrt())).collect();
    let mut out = Map::new();
    out.insert("error".into(), json!(symbol.to_string().to_lowercase()));
    out.insert("nodes_mm".into(), json!(nodes));
    out.insert(format!("change_{u}"), json!(map));
    out.insert(format!("std_{u}"), json!(std));
    out.insert(format!("noise_{u}"), json!((unit.to_outer)(noise.variance().sqrt())));
    out.insert(format!("rms_before_{u}"), json!((unit.to_outer)(outcome.before)));
    out.insert(format!("rms_after_{u}"), json!((unit.to_outer)(outcome.after)));
    out.insert("mean_ratio".into(), json!(outcome.mean_ratio));
    out.insert("readings".into(), json!(outcome.readings));
    out.insert("rejected".into(), json!(outcome.rejected));
    out.insert("outside".into(), json!(outcome.outside));
    out.insert("alarm".into(), json!(outcome.alarm));
    Value::Object(out)
}

fn report(
    symbol: ErrorSymbol,
    unit: &Unit,
    grid: &NodeGrid,
    filter: &NodeFilter,
    noise: &MeasurementNoise,
    outcome: &Outcome,
) {
    let out = unit.to_outer;
    say!("{symbol}: change of the map, {} (k = 1)", unit.name);
    say!("{:>10}{:>10}{:>10}{:>12}{:>10}", "first", "second", "third", "change", "std");
    for (i, (value, variance)) in filter.map().zip(filter.variances()).enumerate() {
        let [a, b, c] = grid.node(i);
        say!("{a:>10.1}{b:>10.1}{c:>10.1}{:>12.3}{:>10.3}", out(value), out(variance.sqrt()));
    }
    say!(
        "{} readings, {} rejected; rms {:.3} before, {:.3} after; noise {:.3} {}; nu^2/S {:.2} in the mean",
        outcome.readings,
        outcome.rejected,
        out(outcome.before),
        out(outcome.after),
        out(noise.variance().sqrt()),
        unit.name,
        outcome.mean_ratio
    );
    if outcome.alarm {
        note!(
            "warning: five readings in a row were rejected: the instrument or --sigma and --noise are wrong"
        );
    }
    if outcome.outside > 0 {
        note!("note: {} readings lie beyond the grid and count at its edge", outcome.outside);
    }
    // 1.5: beyond it the stated noise explains too little, whatever the number of readings
    if outcome.mean_ratio > 1.5 {
        note!(
            "note: readings scatter more than --noise and --sigma say (nu^2/S should be about 1); --adaptive learns the noise"
        );
    }
}
