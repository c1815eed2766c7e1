//! HTML reports in the house style for programs outside of this crate: one file, no scripts, charts as SVG that follow the
//! light or dark scheme and print on A4.

use super::report::Page;
use super::report::chart::{Bar, Chart, HALF, Ink, Labels, Mark, bars, key};
use super::report::page::Cell;

/// How the points of a series are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// A line.
    Line,
    /// Dots.
    Dots,
    /// A thin dashed line for reference.
    Reference,
}

/// A series of a plot.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Entry of the legend.
    pub label: String,
    /// How it is drawn.
    pub style: Style,
    /// Points in the units of the axes.
    pub points: Vec<(f64, f64)>,
}

/// A plot of up to four series.
#[derive(Debug, Clone, PartialEq)]
pub struct Plot {
    /// Caption.
    pub title: String,
    /// Quantity and unit below.
    pub x_label: String,
    /// Quantity and unit to the left.
    pub y_label: String,
    /// Series in the order of the legend.
    pub series: Vec<Series>,
}

impl Plot {
    /// A plot without series.
    #[must_use]
    pub fn new(title: impl Into<String>, x_label: impl Into<String>, y_label: impl Into<String>) -> Self {
        Self { title: title.into(), x_label: x_label.into(), y_label: y_label.into(), series: Vec::new() }
    }

    /// Adds a series.
    #[must_use]
    pub fn with(mut self, style: Style, label: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        self.series.push(Series { label: label.into(), style, points });
        self
    }

    /// Chart and caption as markup.
    pub(crate) fn markup(&self) -> (String, String) {
        const INKS: [Ink; 4] = [Ink::Blue, Ink::Orange, Ink::Green, Ink::Grey];
        let points = || self.series.iter().flat_map(|s| &s.points);
        let labels = Labels { title: &self.title, x: &self.x_label, y: &self.y_label };
        let mut chart = Chart::new(HALF, labels, points().map(|p| p.0), points().map(|p| p.1));
        let mut keys = String::new();
        for (series, ink) in self.series.iter().zip(INKS.into_iter().cycle()) {
            let line = series.points.iter().copied();
            let mark = match series.style {
                Style::Line => {
                    chart.line(ink, line);
                    Mark::Line
                }
                Style::Dots => {
                    chart.marks(Mark::Dot, ink, line);
                    Mark::Dot
                }
                Style::Reference => {
                    chart.reference(line);
                    Mark::Reference
                }
            };
            // a second line of a pair needs no entry of its own
            if !series.label.is_empty() {
                keys.push_str(&key(mark, ink, &series.label));
            }
        }
        let title = super::report::page::escape(&self.title);
        (chart.finish(), format!("<b>{title}</b><br>{keys}"))
    }
}

/// A cell of a table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Entry {
    /// Words that name the row.
    Head(String),
    /// Words.
    Text(String),
    /// A number, aligned to the right.
    Number(String),
}

impl From<&Entry> for Cell {
    fn from(entry: &Entry) -> Self {
        match entry {
            Entry::Head(t) => Self::head(t),
            Entry::Text(t) => Self::text(t),
            Entry::Number(t) => Self::number(t),
        }
    }
}

/// A report under construction.
#[derive(Debug)]
pub struct ReportPage(Page);

impl ReportPage {
    /// A report with its title.
    #[must_use]
    pub fn new(title: &str) -> Self {
        Self(Page::new(title))
    }

    /// The result in a sentence, in large print.
    pub fn lead(&mut self, words: &str) {
        self.0.lead(words);
    }

    /// A heading.
    pub fn heading(&mut self, words: &str) {
        self.0.heading(words);
    }

    /// A paragraph.
    pub fn paragraph(&mut self, words: &str) {
        self.0.paragraph(words);
    }

    /// A remark in small print.
    pub fn note(&mut self, words: &str) {
        self.0.note(words);
    }

    /// A table with its head.
    pub fn table(&mut self, head: &[&str], rows: &[Vec<Entry>]) {
        let rows: Vec<Vec<Cell>> = rows.iter().map(|r| r.iter().map(Cell::from).collect()).collect();
        self.0.stacked_table(head, &rows);
    }

    /// Plots side by side where there is room.
    pub fn plots(&mut self, plots: &[Plot]) {
        let figures: Vec<(String, String)> = plots.iter().map(Plot::markup).collect();
        self.0.figures(&figures);
    }

    /// Horizontal bars from zero: label, length, words beside it.
    pub fn bars(&mut self, rows: &[(String, f64, String)]) {
        let rows: Vec<Bar> = rows
            .iter()
            .map(|(label, to, value)| Bar {
                label: label.clone(),
                from: 0.0,
                to: *to,
                value: value.clone(),
                ink: Ink::Blue,
            })
            .collect();
        self.0.html(&bars(&rows));
    }

    /// The finished page.
    #[must_use]
    pub fn finish(self) -> String {
        self.0.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_holds_tables_plots_and_bars_without_foreign_markup() {
        let mut page = ReportPage::new("<t>");
        page.table(&["figure", "ours"], &[vec![Entry::Head("<a>".into()), Entry::Number("1.0".into())]]);
        let plot = Plot::new("<p>", "x, mm", "y, µm")
            .with(Style::Line, "<l>", vec![(0.0, 1.0), (1.0, f64::NAN), (2.0, 3.0)])
            .with(Style::Dots, "dots", vec![(0.0, 2.0)])
            .with(Style::Reference, "zero", vec![]);
        page.plots(&[plot]);
        page.bars(&[("<b>".into(), 2.0, "2 µm".into())]);
        let text = page.finish();
        assert!(!text.contains("<a>") && !text.contains("<l>") && !text.contains("NaN"), "{text}");
        // dots are areas: Chromium prints no line without length
        assert!(text.contains("class=\"pb\" d=\"M") && !text.contains("h0\""), "{text}");
        assert!(text.contains("<svg class=\"chart\"") && text.contains("class=\"bars\""));
    }
}
