//! Captures and logs to tables over time, and figures to a list.

use std::fmt::Write as _;
use std::io::{self, BufRead, Read, Write};

use super::{Args, encoding_note, note_list};
use crate::files::Rows;
use crate::prelude::*;
use crate::progress::Progress;
use volcomp_formats::columns::Columns;
use volcomp_formats::edge::{self, Gap, Header, Row, Sink, Summary};
use volcomp_formats::{b5r as ballbar, camonitor as epics, rtx as dynamic};

/// The table that is asked for, with its columns.
fn create<'a>(args: &Args, columns: impl Iterator<Item = &'a str>) -> Result<Rows> {
    let mut rows = Rows::create(args.out()?)?;
    put_names(&mut rows, columns);
    Ok(rows)
}

fn put_names<'a>(rows: &mut Rows, columns: impl Iterator<Item = &'a str>) {
    rows.block.extend_from_slice(columns.joined(",").as_bytes());
    rows.block.push(b'\n');
}

/// Numbers with commas between them; nothing where there is none.
fn numbers(rows: &mut Rows, values: impl IntoIterator<Item = f64>) {
    for (i, value) in values.into_iter().enumerate() {
        if i > 0 {
            rows.block.push(b',');
        }
        if !value.is_nan() {
            // writing to memory cannot fail
            let _ = write!(rows.block, "{value}");
        }
    }
}

pub(super) fn rtx(args: &Args, path: &Path) -> Result<()> {
    let mut samples = dynamic::Samples::new(input::open(path, InputKind::Stream)?.buffered())
        .map_err(|e| read_failure(path, &e))?;

    let progress = Progress::of_file(path);
    let name = if args.angular { "angle_mrad" } else { "displacement_mm" };
    let mut table = create(args, ["t_s", name].into_iter())?;
    let rate = samples.header().rate_hz;
    let (mut block, mut done) = (Vec::new(), 0u64);
    while samples.read(&mut block).map_err(|e| read_failure(path, &e))? {
        for value in block.drain(..) {
            numbers(&mut table, [done as f64 / rate, value]);
            table.row_end()?;
            done += 1;
        }
        progress.update(samples.position());
    }
    progress.finish();
    table.finish()?;
    let header = samples.header();
    note!("{}: Renishaw dynamic laser test (.rtx)", path.display());
    let about = ["Machine", "Axis", "Date", "By", "Owner"].into_iter();
    note_list("", about.filter_map(|k| header.text(k).map(|v| format!("{} {v}", k.to_lowercase()))));
    note!("  {done} samples at {rate} Hz, {:.3} s", done.saturating_sub(1) as f64 / rate);
    if !args.angular {
        note!("  note: taken as mm; the file does not say whether it was an angular optic (--angular: mrad)");
    }
    Ok(())
}

/// Tells the progress bar what has been read.
struct Counting<'a, R> {
    source: R,
    bytes: u64,
    progress: &'a Progress,
}

impl<R: Read> Read for Counting<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.source.read(buffer)?;
        self.bytes += read as u64;
        self.progress.update(self.bytes);
        Ok(read)
    }
}

/// Rows of a capture to a table.
struct Capture<'a> {
    args: &'a Args,
    table: Rows,
    /// Columns that are kept.
    kept: Vec<usize>,
    problem: Option<Failure>,
}

impl Capture<'_> {
    /// Name of the column of a signal, `None` where it is not wanted.
    fn name(&self, signal: &edge::Signal) -> Option<String> {
        let Some((name, number)) = signal.of_axis() else {
            return Some(signal.name.to_lowercase().replace('|', "_"));
        };
        let name = name.to_lowercase();
        if self.args.axes.is_empty() {
            let unit = if signal.is_position() { "_mm_or_deg" } else { "" };
            return Some(format!("{name}_{number}{unit}"));
        }
        let (axis, _) = self.args.axes.iter().find(|(_, n)| *n == number)?;
        let unit = match (signal.is_position(), axis.kind()) {
            (true, AxisKind::Linear) => "_mm",
            (true, AxisKind::Rotary) => "_deg",
            (false, _) => "",
        };
        Some(format!("{}_{name}{unit}", axis.lower()))
    }
}

impl Sink for Capture<'_> {
    fn header(&mut self, header: &Header) -> bool {
        let numbers: Vec<u32> = header.signals.iter().filter_map(|s| s.of_axis().map(|(_, n)| n)).collect();
        if let Some((axis, number)) = self.args.axes.iter().find(|(_, n)| !numbers.contains(n)) {
            let mut known = numbers;
            known.sort_unstable();
            known.dedup();
            let what = format_args!("--axes {}={number}: the capture has axes {known:?}", axis.lower());
            self.problem = Some(Failure::usage(what));
            return false;
        }
        let mut names = vec!["t_s".to_owned(), "segment".to_owned()];
        for (i, signal) in header.signals.iter().enumerate() {
            if let Some(name) = self.name(signal) {
                self.kept.push(i);
                // a name from the file may hold a comma or a quote
                names.push(name.chars().map(|c| if c.is_alphanumeric() { c } else { '_' }).collect());
            }
        }
        put_names(&mut self.table, names.iter().map(String::as_str));
        true
    }

    fn row(&mut self, row: Row<'_>) -> bool {
        let kept = self.kept.iter().map(|i| row.values[*i]);
        numbers(&mut self.table, [row.t_s, f64::from(row.segment)].into_iter().chain(kept));
        self.problem = self.table.row_end().err();
        self.problem.is_none()
    }
}

pub(super) fn edge(args: &Args, path: &Path) -> Result<()> {
    let mut source = input::open(path, InputKind::Capture)?.buffered();
    if source.fill_buf().map_err(|e| Failure::io(path, &e))?.starts_with(b"\xef\xbb\xbf") {
        source.consume(3);
    }
    let progress = Progress::of_file(path);
    let mut capture = Capture { args, table: Rows::create(args.out()?)?, kept: Vec::new(), problem: None };
    let counting = Counting { source, bytes: 0, progress: &progress };
    let read = edge::read(io::BufReader::with_capacity(1 << 16, counting), &mut capture);
    progress.finish();
    if let Some(problem) = capture.problem {
        return Err(problem);
    }
    let summary = read.map_err(|e| read_failure(path, &e))?;
    capture.table.finish()?;
    describe_edge(args, path, &summary);
    Ok(())
}

fn describe_edge(args: &Args, path: &Path, summary: &Summary) {
    let header = &summary.header;
    note!("{}: SINUMERIK Edge capture", path.display());
    if let Some(machine) = header.machine() {
        let time = header.time_stamp.as_deref().unwrap_or("at an unknown time");
        note!("  machine {machine}, recorded {time}");
    }
    let Summary { rows, duration_s, .. } = summary;
    let (signals, cycle_ms) = (header.signals.len(), header.cycle_ms);
    note!("  {rows} rows of {signals} signals every {cycle_ms} ms, {duration_s:.3} s from first to last");
    let axes: BTreeSet<(u32, &str)> =
        header.signals.iter().filter_map(|s| s.of_axis().map(|(_, n)| (n, s.axis.as_str()))).collect();
    note!("  axes {}", axes.iter().map(|(n, name)| format!("{n} ({name})")).joined(", "));
    for Gap { missing_cycles, after_rows, .. } in &summary.gaps {
        let lost = *missing_cycles as f64 * cycle_ms / 1e3;
        note!(
            "  gap: {missing_cycles} cycles ({lost:.3} s) missing after row {after_rows}; never differentiate across it, segment goes up there"
        );
    }
    if header.cycle_column().is_none() {
        note!("  note: no signal CYCLE, so gaps cannot be seen; time counts rows");
    }
    if args.axes.is_empty() {
        note!(
            "  note: the letters of the axes need not say how they move; name those you want with --axes, such as --axes x=1,c=4"
        );
    }
    note_list("not kept: ", summary.events.iter().map(|(name, n)| format!("{n} {name}")));
}

pub(super) fn camonitor(args: &Args, path: &Path) -> Result<()> {
    let mut log = epics::Log::new(input::open(path, InputKind::Stream)?.buffered());

    let progress = Progress::of_file(path);
    let mut table = create(args, ["t_s", "pv", "value", "alarm"].into_iter())?;
    let (mut rows, mut pvs) = (0u64, BTreeSet::new());
    while log.advance().map_err(|e| read_failure(path, &e))? {
        let change = log.change();
        if pvs.len() < 10_000 && !pvs.contains(&change.pv) {
            pvs.insert(change.pv.clone());
        }
        numbers(&mut table, [change.t_s]);
        let clean = |t: &str| t.replace(['"', ','], "_");
        for text in [clean(&change.pv), change.value.to_string(), clean(&change.alarm)] {
            table.block.push(b',');
            table.block.extend_from_slice(text.as_bytes());
        }
        table.row_end()?;
        rows += 1;
        progress.update(log.bytes());
    }
    progress.finish();
    if rows == 0 {
        return Err(data!(path, "no change of a value"));
    }
    table.finish()?;
    note!("{}: EPICS camonitor log, {rows} changes of {} values", path.display(), pvs.len());
    if log.unconnected > 0 {
        note!("  note: {} lines about connections left out", log.unconnected);
    }
    note!("  note: t_s counts from the first line; the first stamp of each value may be older than the log");
    Ok(())
}

pub(super) fn columns(args: &Args, path: &Path) -> Result<()> {
    let map = args.column_map()?;
    let mut source = Columns::new(input::open(path, InputKind::Stream)?.buffered(), map)
        .map_err(|e| read_failure(path, &e))?;

    let progress = Progress::of_file(path);
    let mut table = create(args, source.names())?;
    let mut rows = 0u64;
    while source.advance().map_err(|e| read_failure(path, &e))? {
        numbers(&mut table, source.values().iter().copied());
        table.row_end()?;
        rows += 1;
        progress.update(source.bytes());
    }
    progress.finish();
    if rows == 0 {
        return Err(data!(path, "no data rows"));
    }
    table.finish()?;
    note!("{}: {rows} rows", path.display());
    Ok(())
}

pub(super) fn b5r(args: &Args, path: &Path) -> Result<()> {
    let file = path.display().to_string();
    let bytes = input::read(path, InputKind::Instrument)?;
    let decoded = args.decode(&file, &bytes)?;
    let test = ballbar::parse(&decoded.text).map_err(|e| format_failure(&file, &e))?;
    let out = args.out()?;
    let json = out.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
    let text = if json {
        let about: Value =
            test.about.iter().map(|(k, v)| (k.replace(' ', "_"), Value::from(v.as_str()))).collect();
        let features = test.features.iter();
        let features: Value = features
            .map(|f| json!({"feature": f.name, "value": f.value, "unit": f.unit, "type": f.data_type}))
            .collect();
        format!("{:#}\n", json!({"plane": test.plane, "about": about, "features": features}))
    } else {
        let mut text = String::from("feature,value,unit\n");
        for f in &test.features {
            let name = f.name.replace(['"', ',', '\n'], "_");
            // writing to a String cannot fail
            let _ = writeln!(text, "{name},{},{}", f.value, f.unit.unwrap_or(""));
        }
        text
    };
    write_text(out, &text)?;
    note!("{file}: Renishaw ballbar test (.b5r){}", encoding_note(&decoded));
    if let Some(plane) = &test.plane {
        note!("  plane {plane}");
    }
    note_list("", test.about.iter().map(|(k, v)| format!("{k} {v}")));
    note!("  {} figures; raw samples are not read", test.features.len());
    let unknown = test.features.iter().filter(|f| f.unit.is_none()).count();
    if unknown > 0 {
        note!("  note: {unknown} figures of a type whose unit is not known");
    }
    Ok(())
}
