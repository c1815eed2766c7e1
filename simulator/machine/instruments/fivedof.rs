//! A 5-DOF laser: two beams from a fixed head to a carriage, five position detectors with two channels each.
//!
//! Optics to first order in the angles of the beams, as in the README of the reference vectors; the motion of the
//! carriage is exact. The pointing of the source wanders slowly, each channel has its own sign, the beams are not
//! parallel to the axis nor to each other, and the beam runs a little farther than the stated distance.

use volcomp_units::axes::AxisName;
use volcomp_units::{rad_from_arcsec, um_from_mm};

use super::carriage::{Carriage, Seen};
use super::{InstrumentError, Noise};

/// The instrument as it really is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FiveDofLaser {
    /// Focal lengths of the three position detectors.
    pub focal_mm: [f64; 3],
    /// Corner cubes of beam 1 and beam 2, first and second lateral direction, from the point.
    pub beams_mm: [[f64; 2]; 2],
    /// Point of the carriage to which the beams are given, in M at home.
    pub point_mm: [f64; 3],
    /// Distance from head to carriage at the lower end of the travel.
    pub distance_mm: f64,
    /// Beam path beyond the stated distance.
    pub dead_path_mm: f64,
    /// Sign of PSD1, PSD2, PSD3, QD1, QD2 in both directions.
    pub signs: [[f64; 2]; 5],
    /// Angle of beam 1 and beam 2 against the axis, both directions.
    pub skew_arcsec: [[f64; 2]; 2],
    /// How fast the pointing wanders, arcsec per reading.
    pub drift_arcsec: f64,
    /// Standard deviation of a channel.
    pub noise_um: f64,
    /// Standard deviation of the level.
    pub noise_arcsec: f64,
    /// Seed of the noise.
    pub seed: u64,
}

/// One row: PSD1, PSD2, PSD3, QD1, QD2 in both directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FiveDofRow {
    /// Commanded coordinate.
    pub position_mm: f64,
    /// Head to carriage as stated.
    pub distance_mm: f64,
    /// +1 forward, -1 back.
    pub direction: i8,
    /// Counted from 1.
    pub cycle: usize,
    /// Detectors.
    pub channels_um: [[f64; 2]; 5],
    /// Roll by the level, only at the ends.
    pub level_arcsec: Option<f64>,
    /// Known displacement by hand.
    pub push_um: [f64; 2],
}

/// A pointing that wanders.
#[derive(Debug, Clone, Default)]
pub(super) struct Pointing {
    angle: [[f64; 2]; 2],
    speed: [[f64; 2]; 2],
}

impl Pointing {
    pub(super) fn step(&mut self, noise: &mut Noise, step: f64) {
        for j in 0..2 {
            for i in 0..2 {
                self.speed[j][i] = 0.9 * self.speed[j][i] + noise.draw(step);
                self.angle[j][i] += self.speed[j][i];
            }
        }
    }
}

/// EY EZ EA EB EC (mm, rad) of the carriage in laser coordinates: the straightnesses at `reference_mm`, one point for
/// each of the components x, y, z, in M at home.
#[must_use]
pub fn carriage_motion(axis: AxisName, seen: &Seen, reference_mm: &[[f64; 3]; 3]) -> [f64; 5] {
    let d = axis.direction();
    let [first, second] = [(d + 1) % 3, (d + 2) % 3];
    let turn = seen.rotation();
    let shift = |i: usize| seen.displacement(reference_mm[i])[i];
    [shift(first), shift(second), turn[d], turn[first], turn[second]]
}

impl FiveDofLaser {
    /// The instrument of `cncsim`, its corner cubes about `point_mm`.
    #[must_use]
    pub const fn built_in(point_mm: [f64; 3], seed: u64) -> Self {
        Self {
            focal_mm: [230.0, 250.0, 210.0],
            beams_mm: [[-35.0, 8.0], [33.0, 8.0]],
            point_mm,
            distance_mm: 400.0,
            dead_path_mm: 120.0,
            signs: [[1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [-1.0, 1.0], [1.0, -1.0]],
            skew_arcsec: [[12.0, -20.0], [15.0, -17.0]],
            drift_arcsec: 0.1,
            noise_um: 0.1,
            noise_arcsec: 0.1,
            seed,
        }
    }

    /// Runs an axis forward and back over its travel.
    /// # Errors
    /// [`InstrumentError`] for fewer than three positions.
    pub fn run(
        &self,
        axis: AxisName,
        carriage: &Carriage<'_>,
        positions: usize,
        cycles: usize,
    ) -> Result<Vec<FiveDofRow>, InstrumentError> {
        if positions < 3 {
            return Err(InstrumentError::TooFew { count: positions, needed: 3 });
        }
        let [low, high] = carriage.travel();
        let mut noise = Noise::new(self.seed);
        let mut pointing = Pointing::default();
        let mut rows = Vec::with_capacity(2 * positions * cycles);
        for cycle in 1..=cycles {
            for direction in [1, -1] {
                for step in 0..positions {
                    let step = if direction > 0 { step } else { positions - 1 - step };
                    let q = low + (high - low) * step as f64 / (positions - 1) as f64;
                    pointing.step(&mut noise, rad_from_arcsec(self.drift_arcsec));
                    let seen = carriage.at(q, direction);
                    let along = q - low;
                    let channels_um = self.read(axis, &seen, along, &pointing, [0.0; 2], &mut noise);
                    let is_end = step == 0 || step == positions - 1;
                    let roll = seen.rotation()[axis.direction()].to_degrees() * 3600.0;
                    rows.push(FiveDofRow {
                        position_mm: q,
                        distance_mm: self.distance_mm + along,
                        direction,
                        cycle,
                        channels_um,
                        level_arcsec: is_end.then(|| roll + noise.draw(self.noise_arcsec)),
                        push_um: [0.0; 2],
                    });
                }
            }
        }
        Ok(rows)
    }

    /// Logs the resting carriage near and far; in the second half of each log it is pushed aside by `push_um`.
    #[must_use]
    pub fn rest(
        &self,
        axis: AxisName,
        carriage: &Carriage<'_>,
        readings: usize,
        push_um: f64,
    ) -> Vec<FiveDofRow> {
        let [low, high] = carriage.travel();
        let mut noise = Noise::new(self.seed ^ 0x5eed);
        let mut pointing = Pointing::default();
        let mut rows = Vec::with_capacity(2 * readings);
        for q in [low, high] {
            let seen = carriage.at(q, 1);
            for k in 0..readings {
                pointing.step(&mut noise, rad_from_arcsec(self.drift_arcsec));
                let pushed = if 2 * k >= readings { [push_um, -push_um] } else { [0.0; 2] };
                rows.push(FiveDofRow {
                    position_mm: q,
                    distance_mm: self.distance_mm + q - low,
                    direction: 1,
                    cycle: 1,
                    channels_um: self.read(axis, &seen, q - low, &pointing, pushed, &mut noise),
                    level_arcsec: None,
                    push_um: pushed,
                });
            }
        }
        rows
    }

    /// Channels with the carriage `along` from the lower end of its travel, um.
    pub(super) fn read(
        &self,
        axis: AxisName,
        seen: &Seen,
        along: f64,
        pointing: &Pointing,
        push_um: [f64; 2],
        noise: &mut Noise,
    ) -> [[f64; 2]; 5] {
        let lateral = [(axis.direction() + 1) % 3, (axis.direction() + 2) % 3];
        let path = self.distance_mm + along + self.dead_path_mm;
        let turn = seen.rotation();
        let quadrant = |j: usize| -> [f64; 2] {
            let mut cube = self.point_mm;
            for (direction, offset) in lateral.iter().zip(self.beams_mm[j]) {
                cube[*direction] += offset;
            }
            let moved = seen.displacement(cube);
            std::array::from_fn(|i| {
                let skew = rad_from_arcsec(self.skew_arcsec[j][i]) * along;
                2.0 * (moved[lateral[i]] + skew + push_um[i] * 1e-3 - path * pointing.angle[j][i])
            })
        };
        let [f1, f2, f3] = self.focal_mm;
        let [one, two] = pointing.angle;
        let plain = [
            [f1 * (one[0] - 2.0 * turn[lateral[1]]), f1 * (one[1] + 2.0 * turn[lateral[0]])],
            one.map(|v| -f2 * v),
            two.map(|v| -f3 * v),
            quadrant(1),
            quadrant(0),
        ];
        std::array::from_fn(|c| {
            std::array::from_fn(|i| self.signs[c][i] * um_from_mm(plain[c][i]) + noise.draw(self.noise_um))
        })
    }
}

/// Names of the lateral directions of an axis.
#[must_use]
pub fn lateral_letters(axis: AxisName) -> [char; 2] {
    let letters = ['x', 'y', 'z'];
    [letters[(axis.direction() + 1) % 3], letters[(axis.direction() + 2) % 3]]
}

/// Columns of the channels.
fn channel_header(axis: AxisName) -> String {
    let mut text = String::new();
    for detector in ["psd1", "psd2", "psd3", "qd1", "qd2"] {
        for letter in lateral_letters(axis) {
            text.push_str(&format!(",{detector}_{letter}_um"));
        }
    }
    text
}

fn channels(row: &FiveDofRow) -> String {
    row.channels_um.as_flattened().iter().map(|v| format!(",{v:.5}")).collect()
}

/// A run as a table.
#[must_use]
pub fn run_csv(axis: AxisName, rows: &[FiveDofRow]) -> String {
    let mut text = format!("cycle,direction,position_mm,distance_mm{},level_arcsec\n", channel_header(axis));
    for r in rows {
        let level = r.level_arcsec.map_or_else(String::new, |v| format!("{v:.4}"));
        text.push_str(&format!(
            "{},{},{:.6},{:.3}{},{level}\n",
            r.cycle,
            r.direction,
            r.position_mm,
            r.distance_mm,
            channels(r)
        ));
    }
    text
}

/// A resting log as a table.
#[must_use]
pub fn rest_csv(axis: AxisName, rows: &[FiveDofRow]) -> String {
    let [a, b] = lateral_letters(axis);
    let mut text = format!("distance_mm,push_{a}_um,push_{b}_um{}\n", channel_header(axis));
    for r in rows {
        let [pa, pb] = r.push_um;
        text.push_str(&format!("{:.3},{pa},{pb}{}\n", r.distance_mm, channels(r)));
    }
    text
}
