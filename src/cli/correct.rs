//! `volcomp correct`: a part program with corrected positions.

use super::quantities::offset_as_is;
use crate::prelude::*;
use volcomp_formats::part_program::{Corrected, Request, correct};
use volcomp_units::axes::MAX_AXES;

/// Correct the positions of a part program by a model, block by block
///
/// The correction is the one that volcompd applies: nominal minus correction, static model, any chain. Feed blocks are divided
/// where the correction bends. Comments and words without motion pass unchanged. Refused, with file, line and remedy: arcs
/// (G2, G3, G5), incremental mode (G91), cutter compensation (G41, G42), canned cycles, tool length offsets and
/// tool-centre-point motion (G43), inches, subprograms, variables, unknown G codes; and positions or corrections beyond travel
/// or limit.
#[derive(Debug, clap::Parser)]
pub(super) struct Args {
    /// The model file.
    #[arg(long, value_name = "FILE")]
    model: PathBuf,
    /// The part program; - is stdin.
    #[arg(long, value_name = "FILE")]
    gcode: PathBuf,
    /// The corrected program; - is stdout.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Largest distance of the correction within a block from the straight line between its ends, linear axes.
    #[arg(long, value_name = "UM", default_value_t = 0.1, value_parser = above_zero)]
    tolerance_um: f64,
    /// The same for rotary axes.
    #[arg(long, value_name = "ARCSEC", default_value_t = 0.2, value_parser = above_zero)]
    tolerance_arcsec: f64,
    /// Axes that may be corrected, such as a,x,y; default: all of the chain.
    #[arg(long, value_name = "AXES", value_delimiter = ',', value_parser = axis_letter)]
    axes: Vec<AxisName>,
    /// Where an axis stands before the program, in its coordinates (mm, deg), such as z=100; may be repeated.
    #[arg(long, value_name = "AXIS=VALUE", value_parser = at)]
    start: Vec<(AxisName, f64)>,
    /// Machine coordinate minus programmed coordinate (mm, deg), such as x=-350.5; may be repeated.
    #[arg(long, value_name = "AXIS=VALUE", value_parser = at)]
    work_offset: Vec<(AxisName, f64)>,
    /// Largest correction of a linear axis.
    #[arg(long, value_name = "UM", default_value_t = 200.0, value_parser = above_zero)]
    limit_um: f64,
    /// Largest correction of a rotary axis.
    #[arg(long, value_name = "ARCSEC", default_value_t = 200.0, value_parser = above_zero)]
    limit_arcsec: f64,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
}

fn at(text: &str) -> Result<(AxisName, f64), String> {
    let (axis, value) = text
        .split_once('=')
        .ok_or_else(|| format!("invalid AXIS=VALUE '{text}'; write for example x=-350.5"))?;
    Ok((axis_letter(axis)?, number(value)?))
}

pub(super) fn run(args: &Args) -> Result<()> {
    if args.json && args.out.as_os_str() == "-" {
        return Err(Failure::usage("--json and --out - cannot both go to stdout"));
    }
    let (_, model) = read_model(&args.model)?;
    let index = |axis: &AxisName| {
        let found = model.axes().position(|a| a.name == *axis);
        found.ok_or_else(|| usage!("axis {axis} is not in the chain of the model"))
    };
    let mut request = Request {
        model: &model,
        corrected: core::array::from_fn(|k| {
            args.axes.is_empty() && model.axes().nth(k).is_some_and(|a| !a.spindle)
        }),
        start: [None; MAX_AXES],
        work_offset: [0.0; MAX_AXES],
        tolerance: [mm_from_um(args.tolerance_um), rad_from_arcsec(args.tolerance_arcsec)],
        limit: [mm_from_um(args.limit_um), rad_from_arcsec(args.limit_arcsec)],
    };
    for axis in &args.axes {
        request.corrected[index(axis)?] = true;
    }
    for (axis, value) in &args.start {
        request.start[index(axis)?] = Some(axis.kind().position_in(*value));
    }
    for (axis, value) in &args.work_offset {
        request.work_offset[index(axis)?] = axis.kind().position_in(*value);
    }
    let text = input::read_text(&args.gcode, InputKind::PartProgram)?;
    let corrected =
        correct(&text, &request).map_err(|e| failure!(EX_DATAERR, "{}:{e}", args.gcode.display()))?;
    write_text(&args.out, &corrected.text)?;
    for (axis, held) in model.axes().map(|a| a.name).zip(corrected.held) {
        let Some((blocks, line)) = held else { continue };
        let (program, blocks, model) = (args.gcode.display(), counted(blocks, "block"), args.model.display());
        note!(
            "note: {program}: {blocks}, the first in line {line}, beyond the range of a curve of {axis} in the model, whose end value \
             is held there: volcomp check {model} lists the ranges; measure the rest of the travel"
        );
    }
    if args.json {
        say!("{:#}", as_json(&model, &corrected));
    } else if args.out.as_os_str() != "-" {
        print(args, &model, &corrected);
    }
    Ok(())
}

/// Largest correction of every axis: name, unit and value.
fn largest(model: &Model, corrected: &Corrected) -> Vec<(AxisName, &'static str, f64)> {
    let of = |(axis, v): (AxisName, &f64)| (axis, offset_unit(axis), offset_as_is(axis, *v));
    model.axes().map(|a| a.name).zip(&corrected.largest).map(of).collect()
}

fn as_json(model: &Model, corrected: &Corrected) -> Value {
    let mut out = fields!(corrected; blocks, blocks_out, rest_line);
    let held = model.axes().map(|a| a.name).zip(corrected.held).filter_map(|(axis, held)| {
        let (blocks, line) = held?;
        Some(json!({"axis": axis.lower().to_string(), "blocks": blocks, "line": line}))
    });
    out["held"] = held.collect();
    for (axis, unit, value) in largest(model, corrected) {
        out[format!("largest_{}_{unit}", axis.lower())] = json!(value);
    }
    for (direction, rest) in ["x", "y", "z"].into_iter().zip(corrected.rest.iter()) {
        out[format!("rest_{direction}_um")] = json!(um_from_mm(*rest));
    }
    out
}

fn print(args: &Args, model: &Model, corrected: &Corrected) {
    let Corrected { blocks, blocks_out, rest_line, .. } = corrected;
    say!("{}: {blocks} blocks with motion, {blocks_out} after dividing", args.out.display());
    for (axis, unit, value) in largest(model, corrected) {
        say_text!("largest correction of {axis:<2}{value:>10.2} {unit}");
    }
    for (direction, rest) in ["X", "Y", "Z"].into_iter().zip(corrected.rest.iter()) {
        say_text!("largest rest along {direction:<4}{:>10.2} um (workpiece coordinates)", um_from_mm(*rest));
    }
    if *rest_line > 0 {
        say!("largest rest in line {rest_line} of {}", args.gcode.display());
    }
}
