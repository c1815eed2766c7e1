//! The CSV file of a recording: rows with time, cut into parts where the time jumps.

use volcomp_units::axes::AxisArray;

use super::super::axes::MachineAxes;
use super::description::Description;

/// A step of time of more than this many intervals separates two recordings.
const GAP_INTERVALS: f64 = 1.5;

/// One sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Time since the start of its part, s.
    pub time_s: f64,
    /// Commanded, machine coordinates, mm or deg.
    pub commanded: AxisArray,
    /// Actual, machine coordinates, mm or deg.
    pub actual: AxisArray,
    /// Line in the file, 1-based.
    pub line: u32,
}

/// Rows without a gap between them; at least two.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// The rows.
    pub rows: Vec<Row>,
}

/// What is wrong with a recording.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the fields are what the message prints")]
pub enum RecordingError {
    /// Not CSV.
    #[error("{0}")]
    Csv(#[from] csv::Error),
    /// A column is missing.
    #[error("line 1: no column {column:?}; correct the description or the file")]
    Column { column: String },
    /// A cell that is no finite number.
    #[error("line {line}, column {column:?}: {found:?} is no finite number")]
    Number { line: u64, column: String, found: String },
    /// Time that does not go on.
    #[error("line {line}: time {time_s} s is not after {before_s} s of the row before; sort the rows")]
    Time { line: u64, time_s: f64, before_s: f64 },
    /// A recording without two rows in a row.
    #[error("fewer than two rows without a gap from line {line}; remove them or correct interval-s")]
    Short { line: u64 },
    /// The machine lacks an axis.
    #[error("axis {axis} of the recording is not on this machine, which has {axes}; change [axes.*]")]
    NoAxis { axis: char, axes: String },
    /// Outside travel.
    #[error("line {line}: axis {axis} is at {value} (travel {low} to {high}); change its offset")]
    Travel { line: u64, axis: char, value: f64, low: f64, high: f64 },
    /// A cycle time that no control has.
    #[error("{0}")]
    Cycle(#[from] crate::motion::profile::ProfileError),
}

/// Reads a recording; axes that it does not have stand at `rest`.
///
/// # Errors
/// The first thing that is wrong, with its line.
pub fn read_parts(
    text: &str,
    description: &Description,
    axes: &MachineAxes,
    rest: AxisArray,
) -> Result<Vec<Part>, RecordingError> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut reader =
        csv::ReaderBuilder::new().comment(Some(b'#')).trim(csv::Trim::All).from_reader(text.as_bytes());
    let headers = reader.headers()?.clone();
    let find = |column: &str| {
        headers
            .iter()
            .position(|h| h == column)
            .ok_or_else(|| RecordingError::Column { column: column.to_owned() })
    };
    let time = find(&description.time_column)?;
    let mut columns = Vec::new();
    for axis in &description.axes {
        let Some(k) = axes.index(axis.name) else {
            return Err(RecordingError::NoAxis { axis: axis.name.letter(), axes: axes.letters() });
        };
        columns.push((k, find(&axis.commanded)?, find(&axis.actual)?, axis.sign, axis.offset));
    }
    let mut parts: Vec<Part> = Vec::new();
    let mut before_s = f64::NEG_INFINITY;
    let mut origin_s = 0.0;
    for record in reader.records() {
        let record = record?;
        let line = record.position().map_or(0, csv::Position::line);
        let cell = |index: usize| number(&record, &headers, index, line);
        let time_s = cell(time)? * description.time_unit_s;
        if time_s <= before_s {
            return Err(RecordingError::Time { line, time_s, before_s });
        }
        if time_s - before_s > GAP_INTERVALS * description.interval_s {
            parts.push(Part { rows: Vec::new() });
            origin_s = time_s;
        }
        before_s = time_s;
        let mut row = Row {
            time_s: time_s - origin_s,
            commanded: rest,
            actual: rest,
            line: u32::try_from(line).unwrap_or(u32::MAX),
        };
        for &(k, commanded, actual, sign, offset) in &columns {
            row.commanded[k] = sign * cell(commanded)? + offset;
            row.actual[k] = sign * cell(actual)? + offset;
        }
        if let Some((k, value)) = axes.outside(&row.commanded) {
            let axis = &axes.as_slice()[k];
            let [low, high] = axis.travel;
            return Err(RecordingError::Travel { line, axis: axis.name.letter(), value, low, high });
        }
        if let Some(part) = parts.last_mut() {
            part.rows.push(row);
        }
    }
    match parts.iter().find(|p| p.rows.len() < 2) {
        Some(part) => Err(RecordingError::Short { line: part.rows.first().map_or(1, |r| u64::from(r.line)) }),
        None if parts.is_empty() => Err(RecordingError::Short { line: 1 }),
        None => Ok(parts),
    }
}

fn number(
    record: &csv::StringRecord,
    headers: &csv::StringRecord,
    index: usize,
    line: u64,
) -> Result<f64, RecordingError> {
    let found = record.get(index).unwrap_or("");
    match found.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => {
            let column = headers.get(index).unwrap_or("").to_owned();
            Err(RecordingError::Number { line, column, found: found.to_owned() })
        }
    }
}
