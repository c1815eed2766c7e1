//! Logs of displacement at one position, such as a spindle that warms up (ISO 230-3): a table over time with columns of
//! displacement in um, temperatures `<name>_degC` or `<name> [°C]`, and `spindle_rpm`.

use super::{InstrumentArgs, Measurement, Rows, along};
use crate::prelude::*;
use volcomp_diagnose::session::Times;
use volcomp_formats::columns::date_time_s;

/// Names of a column of times, in seconds or as dates with times.
const TIMES: [&str; 5] = ["t_s", "time_s", "time", "timestamp", "datetime"];

/// True for the columns of such a log: times and displacements, with something that explains them or nothing else.
pub(super) fn is_log(header: &[&str]) -> bool {
    let driven = |c: &str| is_speed(c) || sensor(c).is_some();
    let Some(time) = time_of(header.iter().copied()) else { return false };
    let rest = || header.iter().enumerate().filter(|(i, _)| *i != time).map(|(_, c)| *c);
    rest().any(is_displacement) && (rest().any(driven) || rest().all(is_displacement))
}

/// Place of the column of times.
fn time_of<'a>(columns: impl Iterator<Item = &'a str> + Clone) -> Option<usize> {
    TIMES.iter().find_map(|name| columns.clone().position(|c| c.trim().eq_ignore_ascii_case(name)))
}

fn is_speed(column: &str) -> bool {
    column.eq_ignore_ascii_case("spindle_rpm")
}

fn is_displacement(column: &str) -> bool {
    column.len() > 3 && column.to_ascii_lowercase().ends_with("_um")
}

/// Name of the sensor of a column of temperature: `t_nose_degC`, `temp_bed_degC`, `nose [°C]`.
fn sensor(column: &str) -> Option<String> {
    let lower = column.to_lowercase();
    let unit = ["_degc", "[degc]", "(degc)", "_°c", "[°c]", "(°c)"];
    let stem = unit.iter().find_map(|unit| lower.strip_suffix(unit))?;
    let name = stem.trim().trim_start_matches("temp_").replace(' ', "_");
    Some(name).filter(|s| !s.is_empty())
}

/// Directions of the channels by name (`x_um`, `dy_um`, `z1_um`), else as a nest of probes has them.
fn directions(path: &Path, channels: &[String]) -> Result<(Vec<(usize, String)>, String)> {
    let named = |column: &String| {
        let stem = column.to_ascii_lowercase();
        let stem = stem.trim_end_matches("_um").trim_start_matches(['d', 'e']);
        let letter = stem.chars().next()?;
        let rest_is_number = stem.chars().skip(1).all(|c| c.is_ascii_digit());
        ['x', 'y', 'z'].iter().position(|d| *d == letter).filter(|_| rest_is_number)
    };
    let by_name: Option<Vec<usize>> = channels.iter().map(named).collect();
    let (found, how) = match (by_name, channels.len()) {
        (Some(all), _) => (all, "by their names"),
        (None, 5) => {
            (vec![0, 0, 1, 1, 2], "as the five probes of ISO 230-3 (two along x, two along y, one along z)")
        }
        (None, 3) => (vec![0, 1, 2], "as three probes along x, y and z"),
        (None, 1) => (vec![2], "as an axial probe"),
        (None, n) => {
            let (file, all, first, last) =
                (path.display(), channels.join(", "), &channels[0], &channels[n - 1]);
            return Err(usage!(
                "{file}: {n} columns of displacement ({all}) whose directions are not known; name those to use with --series, such \
                 as x={first},z={last}"
            ));
        }
    };
    let list =
        channels.iter().zip(&found).map(|(c, d)| format!("{c} along {}", ["x", "y", "z"][*d])).joined(", ");
    let note = format!("directions assumed {how}: {list}; --series states them");
    Ok((found.into_iter().zip(channels.iter().cloned()).collect(), note))
}

pub(super) fn read(path: &Path, args: &InstrumentArgs) -> Result<Measurement> {
    let mut table = table::open(path)?;
    let names = table.columns().iter().map(String::as_str);
    let t = time_of(names).map_or_else(|| table.require(TIMES[0]), Ok)?;
    let mut notes = Vec::new();
    if !table.columns()[t].ends_with("_s") {
        notes.push(format!("column {}: dates with times, or seconds", table.columns()[t]));
    }
    let channels = if args.series.is_empty() {
        let all: Vec<String> = table.columns().iter().filter(|c| is_displacement(c)).cloned().collect();
        let (channels, note) = directions(path, &all)?;
        notes.push(note);
        channels
    } else {
        args.series.clone()
    };
    let mut columns = Vec::with_capacity(channels.len());
    for (direction, column) in &channels {
        columns.push((*direction, table.require(column)?, column.trim_end_matches("_um").to_owned()));
    }
    let mut sources: Vec<(usize, String)> = Vec::new();
    for (i, name) in table.columns().iter().enumerate() {
        if is_speed(name) {
            sources.push((i, name.to_ascii_lowercase()));
        } else if let Some(sensor) = sensor(name) {
            sources.push((i, format!("temp_{sensor}_degc")));
        }
    }
    let is_read =
        |i: usize| i == t || columns.iter().any(|(_, c, _)| *c == i) || sources.iter().any(|(c, _)| *c == i);
    let unused =
        table.columns().iter().enumerate().filter(|(i, _)| !is_read(*i)).map(|(_, n)| n).joined(", ");
    if !unused.is_empty() {
        notes.push(format!("columns not used: {unused}"));
    }
    let mut names =
        vec!["t_s", "setup", "run", "repeat", "x_mm", "moving", "u_x", "u_y", "u_z", "deviation_um"];
    names.extend(sources.iter().map(|(_, n)| n.as_str()));
    let mut rows = Rows::new(path, names);
    let mut start_s = None;
    while table.advance()? {
        let at = match date_time_s(&table.word(t)) {
            Some(s) => s - *start_s.get_or_insert(s),
            None => table.number(t)?,
        };
        let rest = sources.iter().map(|(i, _)| table.number_or_empty(*i));
        let rest: Vec<f64> = rest.collect::<Result<_, _>>()?;
        for (setup, (direction, column, name)) in columns.iter().enumerate() {
            let [x, y, z] = along(*direction);
            let d = table.number_or_empty(*column)?;
            // every probe has a zero and a noise of its own
            let mut values = vec![at, setup as f64 + 1.0, 1.0, 1.0, 0.0, 0.0, x, y, z, d];
            values.extend(&rest);
            let instrument = if columns.len() == 1 { "probe".to_owned() } else { format!("probe {name}") };
            rows.push(table.line(), &instrument, &values);
        }
    }
    let samples = rows.raw.len() / columns.len().max(1);
    let mut found = Measurement::new(rows, Times::Measured, "log of displacement at one position");
    let heat = sources.iter().filter(|(_, n)| n.starts_with("temp_")).count();
    let spindle = if sources.len() > heat { ", spindle speed" } else { "" };
    let (samples, probes) = (counted(samples, "sample"), counted(columns.len(), "probe"));
    let heat = counted(heat, "temperature");
    found.note(format!("{samples} of {probes}, {heat}{spindle}; the machine stands at one position"));
    found.notes.extend(notes);
    Ok(found)
}
