//! `volcomp fit`: measured error motions to the curves of a model file.

pub(super) mod basis;
pub(super) mod input;
mod picture;
mod positions;
pub(super) mod report;
mod start_up;
mod thermal;

use clap::{Parser, Subcommand};

use self::basis::Auto;
use self::input::{BySymbol, Direction, Format, read};
use self::picture::PictureArgs;
use self::report::{Fitted, comments, hidden_text, json_report, outlier_lines, print_notes, table};
use super::positioning_data::Cycles;
use crate::prelude::*;
use volcomp_identify::curve::{self, Basis, Drift, Period, Request, Reversal, Smoothing};
use volcomp_model::curve::Interpolation;

/// Fit error curves to measured error motions and write them into a model file.
#[derive(Debug, Parser)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(super) struct Args {
    #[command(subcommand)]
    other: Option<Other>,
    /// Measured errors; once per file. - is stdin.
    #[arg(long, required = true, value_name = "FILE")]
    errors: Vec<PathBuf>,
    /// The axis that moved: one for all files, or one per file in the same order.
    #[arg(long, required = true, value_name = "LETTER", value_parser = axis_letter)]
    axis: Vec<AxisName>,
    /// How the files are written.
    #[arg(long, value_enum, default_value = "auto")]
    format: Format,
    /// Only these cycles, such as 1-4 or 1,3,5.
    #[arg(long)]
    cycles: Option<Cycles>,
    /// Only this direction of travel.
    #[arg(long, value_enum, default_value = "both")]
    direction: Direction,
    /// Family of curves.
    #[arg(long, value_parser = one_of(basis::ALL), default_value = "auto")]
    basis: Auto<Basis>,
    /// Half waves, polynomial degree or harmonics: a number or auto.
    #[arg(long, default_value = "auto", value_name = "N|auto")]
    order: AutoOr<usize>,
    /// Period of a Fourier series: a number (mm) or auto (fitted); several such as 10,auto,auto add up.
    #[arg(long, value_name = "P|auto", value_delimiter = ',', conflicts_with = "period_deg")]
    period_mm: Vec<AutoOr<f64>>,
    /// The same for a rotary axis, in degrees. Over a whole turn auto is 360.
    #[arg(long, value_name = "P|auto", value_delimiter = ',')]
    period_deg: Vec<AutoOr<f64>>,
    /// Limits of the search for the period, in mm (rotary: degrees).
    #[arg(long, value_name = "LOW,HIGH", value_parser = pair)]
    period_search: Option<[f64; 2]>,
    /// Whether a Fourier series gets a linear part.
    #[arg(long, value_parser = one_of(LINEAR), default_value = "auto")]
    linear: Auto<bool>,
    /// Penalty lambda * order^4 on the squares of the coefficients.
    #[arg(long, value_name = "LAMBDA")]
    ridge: Option<f64>,
    /// Interpolation between the support points of a table.
    #[arg(long, value_parser = one_of(INTERPOLATIONS), default_value = "linear")]
    interpolation: Interpolation,
    /// Smoothing of a table: none, auto (cross-validation), or the strength alpha of a smoothing spline.
    #[arg(long, default_value = "none", value_name = "none|auto|ALPHA", value_parser = smoothing)]
    smoothing: Smoothing,
    /// The difference between the directions of travel: kept where the data show it, or averaged out.
    #[arg(long, value_parser = one_of(REVERSALS), default_value = "auto")]
    reversal: Reversal,
    /// A drift over the cycles of a test in both directions, which reversal and curve would contain.
    #[arg(long, value_parser = one_of(DRIFTS), default_value = "auto")]
    drift: Drift,
    /// Find outliers, name them and leave them out.
    #[arg(long)]
    robust: bool,
    /// Pitch of the screw, to be told where the targets cannot show its error; several, or none.
    #[arg(long, value_name = "MM|none", default_value = "5,6,8,10,12,16,20", allow_hyphen_values = true, value_parser = pitches)]
    screw_pitch_mm: Pitches,
    #[command(flatten)]
    model: ModelWriter,
    /// Constant errors in arcsec, such as ec0y=-3.1,eb0z=22.3.
    #[arg(long, value_name = "SYMBOL=ARCSEC", value_delimiter = ',', value_parser = constant)]
    squareness: Vec<(ErrorSymbol, f64)>,
    /// Travel of an axis in mm (rotary: degrees), such as x=0:500; once per axis.
    #[arg(long, value_name = "AXIS=LOW:HIGH", value_parser = travel)]
    travel: Vec<(AxisName, [f64; 2])>,
    /// Print the figures of every fit as one JSON object, or write them to FILE.
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = "-")]
    json: Option<PathBuf>,
    #[command(flatten)]
    pictures: PictureArgs,
}

/// What is fitted other than error motions.
#[derive(Debug, Subcommand)]
enum Other {
    /// Thermal displacement, from a recording of temperatures and speeds beside a measured displacement.
    Thermal(Box<thermal::Args>),
}

const LINEAR: &[(&str, &str, Auto<bool>)] =
    &[("auto", "", None), ("yes", "", Some(true)), ("no", "", Some(false))];
const INTERPOLATIONS: &[(&str, &str, Interpolation)] =
    &[("linear", "", Interpolation::Linear), ("cubic", "", Interpolation::MonotoneCubic)];
const REVERSALS: &[(&str, &str, Reversal)] = &[("auto", "", Reversal::Auto), ("mean", "", Reversal::Mean)];

const DRIFTS: &[(&str, &str, Drift)] = &[
    ("auto", "Subtracted where it is significant (p < 0.01)", Drift::Auto),
    ("keep", "Kept; a significant one is reported", Drift::Keep),
    ("subtract", "Subtracted, significant or not", Drift::Subtract),
];

/// `none`, `auto` or a number.
fn smoothing(text: &str) -> Result<Smoothing, String> {
    match text {
        "none" => Ok(Smoothing::None),
        "auto" => Ok(Smoothing::Auto),
        _ => number(text)
            .map(Smoothing::Given)
            .map_err(|_| format!("'{text}' is neither none, auto nor a number")),
    }
}

/// A list of pitches; `none` is the empty one.
type Pitches = Vec<f64>;

fn pitches(text: &str) -> Result<Pitches, String> {
    let pitch = |part: &str| match number(part)? {
        v if v > 0.0 => Ok(v),
        v => Err(format!("pitch {v} is not above 0")),
    };
    if text == "none" { Ok(Vec::new()) } else { text.split(',').map(pitch).collect() }
}

/// A number, or the word `auto`.
#[derive(Debug, Clone, Copy)]
pub(super) enum AutoOr<T> {
    Auto,
    Given(T),
}

impl AutoOr<f64> {
    /// The number, where one is given.
    pub(super) const fn number(self) -> Option<f64> {
        match self {
            Self::Auto => None,
            Self::Given(value) => Some(value),
        }
    }
}

impl<T: core::str::FromStr> core::str::FromStr for AutoOr<T> {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "auto" {
            return Ok(Self::Auto);
        }
        text.parse().map(Self::Given).map_err(|_| format!("'{text}' is neither a number from 0 up nor auto"))
    }
}

fn pair(text: &str) -> Result<[f64; 2], String> {
    let (low, high) = text.split_once([',', ':']).ok_or("write two numbers, such as 20,500")?;
    Ok([number(low)?, number(high)?])
}

fn travel(text: &str) -> Result<(AxisName, [f64; 2]), String> {
    let (axis, range) = text.split_once('=').ok_or("write for example x=0:500")?;
    Ok((axis_letter(axis)?, pair(range)?))
}

fn constant(text: &str) -> Result<(ErrorSymbol, f64), String> {
    let (name, value) = text.split_once('=').ok_or("write for example ec0y=-3.1")?;
    match ErrorSymbol::parse(name) {
        Some(symbol @ ErrorSymbol::Squareness { .. }) => Ok((symbol, rad_from_arcsec(number(value)?))),
        _ => Err(format!("unknown squareness '{name}'; expected one of ec0y, eb0z, ea0z")),
    }
}

pub(super) fn run(args: &Args) -> Result<()> {
    if let Some(Other::Thermal(args)) = &args.other {
        return thermal::run(args);
    }
    if args.model.target().is_none() {
        return Err(usage!("neither --out nor --into is given"));
    }
    stdout_once(&args.model, args.json.as_deref())?;
    let base = args.model.check()?;
    let mut by_symbol = BySymbol::new();
    let [files, axes] = [args.errors.len(), args.axis.len()];
    if axes != 1 && axes != files {
        return Err(usage!("{files} files but {axes} axes; give --axis once, or once per --errors"));
    }
    for (i, path) in args.errors.iter().enumerate() {
        let axis = args.axis[if axes == 1 { 0 } else { i }];
        read(path, axis, args.format, args.cycles.as_ref(), args.direction, &mut by_symbol)?;
    }
    positions::check(&by_symbol, |axis| args.travel_of(axis, base.as_ref()))?;
    args.warn_of_hidden_pitches(&by_symbol);
    let mut fitted = Vec::with_capacity(by_symbol.len());
    for (symbol, measured) in by_symbol {
        let request = args.request(symbol.axis().kind())?;
        let fit = curve::fit(&measured.readings, &request).map_err(|e| {
            data_error(&args.errors, format_args!("{symbol}: {}", e.in_units_of(symbol.axis().kind())))
        })?;
        fitted.push(Fitted::new(symbol, measured, fit));
    }
    let sources = Sources::of(&args.errors);
    let model = args.model(&fitted, &sources)?;
    if let Some(what) = Model::new(&model.spec).err().and_then(|e| positions::swing(&fitted, &e)) {
        return Err(data_error(&args.errors, what));
    }
    args.model.write(&model, &comments("fit", &sources, &fitted), &args.errors)?;
    if let Some(path) = &args.json {
        write_text(path, &json_report(&fitted))?;
    }
    args.pictures.write(|| picture::svg(&fitted), || picture::page(&fitted))?;
    print_notes(&fitted);
    args.uncovered(&model, &fitted).iter().for_each(|note| note!("note: {note}"));
    fitted.iter().flat_map(outlier_lines).for_each(|line| note!("outlier: {line}"));
    if !stdout_taken(&args.model, args.json.as_deref()) {
        say_text!("{}", table(&fitted).trim_end());
    }
    Ok(())
}

/// True where a model or figures go to stdout.
fn stdout_taken(model: &ModelWriter, json: Option<&Path>) -> bool {
    model.takes_stdout() || json.is_some_and(|p| p.as_os_str() == "-")
}

/// Refuses a model and figures that would both go to stdout.
fn stdout_once(model: &ModelWriter, json: Option<&Path>) -> Result<()> {
    if model.takes_stdout() && json.is_some_and(|p| p.as_os_str() == "-") {
        return Err(usage!("--out - and --json cannot both go to stdout; give one of them a file"));
    }
    Ok(())
}

impl Args {
    /// The travel of an axis in the coordinate of the data, where it is stated.
    fn travel_of(&self, axis: AxisName, base: Option<&ModelFile>) -> Option<[f64; 2]> {
        let given = self.travel.iter().rev().find(|(name, _)| *name == axis);
        let given = given.map(|(_, range)| range.map(|v| axis.kind().position_in(v)));
        let spec = base.map(|file| &file.spec);
        let [low, high] = given.or_else(|| spec?.axis(axis).travel)?;
        let is_mirrored = spec.is_some_and(|s| s.is_mirrored(axis));
        Some(if is_mirrored { [-high, -low] } else { [low, high] })
    }

    /// Curves that cover only a part of the travel of their axis.
    fn uncovered(&self, model: &ModelFile, fitted: &[Fitted]) -> Vec<String> {
        let note = |symbol: ErrorSymbol| {
            let travel = self.travel_of(symbol.axis(), Some(model))?;
            let ranges = model.spec.error(symbol)?.curves.iter().filter_map(Curve::range);
            positions::uncovered(symbol, ranges.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])?, travel)
        };
        fitted.iter().filter_map(|f| note(f.symbol)).collect()
    }

    /// Says once per axis what its targets cannot show.
    fn warn_of_hidden_pitches(&self, by_symbol: &BySymbol) {
        let mut seen = Vec::new();
        for (symbol, measured) in by_symbol {
            let axis = symbol.axis();
            if axis.kind() == AxisKind::Rotary || seen.contains(&axis) {
                continue;
            }
            seen.push(axis);
            let Some(positions) = curve::few_positions(&measured.readings) else { continue };
            if let Some(text) = hidden_text(&curve::hidden(&positions, &self.screw_pitch_mm)) {
                note!("note: {axis}: {text}");
            }
        }
    }

    /// The periods in the order given; one that is fitted where none is.
    fn periods(&self, kind: AxisKind) -> Result<Vec<Period>> {
        let (given, other, wanted, to_inner): (_, _, _, fn(f64) -> f64) = match kind {
            AxisKind::Linear => (&self.period_mm, &self.period_deg, "--period-mm", |v| v),
            AxisKind::Rotary => (&self.period_deg, &self.period_mm, "--period-deg", rad_from_deg),
        };
        if !other.is_empty() {
            return Err(usage!("the unit of the period does not suit the axis; use {wanted}"));
        }
        let fitted = self.period_search.map_or(Period::Auto, |r| Period::Within(r.map(to_inner)));
        let period = |p: &AutoOr<f64>| p.number().map_or(fitted, |p| Period::Given(to_inner(p)));
        let all: Vec<Period> = given.iter().map(period).collect();
        let is_given = |p: &Period| matches!(p, Period::Given(_));
        if self.period_search.is_some() && !all.is_empty() && all.iter().all(is_given) {
            return Err(usage!("--period-search is for a period that is fitted; {wanted} gives it"));
        }
        if (!given.is_empty() || self.period_search.is_some())
            && !matches!(self.basis, None | Some(Basis::Fourier))
        {
            return Err(usage!("only --basis fourier has a period; remove {wanted} or change the basis"));
        }
        Ok(if all.is_empty() { vec![fitted] } else { all })
    }

    fn request(&self, kind: AxisKind) -> Result<Request> {
        let periods = self.periods(kind)?;
        if self.smoothing != Smoothing::None && !matches!(self.basis, None | Some(Basis::Table)) {
            return Err(usage!("only a table is smoothed; remove --smoothing or change the basis"));
        }
        let order = match self.order {
            AutoOr::Auto => None,
            AutoOr::Given(_) if self.basis == Some(Basis::Table) => {
                return Err(usage!("a table has no order; remove --order or change the basis"));
            }
            AutoOr::Given(order) => Some(order),
        };
        Ok(Request {
            basis: self.basis,
            order,
            period: periods[0],
            further_periods: periods[1..].to_vec(),
            smoothing: self.smoothing,
            reversal: self.reversal,
            drift: self.drift,
            robust: self.robust,
            turn: (kind == AxisKind::Rotary).then_some(core::f64::consts::TAU),
            linear: self.linear,
            ridge: self.ridge,
            interpolation: self.interpolation,
            ..Request::default()
        })
    }

    /// The model with the fitted curves in their places.
    fn model(&self, fitted: &[Fitted], sources: &Sources) -> Result<ModelFile> {
        let mut model = self.model.base(|| default_chain(fitted.iter().map(|f| f.symbol.axis())))?;
        for f in fitted {
            let name = |i: usize| self.errors[i].display().to_string();
            let from = sources.only(|i| f.measured.by_file().any(|(file, _)| file == name(i))).provenance();
            model.put(f.symbol, f.fit.function(), from);
        }
        for (symbol, value) in &self.squareness {
            model.put(*symbol, ErrorFunction::single(Curve::Constant(*value)), Provenance::default());
        }
        for (name, range) in &self.travel {
            model.spec.axis_mut(*name).travel = Some(range.map(|v| name.kind().position_in(v)));
        }
        for f in fitted {
            let axis = model.spec.axis(f.symbol.axis());
            if axis.sense == Sense::Carriage {
                note!(
                    "note: {}: axis {} of the model is in the carriage sense; the data are taken as the carriage's own motion over its own displacement",
                    f.symbol,
                    axis.name
                );
            }
            model.spec.axis_mut(axis.name);
        }
        let rotary = fitted.iter().filter(|f| f.symbol.axis().kind() == AxisKind::Rotary);
        for symbol in rotary.map(|f| f.symbol) {
            self.repeat_turn(&mut model, symbol)?;
        }
        Ok(model)
    }

    /// Repeats a curve of a whole turn over the travel of its axis: the pose is the same at every turn.
    fn repeat_turn(&self, model: &mut ModelFile, symbol: ErrorSymbol) -> Result<()> {
        let axis = model.spec.axis(symbol.axis());
        let mirrored = model.spec.is_mirrored(axis.name);
        let Some((_, function)) = model.spec.errors.iter_mut().find(|(s, _)| *s == symbol) else {
            return Ok(());
        };
        if !curve::covers_turn(&function.curves, core::f64::consts::TAU) {
            return Ok(());
        }
        let letter = axis.name.lower();
        let Some([low, high]) = axis.travel else {
            note!(
                "note: {symbol}: the curve covers one turn and is held outside of it; with the travel of the axis (--travel \
                 {letter}=LOW:HIGH) it is repeated over the travel"
            );
            return Ok(());
        };
        let travel = if mirrored { [-high, -low] } else { [low, high] };
        let repeated = curve::repeated(&function.curves, core::f64::consts::TAU, travel)
            .map_err(|e| data_error(&self.errors, format_args!("{symbol}: --travel {letter}: {e}")))?;
        if let Some(curves) = repeated {
            function.curves = curves;
            let [low, high] = [low, high].map(deg_from_rad);
            note!(
                "note: {symbol}: the data cover a whole turn; the curve repeats over the travel of {low} to {high} deg"
            );
        }
        Ok(())
    }
}
