//! Small charts as SVG markup whose colours come from the style sheet of the page, so that they follow its light or dark
//! scheme. Coordinates keep fractions of a pixel. The legend is part of the caption and never covers data.

use std::fmt::Write as _;

use super::page::escape;
use super::plot::{round_below, with_room};
use crate::numerals::micro;

/// Size of a chart of which two stand side by side on A4, pixels.
pub(crate) const HALF: (f64, f64) = (440.0, 270.0);

/// Room around the plot: left, top, right, bottom, pixels.
const ROOM: [f64; 4] = [58.0, 10.0, 14.0, 42.0];
/// Distance of two ticks at least, pixels.
const TICK_PX: [f64; 2] = [70.0, 40.0];
/// Radius of a large dot, pixels.
const DISC: f64 = 4.0;

/// Colour and mark of a series; the style sheet holds the colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ink {
    /// Grey, for readings.
    Grey,
    /// Blue, the first fitted line or the state before.
    Blue,
    /// Orange and dashed, the second fitted line or the state after.
    Orange,
    /// Green and dotted, a third fitted line.
    Green,
    /// Colour of the text.
    Text,
}

impl Ink {
    /// Lines of one chart, in their order.
    pub(crate) const LINES: [Self; 3] = [Self::Blue, Self::Orange, Self::Green];

    const fn class(self) -> &'static str {
        match self {
            Self::Grey => "g",
            Self::Blue => "a",
            Self::Orange => "b",
            Self::Green => "c",
            Self::Text => "t",
        }
    }
}

/// A mark in a legend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mark {
    /// A dot.
    Dot,
    /// A large dot.
    Disc,
    /// A vertical line between two limits.
    Limits,
    /// A cross.
    Cross,
    /// A ring.
    Ring,
    /// A thin dashed line.
    Reference,
    /// A line.
    Line,
    /// A band.
    Band,
}

/// An entry of a legend: markup for a caption.
pub(crate) fn key(mark: Mark, ink: Ink, label: &str) -> String {
    let class = ink.class();
    let drawn = match mark {
        Mark::Dot => format!("<circle class=\"d{class}\" cx=\"11\" cy=\"6\" r=\"3\"/>"),
        Mark::Disc => format!("<circle class=\"d{class}\" cx=\"11\" cy=\"6\" r=\"{DISC}\"/>"),
        Mark::Limits => format!("<path class=\"x{class}\" d=\"M11 1v10m-3 0h6m-6 -10h6\"/>"),
        Mark::Cross => format!("<path class=\"x{class}\" d=\"M8 3l6 6m0-6l-6 6\"/>"),
        Mark::Ring => format!("<circle class=\"o{class}\" cx=\"11\" cy=\"6\" r=\"3\"/>"),
        Mark::Reference => "<path class=\"ref\" d=\"M0 6h22\"/>".to_owned(),
        Mark::Line => format!("<path class=\"l{class}\" d=\"M0 6h22\"/>"),
        Mark::Band => format!("<rect class=\"f{class}\" width=\"22\" height=\"12\"/>"),
    };
    format!(
        "<span class=\"key\"><svg class=\"key\" width=\"22\" height=\"12\" viewBox=\"0 0 22 12\" aria-hidden=\"true\">{drawn}</svg> {}</span>",
        escape(label)
    )
}

/// Labels of the axes: quantity and unit.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Labels<'a> {
    /// What the chart shows, for a screen reader.
    pub(crate) title: &'a str,
    /// Below.
    pub(crate) x: &'a str,
    /// To the left.
    pub(crate) y: &'a str,
}

/// A chart under construction.
#[derive(Debug)]
pub(crate) struct Chart {
    text: String,
    x: Scale,
    y: Scale,
}

/// From values to pixels.
#[derive(Debug, Clone, Copy)]
struct Scale {
    range: [f64; 2],
    pixels: [f64; 2],
}

impl Scale {
    fn at(&self, v: f64) -> f64 {
        let [low, high] = self.range;
        self.pixels[0] + (v - low) / (high - low) * (self.pixels[1] - self.pixels[0])
    }

    /// Round numbers inside the range, `least` pixels apart, with their labels.
    fn ticks(&self, least: f64) -> Vec<(f64, String)> {
        let [low, high] = self.range;
        let most = ((self.pixels[1] - self.pixels[0]).abs() / least).max(1.0);
        let rough = (high - low) / most;
        let below = round_below(rough);
        let fits = |s: &f64| *s >= rough * (1.0 - 1e-9) && (round_below(*s) - *s).abs() < 1e-6 * *s;
        let step = [1.0, 2.0, 2.5, 5.0].into_iter().map(|m| m * below).find(fits).unwrap_or(2.0 * below);
        let first = (low / step).ceil() as i64;
        let last = (high / step).floor() as i64;
        let decimals = (-(step * (1.0 + 1e-9)).log10().floor()).clamp(0.0, 9.0) as usize;
        let label = |v: f64| if v == 0.0 { "0".to_owned() } else { minus(&format!("{v:.decimals$}")) };
        (first..=last).map(|k| k as f64 * step).map(|v| (v, label(v))).collect()
    }
}

impl Chart {
    /// Axes over the ranges of some values, with some room; a range without extent gets one.
    pub(crate) fn new(
        size: (f64, f64),
        labels: Labels<'_>,
        x: impl IntoIterator<Item = f64>,
        y: impl IntoIterator<Item = f64>,
    ) -> Self {
        let [left, top, right, bottom] = ROOM;
        let (width, height) = size;
        let finite = |v: &f64| v.is_finite();
        let x = Scale { range: with_room(x.into_iter().filter(finite), 0.03), pixels: [left, width - right] };
        let y =
            Scale { range: with_room(y.into_iter().filter(finite), 0.06), pixels: [height - bottom, top] };
        let mut chart = Self { text: String::new(), x, y };
        chart.put(format_args!(
            "<svg class=\"chart\" viewBox=\"0 0 {width} {height}\" role=\"img\"><title>{}</title>",
            escape(labels.title)
        ));
        chart.axes(height, labels);
        chart
    }

    fn put(&mut self, text: std::fmt::Arguments<'_>) {
        // writing to a string cannot fail
        let _ = self.text.write_fmt(text);
    }

    fn axes(&mut self, height: f64, labels: Labels<'_>) {
        let ([left, right], [bottom, top]) = (self.x.pixels, self.y.pixels);
        for (v, label) in self.x.ticks(TICK_PX[0]) {
            let at = self.x.at(v);
            self.put(format_args!("<path class=\"grid\" d=\"M{at:.1} {bottom:.1}V{top:.1}\"/>"));
            self.words(at, bottom + 15.0, "middle", &label);
        }
        for (v, label) in self.y.ticks(TICK_PX[1]) {
            let (at, class) = (self.y.at(v), if v == 0.0 { "zero" } else { "grid" });
            self.put(format_args!("<path class=\"{class}\" d=\"M{left:.1} {at:.1}H{right:.1}\"/>"));
            self.words(left - 6.0, at + 4.0, "end", &label);
        }
        self.words(0.5 * (left + right), height - 7.0, "middle", &escape(&micro(labels.x)));
        self.put(format_args!(
            "<text transform=\"translate(13 {:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            0.5 * (bottom + top),
            escape(&micro(labels.y))
        ));
    }

    fn words(&mut self, x: f64, y: f64, anchor: &str, words: &str) {
        self.put(format_args!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{words}</text>"));
    }

    fn path(&self, points: impl Iterator<Item = (f64, f64)>) -> String {
        let mut text = String::new();
        for (k, (x, y)) in points.filter(|(x, y)| x.is_finite() && y.is_finite()).enumerate() {
            let _ = write!(text, "{}{:.1} {:.1}", if k == 0 { "M" } else { "L" }, self.x.at(x), self.y.at(y));
        }
        text
    }

    /// A line; the second and third colour are dashed and dotted, too.
    pub(crate) fn line(&mut self, ink: Ink, points: impl IntoIterator<Item = (f64, f64)>) {
        let path = self.path(points.into_iter());
        self.put(format_args!("<path class=\"l{}\" d=\"{path}\"/>", ink.class()));
    }

    /// A thin dashed line for reference, such as equality.
    pub(crate) fn reference(&mut self, points: impl IntoIterator<Item = (f64, f64)>) {
        let path = self.path(points.into_iter());
        self.put(format_args!("<path class=\"ref\" d=\"{path}\"/>"));
    }

    /// A band from (x, low, high).
    pub(crate) fn band(&mut self, ink: Ink, points: &[[f64; 3]]) {
        let there = points.iter().map(|p| (p[0], p[1]));
        let back = points.iter().rev().map(|p| (p[0], p[2]));
        let path = self.path(there.chain(back));
        self.put(format_args!("<path class=\"f{}\" d=\"{path}Z\"/>", ink.class()));
    }

    /// Dots, or crosses where they are the second of two series.
    pub(crate) fn marks(&mut self, mark: Mark, ink: Ink, points: impl IntoIterator<Item = (f64, f64)>) {
        let mut path = String::new();
        for (x, y) in points.into_iter().filter(|(x, y)| x.is_finite() && y.is_finite()) {
            let (x, y) = (self.x.at(x), self.y.at(y));
            let _ = match mark {
                Mark::Cross => write!(path, "M{:.1} {:.1}l4 4m0-4l-4 4", x - 2.0, y - 2.0),
                Mark::Ring => write!(path, "M{:.1} {y:.1}a2 2 0 1 0 4 0a2 2 0 1 0-4 0", x - 2.0),
                // a filled disc: a line of no length with round ends would not be printed
                _ => {
                    let r = if mark == Mark::Disc { DISC } else { 2.0 };
                    write!(path, "M{:.1} {y:.1}a{r} {r} 0 1 0 {1} 0 {r} {r} 0 1 0-{1} 0", x - r, 2.0 * r)
                }
            };
        }
        let kind = match mark {
            Mark::Cross => 'x',
            Mark::Ring => 'o',
            Mark::Disc => 'd',
            _ => 'p',
        };
        self.put(format_args!("<path class=\"{kind}{}\" d=\"{path}\"/>", ink.class()));
    }

    /// Vertical limits between the points of each pair.
    pub(crate) fn limits(&mut self, ink: Ink, pairs: &[(f64, f64)]) {
        let mut path = String::new();
        for pair in pairs.chunks_exact(2) {
            let (x, [low, high]) = (self.x.at(pair[0].0), [pair[0].1, pair[1].1].map(|v| self.y.at(v)));
            let _ = write!(path, "M{x:.1} {low:.1}V{high:.1}");
            for y in [low, high] {
                let _ = write!(path, "M{:.1} {y:.1}h6", x - 3.0);
            }
        }
        self.put(format_args!("<path class=\"x{}\" d=\"{path}\"/>", ink.class()));
    }

    /// The range that both axes show: where a line of equality runs.
    pub(crate) fn shared_range(&self) -> [f64; 2] {
        let ([a, b], [c, d]) = (self.x.range, self.y.range);
        [a.max(c), b.min(d)]
    }

    /// The finished markup.
    pub(crate) fn finish(mut self) -> String {
        self.text.push_str("</svg>");
        self.text
    }
}

/// A number with the sign of mathematics instead of a hyphen.
pub(crate) fn minus(number: &str) -> String {
    number.replace('-', "\u{2212}")
}

/// A bar between two values on a scale that begins at zero.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Bar {
    /// In words.
    pub(crate) label: String,
    /// From here.
    pub(crate) from: f64,
    /// To here.
    pub(crate) to: f64,
    /// What is written beside it.
    pub(crate) value: String,
    /// Colour.
    pub(crate) ink: Ink,
}

/// Horizontal bars, one below the other, on one scale; text wraps where the page is narrow.
pub(crate) fn bars(rows: &[Bar]) -> String {
    let most = rows.iter().flat_map(|r| [r.from, r.to]).filter(|v| v.is_finite()).fold(1e-9, f64::max);
    let percent = |v: f64| 100.0 * (v / most).clamp(0.0, 1.0);
    let mut text = "<div class=\"bars\">".to_owned();
    for r in rows {
        let (left, right) = (percent(r.from.min(r.to)), percent(r.from.max(r.to)));
        let _ = write!(
            text,
            "<div>{}</div><div class=\"track\"><span class=\"s{}\" style=\"left:{left:.2}%;width:{:.2}%\"></span></div><div>{}</div>",
            escape(&r.label),
            r.ink.class(),
            (right - left).max(0.3),
            escape(&r.value)
        );
    }
    text + "</div>"
}

#[cfg(test)]
mod tests {
    use super::*;

    const LABELS: Labels<'_> = Labels { title: "<t>", x: "x, mm", y: "y, µm" };

    #[test]
    fn ticks_are_round_and_neither_crowded_nor_missing() {
        for range in [[0.0, 1.0], [-3.2, 7.9], [1e5, 1.0001e5], [0.0, 0.013], [-47.0, -46.0]] {
            let scale = Scale { range, pixels: [58.0, 426.0] };
            let ticks = scale.ticks(TICK_PX[0]);
            let labels: std::collections::BTreeSet<&String> = ticks.iter().map(|t| &t.1).collect();
            assert_eq!(labels.len(), ticks.len(), "labels differ: {ticks:?}");
            assert!((2..=6).contains(&ticks.len()), "{range:?}: {ticks:?}");
            assert!(ticks.iter().all(|(t, _)| (range[0]..=range[1]).contains(t)), "{range:?}: {ticks:?}");
        }
    }

    #[test]
    fn a_chart_of_anything_has_finite_coordinates_and_no_markup_from_its_words() {
        for points in [vec![], vec![(1.0, 2.0)], vec![(0.0, 0.0), (f64::NAN, 1.0), (3.0, -4.0)]] {
            let mut chart = Chart::new(HALF, LABELS, points.iter().map(|p| p.0), points.iter().map(|p| p.1));
            chart.line(Ink::Blue, points.iter().copied());
            chart.marks(Mark::Dot, Ink::Grey, points.iter().copied());
            let svg = chart.finish();
            assert!(!svg.contains("NaN") && !svg.contains("inf") && svg.contains("&lt;t&gt;"), "{svg}");
        }
    }

    #[test]
    fn bars_stay_on_their_scale() {
        let bar = |from: f64, to: f64| Bar {
            label: "a".to_owned(),
            from,
            to,
            value: String::new(),
            ink: Ink::Blue,
        };
        let html = bars(&[bar(0.0, 8.0), bar(8.0, 2.0), bar(0.0, 0.0), bar(0.0, f64::NAN)]);
        assert!(html.contains("left:25.00%;width:75.00%") && !html.contains("NaN"), "{html}");
    }
}
