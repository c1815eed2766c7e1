//! Logs of the machine, and which of them belong to which session file.

use std::path::PathBuf;

use super::super::moment::Source;
use super::{History, Note, Raw, SessionError};

/// A log that ends this long before the first reading still tells how things stood, s.
const BEFORE_S: f64 = 3600.0;
/// Values of one source at one time that differ by more are not those of one sensor, degC or 1000 per minute.
const SAME_SENSOR: f64 = 0.5;
/// Fewest times at which two series are compared, and the share of them at which they must differ to contradict each other.
const CONTRADICT: (usize, f64) = (3, 0.2);

/// Logs as they were read.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Logs {
    /// In the order in which they were given.
    pub logs: Vec<Log>,
    /// What was not used of them.
    pub notes: Vec<Note>,
}

/// A log.
#[derive(Debug, Clone, PartialEq)]
pub struct Log {
    /// Its name, for messages.
    pub file: String,
    /// The folder in which it lies, by its one name; none of what comes from a pipe.
    pub folder: Option<PathBuf>,
    /// What it tells.
    pub series: Vec<Series>,
}

/// One source of a log, or of the rows of a session; its values are finite and there are some.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    source: Source,
    /// Times (s) and values, in order.
    points: Vec<(f64, f64)>,
}

impl Logs {
    /// The logs of each session file, joined by time. A log belongs to the files whose readings it touches in time and whose
    /// own temperatures it does not contradict: others have another clock. Of logs that contradict each other those in the
    /// folder of the session are its own; `folder_of` gives the folder of a file. Notes say what is not used.
    ///
    /// # Errors
    /// Logs contradict each other, and none of them lies beside the session.
    pub fn of(
        &self,
        raws: &[Raw],
        folder_of: impl Fn(&str) -> Option<PathBuf>,
    ) -> Result<(History, Vec<Note>), SessionError> {
        let (mut history, mut notes) = (History::default(), self.notes.clone());
        for (file, raw) in raws.iter().enumerate() {
            let readings = span(raw);
            for log in self.own(raw, folder_of(&raw.file).as_ref(), readings, &mut notes)? {
                for series in log.series.iter().filter(|s| s.touches(readings)) {
                    history.add(file, series.source.clone(), series.points.iter().copied());
                }
            }
        }
        Ok((history, notes))
    }

    /// The logs of one session file.
    fn own(
        &self,
        raw: &Raw,
        folder: Option<&PathBuf>,
        readings: [f64; 2],
        notes: &mut Vec<Note>,
    ) -> Result<Vec<&Log>, SessionError> {
        let is_beside = |log: &Log| folder.is_some() && log.folder.as_ref() == folder;
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
                    return Err(SessionError::OtherClock {
                        log: log.file.clone(),
                        source_name: source.to_string(),
                        other: other.file.clone(),
                        file: raw.file.clone(),
                    });
                }
            }
        }
        Ok(own)
    }
}

/// First and last time of the readings, s.
fn span(raw: &Raw) -> [f64; 2] {
    let times = raw.column("t_s").unwrap_or(&[]).iter();
    times.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], t| [low.min(*t), high.max(*t)])
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
    let mut pairs = a.iter().flat_map(|a| b.iter().map(move |b| (a, b)));
    pairs.find(|(a, b)| a.is_contradicted_by(b) || b.is_contradicted_by(a)).map(|(a, _)| a.source.clone())
}

impl Series {
    /// The values that are there, in order of time; nothing where there are none.
    pub fn new(source: Source, points: impl Iterator<Item = (f64, f64)>) -> Option<Self> {
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
