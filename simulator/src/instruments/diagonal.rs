//! Displacement along a space diagonal, as an interferometer with a retroreflector at the tool sees it (ISO 230-6).

use volcomp::core::axes::{AxisArray, MAX_AXES};

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
