//! What the reports of all tests have in common: the head with machine, instrument, data files and their hashes, and the
//! table of figures before and after with tolerance and verdict.

use super::{changed, show};
use crate::acceptance::{RULE, sign, summary};
use crate::prelude::*;

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
    judged: &Judged,
    origins: &[Origin],
    facts: &[(&str, String)],
) -> Page {
    let mut page = Page::new(title);
    page.paragraph(standard);
    if let Some(summary) = summary(&judged.figures) {
        page.lead(summary);
    }
    judged.acceptance.head(&mut page);
    let row = |o: &Origin| {
        let hash = o.hash.as_ref().map_or(String::new(), |h| format!(", blake3 {h}"));
        vec![Cell::head(&o.what), Cell::small(format!("{}{hash}", o.name))]
    };
    let mut rows: Vec<Vec<Cell>> = origins.iter().map(row).collect();
    rows.extend(facts.iter().map(|(what, text)| vec![Cell::head(what), Cell::text(text)]));
    page.table(&[], &rows);
    page
}

/// The figures, with those before where there are, and how they are judged.
pub(super) fn figures(unit: &str, after: &[Assessed], before: Option<&[Assessed]>) -> Table {
    let mut heads = match before {
        Some(_) => vec!["".into(), format!(">before / {unit}"), format!(">after / {unit}"), ">change".into()],
        None => vec![String::new(), format!(">{unit}")],
    };
    heads.extend(Assessed::heads(unit));
    let mut table = Table::new(heads);
    for (i, f) in after.iter().enumerate().filter(|(_, f)| f.value.is_some()) {
        let mut row = vec![f.name.to_owned()];
        if let Some(before) = before {
            let old = before.get(i);
            row.extend([show(old.and_then(|b| b.value)), show(f.value), changed(old, f)]);
        } else {
            row.push(show(f.value));
        }
        row.extend(f.words());
        table.row(row);
    }
    table
}

/// The end of a page, with the rule of its verdicts and lines to sign.
pub(crate) fn finish(mut page: Page, judged: &Judged) -> String {
    if judged.has_verdicts() {
        page.note(RULE);
    }
    sign(&mut page);
    page.finish()
}
