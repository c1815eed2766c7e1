//! A model to the tables that controls load.

use std::path::Path;

use clap::{Args, ValueEnum};

use super::FormatArg;
use crate::arg_parsers::{axis_letter, number};
use crate::files::{Output, read_model};
use crate::import::ControlArgs;
use crate::{EX_DATAERR, EX_USAGE, Failure};
use volcomp_formats::axis_table::positioning;
use volcomp_formats::rtl::{Deviation, Entry, Rtl};
use volcomp_formats::sample::{AxisTable, ExportError, Limits, Motions, Sampling, Way, sample_axis};
use volcomp_formats::text::rounded;
use volcomp_formats::{heidenhain, isg, isg_lis, linuxcnc, rtl};
use volcomp_model::{Component, ErrorSymbol, ModelSpec};
use volcomp_units::axes::{AxisKind, AxisName};
use volcomp_units::{arcsec_from_rad, deg_from_rad, mm_from_um, rad_from_deg, um_from_mm};

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
    #[arg(long, value_name = "MM")]
    step: Option<f64>,
    /// First and last position in mm (rotary: deg), such as 0:500; else the travel of the axis.
    #[arg(long, value_name = "LOW:HIGH", value_parser = range, allow_hyphen_values = true)]
    range: Option<[f64; 2]>,
    /// Which direction of travel goes into a format that has only one.
    #[arg(long, value_enum)]
    direction: Option<DirectionArg>,
    #[command(flatten)]
    control: ControlArgs,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum DirectionArg {
    Forward,
    Reverse,
    Mean,
}

fn range(text: &str) -> Result<[f64; 2], String> {
    let (low, high) = text.split_once(':').ok_or("write two numbers, such as 0:500")?;
    Ok([number(low)?, number(high)?])
}

/// A text to write and the errors that are in it.
struct Written {
    text: String,
    symbols: Vec<ErrorSymbol>,
}

pub(super) fn run(path: &Path, format: FormatArg, out: &Path, options: &ModelOptions) -> Result<(), Failure> {
    let tolerance_um = options.tolerance_um.unwrap_or(TOLERANCE_UM);
    if !(tolerance_um > 0.0 && tolerance_um.is_finite()) {
        return Err(Failure::usage(format_args!("--tolerance-um {tolerance_um}: must be above 0")));
    }
    let (spec, _) = read_model(path)?;
    let written = write(format, options, &spec).map_err(|e| failure(path, &e))?;
    let mut output = Output::create(out)?;
    std::io::Write::write_all(&mut output, written.text.as_bytes())
        .map_err(|e| Failure::io(output.path(), &e))?;
    output.finish()?;
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
        let inner = |v: f64| if kind == AxisKind::Rotary { rad_from_deg(v) } else { v };
        Sampling {
            tolerance: mm_from_um(self.tolerance_um.unwrap_or(TOLERANCE_UM)),
            step: self.step.map(inner),
            range: self.range.map(|r| r.map(inner)),
            way: self.direction.map(|d| match d {
                DirectionArg::Forward => Way::Forward,
                DirectionArg::Reverse => Way::Reverse,
                DirectionArg::Mean => Way::Mean,
            }),
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
        FormatArg::Heidenhain => {
            heidenhain::write(spec, axis, args.control.sign.map(heidenhain::Sign::from), &sampling)?
        }
        FormatArg::Rtl => write_rtl(spec, axis, &sampling)?,
        FormatArg::Csv | FormatArg::Isg | FormatArg::Parquet => write_csv(spec, axis, &sampling)?,
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
    let (text, report) =
        isg::write(spec, &args.axis, args.control.sense.map(isg::Body::from), &args.sampling(kind))?;
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
    let (low, high) = (table.positions[0], table.positions[table.positions.len() - 1]);
    let (low, high, unit) = match table.axis.kind() {
        AxisKind::Linear => (low, high, "mm"),
        AxisKind::Rotary => (deg_from_rad(low), deg_from_rad(high), "deg"),
    };
    note!(
        "axis {}: {} points from {low} to {high} {unit}, at most {:.3} um from the model between them",
        table.axis,
        table.positions.len(),
        um_from_mm(table.largest_error)
    );
}

/// Says what of the model is not in the file.
fn not_held(format: FormatArg, args: &ModelOptions, spec: &ModelSpec, written: &[ErrorSymbol]) {
    let missing: Vec<String> =
        spec.errors.iter().filter(|(s, _)| !written.contains(s)).map(|(s, _)| s.to_string()).collect();
    if !missing.is_empty() {
        note!("not in this file: {}", missing.join(" "));
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

/// Any number of points, both directions.
const FREE: Limits = Limits { format: "csv", equidistant: false, points: 200_000, two_directions: true };

fn write_csv(
    spec: &ModelSpec,
    axis: AxisName,
    sampling: &Sampling,
) -> Result<(String, AxisTable), ExportError> {
    let motions = Motions::new(spec, axis, false)?;
    let components = motions.present();
    if components.is_empty() {
        return Err(ExportError::NoError { what: "error motion", axis });
    }
    let table = sample_axis(&motions, &components, sampling, &FREE)?;
    let two_way = table.columns.iter().any(|c| c.reverse.is_some());
    let rotary = axis.kind() == AxisKind::Rotary;
    let mut header = vec![if rotary { "position_deg" } else { "position_mm" }.to_owned()];
    header.extend(components.iter().map(|c| {
        let unit = if c.is_angle() { "arcsec" } else { "um" };
        format!("e{}{}_{unit}", c.letter().to_ascii_lowercase(), axis.lower())
    }));
    header.extend(two_way.then(|| "direction".to_owned()));
    let mut out = header.join(",") + "\n";
    for (reverse, direction) in [(false, "1"), (true, "-1")] {
        if reverse && !two_way {
            break;
        }
        for (i, q) in table.positions.iter().enumerate() {
            let mut row = vec![rounded(if rotary { deg_from_rad(*q) } else { *q }, 0)];
            row.extend(table.columns.iter().map(|c| {
                let values = c.reverse.as_ref().filter(|_| reverse).unwrap_or(&c.forward);
                rounded(
                    if c.component.is_angle() { arcsec_from_rad(values[i]) } else { um_from_mm(values[i]) },
                    0,
                )
            }));
            row.extend(two_way.then(|| direction.to_owned()));
            out.push_str(&row.join(","));
            out.push('\n');
        }
    }
    Ok((out, table))
}

fn write_rtl(
    spec: &ModelSpec,
    axis: AxisName,
    sampling: &Sampling,
) -> Result<(String, AxisTable), ExportError> {
    if axis.kind() == AxisKind::Rotary {
        let (format, known) = ("rtl", "linear ones: the unit of angles is not documented");
        return Err(ExportError::NoSuchAxis { axis, format, known });
    }
    let motions = Motions::new(spec, axis, false)?;
    let component: Component = positioning(axis);
    if !motions.present().contains(&component) {
        return Err(ExportError::NoError { what: "positioning error", axis });
    }
    let table = sample_axis(&motions, &[component], sampling, &Limits { format: "rtl", ..FREE })?;
    let column = &table.columns[0];
    let entry = |key: &str, text: String| Entry { key: key.to_owned(), text };
    // as written: without the rounding of the curve's evaluation
    let um = |v: f64| rounded(um_from_mm(v), 3).parse::<f64>().unwrap_or(v);
    let row = |run, i: usize, v: f64| Deviation { run, target: i as u32 + 1, value: um(v) };
    let mut deviations: Vec<Deviation> =
        column.forward.iter().enumerate().map(|(i, v)| row(1, i, *v)).collect();
    let one_way = column.reverse.is_none();
    if let Some(reverse) = &column.reverse {
        deviations.extend(reverse.iter().enumerate().rev().map(|(i, v)| row(2, i, *v)));
    }
    let file = Rtl {
        header: vec![
            entry("File type", "rtl".into()),
            entry("Owner", "volcomp".into()),
            entry("Version no", env!("CARGO_PKG_VERSION").into()),
        ],
        filetype: "ISO".to_owned(),
        targets: table.positions.clone(),
        flags: vec![0, i64::from(one_way), 2, 0],
        user_text: vec![
            entry("Machine", spec.machine.clone()),
            entry("Axis", axis.to_string()),
            entry("TITLE", "computed from a model, not measured".into()),
        ],
        run_count: if one_way { 1 } else { 2 },
        deviations,
        ..Rtl::default()
    };
    Ok((rtl::write(&file), table))
}
