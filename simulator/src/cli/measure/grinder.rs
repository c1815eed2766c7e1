//! `cncsim measure grinder`: one step of the identification axis by axis.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use volcomp_units::axes::{AxisArray, AxisKind, AxisName};

use crate::cli::serve::built_in_or_file;
use crate::cli::{EX_DATAERR, EX_IOERR, EX_USAGE, Failure};
use crate::drawing::drawing;
use crate::instruments::grinder::{Artefact, ArtefactPose};
use crate::truth::TruthMachine;

/// Measure tip deviations at the poses of a plan, corrections added as the plan says; or write the drawing.
///
/// The plan is what volcomp identify grinder --next writes: a_deg, x_mm .. per axis, tool_x_mm tool_y_mm tool_z_mm, and the
/// corrections ca_arcsec, cx_um .. Start with --drawing, which writes the machine's geometry as a model without errors.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The machine: a truth file, or one of the built-in vmc-850, gantry-5ax, grinder-ab.
    #[arg(long, value_name = "FILE|NAME", default_value = "grinder-ab")]
    machine: PathBuf,
    /// Write the drawing of the machine as a model file without errors.
    #[arg(long, value_name = "FILE")]
    drawing: Option<PathBuf>,
    /// Poses to measure at.
    #[arg(long, value_name = "CSV", requires = "out")]
    poses: Option<PathBuf>,
    /// The readings.
    #[arg(long, value_name = "CSV", requires = "poses")]
    out: Option<PathBuf>,
    /// Standard deviation of a reading.
    #[arg(long, value_name = "UM", default_value_t = 0.3)]
    noise_um: f64,
    /// Standard deviation of the artefact's shift.
    #[arg(long, value_name = "UM", default_value_t = 20.0)]
    lies_um: f64,
    /// Standard deviation of the artefact's turn.
    #[arg(long, value_name = "ARCSEC", default_value_t = 20.0)]
    lies_arcsec: f64,
    /// Seed of the noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let machine = built_in_or_file(&args.machine)?;
    if args.drawing.is_none() && args.poses.is_none() {
        return Err(Failure::new(EX_USAGE, "nothing to do; give --drawing, or --poses and --out"));
    }
    if let Some(path) = &args.drawing {
        write(path, &format!("# Geometry of the machine as drawn, without errors.\n{}", drawing(&machine)))?;
        note!("drawing written: {}", path.display());
    }
    let (Some(poses), Some(out)) = (&args.poses, &args.out) else { return Ok(()) };
    let artefact = Artefact {
        noise_um: args.noise_um,
        lies_um: args.lies_um,
        lies_arcsec: args.lies_arcsec,
        seed: args.seed,
    };
    let count = measure_plan(&machine, poses, out, |plan| artefact.measure(&machine, plan))?;
    note!("{count} points measured: {}", out.display());
    Ok(())
}

/// Reads a plan, has it measured and writes what was seen; returns the number of points.
pub(crate) fn measure_plan(
    machine: &TruthMachine,
    poses: &Path,
    out: &Path,
    see: impl FnOnce(&[ArtefactPose]) -> Vec<[f64; 3]>,
) -> Result<usize, Failure> {
    let plan = read(poses, machine)?;
    write(out, &table(machine, &plan, &see(&plan)))?;
    Ok(plan.len())
}

fn write(path: &Path, text: &str) -> Result<(), Failure> {
    crate::cli::write_file(path, text).map_err(|e| Failure::in_file(EX_IOERR, path, e))
}

/// Names of the columns of position and correction of an axis, and what a correction is divided by.
fn columns(axis: AxisName) -> (String, String, f64) {
    let letter = axis.lower();
    match axis.kind() {
        AxisKind::Linear => (format!("{letter}_mm"), format!("c{letter}_um"), 1e3),
        AxisKind::Rotary => (format!("{letter}_deg"), format!("c{letter}_arcsec"), 3600.0),
    }
}

const TOOL: [&str; 3] = ["tool_x_mm", "tool_y_mm", "tool_z_mm"];

fn read(path: &Path, machine: &TruthMachine) -> Result<Vec<ArtefactPose>, Failure> {
    let bad = |what: &dyn core::fmt::Display| Failure::in_file(EX_DATAERR, path, what);
    let text = crate::cli::read(path, crate::cli::InputKind::Table)?;
    let mut reader =
        csv::ReaderBuilder::new().comment(Some(b'#')).trim(csv::Trim::All).from_reader(text.as_bytes());
    let header = reader.headers().map_err(|e| bad(&e))?.clone();
    let axes = machine.axes();
    // column -> (wire axis, divisor, is a correction) or a coordinate of the tip
    enum Use {
        Axis(usize, f64, bool),
        Tip(usize),
    }
    let mut uses = Vec::with_capacity(header.len());
    for name in &header {
        let of_axis = axes.iter().enumerate().find_map(|(k, axis)| {
            let (position, correction, divisor) = columns(*axis);
            match name {
                n if n == position => Some(Use::Axis(k, 1.0, false)),
                n if n == correction => Some(Use::Axis(k, divisor, true)),
                _ => None,
            }
        });
        let tip = TOOL.iter().position(|t| *t == name).map(Use::Tip);
        match of_axis.or(tip) {
            Some(found) => uses.push(found),
            None => return Err(bad(&format_args!("unknown column {name}"))),
        }
    }
    let mut poses = Vec::new();
    for (row, record) in reader.records().enumerate() {
        let record = record.map_err(|e| bad(&e))?;
        let mut pose = ArtefactPose {
            position: AxisArray::default(),
            correction: AxisArray::default(),
            tip_mm: machine.tool_tip_mm(),
        };
        for (field, used) in record.iter().zip(&uses) {
            let value = field.parse::<f64>().ok().filter(|v| v.is_finite());
            let value =
                value.ok_or_else(|| bad(&format_args!("row {}: invalid number '{field}'", row + 2)))?;
            match used {
                Use::Axis(k, _, false) => pose.position[*k] = value,
                Use::Axis(k, divisor, true) => pose.correction[*k] = value / divisor,
                Use::Tip(i) => pose.tip_mm[*i] = value,
            }
        }
        poses.push(pose);
    }
    if poses.is_empty() {
        return Err(bad(&"no data rows"));
    }
    Ok(poses)
}

/// The plan with what was seen.
fn table(machine: &TruthMachine, plan: &[ArtefactPose], seen: &[[f64; 3]]) -> String {
    let axes = machine.axes();
    let names = axes.iter().map(|a| columns(*a));
    let (positions, corrections): (Vec<String>, Vec<String>) = names.map(|(p, c, _)| (p, c)).unzip();
    let mut text =
        [positions.join(","), TOOL.join(","), corrections.join(",")].join(",") + ",dx_um,dy_um,dz_um\n";
    for (pose, seen) in plan.iter().zip(seen) {
        let mut fields: Vec<String> = Vec::new();
        fields.extend((0..axes.len()).map(|k| format!("{:.9}", pose.position[k])));
        fields.extend(pose.tip_mm.iter().map(|v| format!("{v:.6}")));
        fields.extend(
            axes.iter().enumerate().map(|(k, a)| format!("{:.9}", pose.correction[k] * columns(*a).2)),
        );
        fields.extend(seen.iter().map(|v| format!("{v:.5}")));
        // writing into a string cannot fail
        let _ = writeln!(text, "{}", fields.join(","));
    }
    text
}
