//! Pictures of fits: readings, curve and confidence band, and the residuals below, one pair of panels per error.
//! Directions are distinguished by blue and vermillion, which colour-blind readers and grey prints keep apart.

use core::fmt::Write as _;
use std::path::{Path, PathBuf};

use plotters::coord::Shift;
use plotters::prelude::*;

use super::report::{Fitted, note_text, outlier_lines};
use crate::files::write_text;
use crate::units::{Units, or_dash};
use crate::{EX_SOFTWARE, Failure};
use volcomp_units::axes::Travel;

const FORWARD: RGBColor = RGBColor(0, 114, 178);
const REVERSE: RGBColor = RGBColor(213, 94, 0);
const INK: RGBColor = RGBColor(60, 60, 60);
const FAINT: RGBColor = RGBColor(205, 205, 205);
const FONT: &str = "sans-serif";
const SIZE: (u32, u32) = (1100, 520);
/// Height of the panel of residuals.
const BELOW: u32 = 180;
const SAMPLES: u32 = 500;
/// More readings than this are drawn thinned out, the outliers and the largest residuals kept.
const READINGS: usize = 3000;

type Drawn = Result<(), Box<dyn std::error::Error>>;

/// How a picture is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Svg,
    Html,
}

/// Pictures of a fit: measured, fitted or predicted, residuals.
#[derive(Debug, clap::Args)]
pub(super) struct PictureArgs {
    /// Write curves, confidence bands and residuals as one HTML page.
    #[arg(long, value_name = "FILE.html", value_parser = PicturePath::html)]
    html: Option<PicturePath>,
    /// Draw curves, confidence bands and residuals.
    #[arg(long, value_name = "FILE.svg", value_parser = PicturePath::svg)]
    svg: Option<PicturePath>,
    /// The name before --html and --svg; the ending of the file chooses.
    #[arg(long, value_name = "FILE", hide = true)]
    picture: Option<PicturePath>,
}

impl PictureArgs {
    /// Files to write.
    pub(super) fn paths(&self) -> impl Iterator<Item = &PicturePath> {
        [&self.html, &self.svg, &self.picture].into_iter().flatten()
    }
}

/// A file name that says how the picture is written.
#[derive(Debug, Clone)]
pub(super) struct PicturePath(PathBuf, Kind);

impl core::str::FromStr for PicturePath {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let path = PathBuf::from(text);
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        match extension.as_str() {
            "svg" => Ok(Self(path, Kind::Svg)),
            "html" | "htm" => Ok(Self(path, Kind::Html)),
            _ => Err("the name must end in .svg or .html"),
        }
    }
}

impl PicturePath {
    fn html(text: &str) -> Result<Self, core::convert::Infallible> {
        Ok(Self(text.into(), Kind::Html))
    }

    fn svg(text: &str) -> Result<Self, core::convert::Infallible> {
        Ok(Self(text.into(), Kind::Svg))
    }

    /// The file, and whether it is a page instead of a bare picture.
    pub(super) fn parts(&self) -> (&Path, bool) {
        (&self.0, self.1 == Kind::Html)
    }
}

/// Writes the picture: all panels in one drawing, or a page with figures and notes.
pub(super) fn write(PicturePath(path, kind): &PicturePath, fitted: &[Fitted]) -> Result<(), Failure> {
    let drawn = match kind {
        Kind::Svg => svg(fitted),
        Kind::Html => page(fitted),
    };
    let text = drawn.map_err(|e| {
        Failure::new(EX_SOFTWARE, format_args!("error: {}: the picture cannot be drawn: {e}", path.display()))
    })?;
    write_text(path, &text)
}

fn svg(fitted: &[Fitted]) -> Result<String, Box<dyn std::error::Error>> {
    let mut text = String::new();
    {
        let height = SIZE.1 * fitted.len().max(1) as u32;
        let mut rest = SVGBackend::with_string(&mut text, (SIZE.0, height)).into_drawing_area();
        rest.fill(&WHITE)?;
        for f in fitted {
            let (here, below) = rest.split_vertically(SIZE.1);
            draw(&here, f)?;
            rest = below;
        }
        rest.present()?;
    }
    Ok(text)
}

fn page(fitted: &[Fitted]) -> Result<String, Box<dyn std::error::Error>> {
    let mut out = String::from(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>Fitted error curves</title>\
         <style>body{font:15px/1.45 sans-serif;color:#222;max-width:1140px;margin:24px auto;padding:0 16px}\
         svg{max-width:100%;height:auto}td,th{padding:2px 14px 2px 0;text-align:left}</style></head>\n<body>\
         <h1>Fitted error curves</h1>",
    );
    for f in fitted {
        let (units, figures) = (Units::of(f.symbol), &f.fit.figures);
        let show = |v: Option<f64>| or_dash(v.map(units.of_value), 4);
        let order = f.fit.order.map_or_else(String::new, |o| format!(" of order {o}"));
        write!(
            out,
            "<h2>{}: {}{order}</h2><table><tr><th>n</th><td>{}</td><th>m</th><td>{}</td><th>rmse</th><td>{} {u}</td>\
             <th>largest</th><td>{} {u}</td><th>left out</th><td>{} {u}</td></tr></table>\n{}",
            f.symbol,
            f.fit.basis.name(),
            figures.n,
            figures.m,
            show(figures.rmse_dof),
            show(Some(figures.e_max)),
            show(figures.position_rmse),
            svg(core::slice::from_ref(f))?,
            u = units.value
        )?;
        let notes = f.fit.notes.iter().map(|n| note_text(f.symbol, *n)).chain(outlier_lines(f));
        for note in notes {
            let note = note.replace('&', "&amp;").replace('<', "&lt;");
            write!(out, "<p>{note}</p>")?;
        }
    }
    out.push_str("</body></html>\n");
    Ok(out)
}

/// Position, and two values there.
type Sample = (f64, f64, f64);

/// What one pair of panels shows, in the units of the file.
struct Lines {
    /// Position, value and residual of each reading, by direction.
    points: [Vec<Sample>; 2],
    outliers: Vec<(f64, f64)>,
    /// Position, value and half width of the 95 % band, by direction.
    curves: Vec<(RGBColor, Vec<Sample>)>,
    x: [f64; 2],
}

impl Lines {
    fn of(f: &Fitted, units: &Units) -> Self {
        let mut points = [Vec::new(), Vec::new()];
        let mut is_outlier = f.fit.outliers.iter().map(|o| o.index).peekable();
        let step = f.measured.readings.len().div_ceil(READINGS);
        let mut outliers = Vec::new();
        for (i, r) in f.measured.readings.iter().enumerate() {
            let x = (units.of_position)(r.position);
            if is_outlier.peek() == Some(&i) {
                is_outlier.next();
                outliers.push((x, (units.of_value)(r.value)));
                continue;
            }
            let residual = r.value - f.fit.value(r.position, r.travel);
            if i % step == 0 || residual.abs() >= 0.999 * f.fit.figures.e_max {
                points[usize::from(r.travel == Travel::Reverse)].push((
                    x,
                    (units.of_value)(r.value),
                    (units.of_value)(residual),
                ));
            }
        }
        let [low, high] = f.fit.curve.range().unwrap_or([0.0, 1.0]);
        let mut directions = vec![(FORWARD, Travel::Forward)];
        if f.is_directed() {
            directions.push((REVERSE, Travel::Reverse));
        }
        let curves = directions
            .into_iter()
            .map(|(colour, travel)| {
                let line = (0..=SAMPLES).map(|i| {
                    let x = low + (high - low) * f64::from(i) / f64::from(SAMPLES);
                    let half = f.fit.band.as_ref().map_or(0.0, |b| b.factor_95() * b.std_at(x, travel));
                    let value = (units.of_value)(f.fit.value(x, travel));
                    ((units.of_position)(x), value, (units.of_value)(half))
                });
                (colour, line.collect())
            })
            .collect();
        Self { points, outliers, curves, x: [low, high].map(units.of_position) }
    }

    fn values(&self) -> [f64; 2] {
        let read = self.points.iter().flatten().map(|p| p.1).chain(self.outliers.iter().map(|p| p.1));
        let curves = self.curves.iter().flat_map(|(_, l)| l.iter().flat_map(|p| [p.1 - p.2, p.1 + p.2]));
        roomy(read.chain(curves))
    }
}

/// Lowest and highest value with some room.
fn roomy(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if !(low.is_finite() && high > low) {
        let middle = if low.is_finite() { low } else { 0.0 };
        return [middle - 1.0, middle + 1.0];
    }
    let room = 0.06 * (high - low);
    [low - room, high + room]
}

fn draw(area: &DrawingArea<SVGBackend<'_>, Shift>, f: &Fitted) -> Drawn {
    let units = Units::of(f.symbol);
    let lines = Lines::of(f, &units);
    let (above, below) = area.split_vertically(SIZE.1 - BELOW);
    let [low, high] = lines.x;
    let room = 0.01 * (high - low);
    let x = low - room..high + room;
    let [y_low, y_high] = lines.values();
    let title = format!("{} {}: readings, curve, 95 % band", f.symbol, f.fit.basis.name());
    let mut chart = ChartBuilder::on(&above)
        .caption(title, (FONT, 16).into_font().color(&INK))
        .margin(8)
        .x_label_area_size(8)
        .y_label_area_size(64)
        .build_cartesian_2d(x.clone(), y_low..y_high)?;
    chart
        .configure_mesh()
        .y_desc(units.value)
        .x_labels(0)
        .label_style((FONT, 12))
        .light_line_style(TRANSPARENT)
        .bold_line_style(FAINT)
        .draw()?;
    for (colour, line) in &lines.curves {
        let upper = line.iter().map(|p| (p.0, p.1 + p.2));
        let lower = line.iter().rev().map(|p| (p.0, p.1 - p.2));
        chart.draw_series([Polygon::new(upper.chain(lower).collect::<Vec<_>>(), colour.mix(0.18))])?;
        chart.draw_series(LineSeries::new(line.iter().map(|p| (p.0, p.1)), colour.stroke_width(2)))?;
    }
    for (points, colour) in lines.points.iter().zip([FORWARD, REVERSE]) {
        chart.draw_series(points.iter().map(|p| Circle::new((p.0, p.1), 2, colour.filled())))?;
    }
    chart.draw_series(lines.outliers.iter().map(|p| Cross::new(*p, 5, INK.stroke_width(2))))?;
    let [y_low, y_high] = roomy(lines.points.iter().flatten().map(|p| p.2).chain([0.0]));
    let mut chart = ChartBuilder::on(&below)
        .margin(8)
        .x_label_area_size(36)
        .y_label_area_size(64)
        .build_cartesian_2d(x, y_low..y_high)?;
    chart
        .configure_mesh()
        .x_desc(format!("{} / {}", f.symbol.axis(), units.position))
        .y_desc(format!("residual / {}", units.value))
        .y_labels(5)
        .label_style((FONT, 12))
        .light_line_style(TRANSPARENT)
        .bold_line_style(FAINT)
        .draw()?;
    chart.draw_series(LineSeries::new([(low, 0.0), (high, 0.0)], INK.stroke_width(1)))?;
    for (points, colour) in lines.points.iter().zip([FORWARD, REVERSE]) {
        chart.draw_series(points.iter().map(|p| Circle::new((p.0, p.2), 2, colour.filled())))?;
    }
    Ok(())
}
