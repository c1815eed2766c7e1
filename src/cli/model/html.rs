//! The page of `model show`: the report in tables and the pictures, in one file that needs no other.

use super::report::{Report, axis_words, errors};
use super::{drawing, gauge, picture};
use crate::prelude::*;

/// The page.
///
/// # Errors
/// A picture could not be drawn.
pub(super) fn page(report: &Report<'_>, model: &Model) -> Result<String> {
    let spec = report.spec();
    let mut page = Page::new(&format!("{} {}", spec.machine, spec.chain));
    page.paragraph(report.name);
    page.lines(&drawing::chain(spec));
    for line in report.frame_lines() {
        page.paragraph(line);
    }
    page.heading("In the working volume");
    report.worst().put(&mut page);
    page.heading("Largest corrections");
    report.corrections().put(&mut page);
    if let Some(volume) = picture::distorted(spec, model)? {
        page.heading("Distorted volume");
        page.picture(&volume);
        page.note(
            "The lines are drawn for travel towards plus. The largest position error above is searched over the whole volume, all \
             rotary positions and both directions of travel.",
        );
    }
    page.heading("Axes");
    page.facts(spec.chain.axes().iter().map(|a| (a.name, axis_words(spec, a.name))));
    let (motions, constants) = errors(report.file);
    for (title, table) in [("Squareness and location", constants), ("Error motions", motions)] {
        if !table.is_empty() {
            page.heading(title);
            table.put(&mut page);
        }
    }
    for name in picture::axes_with_errors(spec) {
        page.picture(&picture::axis(spec, name)?);
    }
    page.heading("Datums and reference lines");
    page.list(&gauge::lines(spec, true));
    Ok(page.finish())
}
