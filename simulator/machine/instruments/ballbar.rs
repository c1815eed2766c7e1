//! A telescoping ballbar between workpiece and tool: the change of their distance along a circle.
//!
//! Circularity G of ISO 230-4: range of the radius about the least-squares circle (orthogonal distances), for
//! counter-clockwise and clockwise travel and, about one common circle, for both.

use nalgebra::{Matrix3, Vector3};
use volcomp_units::axes::{AxisArray, AxisName};

use super::{InstrumentError, Noise, at_most};
use crate::truth::TruthMachine;

/// A ballbar set up around a circle in a plane of two machine axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ballbar {
    /// Centre of the circle in the workpiece frame.
    pub centre_mm: [f64; 3],
    /// Nominal length.
    pub radius_mm: f64,
    /// First and second direction of the plane (0 x, 1 y, 2 z): [0, 1], [1, 2] or [2, 0].
    pub plane: [usize; 2],
    /// Standard deviation of a reading.
    pub noise_um: f64,
    /// Seed of the noise.
    pub seed: u64,
}

/// A circle that the machine runs at an even speed, its drives and friction included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Run {
    /// Programmed coordinates of X, Y, Z at the centre.
    pub centre_mm: [f64; 3],
    /// Radius.
    pub radius_mm: f64,
    /// First and second direction of the plane (0 x, 1 y, 2 z).
    pub plane: [usize; 2],
    /// Path speed.
    pub feed_mm_per_min: f64,
    /// True from the first direction towards the second.
    pub counter_clockwise: bool,
    /// Where the measured part begins and ends, from the first direction towards the second; the run goes from the first
    /// to the second angle, clockwise from the second to the first.
    pub from_to_deg: [f64; 2],
    /// Arc before and behind the measured part; the drives settle on it.
    pub overshoot_deg: f64,
    /// Control cycle.
    pub cycle_s: f64,
    /// One sample is kept out of this many cycles.
    pub every: usize,
}

/// Where the tool should have been and where it was, in the workpiece frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CirclePoint {
    /// Commanded tip.
    pub commanded_mm: [f64; 3],
    /// Actual tip.
    pub actual_mm: [f64; 3],
}

/// One reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// From the first direction of the plane towards the second, 0 to 360.
    pub angle_deg: f64,
    /// Actual minus nominal length.
    pub deviation_um: f64,
    /// +1 counter-clockwise (from the first direction to the second), -1 clockwise.
    pub direction: i8,
}

/// A measured circle.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    /// Nominal radius.
    pub radius_mm: f64,
    /// In the order they were taken.
    pub readings: Vec<Reading>,
}

/// The figures of ISO 230-4.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circularity {
    /// G of counter-clockwise travel.
    pub forward_um: Option<f64>,
    /// G of clockwise travel.
    pub reverse_um: Option<f64>,
    /// G of all readings about their common least-squares circle.
    pub bidirectional_um: f64,
    /// Largest radial deviation about the nominal centre.
    pub max_um: f64,
    /// Smallest radial deviation about the nominal centre.
    pub min_um: f64,
}

/// A fitted circle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FittedCircle {
    /// Centre relative to the nominal one, in the plane.
    pub centre_mm: [f64; 2],
    /// Radius.
    pub radius_mm: f64,
    /// Range of the distances from the centre.
    pub range_mm: f64,
}

impl Ballbar {
    /// The readings along a recorded circle; the path must be the circle alone, without its approach.
    /// # Errors
    /// [`InstrumentError::TooFew`] below four points.
    pub fn trace(&self, points: &[CirclePoint]) -> Result<Trace, InstrumentError> {
        if points.len() < 4 {
            return Err(InstrumentError::TooFew { count: points.len(), needed: 4 });
        }
        let [first, second] = self.plane;
        let spoke =
            |tip: [f64; 3]| [tip[first] - self.centre_mm[first], tip[second] - self.centre_mm[second]];
        let turns: Vec<f64> = points
            .windows(2)
            .map(|pair| {
                let (a, b) = (spoke(pair[0].commanded_mm), spoke(pair[1].commanded_mm));
                a[0] * b[1] - a[1] * b[0]
            })
            .collect();
        let moving = |turn: &&f64| turn.abs() > 1e-9;
        let mut direction = turns.iter().find(moving).map_or(1, |turn| sign(*turn));
        let mut noise = Noise::new(self.seed);
        let mut readings = Vec::with_capacity(points.len());
        for (index, point) in points.iter().enumerate() {
            if let Some(turn) = index.checked_sub(1).and_then(|before| turns.get(before)).filter(moving) {
                direction = sign(*turn);
            }
            let length = (0..3).map(|i| (point.actual_mm[i] - self.centre_mm[i]).powi(2)).sum::<f64>().sqrt();
            let [x, y] = spoke(point.actual_mm);
            readings.push(Reading {
                angle_deg: y.atan2(x).to_degrees().rem_euclid(360.0),
                deviation_um: (length - self.radius_mm) * 1e3 + noise.draw(self.noise_um),
                direction,
            });
        }
        Ok(Trace { radius_mm: self.radius_mm, readings })
    }
}

/// Most control cycles of one circle: some three hours at 1 ms.
const CYCLES_MAX: f64 = 1e7;

impl Run {
    /// Runs the circle; what the drives do is part of it.
    /// # Errors
    /// [`InstrumentError::NoLinearAxis`] where the machine lacks an axis of the plane, [`InstrumentError::Plan`] for a
    /// radius, feed or cycle that is none.
    pub fn on(&self, machine: &mut TruthMachine, seed: u64) -> Result<Vec<CirclePoint>, InstrumentError> {
        for (what, value) in [
            ("radius", self.radius_mm),
            ("feed", self.feed_mm_per_min),
            ("cycle", self.cycle_s),
            ("arc", self.from_to_deg[1] - self.from_to_deg[0]),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return Err(InstrumentError::Plan { what, value, limit: "above 0" });
            }
        }
        let mut axes = [0; 3];
        for (slot, axis) in axes.iter_mut().zip([AxisName::X, AxisName::Y, AxisName::Z]) {
            *slot = machine.index_of(axis).ok_or(InstrumentError::NoLinearAxis { axis })?;
        }
        let [from, to] = self.from_to_deg.map(f64::to_radians);
        let (over, sense) =
            (self.overshoot_deg.to_radians(), if self.counter_clockwise { 1.0 } else { -1.0 });
        let begin = if self.counter_clockwise { from - over } else { to + over };
        let way = to - from + 2.0 * over;
        let at = |angle: f64| {
            let mut place = self.centre_mm;
            place[self.plane[0]] += self.radius_mm * angle.cos();
            place[self.plane[1]] += self.radius_mm * angle.sin();
            let mut q = AxisArray::default();
            for (k, value) in axes.iter().zip(place) {
                q[*k] = value;
            }
            q
        };
        let step = self.feed_mm_per_min / 60.0 / self.radius_mm * self.cycle_s;
        machine.reset(seed, &at(begin));
        at_most(
            way / step,
            CYCLES_MAX,
            "cycles on a circle",
            "choose a smaller radius or arc, or a higher feed",
        )?;
        let cycles = (way / step).floor() as usize;
        let mut points = Vec::with_capacity(cycles / self.every.max(1) + 1);
        for i in 0..=cycles {
            let q = at(begin + sense * step * i as f64);
            let sample = machine.step(self.cycle_s, &q);
            if i % self.every.max(1) == 0 {
                let commanded_mm = machine.nominal(&q).tip_mm;
                points.push(CirclePoint { commanded_mm, actual_mm: sample.tip_mm });
            }
        }
        Ok(points)
    }
}

impl Trace {
    /// This circle and another one of the same set-up, as one measurement.
    #[must_use]
    pub fn joined(mut self, other: Self) -> Self {
        self.readings.extend(other.readings);
        self
    }

    /// The figures of ISO 230-4.
    /// # Errors
    /// [`InstrumentError::Degenerate`] where the readings cover too little of the circle.
    pub fn circularity(&self) -> Result<Circularity, InstrumentError> {
        let range = |wanted: Option<i8>| -> Result<Option<f64>, InstrumentError> {
            let chosen: Vec<&Reading> =
                self.readings.iter().filter(|r| wanted.is_none_or(|w| w == r.direction)).collect();
            if chosen.len() < 4 {
                return Ok(None);
            }
            Ok(Some(fit_circle(&self.plane_points(&chosen), self.radius_mm)?.range_mm * 1e3))
        };
        let bidirectional_um =
            range(None)?.ok_or(InstrumentError::TooFew { count: self.readings.len(), needed: 4 })?;
        let deviations = || self.readings.iter().map(|r| r.deviation_um);
        Ok(Circularity {
            forward_um: range(Some(1))?,
            reverse_um: range(Some(-1))?,
            bidirectional_um,
            max_um: deviations().fold(f64::NEG_INFINITY, f64::max),
            min_um: deviations().fold(f64::INFINITY, f64::min),
        })
    }

    /// The readings as a table: `angle_deg,deviation_um,direction`.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut text = String::from("angle_deg,deviation_um,direction\n");
        for r in &self.readings {
            text.push_str(&format!("{:.6},{:.6},{}\n", r.angle_deg, r.deviation_um, r.direction));
        }
        text
    }

    fn plane_points(&self, readings: &[&Reading]) -> Vec<[f64; 2]> {
        readings
            .iter()
            .map(|r| {
                let (sine, cosine) = r.angle_deg.to_radians().sin_cos();
                let length = self.radius_mm + r.deviation_um / 1e3;
                [length * cosine, length * sine]
            })
            .collect()
    }
}

/// Least-squares circle through points by orthogonal distances, started from the origin and `radius_mm`.
/// # Errors
/// [`InstrumentError::Degenerate`] where no circle is determined.
pub fn fit_circle(points: &[[f64; 2]], radius_mm: f64) -> Result<FittedCircle, InstrumentError> {
    const ROUNDS_MAX: usize = 30;
    let degenerate = InstrumentError::Degenerate { what: "a circle" };
    let mut circle = Vector3::new(0.0, 0.0, radius_mm);
    let distance = |circle: &Vector3<f64>, p: &[f64; 2]| (p[0] - circle.x).hypot(p[1] - circle.y);
    for _ in 0..ROUNDS_MAX {
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for p in points {
            let far = distance(&circle, p);
            if far <= 0.0 {
                return Err(degenerate);
            }
            let row = Vector3::new((p[0] - circle.x) / far, (p[1] - circle.y) / far, 1.0);
            normal += row * row.transpose();
            right += row * (far - circle.z);
        }
        let spread = normal.determinant() / (points.len() as f64).powi(3);
        if spread.is_nan() || spread < 1e-9 {
            return Err(degenerate);
        }
        let step = normal.lu().solve(&right).ok_or_else(|| degenerate.clone())?;
        circle += step;
        if step.norm() < 1e-13 * radius_mm {
            break;
        }
    }
    let (low, high) = points
        .iter()
        .map(|p| distance(&circle, p))
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), d| (low.min(d), high.max(d)));
    Ok(FittedCircle { centre_mm: [circle.x, circle.y], radius_mm: circle.z, range_mm: high - low })
}

const fn sign(turn: f64) -> i8 {
    if turn > 0.0 { 1 } else { -1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BALLBAR: Ballbar =
        Ballbar { centre_mm: [300.0, 200.0, 50.0], radius_mm: 100.0, plane: [0, 1], noise_um: 0.0, seed: 1 };

    /// Once around each way, with the radius a function of angle and direction.
    fn circle(ballbar: &Ballbar, shift: [f64; 2], radius: impl Fn(f64, i8) -> f64) -> Trace {
        let [first, second] = ballbar.plane;
        let once = |direction: i8| {
            let points: Vec<_> = (0..720)
                .map(|k| {
                    let angle = (f64::from(direction) * f64::from(k) / 2.0).to_radians();
                    let (s, c) = angle.sin_cos();
                    let mut point =
                        CirclePoint { commanded_mm: ballbar.centre_mm, actual_mm: ballbar.centre_mm };
                    point.commanded_mm[first] += ballbar.radius_mm * c;
                    point.commanded_mm[second] += ballbar.radius_mm * s;
                    point.actual_mm[first] += radius(angle, direction) * c + shift[0];
                    point.actual_mm[second] += radius(angle, direction) * s + shift[1];
                    point
                })
                .collect();
            ballbar.trace(&points).unwrap()
        };
        once(1).joined(once(-1))
    }

    #[test]
    fn an_ellipse_has_its_difference_of_axes() {
        let figures =
            circle(&BALLBAR, [0.0; 2], |a, _| 100.0 + 0.010 * (2.0 * a).cos()).circularity().unwrap();
        assert!((figures.bidirectional_um - 20.0).abs() < 1e-4, "{figures:?}");
        assert!((figures.forward_um.unwrap() - 20.0).abs() < 1e-4, "{figures:?}");
        assert!((figures.max_um - 10.0).abs() < 1e-6 && (figures.min_um + 10.0).abs() < 1e-6);
    }

    #[test]
    fn a_shifted_centre_and_a_wrong_radius_are_no_circularity() {
        let figures = circle(&BALLBAR, [0.03, -0.02], |_, _| 100.2).circularity().unwrap();
        assert!(figures.bidirectional_um < 1e-6, "{figures:?}");
        assert!(figures.max_um - figures.min_um > 70.0);
    }

    #[test]
    fn directions_are_told_apart_in_every_plane() {
        for plane in [[0, 1], [1, 2], [2, 0]] {
            let ballbar = Ballbar { plane, ..BALLBAR };
            let trace = circle(&ballbar, [0.0; 2], |_, way| if way > 0 { 100.004 } else { 100.0 });
            let figures = trace.circularity().unwrap();
            assert!(figures.forward_um.unwrap() < 1e-6 && figures.reverse_um.unwrap() < 1e-6);
            assert!((figures.bidirectional_um - 4.0).abs() < 0.02, "{figures:?}");
            assert_eq!(trace.readings[0].direction, 1);
            assert_eq!(trace.readings.last().unwrap().direction, -1);
        }
    }

    #[test]
    fn too_little_of_a_circle_is_refused() {
        assert_eq!(BALLBAR.trace(&[]).unwrap_err(), InstrumentError::TooFew { count: 0, needed: 4 });
        let point = CirclePoint { commanded_mm: [400.0, 200.0, 50.0], actual_mm: [400.0, 200.0, 50.0] };
        let trace = BALLBAR.trace(&[point; 6]).unwrap();
        assert!(matches!(trace.circularity(), Err(InstrumentError::Degenerate { .. })));
    }

    #[test]
    fn the_table_has_the_columns_of_iso_230_4() {
        let trace = Trace {
            radius_mm: 1.0,
            readings: vec![Reading { angle_deg: 1.5, deviation_um: -2.25, direction: -1 }],
        };
        assert_eq!(trace.csv(), "angle_deg,deviation_um,direction\n1.500000,-2.250000,-1\n");
    }
}
