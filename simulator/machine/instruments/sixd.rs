//! A 6D interferometer: displacement, two straightnesses and three angles of optics on one axis, in channels of its own.
//!
//! Lengths are seen at two points of the moving body: the reflector of the distance and that of the straightness. Each
//! channel has a direction of the machine and a sign; nothing makes the angles follow the lengths.

use volcomp_units::axes::AxisName;
use volcomp_units::um_from_mm;

use super::carriage::{Carriage, Seen};
use super::{InstrumentError, Noise};

/// Channels in the order of all arrays.
pub const CHANNELS: [&str; 6] = ["distance", "horizontal", "vertical", "roll", "pitch", "yaw"];

/// Systematic errors of the instrument: the same in every run, or drifting from run to run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SixDErrors {
    /// Wavelength and material compensation of the distance, 1e-6.
    pub scale_ppm: f64,
    /// Gain errors of straightness and angle channels, 1e-3.
    pub gain_per_mille: [f64; 5],
    /// Bending of the beam by the air, um at 1 m, horizontal and vertical; grows with the square of the distance.
    pub bending_um: [f64; 2],
    /// Drift over one run out and back: um for lengths, arcsec for angles, of random direction from run to run.
    pub drift: [f64; 2],
}

impl SixDErrors {
    /// No systematic error.
    pub const NONE: Self =
        Self { scale_ppm: 0.0, gain_per_mille: [0.0; 5], bending_um: [0.0; 2], drift: [0.0; 2] };

    /// An instrument in a shop without air conditioning.
    #[must_use]
    pub fn shop(seed: u64) -> Self {
        let mut noise = Noise::new(seed ^ 0x6d_a1e5);
        Self {
            scale_ppm: noise.draw(0.8),
            gain_per_mille: [0.0; 5].map(|_: f64| noise.draw(5.0)),
            bending_um: [noise.draw(0.3), noise.draw(0.5)],
            drift: [0.5, 0.2],
        }
    }
}

/// The instrument as it really is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SixD {
    /// Reflector of the distance, in M at home.
    pub abbe_mm: [f64; 3],
    /// Reflector of the straightnesses, in M at home.
    pub bryan_mm: [f64; 3],
    /// Signs of the channels; directions: axis, then the two that follow it in the cycle x, y, z.
    pub signs: [f64; 6],
    /// Angle of the beam against the axis, horizontal and vertical.
    pub skew_arcsec: [f64; 2],
    /// Standard deviation of a length.
    pub noise_um: f64,
    /// Standard deviation of an angle.
    pub noise_arcsec: f64,
    /// Systematic errors.
    pub errors: SixDErrors,
    /// Seed of the noise.
    pub seed: u64,
}

/// One row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SixDRow {
    /// Counted from 1.
    pub cycle: usize,
    /// +1 forward, -1 back.
    pub direction: i8,
    /// Commanded coordinate.
    pub position_mm: f64,
    /// um, arcsec.
    pub channels: [f64; 6],
}

impl SixD {
    /// Runs an axis forward and back over its travel.
    /// # Errors
    /// [`InstrumentError`] for fewer than three positions.
    pub fn run(
        &self,
        axis: AxisName,
        carriage: &Carriage<'_>,
        positions: usize,
        cycles: usize,
    ) -> Result<Vec<SixDRow>, InstrumentError> {
        if positions < 3 {
            return Err(InstrumentError::TooFew { count: positions, needed: 3 });
        }
        let [low, high] = carriage.travel();
        let mut noise = Noise::new(self.seed);
        let zero = self.motion(axis, &carriage.at(low, 1));
        let mut rows = Vec::with_capacity(2 * positions * cycles);
        let readings = (2 * positions).max(1) as f64;
        for cycle in 1..=cycles {
            let drift = self.errors.drift;
            let drift: [f64; 6] = std::array::from_fn(|i| {
                let size = drift[usize::from(i >= 3)];
                if size > 0.0 { noise.draw(size) } else { 0.0 }
            });
            for direction in [1, -1] {
                for step in 0..positions {
                    let done = if direction > 0 { step } else { positions + step } as f64 / readings;
                    let step = if direction > 0 { step } else { positions - 1 - step };
                    let q = low + (high - low) * step as f64 / (positions - 1) as f64;
                    let mut motion = self.motion(axis, &carriage.at(q, direction));
                    for i in 0..6 {
                        motion[i] -= zero[i];
                    }
                    for i in 0..2 {
                        motion[i + 1] += (self.skew_arcsec[i] / 3600.0).to_radians() * (q - low) * 1e3;
                        motion[i + 1] += self.errors.bending_um[i] * ((q - low) * 1e-3).powi(2);
                    }
                    let moved = um_from_mm(q - low) * carriage.sense();
                    motion[0] += self.errors.scale_ppm * 1e-6 * moved;
                    for (value, gain) in motion[1..].iter_mut().zip(self.errors.gain_per_mille) {
                        *value *= 1.0 + gain * 1e-3;
                    }
                    for (value, drift) in motion.iter_mut().zip(drift) {
                        *value += drift * done;
                    }
                    let channels = self.channels(&motion, &mut noise);
                    rows.push(SixDRow { cycle, direction, position_mm: q, channels });
                }
            }
        }
        Ok(rows)
    }

    /// Tilts of the optics about x, y, z of the machine by plus and minus `tilt_arcsec`: applied tilts and channels.
    #[must_use]
    pub fn tilts(&self, axis: AxisName, tilt_arcsec: f64) -> Vec<([f64; 3], [f64; 6])> {
        let mut noise = Noise::new(self.seed ^ 0x711e);
        let mut rows = Vec::new();
        for about in 0..3 {
            for tilt in [0.0, tilt_arcsec, 0.0, -tilt_arcsec] {
                let mut applied = [0.0; 3];
                applied[about] = tilt;
                let mut motion = [0.0; 6];
                for (i, value) in motion[3..].iter_mut().enumerate() {
                    *value = applied[(axis.direction() + i) % 3];
                }
                rows.push((applied, self.channels(&motion, &mut noise)));
            }
        }
        rows
    }

    /// Lengths (um) and angles (arcsec) along and about the axis and the two directions that follow it.
    fn motion(&self, axis: AxisName, seen: &Seen) -> [f64; 6] {
        let (along, across, turn) =
            (seen.displacement(self.abbe_mm), seen.displacement(self.bryan_mm), seen.rotation());
        std::array::from_fn(|i| {
            let direction = (axis.direction() + i) % 3;
            match i {
                0 => um_from_mm(along[direction]),
                1 | 2 => um_from_mm(across[direction]),
                _ => turn[direction].to_degrees() * 3600.0,
            }
        })
    }

    fn channels(&self, motion: &[f64; 6], noise: &mut Noise) -> [f64; 6] {
        std::array::from_fn(|i| {
            let std = if i < 3 { self.noise_um } else { self.noise_arcsec };
            self.signs[i] * motion[i] + noise.draw(std)
        })
    }
}

fn header() -> String {
    CHANNELS
        .iter()
        .enumerate()
        .map(|(i, name)| format!(",{name}_{}", if i < 3 { "um" } else { "arcsec" }))
        .collect()
}

fn values(channels: &[f64; 6]) -> String {
    channels.iter().map(|v| format!(",{v:.5}")).collect()
}

/// A run as a table.
#[must_use]
pub fn run_csv(rows: &[SixDRow]) -> String {
    let mut text = format!("cycle,direction,position_mm{}\n", header());
    for r in rows {
        let head = format!("{},{},{:.6}", r.cycle, r.direction, r.position_mm);
        text.push_str(&format!("{head}{}\n", values(&r.channels)));
    }
    text
}

/// A tilt test as a table.
#[must_use]
pub fn tilt_csv(rows: &[([f64; 3], [f64; 6])]) -> String {
    let mut text = format!("applied_ea_arcsec,applied_eb_arcsec,applied_ec_arcsec{}\n", header());
    for ([a, b, c], channels) in rows {
        text.push_str(&format!("{a},{b},{c}{}\n", values(channels)));
    }
    text
}

/// The sign table of the set-up along `axis`, as `volcomp identify straightness --signs` reads it.
#[must_use]
pub fn sign_table(axis: AxisName, signs: &[f64; 6]) -> String {
    let letters = ['x', 'y', 'z', 'a', 'b', 'c'];
    let mut text = format!("format = \"volcomp-6d/1\"\ninstrument = \"cncsim 6D\"\n\n[{}]\n", axis.lower());
    for (i, (name, sign)) in CHANNELS.iter().zip(signs).enumerate() {
        let letter = letters[i / 3 * 3 + (axis.direction() + i) % 3];
        let sign = if *sign < 0.0 { '-' } else { '+' };
        text.push_str(&format!("{name} = \"{sign}{letter}\"\n"));
    }
    text
}
