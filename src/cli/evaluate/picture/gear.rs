//! Gear diagrams: one panel per direction and flank, the traces of the teeth above each other at one scale.

use crate::report::plot::*;

const HEIGHT: u32 = 300;

/// Tooth, readings (mm, um), mean line (um at 0, um/mm).
pub(in crate::evaluate) type Drawing = (u32, Vec<(f64, f64)>, [f64; 2]);

/// One direction of one flank.
pub(in crate::evaluate) struct Panel {
    /// Direction and flank.
    pub(in crate::evaluate) name: String,
    /// Label of the positions.
    pub(in crate::evaluate) position: &'static str,
    /// Evaluation length, mm.
    pub(in crate::evaluate) evaluation: [f64; 2],
    /// The teeth.
    pub(in crate::evaluate) traces: Vec<Drawing>,
}

/// Distance of neighbouring traces, um: a round number with room for the widest trace.
pub(in crate::evaluate) fn step_um(shown: &[(&str, Vec<Panel>)]) -> f64 {
    let range = |trace: &Drawing| {
        let [low, high] = with_room(trace.1.iter().map(|r| r.1), 0.0);
        high - low
    };
    let widest = shown.iter().flat_map(|s| &s.1).flat_map(|p| &p.traces).map(range).fold(1.0f64, f64::max);
    let below = round_below(1.1 * widest);
    [1.0, 2.0, 2.5].into_iter().map(|m| m * below).find(|s| *s >= 1.1 * widest).unwrap_or(below)
}

fn height(panels: &[Panel]) -> u32 {
    panels.len().div_ceil(2) as u32 * HEIGHT
}

/// The panels of one measurement.
///
/// # Errors
/// The drawing library could not draw it.
pub(in crate::evaluate) fn single(panels: &[Panel], step: f64) -> Svg {
    stacked(SHEET_WIDTH, "", &[("", height(panels), &|area| draw(area, panels, step))])
}

/// Panels, before and after below each other with their headings.
///
/// # Errors
/// The drawing library could not draw it.
pub(in crate::evaluate) fn whole(title: &str, shown: &[(&str, Vec<Panel>)], step: f64) -> Svg {
    stacked_tests(SHEET_WIDTH, title, shown, |panels| height(panels), |area, panels| draw(area, panels, step))
}

fn draw(area: &Area<'_>, panels: &[Panel], step_um: f64) -> Drawn {
    let cells = area.split_evenly((panels.len().div_ceil(2).max(1), 2));
    for (cell, panel) in cells.iter().zip(panels) {
        draw_panel(cell, panel, step_um)?;
    }
    Ok(())
}

fn draw_panel(area: &Area<'_>, panel: &Panel, step_um: f64) -> Drawn {
    let x = with_room(panel.traces.iter().flat_map(|t| t.1.iter().map(|r| r.0)), 0.08);
    let count = panel.traces.len() as f64;
    let title = format!("{}, teeth {step_um} µm apart", panel.name);
    let (x_label, y) = (panel.position, [-step_um, count * step_um]);
    let axes = Axes { title: &title, x_label, y_label: "deviation / µm", x, y, right: 16, x_ticks: 7 };
    let mut chart = axes.draw(area)?;
    for (k, (tooth, readings, [offset, slope])) in panel.traces.iter().enumerate() {
        let base = k as f64 * step_um;
        // how the probe was set is no deviation: the trace is drawn about its mean line
        let middle = offset + slope * f64::midpoint(panel.evaluation[0], panel.evaluation[1]);
        let at = |p: f64, um: f64| (p, base + um - middle);
        chart.draw_series(LineSeries::new(readings.iter().map(|r| at(r.0, r.1)), BLUE.stroke_width(1)))?;
        let ends = panel.evaluation.map(|p| at(p, offset + slope * p));
        chart.draw_series(LineSeries::new(ends, VERMILLION.stroke_width(1)))?;
        let style = (FONT, 13).into_font().color(&INK);
        chart.draw_series([Text::new(tooth.to_string(), (x[0], base), style)])?;
    }
    for end in panel.evaluation {
        let line = y.map(|y| (end, y));
        chart.draw_series(DashedLineSeries::new(line, 4, 4, INK.stroke_width(1)))?;
    }
    Ok(())
}
