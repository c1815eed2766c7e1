//! Error curves: six panels per axis, lengths above, angles below.

use crate::report::plot::*;

use crate::model::report::kinds_words;
use crate::prelude::*;
use volcomp_model::search::reference_pose;

const SAMPLES: u32 = 600;

/// What one panel shows, in the units of the file.
struct Panel {
    title: String,
    unit: &'static str,
    x: [f64; 2],
    x_label: String,
    forward: Vec<Vec<(f64, f64)>>,
    reverse: Vec<(f64, f64)>,
    /// Standard uncertainty.
    std: Option<f64>,
    note: Option<&'static str>,
}

/// The six panels of an axis with a heading.
pub(super) fn draw_axis(area: &Area<'_>, spec: &ModelSpec, name: AxisName) -> Drawn {
    let (head, body) = area.split_vertically(TITLE);
    let sense = if spec.is_mirrored(name) { ", carriage sense over its own displacement" } else { "" };
    let title = format!("Error motions of {name}{sense}");
    words(&head, &title, (14, 12), 18)?;
    for (place, component) in body.split_evenly((2, 3)).iter().zip(Component::ALL) {
        draw(place, &Panel::of(spec, ErrorSymbol::Motion { component, axis: name }))?;
    }
    Ok(())
}

impl Panel {
    fn of(spec: &ModelSpec, symbol: ErrorSymbol) -> Self {
        let name = symbol.axis();
        let empty = ErrorFunction::default();
        let function = spec.error(symbol).unwrap_or(&empty);
        let [low, high] = range(spec, name);
        let directed =
            function.curves.iter().any(|c| matches!(c, Curve::Table(t) if t.columns().2.is_some()));
        let line = |share: f64, travel: Travel| -> Vec<(f64, f64)> {
            (0..=SAMPLES)
                .map(|i| {
                    let x = low + (high - low) * f64::from(i) / f64::from(SAMPLES);
                    let value = function.value(x, travel) + grids(spec, symbol, function, x, share);
                    (position_out(name, x), error_out(symbol, value))
                })
                .collect()
        };
        let shares: &[f64] = if function.grids.is_empty() { &[0.5] } else { &[0.0, 0.5, 1.0] };
        let given = !(function.curves.is_empty() && function.grids.is_empty());
        let what = if given { kinds_words(function) } else { "not given: zero".to_owned() };
        Self {
            title: format!("{symbol}  {}  ({what})", meaning(symbol)),
            unit: if symbol.is_angle() { "arcsec" } else { "µm" },
            x: [position_out(name, low), position_out(name, high)],
            x_label: format!("{name} / {}", position_unit(name)),
            forward: shares.iter().map(|s| line(*s, Travel::Forward)).collect(),
            reverse: if directed { line(0.5, Travel::Reverse) } else { Vec::new() },
            std: function.std.map(|s| error_out(symbol, s)).filter(|s| *s > 0.0),
            note: if !function.grids.is_empty() {
                Some("other axes at their lower end, middle, upper end")
            } else if directed {
                Some("blue: towards plus, vermillion: towards minus")
            } else {
                None
            },
        }
    }

    /// Lowest and highest value with some room; around zero where all is zero.
    fn y(&self) -> [f64; 2] {
        let band = self.std.unwrap_or(0.0) * 2.0;
        let values = self.forward.iter().flatten().chain(&self.reverse);
        with_room(values.flat_map(|p| [p.1 - band, p.1 + band]).chain([0.0]), 0.08)
    }
}

/// The stored coordinates over which an axis is drawn.
fn range(spec: &ModelSpec, name: AxisName) -> [f64; 2] {
    let inverted = spec.is_mirrored(name);
    let [low, high] = spec.domain(name).unwrap_or([0.0, 1.0]);
    if inverted { [-high, -low] } else { [low, high] }
}

/// The grids of a function at stored coordinate `x`, the other axes at a share of their travel.
fn grids(spec: &ModelSpec, symbol: ErrorSymbol, function: &ErrorFunction, x: f64, share: f64) -> f64 {
    let home = reference_pose(spec);
    let other = |axis: AxisName| match spec.axis(axis).travel {
        Some([low, high]) => low + share * (high - low),
        None => spec.chain.index_of(axis).map_or(0.0, |k| home.position[k]),
    };
    function.grids_value(|axis| if axis == symbol.axis() { x } else { other(axis) })
}

/// What an error motion is called.
pub(in crate::model) fn meaning(symbol: ErrorSymbol) -> &'static str {
    use volcomp_units::axes::AxisKind::{Linear, Rotary};
    let own = symbol.component().index() % 3 == symbol.axis().direction();
    match (symbol.axis().kind(), symbol.is_angle(), own) {
        (Linear, false, true) => "positioning",
        (Linear, false, false) => "straightness",
        (Linear, true, true) => "roll",
        (Linear, true, false) => match symbol.component() {
            // about the vertical axis; of the vertical axis itself about Y
            Component::C => "yaw",
            Component::B if symbol.axis().direction() == 2 => "yaw",
            _ => "pitch",
        },
        (Rotary, false, true) => "axial motion",
        (Rotary, false, false) => "radial motion",
        (Rotary, true, true) => "angular positioning",
        (Rotary, true, false) => "tilt",
    }
}

fn draw(area: &Area<'_>, panel: &Panel) -> Drawn {
    let Panel { title, x_label, unit: y_label, x, .. } = panel;
    let axes = Axes { title, x_label, y_label, x: *x, y: panel.y(), right: 16, x_ticks: 6 };
    let mut chart = axes.draw_small(area)?;
    if let (Some(std), Some(line)) = (panel.std, panel.forward.first()) {
        let upper = line.iter().map(|(x, y)| (*x, y + 2.0 * std));
        let lower = line.iter().rev().map(|(x, y)| (*x, y - 2.0 * std));
        chart.draw_series([Polygon::new(upper.chain(lower).collect::<Vec<_>>(), BLUE.mix(0.15))])?;
    }
    for (i, line) in panel.forward.iter().enumerate() {
        let width = if panel.forward.len() > 1 { i as u32 + 1 } else { 2 };
        chart.draw_series(LineSeries::new(line.iter().copied(), BLUE.stroke_width(width)))?;
    }
    if !panel.reverse.is_empty() {
        chart.draw_series(LineSeries::new(panel.reverse.iter().copied(), VERMILLION.stroke_width(2)))?;
    }
    if let Some(note) = panel.note {
        words(area, note, (72, 28), 11)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motions_have_their_names() {
        for (symbol, name) in [
            ("exx", "positioning"),
            ("ezx", "straightness"),
            ("eax", "roll"),
            ("ebx", "pitch"),
            ("ecx", "yaw"),
            ("eay", "pitch"),
            ("eaz", "pitch"),
            ("ebz", "yaw"),
            ("ecy", "yaw"),
            ("ecz", "roll"),
            ("ecc", "angular positioning"),
            ("ezc", "axial motion"),
            ("eba", "tilt"),
        ] {
            assert_eq!(meaning(ErrorSymbol::parse(symbol).unwrap()), name, "{symbol}");
        }
    }
}
