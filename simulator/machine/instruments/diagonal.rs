//! Displacement along a space diagonal, as an interferometer with a retroreflector at the tool sees it (ISO 230-6).

use volcomp_units::axes::{AxisArray, MAX_AXES};

use super::{InstrumentError, Noise, along, line};
use crate::truth::TruthMachine;

/// One reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DiagonalRow {
    /// Nominal displacement from the start.
    pub position_mm: f64,
    /// Actual minus nominal displacement.
    pub deviation_um: f64,
}

/// A measured diagonal.
#[derive(Debug, Clone, PartialEq)]
pub struct Diagonal {
    /// From start to end.
    pub rows: Vec<DiagonalRow>,
}

/// Where the tool should have been and where it was, in the workpiece frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DiagonalPoint {
    /// Nominal tip.
    pub nominal_mm: [f64; 3],
    /// Actual tip.
    pub actual_mm: [f64; 3],
}

/// How body diagonals are measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyDiagonals {
    /// Wire index of X, Y, Z.
    pub xyz: [usize; 3],
    /// Lower corner, programmed coordinates.
    pub low_mm: [f64; 3],
    /// Upper corner.
    pub high_mm: [f64; 3],
    /// Steps along each diagonal.
    pub steps: usize,
    /// Out and back so many times.
    pub cycles: usize,
    /// Drift from reading to reading.
    pub drift_um: f64,
    /// Standard deviation of a reading.
    pub noise_um: f64,
    /// Seed of the noise.
    pub seed: u64,
}

/// How far the tool stands beside itself along the diagonal when it comes to `end` from there instead of from `start`.
fn lost_motion_um(machine: &TruthMachine, start: &AxisArray, end: &AxisArray) -> f64 {
    let arriving: [i8; MAX_AXES] =
        std::array::from_fn(|i| if end[i] > start[i] { 1 } else { i8::from(end[i] >= start[i]) - 1 });
    let leaving = arriving.map(|d| -d);
    let (from, to) = (machine.nominal(start).tip_mm, machine.nominal(end).tip_mm);
    let Some((beam, _)) = line(from, to) else { return 0.0 };
    along(machine.pose(end, &arriving).tip_mm, machine.pose(end, &leaving).tip_mm, beam) * 1e3
}

impl Diagonal {
    /// Evaluates recorded points along a diagonal; the beam runs from the first nominal point to the last.
    /// # Errors
    /// [`InstrumentError`] below two points or where first and last coincide.
    pub fn of_points(points: &[DiagonalPoint], noise_um: f64, seed: u64) -> Result<Self, InstrumentError> {
        let (first, last) = match points {
            [first, .., last] => (first, last),
            few => return Err(InstrumentError::TooFew { count: few.len(), needed: 2 }),
        };
        let (beam, _) = line(first.nominal_mm, last.nominal_mm)
            .ok_or(InstrumentError::Degenerate { what: "the direction of the diagonal" })?;
        let mut noise = Noise::new(seed);
        let rows = points
            .iter()
            .map(|point| {
                let position_mm = along(first.nominal_mm, point.nominal_mm, beam);
                let error = along(first.actual_mm, point.actual_mm, beam) - position_mm;
                DiagonalRow { position_mm, deviation_um: error * 1e3 + noise.draw(noise_um) }
            })
            .collect();
        Ok(Self { rows })
    }

    /// Measures a machine at rest at `steps` + 1 points between two positions (mm or deg, wire order); `offset` is
    /// added to every commanded position.
    /// # Errors
    /// [`InstrumentError`] without steps or where the diagonal has no length.
    pub fn of_machine(
        machine: &TruthMachine,
        [from, to]: [&AxisArray; 2],
        steps: usize,
        offset: impl Fn(&AxisArray) -> AxisArray,
    ) -> Result<Self, InstrumentError> {
        let directions: [i8; MAX_AXES] = std::array::from_fn(|i| {
            if to[i] > from[i] {
                1
            } else if to[i] < from[i] {
                -1
            } else {
                0
            }
        });
        let points: Vec<DiagonalPoint> = (0..=steps)
            .map(|step| {
                let share = step as f64 / steps.max(1) as f64;
                let commanded: AxisArray = std::array::from_fn(|i| from[i] + share * (to[i] - from[i]));
                let applied = offset(&commanded);
                let driven: AxisArray = std::array::from_fn(|i| commanded[i] + applied[i]);
                DiagonalPoint {
                    nominal_mm: machine.nominal(&commanded).tip_mm,
                    actual_mm: machine.pose(&driven, &directions).tip_mm,
                }
            })
            .collect();
        Self::of_points(&points, 0.0, 0)
    }

    /// Four body diagonals of a box, out and back in cycles, as `volcomp identify diagonals` reads them:
    /// `diagonal,cycle,direction,target_mm,deviation_um`. `low` and `high` are opposite corners (mm, wire order of
    /// `xyz`, other axes at home).
    /// # Errors
    /// [`InstrumentError`] without steps or where the box is empty.
    pub fn body_diagonals(machine: &TruthMachine, plan: &BodyDiagonals) -> Result<String, InstrumentError> {
        let mut text = String::from("diagonal,cycle,direction,target_mm,deviation_um\n");
        let mut noise = Noise::new(plan.seed);
        let mut drift_um = 0.0;
        for signs in [[1, 1, 1], [-1, 1, 1], [1, -1, 1], [1, 1, -1]] {
            let corner = |end: bool| {
                let mut q = AxisArray::default();
                for i in 0..3 {
                    let at_high = (signs[i] > 0) == end;
                    q[plan.xyz[i]] = if at_high { plan.high_mm[i] } else { plan.low_mm[i] };
                }
                q
            };
            let (start, end) = (corner(false), corner(true));
            let out = Self::of_machine(machine, [&start, &end], plan.steps, super::no_offset)?;
            let back = Self::of_machine(machine, [&end, &start], plan.steps, super::no_offset)?;
            // the laser keeps its zero at the start of the way out; what the way back adds is lost motion at the far end
            let lost = lost_motion_um(machine, &start, &end);
            let last = out.rows.last().map_or(0.0, |r| r.deviation_um);
            let length = out.rows.last().map_or(0.0, |r| r.position_mm);
            let name: String = signs.iter().map(|s| if *s > 0 { 'p' } else { 'n' }).collect();
            for cycle in 1..=plan.cycles {
                let there = out.rows.iter().map(|r| (1, r.position_mm, r.deviation_um));
                // seen from the far end the same error counts the other way round
                let returned =
                    back.rows.iter().map(|r| (-1, length - r.position_mm, last + lost - r.deviation_um));
                for (direction, target, deviation) in there.chain(returned) {
                    drift_um += plan.drift_um;
                    let reading = deviation + drift_um + noise.draw(plan.noise_um);
                    text.push_str(&format!("{name},{cycle},{direction},{target:.6},{reading:.5}\n"));
                }
            }
        }
        Ok(text)
    }

    /// Largest minus smallest deviation.
    #[must_use]
    pub fn range_um(&self) -> f64 {
        let deviations = || self.rows.iter().map(|r| r.deviation_um);
        let range =
            deviations().fold(f64::NEG_INFINITY, f64::max) - deviations().fold(f64::INFINITY, f64::min);
        range.max(0.0)
    }

    /// The rows as a table: `position_mm,deviation_um`.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut text = String::from("position_mm,deviation_um\n");
        for r in &self.rows {
            text.push_str(&format!("{:.6},{:.6}\n", r.position_mm, r.deviation_um));
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scale_error_grows_along_the_diagonal() {
        let points: Vec<_> = (0..=10)
            .map(|k| {
                let nominal_mm = [30.0 * f64::from(k), 40.0 * f64::from(k), 0.0];
                // The tool goes 100 ppm too far and stands off by a constant that does not count.
                DiagonalPoint { nominal_mm, actual_mm: nominal_mm.map(|v| v * 1.0001 + 0.5) }
            })
            .collect();
        let diagonal = Diagonal::of_points(&points, 0.0, 0).unwrap();
        assert!((diagonal.range_um() - 50.0).abs() < 1e-6);
        assert!((diagonal.rows[10].deviation_um - 50.0).abs() < 1e-6);
        assert!(diagonal.csv().starts_with("position_mm,deviation_um\n0.000000,0.000000\n"));
    }

    #[test]
    fn one_point_is_no_diagonal() {
        let point = DiagonalPoint { nominal_mm: [1.0; 3], actual_mm: [1.0; 3] };
        assert!(matches!(
            Diagonal::of_points(&[point], 0.0, 0),
            Err(InstrumentError::TooFew { count: 1, .. })
        ));
        assert!(matches!(Diagonal::of_points(&[point; 3], 0.0, 0), Err(InstrumentError::Degenerate { .. })));
    }
}
