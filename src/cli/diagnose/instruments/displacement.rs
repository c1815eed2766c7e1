//! Logs of displacement at one position, such as a spindle that warms up (ISO 230-3): a table over time with columns of
//! displacement in um, temperatures `<name>_degC` and `spindle_rpm`.

use std::path::Path;

use super::{InstrumentArgs, Measurement, Rows, along};
use crate::numerals::counted;
use crate::{Failure, table};
use volcomp_diagnose::session::Times;

/// True for the columns of such a log: displacements and something that explains them.
pub(super) fn is_log(header: &[&str]) -> bool {
    let driven = |c: &str| c.eq_ignore_ascii_case("spindle_rpm") || sensor(c).is_some();
    header.iter().any(|c| is_displacement(c)) && header.iter().any(|c| driven(c))
}

fn is_displacement(column: &str) -> bool {
    column.len() > 3 && column.to_ascii_lowercase().ends_with("_um")
}

/// Name of the sensor of a column of temperature.
fn sensor(column: &str) -> Option<String> {
    let lower = column.to_ascii_lowercase();
    lower.strip_suffix("_degc").map(|s| s.trim_start_matches("temp_").to_owned()).filter(|s| !s.is_empty())
}

/// Directions of the channels by name (`x_um`, `dy_um`, `z1_um`), else as a nest of probes has them.
fn directions(path: &Path, channels: &[String]) -> Result<(Vec<(usize, String)>, String), Failure> {
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
            return Err(usage!(
                "{}: {n} columns of displacement ({}) whose directions are not known; name those to use with --series, such as \
                 x={},z={}",
                path.display(),
                channels.join(", "),
                channels[0],
                channels[n - 1]
            ));
        }
    };
    let list: Vec<String> =
        channels.iter().zip(&found).map(|(c, d)| format!("{c} along {}", ["x", "y", "z"][*d])).collect();
    let note = format!("directions assumed {how}: {}; --series states them", list.join(", "));
    Ok((found.into_iter().zip(channels.iter().cloned()).collect(), note))
}

pub(super) fn read(path: &Path, args: &InstrumentArgs) -> Result<Measurement, Failure> {
    let mut table = table::open(path)?;
    let t = table.require("t_s")?;
    let mut notes = Vec::new();
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
        if name.eq_ignore_ascii_case("spindle_rpm") {
            sources.push((i, name.to_ascii_lowercase()));
        } else if let Some(sensor) = sensor(name) {
            sources.push((i, format!("temp_{sensor}_degc")));
        }
    }
    let mut names =
        vec!["t_s", "setup", "run", "repeat", "x_mm", "moving", "u_x", "u_y", "u_z", "deviation_um"];
    names.extend(sources.iter().map(|(_, n)| n.as_str()));
    let mut rows = Rows::new(path, names);
    while table.advance()? {
        let at = table.number(t)?;
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
    found.note(format!(
        "{} of {}, {}{spindle}; the machine stands at one position",
        counted(samples, "sample"),
        counted(columns.len(), "probe"),
        counted(heat, "temperature")
    ));
    found.notes.extend(notes);
    Ok(found)
}
