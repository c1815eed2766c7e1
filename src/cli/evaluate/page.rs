//! What the reports of all tests have in common: the head with machine, instrument, data files and their hashes, and the
//! table of figures before and after with tolerance and verdict.

use std::path::Path;

use super::{Figure, change, percent, show};
use crate::acceptance::verdicts::{Assessed, summary};
use crate::acceptance::{Acceptance, RULE, file_name, sign};
use crate::input::{self, InputKind};
use crate::report::Page;
use crate::report::page::Cell;

/// Where the data of a report came from.
pub(crate) struct Origin {
    /// `data`, `before`.
    what: String,
    name: String,
    /// Hash of the file; none for stdin.
    hash: Option<String>,
}

impl Origin {
    /// The origin of a file that was read.
    pub(crate) fn of(what: impl Into<String>, path: &Path) -> Self {
        let name = file_name(path);
        // stdin cannot be read twice
        let hash = input::hash(path, InputKind::Table);
        Self { what: what.into(), name: if name == "-" { "standard input".to_owned() } else { name }, hash }
    }
}

/// A page with its head: the verdicts in a sentence, machine and instrument, what was tested, from which files.
pub(crate) fn start(
    title: &str,
    standard: &str,
    acceptance: &Acceptance,
    assessed: &[Assessed],
    origins: &[Origin],
    facts: &[(&str, String)],
) -> Page {
    let mut page = Page::new(title);
    page.paragraph(standard);
    if let Some(summary) = summary(assessed) {
        page.lead(summary);
    }
    acceptance.head(&mut page);
    let mut rows: Vec<Vec<Cell>> = origins
        .iter()
        .map(|o| {
            let hash = o.hash.as_ref().map_or(String::new(), |h| format!(", blake3 {h}"));
            vec![Cell::head(&o.what), Cell::small(format!("{}{hash}", o.name))]
        })
        .collect();
    rows.extend(facts.iter().map(|(what, text)| vec![Cell::head(what), Cell::text(text)]));
    page.table(&[], &rows);
    page
}

/// The figures of one test, or of two side by side, with uncertainty, tolerance and verdict of the test after.
pub(super) fn figures(page: &mut Page, unit: &str, after: &[Assessed], before: Option<&[Figure]>) {
    let mut head = vec![Cell::head("")];
    match before {
        Some(_) => head.extend([
            Cell::number(format!("before / {unit}")),
            Cell::number(format!("after / {unit}")),
            Cell::number("change"),
        ]),
        None => head.push(Cell::number(unit)),
    }
    head.extend(Assessed::heads(unit));
    let rows: Vec<Vec<Cell>> = after
        .iter()
        .enumerate()
        .filter(|(_, f)| f.value.is_some())
        .map(|(i, f)| {
            let mut row = vec![Cell::head(f.name)];
            if let Some(before) = before {
                let old = before.get(i).and_then(|b| b.value);
                row.push(Cell::number(show(old)));
                row.push(Cell::number(show(f.value)));
                row.push(Cell::number(percent(change(old, f.value))));
            } else {
                row.push(Cell::number(show(f.value)));
            }
            row.extend(f.cells());
            row
        })
        .collect();
    page.table(&head, &rows);
}

/// The rule of the verdicts, where there are any, and lines to sign end a report.
pub(crate) fn finish(mut page: Page, assessed: &[Assessed]) -> String {
    if assessed.iter().any(|a| a.verdict().is_some()) {
        page.note(RULE);
    }
    sign(&mut page);
    page.finish()
}
