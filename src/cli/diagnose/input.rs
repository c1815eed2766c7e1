//! Session files from disk.

use super::instruments::{self, InstrumentArgs, Measurement};
use crate::positioning_data::no_rows;
use crate::prelude::*;
use crate::table::Table;
use volcomp_diagnose::machine_state::Axis;
use volcomp_diagnose::session::{Note, Raw, Session, is_encoder};
use volcomp_formats::detect;

/// A rotary axis that moves less stands still, rad.
const TURNED_RAD: f64 = 1e-6;

/// What a file holds: a session file, or a file of an instrument or a control by its content.
pub(super) enum Source {
    /// A session file.
    Table(Raw),
    /// A file of an instrument or a control.
    Instrument(Box<Measurement>),
}

/// Reads a file. A plan may lack deviations.
pub(super) fn session(
    path: &Path,
    args: &InstrumentArgs,
    model: Option<&Model>,
    plan: bool,
) -> Result<Source> {
    // what cannot be read twice is a session file
    if input::is_regular(path) {
        let bytes = input::head(path, InputKind::Capture, detect::HEAD as u64)?;
        if let Some(found) = instruments::recognised(path, &bytes, args, model)? {
            return Ok(Source::Instrument(Box::new(found)));
        }
    }
    let mut table = table::open(path)?;
    known(&table)?;
    let mut raw = read(&mut table)?;
    if plan {
        as_plan(&mut raw);
    } else if raw.column("deviation_um").is_some_and(|all| all.iter().all(|v| v.is_nan())) {
        return Err(data!(
            raw.file,
            "deviation_um is empty in every row; a recording of the daemon measures no deviation: fill in the readings of an instrument, or give \
             --plan to see what such rows could show"
        ));
    }
    Ok(Source::Table(raw))
}

/// Refuses what is no session table at all, before one of its lines is called wrong.
fn known(table: &Table) -> Result<()> {
    let names = table.columns();
    if names.iter().any(|n| is_quantity(n) || n == "instrument") {
        return Ok(());
    }
    Err(failure!(
        EX_DATAERR,
        "{}: neither a session file (its heading has none of the columns t_s, x_mm .. deviation_um) nor a known file of an \
             instrument or a control\n  \
             hint: read are ISO 230-2 tests (.dat, .rtl, .pos, CSV), circular tests (CSV), plates measured on a CMM, points of a \
             tracker (measured_x_mm ..), captures of a SINUMERIK Edge (JSON, CSV) and logs of displacement; columns of session files: docs/reference/session-files.md",
        table.file()
    ))
}

/// Reads a session table; empty fields become NaN.
pub(super) fn read(table: &mut Table) -> Result<Raw> {
    let names: Vec<String> = table.columns().to_vec();
    let instrument = names.iter().position(|n| n == "instrument");
    let mut raw = Raw { file: table.file().to_owned(), ..Raw::default() };
    let mut kept: Vec<usize> = (0..names.len()).filter(|i| Some(*i) != instrument).collect();
    raw.columns = vec![Vec::new(); names.len()];
    while table.advance()? {
        let mut words = Vec::new();
        for i in &kept {
            match table.number_or_empty(*i) {
                Ok(value) => raw.columns[*i].push(value),
                // a column of words is a remark, not a quantity: its first value decides
                Err(_) if !is_quantity(&names[*i]) && raw.columns[*i].iter().all(|v| v.is_nan()) => {
                    words.push(*i);
                }
                Err(e) => return Err(e),
            }
        }
        kept.retain(|i| !words.contains(i));
        raw.instruments.push(instrument.map_or_else(|| "instrument".to_owned(), |i| table.word(i)));
        raw.lines.push(table.line());
    }
    if raw.lines.is_empty() {
        return Err(no_rows(table.file()));
    }
    let mut columns = Vec::with_capacity(kept.len());
    for i in kept {
        raw.names.push(names[i].clone());
        columns.push(std::mem::take(&mut raw.columns[i]));
    }
    raw.columns = columns;
    Ok(raw)
}

/// Names that mean a number.
fn is_quantity(name: &str) -> bool {
    ["setup", "run", "repeat", "pair", "moving"].contains(&name)
        || ["u_", "dir_"].iter().any(|s| name.starts_with(s))
        || ["_mm", "_um", "_deg", "_s", "_s2", "_n", "_rpm", "_degc"].iter().any(|e| name.ends_with(e))
}

/// A plan has no deviations yet; any will do that are not all the same.
fn as_plan(raw: &mut Raw) {
    let n = raw.lines.len();
    let ones: Vec<f64> = (0..n).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
    match raw.names.iter().position(|c| c == "deviation_um") {
        Some(i) => raw.columns[i] = ones,
        None => {
            raw.names.push("deviation_um".to_owned());
            raw.columns.push(ones);
        }
    }
}

/// Refuses rotary axes that turn while nobody says where they stand in the chain: their errors would pass for others.
/// The control's own encoders do not see the structure: there a note says what cannot be searched for.
pub(super) fn chain(session: &mut Session, model: Option<&Model>) -> Result<()> {
    let turns = |a: &Axis| {
        let [low, high] = hull(session.moments.iter().map(|m| m.position[a.slot()]));
        high - low > TURNED_RAD
    };
    let stands = |a: &Axis| model.is_some_and(|m| m.axes().any(|b| b.name == a.name()));
    let unknown = session.axes.iter().find(|a| !a.is_linear() && turns(a) && !stands(a));
    let Some(axis) = unknown else { return Ok(()) };
    if session.instruments.iter().all(|n| is_encoder(n)) {
        let note = format!(
            "axis {axis} turns, and no model says where it stands: its scale, delay and reversal error as seen by its encoder are not searched for; give \
             the model with --model"
        );
        session.notes.push(Note::new(note));
        return Ok(());
    }
    let what = match model {
        None => {
            "turns, and nothing says where it stands in the chain; give the model with --model".to_owned()
        }
        Some(m) => format!(
            "turns, but the chain of {} has no such axis; give the model of this machine",
            m.machine()
        ),
    };
    let file = session.files.join(", ");
    Err(failure!(EX_DATAERR, "{file}: axis {axis} {what}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns(text: &str) -> Result<Vec<String>> {
        let mut table = Table::new(std::io::Cursor::new(text.to_owned()), "s.csv".to_owned())?;
        read(&mut table).map(|raw| raw.names)
    }

    #[test]
    fn the_first_value_of_a_column_says_whether_it_holds_words() {
        let found = columns("t_s,cause,deviation_um\n0,,1\n1,machine-ready,2\n2,,3\n").unwrap();
        assert_eq!(found, ["t_s", "deviation_um"]);
        let slip = columns("t_s,flow,deviation_um\n0,4,1\n1,4x,2\n").unwrap_err();
        assert!(slip.message.contains("'4x' is not a number"), "{}", slip.message);
        assert!(columns("t_s,x_mm,deviation_um\n0,,1\n1,word,2\n").is_err());
    }
}
