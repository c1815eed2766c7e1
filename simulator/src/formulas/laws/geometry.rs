//! Effects of the geometry. Angles act through exact rotations; signs as in equations 1.

use std::f64::consts::{PI, TAU};

use nalgebra::{Rotation3, Unit, Vector3};

use super::super::curve::Curve;
use super::super::machine::{TRAVEL_MM, lever, span};
use super::{Law, Making, UM, along};

/// Pitches of screws and racks, mm: metric, inch, module.
const PITCHES_MM: [f64; 10] = [5.0, 8.0, 10.0, 12.0, 16.0, 20.0, 5.08, 12.7, 2.0 * PI, 3.0 * PI];

/// What a turn by `angle` about `about` does to the end of an arm, um.
fn turned(about: Vector3<f64>, angle: f64, arm: Vector3<f64>) -> Vector3<f64> {
    (Rotation3::from_axis_angle(&Unit::new_normalize(about), angle) * arm - arm) * UM
}

pub(super) fn law(name: &str, m: &mut Making<'_, '_>) -> Option<Law> {
    let size = m.size;
    Some(match name {
        "squareness" => {
            // 300 mm make the size
            let angle = size / UM / 300.0;
            let (axis, about) = match m.subject {
                "xy" => (1, along(2)),
                "zx" => (2, along(1)),
                _ => (2, along(0)),
            };
            Box::new(move |r| turned(about, angle, along(axis) * r.position[axis]))
        }
        "scale" => {
            let axis = m.axis()?;
            Box::new(move |r| along(axis) * (size * r.position[axis] / 200.0))
        }
        "positioning" => {
            let axis = m.axis()?;
            let count = m.chance.within(6.0, 11.0) as usize;
            let broken = m.chance.unit() < 0.5;
            let travel = TRAVEL_MM[axis];
            let curve = Curve::knots(travel, count, broken, m.chance).without_line(travel).normed(travel);
            Box::new(move |r| along(axis) * (size * curve.at(r.position[axis])))
        }
        "cyclic" => {
            let axis = m.axis()?;
            let (pitch, begin) = (m.chance.pick(&PITCHES_MM), m.chance.angle());
            let wave = move |q: f64| {
                let phase = TAU * q / pitch + begin;
                (phase + 0.5 * phase.sin()).sin()
            };
            let home = wave(0.0);
            Box::new(move |r| along(axis) * (1.4 * size * (wave(r.position[axis]) - home)))
        }
        "wear" => {
            let axis = m.axis()?;
            let [low, high] = TRAVEL_MM[axis];
            let half = (high - low) * m.chance.within(0.09, 0.22);
            let centre = m.chance.within(low + 0.8 * half, high - 0.8 * half);
            Box::new(move |r| {
                let s = ((r.position[axis] - centre) / half).clamp(-1.0, 1.0);
                along(axis) * (1.5 * size * (1.0 + (PI * s).cos()))
            })
        }
        "straightness" => {
            let (what, axis) = symbol(m.subject)?;
            let travel = TRAVEL_MM[axis];
            let curve = if m.chance.unit() < 0.6 {
                Curve::sines(travel, m.chance)
            } else {
                Curve::kinks(travel, m.chance)
            };
            let curve = curve.without_line(travel).normed(travel);
            Box::new(move |r| along(what) * (size * curve.at(r.position[axis])))
        }
        "angular" => {
            let (about, axis) = symbol(m.subject)?;
            let travel = TRAVEL_MM[axis];
            let curve = if m.chance.unit() < 0.6 {
                Curve::knots(travel, 5, false, m.chance)
            } else {
                Curve::kinks(travel, m.chance)
            };
            let curve = curve.zero_at_home().normed(travel);
            // 200 mm of lever make the size
            let unit = size / UM / 200.0;
            Box::new(move |r| {
                let arm = lever(axis, r.position, r.tool_mm);
                turned(along(about), unit * curve.at(r.position[axis]), arm)
            })
        }
        "sag" => sag(m)?,
        "load" => {
            let axis = m.axis()?;
            let soft = m.chance.within(600.0, 2000.0);
            Box::new(move |r| {
                let force = r.force_n[axis];
                along(axis) * (size * force / 400.0 / (1.0 + force.abs() / soft).powf(0.3))
            })
        }
        "spindle-tilt" => {
            let direction = m.chance.angle();
            let about = Vector3::new(direction.cos(), direction.sin(), 0.0);
            let angle = size / UM / 100.0;
            Box::new(move |r| turned(about, angle, Vector3::new(0.0, 0.0, -r.tool_mm)))
        }
        "tool-length" => Box::new(move |r| along(2) * (-size * r.tool_mm / 100.0)),
        _ => return None,
    })
}

/// Direction and axis of a symbol such as `eyx` or `ebx`.
fn symbol(text: &str) -> Option<(usize, usize)> {
    let [_, what, axis] = text.as_bytes() else { return None };
    let place = |letters: &[u8; 3], l: u8| letters.iter().position(|k| *k == l);
    Some((place(b"xyz", *what).or_else(|| place(b"abc", *what))?, place(b"xyz", *axis)?))
}

/// A ram whose end droops with the power 2.6 of its reach, and turns what it carries down with it.
fn sag(m: &Making<'_, '_>) -> Option<Law> {
    const POWER: f64 = 2.6;
    let (axis, size) = (m.axis()?, 2.0 * m.size);
    let (low, length) = (TRAVEL_MM[axis][0], span(axis));
    // a turn that lowers what points along the axis
    let about = along(2).cross(&along(axis)) * -1.0;
    Some(Box::new(move |r| {
        let reach = ((r.position[axis] - low) / length).max(0.0);
        let drop = size * reach.powf(POWER);
        // a beam's end slopes by 2 drops per reach under a moment, by 1.5 under a weight (powers 2 and 3)
        let slope = 1.7 * size / UM * reach.powf(POWER - 1.0) / length;
        turned(about, -slope, lever(axis, r.position, r.tool_mm)) - along(2) * drop
    }))
}
