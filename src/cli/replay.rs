//! `replay`: a recording through the same engine, compared bit for bit.

use std::sync::Arc;

use super::recordings::{self, Parsed, Walked};
use super::{files, status};
use crate::prelude::*;
use volcomp_daemon::replay::{Difference, Gap, Replay, Report};

/// Exit code where a correction came out otherwise.
const EX_DIFFERS: u8 = 1;
/// Exit code where nothing differs, but part of the recording is missing, damaged or could not be compared.
const EX_INCOMPLETE: u8 = 2;
/// Differences shown as text.
const SHOWN: usize = 10;

/// Run a recording of volcompd through the same engine; every correction must come out the same, bit for bit.
///
/// Exit code 0: every cycle was compared and is the same; 1: something differs; 2: nothing differs, but records are
/// missing or damaged, or cycles could not be compared; 65: nothing could be compared, or the model of the beginning is
/// missing. After missing records the engine has to catch up first; cycles until then are not compared, and the report
/// says how many.
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

pub(super) fn run(args: &Args) -> Result<()> {
    let mut parsed = recordings::read(&args.recordings)?;
    let mut replay = prepare(args, &parsed)?;
    let walked = recordings::walk(&mut parsed, |item| {
        replay.feed(item);
        Ok(())
    })?;
    let report = replay.finish();
    for note in &walked.notes {
        note!("note: {note}");
    }
    if args.json {
        say!("{}", to_json(&report, &walked));
    } else {
        print(&report, &walked);
    }
    judge(&report, &walked)
}

/// True where every cycle of the recordings was there and compared.
fn is_complete(report: &Report, walked: &Walked) -> bool {
    walked.missing.is_empty()
        && walked.damaged == 0
        && report.refused.is_empty()
        && report.compared == report.cycles
}

fn judge(report: &Report, walked: &Walked) -> Result<()> {
    let complete = is_complete(report, walked);
    let part = if complete { "" } else { "; the recording is incomplete, too" };
    let Report { differing, compared, cycles, .. } = report;
    if *differing > 0 {
        return Err(failure!(EX_DIFFERS, "{differing} of {compared} cycles differ from the recording{part}"));
    }
    if *compared == 0 {
        return Err(failure!(
            EX_DATAERR,
            "nothing could be compared: no cycle, or the engine never caught up after a gap"
        ));
    }
    if !complete {
        let gaps = counted(walked.missing.len(), "gap");
        let damaged = counted(walked.damaged, "damaged place");
        return Err(failure!(
            EX_INCOMPLETE,
            "not everything could be replayed: {gaps}, {damaged}, {compared} of {cycles} cycles compared (all the same)\n  \
             hint: give all files of the run; the lines above name what is missing"
        ));
    }
    Ok(())
}

fn prepare(args: &Args, parsed: &[Parsed]) -> Result<Replay> {
    let file = recordings::first(parsed)?;
    let (path, meta) = (file.path.display(), &file.meta);
    let config = match &args.config {
        None => recordings::machine(file)?,
        Some(path) => status::machine(path)?,
    };
    let inside: Vec<_> =
        recordings::models(parsed)?.into_iter().map(|m| (m.hash, Arc::new(m.model))).collect();
    let model = match &args.model {
        // a later model may be there where the first one is damaged
        None => {
            let is_first = |hash: &[u8; 32]| blake3::Hash::from(*hash).to_hex().as_str() == meta.model_hash;
            let first = inside.iter().find(|(hash, _)| is_first(hash)).map(|(_, model)| Arc::clone(model));
            let (model, hash) = (&meta.model, &meta.model_hash);
            first.ok_or_else(|| {
                failure!(
                    EX_DATAERR,
                    "{path} (model inside): the model of its beginning, {model} (blake3 {hash}), is missing or damaged\n  \
                     hint: name that file with --model"
                )
            })?
        }
        Some(path) => {
            let (_, model, hash) = files::read_hashed_model(path)?;
            if hash.as_str() != meta.model_hash {
                let (path, there) = (path.display(), &meta.model_hash);
                note!("note: {path} is not the model of the recording (blake3 {hash}, there {there})");
            }
            Arc::new(model)
        }
    };
    let mut replay = Replay::new(config, model);
    for (hash, model) in inside {
        replay.add_model(hash, model);
    }
    Ok(replay)
}

fn print(report: &Report, walked: &Walked) {
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
    for missing in &walked.missing {
        say!("not replayed {missing}");
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

fn to_json(report: &Report, walked: &Walked) -> serde_json::Value {
    let gap = |g: &Gap| json!({"record": g.record, "dropped": g.dropped, "caught_up_cycles": g.caught_up});
    let difference = |d: &Difference| {
        let axis = d.axis.map(|a| a.lower().to_string());
        fields!(d; record, sequence, what, recorded, replayed; "axis": axis)
    };
    let refused = report.refused.iter().map(|(r, why)| json!({"record": r, "why": why}));
    fields!(report; records, cycles, compared, differing;
        "largest_difference": report.largest,
        "differences": report.differences.iter().map(difference).collect::<Value>(),
        "gaps": report.gaps.iter().map(gap).collect::<Value>(),
        "refused": refused.collect::<Value>(),
        "notes": walked.notes, "missing": walked.missing, "damaged": walked.damaged,
        "complete": is_complete(report, walked),
    )
}
