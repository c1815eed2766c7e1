//! A model to the tables that controls load.

use clap::Args;

use super::FormatArg;
use crate::import::ControlArgs;
use crate::prelude::*;
use volcomp_formats::sample::{AxisTable, ExportError, Sampling, Way};
use volcomp_formats::{heidenhain, isg, isg_lis, linuxcnc, motion_table, rtl};
use volcomp_model::Law;

/// Straight lines between points stay this close to the model where nothing else is asked for, um.
const TOLERANCE_UM: f64 = 0.05;

/// What only models need.
#[derive(Debug, Args)]
pub(super) struct ModelOptions {
    /// The axis; isg takes several, and all where none is given.
    #[arg(long, value_name = "LETTER", value_parser = axis_letter)]
    axis: Vec<AxisName>,
    /// Straight lines between points stay this close to the model (angles: over one metre) [default: 0.05].
    #[arg(long, value_name = "UM")]
    tolerance_um: Option<f64>,
    /// Distance of the points in mm (rotary: deg), instead of a tolerance.
    #[arg(long, value_name = "MM|DEG")]
    step: Option<f64>,
    /// First and last position in mm (rotary: deg), such as 0:500; else the travel of the axis.
    #[arg(long, value_name = "LOW:HIGH", value_parser = range, allow_hyphen_values = true)]
    range: Option<[f64; 2]>,
    /// Which direction of travel goes into a format that has only one.
    #[arg(long, value_parser = one_of(DIRECTIONS))]
    direction: Option<Way>,
    #[command(flatten)]
    control: ControlArgs,
}

const DIRECTIONS: &[(&str, &str, Way)] =
    &[("forward", "", Way::Forward), ("reverse", "", Way::Reverse), ("mean", "", Way::Mean)];

fn range(text: &str) -> Result<[f64; 2], String> {
    let (low, high) = text.split_once(':').ok_or("write two numbers, such as 0:500")?;
    Ok([number(low)?, number(high)?])
}

/// A text to write and the errors that are in it.
struct Written {
    text: String,
    symbols: Vec<ErrorSymbol>,
}

pub(super) fn run(path: &Path, format: FormatArg, out: &Path, options: &ModelOptions) -> Result<()> {
    let tolerance_um = options.tolerance_um.unwrap_or(TOLERANCE_UM);
    if !(tolerance_um > 0.0 && tolerance_um.is_finite()) {
        return Err(usage!("--tolerance-um {tolerance_um}: must be above 0"));
    }
    let (spec, _) = read_model(path)?;
    let written = write(format, options, &spec).map_err(|e| failure(path, &e))?;
    write_text(out, &written.text)?;
    note!("written: {}", out.display());
    not_held(format, options, &spec, &written.symbols);
    Ok(())
}

fn failure(path: &Path, e: &ExportError) -> Failure {
    let code = match e {
        ExportError::SenseNotStated { .. }
        | ExportError::SignNotStated
        | ExportError::OneAxis { .. }
        | ExportError::CompTypeNotStated
        | ExportError::Step { .. }
        | ExportError::EmptyRange { .. }
        | ExportError::NoRange { .. }
        | ExportError::TwoDirections { .. }
        | ExportError::AxisNotInChain { .. } => EX_USAGE,
        _ => EX_DATAERR,
    };
    Failure::new(code, format_args!("error: {}: {e}", path.display()))
}

impl ModelOptions {
    /// An option that was given, for a file that is no model.
    pub(super) fn first_given(&self) -> Option<&'static str> {
        let Self { axis, tolerance_um, step, range, direction, control } = self;
        let ControlArgs { comp_type, linear_units, sense, sign } = control;
        [
            (!axis.is_empty(), "--axis"),
            (tolerance_um.is_some(), "--tolerance-um"),
            (step.is_some(), "--step"),
            (range.is_some(), "--range"),
            (direction.is_some(), "--direction"),
            (comp_type.is_some(), "--comp-type"),
            (linear_units.is_some(), "--linear-units"),
            (sense.is_some(), "--sense"),
            (sign.is_some(), "--sign"),
        ]
        .into_iter()
        .find_map(|(given, name)| given.then_some(name))
    }

    fn sampling(&self, kind: AxisKind) -> Sampling {
        let inner = |v: f64| kind.position_in(v);
        Sampling {
            tolerance: mm_from_um(self.tolerance_um.unwrap_or(TOLERANCE_UM)),
            step: self.step.map(inner),
            range: self.range.map(|r| r.map(inner)),
            way: self.direction,
        }
    }
}

fn write(format: FormatArg, args: &ModelOptions, spec: &ModelSpec) -> Result<Written, ExportError> {
    if format == FormatArg::Isg {
        return write_isg(args, spec);
    }
    let [axis] = args.axis[..] else { return Err(ExportError::OneAxis { format: "the format" }) };
    let sampling = args.sampling(axis.kind());
    let (text, table) = match format {
        FormatArg::LinuxCnc => {
            let file = args.control.comp_type.ok_or(ExportError::CompTypeNotStated)?;
            linuxcnc::write(spec, axis, file, args.control.linear_unit(), &sampling)?
        }
        FormatArg::IsgLis => isg_lis::write(spec, axis, &sampling)?,
        FormatArg::Heidenhain => heidenhain::write(spec, axis, args.control.sign, &sampling)?,
        FormatArg::Rtl => rtl::of_model(spec, axis, &sampling)?,
        FormatArg::Csv | FormatArg::Isg | FormatArg::Parquet => motion_table::write(spec, axis, &sampling)?,
    };
    describe(&table);
    let symbols =
        table.columns.iter().map(|c| ErrorSymbol::Motion { component: c.component, axis }).collect();
    Ok(Written { text, symbols })
}

fn write_isg(args: &ModelOptions, spec: &ModelSpec) -> Result<Written, ExportError> {
    let kind = args.axis.first().map_or(AxisKind::Linear, |a| a.kind());
    let several = args.axis.len() != 1;
    if several && (args.range.is_some() || args.step.is_some()) {
        return Err(ExportError::OneAxis { format: "--range and --step" });
    }
    let (text, report) = isg::write(spec, &args.axis, args.control.sense, &args.sampling(kind))?;
    for (axis, rows, error) in &report.blocks {
        note!("axis {axis}: {rows} rows, at most {:.3} um from the model between them", um_from_mm(*error));
    }
    note!("{} constants", report.constants);
    let written = |s: &ErrorSymbol| {
        report.blocks.iter().any(|(a, ..)| *a == s.axis()) || (s.is_constant() && report.constants > 0)
    };
    let symbols = spec.errors.iter().map(|(s, _)| *s).filter(written).collect();
    Ok(Written { text, symbols })
}

fn describe(table: &AxisTable) {
    let AxisTable { axis, positions, largest_error, .. } = table;
    let (points, largest) = (positions.len(), um_from_mm(*largest_error));
    let range = range_words(*axis, [positions[0], positions[points - 1]]);
    note!("axis {axis}: {points} points from {range}, at most {largest:.3} um from the model between them");
}

/// Says what of the model is not in the file.
fn not_held(format: FormatArg, args: &ModelOptions, spec: &ModelSpec, written: &[ErrorSymbol]) {
    let missing =
        spec.errors.iter().filter(|(s, _)| !written.contains(s)).map(|(s, _)| s.to_string()).joined(" ");
    if !missing.is_empty() {
        note!("not in this file: {missing}");
    }
    let terms = unheld_terms(args, spec, written);
    if !terms.is_empty() {
        note!("not in this file: {}", terms.join(", "));
    }
    if spec.errors.iter().any(|(s, f)| written.contains(s) && f.std.is_some()) && format != FormatArg::Csv {
        note!("not in this file: the stated uncertainties");
    }
    let angles = |axis: AxisName| {
        spec.errors.iter().any(|(s, _)| s.axis() == axis && s.is_angle() && !s.is_constant())
    };
    if let (false, Some(axis)) = (format == FormatArg::Isg || format == FormatArg::Csv, args.axis.first())
        && angles(*axis)
    {
        note!(
            "note: axis {axis} has angular errors, so away from its reference points its linear errors are others; the table holds those at the reference points"
        );
    }
}

/// Dynamic terms and errors of the tool that no table holds. Of a reversal error a table holds the values after long travel.
fn unheld_terms(args: &ModelOptions, spec: &ModelSpec, written: &[ErrorSymbol]) -> Vec<String> {
    let mut terms = Vec::new();
    for (symbol, function) in spec.errors.iter().filter(|(s, _)| written.contains(s)) {
        for term in &function.dynamics {
            let what = match term.law {
                Law::Reversal { .. } if args.direction == Some(Way::Mean) => "reversal",
                Law::Reversal { build_up } if build_up > 0.0 => "build-up of the reversal",
                Law::Reversal { .. } => continue,
                Law::FrictionPeak { .. } => "friction-peak",
                Law::Friction { .. } => "friction",
                Law::Velocity => "velocity",
                Law::Acceleration => "acceleration",
            };
            terms.push(format!("{symbol} {what}"));
        }
    }
    let tilted = spec.tool.tilt != [0.0; 2];
    terms.extend(tilted.then(|| "[tool] spindle-tilt-arcsec".to_owned()));
    terms.extend((spec.tool.length != 0.0).then(|| "[tool] length-error-um-per-m".to_owned()));
    terms
}
