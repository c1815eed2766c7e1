//! A smooth move from one state of motion to another: polynomials of fifth order that take over position, speed and
//! acceleration at both ends.

use volcomp_units::axes::{AxisArray, MAX_AXES};

/// Position, speed and acceleration of all axes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Motion {
    pub(super) position: AxisArray,
    pub(super) velocity: AxisArray,
    pub(super) acceleration: AxisArray,
}

/// A connecting move.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Connection {
    coefficients: [[f64; 6]; MAX_AXES],
    pub(super) duration_s: f64,
}

impl Connection {
    /// The move of a given duration.
    pub(super) fn lasting(from: &Motion, to: &Motion, t: f64) -> Self {
        let mut coefficients = [[0.0; 6]; MAX_AXES];
        for (k, c) in coefficients.iter_mut().enumerate() {
            let (p0, v0, a0) = (from.position[k], from.velocity[k], from.acceleration[k]);
            let (p1, v1, a1) = (to.position[k], to.velocity[k], to.acceleration[k]);
            // what remains at the end of the parabola of the start
            let p = p1 - p0 - v0 * t - 0.5 * a0 * t * t;
            let v = (v1 - v0 - a0 * t) * t;
            let a = (a1 - a0) * t * t;
            *c = [
                p0,
                v0,
                0.5 * a0,
                (10.0 * p - 4.0 * v + 0.5 * a) / t.powi(3),
                (-15.0 * p + 7.0 * v - a) / t.powi(4),
                (6.0 * p - 3.0 * v + 0.5 * a) / t.powi(5),
            ];
        }
        Self { coefficients, duration_s: t }
    }

    /// The shortest move, in whole cycles, that keeps speed and acceleration of every axis.
    pub(super) fn new(from: &Motion, to: &Motion, speed: f64, acceleration: f64, cycle_s: f64) -> Self {
        // what the ends bring along cannot be less
        let biggest = |a: &AxisArray, b: &AxisArray| a.iter().chain(b).fold(0.0_f64, |m, v| m.max(v.abs()));
        let speed = speed.max(1.1 * biggest(&from.velocity, &to.velocity));
        let acceleration = acceleration.max(1.1 * biggest(&from.acceleration, &to.acceleration));
        let mut duration_s = (0.05 / cycle_s).ceil() * cycle_s;
        loop {
            let candidate = Self::lasting(from, to, duration_s);
            if candidate.keeps(speed, acceleration) || duration_s > 600.0 {
                return candidate;
            }
            duration_s = (1.1 * duration_s / cycle_s).ceil() * cycle_s;
        }
    }

    fn keeps(&self, speed: f64, acceleration: f64) -> bool {
        (0..=200).all(|n| {
            let m = self.at(self.duration_s * f64::from(n) / 200.0);
            m.velocity.iter().all(|v| v.abs() <= speed)
                && m.acceleration.iter().all(|a| a.abs() <= acceleration)
        })
    }

    pub(super) fn at(&self, t: f64) -> Motion {
        let mut m = Motion::default();
        for (k, c) in self.coefficients.iter().enumerate() {
            m.position[k] = c.iter().rev().fold(0.0, |sum, c| sum * t + c);
            m.velocity[k] =
                (1..6).rev().fold(0.0, |sum, n| sum * t + c[n] * f64::from(u8::try_from(n).unwrap_or(0)));
            m.acceleration[k] = 2.0 * c[2] + t * (6.0 * c[3] + t * (12.0 * c[4] + t * 20.0 * c[5]));
        }
        m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_ends_are_met_and_the_limits_kept() {
        let mut from = Motion::default();
        from.position[0] = 10.0;
        from.velocity[0] = -5.0;
        from.acceleration[0] = 3.0;
        let mut to = Motion::default();
        to.position[0] = -35.0;
        to.velocity[0] = 4.0;
        let c = Connection::new(&from, &to, 100.0, 500.0, 0.001);
        let (a, b) = (c.at(0.0), c.at(c.duration_s));
        assert!((a.position[0] - 10.0).abs() < 1e-9 && (a.velocity[0] + 5.0).abs() < 1e-9);
        assert!((a.acceleration[0] - 3.0).abs() < 1e-9);
        assert!((b.position[0] + 35.0).abs() < 1e-9 && (b.velocity[0] - 4.0).abs() < 1e-8);
        assert!(b.acceleration[0].abs() < 1e-6);
        assert!(c.keeps(100.0, 500.0));
        let cycles = c.duration_s / 0.001;
        assert!((cycles - cycles.round()).abs() < 1e-6 && cycles < 2000.0);
    }
}
