//! The polar plot of ISO 230-4: radial deviations about the nominal circle, magnified.

use crate::report::plot::*;

use crate::prelude::*;
use volcomp_evaluate::{CircularReading, Circularity};

const HEIGHT: u32 = 516;
/// Radius of the nominal circle, pixels.
const NOMINAL: f64 = 145.0;
/// Radius to which the largest deviation reaches at most beyond the nominal circle, pixels.
const REACH: f64 = 72.0;
/// Centre of the plot, pixels from the left.
const CENTRE: f64 = 275.0;

/// A test to be drawn, deviations in mm.
#[derive(Clone, Copy)]
pub(in crate::evaluate) struct Shown<'a> {
    pub(in crate::evaluate) result: &'a Circularity,
    pub(in crate::evaluate) readings: &'a [CircularReading],
    /// First and second axis.
    pub(in crate::evaluate) plane: [char; 2],
    pub(in crate::evaluate) radius_mm: Option<f64>,
}

/// um per division, so that all tests fit: two divisions inside and outside the nominal circle.
pub(in crate::evaluate) fn scale<'a>(shown: impl IntoIterator<Item = &'a Shown<'a>>) -> f64 {
    let all = shown.into_iter().flat_map(|s| [s.result.f_max, s.result.f_min]);
    let largest = um_from_mm(all.fold(0.0f64, |m, v| m.max(v.abs())));
    // the round number above half of the largest
    let half = (0.5 * largest).max(1e-6);
    let mut round = [1.0, 2.0, 2.5, 4.0, 5.0, 10.0].into_iter().map(|m| m * round_below(half));
    round.find(|d| *d >= half).unwrap_or(half)
}

/// One test.
///
/// # Errors
/// The drawing library could not draw it.
pub(in crate::evaluate) fn single(shown: &Shown<'_>, division: f64) -> Svg {
    whole("", &[("", *shown)], division)
}

/// Tests below each other with their headings, at one scale.
///
/// # Errors
/// The drawing library could not draw it.
pub(in crate::evaluate) fn whole(title: &str, shown: &[(&str, Shown<'_>)], division: f64) -> Svg {
    stacked_tests(SHEET_WIDTH, title, shown, |_| HEIGHT, |area, one| draw(area, one, division))
}

/// From angle and deviation to pixels.
struct View {
    centre: (f64, f64),
    /// Pixels per um.
    per_um: f64,
}

impl View {
    fn at(&self, angle: f64, um: f64) -> (i32, i32) {
        let r = NOMINAL + self.per_um * um;
        let (sin, cos) = angle.sin_cos();
        ((self.centre.0 + r * cos).round() as i32, (self.centre.1 - r * sin).round() as i32)
    }
}

fn draw(area: &Area<'_>, shown: &Shown<'_>, division: f64) -> Drawn {
    let view = View { centre: (CENTRE, f64::from(HEIGHT) / 2.0), per_um: 0.5 * REACH / division };
    draw_grid(area, &view, shown, division)?;
    for (travel, colour) in [(Travel::Forward, BLUE), (Travel::Reverse, VERMILLION)] {
        let own = shown.readings.iter().zip(&shown.result.radial).filter(|(r, _)| r.travel == travel);
        for path in paths(own.map(|(r, d)| (r.angle, um_from_mm(*d)))) {
            let path: Vec<(i32, i32)> = path.into_iter().map(|(a, d)| view.at(a, d)).collect();
            area.draw(&PathElement::new(path, colour.stroke_width(2)))?;
        }
    }
    draw_scale(area, &view, division)?;
    draw_extremes(area, &view, shown)?;
    draw_words(area, shown, division)
}

/// Readings in the order of the path, cut where it has a gap of more than 20 degrees.
fn paths(readings: impl Iterator<Item = (f64, f64)>) -> Vec<Vec<(f64, f64)>> {
    let mut out: Vec<Vec<(f64, f64)>> = Vec::new();
    for (angle, d) in readings {
        match out.last_mut() {
            Some(path) if path.last().is_some_and(|(a, _)| gap(*a, angle) < 20f64.to_radians()) => {
                path.push((angle, d));
            }
            _ => out.push(vec![(angle, d)]),
        }
    }
    // a whole turn that ends one step before its start is closed
    if let [path] = &mut out[..]
        && let (Some(first), Some(last)) = (path.first().copied(), path.last())
        && gap(first.0, last.0) < 20f64.to_radians()
    {
        path.push(first);
    }
    out
}

fn gap(a: f64, b: f64) -> f64 {
    let d = (b - a).rem_euclid(core::f64::consts::TAU);
    d.min(core::f64::consts::TAU - d)
}

fn draw_grid(area: &Area<'_>, view: &View, shown: &Shown<'_>, division: f64) -> Drawn {
    let centre = (view.centre.0 as i32, view.centre.1 as i32);
    for step in -2..=2i32 {
        let um = f64::from(step) * division;
        let radius = (NOMINAL + view.per_um * um).round() as i32;
        let style = if step == 0 { INK.stroke_width(2) } else { FAINT.stroke_width(1) };
        area.draw(&Circle::new(centre, radius, style))?;
    }
    let reach = (NOMINAL + REACH + 18.0) as i32;
    let style = FAINT.stroke_width(1);
    area.draw(&PathElement::new(vec![(centre.0 - reach, centre.1), (centre.0 + reach, centre.1)], style))?;
    area.draw(&PathElement::new(vec![(centre.0, centre.1 - reach), (centre.0, centre.1 + reach)], style))?;
    let [a, b] = shown.plane;
    words(area, &format!("+{a}"), (centre.0 + reach + 6, centre.1 - 9), 17)?;
    words(area, &format!("+{b}"), (centre.0 - 9, centre.1 - reach - 22), 17)?;
    Ok(())
}

/// The scale along a direction away from the axes.
fn draw_scale(area: &Area<'_>, view: &View, division: f64) -> Drawn {
    for step in -2..=2i32 {
        let um = f64::from(step) * division;
        let (x, y) = view.at(-22.5f64.to_radians(), um);
        let label = if step == 0 {
            "0".to_owned()
        } else {
            format!("{}{}", if step > 0 { "+" } else { "" }, tick(um, 4.0 * division))
        };
        let width = 8 * label.chars().count() as i32;
        area.draw(&Rectangle::new([(x - width / 2 - 2, y - 8), (x + width / 2 + 2, y + 8)], WHITE.filled()))?;
        words(area, &label, (x - width / 2, y - 7), 13)?;
    }
    Ok(())
}

/// Fmax and Fmin where they occur.
fn draw_extremes(area: &Area<'_>, view: &View, shown: &Shown<'_>) -> Drawn {
    let pairs = || shown.readings.iter().zip(&shown.result.radial);
    let largest = pairs().reduce(|a, b| if b.1 > a.1 { b } else { a });
    let smallest = pairs().reduce(|a, b| if b.1 < a.1 { b } else { a });
    for (found, name, beyond) in [(largest, "Fmax", 22.0), (smallest, "Fmin", -22.0)] {
        let Some((r, d)) = found else { continue };
        let um = um_from_mm(*d);
        area.draw(&Circle::new(view.at(r.angle, um), 5, INK.stroke_width(2)))?;
        let (x, y) = view.at(r.angle, um + beyond / view.per_um);
        let left = if r.angle.cos() * beyond < 0.0 { x - 40 } else { x - 2 };
        area.draw(&Rectangle::new([(left - 2, y - 8), (left + 38, y + 9)], WHITE.mix(0.8).filled()))?;
        words(area, name, (left, y - 7), 14)?;
    }
    Ok(())
}

fn draw_words(area: &Area<'_>, shown: &Shown<'_>, division: f64) -> Drawn {
    let c = shown.result;
    let um = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), |v| format!("{:.2} µm", um_from_mm(v)));
    let x = SHEET_WIDTH as i32 - 250;
    let mut y = 90;
    for (name, value) in [
        ("G counter-clockwise", um(c.g_forward)),
        ("G clockwise", um(c.g_backward)),
        ("G(b) both", um(c.g_both)),
        ("Fmax", um(Some(c.f_max))),
        ("Fmin", um(Some(c.f_min))),
    ] {
        words(area, name, (x, y), 16)?;
        words(area, &value, (x + 170, y), 16)?;
        y += 26;
    }
    y += 18;
    words(area, &format!("one division = {division} µm"), (x, y), 15)?;
    if let Some(radius) = shown.radius_mm {
        words(area, &format!("nominal radius {radius} mm"), (x, y + 22), 15)?;
    }
    let directions = [
        (c.g_forward.is_some(), BLUE, "counter-clockwise"),
        (c.g_backward.is_some(), VERMILLION, "clockwise"),
    ];
    for (present, colour, label) in directions {
        if present {
            y += 26;
            legend(area, &[Key::line(colour, 3, label)], x, y + 40)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_cut_at_gaps_and_closed_over_a_turn() {
        let turn = |n: u32| (0..n).map(|i| (f64::from(i).to_radians(), 1.0));
        let [closed] = &paths(turn(360))[..] else { panic!() };
        assert_eq!(closed.len(), 361);
        let half = paths(turn(180));
        assert_eq!((half.len(), half[0].len()), (1, 180));
        assert_eq!(paths(turn(90).chain([(3.0, 1.0)])).len(), 2);
    }
}
