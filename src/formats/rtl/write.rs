//! Writing, so that reading gives the same.

use core::fmt::Write as _;

use super::{Entry, Rtl};
use crate::text::number;

/// Targets per line.
const PER_LINE: usize = 6;
/// Width of a key, so that the colons stand below each other.
const KEY_WIDTH: usize = 11;

/// Writes a file with the line ends of the instrument's software.
#[must_use]
pub fn write(rtl: &Rtl) -> String {
    let mut out = String::new();
    section(&mut out, "HEADER", &rtl.header);
    out.push_str("\r\nTARGET DATA::\r\n");
    line(&mut out, format_args!("Filetype  : {}", one_line(&rtl.filetype)));
    line(&mut out, format_args!("Target-count: {}", rtl.targets.len()));
    line(&mut out, format_args!("Targets :"));
    for targets in rtl.targets.chunks(PER_LINE) {
        let row: Vec<String> = targets.iter().map(|t| number(*t, 6)).collect();
        line(&mut out, format_args!("{}", row.join("  ")));
    }
    let flags: Vec<String> = rtl.flags.iter().map(i64::to_string).collect();
    line(&mut out, format_args!("Flags: {}", flags.join(" ")));
    out.push_str("\r\n");
    section(&mut out, "USER-TEXT", &rtl.user_text);
    out.push_str("\r\nRUNS::\r\n");
    line(&mut out, format_args!("Run-count:{}", rtl.run_count));
    out.push_str("\r\nDEVIATIONS::\r\n");
    line(&mut out, format_args!("Run Target Data:"));
    for d in &rtl.deviations {
        line(&mut out, format_args!("{:3} {:4} {:>12}", d.run, d.target, number(d.value, 3)));
    }
    for (name, entries) in [("EQUIPMENT", &rtl.equipment), ("ENVIRONMENT", &rtl.environment)] {
        if !entries.is_empty() {
            out.push_str("\r\n");
            section(&mut out, name, entries);
        }
    }
    out.push_str("EOF::\r\n");
    out
}

fn section(out: &mut String, name: &str, entries: &[Entry]) {
    line(out, format_args!("{name}::"));
    for e in entries {
        line(out, format_args!("{:KEY_WIDTH$}: {}", one_line(&e.key), one_line(&e.text)));
    }
}

/// Line ends inside a text would end it.
fn one_line(text: &str) -> String {
    text.replace(['\r', '\n'], " ").trim().to_owned()
}

fn line(out: &mut String, text: core::fmt::Arguments<'_>) {
    // writing to a String cannot fail
    let _ = write!(out, "{text}\r\n");
}
