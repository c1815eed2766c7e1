//! Other people's files as sessions: positioning tests, tables of holes, captures of controls, logs of displacement.

use std::collections::BTreeMap;
use std::path::Path;

use clap::Args;

use super::input;
use crate::table;
use crate::{EX_USAGE, Failure};
use volcomp_diagnose::session::Raw;
use volcomp_formats::edge::{self, Header, Row, Sink};
use volcomp_formats::{hole_plate, iso230_dat};
use volcomp_units::axes::{AxisKind, AxisName, Travel};
use volcomp_units::um_from_mm;

/// How files of other programs are read.
#[derive(Debug, Clone, Args)]
pub(crate) struct SourceArgs {
    /// Axis of a positioning test (.dat).
    #[arg(long, value_name = "LETTER", value_parser = super::letter, default_value = "x")]
    axis: AxisName,
    /// Axes of an Edge capture by number, such as x=1,y=2,z=6.
    #[arg(long, value_delimiter = ',', value_name = "AXIS=NUMBER", value_parser = numbered)]
    axes: Vec<(AxisName, u32)>,
    /// Of a capture only the following error of this axis.
    #[arg(long, value_name = "LETTER", value_parser = super::letter)]
    only: Option<AxisName>,
    /// Columns of a log of displacement by direction, such as x=ch1_um,z=ch5_um.
    #[arg(long, value_delimiter = ',', value_name = "DIRECTION=COLUMN", value_parser = directed)]
    series: Vec<(usize, String)>,
}

fn numbered(text: &str) -> Result<(AxisName, u32), String> {
    let wrong = || format!("'{text}' is not AXIS=NUMBER, such as x=1");
    let (axis, number) = text.split_once('=').ok_or_else(wrong)?;
    Ok((super::letter(axis)?, number.parse().map_err(|_| wrong())?))
}

fn directed(text: &str) -> Result<(usize, String), String> {
    let wrong = || format!("'{text}' is not DIRECTION=COLUMN with x, y or z, such as z=ch5_um");
    let (direction, column) = text.split_once('=').ok_or_else(wrong)?;
    let at = ["x", "y", "z"].iter().position(|d| *d == direction).ok_or_else(wrong)?;
    Ok((at, column.to_owned()))
}

/// Rows under construction.
struct Rows {
    raw: Raw,
    names: Vec<String>,
}

impl Rows {
    fn new(path: &Path, names: &[&str]) -> Self {
        let names: Vec<String> = names.iter().map(|n| (*n).to_owned()).collect();
        let raw = Raw {
            file: path.display().to_string(),
            names: names.clone(),
            columns: vec![Vec::new(); names.len()],
            ..Raw::default()
        };
        Self { raw, names }
    }

    fn push(&mut self, line: u64, instrument: &str, values: &[f64]) {
        for (c, v) in self.raw.columns.iter_mut().zip(values) {
            c.push(*v);
        }
        debug_assert_eq!(values.len(), self.names.len(), "a value for each column");
        self.raw.instruments.push(instrument.to_owned());
        self.raw.lines.push(line);
    }
}

/// The session in a file of another program; `None` where it is not one.
pub(super) fn recognised(path: &Path, head: &[u8], args: &SourceArgs) -> Result<Option<Raw>, Failure> {
    if !args.series.is_empty() {
        return series(path, args).map(Some);
    }
    let start = String::from_utf8_lossy(head);
    if start.contains("TGT_DATA[") || start.contains("REF_DATA_") {
        return positioning(path, args.axis).map(Some);
    }
    if hole_plate::recognises(&start) {
        return plate(path).map(Some);
    }
    if edge::recognises(&start) {
        return capture_json(path, args).map(Some);
    }
    if start.lines().next().is_some_and(|l| l.starts_with("CYCLE,") && l.contains("DES_POS|")) {
        return capture(path, args).map(Some);
    }
    Ok(None)
}

/// Seconds between readings of a positioning test, which says nothing of its times.
const STEP_S: f64 = 10.0;

fn positioning(path: &Path, axis: AxisName) -> Result<Raw, Failure> {
    let text = input::text(path)?;
    let test = iso230_dat::parse(&text).map_err(|e| Failure::data(path, e))?;
    let lines = lines_of(&text);
    if test.kind != axis.kind() || axis.kind() != AxisKind::Linear {
        return Err(Failure::usage(format_args!(
            "--axis {axis}: the test in {} is of a linear axis",
            path.display()
        )));
    }
    let mut readings = test.readings;
    // in the order in which it was measured: cycle by cycle, up and down again
    readings.sort_by(|a, b| {
        let way = |r: &volcomp_identify::Reading| r.travel == Travel::Reverse;
        let place = |r: &volcomp_identify::Reading| if way(r) { -r.position } else { r.position };
        a.cycle.cmp(&b.cycle).then(way(a).cmp(&way(b))).then(place(a).total_cmp(&place(b)))
    });
    let column = format!("{}_mm", axis.lower());
    let direction = format!("dir_{}", axis.lower());
    let names = ["t_s", "setup", "run", "repeat", &column, &direction, "u_x", "u_y", "u_z", "deviation_um"];
    let mut rows = Rows::new(path, &names);
    let mut u = [0.0; 3];
    u[axis.direction()] = 1.0;
    for (i, r) in readings.iter().enumerate() {
        let back = r.travel == Travel::Reverse;
        let cycle = f64::from(r.cycle);
        let values = [
            STEP_S * i as f64,
            1.0,
            2.0 * cycle + f64::from(u8::from(back)),
            cycle,
            r.position,
            if back { -1.0 } else { 1.0 },
            u[0],
            u[1],
            u[2],
            um_from_mm(r.value),
        ];
        let line = lines.get(&(back, r.cycle, nanometres(r.position))).copied().unwrap_or(i as u64 + 1);
        rows.push(line, "laser", &values);
    }
    Ok(rows.raw)
}

fn nanometres(mm: f64) -> i64 {
    (mm * 1e6).round() as i64
}

/// Line of every reading of a positioning test, by direction (true is backward), cycle and target.
fn lines_of(text: &str) -> BTreeMap<(bool, u32, i64), u64> {
    let index = |key: &str, stem: &str| -> Option<Vec<u32>> {
        let inner = key.trim().strip_prefix(stem)?.strip_suffix(']')?;
        inner.split(',').map(|n| n.trim().parse().ok()).collect()
    };
    let entries =
        || text.lines().enumerate().filter_map(|(n, l)| l.split_once('=').map(|(k, v)| (n as u64 + 1, k, v)));
    let targets: BTreeMap<u32, i64> = entries()
        .filter_map(|(_, k, v)| {
            Some((*index(k, "TGT_DATA[")?.first()?, nanometres(v.trim().parse::<f64>().ok()?)))
        })
        .collect();
    entries()
        .filter_map(|(line, k, _)| {
            let (back, at) = match index(k, "REF_DATA_FWD[") {
                Some(at) => (false, at),
                None => (true, index(k, "REF_DATA_BWD[")?),
            };
            Some(((back, *at.get(1)?, *targets.get(at.first()?)?), line))
        })
        .collect()
}

fn plate(path: &Path) -> Result<Raw, Failure> {
    let plate = hole_plate::parse(&input::text(path)?).map_err(|e| Failure::data(path, e))?;
    let names =
        ["t_s", "setup", "run", "repeat", "x_mm", "y_mm", "u_x", "u_y", "u_z", "deviation_um", "hole_mm"];
    let mut rows = Rows::new(path, &names);
    for (i, hole) in plate.holes.iter().enumerate() {
        let p = &hole.place;
        for axis in 0..2 {
            let mut u = [0.0; 3];
            u[axis] = 1.0;
            let d = p.measured[axis] - p.nominal[axis];
            let values = [
                i as f64,
                1.0,
                1.0,
                1.0,
                p.nominal[0],
                p.nominal[1],
                u[0],
                u[1],
                u[2],
                um_from_mm(d),
                hole.diameter,
            ];
            rows.push(i as u64 + 1, "cmm", &values);
        }
    }
    Ok(rows.raw)
}

/// Seconds per cycle of a capture that does not say it.
const CYCLE_S: f64 = 0.002;

/// Following errors of a capture: actual minus commanded position of each axis; a gap begins a new run.
struct Capture<'a> {
    args: &'a SourceArgs,
    /// Axis, column of its commanded and of its actual position.
    axes: Vec<(AxisName, usize, usize)>,
    rows: Rows,
}

impl<'a> Capture<'a> {
    /// `find` gives the column of a signal.
    fn new<E>(path: &Path, args: &'a SourceArgs, find: impl Fn(&str) -> Result<usize, E>) -> Result<Self, E> {
        let mut axes = Vec::new();
        for (axis, number) in args.axes.iter().filter(|(a, _)| a.kind() == AxisKind::Linear) {
            axes.push((*axis, find(&format!("DES_POS|{number}"))?, find(&format!("ENC_POS|{number}"))?));
        }
        let positions: Vec<String> = axes.iter().map(|(a, _, _)| format!("{}_mm", a.lower())).collect();
        let mut names = vec!["t_s", "setup", "run", "repeat", "moving", "u_x", "u_y", "u_z", "deviation_um"];
        names.extend(positions.iter().map(String::as_str));
        let rows = Rows::new(path, &names);
        Ok(Self { args, axes, rows })
    }

    fn sample(&mut self, line: u64, t_s: f64, run: f64, value: impl Fn(usize) -> f64) {
        let places: Vec<f64> = self.axes.iter().map(|(_, c, _)| value(*c)).collect();
        if places.iter().any(|p| !p.is_finite()) {
            return;
        }
        for ((axis, _, actual), place) in self.axes.iter().zip(&places) {
            if self.args.only.is_some_and(|o| o != *axis) {
                continue;
            }
            let mut u = [0.0; 3];
            u[axis.direction()] = 1.0;
            let e = um_from_mm(value(*actual) - place);
            let mut values = vec![t_s, 1.0, run, 1.0, 1.0, u[0], u[1], u[2], e];
            values.extend(&places);
            self.rows.push(line, "encoder", &values);
        }
    }
}

fn needs_axes(path: &Path, args: &SourceArgs) -> Result<(), Failure> {
    if args.axes.is_empty() {
        return Err(Failure::new(
            EX_USAGE,
            format_args!("error: {}: a capture needs --axes, such as x=1,y=2,z=6", path.display()),
        ));
    }
    Ok(())
}

/// A capture as a table.
fn capture(path: &Path, args: &SourceArgs) -> Result<Raw, Failure> {
    needs_axes(path, args)?;
    let mut table = table::open(path)?;
    let cycle = table.require("CYCLE")?;
    let mut capture = Capture::new(path, args, |name| table.require(name))?;
    let columns: Vec<usize> = capture.axes.iter().flat_map(|(_, c, a)| [*c, *a]).collect();
    let width = table.columns().len();
    let (mut before, mut run) = (f64::NAN, 1.0);
    while table.advance()? {
        let count = table.number(cycle)?;
        if count - before > 1.5 {
            run += 1.0;
        }
        before = count;
        let mut values = vec![f64::NAN; width];
        for c in &columns {
            values[*c] = table.number(*c)?;
        }
        capture.sample(table.line(), count * CYCLE_S, run, |c| values[c]);
    }
    Ok(capture.rows.raw)
}

/// Takes the rows of a capture as the control writes it.
struct CaptureSink<'a> {
    path: &'a Path,
    args: &'a SourceArgs,
    found: Option<Result<Capture<'a>, String>>,
    count: u64,
}

impl Sink for CaptureSink<'_> {
    fn header(&mut self, header: &Header) -> bool {
        let find =
            |name: &str| header.signals.iter().position(|s| s.name == name).ok_or_else(|| name.to_owned());
        let found = Capture::new(self.path, self.args, find);
        let go_on = found.is_ok();
        self.found = Some(found);
        go_on
    }

    fn row(&mut self, row: Row<'_>) -> bool {
        self.count += 1;
        if let Some(Ok(capture)) = &mut self.found {
            capture.sample(self.count, row.t_s, f64::from(row.segment) + 1.0, |c| row.values[c]);
        }
        true
    }
}

/// A capture as the control writes it, in JSON; lines are counted as rows of data.
fn capture_json(path: &Path, args: &SourceArgs) -> Result<Raw, Failure> {
    needs_axes(path, args)?;
    let source = crate::input::open(path, crate::input::InputKind::Capture)?;
    let mut sink = CaptureSink { path, args, found: None, count: 0 };
    let read = edge::read(source.buffered(), &mut sink);
    if let Some(Err(signal)) = &sink.found {
        return Err(Failure::data(
            path,
            format_args!("no signal {signal}; --axes names axes of the capture"),
        ));
    }
    read.map_err(|e| Failure::data(path, e))?;
    match sink.found {
        Some(Ok(capture)) => Ok(capture.rows.raw),
        _ => Err(Failure::data(path, "no header before the rows")),
    }
}

/// A log of displacement at one place: columns by direction, temperatures `<name>_degC`, `spindle_rpm`.
fn series(path: &Path, args: &SourceArgs) -> Result<Raw, Failure> {
    let mut table = table::open(path)?;
    let t = table.require("t_s")?;
    let mut channels = Vec::new();
    for (direction, column) in &args.series {
        channels.push((*direction, table.require(column)?));
    }
    let mut sources: Vec<(usize, String)> = Vec::new();
    for (i, name) in table.columns().iter().enumerate() {
        let lower = name.to_ascii_lowercase();
        if lower == "spindle_rpm" {
            sources.push((i, lower));
        } else if let Some(sensor) = lower.strip_suffix("_degc") {
            sources.push((i, format!("temp_{}_degc", sensor.trim_start_matches("temp_"))));
        }
    }
    let mut names =
        vec!["t_s", "setup", "run", "repeat", "x_mm", "moving", "u_x", "u_y", "u_z", "deviation_um"];
    names.extend(sources.iter().map(|(_, n)| n.as_str()));
    let mut rows = Rows::new(path, &names);
    while table.advance()? {
        let at = table.number(t)?;
        let mut rest = Vec::with_capacity(sources.len());
        for (i, _) in &sources {
            rest.push(table.number_or_empty(*i)?);
        }
        for (direction, column) in &channels {
            let mut u = [0.0; 3];
            u[*direction] = 1.0;
            let d = table.number_or_empty(*column)?;
            let mut values = vec![at, 1.0, 1.0, 1.0, 0.0, 0.0, u[0], u[1], u[2], d];
            values.extend(&rest);
            rows.push(table.line(), "probe", &values);
        }
    }
    Ok(rows.raw)
}
