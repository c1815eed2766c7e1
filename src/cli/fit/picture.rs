//! Pictures of fits: readings, curve and confidence band, and the residuals below, one pair of panels per error.
//! Directions are distinguished by blue and vermillion, which colour-blind readers and grey prints keep apart.

use crate::report::plot::*;

use super::report::{Fitted, note_text, outlier_lines};
use crate::prelude::*;

const SIZE: (u32, u32) = (1100, 520);
/// Height of the panel of residuals.
const BELOW: u32 = 180;
const SAMPLES: u32 = 500;
/// More readings than this are drawn thinned out, the outliers and the largest residuals kept.
const READINGS: usize = 3000;

/// Pictures of a fit: measured, fitted or predicted, residuals.
#[derive(Debug, clap::Args)]
pub(super) struct PictureArgs {
    /// Write curves, confidence bands and residuals as one HTML page.
    #[arg(long, value_name = "FILE.html")]
    html: Option<PathBuf>,
    /// Draw curves, confidence bands and residuals.
    #[arg(long, value_name = "FILE.svg")]
    svg: Option<PathBuf>,
    /// The name before --html and --svg; the ending of the file chooses.
    #[arg(long, value_name = "FILE", hide = true, value_parser = picture)]
    picture: Option<PathBuf>,
}

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    let own = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
    endings.iter().any(|e| own.eq_ignore_ascii_case(e))
}

fn picture(text: &str) -> Result<PathBuf, &'static str> {
    let path = PathBuf::from(text);
    if has_ending(&path, &["svg", "html", "htm"]) {
        Ok(path)
    } else {
        Err("the name must end in .svg or .html")
    }
}

impl PictureArgs {
    /// Writes the files that were asked for: a bare picture, or a page with figures and notes.
    pub(super) fn write(&self, svg: impl Fn() -> Svg, page: impl Fn() -> Svg) -> Result<()> {
        let named = self.picture.iter().map(|path| (path, !has_ending(path, &["svg"])));
        let pages = self.html.iter().map(|path| (path, true));
        for (path, is_page) in pages.chain(self.svg.iter().map(|path| (path, false))).chain(named) {
            let drawn = if is_page { page() } else { svg() };
            let text = drawn.map_err(|e| {
                let path = path.display();
                failure!(EX_SOFTWARE, "{path}: the picture cannot be drawn: {e}")
            })?;
            write_text(path, &text)?;
        }
        Ok(())
    }
}

/// All panels in one drawing.
pub(super) fn svg(fitted: &[Fitted]) -> Svg {
    let tests: Vec<_> = fitted.iter().map(|f| ("", f)).collect();
    stacked_tests(SIZE.0, "", &tests, |_| SIZE.1, |area, f| draw(area, f))
}

/// A page with figures, panels and notes.
pub(super) fn page(fitted: &[Fitted]) -> Svg {
    let mut page = Page::new("Fitted error curves");
    for f in fitted {
        let (Units { value: unit, of_value, .. }, figures) = (Units::of(f.symbol), &f.fit.figures);
        let order = f.fit.order.map_or_else(String::new, |o| format!(" of order {o}"));
        page.heading(format_args!("{}: {}{order}", f.symbol, f.fit.basis.name()));
        let show = |v: Option<f64>| format!("{} {unit}", or_dash(v.map(of_value), 4));
        let cells = [
            ("readings", figures.n.to_string()),
            ("numbers of the curve", figures.m.to_string()),
            ("rmse", show(figures.rmse_dof)),
            ("largest", show(Some(figures.e_max))),
            ("left out", show(figures.position_rmse)),
        ];
        page.head_table(&[cells.into_iter().flat_map(|(k, v)| [Cell::head(k), Cell::text(v)]).collect()]);
        page.picture(&svg(core::slice::from_ref(f))?);
        let notes = f.fit.notes.iter().map(|n| note_text(f.symbol, *n)).chain(outlier_lines(f));
        notes.for_each(|note| page.paragraph(note));
    }
    Ok(page.finish())
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
        let &Units { of_value, of_position, .. } = units;
        let (mut points, mut outliers) = ([Vec::new(), Vec::new()], Vec::new());
        let mut is_outlier = f.fit.outliers.iter().map(|o| o.index).peekable();
        let step = f.measured.readings.len().div_ceil(READINGS);
        for (i, r) in f.measured.readings.iter().enumerate() {
            let (x, value) = (of_position(r.position), of_value(r.value));
            if is_outlier.next_if_eq(&i).is_some() {
                outliers.push((x, value));
                continue;
            }
            let residual = r.value - f.fit.value(r.position, r.travel);
            if i % step == 0 || residual.abs() >= 0.999 * f.fit.figures.e_max {
                points[usize::from(r.travel == Travel::Reverse)].push((x, value, of_value(residual)));
            }
        }
        let [low, high] = f.fit.curve.range().unwrap_or([0.0, 1.0]);
        let curve = |(colour, travel): (RGBColor, Travel)| {
            let sample = |i: u32| {
                let x = low + (high - low) * f64::from(i) / f64::from(SAMPLES);
                let half = f.fit.band.as_ref().map_or(0.0, |b| b.factor_95() * b.std_at(x, travel));
                (of_position(x), of_value(f.fit.value(x, travel)), of_value(half))
            };
            (colour, (0..=SAMPLES).map(sample).collect())
        };
        let directions = [(BLUE, Travel::Forward), (VERMILLION, Travel::Reverse)];
        let curves = directions.into_iter().take(1 + usize::from(f.is_directed())).map(curve).collect();
        Self { points, outliers, curves, x: [low, high].map(of_position) }
    }

    fn values(&self) -> impl Iterator<Item = f64> {
        let read = self.points.iter().flatten().map(|p| p.1).chain(self.outliers.iter().map(|p| p.1));
        read.chain(self.curves.iter().flat_map(|(_, l)| l.iter().flat_map(|p| [p.1 - p.2, p.1 + p.2])))
    }
}

fn draw(area: &Area<'_>, f: &Fitted) -> Drawn {
    let units = Units::of(f.symbol);
    let lines = Lines::of(f, &units);
    let (above, below) = area.split_vertically(SIZE.1 - BELOW);
    let [low, high] = lines.x;
    let room = 0.01 * (high - low);
    let title = format!("{} {}: readings, curve, 95 % band", f.symbol, f.fit.basis.name());
    let (y, x) = (with_room(lines.values(), 0.06), [low - room, high + room]);
    let axes = Axes { title: &title, x_label: "", y_label: units.value, x, y, right: 16, x_ticks: 0 };
    let mut chart = axes.draw(&above)?;
    for (colour, line) in &lines.curves {
        let upper = line.iter().map(|p| (p.0, p.1 + p.2));
        let lower = line.iter().rev().map(|p| (p.0, p.1 - p.2));
        chart.draw_series([Polygon::new(upper.chain(lower).collect::<Vec<_>>(), colour.mix(0.18))])?;
        chart.draw_series(LineSeries::new(line.iter().map(|p| (p.0, p.1)), colour.stroke_width(2)))?;
    }
    let dots = |at: fn(&Sample) -> (f64, f64)| {
        let of = move |(points, colour): (&Vec<Sample>, RGBColor)| {
            points.iter().map(|p| Circle::new(at(p), 2, colour.filled())).collect::<Vec<_>>()
        };
        lines.points.iter().zip([BLUE, VERMILLION]).flat_map(of).collect::<Vec<_>>()
    };
    chart.draw_series(dots(|p| (p.0, p.1)))?;
    chart.draw_series(lines.outliers.iter().map(|p| Cross::new(*p, 5, INK.stroke_width(2))))?;
    let labels = [format!("{} / {}", f.symbol.axis(), units.position), format!("residual / {}", units.value)];
    let y = with_room(lines.points.iter().flatten().map(|p| p.2).chain([0.0]), 0.06);
    let axes = Axes { title: "", x_label: &labels[0], y_label: &labels[1], y, x_ticks: 11, ..axes };
    axes.draw(&below)?.draw_series(dots(|p| (p.0, p.2)))?;
    Ok(())
}
