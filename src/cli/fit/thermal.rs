//! `volcomp fit thermal`: a recording of temperatures, speeds and a displacement to a growth of the model file.

use plotters::prelude::*;

use super::picture::PictureArgs;
use crate::identify::{Column, Columns};
use crate::prelude::*;
use crate::report::plot::{self, Axes, Key};
use volcomp_estimate::Quantity;
use volcomp_identify::thermal::{Input, Request, ThermalFit, fit};
use volcomp_model::curve::Live;

/// Fit thermal displacement to a recording.
///
/// The recording is a table with a time, temperatures and speeds, and a displacement measured beside them: a probe on
/// the spindle nose, a laser on an axis at rest. Every temperature and every speed enters with several time constants;
/// the last part of the recording is kept back and forecast, so the figures say what to expect tomorrow, not how well
/// yesterday can be explained.
#[derive(Debug, clap::Parser)]
#[command(after_help = include_str!("thermal.txt"))]
pub(super) struct Args {
    /// The recording: CSV with a header. - is stdin.
    file: PathBuf,
    /// Column of the displacement, in um.
    #[arg(long, value_name = "COLUMN")]
    displacement: String,
    /// Column of the time, in s.
    #[arg(long, value_name = "COLUMN", default_value = "t_s")]
    time: String,
    /// Columns of temperatures, in degC; without it all that end in _degc.
    #[arg(long, value_name = "COLUMN,..", value_delimiter = ',')]
    temperatures: Vec<String>,
    /// Columns of speeds, in 1/min; without it all that end in _rpm.
    #[arg(long, value_name = "COLUMN,..", value_delimiter = ',')]
    speeds: Vec<String>,
    /// Columns that are not used, though they end like temperatures or speeds.
    #[arg(long, value_name = "COLUMN,..", value_delimiter = ',')]
    without: Vec<String>,
    /// Name of the growth in the model; without it that of the displacement.
    #[arg(long)]
    name: Option<String>,
    /// The error that it adds to, such as ezz.
    #[arg(long, value_name = "SYMBOL", value_parser = length, requires = "limit_um")]
    symbol: Option<ErrorSymbol>,
    /// The largest growth that is ever believed.
    #[arg(long, value_name = "UM", value_parser = above_zero)]
    limit_um: Option<f64>,
    /// So much of the recording, from its end, is forecast instead of fitted.
    #[arg(long, value_name = "PERCENT", default_value = "30", value_parser = not_negative)]
    hold_out_percent: f64,
    /// Time constants of the temperatures; 0 is the reading itself.
    #[arg(long, value_name = "S,..", value_delimiter = ',', default_value = "0,600,1800,5400", value_parser = not_negative)]
    lags_s: Vec<f64>,
    /// Time constants of the speeds.
    #[arg(long, value_name = "S,..", value_delimiter = ',', default_value = "60,600,1800,5400,14400", value_parser = not_negative)]
    speed_lags_s: Vec<f64>,
    /// Regularisation; default: the one with the smallest prediction error.
    #[arg(long, value_name = "LAMBDA", value_parser = above_zero)]
    lambda: Option<f64>,
    #[command(flatten)]
    model: ModelWriter,
    /// Print the figures as one JSON object, or write them to FILE.
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = "-")]
    json: Option<PathBuf>,
    #[command(flatten)]
    pictures: PictureArgs,
}

/// A length among the error motions of an axis.
fn length(text: &str) -> Result<ErrorSymbol, String> {
    match ErrorSymbol::parse(text) {
        Some(symbol) if !symbol.is_angle() && !symbol.is_constant() => Ok(symbol),
        _ => Err(format!(
            "invalid positioning or straightness error '{text}'; expected one of exx, eyx, .. ezz"
        )),
    }
}

/// The recording.
struct Recording {
    time_s: Vec<f64>,
    displacement_mm: Vec<f64>,
    inputs: Vec<Input>,
}

pub(super) fn run(args: &Args) -> Result<()> {
    super::stdout_once(&args.model, args.json.as_deref())?;
    let recording = read(args)?;
    let name = args.name.clone().unwrap_or_else(|| stem(&args.displacement).to_owned());
    let request = Request {
        name: name.clone(),
        temperature_lags_s: args.lags_s.clone(),
        speed_lags_s: args.speed_lags_s.clone(),
        hold_out: args.hold_out_percent / 100.0,
        lambda: args.lambda,
        ..Request::default()
    };
    let found = fit(&recording.time_s, &recording.inputs, &recording.displacement_mm, &request)
        .map_err(|e| data!(args.file, "{}: {e}", args.displacement))?;
    for sensor in &found.constant {
        note!("note: {sensor} never changes and is left out");
    }
    if args.model.target().is_some() {
        write_model(args, &name, &found)?;
    } else if args.symbol.is_some() {
        return Err(usage!("--symbol is written into a model; add --out or --into"));
    }
    if let Some(path) = &args.json {
        write_text(path, &format!("{:#}\n", report(&name, &found)))?;
    }
    let column = &args.displacement;
    args.pictures.write(|| svg(column, &recording, &found), || page(column, &recording, &found))?;
    if !super::stdout_taken(&args.model, args.json.as_deref()) {
        figures(&found).iter().for_each(|[what, value]| say!("{what:<58}{value:>12}"));
    }
    Ok(())
}

/// A column without its unit: the name of the sensor.
fn stem(column: &str) -> &str {
    let lower = column.to_ascii_lowercase();
    let unit = ["_degc", "_rpm", "_um"].into_iter().find(|unit| lower.ends_with(unit));
    unit.map_or(column, |unit| &column[..column.len() - unit.len()])
}

fn read(args: &Args) -> Result<Recording> {
    let mut table = table::open(&args.file)?;
    let [time, displacement] = [table.column(&args.time)?, table.column(&args.displacement)?];
    let mut inputs = sensors(&mut table, &args.temperatures, "_degc", &args.without, Quantity::Temperature)?;
    inputs.extend(sensors(&mut table, &args.speeds, "_rpm", &args.without, Quantity::Speed)?);
    let (mut time_s, mut displacement_mm) = (Vec::new(), Vec::new());
    table.rows(|row| {
        time_s.push(row.number(time)?);
        displacement_mm.push(mm_from_um(row.number(displacement)?));
        for (column, input) in &mut inputs {
            input.values.push(row.number(*column)?);
        }
        Ok(())
    })?;
    Ok(Recording { time_s, displacement_mm, inputs: inputs.into_iter().map(|(_, input)| input).collect() })
}

/// The columns named, or all with the ending.
fn sensors(
    table: &mut Columns,
    named: &[String],
    ending: &str,
    without: &[String],
    quantity: Quantity,
) -> Result<Vec<(Column, Input)>> {
    let mut names = named.to_vec();
    if named.is_empty() {
        without.iter().try_for_each(|name| table.column(name).map(|_| ()))?;
        let ends = |name: &&String| name.to_ascii_lowercase().ends_with(ending) && !without.contains(name);
        names.extend(table.columns().iter().filter(ends).cloned());
    }
    let one = |name: String| {
        Ok((table.column(&name)?, Input { sensor: stem(&name).to_owned(), quantity, values: Vec::new() }))
    };
    names.into_iter().map(one).collect()
}

fn write_model(args: &Args, name: &str, found: &ThermalFit) -> Result<()> {
    let files = std::slice::from_ref(&args.file);
    let sources = Sources::of(files);
    let mut model = args.model.base(|| "[w b X Y Z t]".to_owned())?;
    model.thermal.retain(|t| t.name != name);
    model.thermal.push(found.thermal.clone());
    if let (Some(symbol), Some(limit_um)) = (args.symbol, args.limit_um) {
        let live = Live { sensor: name.to_owned(), limit: mm_from_um(limit_um), reference: None };
        let function = model.spec.error_mut(symbol);
        function.live.retain(|l| l.sensor != name);
        function.live.push(live);
    }
    let mut comment = vec![format!("thermal {name} written by volcomp fit thermal")];
    comment.extend(sources.comments());
    args.model.write(&model, &comment, files)
}

fn um(mm: f64) -> String {
    format!("{:.2} um", um_from_mm(mm))
}

/// The figures in words.
fn figures(found: &ThermalFit) -> Vec<[String; 2]> {
    let mut lines = vec![
        ["displacement about its mean, RMS".to_owned(), um(found.raw_rms)],
        ["left by the growth in the rows it knows, RMS".to_owned(), um(found.fit_rms)],
        ["forecast of each later part from what came before, RMS".to_owned(), um(found.rolling_rms)],
    ];
    if let Some(f) = &found.forecast {
        let share = 100.0 * (1.0 - found.training_rows as f64 / found.rows as f64);
        lines.push([format!("forecast of the last {share:.0} %, never seen: RMS"), um(f.rms)]);
        lines.push(["    largest error".to_owned(), um(f.largest)]);
        lines.push(["    without a model (mean of the rows before): RMS".to_owned(), um(f.by_mean_rms)]);
        if let Some(plain) = f.by_regression_rms {
            lines.push(["    plain regression on the temperatures: RMS".to_owned(), um(plain)]);
        }
        lines.push([
            "    rows outside of what the fit had seen (held)".to_owned(),
            format!("{:.1} %", 100.0 * f.outside_share),
        ]);
    }
    lines.push(["strength of the shrinking".to_owned(), format!("{:.2e}", found.lambda)]);
    lines
}

fn report(name: &str, found: &ThermalFit) -> Value {
    let forecast = found.forecast.map(|f| {
        json!({
            "rms_um": um_from_mm(f.rms),
            "largest_um": um_from_mm(f.largest),
            "by_mean_rms_um": um_from_mm(f.by_mean_rms),
            "by_regression_rms_um": f.by_regression_rms.map(um_from_mm),
            "outside_share": f.outside_share,
        })
    });
    fields!(found; rows, training_rows, lambda;
        "name": name,
        "terms": found.thermal.terms(),
        "raw_rms_um": um_from_mm(found.raw_rms),
        "fit_rms_um": um_from_mm(found.fit_rms),
        "rolling_forecast_rms_um": um_from_mm(found.rolling_rms),
        "forecast": forecast,
        "left_out": found.constant,
    )
}

/// More points than this are drawn thinned out.
const POINTS: usize = 4000;

fn page(column: &str, recording: &Recording, found: &ThermalFit) -> plot::Svg {
    let mut page = Page::new(&format!("Thermal displacement: {column}"));
    let words = "Measured and predicted; right of the line the recording was not known to the fit.";
    page.figure(&svg(column, recording, found)?, words);
    let row = |[what, value]: [String; 2]| vec![Cell::text(what), Cell::number(value)];
    let rows: Vec<Vec<Cell>> = figures(found).into_iter().map(row).collect();
    page.table(&[Cell::text("figure"), Cell::text("value")], &rows);
    Ok(page.finish())
}

fn svg(column: &str, recording: &Recording, found: &ThermalFit) -> plot::Svg {
    let begin = recording.time_s.first().copied().unwrap_or_default();
    let every = (recording.time_s.len() / POINTS).max(1);
    let hours = |k: usize| (recording.time_s[k] - begin) / 3600.0;
    let series = |value: &dyn Fn(usize) -> f64| -> Vec<(f64, f64)> {
        (0..recording.time_s.len()).step_by(every).map(|k| (hours(k), um_from_mm(value(k)))).collect()
    };
    let measured = series(&|k| recording.displacement_mm[k]);
    let predicted = series(&|k| found.predicted[k]);
    let left = series(&|k| recording.displacement_mm[k] - found.predicted[k]);
    let x = [0.0, hours(recording.time_s.len() - 1)];
    let kept_back = (found.training_rows < found.rows).then(|| hours(found.training_rows));
    plot::svg(560, |area| {
        let (above, below) = area.split_vertically(370);
        let panels = [
            (&above, vec![(&measured, plot::BLUE), (&predicted, plot::VERMILLION)], column),
            (&below, vec![(&left, plot::INK)], "left / um"),
        ];
        for (area, lines, label) in panels {
            let y = plot::with_room(lines.iter().flat_map(|(l, _)| l.iter().map(|p| p.1)), 0.08);
            let axes = Axes { title: "", x_label: "time / h", y_label: label, x, y, right: 16, x_ticks: 12 };
            let mut chart = axes.draw(area)?;
            if let Some(at) = kept_back {
                chart.draw_series(LineSeries::new([(at, y[0]), (at, y[1])], plot::GREY.stroke_width(2)))?;
            }
            for (line, colour) in lines {
                chart.draw_series(LineSeries::new(line.iter().copied(), colour.stroke_width(1)))?;
            }
        }
        let keys = [
            Key::line(plot::BLUE, 2, "measured"),
            Key::line(plot::VERMILLION, 2, "predicted"),
            Key::line(plot::GREY, 2, "the fit knows what is left of this line"),
        ];
        plot::legend(&above, &keys, 90, 14)
    })
}
