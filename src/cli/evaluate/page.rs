//! What the reports of all tests have in common: the head with the data files and their hashes, and the table of
//! figures before and after.

use std::path::Path;

use super::{Figure, change, percent, show};
use crate::input::{self, InputKind};
use crate::report::Page;
use crate::report::page::Cell;

/// Where the data of a report came from.
pub(super) struct Origin {
    /// `data`, `before`.
    what: &'static str,
    name: String,
    /// Hash of the file; none for stdin.
    hash: Option<String>,
}

impl Origin {
    /// The origin of a file that was read.
    pub(super) fn of(what: &'static str, path: &Path) -> Self {
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        // stdin cannot be read twice
        let hash = input::hash(path, InputKind::Table);
        Self { what, name: if name == "-" { "standard input".to_owned() } else { name }, hash }
    }
}

/// A page with its head: what was tested, from which files.
pub(super) fn start(title: &str, standard: &str, origins: &[Origin], facts: &[(&str, String)]) -> Page {
    let mut page = Page::new(title);
    page.paragraph(standard);
    let mut rows: Vec<Vec<Cell>> = origins
        .iter()
        .map(|o| {
            let hash = o.hash.as_ref().map_or(String::new(), |h| format!(", blake3 {h}"));
            vec![Cell::head(o.what), Cell::small(format!("{}{hash}", o.name))]
        })
        .collect();
    rows.extend(facts.iter().map(|(what, text)| vec![Cell::head(what), Cell::text(text)]));
    page.table(&[], &rows);
    page
}

/// The figures of one test, or of two side by side.
pub(super) fn figures(page: &mut Page, unit: &str, after: &[Figure], before: Option<&[Figure]>) {
    let head = match before {
        Some(_) => {
            let unit = format!("after / {unit}");
            vec![
                Cell::head(""),
                Cell::number(unit.replace("after", "before")),
                Cell::number(unit),
                Cell::number("change"),
            ]
        }
        None => vec![Cell::head(""), Cell::number(unit)],
    };
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
            row
        })
        .collect();
    page.table(&head, &rows);
}
