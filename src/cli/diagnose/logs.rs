//! Logs of the machine, and which of them belong to which session file.

use crate::prelude::*;
use volcomp_diagnose::machine_state::Source;
use volcomp_diagnose::session::{History, Note, Raw};

/// A log that ends this long before the first reading still tells how things stood, s.
const BEFORE_S: f64 = 3600.0;
/// Values of one source at one time that differ by more are not those of one sensor, degC or 1000 per minute.
const SAME_SENSOR: f64 = 0.5;
/// Fewest times at which two series are compared, and the share of them at which they must differ to contradict each other.
const CONTRADICT: (usize, f64) = (3, 0.2);

/// Logs as they were read.
pub(super) struct Logs {
    logs: Vec<Log>,
    notes: Vec<Note>,
}

struct Log {
    file: String,
    folder: Option<PathBuf>,
    series: Vec<Series>,
}

/// One source of a log, or of the rows of a session; its values are finite and there are some.
struct Series {
    source: Source,
    points: Vec<(f64, f64)>,
}

impl Logs {
    /// Reads logs.
    pub(super) fn read(paths: &[PathBuf]) -> Result<Self> {
        let mut notes = Vec::new();
        let logs = paths.iter().map(|path| Log::read(path, &mut notes)).collect::<Result<_, _>>()?;
        Ok(Self { logs, notes })
    }

    /// The logs of each session file, joined by time. A log belongs to the files whose readings it touches in time and whose
    /// own temperatures it does not contradict: others have another clock. Of logs that contradict each other those in the
    /// folder of the session are its own. Notes say what is not used.
    pub(super) fn of(&self, raws: &[Raw]) -> Result<(History, Vec<Note>)> {
        let (mut history, mut notes) = (History::default(), self.notes.clone());
        for (file, raw) in raws.iter().enumerate() {
            let readings = span(raw);
            for log in self.own(raw, readings, &mut notes)? {
                for series in log.series.iter().filter(|s| s.touches(readings)) {
                    history.add(file, series.source.clone(), series.points.iter().copied());
                }
            }
        }
        Ok((history, notes))
    }

    /// The logs of one session file.
    fn own(&self, raw: &Raw, readings: [f64; 2], notes: &mut Vec<Note>) -> Result<Vec<&Log>> {
        let folder = folder_of(&raw.file);
        let is_beside = |log: &Log| folder.is_some() && log.folder == folder;
        let mut logs: Vec<&Log> = self.logs.iter().collect();
        logs.sort_by_key(|log| !is_beside(log));
        let rows = temperatures(raw);
        let mut own: Vec<&Log> = Vec::new();
        for log in logs {
            for s in log.series.iter().filter(|s| !s.touches(readings)) {
                let ([from, to], [first, last]) = (s.span(), readings);
                notes.push(Note::new(format!(
                    "{}: {} from {from} to {to} s does not touch the readings of {}, {first} to {last} s, and is not used there: is it on another clock?",
                    log.file, s.source, raw.file
                )));
            }
            if let Some(source) = contradicted(&log.series, &rows) {
                notes.push(Note::new(format!(
                    "{}: {source} contradicts the rows of {}; the log is not used there: is it of another day?",
                    log.file, raw.file
                )));
                continue;
            }
            // those beside the session come first, so that the first one found decides
            let other = own.iter().find_map(|o| contradicted(&o.series, &log.series).map(|s| (*o, s)));
            match other {
                None => own.push(log),
                Some((other, source)) if is_beside(other) && !is_beside(log) => {
                    notes.push(Note::new(format!(
                        "{}: {source} contradicts {}, which lies beside {}; the log is not used there",
                        log.file, other.file, raw.file
                    )))
                }
                Some((other, source)) => {
                    return Err(failure!(
                        EX_DATAERR,
                        "{}: {source} at the same times as in {}, with other values, beside the readings of {}; each seems to have a clock of its own: give those of --fresh files with --fresh-history, diagnose the sessions one by one, or write the values into the columns of their files",
                        log.file,
                        other.file,
                        raw.file
                    ));
                }
            }
        }
        Ok(own)
    }
}

/// The folder in which a file lies, by its one name; none of what comes from a pipe.
fn folder_of(file: &str) -> Option<PathBuf> {
    let parent = Path::new(file).parent().filter(|_| ![table::STDIN, "-"].contains(&file))?;
    let parent = if parent.as_os_str().is_empty() { Path::new(".") } else { parent };
    parent.canonicalize().ok()
}

/// First and last time of the readings, s.
fn span(raw: &Raw) -> [f64; 2] {
    crate::numerals::hull(raw.column("t_s").unwrap_or(&[]).iter().copied())
}

/// What the rows of a session say of temperatures themselves; a spindle that stops for each reading contradicts no log.
fn temperatures(raw: &Raw) -> Vec<Series> {
    let t = raw.column("t_s").unwrap_or(&[]);
    let columns = raw.names.iter().zip(&raw.columns);
    let known =
        columns.filter_map(|(name, values)| Source::of_column(name).map(|(source, _)| (source, values)));
    known
        .filter(|(source, _)| matches!(source, Source::Temperature(_)))
        .filter_map(|(source, values)| Series::new(source, t.iter().copied().zip(values.iter().copied())))
        .collect()
}

/// A source of which one side says other things than the other at the same times.
fn contradicted(a: &[Series], b: &[Series]) -> Option<Source> {
    let pairs = a.iter().flat_map(|a| b.iter().map(move |b| (a, b)));
    pairs
        .into_iter()
        .find(|(a, b)| a.is_contradicted_by(b) || b.is_contradicted_by(a))
        .map(|(a, _)| a.source.clone())
}

impl Series {
    /// The values that are there; nothing where there are none.
    fn new(source: Source, points: impl Iterator<Item = (f64, f64)>) -> Option<Self> {
        let points: Vec<(f64, f64)> = points.filter(|(t, v)| t.is_finite() && v.is_finite()).collect();
        (!points.is_empty()).then_some(Self { source, points })
    }

    fn span(&self) -> [f64; 2] {
        [self.points[0].0, self.points[self.points.len() - 1].0]
    }

    /// True where it tells of some of the readings between two times.
    fn touches(&self, [first, last]: [f64; 2]) -> bool {
        let [from, to] = self.span();
        from <= last && to + BEFORE_S >= first
    }

    fn is_contradicted_by(&self, other: &Self) -> bool {
        if self.source != other.source {
            return false;
        }
        let mut at = 0;
        let (mut apart, mut both) = (0usize, 0usize);
        for (t, v) in &other.points {
            while self.points.get(at + 1).is_some_and(|p| p.0 <= *t) {
                at += 1;
            }
            let (Some(p), Some(q)) = (self.points.get(at), self.points.get(at + 1)) else { break };
            if p.0 <= *t {
                both += 1;
                let (low, high) = (p.1.min(q.1) - SAME_SENSOR, p.1.max(q.1) + SAME_SENSOR);
                apart += usize::from(!(low..=high).contains(v));
            }
        }
        both >= CONTRADICT.0 && apart as f64 > CONTRADICT.1 * both as f64
    }
}

impl Log {
    fn read(path: &Path, notes: &mut Vec<Note>) -> Result<Self> {
        let mut table = table::open(path)?;
        let file = table.file().to_owned();
        let t = table.require("t_s")?;
        let (mut columns, mut unused) = (Vec::new(), Vec::new());
        for (i, column) in table.columns().iter().enumerate().filter(|(i, _)| *i != t) {
            match Source::of_column(column) {
                Some((source, unit)) => columns.push((i, source, unit)),
                None => unused.push(column.clone()),
            }
        }
        if !unused.is_empty() {
            notes.push(Note::new(format!(
                "{file}: {} not used: of a log spindle_rpm and temp_<name>_degc are; positions and forces stand in the rows of a session",
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
        let mut series = Vec::with_capacity(columns.len());
        for (points, (_, source, _)) in points.into_iter().zip(columns) {
            match Series::new(source.clone(), points.into_iter()) {
                Some(s) => series.push(s),
                None => notes.push(Note::new(format!("{file}: {source} has no values"))),
            }
        }
        Ok(Self { folder: folder_of(&file), file, series })
    }
}
