//! Logs of the machine as files.

use crate::prelude::*;
use volcomp_diagnose::machine_state::Source;
use volcomp_diagnose::session::{Log, Logs, Note, Series};

/// Reads logs.
pub(super) fn read(paths: &[PathBuf]) -> Result<Logs> {
    let mut logs = Logs::default();
    for path in paths {
        logs.logs.push(read_log(path, &mut logs.notes)?);
    }
    Ok(logs)
}

/// The folder in which a file lies, by its one name; none of what comes from a pipe.
pub(super) fn folder_of(file: &str) -> Option<PathBuf> {
    let parent = Path::new(file).parent().filter(|_| ![table::STDIN, "-"].contains(&file))?;
    let parent = if parent.as_os_str().is_empty() { Path::new(".") } else { parent };
    parent.canonicalize().ok()
}

/// Reads a log; `notes` say what is not used of it.
fn read_log(path: &Path, notes: &mut Vec<Note>) -> Result<Log> {
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
    Ok(Log { folder: folder_of(&file), file, series })
}
