//! `audit verify` and `audit show`: the log of who did what, and the proof that it is whole.

use super::status;
use crate::numerals::is_obeyed;
use crate::prelude::*;
use volcomp_daemon::audit::{AUDIT_FILE, Broken, Line, Summary, head_path, verify_with};

/// Where the daemon of the shipped unit keeps it.
const DEFAULT_FILE: &str = "/var/lib/volcomp/audit.jsonl";

subcommands! {
    /// Read the audit log of volcompd: who did what, when, why, and with which model.
    pub(super) enum Verb {
        /// Checks that no line was changed, taken out, put in or cut off; exit code 65 names the line.
        Verify(VerifyArgs) => verify,
        /// Shows the log.
        Show(ShowArgs) => show,
    }
}

#[derive(Debug, clap::Args)]
struct WhichLog {
    /// The log [default: /var/lib/volcomp/audit.jsonl].
    #[arg(value_name = "FILE", conflicts_with = "config")]
    file: Option<PathBuf>,
    /// The daemon's machine file, which names its state directory.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
}

#[derive(Debug, clap::Args)]
pub(super) struct VerifyArgs {
    #[command(flatten)]
    which: WhichLog,
    /// A log without the file audit.head beside it is accepted, though lines cut off at its end cannot be seen then.
    #[arg(long)]
    without_head: bool,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
pub(super) struct ShowArgs {
    #[command(flatten)]
    which: WhichLog,
    /// Only the last lines.
    #[arg(long, value_name = "N")]
    last: Option<usize>,
    /// Print the lines as they are, one JSON object each.
    #[arg(long)]
    json: bool,
}

/// The log that is meant.
fn log_of(which: &WhichLog) -> Result<PathBuf> {
    if let Some(file) = &which.file {
        return Ok(file.clone());
    }
    let Some(config) = &which.config else { return Ok(PathBuf::from(DEFAULT_FILE)) };
    let Some(directory) = status::machine(config)?.state.directory else {
        return Ok(PathBuf::from(DEFAULT_FILE));
    };
    Ok(config.with_file_name(directory).join(AUDIT_FILE))
}

fn verify(args: &VerifyArgs) -> Result<()> {
    let path = log_of(&args.which)?;
    let file = path.display();
    let text = input::read(&path, InputKind::AuditLog)?;
    let beside = head_path(&path);
    let head = if beside.exists() { Some(input::read(&beside, InputKind::Description)?) } else { None };
    match verify_with(&text, head.as_deref()) {
        Ok(Summary { lines, hash, head, .. }) => {
            if args.json {
                say!("{}", json!({"intact": true, "lines": lines, "hash": hash, "head": head}));
            } else {
                say!("{file}: {lines} lines, intact; last hash {hash}");
            }
            if head || args.without_head {
                return Ok(());
            }
            Err(data!(
                path,
                "the file audit.head, which tells number and hash of the last line, is not beside it: lines cut off at the \
                 end cannot be seen\n  hint: compare the last hash with the journal of the daemon; for a copy of the log \
                 alone add --without-head"
            ))
        }
        Err(Broken { line, fault, good: (good, hash) }) => {
            if args.json {
                let (fault, last_good) = (fault.to_string(), json!({"line": good, "hash": hash}));
                say!("{}", json!({"intact": false, "line": line, "fault": fault, "last_good": last_good}));
            }
            Err(failure!(
                EX_DATAERR,
                "{file}:{line}: {fault}\n  hint: everything up to line {good} is as it was written; compare its \
                     hash {hash} with the journal"
            ))
        }
    }
}

fn show(args: &ShowArgs) -> Result<()> {
    let path = log_of(&args.which)?;
    let text = input::read_text(&path, InputKind::AuditLog)?;
    let lines: Vec<&str> = text.lines().collect();
    let skip = args.last.map_or(0, |last| lines.len().saturating_sub(last));
    for (number, line) in lines.iter().enumerate().skip(skip) {
        if args.json {
            say!("{line}");
            continue;
        }
        let line: Line = serde_json::from_str(line).map_err(|e| not_a_line(&path, number + 1, &e))?;
        say!("{}", human(&line));
    }
    Ok(())
}

fn not_a_line(path: &Path, line: usize, error: &serde_json::Error) -> Failure {
    failure!(
        EX_DATAERR,
        "{}:{line}: not a line of an audit log: {error}\n  hint: volcomp audit verify",
        path.display()
    )
}

/// One line for a person: characters in what others wrote that a terminal would obey are blanks.
fn human(line: &Line) -> String {
    let name = line.who.name.clone().or_else(|| line.who.uid.map(|uid| format!("uid {uid}")));
    let Line { seq, time, what, result, .. } = line;
    let parts = [
        Some(format!("{seq:>5} {time} {:<10} {what}: {result}", name.unwrap_or_else(|| "?".to_owned()))),
        line.why.as_ref().map(|why| format!(" (why: {why})")),
        line.old_model.as_ref().map(|old| format!(" old model {old:.12}")),
        line.new_model.as_ref().map(|new| format!(" model {new:.12}")),
        line.detail.as_ref().map(|detail| format!("; {detail}")),
    ];
    let text = parts.into_iter().flatten().joined("");
    text.chars().map(|c| if is_obeyed(c) { ' ' } else { c }).collect()
}
