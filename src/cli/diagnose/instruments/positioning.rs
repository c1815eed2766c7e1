//! Positioning tests by ISO 230-2: `.dat` of ecmc loggers, Renishaw `.rtl`, API `.pos`, and the table
//! `cycle,direction,target_mm,deviation_um`.

use std::io::Cursor;

use super::{InstrumentArgs, Measurement, Rotary, Rows, along, ways};
use crate::input::text_of;
use crate::positioning_data::{Test, instrument_test, parse_csv};
use crate::prelude::*;
use crate::table::Table;
use volcomp_diagnose::session::Times;
use volcomp_formats::positioning_test::{Order, PositioningTest};
use volcomp_identify::start_up::start_up_outliers;

/// Radius at which the deviations of a rotary axis are given, mm.
const RADIUS_MM: f64 = 100.0;

/// A file of an instrument.
pub(super) fn read(path: &Path, args: &InstrumentArgs) -> Result<Measurement> {
    let bytes = input::read(path, InputKind::Instrument)?;
    let file = path.display().to_string();
    let unit = args.deviation_unit;
    match instrument_test(&file, &bytes, args.axis, unit)? {
        Some(found) => session(path, args, found),
        None => Err(Failure::data(path, "damaged beginning: no positioning test is found in it")),
    }
}

/// The table of docs/reference/tables.md 3.
pub(super) fn table(path: &Path, args: &InstrumentArgs) -> Result<Measurement> {
    let text = text_of(path, input::read(path, InputKind::Table)?)?;
    let test = parse_csv(Table::new(Cursor::new(text), path.display().to_string())?)?;
    let found = Test::new(test, "positioning test (cycle,direction,target,deviation)");
    session(path, args, found)
}

fn session(path: &Path, args: &InstrumentArgs, found: Test) -> Result<Measurement> {
    let (axis, notes) = axis_of(path, args, &found)?;
    let Test { test, format, span_s, notes: more, .. } = found;
    let outliers = start_up_outliers(&test.readings);
    let (times, clock) = clock(&test, span_s);
    let letter = axis.lower();
    let linear = axis.kind() == AxisKind::Linear;
    let column = if linear { format!("{letter}_mm") } else { format!("{letter}_deg") };
    let direction = format!("dir_{letter}");
    let mut names = vec!["t_s", "setup", "run", "repeat", "moving", &column, &direction];
    names.extend(["u_x", "u_y", "u_z", "deviation_um", "outlier"]);
    // a rotary axis moves a point along the next direction: c moves a point on x along y
    let u = along(if linear { axis.direction() } else { (axis.direction() + 2) % 3 });
    let lever =
        if linear { Vec::new() } else { along((axis.direction() + 1) % 3).map(|v| v * RADIUS_MM).to_vec() };
    if !linear {
        names.extend(["lever_x_mm", "lever_y_mm", "lever_z_mm"]);
    }
    let mut rows = Rows::new(path, names);
    let (mut run, mut before) = (0.0, None);
    for (i, r) in test.readings.iter().enumerate() {
        let pass = (r.cycle, r.travel);
        if before.replace(pass) != Some(pass) {
            run += 1.0;
        }
        let sign = if r.travel == Travel::Reverse { -1.0 } else { 1.0 };
        let position = if linear { r.position } else { deg_from_rad(r.position) };
        let deviation = um_from_mm(if linear { r.value } else { r.value * RADIUS_MM });
        let outlier = f64::from(u8::from(outliers.iter().any(|o| o.reading == i)));
        let [x, y, z] = u;
        let mut values =
            vec![clock(i), 1.0, run, f64::from(r.cycle), 0.0, position, sign, x, y, z, deviation, outlier];
        values.extend(&lever);
        rows.push(test.line(i), if linear { "laser" } else { "rotary calibrator" }, &values);
    }
    let mut found = Measurement::new(rows, times, format);
    found.notes = notes.into_iter().chain(more).collect();
    describe(&mut found, &test, axis);
    if times == Times::Nominal {
        found.note("times: start and end of the test spread evenly over the readings");
    }
    if !linear {
        found.rotary = Some(Rotary { axis, radius_mm: RADIUS_MM });
        found.note(format!(
            "deviations of axis {axis} are given as displacement at a radius of {RADIUS_MM} mm (1 arcsec = {:.3} µm)",
            um_from_mm(RADIUS_MM * volcomp_units::rad_from_arcsec(1.0))
        ));
    }
    for o in &outliers {
        let r = &test.readings[o.reading];
        let (scale, unit) = if linear { (1.0, "mm") } else { (RADIUS_MM, "deg") };
        let way = if r.travel == Travel::Reverse { "backward" } else { "forward" };
        let place = if linear { r.position } else { deg_from_rad(r.position) };
        let [apart, limit] = [o.apart, o.limit].map(|v| um_from_mm(v * scale));
        let (line, cycle) = (test.line(o.reading), r.cycle);
        found.note(format!(
            "line {line}: start-up outlier at {place} {unit} {way}, cycle {cycle}: {apart:+.1} µm from the median of the other cycles \
             (limit {limit:.1} µm); kept and treated as an outlier"
        ));
    }
    Ok(found)
}

/// The axis tested: that of --axis, that of the file, else X, with what was assumed.
fn axis_of(path: &Path, args: &InstrumentArgs, found: &Test) -> Result<(AxisName, Vec<String>)> {
    let default = if found.test.kind == AxisKind::Linear { AxisName::X } else { AxisName::C };
    let (axis, notes) = match (args.axis, found.axis) {
        (Some(axis), _) | (None, Some(axis)) => (axis, Vec::new()),
        (None, None) => {
            (default, vec![format!("the file does not name its axis: {default} assumed; --axis states it")])
        }
    };
    if found.test.kind != axis.kind() {
        let (unit, kind) = match found.test.kind {
            AxisKind::Linear => ("millimetres", "a linear"),
            AxisKind::Rotary => ("degrees", "a rotary"),
        };
        let what = format!("the test is in {unit}, axis {axis} does not suit; name {kind} axis with --axis");
        return Err(Failure::data(path, what));
    }
    if volcomp_diagnose::machine_state::Axis::from_name(axis).is_none() {
        return Err(usage!("--axis {axis}: a session has the axes x, y, z, a, b and c"));
    }
    Ok((axis, notes))
}

/// The kind of the times and the time of each reading, s.
fn clock(test: &PositioningTest, span_s: Option<f64>) -> (Times, Box<dyn Fn(usize) -> f64 + '_>) {
    let n = test.readings.len();
    if test.times_s.len() == n {
        return (Times::Measured, Box::new(|i| test.times_s[i]));
    }
    match span_s.filter(|_| n > 1) {
        Some(span) => (Times::Nominal, Box::new(move |i| span * i as f64 / (n - 1) as f64)),
        None => (Times::Ordinal, Box::new(|i| i as f64)),
    }
}

fn describe(found: &mut Measurement, test: &PositioningTest, axis: AxisName) {
    let (positions, _) = volcomp_identify::reading::group_by_position(&test.readings);
    let cycles: BTreeSet<u32> = test.readings.iter().map(|r| r.cycle).collect();
    let ways = ways(test.readings.iter().map(|r| r.travel));
    let (targets, cycles) = (counted(positions.len(), "target"), counted(cycles.len(), "cycle"));
    let readings = counted(test.readings.len(), "reading");
    found.notes.insert(0, format!("axis {axis}, {targets}, {cycles}, {ways}, {readings}"));
    if test.order == Order::StandardCycle {
        found.note(
            "the file is sorted by target or direction: the order of the standard test cycle of ISO 230-2 is assumed, cycle by \
             cycle to the far end and back",
        );
    }
}
