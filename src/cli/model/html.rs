//! The page of `model show`: the report in tables and the pictures, in one file that needs no other.

use super::report::{ErrorRow, Fact, Report};
use super::{drawing, gauge, picture};
use crate::numerals::micro;
use crate::report::Page;
use crate::report::page::Cell;
use volcomp_model::Model;

/// The page.
///
/// # Errors
/// A picture could not be drawn.
pub(super) fn page(report: &Report<'_>, model: &Model) -> Result<String, Box<dyn std::error::Error>> {
    let spec = report.spec();
    let mut page = Page::new(&format!("{} {}", spec.machine, spec.chain));
    page.paragraph(report.name);
    page.lines(&drawing::chain(spec));
    for line in report.frame_lines() {
        page.paragraph(line);
    }
    page.heading("In the working volume");
    facts(&mut page, &report.worst());
    page.heading("Largest corrections");
    facts(&mut page, &report.corrections());
    if let Some(volume) = picture::distorted(spec, model)? {
        page.heading("Distorted volume");
        page.picture(&volume);
    }
    page.heading("Axes");
    let axes = spec.chain.axes().iter();
    let rows: Vec<Vec<Cell>> =
        axes.map(|a| vec![Cell::head(a.name), Cell::text(report.axis_words(a.name))]).collect();
    page.table(&[], &rows);
    let (motions, constants) = report.error_rows();
    errors(&mut page, "Squareness and location", &constants);
    errors(&mut page, "Error motions", &motions);
    for name in picture::axes_with_errors(spec) {
        page.picture(&picture::axis(spec, name)?);
    }
    page.heading("Gauge");
    page.lines(&gauge::lines(spec).iter().map(|line| micro(line)).collect::<Vec<_>>());
    Ok(page.finish())
}

fn facts(page: &mut Page, facts: &[Fact]) {
    let row =
        |f: &Fact| vec![Cell::head(&f.what), Cell::number(micro(&f.value)), Cell::text(micro(&f.place))];
    page.table(&[], &facts.iter().map(row).collect::<Vec<_>>());
}

fn errors(page: &mut Page, title: &str, rows: &[ErrorRow]) {
    if rows.is_empty() {
        return;
    }
    page.heading(title);
    let numbers = ["lowest", "highest", "range"].map(Cell::number);
    let mut head = vec![Cell::head(""), Cell::head("kind"), Cell::head("over")];
    head.extend(numbers);
    head.extend([Cell::head(""), Cell::number("u (k=1)"), Cell::head("")]);
    let row = |r: &ErrorRow| {
        let mut cells = vec![Cell::head(&r.symbol), Cell::text(&r.kinds), Cell::text(&r.range)];
        cells.extend(r.size.iter().map(Cell::number));
        cells.extend([Cell::text(micro(r.unit)), Cell::number(&r.std), Cell::text(&r.origin)]);
        cells
    };
    page.table(&head, &rows.iter().map(row).collect::<Vec<_>>());
}
