//! Laser tests and other positioning tests to `cycle,direction,target_mm,deviation_um`.

use super::{Args, encoding_note, note_list};
use crate::files::Rows;
use crate::positioning_data::parse_dat;
use crate::predict::push_number;
use crate::prelude::*;
use crate::progress::Progress;
use crate::start_up;
use volcomp_evaluate::PositioningReading;
use volcomp_formats::columns::{Columns, Placed, Runs};
use volcomp_formats::detect::Format;
use volcomp_formats::positioning_test::{Order, PositioningTest};
use volcomp_formats::rtl::{self, DeviationUnit, Rtl};
use volcomp_formats::{ReadError, api_pos};

pub(super) fn run(args: &Args, format: Format) -> Result<()> {
    let out = args.out()?;
    if args.model.into.is_some() {
        return Err(Failure::usage(
            "--into is for tables of controls; fit a test with volcomp fit --errors FILE --into MODEL",
        ));
    }
    let mut rows = Rows::create(out)?;
    let mut joined: Option<AxisKind> = None;
    let mut cycles = 0;
    for path in &args.files {
        let file = path.display().to_string();
        let after = cycles;
        let mut sink = |kind: AxisKind, reading: &Reading| {
            if *joined.get_or_insert(kind) != kind {
                return Err(data!(file, "in other units than the files before it; import them apart"));
            }
            // several files are several tests: their cycles follow each other
            let cycle = reading.cycle + after;
            cycles = cycles.max(cycle);
            write(&mut rows, kind, &Reading { cycle, ..*reading })
        };
        if format == Format::Columns {
            columns(args, path, &mut sink)?;
        } else {
            let test = read(args, format, path, &file)?;
            test.readings.iter().try_for_each(|r| sink(test.kind, r))?;
            start_up::report(&file, &test);
        }
    }
    rows.finish()
}

/// Reads a whole test and says what was found.
fn read(args: &Args, format: Format, path: &Path, file: &str) -> Result<PositioningTest> {
    let bytes = input::read(path, InputKind::Instrument)?;
    let decoded = args.decode(file, &bytes)?;
    let encoding = encoding_note(&decoded);
    let test = match format {
        Format::Rtl => {
            let (rtl, mut notes) = rtl::parse(&decoded.text).map_err(|e| format_failure(file, &e))?;
            let unit = args.deviation_unit(&rtl, file)?;
            let (test, more) = rtl.test(unit);
            notes.extend(more);
            note!("{file}: Renishaw laser test (.rtl){encoding}");
            describe_rtl(&rtl);
            for note in &notes {
                note!("  note: {note}");
            }
            test
        }
        Format::ApiPos => {
            let means = api_pos::parse(&decoded.text).map_err(|e| format_failure(file, &e))?;
            note!("{file}: API laser test (.pos){encoding}");
            note!("  note: the file holds means, so repeatability cannot be judged from it");
            if means.bidirectional_only {
                note!("  note: means of both directions only, written as direction 1");
            }
            means.test
        }
        _ => {
            note!("{file}: ISO 230-2 test (.dat){encoding}");
            parse_dat(file, &decoded.text)?
        }
    };
    if let Some(axis) = args.axis.filter(|a| a.kind() != test.kind) {
        let kind = if test.kind == AxisKind::Linear { "millimetres" } else { "degrees" };
        return Err(data!(file, "the test is in {kind}; check --axis {}", axis.lower()));
    }
    if test.readings.is_empty() {
        return Err(data!(file, "no reading"));
    }
    describe(&test);
    Ok(test)
}

impl Args {
    /// The unit of an .rtl: um for a linear axis; for a rotary one it has to be stated.
    fn deviation_unit(&self, rtl: &Rtl, file: &str) -> Result<DeviationUnit> {
        let written = rtl.user("Axis").and_then(|a| a.chars().next()).and_then(AxisName::from_letter);
        let axis = self.axis.or(written);
        match (self.deviation_unit, axis.map(AxisName::kind)) {
            (Some(unit), Some(kind)) if unit.kind() != kind => Err(usage!(
                "{file}: the unit of --deviation-unit does not suit the axis; say which one moved with --axis"
            )),
            (Some(unit), _) => Ok(unit),
            (None, Some(AxisKind::Rotary)) => Err(usage!(
                "{file}: a rotary axis, and the file does not say the unit of its deviations; give --deviation-unit mrad, urad or arcsec"
            )),
            _ => Ok(DeviationUnit::Um),
        }
    }
}

fn describe_rtl(rtl: &Rtl) {
    let about = ["Machine", "Serial No", "Axis", "Date", "By", "Location", "TITLE"].into_iter();
    note_list("", about.filter_map(|k| rtl.user(k).map(|v| format!("{} {v}", k.to_lowercase()))));
    let way = if rtl.is_one_way() { "one way" } else { "both ways" };
    note!("  {} targets, {} runs, {way}", rtl.targets.len(), rtl.run_count);
    let known = [
        ("Air temp", "air", "degC"),
        ("Air press", "pressure", "kPa"),
        ("Air humid", "humidity", "%"),
        ("Mat temp 1", "material 1", "degC"),
        ("Mat temp 2", "material 2", "degC"),
        ("Mat temp 3", "material 3", "degC"),
        ("Exp coeff", "expansion", "ppm/degC"),
    ];
    let environment = known.into_iter().filter_map(|(key, name, unit)| {
        let span = rtl.environment(key)?;
        Some(format!("{name} {:.2} to {:.2} {unit}", span.start, span.end))
    });
    note_list("", environment);
    note_list("sensors that were not there: ", rtl.absent_sensors());
}

/// Range, cycles and directions of a test.
fn describe(test: &PositioningTest) {
    let (positions, _) = volcomp_identify::reading::group_by_position(&test.readings);
    let (Some(low), Some(high)) = (positions.first(), positions.last()) else { return };
    let ([low, high], unit) = ([*low, *high].map(|q| test.kind.position_out(q)), test.kind.position_unit());
    let cycles: BTreeSet<u32> = test.readings.iter().map(|r| r.cycle).collect();
    let reverse = test.readings.iter().filter(|r| r.travel == Travel::Reverse).count();
    let [readings, positions, cycles] = [test.readings.len(), positions.len(), cycles.len()];
    note!(
        "  {readings} readings at {positions} positions from {low} to {high} {unit}, {cycles} cycles, {reverse} of them towards minus"
    );
    let order = match test.order {
        Order::Rows => "rows stand in the order measured",
        Order::StandardCycle => {
            "the file does not state the order between directions: rows stand in the order of the standard test cycle"
        }
    };
    note!("  note: {order}; no time per reading, so that volcomp diagnose takes the times as ordinal");
}

/// Readings of a table that are kept to look for start-up outliers; longer tables are no positioning tests of a standard.
const START_UP_ROWS: usize = 100_000;

/// A table with a column map, row by row.
fn columns(args: &Args, path: &Path, sink: &mut dyn FnMut(AxisKind, &Reading) -> Result<()>) -> Result<()> {
    let file = path.display().to_string();
    let map = args.column_map()?;
    let target = map.output("target").ok_or_else(|| usage!("the map has no output target"))?;
    let value = map.output("deviation").or(map.output("actual")).unwrap_or(target);
    let (cycle, direction) = (map.output("cycle"), map.output("direction"));
    let is_actual = map.output("actual").is_some();
    let kind = match (args.axis.map(AxisName::kind), map.is_angle("target")) {
        (Some(AxisKind::Linear), true) | (Some(AxisKind::Rotary), false) => {
            return Err(usage!("{file}: the unit of target does not suit --axis"));
        }
        (_, true) => AxisKind::Rotary,
        _ => AxisKind::Linear,
    };
    if map.is_angle(if is_actual { "actual" } else { "deviation" }) != (kind == AxisKind::Rotary) {
        return Err(usage!("{file}: target and deviation are of different kinds; check their units"));
    }
    let fail = |e: ReadError| read_failure(path, &e);
    let mut table = Columns::new(input::open(path, InputKind::Table)?.buffered(), map).map_err(fail)?;
    let progress = Progress::of_file(path);
    let mut runs = Runs::default();
    let mut rows = 0u64;
    let mut test = PositioningTest::new(kind, Vec::new(), Vec::new());
    let mut put = |line: u64, cycle, travel, position, value| {
        let reading = Reading { cycle, travel, position, value };
        if test.readings.len() < START_UP_ROWS {
            test.readings.push(reading);
            test.lines.push(line);
        }
        sink(kind, &reading)
    };
    let mut before = 0;
    while table.advance().map_err(fail)? {
        let row = table.values();
        let deviation = if is_actual { row[value] - row[target] } else { row[value] };
        let (cycle, travel) = given(&file, &table, cycle, direction)?;
        if let (Some(cycle), Some(travel)) = (cycle, travel) {
            put(table.line() as u64, cycle, travel, row[target], deviation)?;
        } else {
            // what is not given follows from the order; a given part wins over a derived one
            if let Some(placed) = runs.push(row[target], deviation, cycle, travel) {
                certain(&file, before, &placed, kind)?;
                put(before, placed.cycle, placed.travel, placed.position, placed.value)?;
            }
            before = table.line() as u64;
        }
        rows += 1;
        if rows.is_multiple_of(4096) {
            progress.update(table.bytes());
        }
    }
    if let Some(placed) = runs.finish() {
        certain(&file, before, &placed, kind)?;
        put(before, placed.cycle, placed.travel, placed.position, placed.value)?;
    }
    progress.finish();
    if rows == 0 {
        return Err(data!(file, "no data rows"));
    }
    let derived = match (cycle, direction) {
        (None, None) => "; cycles and directions from the order of the positions",
        (None, Some(_)) => "; cycles from the order of the positions",
        (Some(_), None) => "; directions from the order of the positions",
        _ => "",
    };
    note!("{file}: {rows} readings{derived}");
    note!(
        "  note: rows stand in the order of the file; no time per reading, so that volcomp diagnose takes the times as ordinal"
    );
    if rows <= START_UP_ROWS as u64 {
        start_up::report(&file, &test);
    }
    Ok(())
}

/// Refuses a reading whose direction of approach the order of the rows does not tell.
fn certain(file: &str, line: u64, placed: &Placed, kind: AxisKind) -> Result<()> {
    if placed.is_certain {
        return Ok(());
    }
    let (position, unit) = (kind.position_out(placed.position), kind.position_unit());
    Err(failure!(
        EX_DATAERR,
        "{file}:{line}: target {position} {unit} follows itself and the rows do not turn back here, so that nothing tells from which side \
         it was approached (step cycle?); map a column with 1 (towards plus) or -1, such as \"direction=NAME\" in --columns"
    ))
}

/// Cycle and direction of the current row, where the table has them.
fn given<R: std::io::BufRead>(
    file: &str,
    table: &Columns<R>,
    cycle: Option<usize>,
    direction: Option<usize>,
) -> Result<(Option<u32>, Option<Travel>)> {
    let wrong = |value: f64, what: &str| failure!(EX_DATAERR, "{file}:{}: {value} is {what}", table.line());
    let travel = direction.map(|i| match table.values()[i] {
        1.0 => Ok(Travel::Forward),
        -1.0 => Ok(Travel::Reverse),
        value => Err(wrong(value, "no direction; it is 1 (towards plus) or -1 (towards minus)")),
    });
    let cycle = cycle.map(|i| match table.values()[i] {
        value if value.fract() == 0.0 && (0.0..=4e9).contains(&value) => Ok(value as u32),
        value => Err(wrong(value, "no cycle; it is a whole number from 0 up")),
    });
    Ok((cycle.transpose()?, travel.transpose()?))
}

/// Writes a reading, in front of the first the names of the columns.
fn write(rows: &mut Rows, kind: AxisKind, r: &Reading) -> Result<()> {
    if rows.is_empty() {
        rows.block.extend_from_slice(match kind {
            AxisKind::Linear => b"cycle,direction,target_mm,deviation_um\n",
            AxisKind::Rotary => b"cycle,direction,target_deg,deviation_arcsec\n",
        });
    }
    let PositioningReading { target, deviation, .. } = start_up::in_report_units(kind, r);
    rows.block.extend_from_slice(r.cycle.to_string().as_bytes());
    rows.block.extend_from_slice(if r.travel == Travel::Forward { &b",1"[..] } else { b",-1" });
    push_number(&mut rows.block, target);
    push_number(&mut rows.block, deviation);
    rows.row_end()
}
