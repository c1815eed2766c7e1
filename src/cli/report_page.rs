//! HTML reports in the house style for programs outside of this crate: one file, no scripts, charts as SVG that follow the
//! light or dark scheme and print on A4.

use super::report::chart::{Chart, HALF, Ink, Labels, Mark, key};

pub use super::report::{Page, Table};

/// How the points of a series are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// A line.
    Line,
    /// Dots.
    Dots,
    /// Large dots, of few points.
    Discs,
    /// Limits from each odd point to the even one after it, in the colour of the series before.
    Limits,
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
        let (mut inks, mut ink) = (INKS.into_iter().cycle(), Ink::Blue);
        for series in &self.series {
            if series.style != Style::Limits {
                ink = inks.next().unwrap_or(ink);
            }
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
                Style::Discs => {
                    chart.marks(Mark::Disc, ink, line);
                    Mark::Disc
                }
                Style::Limits => {
                    chart.limits(ink, &series.points);
                    Mark::Limits
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_holds_tables_plots_and_bars_without_foreign_markup() {
        let mut page = Page::new("<t>");
        Table::new(["figure", ">ours"]).rows([["<a>", "1.0"]]).put_stacked(&mut page);
        let plot = Plot::new("<p>", "x, mm", "y, µm")
            .with(Style::Line, "<l>", vec![(0.0, 1.0), (1.0, f64::NAN), (2.0, 3.0)])
            .with(Style::Dots, "dots", vec![(0.0, 2.0)])
            .with(Style::Limits, "U", vec![(0.0, 1.5), (0.0, 2.5)])
            .with(Style::Reference, "zero", vec![]);
        page.charts(&[plot]);
        page.bars([("<b>".into(), 2.0, "2 µm".into())]);
        let text = page.finish();
        assert!(!text.contains("<a>") && !text.contains("<l>") && !text.contains("NaN"), "{text}");
        // dots are areas: Chromium prints no line without length
        assert!(text.contains("class=\"pb\" d=\"M") && !text.contains("h0\""), "{text}");
        assert!(text.contains("<svg class=\"chart\"") && text.contains("class=\"bars\""));
    }
}
