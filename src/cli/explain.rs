//! `volcomp explain`: what a number in status, log or audit means, and what to do.

use crate::prelude::*;
use volcomp_engine::fault::{CATALOGUE, Code, Entry, named};

/// Explain a number or name from status, log or audit: cause, reaction, remedy.
///
/// Without a number every entry is listed.
#[derive(Debug, clap::Parser)]
#[command(after_help = "Example:\n  volcomp explain VC-4001\n  volcomp explain read-back")]
pub(super) struct Args {
    /// A number such as VC-4001 (or 4001), or a name such as read-back.
    #[arg(value_name = "CODE")]
    code: Vec<String>,
    /// JSON on stdout: a list of entries.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let entries = if args.code.is_empty() {
        CATALOGUE.iter().collect()
    } else {
        args.code.iter().map(|text| find(text)).collect::<Result<Vec<_>, _>>()?
    };
    if args.json {
        say!("{:#}", serde_json::Value::Array(entries.into_iter().map(as_json).collect()));
    } else if args.code.is_empty() {
        for e in entries {
            say!("{}  {:<8} {:<22} {}", e.code, e.severity.name(), e.name, e.text);
        }
    } else {
        for (i, e) in entries.into_iter().enumerate() {
            if i > 0 {
                say!();
            }
            say!("{} {} ({}): {}", e.code, e.name, e.severity.name(), e.text);
            say!("  cause     {}", e.cause);
            say!("  reaction  {}", e.reaction);
            say!("  remedy    {}", e.remedy);
        }
    }
    Ok(())
}

fn find(text: &str) -> Result<&'static Entry> {
    Code::parse(text).and_then(Code::entry).or_else(|| named(text)).ok_or_else(|| {
        usage!("{text} is not a number or name that volcomp uses; volcomp explain lists them all")
    })
}

fn as_json(e: &Entry) -> serde_json::Value {
    fields!(e; name, text, cause, reaction, remedy; "code": e.code.to_string(), "severity": e.severity.name())
}
