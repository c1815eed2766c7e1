//! Vectors of a plate: as measured, and what the fit leaves.

use crate::report::plot::*;

use volcomp_evaluate::{PlateFit, PlatePoint};
use volcomp_units::um_from_mm;

const HEIGHT: u32 = 430;
/// Above this many places arrows are drawn thin.
const MANY: usize = 150;
/// Room for axis labels beside and below a chart, pixels.
const LABELS: (f64, f64) = (66.0 + 8.0 + 16.0, 40.0 + 8.0 + 8.0);
/// Share of the plate that the longest arrow has.
const ARROW: f64 = 0.12;

/// A plate to be drawn.
pub(in crate::evaluate) struct Shown<'a> {
    /// Above the plot; none where empty.
    pub(in crate::evaluate) title: &'a str,
    pub(in crate::evaluate) points: &'a [PlatePoint],
    pub(in crate::evaluate) fit: &'a PlateFit,
}

/// Both pictures beside each other.
///
/// # Errors
/// The drawing library could not draw it.
pub(in crate::evaluate) fn whole(shown: &Shown<'_>) -> Svg {
    stacked(
        SHEET_WIDTH,
        shown.title,
        &[("", HEIGHT, &|body| {
            let (left, right) = body.split_horizontally(SHEET_WIDTH / 2);
            let measured =
                shown.points.iter().map(|p| [p.measured[0] - p.nominal[0], p.measured[1] - p.nominal[1]]);
            draw(&left, shown.points, &measured.collect::<Vec<_>>(), "measured minus nominal")?;
            draw(&right, shown.points, &shown.fit.residuals, "residuals of the fit")
        })],
    )
}

fn draw(area: &Area<'_>, points: &[PlatePoint], vectors: &[[f64; 2]], name: &str) -> Drawn {
    let (head, body) = area.split_vertically(2 * TITLE);
    let x = with_room(points.iter().map(|p| p.nominal[0]), 0.08);
    let y = with_room(points.iter().map(|p| p.nominal[1]), 0.08);
    // the same scale along x and y
    let (width, height) = body.dim_in_pixel();
    let room = (f64::from(width) - LABELS.0, f64::from(height) - LABELS.1);
    let per_pixel = ((x[1] - x[0]) / room.0).max((y[1] - y[0]) / room.1);
    let wide = |[low, high]: [f64; 2], pixels: f64| {
        let rest = 0.5 * (per_pixel * pixels - (high - low));
        [low - rest, high + rest]
    };
    let size = (x[1] - x[0]).max(y[1] - y[0]);
    let (x, y) = (wide(x, room.0), wide(y, room.1));
    let lengths = vectors.iter().map(|v| v[0].hypot(v[1])).enumerate();
    let (worst, largest) = lengths.reduce(|a, b| if b.1 > a.1 { b } else { a }).unwrap_or((0, 0.0));
    let magnification = if largest > 0.0 { round_below(ARROW * size / largest) } else { 1.0 };
    words(&head, &format!("{name}, magnified {magnification:.0} times"), (74, 12), 16)?;
    draw_scale(&head, magnification / per_pixel, largest)?;
    let axes = Axes { title: "", x_label: "X / mm", y_label: "Y / mm", x, y, right: 16, x_ticks: 7 };
    let mut chart = axes.draw(&body)?;
    chart.draw_series(points.iter().map(|p| Circle::new((p.nominal[0], p.nominal[1]), 2, GREY.filled())))?;
    let (width, barb) = if points.len() > MANY { (1, 3.0 * per_pixel) } else { (2, 6.0 * per_pixel) };
    for (i, (p, v)) in points.iter().zip(vectors).enumerate() {
        let colour = if i == worst { VERMILLION } else { BLUE };
        let from = (p.nominal[0], p.nominal[1]);
        let to = (from.0 + magnification * v[0], from.1 + magnification * v[1]);
        chart.draw_series(LineSeries::new([from, to], colour.stroke_width(width)))?;
        let length = magnification * v[0].hypot(v[1]);
        if length > barb {
            let tip = |angle: f64| {
                let (sin, cos) = angle.sin_cos();
                let (ux, uy) = (v[0] * magnification / length, v[1] * magnification / length);
                (to.0 - barb * (ux * cos - uy * sin), to.1 - barb * (ux * sin + uy * cos))
            };
            chart.draw_series(LineSeries::new([tip(0.45), to, tip(-0.45)], colour.stroke_width(width)))?;
        }
    }
    Ok(())
}

/// An arrow of a round length.
fn draw_scale(area: &Area<'_>, pixels_per_mm: f64, largest: f64) -> Drawn {
    if largest <= 0.0 {
        return words(area, "no deviation", (74, 38), 14);
    }
    let length = round_below(largest);
    let pixels = (length * pixels_per_mm).round() as i32;
    area.draw(&PathElement::new(vec![(76, 46), (76 + pixels, 46)], INK.stroke_width(2)))?;
    for x in [76, 76 + pixels] {
        area.draw(&PathElement::new(vec![(x, 41), (x, 51)], INK.stroke_width(2)))?;
    }
    let um = um_from_mm(length);
    let label = format!("{} µm; largest {:.2} µm", (um * 1e3).round() / 1e3, um_from_mm(largest));
    words(area, &label, (86 + pixels, 38), 14)
}
