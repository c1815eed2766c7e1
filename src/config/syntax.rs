//! Mistakes in the syntax of TOML that people make often, in words that name the remedy.

use super::Diagnostic;

/// Message and remedy for a mistake that the parser has found at byte `at`; `None` where its own words are as good.
pub(super) fn known_mistake(text: &str, at: usize, message: &str) -> Option<(String, String)> {
    let before = text.get(..at)?;
    let number = before.matches('\n').count();
    let lines: Vec<&str> = text.lines().collect();
    let line = code_of(lines.get(number)?);
    if message.contains("duplicate") {
        return twice(&lines[..number], line);
    }
    decimal_comma(line)
}

/// A table of data in place of a TOML file: one mistake, not one for each of its rows.
pub(super) fn data_table(text: &str) -> Option<Diagnostic> {
    let line = text.lines().find(|line| !code_of(line).is_empty())?;
    let separators = line.matches([',', ';', '\t']).count();
    if separators == 0 || line.contains(['=', '[', '{']) {
        return None;
    }
    let start = line.as_ptr() as usize - text.as_ptr() as usize;
    Some(Diagnostic {
        span: Some(start..start + line.trim_end().len()),
        message: "not TOML: this is a table of data".to_owned(),
        remedy: Some(
            "name a model or machine file, which begins with a line such as format = \"volcomp-model/1\""
                .to_owned(),
        ),
    })
}

/// A line without its comment; a `#` in quotes ends it as well, which these mistakes do not mind.
fn code_of(line: &str) -> &str {
    line.split('#').next().unwrap_or_default().trim()
}

/// A table or key that stands twice: where it stands first.
fn twice(before: &[&str], line: &str) -> Option<(String, String)> {
    let is_header = |line: &str| line.starts_with('[');
    let key = |line: &str| line.split('=').next().unwrap_or_default().trim().to_owned();
    let first = if is_header(line) {
        before.iter().position(|other| code_of(other) == line)?
    } else {
        let table = before.iter().rposition(|other| is_header(code_of(other))).map_or(0, |header| header + 1);
        table + before[table..].iter().position(|other| key(code_of(other)) == key(line))?
    };
    let what = if is_header(line) { format!("table {line}") } else { format!("key {}", key(line)) };
    let (first, remedy) = (
        first + 1,
        if is_header(line) { "put all its keys below one of them" } else { "take one of them out" },
    );
    Some((format!("duplicate {what}, it stands in line {first} already"), remedy.to_owned()))
}

/// `ramp-s = 2,5`.
fn decimal_comma(line: &str) -> Option<(String, String)> {
    let (key, value) = line.split_once('=')?;
    let (whole, decimals) = value.trim().split_once(',')?;
    let (whole, decimals) = (whole.trim(), decimals.trim());
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    if !digits(whole.trim_start_matches(['-', '+'])) || !digits(decimals) {
        return None;
    }
    let key = key.trim();
    Some((format!("{key} has a decimal comma"), format!("write {key} = {whole}.{decimals}")))
}
