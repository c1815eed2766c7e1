//! Effects of motion: reversals, lags, delays, acceleration.

use nalgebra::{Rotation3, Unit, Vector3};

use super::super::chance::Chance;
use super::super::row::Row;
use super::{Law, Making, UM, along};

/// Speed at which lags have their size, mm/s.
const SPEED: f64 = 30.0;
/// Acceleration at which structures have moved by their size, and where they begin to stiffen, mm/s^2.
const ACCELERATION: [f64; 2] = [200.0, 900.0];

/// -1 to 1 after a reversal: from one stop to the other.
fn stops(since_mm: f64, length_mm: f64) -> f64 {
    2.0 * (since_mm / length_mm).tanh() - 1.0
}

/// The other two axes.
fn others(axis: usize) -> [usize; 2] {
    [(axis + 1) % 3, (axis + 2) % 3]
}

/// Acceleration as a structure that stiffens takes it, in units of its size.
fn taken(acceleration: f64) -> f64 {
    let [unit, stiff] = ACCELERATION;
    stiff / unit * (acceleration / stiff).atan()
}

pub(super) fn law(name: &str, m: &mut Making<'_, '_>) -> Option<Law> {
    let size = m.size;
    Some(match name {
        // tables have theirs elsewhere
        "backlash" if m.axis().is_some() => {
            let axis = m.axis()?;
            let length = m.chance.around(0.02, 1.5);
            Box::new(move |r| along(axis) * (-size * r.direction[axis] * stops(r.since_mm[axis], length)))
        }
        "lateral-play" => {
            let axis = m.axis()?;
            let length = m.chance.around(0.02, 1.5);
            let [b, c] = others(axis);
            let share = m.chance.pick(&[0.0, 0.0, 1.0, 1.0, 0.5]);
            let way = along(b) * share + along(c) * (1.0 - share);
            Box::new(move |r| way * (size * r.direction[axis] * stops(r.since_mm[axis], length)))
        }
        "reversal-spike" => {
            let axis = m.axis()?;
            let time = m.chance.around(0.05, 0.3);
            Box::new(move |r| {
                if r.speed[axis].abs() < 1e-6 {
                    return Vector3::zeros();
                }
                let t = r.since_s[axis] / time;
                let hard = 1.0 + 0.25 * (r.acceleration[axis].abs() / 40.0).min(1.0);
                along(axis) * (6.0 * size * hard * r.direction[axis] * t * (1.0 - t).exp())
            })
        }
        "servo-mismatch" => {
            let axis = m.axis()?;
            Box::new(move |r| {
                let v = r.speed[axis];
                along(axis) * (-size * v / SPEED * (1.0 - 0.25 * v.abs() / (v.abs() + 60.0)))
            })
        }
        "latency" => {
            let delay = size / UM / SPEED;
            let seed = m.world.day;
            Box::new(move |r| {
                // the command waits for the next cycle: never quite as long
                let waits = 1.0 + 0.12 * Chance::new(seed ^ r.t_s.to_bits(), "cycle").normal();
                late(r, delay * waits)
            })
        }
        "clock-skew" => {
            let delay = size / UM / SPEED;
            let clocks = ["ballbar", "dynamic", "laser-flight"].map(|name| {
                let own = m.chance.either() * m.chance.within(0.5, 1.4);
                (name, own, m.chance.within(-0.3, 0.5), first(m.world.rows, name))
            });
            Box::new(move |r| {
                clocks.iter().find(|c| c.0 == r.instrument).map_or_else(
                    Vector3::zeros,
                    |(_, own, grows, begin)| {
                        let hours = (r.t_s - begin) / 3600.0;
                        late(r, delay * own * (1.0 + grows * hours * hours))
                    },
                )
            })
        }
        "inertial" => {
            let axis = m.axis()?;
            Box::new(move |r| along(axis) * (size * taken(r.acceleration[axis])))
        }
        "inertial-cross" => {
            let axis = m.axis()?;
            let other = others(axis)[usize::from(m.chance.unit() < 0.5)];
            if m.chance.unit() < 0.5 {
                return Some(Box::new(move |r| along(other) * (size * taken(r.acceleration[axis]))));
            }
            // 200 mm of lever make the size
            let (unit, about) = (size / UM / 200.0, Unit::new_normalize(along(other)));
            Box::new(move |r| {
                let arm = r.tip();
                let turn = Rotation3::from_axis_angle(&about, unit * taken(r.acceleration[axis]));
                (turn * arm - arm) * UM
            })
        }
        _ => return None,
    })
}

/// Where the axes are when they come late by a time, s: to second order, um.
fn late(r: &Row, delay: f64) -> Vector3<f64> {
    (Vector3::from(r.acceleration) * (0.5 * delay * delay) - Vector3::from(r.speed) * delay) * UM
}

/// Time of the first reading of an instrument, s.
fn first(rows: &[Row], instrument: &str) -> f64 {
    rows.iter().find(|r| r.instrument == instrument).map_or(0.0, |r| r.t_s)
}
