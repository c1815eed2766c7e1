//! Tables of controls to a model.

use super::{Args, encoding_note};
use crate::prelude::*;
use volcomp_formats::axis_table::positioning_symbol;
use volcomp_formats::detect::Format;
use volcomp_formats::{heidenhain, isg, isg_lis, linuxcnc};

pub(super) fn run(args: &Args, format: Format) -> Result<()> {
    if args.model.target().is_none() {
        return Err(Failure::usage(
            "neither --out nor --into is given; a table of a control becomes a model file",
        ));
    }
    let mut model = args.model.base(|| default_chain(args.axis))?;
    let mut seen: Vec<ErrorSymbol> = Vec::new();
    let sources = Sources::of(&args.files);
    for (index, path) in args.files.iter().enumerate() {
        for (symbol, function) in read(args, format, &model, path)? {
            if seen.contains(&symbol) {
                return Err(data!(path, "{symbol} was in a file before it; import one of the two"));
            }
            seen.push(symbol);
            refuse_other_reference(&model, symbol, format, path)?;
            describe(symbol, &function);
            model.put(symbol, function, sources.only(|i| i == index).provenance());
        }
    }
    args.model.write(&model, &sources.comments(), &args.files)
}

/// Errors with their functions.
type Errors = Vec<(ErrorSymbol, ErrorFunction)>;

fn read(args: &Args, format: Format, model: &ModelFile, path: &Path) -> Result<Errors> {
    let file = &path.display().to_string();
    let bytes = input::read(path, InputKind::Instrument)?;
    let decoded = args.decode(file, &bytes)?;
    let (text, encoding) = (&decoded.text, encoding_note(&decoded));
    let axis =
        || args.axis.ok_or_else(|| usage!("{file}: the file does not say whose table it is; give --axis"));
    let fail = |e| format_failure(file, &e);
    match format {
        Format::Isg => {
            let tables = isg::parse(text, &model.spec.chain, args.control.sense).map_err(fail)?;
            note!("{file}: ISG volumetric compensation{encoding}, {} errors", tables.errors.len());
            if !tables.kinematics.is_empty() {
                let names = tables.kinematics.join(" ");
                note!("  note: {names} describe the control's kinematics and are no errors; left out");
            }
            Ok(tables.errors)
        }
        Format::IsgLis => {
            let axis = axis()?;
            // um to mm; for a rotary axis thousandths of a degree
            let increment = args.increment_um.map(|um| um / 1e3);
            let found = isg_lis::parse(text, axis.kind(), increment).map_err(fail)?;
            note!("{file}: ISG leadscrew compensation{encoding}");
            Ok(vec![(positioning_symbol(axis), found)])
        }
        Format::Heidenhain => {
            let table = heidenhain::parse(text, axis()?, args.control.sign).map_err(fail)?;
            note!("{file}: Heidenhain compensation table (.COM){encoding}");
            if table.backlash_empty {
                note!("  note: BACKLASH holds zeros only and is taken as not filled in");
            }
            Ok(table.errors)
        }
        _ => {
            let axis = axis()?;
            let kind = args.control.comp_type.ok_or_else(|| {
                usage!("{file}: the file does not say what its columns are; give --comp-type 0 (actual positions) or 1 (trims), as COMP_FILE_TYPE of the INI file")
            })?;
            let found = linuxcnc::parse(text, axis.kind(), kind, args.control.linear_unit()).map_err(fail)?;
            note!("{file}: LinuxCNC screw compensation{encoding}");
            Ok(vec![(positioning_symbol(axis), found)])
        }
    }
}

/// Tables hold values in the relative sense, those of ISG at the origin: a model that means something else by its numbers
/// would take them for something else.
fn refuse_other_reference(model: &ModelFile, symbol: ErrorSymbol, format: Format, file: &Path) -> Result<()> {
    if symbol.is_constant() {
        return Ok(());
    }
    let axis = model.spec.axis(symbol.axis());
    if model.spec.is_mirrored(axis.name) {
        return Err(data!(
            file,
            "axis {} of the model is in the carriage sense, the table in the relative one; import into a model in the relative sense",
            axis.name
        ));
    }
    let elsewhere = axis.reference_points.iter().any(|r| r.point != Vec3::zeros());
    if format == Format::Isg && axis.name.kind() == AxisKind::Linear && elsewhere {
        return Err(data!(
            file,
            "axis {} of the model has reference points, the table is referred to the origin; import into a model without them",
            axis.name
        ));
    }
    Ok(())
}

fn describe(symbol: ErrorSymbol, function: &ErrorFunction) {
    let range = |axis: AxisName, low: f64, high: f64| match axis.kind() {
        AxisKind::Linear => format!("{low} to {high} mm"),
        AxisKind::Rotary => format!("{:.4} to {:.4} deg", deg_from_rad(low), deg_from_rad(high)),
    };
    for curve in &function.curves {
        match curve {
            Curve::Table(t) => {
                let (positions, _, reverse) = t.columns();
                let ways = if reverse.is_some() { ", both directions" } else { "" };
                let [low, high] = t.range();
                note!("  {symbol}: {} points, {}{ways}", positions.len(), range(symbol.axis(), low, high));
            }
            _ => note!("  {symbol}: constant"),
        }
    }
    for grid in &function.grids {
        let axes = grid.axes().enumerate().map(|(i, a)| format!("{} along {a}", grid.positions(i).len()));
        note!("  {symbol}: grid, {}", axes.joined(", "));
    }
}
