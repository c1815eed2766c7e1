//! The state at one reading, and motion along a line.

use std::f64::consts::PI;

use nalgebra::Vector3;

use super::machine::lever;

/// The state of machine and instrument at one reading.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Time, s.
    pub t_s: f64,
    /// The instrument.
    pub instrument: &'static str,
    /// Mounting, pass, repetition, number of the programmed point.
    pub place: [i64; 4],
    /// X, Y, Z, mm.
    pub position: [f64; 3],
    /// Their speeds, mm/s.
    pub speed: [f64; 3],
    /// Their accelerations, mm/s^2.
    pub acceleration: [f64; 3],
    /// A and C, rad.
    pub turn: [f64; 2],
    /// Travel since the last reversal of X, Y, Z, A, C.
    pub direction: [f64; 5],
    /// Way since then of X, Y, Z, mm.
    pub since_mm: [f64; 3],
    /// Time since then, s.
    pub since_s: [f64; 3],
    /// Direction of sensitivity.
    pub u: Vector3<f64>,
    /// An axis moves.
    pub moving: bool,
    /// Tool, mm.
    pub tool_mm: f64,
    /// Instrument to target, mm.
    pub range_mm: Option<f64>,
    /// Target on the workpiece side at home, mm.
    pub target_mm: Option<[f64; 3]>,
    /// Where the instrument stands, mm.
    pub station_mm: Option<[f64; 3]>,
    /// Forces, N.
    pub force_n: [f64; 3],
    /// Spindle, rpm.
    pub rpm: f64,
    /// Time since the axis started or stopped last, s; no column has it.
    pub since_jolt_s: f64,
    /// The acceleration with which it did, mm/s^2.
    pub jolt: [f64; 3],
}

impl Row {
    /// The tip of the tool, nominally, mm.
    #[must_use]
    pub fn tip(&self) -> Vector3<f64> {
        lever(0, self.position, self.tool_mm) + Vector3::x() * self.position[0]
    }

    /// The beam from the instrument to the target, a unit vector.
    #[must_use]
    pub fn beam(&self) -> Option<Vector3<f64>> {
        self.station_mm.map(|s| {
            let line = self.tip() - Vector3::from(s);
            line / line.norm().max(1e-9)
        })
    }
}

/// A move along one line with ramps of sine squared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ramped {
    /// Way, mm.
    pub way_mm: f64,
    /// Speed between the ramps, mm/s.
    pub speed: f64,
    /// Duration of a ramp, s.
    pub ramp_s: f64,
}

impl Ramped {
    /// Duration, s.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        self.way_mm / self.speed + self.ramp_s
    }

    /// Way, speed and acceleration after `t` s.
    #[must_use]
    pub fn at(&self, t: f64) -> [f64; 3] {
        let (v, r, all) = (self.speed, self.ramp_s, self.seconds());
        let ramp = |t: f64| {
            let p = PI * t / r;
            [0.5 * v * (t - r / PI * p.sin()), 0.5 * v * (1.0 - p.cos()), 0.5 * v * PI / r * p.sin()]
        };
        if t <= 0.0 {
            [0.0; 3]
        } else if t < r {
            ramp(t)
        } else if t <= all - r {
            [v * (t - 0.5 * r), v, 0.0]
        } else if t < all {
            let [way, speed, acceleration] = ramp(all - t);
            [self.way_mm - way, speed, -acceleration]
        } else {
            [self.way_mm, 0.0, 0.0]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speeds_and_accelerations_are_those_of_the_positions() {
        let line = Ramped { way_mm: 200.0, speed: 90.0, ramp_s: 0.3 };
        for t in [0.1, 0.25, 0.31, 1.0, line.seconds() - 0.2, line.seconds() - 0.05] {
            let h = 1e-5;
            let [a, b, c] = [t - h, t, t + h].map(|t| line.at(t));
            assert!(((c[0] - a[0]) / (2.0 * h) - b[1]).abs() < 1e-3, "{t}");
            assert!(((c[1] - a[1]) / (2.0 * h) - b[2]).abs() < 1e-1, "{t}");
        }
        assert!((line.at(line.seconds())[0] - 200.0).abs() < 1e-12);
    }
}
