//! Commanded motion: lines and arcs with raised-cosine speed ramps.

use std::f64::consts::{FRAC_PI_2, PI};

/// Largest acceleration along a path, mm/s^2.
const ACCELERATION: f64 = 600.0;

/// Commanded X, Y, Z (mm) and B (rad) with their derivatives.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Command {
    /// Position.
    pub q: [f64; 4],
    /// Velocity, 1/s.
    pub v: [f64; 4],
    /// Acceleration, 1/s^2.
    pub a: [f64; 4],
}

/// Shape of a motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// Standstill.
    Rest([f64; 4]),
    /// Straight, all axes together.
    Line([f64; 4], [f64; 4]),
    /// Full circle: plane, centre, radius, mm; start angle, rad; sense; the other axes stay.
    Circle { plane: [usize; 2], centre: [f64; 4], radius: f64, sense: f64 },
}

/// A motion from standstill to standstill.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Its shape.
    pub shape: Shape,
    /// Length of the path, mm (or the largest change of an axis).
    length: f64,
    speed: f64,
    ramp_s: f64,
    /// Duration, s.
    pub duration: f64,
}

impl Motion {
    /// Standstill for a time.
    pub fn rest(q: [f64; 4], duration: f64) -> Self {
        Self { shape: Shape::Rest(q), length: 0.0, speed: 0.0, ramp_s: 0.0, duration }
    }

    /// A line at a speed (mm/s); the table counts 100 mm per rad.
    pub fn line(from: [f64; 4], to: [f64; 4], speed: f64) -> Self {
        let linear = (0..3).map(|k| (to[k] - from[k]).powi(2)).sum::<f64>().sqrt();
        let length = linear.max(100.0 * (to[3] - from[3]).abs());
        Self::along(Shape::Line(from, to), length, speed)
    }

    /// A full circle.
    pub fn circle(plane: [usize; 2], centre: [f64; 4], radius: f64, sense: f64, speed: f64) -> Self {
        Self::along(Shape::Circle { plane, centre, radius, sense }, 2.0 * PI * radius, speed)
    }

    fn along(shape: Shape, length: f64, speed: f64) -> Self {
        let fastest = (length * ACCELERATION / FRAC_PI_2).sqrt();
        let speed = speed.min(0.999 * fastest).max(1e-9);
        let ramp_s = speed * FRAC_PI_2 / ACCELERATION;
        Self { shape, length, speed, ramp_s, duration: length / speed + ramp_s }
    }

    /// Time spent in one speed ramp, s.
    pub const fn ramp_s(&self) -> f64 {
        self.ramp_s
    }

    /// Way, speed, acceleration along the path.
    fn way(&self, t: f64) -> [f64; 3] {
        let (v, r) = (self.speed, self.ramp_s);
        let up = |t: f64| {
            let w = PI / r;
            [0.5 * v * (t - (w * t).sin() / w), 0.5 * v * (1.0 - (w * t).cos()), 0.5 * v * w * (w * t).sin()]
        };
        let t = t.clamp(0.0, self.duration);
        if t < r {
            up(t)
        } else if t > self.duration - r {
            let [s, v, a] = up(self.duration - t);
            [self.length - s, v, -a]
        } else {
            [0.5 * v * r + v * (t - r), v, 0.0]
        }
    }

    /// The command at a time after the start; before and after: standstill.
    pub fn at(&self, t: f64) -> Command {
        let mut c = Command::default();
        match self.shape {
            Shape::Rest(q) => c.q = q,
            Shape::Line(from, to) => {
                let [s, v, a] = self.way(t);
                for k in 0..4 {
                    let per = (to[k] - from[k]) / self.length.max(1e-12);
                    c.q[k] = from[k] + per * s;
                    c.v[k] = per * v;
                    c.a[k] = per * a;
                }
            }
            Shape::Circle { plane: [i, j], centre, radius, sense } => {
                let [s, v, a] = self.way(t);
                let (sin, cos) = (sense * s / radius).sin_cos();
                let (w, aw) = (sense * v / radius, sense * a / radius);
                c.q = centre;
                c.q[i] += radius * cos;
                c.q[j] += radius * sin;
                c.v[i] = -radius * sin * w;
                c.v[j] = radius * cos * w;
                c.a[i] = radius * (-cos * w * w - sin * aw);
                c.a[j] = radius * (-sin * w * w + cos * aw);
            }
        }
        c
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn velocity_and_acceleration_are_the_derivatives_of_the_way() {
        let line = Motion::line([0.0; 4], [300.0, 40.0, 0.0, 0.0], 100.0);
        let circle = Motion::circle([0, 2], [300.0, 200.0, 200.0, 0.0], 80.0, -1.0, 60.0);
        for m in [line, circle] {
            let h = 1e-4;
            for n in 1..200 {
                let t = m.duration * f64::from(n) / 200.0;
                let (a, b, c) = (m.at(t - h), m.at(t), m.at(t + h));
                for k in 0..4 {
                    assert!((b.v[k] - (c.q[k] - a.q[k]) / (2.0 * h)).abs() < 1e-3, "{t}");
                    assert!((b.a[k] - (c.v[k] - a.v[k]) / (2.0 * h)).abs() < 2.0, "{t}");
                }
            }
        }
        assert!((line.at(line.duration).q[0] - 300.0).abs() < 1e-9);
    }
}
