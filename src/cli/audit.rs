//! `audit verify` and `audit show`: the log of who did what, and the proof that it is whole.

use std::path::{Path, PathBuf};

use serde_json::json;

use super::{EX_DATAERR, Failure};
use crate::runtime::audit::{Line, verify_file};

/// Where the daemon of the shipped unit keeps it.
const DEFAULT_FILE: &str = "/var/lib/volcomp/audit.jsonl";

/// Reads the audit log of volcompd: who did what, when, why, and with which model.
#[derive(Debug, clap::Parser)]
pub(super) struct Args {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, clap::Subcommand)]
enum Verb {
    /// Checks that no line was changed, taken out, put in or cut off; exit code 65 names the line.
    Verify(VerifyArgs),
    /// Shows the log.
    Show(ShowArgs),
}

#[derive(Debug, clap::Args)]
struct VerifyArgs {
    /// The log.
    #[arg(default_value = DEFAULT_FILE, value_name = "FILE")]
    file: PathBuf,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
struct ShowArgs {
    /// The log.
    #[arg(default_value = DEFAULT_FILE, value_name = "FILE")]
    file: PathBuf,
    /// Only the last lines.
    #[arg(long, value_name = "N")]
    last: Option<usize>,
    /// Print the lines as they are, one JSON object each.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    match &args.verb {
        Verb::Verify(args) => verify(args),
        Verb::Show(args) => show(args),
    }
}

fn verify(args: &VerifyArgs) -> Result<(), Failure> {
    let file = args.file.display();
    match verify_file(&args.file).map_err(|e| Failure::io(&args.file, &e))? {
        Ok(summary) => {
            if args.json {
                say!(
                    "{}",
                    json!({"intact": true, "lines": summary.lines, "hash": summary.hash, "head": summary.head})
                );
            } else {
                say!("{file}: {} lines, intact; last hash {}", summary.lines, summary.hash);
            }
            if !summary.head {
                eprintln!("note: no head file beside it: lines cut off at the end could not be seen");
            }
            Ok(())
        }
        Err(broken) => {
            if args.json {
                say!(
                    "{}",
                    json!({
                        "intact": false, "line": broken.line, "fault": broken.fault.to_string(),
                        "last_good": {"line": broken.good.0, "hash": broken.good.1},
                    })
                );
            }
            Err(Failure::new(
                EX_DATAERR,
                format_args!(
                    "error: {file}:{}: {}\n  hint: everything up to line {} is as it was written; \
                     compare its hash {} with the journal",
                    broken.line, broken.fault, broken.good.0, broken.good.1
                ),
            ))
        }
    }
}

fn show(args: &ShowArgs) -> Result<(), Failure> {
    let text = super::files::read_text(&args.file)?;
    let lines: Vec<&str> = text.lines().collect();
    let skip = args.last.map_or(0, |last| lines.len().saturating_sub(last));
    for (number, line) in lines.iter().enumerate().skip(skip) {
        if args.json {
            say!("{line}");
            continue;
        }
        let line: Line = serde_json::from_str(line).map_err(|e| not_a_line(&args.file, number + 1, &e))?;
        say!("{}", human(&line));
    }
    Ok(())
}

fn not_a_line(path: &Path, line: usize, error: &serde_json::Error) -> Failure {
    Failure::new(
        EX_DATAERR,
        format_args!(
            "error: {}:{line}: not a line of an audit log: {error}\n  hint: volcomp audit verify",
            path.display()
        ),
    )
}

/// One line for a person: control characters in what others wrote are shown, not carried out.
fn human(line: &Line) -> String {
    let name = line.who.name.clone().or_else(|| line.who.uid.map(|uid| format!("uid {uid}")));
    let mut text =
        format!("{:>5} {} {:<10} {}", line.seq, line.time, name.unwrap_or_else(|| "?".to_owned()), line.what);
    text.push_str(&format!(": {}", line.result));
    if let Some(why) = &line.why {
        text.push_str(&format!(" (why: {why})"));
    }
    if let Some(old) = &line.old_model {
        text.push_str(&format!(" old model {}", &old.chars().take(12).collect::<String>()));
    }
    if let Some(new) = &line.new_model {
        text.push_str(&format!(" model {}", &new.chars().take(12).collect::<String>()));
    }
    if let Some(detail) = &line.detail {
        text.push_str(&format!("; {detail}"));
    }
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}
