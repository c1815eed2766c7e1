//! `volcomp identify diagonals`: squareness from four body diagonals.

mod vector;

use crate::identify::prelude::*;
use crate::positioning_data::TestColumns;
use crate::units::beyond_machines;
use volcomp_evaluate::Diagonal;
use volcomp_identify::diagonals::measurement::{Measurement, Steps};
use volcomp_identify::diagonals::runs::{EndToEnd, RunReading, end_to_end};
use volcomp_identify::diagonals::{MissingAngle, NAMES, SQUARENESS, Setup, without_squareness};
use volcomp_model::statistics::ChiSquare;

/// Squareness of X, Y and Z from the displacements along four body diagonals (ISO 230-6).
#[derive(Debug, clap::Args)]
#[command(after_long_help = include_str!("help.txt"))]
pub(crate) struct Args {
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
    /// Standard deviation of one end-to-end displacement, where the cycles do not tell; where they do, it is tested against them.
    #[arg(long, value_name = "UM", value_parser = above_zero)]
    noise_um: Option<f64>,
    #[command(flatten)]
    out: ModelWriter,
}

impl Method for Args {
    fn front(&self) -> Front<'_> {
        self.case.front(&self.out)
    }

    fn of_case(&self, file: CaseFile<'_>) -> Result<Box<dyn Found + '_>> {
        vector::run(self, file)
    }

    fn of_data(&self) -> Result<Option<Box<dyn Found + '_>>> {
        Ok(Some(Box::new(Outcome::of(self, self.case.required(&self.data)?)?)))
    }
}

/// Everything about a measurement on a machine.
struct Outcome<'a> {
    args: &'a Args,
    path: &'a Path,
    /// The model of the levers.
    spec: ModelSpec,
    ends: EndToEnd,
    setup: Setup,
    result: Measurement,
    missing: Vec<MissingAngle>,
    /// What was accepted as bias where angles are missing, arcsec.
    bound: Option<f64>,
}

impl<'a> Outcome<'a> {
    fn of(args: &'a Args, path: &'a Path) -> Result<Self> {
        let size = args.box_mm.ok_or_else(|| usage!("--box-mm is missing; give the sides of the box"))?;
        let model_path = args.model.as_ref().or(args.out.into.as_ref());
        let spec = match model_path {
            Some(p) => read_model(p)?.0,
            None => {
                let text = args.out.chain.clone().unwrap_or_else(|| default_chain([]));
                let chain = Chain::parse(&text).map_err(|e| usage!("--chain \"{text}\": {e}"))?;
                ModelSpec::new("unnamed", chain)
            }
        };
        let fail = |e| Failure::data(path, e);
        inside_travel(path, &spec, args.low_mm, size)?;
        let reflector = args.reflector_mm.unwrap_or(spec.tool_tip);
        let setup = Setup::new(&spec.chain, args.low_mm.into(), size.into(), reflector).map_err(fail)?;
        let readings = read_diagonals(path, setup.length())?;
        let ends = end_to_end(&readings, setup.length()).map_err(|e| Failure::data(path, e))?;
        let model = without_squareness(&spec);
        let missing = setup.missing_angles(&model).map_err(fail)?;
        if !missing.is_empty() && args.accept_bias_arcsec.is_none() {
            return Err(refusal(path, &missing, model_path.is_some()));
        }
        let result = Measurement::new(&setup, &model, &ends, args.noise_um.map(mm_from_um)).map_err(fail)?;
        let bound = args.accept_bias_arcsec.filter(|_| !missing.is_empty());
        Ok(Self { args, path, spec, ends, setup, result, missing, bound })
    }
}

/// How far a box may reach out of the travel, as a share of its side: nobody measures the ends to the last micrometre.
const OUTSIDE: f64 = 0.01;

/// Refuses a box that the machine of the model cannot reach.
fn inside_travel(path: &Path, spec: &ModelSpec, low_mm: Vec3, size_mm: Vec3) -> Result<()> {
    for axis in [AxisName::X, AxisName::Y, AxisName::Z] {
        let (low, side) = (low_mm[axis.direction()], size_mm[axis.direction()]);
        let Some([least, most]) = spec.axis(axis).travel else { continue };
        if low < least - OUTSIDE * side || low + side > most + OUTSIDE * side {
            let rounded = |mm: f64| (mm * 1e3).round() / 1e3;
            let [low, least, most] = [low, least, most].map(rounded);
            return Err(data!(
                path,
                "the box runs from {axis} {low} to {} mm, the travel of the model from {least} to {most} mm; give the low corner of \
                 the box with --low-mm, its sides with --box-mm, or correct travel-mm of the model",
                rounded(low + side)
            ));
        }
    }
    Ok(())
}

/// Why the result would be worth little.
fn refusal(path: &Path, missing: &[MissingAngle], has_model: bool) -> Failure {
    let worst = missing
        .iter()
        .flat_map(|m| m.bias.iter().zip(SQUARENESS).map(move |(b, s)| (b.abs(), s, m.symbol)))
        .fold((0.0, SQUARENESS[0], missing[0].symbol), |a, b| if b.0 > a.0 { b } else { a });
    let source = if has_model { "the model lacks" } else { "no --model with" };
    let (worst, of, angle) = (10.0 * worst.0, worst.1, worst.2);
    data!(
        path,
        "{source} {}: angular errors do not cancel on diagonals (10 arcsec of {angle} over the box change {of} by {worst:.1} arcsec); measure the angles and give --model, or accept and state a bound with --accept-bias-arcsec",
        names_of(missing)
    )
}

fn names_of(missing: &[MissingAngle]) -> String {
    missing.iter().map(|m| m.symbol.to_string()).joined(" ")
}

/// The readings of the CSV that `volcomp evaluate iso230-6` reads; a diagonal written with opposite signs is the same
/// line from its other end.
fn read_diagonals(path: &Path, length: f64) -> Result<Vec<RunReading>> {
    let mut table = table::open(path)?;
    let name = table.require("diagonal")?;
    let columns = TestColumns::find(&table, &["diagonal", "t_s"])?;
    let time = table.find("t_s");
    if columns.kind == AxisKind::Rotary {
        return Err(data!(path, "a diagonal has target_mm and deviation_um, not angles"));
    }
    let mut row = 0.0;
    table.some_rows(|table| {
        let word = table.word(name);
        let Some((diagonal, reversed)) = diagonal_of(&word) else {
            let what = format_args!("invalid diagonal '{word}'; write ppp, npp, pnp or ppn (signs of X Y Z)");
            return Err(table.fail(name, what));
        };
        let mut reading = columns.reading(table)?;
        if let Some(what) = beyond_machines(um_from_mm(reading.value), false) {
            return Err(table.fail_row(format_args!("deviation_um {what}")));
        }
        if !(-1e-3..=length * (1.0 + 1e-6) + 1e-3).contains(&reading.position) {
            let what = format_args!(
                "{word}: target {} mm lies outside the diagonal of {length:.4} mm; is --box-mm right?",
                reading.position
            );
            return Err(table.fail(name, what));
        }
        if reversed {
            reading = Reading {
                position: length - reading.position,
                value: -reading.value,
                travel: reading.travel.reversed(),
                ..reading
            };
        }
        let time = time.map_or(Ok(row), |c| table.number(c))?;
        row += 1.0;
        Ok(RunReading { diagonal, reading, time })
    })
}

/// Index into [`NAMES`], and whether the name starts from the other end.
fn diagonal_of(word: &str) -> Option<(usize, bool)> {
    let diagonal = Diagonal::parse(word)?;
    let index = NAMES.iter().position(|name| *name == diagonal.name())?;
    Some((index, !word.eq_ignore_ascii_case(diagonal.name())))
}

/// Values of the four diagonals.
fn by_name<V: Serialize>(values: [V; 4]) -> Value {
    NAMES.iter().zip(values).map(|(n, v)| ((*n).to_owned(), json!(v))).collect()
}

impl Found for Outcome<'_> {
    fn json(&self) -> Value {
        let Measurement { found, subtracted, steps, .. } = &self.result;
        let (test, repeats) = (steps.and_then(|s| s.test), self.result.repeats);
        let mut json = json!({
            "common_um": um_from_mm(found.common),
            "displacement_um": by_name(self.ends.displacement.map(um_from_mm)),
            "subtracted_um": by_name(subtracted.map(um_from_mm)),
            "run_std_um": self.ends.run_std.map(um_from_mm),
            "dof": self.ends.dof,
            "noise_p_value": repeats.and_then(ChiSquare::p_value),
            "noise_factor": repeats.and_then(ChiSquare::noise_factor),
            "open_runs": self.ends.open_runs,
            "closure_um": by_name(self.ends.closure.map(|v| v.map(um_from_mm))),
            "steps_rms_um": steps.map(|s| um_from_mm(s.rms)),
            "steps_expected_rms_um": test.map(|t| um_from_mm(t.expected_rms)),
            "steps_p_value": test.map(|t| t.p_value),
            "steps_passed": test.map(|t| t.p_value >= SIGNIFICANT),
            "enlarged": steps.map_or(1.0, |s| s.enlarged()),
            "worst_step": steps.map(|s| json!({
                "diagonal": NAMES[s.worst.0],
                "target_mm": s.worst.1,
                "residual_um": um_from_mm(s.worst.2),
            })),
            "missing_angles": self.missing.iter().map(|m| key(m.symbol)).collect::<Vec<_>>(),
            "bias_bound_arcsec": self.bound,
        });
        for (symbol, line) in SQUARENESS.into_iter().zip(self.result.lines(self.bound)) {
            let line = fields!(line; arcsec, std_arcsec, half_width_95_arcsec, significant, without_subtraction_arcsec);
            for (name, value) in line.as_object().into_iter().flatten() {
                json[format!("{}_{name}", key(symbol))] = value.clone();
            }
        }
        json
    }

    fn print(&self) {
        let (ends, um) = (&self.ends, um_from_mm);
        say!("diagonal      displacement      model says     closure    runs");
        for (i, name) in NAMES.iter().enumerate() {
            let [measured, model] = [ends.displacement[i], self.result.subtracted[i]].map(um);
            let (closure, runs) = (or_dash(ends.closure[i].map(um), 2), ends.runs[i]);
            say_text!("{name:<10}{measured:>13.2} um{model:>13.2} um{closure:>9} um{runs:>8}");
        }
        say!();
        say!("error           arcsec   std (k = 1)   95 % interval   without subtraction");
        for (symbol, line) in SQUARENESS.into_iter().zip(self.result.lines(self.bound)) {
            let verdict = match line.significant {
                Some(true) => "",
                Some(false) => "  not significant",
                None => "  noise unknown: significance cannot be judged",
            };
            let (value, std) = (line.arcsec, or_dash(line.std_arcsec, 2));
            let half =
                line.half_width_95_arcsec.map_or_else(|| "-".to_owned(), |half| format!("+-{half:.2}"));
            let raw = line.without_subtraction_arcsec;
            say!("{symbol:<10}{value:>12.2}{std:>14}{half:>16}{raw:>22.2}{verdict}");
        }
        say!();
        say_text!("common part (positioning and scale of the laser) {:.2} um", um(self.result.found.common));
        if let Some(std) = ends.run_std {
            say_text!("one displacement repeats to {:.2} um ({} degrees of freedom)", um(std), ends.dof);
        }
        if let Some(bound) = self.bound {
            let names = names_of(&self.missing);
            say!("bias up to {bound:.2} arcsec accepted: no data of {names}; added to the interval");
        }
        if ends.open_runs > 0 {
            note!(
                "warning: {} runs do not return to their start: a drift of laser and machine is in the result; measure out and back, or read once more at 0",
                ends.open_runs
            );
        }
        let Some(steps) = &self.result.steps else {
            say!("steps between the ends are not judged: the model has no positioning of all three axes");
            return;
        };
        let verdict = steps.test.map_or_else(
            || ": noise unknown, not tested".to_owned(),
            |t| {
                let verdict = if steps.failed() { "FAILED" } else { "passed" };
                format!("; expected {:.2} um, p {:.3}: {verdict}", um(t.expected_rms), t.p_value)
            },
        );
        say_text!("steps between the ends differ from the model by {:.2} um rms{verdict}", um(steps.rms));
    }

    fn warn(&self) {
        let path = self.path.display();
        if let (Some(repeats), Some(std), Some(stated)) =
            (self.result.repeats.filter(|r| r.has_failed()), self.ends.run_std, self.args.noise_um)
        {
            let (std, factor) = (um_from_mm(std), repeats.enlarged());
            let p = small(repeats.p_value().unwrap_or_default());
            note!(
                "warning: {path}: the cycles scatter by {std:.2} um, {factor:.1} times the stated {stated} um (p {p}); is a run wrong, or \
                 --noise-um too small?"
            );
            note!(
                "note: the noise is taken from the cycles: the uncertainties given are enlarged by {factor:.1}"
            );
        }
        let Some((steps, test)) = self.result.steps.filter(Steps::failed).and_then(|s| Some((s, s.test?)))
        else {
            return;
        };
        let (count, (diagonal, target, residual)) = (steps.count, steps.worst);
        let [rms, expected, residual] = [steps.rms, test.expected_rms, residual].map(um_from_mm);
        let (p, diagonal) = (small(test.p_value), NAMES[diagonal]);
        note!(
            "warning: {path}: {count} steps between the ends lie {rms:.2} um rms off the model, {expected:.2} um expected (p {p}), \
             farthest {diagonal} at {target:.3} mm: {residual:+.2} um; two diagonals may be exchanged, a sign, --low-mm or --box-mm \
             be wrong, or positioning have changed since the model was measured"
        );
        note!("note: the uncertainties given are enlarged by {:.1}", steps.enlarged());
    }

    fn write(&self, _end: &mut String) -> Result<()> {
        let (args, spec) = (self.args, &self.spec);
        let mut model = match &args.model {
            Some(_) if args.out.into.is_none() && args.out.chain.is_none() => {
                args.out.base_with(spec.chain.clone())
            }
            _ => args.out.base(|| spec.chain.to_string())?,
        };
        if args.out.into.is_none() {
            // levers of the subtraction belong to the result
            model.spec.workpiece_origin = spec.workpiece_origin;
            model.spec.tool_tip = spec.tool_tip;
            if args.out.machine.is_none() && spec.machine != "unnamed" {
                model.spec.machine.clone_from(&spec.machine);
            }
        }
        let files = [self.path.to_owned()];
        let all: Vec<PathBuf> = files.iter().chain(&args.model).cloned().collect();
        let sources = Sources::of(&all);
        for (symbol, line) in SQUARENESS.into_iter().zip(self.result.lines(self.bound)) {
            let value = Curve::Constant(rad_from_arcsec(line.arcsec));
            let std = line.std_arcsec.map(|std| rad_from_arcsec(std.hypot(self.bound.unwrap_or(0.0))));
            let note = self.bound.map(|b| format!("angular data incomplete, bias up to {b} arcsec accepted"));
            // the model that was subtracted is no measurement of its own
            let from = Provenance { note, ..sources.only(|i| i == 0).provenance() };
            model.put(symbol, ErrorFunction { std, ..ErrorFunction::single(value) }, from);
        }
        let (low, size) = self.setup.cuboid();
        let mut comment = sources.heading("identify diagonals");
        comment.push(format!("body diagonals of the box {size:?} mm from {low:?} mm"));
        args.out.write(&model, &comment, &files)
    }
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
