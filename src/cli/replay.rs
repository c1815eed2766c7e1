//! `replay`: a recording through the same engine, compared bit for bit.

use std::path::PathBuf;
use std::sync::Arc;

use serde_json::json;

use super::recordings::{self, Parsed};
use super::{EX_DATAERR, Failure, files, service};
use crate::runtime::replay::{Difference, Gap, Replay, Report};

/// Exit code where a correction came out otherwise.
const EX_DIFFERS: u8 = 1;
/// Differences shown as text.
const SHOWN: usize = 10;

/// Runs a recording of volcompd through the same engine; every correction must come out the same, bit for bit.
///
/// Exit code 0: all the same; 1: something differs; 65: nothing could be compared. After missing records the engine has
/// to catch up first; cycles until then are not compared, and the report says how many.
#[derive(Debug, clap::Parser)]
pub(super) struct Args {
    /// Recordings of one run of the daemon, in any order.
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// The model file of the beginning [default: the one inside the recording]; models that the daemon was switched to
    /// later are always those inside.
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// The machine file [default: the one inside the recording].
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let bytes = recordings::read(&args.recordings)?;
    let parsed = recordings::parse(&bytes)?;
    let mut replay = prepare(args, &parsed)?;
    let notes = recordings::walk(&parsed, |item| {
        replay.feed(item);
        Ok(())
    })?;
    let report = replay.finish();
    for note in &notes {
        eprintln!("note: {note}");
    }
    if args.json {
        say!("{}", to_json(&report, &notes));
    } else {
        print(&report);
    }
    if report.differing > 0 {
        return Err(Failure::new(
            EX_DIFFERS,
            format_args!(
                "error: {} of {} cycles differ from the recording",
                report.differing, report.compared
            ),
        ));
    }
    if report.compared == 0 {
        return Err(Failure::new(
            EX_DATAERR,
            "error: nothing could be compared: no cycle, or the engine never caught up after a gap",
        ));
    }
    Ok(())
}

fn prepare(args: &Args, parsed: &[Parsed<'_>]) -> Result<Replay, Failure> {
    let (Parsed { path, recording }, meta) = recordings::first(parsed)?;
    let config = match &args.config {
        None => recordings::machine(path, recording)?,
        Some(path) => service::machine(path)?,
    };
    let mut inside = recordings::models(parsed)?.into_iter().map(|m| (m.hash, Arc::new(m.model)));
    let first = recording.models.first().and_then(|_| inside.next());
    let model = match &args.model {
        None => match &first {
            Some((_, model)) => Arc::clone(model),
            None => {
                let path = path.display();
                let why = format_args!(
                    "error: {path} (model inside): missing or damaged\n  hint: name it with --model"
                );
                return Err(Failure::new(EX_DATAERR, why));
            }
        },
        Some(path) => {
            let hash = blake3::hash(files::read_text(path)?.as_bytes()).to_hex();
            if hash.as_str() != meta.model_hash {
                eprintln!(
                    "note: {} is not the model of the recording (blake3 {hash}, there {})",
                    path.display(),
                    meta.model_hash
                );
            }
            Arc::new(files::read_model(path)?.1)
        }
    };
    let mut replay = Replay::new(config, model);
    for (hash, model) in first.into_iter().chain(inside) {
        replay.add_model(hash, model);
    }
    Ok(replay)
}

fn print(report: &Report) {
    say!("records     {}, of these {} cycles", report.records, report.cycles);
    say!("compared    {} cycles, {} differ", report.compared, report.differing);
    for Gap { record, dropped, caught_up } in &report.gaps {
        match caught_up {
            Some(cycles) => {
                say!(
                    "gap         {dropped} records missing before record {record}; resynchronised after {cycles} cycles, which are not compared"
                );
            }
            None => say!(
                "gap         {dropped} records missing before record {record}; not resynchronised: nothing after it is compared until the next gap or link"
            ),
        }
    }
    for (record, why) in &report.refused {
        say!("not repeated from record {record} on: {why}");
    }
    for Difference { record, sequence, what, axis, recorded, replayed } in
        report.differences.iter().take(SHOWN)
    {
        let sequence = sequence.map_or_else(|| "deadline".to_owned(), |s| format!("cycle {s}"));
        let axis = axis.map_or_else(String::new, |a| format!(" {}", a.lower()));
        say!(
            "differs     record {record}, {sequence}: {what}{axis} recorded {recorded}, replayed {replayed}"
        );
    }
    if report.differences.len() > SHOWN {
        say!("            and more; --json lists the first 100");
    }
    if report.differing > 0 {
        say!("largest     {:e} mm or deg", report.largest);
    }
}

fn to_json(report: &Report, notes: &[String]) -> serde_json::Value {
    let gap = |g: &Gap| json!({"record": g.record, "dropped": g.dropped, "caught_up_cycles": g.caught_up});
    let difference = |d: &Difference| {
        json!({
            "record": d.record, "sequence": d.sequence, "what": d.what,
            "axis": d.axis.map(|a| a.lower().to_string()), "recorded": d.recorded, "replayed": d.replayed,
        })
    };
    json!({
        "records": report.records,
        "cycles": report.cycles,
        "compared": report.compared,
        "differing": report.differing,
        "largest_difference": report.largest,
        "differences": report.differences.iter().map(difference).collect::<Vec<_>>(),
        "gaps": report.gaps.iter().map(gap).collect::<Vec<_>>(),
        "refused": report.refused.iter().map(|(r, why)| json!({"record": r, "why": why})).collect::<Vec<_>>(),
        "notes": notes,
    })
}
