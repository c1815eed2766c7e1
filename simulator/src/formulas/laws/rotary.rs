//! Effects of swivel and table: the place of a point on the table, exactly, against where it should be.

use std::f64::consts::{PI, TAU};

use nalgebra::{Rotation3, Unit, Vector3};

use super::super::machine::{SWIVEL_MM, TABLE_MM, on_table, swivel};
use super::super::row::Row;
use super::{Law, Making, UM, along};

/// The point on the table that the row looks at, at home, mm: the target, or what the tool stands over.
fn home(r: &Row) -> Vector3<f64> {
    r.target_mm.map_or_else(
        || {
            // swivel and table only turn where there is a target
            r.tip()
        },
        Vector3::from,
    )
}

/// Tool against workpiece when the point stands at `really`, um.
fn missed(r: &Row, really: Vector3<f64>) -> Vector3<f64> {
    (on_table(r.turn, home(r)) - really) * UM
}

/// A line about which something turns.
#[derive(Debug, Clone, Copy)]
struct Line {
    point: Vector3<f64>,
    direction: Unit<Vector3<f64>>,
}

impl Line {
    fn turn(&self, angle: f64, p: Vector3<f64>) -> Vector3<f64> {
        Rotation3::from_axis_angle(&self.direction, angle) * (p - self.point) + self.point
    }
}

pub(super) fn law(name: &str, m: &mut Making<'_, '_>) -> Option<Law> {
    let slot = ["a", "c"].iter().position(|a| *a == m.subject)?;
    let size = m.size;
    Some(match name {
        "backlash" => {
            // 80 mm of radius make the size
            let half = size / UM / 80.0;
            Box::new(move |r| {
                let mut turn = r.turn;
                turn[slot] -= half * r.direction[3 + slot];
                missed(r, on_table(turn, home(r)))
            })
        }
        "rotary-location" => {
            let mut lines = [
                Line { point: Vector3::from(SWIVEL_MM), direction: Vector3::x_axis() },
                Line { point: Vector3::from(TABLE_MM), direction: Vector3::z_axis() },
            ];
            let line = lines.get_mut(slot)?;
            let (shift, lean) = (m.chance.normals(), m.chance.normals());
            let across = |v: Vector3<f64>| v - *line.direction * line.direction.dot(&v);
            let (shift, lean) = (across(shift) * (size / UM), across(lean) * (size / UM / 150.0));
            line.point += shift;
            line.direction = Unit::new_normalize(Rotation3::new(lean) * *line.direction);
            let [a, c] = lines;
            Box::new(move |r| missed(r, a.turn(-r.turn[0], c.turn(-r.turn[1], home(r)))))
        }
        "rotary-motion" => {
            let [axial, radial, where_to] = [(); 3].map(|()| m.chance.angle());
            let share = m.chance.within(0.4, 1.6);
            let axis = if slot == 0 { along(0) } else { along(2) };
            let sideways = if slot == 0 {
                Vector3::new(0.0, where_to.cos(), where_to.sin())
            } else {
                Vector3::new(where_to.cos(), where_to.sin(), 0.0)
            };
            let runs = move |q: f64| {
                let face = (1.1 * (2.0 * q + axial).cos()).exp();
                axis * face + sideways * (share * (3.0 * q + radial).cos())
            };
            let zero = runs(0.0);
            Box::new(move |r| {
                let shift = runs(r.turn[slot]) - zero;
                // the table's bearing is fixed to the swivel and turns with it
                let shift = if slot == 1 { swivel(r.turn[0]) * shift } else { shift };
                -shift * size
            })
        }
        "rotary-eccentricity" => {
            // 100 mm of radius make the size
            let off = size / UM / 100.0;
            let [to, ellipse] = [(); 2].map(|()| m.chance.angle());
            let reads = move |q: f64| {
                let seen = (q.sin() + off * to.sin()).atan2(q.cos() + off * to.cos());
                let apart = (seen - q + PI).rem_euclid(TAU) - PI;
                apart + 0.15 * off * (2.0 * q + ellipse).sin()
            };
            let zero = reads(0.0);
            Box::new(move |r| {
                let mut turn = r.turn;
                turn[slot] += reads(r.turn[slot]) - zero;
                missed(r, on_table(turn, home(r)))
            })
        }
        _ => return None,
    })
}
