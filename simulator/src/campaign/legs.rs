//! How the axes move: smooth lines and circles as functions of time.

use std::f64::consts::{PI, TAU};

use crate::twin::Command;
use crate::twin::drive::SetPoint;

/// One stretch of motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Leg {
    /// A line from one place to another (X Y Z mm, C rad), speed like 1 - cos.
    Line {
        /// Begin.
        from: [f64; 4],
        /// End.
        to: [f64; 4],
        /// Duration, s.
        seconds: f64,
    },
    /// An arc in a plane at a steady speed, with a ramp before and after it.
    Arc {
        /// Centre, mm, and the table, rad.
        centre: [f64; 4],
        /// The two axes, in the sense of turning.
        plane: [usize; 2],
        /// Radius, mm.
        radius: f64,
        /// Where it begins, rad.
        start: f64,
        /// Steady speed, rad/s; negative is clockwise.
        omega: f64,
        /// Duration of each ramp, s.
        ramp: f64,
        /// Duration at the steady speed, s.
        steady: f64,
    },
}

impl Leg {
    /// A line at about a speed (mm/s, or as much in degrees of the table).
    #[must_use]
    pub fn line(from: [f64; 4], to: [f64; 4], speed: f64) -> Self {
        let mut way = from[3].to_degrees() - to[3].to_degrees();
        way = way.abs();
        for k in 0..3 {
            way = way.max((to[k] - from[k]).abs());
        }
        Self::Line { from, to, seconds: (2.0 * way / speed).max(0.25) }
    }

    /// How long it takes, s.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        match self {
            Self::Line { seconds, .. } => *seconds,
            Self::Arc { ramp, steady, .. } => 2.0 * ramp + steady,
        }
    }

    /// Where it ends.
    #[must_use]
    pub fn end(&self) -> [f64; 4] {
        let c = self.at(self.seconds());
        let [x, y, z] = c.linear.map(|s| s.q);
        [x, y, z, c.table.q]
    }

    /// The set points at a time, s from the beginning; held before and after.
    #[must_use]
    pub fn at(&self, t: f64) -> Command {
        match self {
            Self::Line { from, to, seconds } => {
                let s = (t / seconds).clamp(0.0, 1.0);
                let part = s - (TAU * s).sin() / TAU;
                let speed = (1.0 - (TAU * s).cos()) / seconds;
                let gain = TAU * (TAU * s).sin() / seconds.powi(2);
                let point = |k: usize| {
                    let way = to[k] - from[k];
                    SetPoint { q: from[k] + way * part, v: way * speed, a: way * gain }
                };
                Command { linear: [point(0), point(1), point(2)], table: point(3) }
            }
            Self::Arc { centre, plane, radius, start, omega, ramp, steady } => {
                let (angle, w, dw) = Self::turn(t, *omega, *ramp, *steady);
                let (sin, cos) = (start + angle).sin_cos();
                let hold = |k: usize| SetPoint { q: centre[k], v: 0.0, a: 0.0 };
                let mut linear = [hold(0), hold(1), hold(2)];
                let [i, j] = *plane;
                linear[i] = SetPoint {
                    q: centre[i] + radius * cos,
                    v: -radius * w * sin,
                    a: -radius * (w * w * cos + dw * sin),
                };
                linear[j] = SetPoint {
                    q: centre[j] + radius * sin,
                    v: radius * w * cos,
                    a: -radius * (w * w * sin - dw * cos),
                };
                Command { linear, table: hold(3) }
            }
        }
    }

    /// Angle, its speed and acceleration: up like (1 - cos)/2, steady, down again.
    fn turn(t: f64, omega: f64, ramp: f64, steady: f64) -> (f64, f64, f64) {
        let up = |t: f64| {
            let s = PI * t / ramp;
            let angle = omega * (t / 2.0 - ramp * s.sin() / TAU);
            (angle, 0.5 * omega * (1.0 - s.cos()), 0.5 * omega * PI / ramp * s.sin())
        };
        let t = t.clamp(0.0, 2.0 * ramp + steady);
        if t < ramp {
            return up(t);
        }
        let first = omega * ramp / 2.0;
        if t <= ramp + steady {
            return (first + omega * (t - ramp), omega, 0.0);
        }
        let (back, w, dw) = up(2.0 * ramp + steady - t);
        (first + omega * steady + omega * ramp / 2.0 - back, w, -dw)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speeds_and_accelerations_are_the_derivatives_of_the_positions() {
        let arc = Leg::Arc {
            centre: [250.0, 200.0, 200.0, 0.0],
            plane: [2, 0],
            radius: 100.0,
            start: 0.3,
            omega: -0.8,
            ramp: 0.6,
            steady: 2.0,
        };
        let line = Leg::line([0.0, 10.0, 20.0, 0.0], [100.0, 40.0, 5.0, 1.0], 60.0);
        for leg in [arc, line] {
            for k in 1..60 {
                let (t, h) = (leg.seconds() * f64::from(k) / 60.0, 1e-5);
                let (a, b, c) = (leg.at(t - h), leg.at(t), leg.at(t + h));
                for i in 0..3 {
                    let v = (c.linear[i].q - a.linear[i].q) / (2.0 * h);
                    let acc = (c.linear[i].v - a.linear[i].v) / (2.0 * h);
                    assert!(
                        (v - b.linear[i].v).abs() < 1e-3 && (acc - b.linear[i].a).abs() < 0.05,
                        "{t} {i}"
                    );
                }
            }
        }
    }
}
