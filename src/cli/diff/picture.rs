//! The curves that differ: what the first and what the second model says, in relative sense.

use crate::report::plot::*;

use super::Diff;
use crate::prelude::*;
use volcomp_model::compare::{ErrorDifference, relative_values};

const COLUMNS: usize = 2;
const ROW: u32 = 250;
const HEAD: u32 = 34;
const SAMPLES: u32 = 500;

/// All error motions that differ, and a bar for every constant.
///
/// # Errors
/// The drawing library could not draw it.
pub(super) fn curves(diff: &Diff) -> Svg {
    let moving: Vec<&ErrorDifference> = diff.found.errors.iter().filter(|e| e.over.is_some()).collect();
    let rows = moving.len().div_ceil(COLUMNS).max(1);
    let models = [Model::new(&diff.files[0].spec)?, Model::new(&diff.files[1].spec)?];
    svg_of((SHEET_WIDTH, HEAD + ROW * rows as u32), |area| {
        let (head, body) = area.split_vertically(HEAD);
        let keys =
            [Key::line(GREY, 3, "first"), Key::line(BLUE, 2, "second"), Key::line(BLUE, 1, "towards minus")];
        legend(&head, &keys, 74, 18)?;
        if moving.is_empty() {
            return words(&body, "no error motion differs", (74, 40), 15);
        }
        for (place, error) in body.split_evenly((rows, COLUMNS)).iter().zip(moving) {
            panel(place, diff, &models, error)?;
        }
        Ok(())
    })
}

/// Which model, which direction of travel, and the points.
type Line = (usize, Travel, Vec<(f64, f64)>);

fn panel(area: &Area<'_>, diff: &Diff, models: &[Model; 2], error: &ErrorDifference) -> Drawn {
    let (symbol, axis) = (error.symbol, error.symbol.axis());
    let Some([low, high]) = error.over else { return Ok(()) };
    let at: Vec<f64> =
        (0..=SAMPLES).map(|i| low + (high - low) * f64::from(i) / f64::from(SAMPLES)).collect();
    let line = |which: usize, travel: Travel| -> Vec<(f64, f64)> {
        let values = relative_values(&diff.files[which].spec, &models[which], symbol, &at, travel);
        at.iter().zip(values).map(|(q, v)| (position_out(axis, *q), error_out(symbol, v))).collect()
    };
    let both = |which| [Travel::Forward, Travel::Reverse].map(|t| (which, t, line(which, t)));
    let lines: Vec<Line> = [0, 1].into_iter().flat_map(both).collect();
    let [from, to] = [low, high].map(|q| position_out(axis, q));
    let (title, x_label) = (symbol.to_string(), format!("{axis} / {}", position_unit(axis)));
    let y_label = if symbol.is_angle() { "arcsec" } else { "µm" };
    let x = [from, if to > from { to } else { from + 1.0 }];
    let y = with_room(lines.iter().flat_map(|l| l.2.iter().map(|p| p.1)).chain([0.0]), 0.08);
    let axes = Axes { title: &title, x_label: &x_label, y_label, x, y, right: 18, x_ticks: 6 };
    let mut chart = axes.draw(area)?;
    for (which, travel, points) in &lines {
        let forward = lines.iter().find(|l| l.0 == *which && l.1 == Travel::Forward);
        // the reverse is drawn where it differs
        if *travel == Travel::Reverse && forward.is_some_and(|f| f.2 == *points) {
            continue;
        }
        let (colour, width) = if *which == 0 { (GREY, 3) } else { (BLUE, 2) };
        let width = if *travel == Travel::Reverse { 1 } else { width };
        chart.draw_series(LineSeries::new(points.iter().copied(), colour.stroke_width(width)))?;
    }
    Ok(())
}
