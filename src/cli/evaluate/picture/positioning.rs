//! The plot of ISO 230-2: deviations over the targets, mean and band of two standard deviations of each direction, B and
//! R where they occur, M, E and A as ranges.

use crate::report::plot::*;

use crate::evaluate::headed;
use crate::prelude::*;
use volcomp_evaluate::{AtTarget, Positioning, PositioningReading, Spread};

pub(in crate::evaluate) const HEIGHT: u32 = 370;
/// Height of one of two plots that share a sheet.
pub(in crate::evaluate) const HALF_HEIGHT: u32 = 285;
/// Height of the legend.
pub(in crate::evaluate) const LEGEND: u32 = 30;
/// Room at the right for the ranges, pixels.
const RANGES: u32 = 164;

/// What is drawn, in the units of the report.
pub(in crate::evaluate) struct Shown<'a> {
    pub(in crate::evaluate) result: &'a Positioning,
    pub(in crate::evaluate) readings: &'a [PositioningReading],
    pub(in crate::evaluate) unit: &'a str,
    pub(in crate::evaluate) target_unit: &'a str,
}

/// The range of deviations that holds every test to be compared.
pub(in crate::evaluate) fn scale<'a>(
    results: impl IntoIterator<Item = Option<&'a Positioning>>,
    readings: impl IntoIterator<Item = &'a [PositioningReading]>,
) -> [f64; 2] {
    let bands = results.into_iter().flatten().flat_map(|p| {
        p.targets.iter().flat_map(AtTarget::spreads).flat_map(|s| [s.mean - 2.0 * s.s, s.mean + 2.0 * s.s])
    });
    let single = readings.into_iter().flatten().map(|r| r.deviation);
    // the labels of B and R stand above the data
    let [low, high] = with_room(bands.chain(single).chain([0.0]), 0.05);
    [low, high + 0.16 * (high - low)]
}

/// One test.
///
/// # Errors
/// The drawing library could not draw it.
pub(in crate::evaluate) fn single(shown: &Shown<'_>, y: [f64; 2], height: u32) -> Svg {
    stacked(SHEET_WIDTH, "", &[("", height, &|area| draw(area, shown, y))])
}

/// One test, or the test before above it at the same scale.
///
/// # Errors
/// The drawing library could not draw it.
pub(in crate::evaluate) fn whole(title: &str, after: &Shown<'_>, before: Option<&Shown<'_>>) -> Svg {
    let y = scale(
        [Some(after.result), before.map(|b| b.result)],
        [after.readings, before.map_or(&[][..], |b| b.readings)],
    );
    stacked_tests(SHEET_WIDTH, title, &headed(before, after), |_| HEIGHT, |area, test| draw(area, test, y))
}

/// A test in an area; also used small, for the diagonals.
pub(in crate::evaluate) fn draw(area: &Area<'_>, shown: &Shown<'_>, y: [f64; 2]) -> Drawn {
    let (plot, below) = area.split_vertically(area.dim_in_pixel().1 - LEGEND);
    let chart = draw_deviations(&plot, shown, y, RANGES)?;
    draw_places(&plot, &chart, shown)?;
    draw_ranges(&plot, &chart, shown)?;
    draw_legend(&below, shown.result)
}

/// The axes with readings, bands and means.
pub(in crate::evaluate) fn draw_deviations<'a, 'b>(
    area: &'a Area<'b>,
    shown: &Shown<'_>,
    y: [f64; 2],
    right: u32,
) -> Drawn<Chart<'a, 'b>> {
    let targets = &shown.result.targets;
    let (x_label, y_label) =
        (format!("target / {}", shown.target_unit), format!("deviation / {}", shown.unit));
    let x = with_room(targets.iter().map(|t| t.target), 0.03);
    let axes = Axes { title: "", x_label: &x_label, y_label: &y_label, x, y, right, x_ticks: 9 };
    let mut chart = axes.draw(area)?;
    type Side = fn(&AtTarget) -> Option<Spread>;
    let sides: [(Side, RGBColor, Travel); 2] =
        [(|t| t.forward, BLUE, Travel::Forward), (|t| t.backward, VERMILLION, Travel::Reverse)];
    for (side, colour, travel) in sides {
        let line: Vec<(f64, Spread)> = targets.iter().filter_map(|t| Some((t.target, side(t)?))).collect();
        let edge = |sign: f64| line.iter().map(move |(x, s)| (*x, s.mean + sign * 2.0 * s.s));
        let band: Vec<(f64, f64)> = edge(1.0).chain(edge(-1.0).rev()).collect();
        if !band.is_empty() {
            chart.draw_series([Polygon::new(band, colour.mix(0.13))])?;
        }
        for sign in [1.0, -1.0] {
            chart.draw_series(LineSeries::new(edge(sign), colour.mix(0.45).stroke_width(1)))?;
        }
        let own = shown.readings.iter().filter(|r| r.travel == travel);
        chart.draw_series(own.map(|r| Circle::new((r.target, r.deviation), 2, colour.mix(0.55).filled())))?;
        let mean = line.iter().map(|(x, s)| (*x, s.mean));
        chart.draw_series(LineSeries::new(mean.clone(), colour.stroke_width(2)))?;
        chart.draw_series(mean.map(|p| Circle::new(p, 4, colour.filled())))?;
    }
    let both: Vec<(f64, f64)> = targets.iter().filter_map(|t| Some((t.target, t.mean()?))).collect();
    if !both.is_empty() {
        chart.draw_series(DashedLineSeries::new(both, 7, 5, INK.stroke_width(1)))?;
    }
    Ok(chart)
}

/// B and R where they occur.
fn draw_places(area: &Area<'_>, chart: &Chart<'_, '_>, shown: &Shown<'_>) -> Drawn {
    let targets = &shown.result.targets;
    let at = |of: fn(&AtTarget) -> Option<f64>| {
        let sized = targets.iter().filter_map(|t| Some((t, of(t)?)));
        sized.reduce(|a, b| if b.1 > a.1 { b } else { a })
    };
    let reversal = at(|t| t.reversal().map(f64::abs));
    let repeatability = at(AtTarget::repeatability).or_else(|| at(|t| t.spreads().next().map(|s| 4.0 * s.s)));
    let top = chart.y_range().end;
    let pixel = |chart: &Chart<'_, '_>, x: f64, y: f64| {
        let (px, py) = chart.backend_coord(&(x, y));
        let (x0, y0) = area.get_base_pixel();
        (px - x0, py - y0)
    };
    let width = area.dim_in_pixel().0 as i32;
    for (row, found, name) in [(0, reversal, "B"), (1, repeatability, "R")] {
        let Some((t, value)) = found else { continue };
        let [low, high] = match name {
            "B" => hull(t.spreads().map(|s| s.mean)),
            _ => repeatability_ends(t),
        };
        let side = if name == "B" { -9 } else { 9 };
        let ((x, y_low), (_, y_high)) = (pixel(chart, t.target, low), pixel(chart, t.target, high));
        let x = x + side;
        bracket(area, x, y_low, y_high)?;
        let (Shown { unit, target_unit, .. }, target) = (shown, (t.target * 1e3).round() / 1e3);
        let label = format!("{name} {value:.2} {unit} at {target} {target_unit}");
        let (_, y_top) = pixel(chart, t.target, top);
        let y = y_top + 5 + 18 * row;
        let room = 7 * label.chars().count() as i32;
        let left = if x + room > width - RANGES as i32 { x - room } else { x - 4 };
        area.draw(&PathElement::new(vec![(x, y_high), (x, y + 16)], GREY.stroke_width(1)))?;
        // white behind the words keeps the grid away from them
        area.draw(&Rectangle::new([(left - 2, y), (left + room, y + 16)], WHITE.mix(0.85).filled()))?;
        words(area, &label, (left, y + 1), 14)?;
    }
    Ok(())
}

/// Lowest and highest end of what makes up `R_i`.
fn repeatability_ends(t: &AtTarget) -> [f64; 2] {
    let ends = |s: &Spread| [s.mean - 2.0 * s.s, s.mean + 2.0 * s.s];
    let all: Vec<Spread> = t.spreads().collect();
    let widest = all.iter().copied().reduce(|a, b| if b.s > a.s { b } else { a });
    match (t.repeatability(), widest) {
        (Some(r), Some(w)) if r <= 4.0 * w.s => ends(&w),
        _ => hull(all.iter().flat_map(ends)),
    }
}

/// M, E and A as ranges beside the plot.
fn draw_ranges(area: &Area<'_>, chart: &Chart<'_, '_>, shown: &Shown<'_>) -> Drawn {
    let spreads = || shown.result.targets.iter().flat_map(AtTarget::spreads);
    let ranges = [
        ("M", hull(shown.result.targets.iter().filter_map(AtTarget::mean))),
        ("E", hull(spreads().map(|s| s.mean))),
        ("A", hull(spreads().flat_map(|s| [s.mean - 2.0 * s.s, s.mean + 2.0 * s.s]))),
    ];
    let (_, y0) = area.get_base_pixel();
    let left = area.dim_in_pixel().0 as i32 - RANGES as i32;
    for (i, (name, [low, high])) in
        ranges.into_iter().enumerate().filter(|(_, (_, [low, _]))| low.is_finite())
    {
        let y = |v: f64| chart.backend_coord(&(0.0, v)).1 - y0;
        let x = left + 22 + 51 * i as i32;
        bracket(area, x, y(low), y(high))?;
        words(area, name, (x - 4, y(high) - 36), 15)?;
        let text = format!("{:.2}", high - low);
        words(area, &text, (x - 4 * text.chars().count() as i32 + 2, y(high) - 19), 13)?;
    }
    Ok(())
}

/// A vertical range with its ends.
fn bracket(area: &Area<'_>, x: i32, from: i32, to: i32) -> Drawn {
    area.draw(&PathElement::new(vec![(x, from), (x, to)], INK.stroke_width(2)))?;
    for y in [from, to] {
        area.draw(&PathElement::new(vec![(x - 5, y), (x + 5, y)], INK.stroke_width(2)))?;
    }
    Ok(())
}

/// Colours and marks in words, below the axes.
pub(in crate::evaluate) fn draw_legend(area: &Area<'_>, result: &Positioning) -> Drawn {
    let keys = [
        result.forward.map(|_| Key::line(BLUE, 3, "forward, mean")),
        result.backward.map(|_| Key::line(VERMILLION, 3, "backward, mean")),
        Some(Key::band(GREY.mix(0.35), "± 2 s")),
        Some(Key::dot(GREY, "reading")),
        result.both.map(|_| Key::dashed(INK, 1, "mean of both")),
    ];
    legend(area, &keys.into_iter().flatten().collect::<Vec<_>>(), 74, 12)
}
