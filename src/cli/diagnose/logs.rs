//! Logs of the machine, and which of them belong to which session file.

use std::path::{Path, PathBuf};

use crate::cli::table;
use crate::cli::{EX_DATAERR, Failure};
use crate::diagnose::moment::Source;
use crate::diagnose::session::{History, Note, Raw};

/// A log that ends this long before the first reading still tells how things stood, s.
const BEFORE_S: f64 = 3600.0;
/// Values of one source at one time that differ by more are not those of one sensor, degC or 1000 per minute.
const SAME_SENSOR: f64 = 0.5;

/// One source of one log, or of the rows of a session.
struct Series {
    file: String,
    source: Source,
    points: Vec<(f64, f64)>,
}

impl Series {
    fn span(&self) -> [f64; 2] {
        [self.points.first().map_or(0.0, |p| p.0), self.points.last().map_or(0.0, |p| p.0)]
    }

    fn is_beside(&self, file: &str) -> bool {
        Path::new(&self.file).parent() == Path::new(file).parent()
    }
}

/// Logs, joined by time. A log belongs to the files whose readings it touches in time and whose own columns it does not
/// contradict: others have another clock. Of logs that contradict each other the one beside the file is its own. Notes say
/// what is not used.
pub(super) fn history(paths: &[PathBuf], raws: &[Raw]) -> Result<(History, Vec<Note>), Failure> {
    let (mut all, mut notes) = (Vec::new(), Vec::new());
    for path in paths {
        all.extend(log(path, &mut notes)?);
    }
    let mut history = History::default();
    for (file, raw) in raws.iter().enumerate() {
        let t = raw.column("t_s").unwrap_or(&[]);
        let (first, last) =
            t.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
        let rows = of_rows(raw);
        let mut taken: Vec<&Series> = Vec::new();
        for series in &all {
            let [from, to] = series.span();
            if from > last || to + BEFORE_S < first {
                notes.push(Note::new(format!(
                    "{}: {} from {from} to {to} s does not touch the readings of {}, {first} to {last} s, and is not used there: is it on another clock?",
                    series.file, series.source, raw.file
                )));
                continue;
            }
            if rows.iter().any(|own| contradict(series, own)) {
                notes.push(Note::new(format!(
                    "{}: {} contradicts the rows of {} and is not used there: is it of another day?",
                    series.file, series.source, raw.file
                )));
                continue;
            }
            let other = taken.iter().position(|o| contradict(o, series));
            match other.map(|at| (at, taken[at].is_beside(&raw.file), series.is_beside(&raw.file))) {
                None => taken.push(series),
                Some((_, true, false)) => {}
                Some((at, false, true)) => taken[at] = series,
                Some((at, ..)) => {
                    return Err(Failure::new(
                        EX_DATAERR,
                        format_args!(
                            "error: {}: {} at the same times as in {}, with other values, beside the readings of {}; each seems to have a clock of its own: give those of --fresh files with --fresh-history, diagnose the sessions one by one, or write the values into the columns of their files",
                            series.file, series.source, taken[at].file, raw.file
                        ),
                    ));
                }
            }
        }
        for series in taken {
            history.add(file, series.source.clone(), series.points.iter().copied());
        }
    }
    Ok((history, notes))
}

/// A column of a log or of a session that tells of a source, and what one of its units is of that source.
fn source_of(column: &str) -> Option<(Source, f64)> {
    let sensor = column.strip_prefix("temp_").and_then(|n| n.strip_suffix("_degc"));
    match sensor {
        _ if column == "spindle_rpm" => Some((Source::Spindle, 1e-3)),
        Some(sensor) => Some((Source::Temperature(sensor.to_owned()), 1.0)),
        None => None,
    }
}

/// What the rows of a session say themselves.
fn of_rows(raw: &Raw) -> Vec<Series> {
    let t = raw.column("t_s").unwrap_or(&[]);
    let columns = raw.names.iter().zip(&raw.columns);
    let known = columns.filter_map(|(name, values)| source_of(name).map(|known| (known, values)));
    let series = known.map(|((source, unit), values)| {
        let points = t.iter().copied().zip(values.iter().map(|v| v * unit)).collect();
        Series { file: raw.file.clone(), source, points }
    });
    series.collect()
}

/// True where the second says other things of one source than the first at the same times.
fn contradict(a: &Series, b: &Series) -> bool {
    if a.source != b.source {
        return false;
    }
    let mut at = 0;
    let (mut apart, mut both) = (0usize, 0usize);
    for (t, v) in &b.points {
        while a.points.get(at + 1).is_some_and(|p| p.0 <= *t) {
            at += 1;
        }
        let (Some(p), Some(q)) = (a.points.get(at), a.points.get(at + 1)) else { break };
        if p.0 <= *t && p.1.is_finite() && v.is_finite() {
            both += 1;
            let (low, high) = (p.1.min(q.1) - SAME_SENSOR, p.1.max(q.1) + SAME_SENSOR);
            apart += usize::from(!(low..=high).contains(v));
        }
    }
    both > 2 && 5 * apart > both
}

/// One log.
fn log(path: &Path, notes: &mut Vec<Note>) -> Result<Vec<Series>, Failure> {
    let name = path.display().to_string();
    let mut table = table::open(path)?;
    let t = table.require("t_s")?;
    let (mut columns, mut unused) = (Vec::new(), Vec::new());
    for (i, column) in table.columns().iter().enumerate().filter(|(i, _)| *i != t) {
        match source_of(column) {
            Some((source, unit)) => columns.push((i, source, unit)),
            None => unused.push(column.clone()),
        }
    }
    if !unused.is_empty() {
        notes.push(Note::new(format!(
            "{name}: {} not used: of a log spindle_rpm and temp_<name>_degc are; positions and forces stand in the rows of a session",
            unused.join(", ")
        )));
    }
    let mut points: Vec<Vec<(f64, f64)>> = vec![Vec::new(); columns.len()];
    let mut before = f64::NEG_INFINITY;
    while table.advance()? {
        let at = table.number(t)?;
        if at < before {
            return Err(table.fail(t, format_args!("time goes back from {before} to {at}; sort the log")));
        }
        before = at;
        for (p, (i, _, unit)) in points.iter_mut().zip(&columns) {
            p.push((at, table.number_or_empty(*i)? * unit));
        }
    }
    let series = points.into_iter().zip(columns);
    Ok(series.map(|(points, (_, source, _))| Series { file: name.clone(), source, points }).collect())
}
