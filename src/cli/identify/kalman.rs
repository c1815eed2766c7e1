//! `volcomp identify kalman`: the filter on node values, on a case or on a recording.

use crate::identify::prelude::*;
use volcomp_estimate::filter::{Run, Sample};
use volcomp_estimate::{
    Adaptation, MeasurementNoise, NodeFilter, NodeGrid, Observation, Process, Rules, Update, Verdict,
};

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
pub(crate) struct Args {
    #[command(flatten)]
    case: CaseArgs,
    /// Measurements as a table.
    #[arg(long, value_name = "FILE", conflicts_with = "input", required_unless_present_any = ["input", "file"])]
    data: Option<PathBuf>,
    /// The three linear axes of the grid.
    #[arg(long, value_delimiter = ',', default_value = "x,y,z", value_parser = linear_axis)]
    axes: Vec<AxisName>,
    /// Nodes along the first axis, mm.
    #[arg(long, value_delimiter = ',', value_name = "MM", required_unless_present_any = ["input", "file"], allow_hyphen_values = true)]
    first: Vec<f64>,
    /// Nodes along the second axis, mm.
    #[arg(long, value_delimiter = ',', value_name = "MM", required_unless_present_any = ["input", "file"], allow_hyphen_values = true)]
    second: Vec<f64>,
    /// Nodes along the third axis, mm.
    #[arg(long, value_delimiter = ',', value_name = "MM", required_unless_present_any = ["input", "file"], allow_hyphen_values = true)]
    third: Vec<f64>,
    /// How far the model may be wrong (k = 1), um or arcsec.
    #[arg(long, value_name = "UM|ARCSEC", required_unless_present_any = ["input", "file"])]
    sigma: Option<f64>,
    /// Distance over which nodes move together; 0: each on its own.
    #[arg(long, value_name = "MM", default_value_t = 0.0)]
    correlation_mm: f64,
    /// Noise of the instrument (k = 1), um or arcsec.
    #[arg(long, value_name = "UM|ARCSEC", required_unless_present_any = ["input", "file"])]
    noise: Option<f64>,
    /// Learn the noise from the data, between a tenth and ten times --noise.
    #[arg(long)]
    adaptive: bool,
    /// Random walk of every node: standard deviation after one hour, um or arcsec; needs t_s.
    #[arg(long, value_name = "UM|ARCSEC", default_value_t = 0.0)]
    walk_per_sqrt_h: f64,
    /// Largest change against the model, um or arcsec.
    #[arg(long, value_name = "UM|ARCSEC")]
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

impl Method for Args {
    fn front(&self) -> Front<'_> {
        self.case.front(&self.model)
    }

    fn of_case(&self, file: CaseFile<'_>) -> Result<Box<dyn Found + '_>> {
        of_case(&file.read()?).map_err(|e| file.bad(e))
    }

    fn of_data(&self) -> Result<Option<Box<dyn Found + '_>>> {
        Ok(Some(Box::new(Outcome::of(self, self.case.required(&self.data)?)?)))
    }
}

fn of_case(case: &Case) -> Result<Box<dyn Found>, String> {
    let CaseGrid { x, y, z } = &case.grid;
    let grid = NodeGrid::new(x.clone(), y.clone(), z.clone()).map_err(|e| e.to_string())?;
    let adaptation = case.adaptive.as_ref().map(|a| Adaptation { share: a.d, low: a.r_min, high: a.r_max });
    let mut noise = MeasurementNoise::new(case.r, adaptation).map_err(|e| e.to_string())?;
    if !(case.q_diag.is_finite() && case.q_diag >= 0.0) {
        return Err(format!("Q_diag {} is not a number from 0 up", case.q_diag));
    }
    let rules = Rules { gate: case.gate.unwrap_or(f64::INFINITY), cap_at_prior: false, ..Rules::default() };
    let process = Process::RandomWalk { variance_per_s: case.q_diag };
    let Prior { sigma, correlation_length } = case.p0;
    let mut filter = NodeFilter::new(&grid, &case.x0, &[sigma], correlation_length, process, rules)
        .map_err(|e| e.to_string())?;
    let update = |o: &CaseObservation| {
        filter.predict(1.0);
        filter.update(&Observation::alone(grid.place(o.position), o.value), &mut noise)
    };
    let updates: Vec<Update> = case.observations.iter().map(update).collect();
    let accepted: Vec<&Update> = updates.iter().filter(|u| u.verdict == Verdict::Accepted).collect();
    let mean_ratio = accepted.iter().fold(0.0, |sum, u| sum + u.ratio()) / accepted.len() as f64;
    let rejected = updates.len() - accepted.len();
    let sequence: Vec<f64> = updates.iter().map(|u| u.measurement_variance).collect();
    let (state, variance): (Vec<f64>, Vec<f64>) = (filter.state().to_vec(), filter.variances().collect());
    let mut json =
        json!({"state": state, "variance": variance, "mean_ratio": mean_ratio, "rejected": rejected});
    let last = sequence.last().copied().filter(|_| adaptation.is_some());
    if adaptation.is_some() {
        json["R_sequence"] = json!(sequence);
    }
    Ok(printed(json, move || {
        say!("node          value           std");
        for (i, (x, v)) in state.iter().zip(&variance).enumerate() {
            say!("{i:>4}{x:>15.6e}{:>14.6e}", v.sqrt());
        }
        if let Some(r) = last {
            say!("measurement std at the end {:.6e}", r.sqrt());
        }
        say!("nu^2/S in the mean {mean_ratio:.3}, rejected {rejected}");
    }))
}

/// Where a table keeps what.
struct TableColumns {
    time: Option<Column>,
    positions: [Column; 3],
    value: Column,
    symbol: ErrorSymbol,
}

impl TableColumns {
    fn find(table: &mut Columns, axes: &[AxisName; 3]) -> Result<Self> {
        let time = table.find_column("t_s");
        let [a, b, c] = axes.map(|axis| format!("{}_mm", axis.lower()));
        let positions = table.three([&a, &b, &c])?;
        let mut found: Option<(Column, ErrorSymbol)> = None;
        for (i, column) in table.columns().to_vec().iter().enumerate() {
            if table.known.contains(column) {
                continue;
            }
            let (name, unit) = column.rsplit_once('_').unwrap_or((column, ""));
            let symbol = ErrorSymbol::parse(name);
            match symbol.filter(|s| !s.is_constant() && Units::of(*s).value == unit) {
                Some(symbol) if found.is_none() => found = table.find_column(column).map(|c| (c, symbol)),
                Some(_) => return Err(table.fail(i, "a second error; filter one error at a time")),
                None => {
                    return Err(table.fail(i, "unknown column; columns are t_s, the axes in mm, and one error such as eaz_arcsec or ezz_um"));
                }
            }
        }
        let Some((value, symbol)) = found else {
            return Err(table.file_error("no column with an error, such as eaz_arcsec or ezz_um"));
        };
        Ok(Self { time, positions, value, symbol })
    }
}

/// What the filter made of a table.
struct Outcome<'a> {
    args: &'a Args,
    path: &'a Path,
    /// The model before, in which the map takes its place.
    model: ModelFile,
    function: ErrorFunction,
    axes: [AxisName; 3],
    symbol: ErrorSymbol,
    grid: NodeGrid,
    filter: NodeFilter,
    noise: MeasurementNoise,
    run: Run,
}

impl<'a> Outcome<'a> {
    fn of(args: &'a Args, path: &'a Path) -> Result<Self> {
        let &[a, b, c] = &args.axes[..] else {
            return Err(usage!("--axes names {} axes; a grid has three", args.axes.len()));
        };
        let axes = [a, b, c];
        if a == b || a == c || b == c {
            return Err(usage!("--axes names an axis twice"));
        }
        let grid = NodeGrid::new(args.first.clone(), args.second.clone(), args.third.clone())
            .map_err(Failure::usage)?;
        let mut table = table::open(path)?;
        let columns = TableColumns::find(&mut table, &axes)?;
        let (symbol, to_inner) = (columns.symbol, Units::of(columns.symbol).to_inner);
        if args.walk_per_sqrt_h > 0.0 && columns.time.is_none() {
            return Err(table.file_error("--walk-per-sqrt-h needs the column t_s"));
        }
        let model = args.model.base(|| default_chain(axes))?;
        let before = offline(&model, symbol)?;
        let variance = to_inner(args.noise.unwrap_or(0.0)).powi(2);
        let adaptation = Adaptation { share: 0.02, low: 0.01 * variance, high: 100.0 * variance };
        let mut noise = MeasurementNoise::new(variance, args.adaptive.then_some(adaptation))
            .map_err(|e| usage!("--noise: {e}"))?;
        let limit = args.limit.map_or(f64::INFINITY, |l| to_inner(l.abs()));
        let walk = to_inner(args.walk_per_sqrt_h).powi(2) / 3600.0;
        let mut filter = NodeFilter::new(
            &grid,
            &vec![0.0; grid.nodes()],
            &[to_inner(args.sigma.unwrap_or(0.0))],
            args.correlation_mm,
            Process::RandomWalk { variance_per_s: walk },
            Rules { limit, ..Rules::default() },
        )
        .map_err(Failure::usage)?;
        let offline_at = |at: [f64; 3]| value_at(&before, symbol, &axes, at);
        let run = filter.run(&mut noise, &grid, &read(&mut table, &columns, offline_at)?);
        if run.readings == run.rejected {
            let what = "no reading was accepted; check --sigma and --noise, and the units";
            return Err(table.file_error(what));
        }
        let function = filter.added_to(before, axes, &grid).map_err(|e| data!(symbol.to_string(), "{e}"))?;
        Ok(Self { args, path, model, function, axes, symbol, grid, filter, noise, run })
    }
}

impl Found for Outcome<'_> {
    fn json(&self) -> Value {
        let Units { value: u, of_value: out, .. } = Units::of(self.symbol);
        fields!(self.run; mean_ratio, readings, rejected, outside, alarm;
            "error": key(self.symbol),
            "nodes_mm": (0..self.grid.nodes()).map(|i| self.grid.node(i)).collect::<Vec<_>>(),
            format!("change_{u}"): self.filter.map().map(out).collect::<Value>(),
            format!("std_{u}"): self.filter.variances().map(|v| out(v.sqrt())).collect::<Value>(),
            format!("noise_{u}"): out(self.noise.variance().sqrt()),
            format!("rms_before_{u}"): out(self.run.before), format!("rms_after_{u}"): out(self.run.after),
        )
    }

    fn print(&self) {
        let Units { value: unit, of_value: out, .. } = Units::of(self.symbol);
        say_text!("{}: change of the map, {unit} (k = 1)", self.symbol);
        say!("     first    second     third      change       std");
        for (i, (value, variance)) in self.filter.map().zip(self.filter.variances()).enumerate() {
            let [a, b, c] = self.grid.node(i);
            say!("{a:>10.1}{b:>10.1}{c:>10.1}{:>12.3}{:>10.3}", out(value), out(variance.sqrt()));
        }
        let Run { readings, rejected, mean_ratio, outside, .. } = self.run;
        let [before, after, noise] = [self.run.before, self.run.after, self.noise.variance().sqrt()].map(out);
        say_text!(
            "{readings} readings, {rejected} rejected; rms {before:.3} before, {after:.3} after; noise {noise:.3} {unit}; nu^2/S {mean_ratio:.2} in the mean"
        );
        if self.run.alarm {
            note!(
                "warning: five readings in a row were rejected: the instrument or --sigma and --noise are wrong"
            );
        }
        if outside > 0 {
            note!("note: {outside} readings lie beyond the grid and count at its edge");
        }
        // 1.5: beyond it the stated noise explains too little, whatever the number of readings
        if mean_ratio > 1.5 {
            note!(
                "note: readings scatter more than --noise and --sigma say (nu^2/S should be about 1); --adaptive learns the noise"
            );
        }
    }

    fn write(&self, _end: &mut String) -> Result<()> {
        let (files, mut model) = ([self.path.to_owned()], self.model.clone());
        let sources = Sources::of(&files);
        model.put(self.symbol, self.function.clone(), sources.provenance());
        for name in self.axes.into_iter().chain([self.symbol.axis()]) {
            model.spec.axis_mut(name);
        }
        self.args.model.write(&model, &sources.heading("identify kalman"), &files)
    }
}

/// What the model says about the error already.
fn offline(model: &ModelFile, symbol: ErrorSymbol) -> Result<ErrorFunction> {
    let axis = model.spec.axis(symbol.axis());
    if axis.sense == Sense::Carriage {
        return Err(data!(
            symbol.to_string(),
            "axis {} of the model is in the carriage sense; the measurements are relative: convert the model first",
            axis.name
        ));
    }
    Ok(model.spec.error(symbol).cloned().unwrap_or_default())
}

/// The offline error at a place; axes that the table does not have stand at 0.
fn value_at(function: &ErrorFunction, symbol: ErrorSymbol, axes: &[AxisName; 3], at: [f64; 3]) -> f64 {
    let coordinate = |name: AxisName| axes.iter().position(|a| *a == name).map_or(0.0, |i| at[i]);
    function.value(coordinate(symbol.axis()), Travel::Forward) + function.grids_value(coordinate)
}

/// What a table holds beyond the model.
fn read(
    table: &mut Columns,
    columns: &TableColumns,
    offline_at: impl Fn([f64; 3]) -> f64,
) -> Result<Vec<Sample>> {
    let mut last: Option<f64> = None;
    table.rows(|row| {
        let at = row.point(columns.positions)?.into();
        let value = row.deviation(columns.value)? - offline_at(at);
        let mut passed_s = 0.0;
        if let Some(column) = columns.time {
            let now = row.value(column)?;
            passed_s = last.map_or(0.0, |last| now - last);
            if passed_s < 0.0 {
                let what = "is before the row above; sort the rows by time";
                return Err(row.fail(column, format_args!("{now} s {what}")));
            }
            last = Some(now);
        }
        Ok(Sample { passed_s, at, value })
    })
}
