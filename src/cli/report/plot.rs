//! The ground of all plots: colours that colour-blind readers and grey prints keep apart, one font, axes with units,
//! ticks with as many decimals as they need.

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
pub(crate) use plotters::prelude::*;

use crate::numerals::micro;
use volcomp_model::statistics::hull;

/// The first series.
pub(crate) const BLUE: RGBColor = RGBColor(0, 114, 178);
/// The second series.
pub(crate) const VERMILLION: RGBColor = RGBColor(213, 94, 0);
/// Text and axes.
pub(crate) const INK: RGBColor = RGBColor(60, 60, 60);
/// Grid lines.
pub(crate) const FAINT: RGBColor = RGBColor(205, 205, 205);
/// What the rest is compared with.
pub(crate) const GREY: RGBColor = RGBColor(150, 150, 150);
/// The font of everything.
pub(crate) const FONT: &str = "sans-serif";
/// Width of a picture that fills a page.
pub(crate) const WIDTH: u32 = 1200;

/// Width of a plot that stays legible where a page is printed on A4 (13 pixels are 8 points).
pub(crate) const SHEET_WIDTH: u32 = 840;

/// A part of a picture.
pub(crate) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
/// The result of drawing.
pub(crate) type Drawn<T = ()> = Result<T, Box<dyn std::error::Error>>;
/// A finished picture.
pub(crate) type Svg = Drawn<String>;
/// A chart with straight axes.
pub(crate) type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// A picture of the width of a page.
pub(crate) fn svg(height: u32, draw: impl FnOnce(&Area<'_>) -> Drawn) -> Svg {
    svg_of((WIDTH, height), draw)
}

/// A picture.
pub(crate) fn svg_of(size: (u32, u32), draw: impl FnOnce(&Area<'_>) -> Drawn) -> Svg {
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        area.fill(&WHITE)?;
        draw(&area)?;
        area.present()?;
    }
    Ok(text)
}

/// Height of a title above a picture or a part of one.
pub(crate) const TITLE: u32 = 34;
/// A part of a stacked picture: its heading, none where empty; its height; how it is drawn.
pub(crate) type Part<'a> = (&'a str, u32, &'a dyn Fn(&Area<'_>) -> Drawn);

/// Parts below each other under a title; there is no room for a title or heading that is empty.
pub(crate) fn stacked(width: u32, title: &str, parts: &[Part<'_>]) -> Svg {
    let head = |text: &str| if text.is_empty() { 0 } else { TITLE };
    let height = parts.iter().map(|(heading, height, _)| head(heading) + height).sum::<u32>();
    svg_of((width, head(title) + height), |area| {
        let mut rest = titled(area, title, 20)?;
        for (heading, height, draw) in parts {
            let (here, below) = titled(&rest, heading, 18)?.split_vertically(*height);
            draw(&here)?;
            rest = below;
        }
        Ok(())
    })
}

/// Tests of one kind below each other, each with its heading.
pub(crate) fn stacked_tests<T>(
    width: u32,
    title: &str,
    tests: &[(&str, T)],
    height: impl Fn(&T) -> u32,
    draw: impl Fn(&Area<'_>, &T) -> Drawn,
) -> Svg {
    let draw = &draw;
    let drawn: Vec<_> = tests.iter().map(|(_, test)| move |area: &Area<'_>| draw(area, test)).collect();
    let parts = tests.iter().zip(&drawn).map(|((heading, test), draw)| (*heading, height(test), draw as _));
    stacked(width, title, &parts.collect::<Vec<Part<'_>>>())
}

/// Words above a picture; what is left below them.
pub(crate) fn titled<'a>(area: &Area<'a>, text: &str, size: u32) -> Drawn<Area<'a>> {
    if text.is_empty() {
        return Ok(area.clone());
    }
    let (head, body) = area.split_vertically(TITLE);
    words(&head, text, (14, 10), size)?;
    Ok(body)
}

/// Axes of a chart.
#[derive(Debug, Clone)]
pub(crate) struct Axes<'a> {
    /// Above the chart; none where empty.
    pub(crate) title: &'a str,
    /// Quantity and unit.
    pub(crate) x_label: &'a str,
    /// Quantity and unit.
    pub(crate) y_label: &'a str,
    /// Lowest and highest value.
    pub(crate) x: [f64; 2],
    /// Lowest and highest value.
    pub(crate) y: [f64; 2],
    /// Room to the right of the chart, pixels.
    pub(crate) right: u32,
    /// Ticks of x at these values instead of round numbers.
    pub(crate) x_ticks: usize,
}

impl Axes<'_> {
    /// Draws the axes with grid and labels.
    pub(crate) fn draw<'a, 'b>(&self, area: &'a Area<'b>) -> Drawn<Chart<'a, 'b>> {
        self.sized(area, ([15, 14, 13], [40, 66], 9))
    }

    /// The same for one of several charts side by side.
    pub(crate) fn draw_small<'a, 'b>(&self, area: &'a Area<'b>) -> Drawn<Chart<'a, 'b>> {
        self.sized(area, ([14, 13, 12], [36, 58], 5))
    }

    /// Sizes of title, quantities and numbers, room below and to the left, and number of ticks of y.
    fn sized<'a, 'b>(&self, area: &'a Area<'b>, sizes: ([u32; 3], [u32; 2], usize)) -> Drawn<Chart<'a, 'b>> {
        let ([title, quantity, number], [below, left], y_ticks) = sizes;
        let mut builder = ChartBuilder::on(area);
        if !self.title.is_empty() {
            builder.caption(micro(self.title), (FONT, title).into_font().color(&INK));
        }
        let mut chart = builder
            .margin(8)
            .margin_right(self.right.max(16))
            .x_label_area_size(below)
            .y_label_area_size(left)
            .build_cartesian_2d(self.x[0]..self.x[1], self.y[0]..self.y[1])?;
        let ([x_low, x_high], [y_low, y_high]) = (self.x, self.y);
        chart
            .configure_mesh()
            .x_desc(micro(self.x_label))
            .y_desc(micro(self.y_label))
            .x_labels(self.x_ticks)
            .y_labels(y_ticks)
            .x_label_formatter(&|v| tick(*v, x_high - x_low))
            .y_label_formatter(&|v| tick(*v, y_high - y_low))
            .axis_desc_style((FONT, quantity))
            .label_style((FONT, number))
            .light_line_style(TRANSPARENT)
            .bold_line_style(FAINT)
            .axis_style(INK)
            .draw()?;
        if y_low < 0.0 && y_high > 0.0 {
            chart.draw_series(LineSeries::new([(x_low, 0.0), (x_high, 0.0)], INK.stroke_width(1)))?;
        }
        Ok(chart)
    }
}

/// A tick label with as many decimals as the length of the scale needs.
pub(crate) fn tick(v: f64, length: f64) -> String {
    let decimals = (1.0 - length.log10()).ceil().clamp(0.0, 6.0) as usize;
    let text = format!("{v:.decimals$}");
    if text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.') { "0".to_owned() } else { text }
}

/// A range with some room at both ends; around zero where all is zero.
pub(crate) fn with_room(values: impl IntoIterator<Item = f64>, share: f64) -> [f64; 2] {
    let [low, high] = hull(values);
    if !(low.is_finite() && high.is_finite()) {
        return [-1.0, 1.0];
    }
    let room = if high > low { share * (high - low) } else { low.abs().max(1.0) };
    [low - room, high + room]
}

/// The round number (1, 2 or 5 times a power of ten) that is at most `v`.
pub(crate) fn round_below(v: f64) -> f64 {
    if !(v.is_finite() && v > 0.0) {
        return 1.0;
    }
    let power = 10f64.powf(v.log10().floor());
    [5.0, 2.0, 1.0].into_iter().map(|m| m * power).find(|m| *m <= v * (1.0 + 1e-12)).unwrap_or(power)
}

/// Words at a place of an area, from its upper left corner.
pub(crate) fn words(area: &Area<'_>, text: &str, at: (i32, i32), size: u32) -> Drawn {
    area.draw(&Text::new(micro(text), at, (FONT, size).into_font().color(&INK)))?;
    Ok(())
}

/// An entry of a legend.
#[derive(Debug, Clone)]
pub(crate) struct Key {
    /// Colour.
    pub(crate) colour: RGBAColor,
    /// Width of the line; 0 is a dot, 255 a filled band.
    pub(crate) width: u32,
    /// The line is dashed.
    pub(crate) dashed: bool,
    /// Words.
    pub(crate) label: String,
}

impl Key {
    /// A line.
    pub(crate) fn line(colour: impl Into<RGBAColor>, width: u32, label: impl Into<String>) -> Self {
        Self { colour: colour.into(), width, dashed: false, label: label.into() }
    }

    /// A dashed line.
    pub(crate) fn dashed(colour: impl Into<RGBAColor>, width: u32, label: impl Into<String>) -> Self {
        Self { dashed: true, ..Self::line(colour, width, label) }
    }

    /// A dot.
    pub(crate) fn dot(colour: impl Into<RGBAColor>, label: impl Into<String>) -> Self {
        Self::line(colour, 0, label)
    }

    /// A band.
    pub(crate) fn band(colour: impl Into<RGBAColor>, label: impl Into<String>) -> Self {
        Self::line(colour, u32::from(u8::MAX), label)
    }
}

/// A legend in one row, from `x` on; widths are estimated from the letters.
pub(crate) fn legend(area: &Area<'_>, keys: &[Key], mut x: i32, y: i32) -> Drawn {
    for key in keys {
        match key.width {
            0 => area.draw(&Circle::new((x + 13, y), 3, key.colour.filled()))?,
            255 => area.draw(&Rectangle::new([(x, y - 6), (x + 26, y + 6)], key.colour.filled()))?,
            width => {
                // three dashes of 6 with gaps of 4
                let ends = if key.dashed { &[[0, 6], [10, 16], [20, 26]][..] } else { &[[0, 26]] };
                for [from, to] in ends {
                    let style = key.colour.stroke_width(width);
                    area.draw(&PathElement::new(vec![(x + from, y), (x + to, y)], style))?;
                }
            }
        }
        words(area, &key.label, (x + 32, y - 7), 14)?;
        x += 32 + 28 + (key.label.chars().count() as f64 * 7.1) as i32;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_have_the_decimals_that_they_need() {
        for (v, length, text) in [
            (5.0, 20.0, "5"),
            (0.25, 1.0, "0.2"),
            (-0.0, 20.0, "0"),
            (0.005, 0.02, "0.005"),
            (-300.0, 500.0, "-300"),
        ] {
            assert_eq!(tick(v, length), text);
        }
    }

    #[test]
    fn ranges_and_round_numbers() {
        assert_eq!(with_room([], 0.1), [-1.0, 1.0]);
        assert_eq!(with_room([0.0, 0.0], 0.1), [-1.0, 1.0]);
        assert_eq!(with_room([0.0, 10.0], 0.1), [-1.0, 11.0]);
        for (v, round) in [(7.3, 5.0), (0.21, 0.2), (1.0, 1.0), (999.0, 500.0), (5.0, 5.0), (0.0, 1.0)] {
            assert!((round_below(v) - round).abs() < 1e-12, "{v}");
        }
    }
}
