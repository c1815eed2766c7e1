//! `volcomp identify diagonals`: squareness from four body diagonals.

mod vector;

use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use super::case::{CaseArgs, print_json};
use crate::arg_parsers::{above_zero, point};
use crate::files::read_model;
use crate::model_writer::{ModelWriter, Sources, default_chain, put};
use crate::positioning_data::{TestColumns, no_rows};
use crate::{EX_DATAERR, EX_USAGE, Failure, table};
use volcomp_config::model::Provenance;
use volcomp_identify::Reading;
use volcomp_identify::diagonals::runs::{EndToEnd, RunReading, end_to_end};
use volcomp_identify::diagonals::{
    MissingAngle, NAMES, SIGNS, SQUARENESS, Setup, Squareness, without_squareness,
};
use volcomp_model::geometry::Vec3;
use volcomp_model::statistics::student_95;
use volcomp_model::{Chain, Component, Curve, ErrorFunction, ErrorSymbol, ModelSpec};
use volcomp_units::axes::{AxisKind, AxisName, Travel};
use volcomp_units::{arcsec_from_rad, mm_from_um, rad_from_arcsec, um_from_mm};

/// What the help says beside the options.
const HELP: &str = "A laser along each body diagonal of a box reads how much too long it is. From the four end-to-end \
    values follow the three squarenesses, whatever the positioning errors are. Angular errors do not \
    cancel: an angle that grows by 10 arcsec over the box feigns up to 5 arcsec of squareness, so the \
    model with the angular curves is needed (--model) and its displacement is subtracted. Without it the \
    command refuses, unless you accept and state a bound for the bias.\n\n\
    Columns of --data: diagonal (ppp npp pnp ppn, signs of X Y Z), cycle, direction (1 out, -1 back), \
    target_mm along the diagonal from 0 to its length, deviation_um; optional t_s. Measure out and back, \
    or return once to 0 at the end: that takes the drift out. Three or more cycles give the noise.\n\n\
    Example:\n  volcomp identify diagonals --data diagonals.csv --box-mm 800,450,400 --low-mm 0,0,-450 --model angles.toml --into angles.toml --out model.toml";

/// Squareness of X, Y and Z from the displacements along four body diagonals (ISO 230-6).
#[derive(Debug, clap::Args)]
#[command(after_long_help = HELP)]
pub(super) struct Args {
    #[command(flatten)]
    case: CaseArgs,
    /// Readings along the diagonals; - is stdin.
    #[arg(
        long,
        value_name = "FILE",
        requires = "box_mm",
        conflicts_with = "input",
        required_unless_present_any = ["input", "file"]
    )]
    data: Option<PathBuf>,
    /// Sides of the box along X, Y, Z.
    #[arg(long, value_name = "A,B,C", value_parser = point)]
    box_mm: Option<Vec3>,
    /// Lower corner of the box, programmed coordinates.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, default_value = "0,0,0")]
    low_mm: Vec3,
    /// Model with the angular error motions of X, Y and Z; its displacement (squareness 0) is subtracted.
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Where the reflector stands, in M at home; default: the tool tip of the model.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    reflector_mm: Option<Vec3>,
    /// Accept missing angular data: no squareness is biased by more than this (half the change of each missing angle
    /// over the box). Stated in the result.
    #[arg(long, value_name = "ARCSEC", value_parser = above_zero)]
    accept_bias_arcsec: Option<f64>,
    /// Standard deviation of one end-to-end displacement, where the cycles do not tell.
    #[arg(long, value_name = "UM", value_parser = above_zero)]
    noise_um: Option<f64>,
    #[command(flatten)]
    out: ModelWriter,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    match (args.case.file(), args.case.data(&args.data)) {
        (Some(file), _) => {
            file.writes_no_model(args.out.target().is_some())?;
            vector::run(args, file)
        }
        (None, Some(path)) => run_data(args, path),
        (None, None) => Err(Failure::new(EX_USAGE, "error: give --data or --input")),
    }
}

/// Everything about a measurement on a machine.
struct Outcome {
    ends: EndToEnd,
    setup: Setup,
    found: Squareness,
    raw: Squareness,
    subtracted: [f64; 4],
    /// Standard deviation of the displacements and degrees of freedom, where known.
    noise: Option<([f64; 4], Option<usize>)>,
    missing: Vec<MissingAngle>,
    /// RMS of the steps about model, squareness and a common scale; only where the model has positioning.
    steps: Option<f64>,
}

fn run_data(args: &Args, path: &Path) -> Result<(), Failure> {
    let Some(size) = args.box_mm else {
        return Err(Failure::new(EX_USAGE, "error: --box-mm is missing; give the sides of the box"));
    };
    let model_path = args.model.as_ref().or(args.out.into.as_ref());
    let spec = match model_path {
        Some(p) => read_model(p)?.0,
        None => {
            let text = args.out.chain.clone().unwrap_or_else(|| default_chain([]));
            let chain = Chain::parse(&text)
                .map_err(|e| Failure::new(EX_USAGE, format_args!("error: --chain \"{text}\": {e}")))?;
            ModelSpec::new("unnamed", chain)
        }
    };
    let reflector = args.reflector_mm.unwrap_or(spec.tool_tip);
    let setup = Setup::new(&spec.chain, args.low_mm.into(), size.into(), reflector)
        .map_err(|e| Failure::data(path, e))?;
    let readings = read_diagonals(path, setup.length())?;
    let ends = end_to_end(&readings, setup.length()).map_err(|e| Failure::data(path, e))?;
    let model = without_squareness(&spec);
    let missing = setup.missing_angles(&model).map_err(|e| Failure::data(path, e))?;
    if !missing.is_empty() && args.accept_bias_arcsec.is_none() {
        return Err(refusal(path, &missing, model_path.is_some()));
    }
    let outcome = evaluate(args, path, setup, ends, &model, missing)?;
    let report = json_report(args, &outcome);
    if args.out.target().is_some() {
        write_model(args, path, &spec, &outcome)?;
    }
    if !args.out.takes_stdout() {
        if args.case.json { print_json(&report) } else { print_report(args, &outcome) }
    }
    Ok(())
}

/// Why the result would be worth little.
fn refusal(path: &Path, missing: &[MissingAngle], has_model: bool) -> Failure {
    let names: Vec<String> = missing.iter().map(|m| m.symbol.to_string()).collect();
    let worst = missing
        .iter()
        .flat_map(|m| m.bias.iter().zip(SQUARENESS).map(move |(b, s)| (b.abs(), s, m.symbol)))
        .fold((0.0, SQUARENESS[0], missing[0].symbol), |a, b| if b.0 > a.0 { b } else { a });
    let source = if has_model { "the model lacks" } else { "no --model with" };
    Failure::new(
        EX_DATAERR,
        format_args!(
            "error: {}: {source} {}: angular errors do not cancel on diagonals (10 arcsec of {} over the box change {} by {:.1} arcsec); measure the angles and give --model, or accept and state a bound with --accept-bias-arcsec",
            path.display(),
            names.join(" "),
            worst.2,
            worst.1,
            10.0 * worst.0
        ),
    )
}

fn evaluate(
    args: &Args,
    path: &Path,
    setup: Setup,
    ends: EndToEnd,
    model: &ModelSpec,
    missing: Vec<MissingAngle>,
) -> Result<Outcome, Failure> {
    let fail = |e| Failure::data(path, e);
    let directions: &[Travel] =
        if ends.both_directions { &[Travel::Forward, Travel::Reverse] } else { &[Travel::Forward] };
    let mut subtracted = [0.0; 4];
    for travel in directions {
        let d = setup.displacements(model, *travel).map_err(fail)?;
        for i in 0..4 {
            subtracted[i] += d[i] / directions.len() as f64;
        }
    }
    let noise = match (args.noise_um, ends.run_std) {
        (Some(um), _) => Some((ends.runs.map(|n| mm_from_um(um) / (n as f64).sqrt()), None)),
        (None, Some(std)) => Some((ends.runs.map(|n| std / (n as f64).sqrt()), Some(ends.dof))),
        (None, None) => None,
    };
    let std = noise.map_or([0.0; 4], |n| n.0);
    let corrected: [f64; 4] = std::array::from_fn(|i| ends.displacement[i] - subtracted[i]);
    let mut found = setup.squareness(&corrected, &std).map_err(fail)?;
    found.covariance += setup.covariance_of_angles(model).map_err(fail)?;
    let raw = setup.squareness(&ends.displacement, &std).map_err(fail)?;
    let positioning = [(Component::X, AxisName::X), (Component::Y, AxisName::Y), (Component::Z, AxisName::Z)];
    let knows_positioning = positioning.iter().all(|&(component, axis)| {
        model.errors.iter().any(|(s, _)| *s == ErrorSymbol::Motion { component, axis })
    });
    let mut outcome = Outcome { ends, setup, found, raw, subtracted, noise, missing, steps: None };
    if knows_positioning {
        outcome.steps = steps_residual(&outcome, model, directions).map_err(fail)?;
    }
    Ok(outcome)
}

/// RMS of the intermediate steps about the model with the squareness found and a common scale.
fn steps_residual(
    o: &Outcome,
    model: &ModelSpec,
    directions: &[Travel],
) -> Result<Option<f64>, volcomp_identify::diagonals::DiagonalsError> {
    let mut spec = model.clone();
    for (symbol, value) in SQUARENESS.into_iter().zip(o.found.value) {
        spec.errors.push((symbol, ErrorFunction::single(Curve::Constant(value))));
    }
    let length = o.setup.length();
    let (mut sum, mut n) = (0.0, 0usize);
    for (index, steps) in o.ends.steps.iter().enumerate() {
        let inner: Vec<&(f64, f64)> =
            steps.iter().filter(|(t, _)| *t > 1e-3 * length && *t < (1.0 - 1e-3) * length).collect();
        let shares: Vec<f64> = inner.iter().map(|(t, _)| t / length).collect();
        let mut expected = vec![0.0; shares.len()];
        for travel in directions {
            let d = o.setup.displacement(&spec, index, &shares, *travel)?;
            for (e, v) in expected.iter_mut().zip(d) {
                *e += v / directions.len() as f64;
            }
        }
        for ((step, share), e) in inner.iter().zip(shares).zip(expected) {
            sum += (step.1 - e - o.found.common * share).powi(2);
            n += 1;
        }
    }
    Ok((n > 0).then(|| (sum / n as f64).sqrt()))
}

/// The readings of the CSV that `volcomp evaluate iso230-6` reads; a diagonal written with opposite signs is the same
/// line from its other end.
fn read_diagonals(path: &Path, length: f64) -> Result<Vec<RunReading>, Failure> {
    let mut table = table::open(path)?;
    let name = table.require("diagonal")?;
    let columns = TestColumns::find(&table, &["diagonal", "t_s"])?;
    let time = table.find("t_s");
    if columns.kind == AxisKind::Rotary {
        return Err(Failure::data(path, "a diagonal has target_mm and deviation_um, not angles"));
    }
    let mut readings: Vec<RunReading> = Vec::new();
    while table.advance()? {
        let word = table.word(name);
        let Some((diagonal, reversed)) = diagonal_of(&word) else {
            let what = format_args!("invalid diagonal '{word}'; write ppp, npp, pnp or ppn (signs of X Y Z)");
            return Err(table.fail(name, what));
        };
        let mut reading = columns.reading(&table)?;
        if !(-1e-3..=length * (1.0 + 1e-6) + 1e-3).contains(&reading.position) {
            return Err(Failure::new(
                EX_DATAERR,
                format_args!(
                    "{}: target {} mm lies outside the diagonal of {length:.4} mm; is --box-mm right?",
                    table.fail(name, word).message,
                    reading.position
                ),
            ));
        }
        if reversed {
            reading = Reading {
                position: length - reading.position,
                value: -reading.value,
                travel: reading.travel.reversed(),
                ..reading
            };
        }
        let time = time.map_or(Ok(readings.len() as f64), |c| table.number(c))?;
        readings.push(RunReading { diagonal, reading, time });
    }
    if readings.is_empty() {
        return Err(no_rows(table.file()));
    }
    Ok(readings)
}

/// Index into [`SIGNS`], and whether the name starts from the other end.
fn diagonal_of(word: &str) -> Option<(usize, bool)> {
    let signs: Vec<f64> = word
        .chars()
        .map(|c| match c.to_ascii_lowercase() {
            'p' => Some(1.0),
            'n' => Some(-1.0),
            _ => None,
        })
        .collect::<Option<_>>()?;
    let signs = <[f64; 3]>::try_from(signs).ok()?;
    let find = |s: [f64; 3]| SIGNS.iter().position(|known| *known == s);
    find(signs).map(|i| (i, false)).or_else(|| find(signs.map(|s| -s)).map(|i| (i, true)))
}

/// One squareness with what is known about it, arcsec.
struct Line {
    symbol: ErrorSymbol,
    value: f64,
    /// Standard uncertainty and half width of the 95 % interval; the bias bound is added to the latter.
    uncertainty: Option<(f64, f64)>,
    biased: f64,
}

impl Line {
    fn is_significant(&self) -> Option<bool> {
        self.uncertainty.map(|(_, half)| self.value.abs() > half)
    }
}

fn lines(args: &Args, o: &Outcome) -> Vec<Line> {
    let bias = args.accept_bias_arcsec.filter(|_| !o.missing.is_empty()).unwrap_or(0.0);
    (0..3)
        .map(|i| Line {
            symbol: SQUARENESS[i],
            value: arcsec_from_rad(o.found.value[i]),
            uncertainty: o.noise.map(|(_, dof)| {
                let std = arcsec_from_rad(o.found.covariance[(i, i)].sqrt());
                // stated noise counts as well known
                (std, dof.map_or(1.959_964, student_95) * std + bias)
            }),
            biased: arcsec_from_rad(o.raw.value[i]),
        })
        .collect()
}

fn json_report(args: &Args, o: &Outcome) -> Value {
    let mut report = Map::new();
    for line in lines(args, o) {
        let key = line.symbol.to_string().to_lowercase();
        report.insert(format!("{key}_arcsec"), json!(line.value));
        report.insert(format!("{key}_std_arcsec"), json!(line.uncertainty.map(|u| u.0)));
        report.insert(format!("{key}_half_width_95_arcsec"), json!(line.uncertainty.map(|u| u.1)));
        report.insert(format!("{key}_significant"), json!(line.is_significant()));
        report.insert(format!("{key}_without_subtraction_arcsec"), json!(line.biased));
    }
    let by_name = |values: [f64; 4]| -> Value {
        NAMES.iter().zip(values).map(|(n, v)| ((*n).to_owned(), json!(um_from_mm(v)))).collect()
    };
    report.insert("common_um".into(), json!(um_from_mm(o.found.common)));
    report.insert("displacement_um".into(), by_name(o.ends.displacement));
    report.insert("subtracted_um".into(), by_name(o.subtracted));
    report.insert("run_std_um".into(), json!(o.ends.run_std.map(um_from_mm)));
    report.insert("dof".into(), json!(o.ends.dof));
    report.insert("open_runs".into(), json!(o.ends.open_runs));
    report.insert(
        "closure_um".into(),
        NAMES.iter().zip(o.ends.closure).map(|(n, v)| ((*n).to_owned(), json!(v.map(um_from_mm)))).collect(),
    );
    report.insert("steps_rms_um".into(), json!(o.steps.map(um_from_mm)));
    let names: Vec<String> = o.missing.iter().map(|m| m.symbol.to_string().to_lowercase()).collect();
    report.insert("missing_angles".into(), json!(names));
    let bound = args.accept_bias_arcsec.filter(|_| !o.missing.is_empty());
    report.insert("bias_bound_arcsec".into(), json!(bound));
    Value::Object(report)
}

fn print_report(args: &Args, o: &Outcome) {
    let show = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), |v| format!("{v:.2}"));
    say!("{:<10}{:>16}{:>16}{:>12}{:>8}", "diagonal", "displacement", "model says", "closure", "runs");
    for (i, name) in NAMES.iter().enumerate() {
        say!(
            "{name:<10}{:>13.2} um{:>13.2} um{:>9} um{:>8}",
            um_from_mm(o.ends.displacement[i]),
            um_from_mm(o.subtracted[i]),
            show(o.ends.closure[i].map(um_from_mm)),
            o.ends.runs[i]
        );
    }
    say!();
    say!(
        "{:<10}{:>12}{:>14}{:>16}{:>22}",
        "error",
        "arcsec",
        "std (k = 1)",
        "95 % interval",
        "without subtraction"
    );
    for line in lines(args, o) {
        let verdict = match line.is_significant() {
            Some(true) => "",
            Some(false) => "  not significant",
            None => "  noise unknown: significance cannot be judged",
        };
        say!(
            "{:<10}{:>12.2}{:>14}{:>16}{:>22.2}{verdict}",
            line.symbol.to_string(),
            line.value,
            show(line.uncertainty.map(|u| u.0)),
            line.uncertainty.map_or_else(|| "-".to_owned(), |u| format!("+-{:.2}", u.1)),
            line.biased
        );
    }
    say!();
    say!("common part (positioning and scale of the laser) {:.2} um", um_from_mm(o.found.common));
    if let Some(std) = o.ends.run_std {
        say!("one displacement repeats to {:.2} um ({} degrees of freedom)", um_from_mm(std), o.ends.dof);
    }
    notes(args, o);
}

fn notes(args: &Args, o: &Outcome) {
    if let Some(bound) = args.accept_bias_arcsec.filter(|_| !o.missing.is_empty()) {
        let names: Vec<String> = o.missing.iter().map(|m| m.symbol.to_string()).collect();
        say!("bias up to {bound:.2} arcsec accepted: no data of {}; added to the interval", names.join(" "));
    }
    if o.ends.open_runs > 0 {
        note!(
            "warning: {} runs do not return to their start: a drift of laser and machine is in the result; measure out and back, or read once more at 0",
            o.ends.open_runs
        );
    }
    match (o.steps, o.noise) {
        (Some(rms), Some((std, _))) => {
            let limit = 3.0 * std.iter().copied().fold(0.0, f64::max) * 2f64.sqrt();
            let verdict = if rms > limit {
                "more than the noise explains: positioning has changed since the model was measured, or the path is wrong"
            } else {
                "within the noise"
            };
            say!("steps between the ends differ from the model by {:.2} um rms: {verdict}", um_from_mm(rms));
        }
        (Some(rms), None) => {
            say!("steps between the ends differ from the model by {:.2} um rms", um_from_mm(rms))
        }
        (None, _) => {
            say!("steps between the ends are not judged: the model has no positioning of all three axes")
        }
    }
}

fn write_model(args: &Args, path: &Path, spec: &ModelSpec, o: &Outcome) -> Result<(), Failure> {
    let mut model = args.out.base(|| spec.chain.to_string())?;
    if args.out.into.is_none() {
        // levers of the subtraction belong to the result
        model.spec.workpiece_origin = spec.workpiece_origin;
        model.spec.tool_tip = spec.tool_tip;
        if args.out.machine.is_none() && spec.machine != "unnamed" {
            model.spec.machine.clone_from(&spec.machine);
        }
    }
    let files: Vec<PathBuf> = [Some(path.to_owned()), args.model.clone()].into_iter().flatten().collect();
    let sources = Sources::of(&files);
    let bound = args.accept_bias_arcsec.filter(|_| !o.missing.is_empty());
    for line in lines(args, o) {
        let value = Curve::Constant(rad_from_arcsec(line.value));
        let std = line.uncertainty.map(|u| rad_from_arcsec(u.0.hypot(bound.unwrap_or(0.0))));
        let note = bound.map(|b| format!("angular data incomplete, bias up to {b} arcsec accepted"));
        // the model that was subtracted is no measurement of its own
        let from = Provenance { note, ..sources.only(|i| i == 0).provenance() };
        put(&mut model, line.symbol, ErrorFunction { std, ..ErrorFunction::single(value) }, from);
    }
    let (low, size) = o.setup.cuboid();
    let mut comment = vec![format!("written by volcomp identify diagonals {}", env!("CARGO_PKG_VERSION"))];
    comment.extend(sources.comments());
    comment.push(format!("body diagonals of the box {size:?} mm from {low:?} mm"));
    args.out.write(&model, &comment, &path.display().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_diagonals() {
        assert_eq!(diagonal_of("ppp"), Some((0, false)));
        assert_eq!(diagonal_of("NNN"), Some((0, true)));
        assert_eq!(diagonal_of("pnn"), Some((1, true)));
        assert_eq!(diagonal_of("ppn"), Some((3, false)));
        for bad in ["", "pp", "pppp", "pqp"] {
            assert_eq!(diagonal_of(bad), None);
        }
    }
}
