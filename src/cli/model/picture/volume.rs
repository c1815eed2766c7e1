//! The distorted volume: the box of X, Y, Z as a wire grid, nominal and with its deviations magnified, seen along a
//! space diagonal (isometric).

use crate::report::plot::*;

use super::VOLUME_HEIGHT;
use crate::prelude::*;
use volcomp_model::geometry::unit;
use volcomp_model::search::reference_pose;
use volcomp_model::wireframe::{self, Edge, Wire, Wireframe};

/// Intervals of a wire.
const POINTS: usize = 48;
/// Length of the arrows of the axes beyond the box, pixels.
const ARROW: f64 = 36.0;
const NOMINAL: RGBColor = RGBColor(165, 165, 165);

/// True where there is a volume or an area to draw: of one axis alone the curves say all.
pub(super) fn exists(spec: &ModelSpec) -> bool {
    wireframe::edges(spec).iter().filter(|e| e.range[0] < e.range[1]).count() > 1
}

pub(super) fn draw(area: &Area<'_>, spec: &ModelSpec, model: &Model) -> Drawn {
    let Some(frame) = Wireframe::of(spec, model, POINTS) else { return Ok(()) };
    let (largest, magnification) = (frame.largest(), frame.magnification());
    let Wireframe { edges, wires, rotary } = frame;
    let all = || wires.iter().flat_map(|w| &w.points);
    let view = View::around(all().flat_map(|(p, e)| [*p, p + e * magnification]));

    let home = if rotary { ", rotary axes at home" } else { "" };
    let title = format!(
        "Distorted volume: deviation of the tool tip magnified {magnification:.0} times, travel towards plus{home}"
    );
    words(area, &title, (14, 12), 18)?;
    for wire in wires.iter().filter(|w| w.front) {
        area.draw(&PathElement::new(view.path(wire, 0.0), NOMINAL.stroke_width(1)))?;
    }
    for wire in wires.iter().filter(|w| !w.front) {
        area.draw(&PathElement::new(view.path(wire, magnification), BLUE.mix(0.35).stroke_width(1)))?;
    }
    for wire in wires.iter().filter(|w| w.front) {
        area.draw(&PathElement::new(view.path(wire, magnification), BLUE.stroke_width(2)))?;
    }
    draw_largest(area, &view, all().copied(), magnification)?;
    draw_axes(area, &view, spec, &edges)?;
    draw_legend(area, um_from_mm(largest))
}

/// Where the deviation is largest: an arrow from the nominal to the magnified actual place.
fn draw_largest(
    area: &Area<'_>,
    view: &View,
    points: impl Iterator<Item = (Vec3, Vec3)>,
    magnification: f64,
) -> Drawn {
    let Some((p, e)) = points.reduce(|a, b| if b.1.norm() > a.1.norm() { b } else { a }) else {
        return Ok(());
    };
    let (from, to) = (view.at(&p), view.at(&(p + e * magnification)));
    area.draw(&PathElement::new(vec![from, to], VERMILLION.stroke_width(3)))?;
    area.draw(&Circle::new(to, 5, VERMILLION.filled()))?;
    Ok(())
}

/// The letters and ends of travel along three edges of the box.
fn draw_axes(area: &Area<'_>, view: &View, spec: &ModelSpec, edges: &[Edge]) -> Drawn {
    let home = reference_pose(spec);
    let mut low = Vec3::zeros();
    for edge in edges {
        low[edge.axis.direction()] = edge.range[0];
    }
    for edge in edges {
        let direction = edge.axis.direction();
        let mut start = low;
        // the edges towards the reader stay free of the wires
        if direction == 1
            && let Some(x) = edges.iter().find(|e| e.axis == AxisName::X)
        {
            start.x = x.range[1];
        }
        let mut end = start;
        end[direction] = edge.range[1];
        let beyond = end + unit(direction) * (ARROW / view.scale);
        area.draw(&PathElement::new(vec![view.at(&start), view.at(&beyond)], INK.stroke_width(2)))?;
        let (x, y) = view.at(&(end + unit(direction) * (1.25 * ARROW / view.scale)));
        words(area, &edge.axis.to_string(), (x - 6, y - 9), 18)?;
    }
    let travels = edges.iter().map(|e| format!("{} {} to {} mm", e.axis, e.range[0], e.range[1]));
    let travels = travels.joined(", ");
    words(area, &travels, (14, TITLE as i32 + 4), 13)?;
    let placed = spec.chain.axes().iter().zip(home.position);
    let elsewhere = placed.filter(|(a, q)| *q != 0.0 && !edges.iter().any(|e| e.axis == a.name));
    let elsewhere = elsewhere.map(|(a, _)| a.name).joined(", ");
    if !elsewhere.is_empty() {
        let text = format!("{elsewhere} at the end of travel nearest to home");
        words(area, &text, (14, TITLE as i32 + 24), 13)?;
    }
    Ok(())
}

fn draw_legend(area: &Area<'_>, largest_um: f64) -> Drawn {
    let y = VOLUME_HEIGHT as i32 - 20;
    // not the largest of the model: other poses and directions of travel are not drawn
    let largest = format!("largest deviation on these lines, {largest_um:.1} µm");
    let entries = [
        (20, NOMINAL, "nominal"),
        (130, BLUE, "actual, deviations magnified"),
        (370, VERMILLION, largest.as_str()),
    ];
    for (x, colour, label) in entries {
        legend(area, &[Key::line(colour, 3, label)], x, y)?;
    }
    Ok(())
}

/// From mm in M to pixels, the same scale in all directions.
struct View {
    scale: f64,
    origin: (f64, f64),
}

impl View {
    /// X to the lower right, Y to the upper right, Z upwards.
    fn flat(p: &Vec3) -> (f64, f64) {
        let (cos, sin) = (30f64.to_radians().cos(), 30f64.to_radians().sin());
        ((p.x + p.y) * cos, p.z + (p.y - p.x) * sin)
    }

    fn around(points: impl Iterator<Item = Vec3>) -> Self {
        let (mut low, mut high) = ((f64::INFINITY, f64::INFINITY), (f64::NEG_INFINITY, f64::NEG_INFINITY));
        for p in points {
            let (u, v) = Self::flat(&p);
            low = (low.0.min(u), low.1.min(v));
            high = (high.0.max(u), high.1.max(v));
        }
        let (margin, top) = (170.0, f64::from(TITLE) + 30.0);
        let room = (f64::from(WIDTH) - 2.0 * margin, f64::from(VOLUME_HEIGHT) - top - 60.0);
        let size = ((high.0 - low.0).max(1e-9), (high.1 - low.1).max(1e-9));
        let scale = (room.0 / size.0).min(room.1 / size.1);
        let left = margin + 0.5 * (room.0 - scale * size.0);
        let bottom = top + 0.5 * (room.1 + scale * size.1);
        Self { scale, origin: (left - scale * low.0, bottom + scale * low.1) }
    }

    fn at(&self, p: &Vec3) -> (i32, i32) {
        let (u, v) = Self::flat(p);
        ((self.origin.0 + self.scale * u).round() as i32, (self.origin.1 - self.scale * v).round() as i32)
    }

    fn path(&self, wire: &Wire, magnification: f64) -> Vec<(i32, i32)> {
        wire.points.iter().map(|(p, e)| self.at(&(p + e * magnification))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_view_is_right_handed_and_fits() {
        let corner = [Vec3::zeros(), Vec3::new(850.0, 500.0, -500.0)];
        let view = View::around(corner.into_iter());
        let (o, x, y, z) = (
            view.at(&Vec3::zeros()),
            view.at(&Vec3::new(100.0, 0.0, 0.0)),
            view.at(&Vec3::new(0.0, 100.0, 0.0)),
            view.at(&Vec3::new(0.0, 0.0, 100.0)),
        );
        assert!(x.0 > o.0 && x.1 > o.1 && y.0 > o.0 && y.1 < o.1 && z.0 == o.0 && z.1 < o.1);
        for p in &corner {
            let (u, v) = view.at(p);
            assert!((0..WIDTH as i32).contains(&u) && (0..VOLUME_HEIGHT as i32).contains(&v));
        }
    }
}
