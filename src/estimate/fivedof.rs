//! Readings of a 5-DOF laser to straightness, roll, pitch and yaw.
//!
//! Two parallel beams run from a fixed head to a carriage. Beam 1 ends on a plane mirror (detector PSD1) and, beside
//! it, a corner cube (quadrant detector QD2); beam 2 on a corner cube (QD1). PSD2 and PSD3 watch the pointing of beam 1
//! and beam 2 at the source. In laser coordinates (x along the beam, y and z across, right-handed), with theta the
//! pointing of a beam, d the distance and b the place of a corner cube on the carriage:
//!
//! `PSD1 = f1 (-2 EC + th1y, 2 EB + th1z)`, `PSD2 = -f2 (th1y, th1z)`, `PSD3 = -f3 (th2y, th2z)`,
//! `QD = 2 (EY(b) - d thy, EZ(b) - d thz)`, `EY(b) = EY - EA zb`, `EZ(b) = EZ + EA yb`.
//!
//! Solved: `theta = -s D/f`; `EC = -(s D1y/f1 - k th1y)/2`, `EB = (s D1z/f1 - k th1z)/2`;
//! `dy_j = s Dy/2 + (g d + p) thy`, `dz_j` alike; `EA = (dz2 - dz1)/(y2 - y1)`, `EZ = dz2 - EA y2`, `EY = dy2 + EA z2`.
//! Nominally g = 1, p = 0, k = 1 and all signs s = +1 with the minus of PSD2 and PSD3 as above. A corner cube
//! returns a pointing error d theta off, so that the printed compensation with d theta/2 removes half of it; signs
//! depend on mirrors and beam splitters. Both come from a log of the resting carriage: `identify::fivedof::resting`.
//!
//! Errors are those of the carriage (carriage sense) where the head stands on the bed side. Another axis than X takes the
//! same formulas: its two lateral directions follow it in the cycle x, y, z.
//!
//! Shared by the offline evaluation (`identify::fivedof`) and the live one.
//!
//! Source: equations 5.2, 4.2 ((1) to (6)), 8 (decision 7).

use nalgebra::SMatrix;

use volcomp_model::axes::AxisName;

/// The detectors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Detector {
    /// Autocollimator of the plane mirror, beam 1.
    Psd1,
    /// Pointing of beam 1.
    Psd2,
    /// Pointing of beam 2.
    Psd3,
    /// Corner cube of beam 2.
    Qd1,
    /// Corner cube of beam 1.
    Qd2,
}

impl Detector {
    /// All, in the order of all arrays.
    pub const ALL: [Self; 5] = [Self::Psd1, Self::Psd2, Self::Psd3, Self::Qd1, Self::Qd2];

    /// Its name in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Psd1 => "psd1",
            Self::Psd2 => "psd2",
            Self::Psd3 => "psd3",
            Self::Qd1 => "qd1",
            Self::Qd2 => "qd2",
        }
    }
}

/// One number per channel: detector, then first and second lateral direction.
pub type Channels = [[f64; 2]; 5];

/// The instrument; lengths mm. Index 0 of a pair is the first lateral direction (y for the X axis), 1 the second (z).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Head {
    /// Focal lengths of PSD1, PSD2, PSD3.
    pub focal: [f64; 3],
    /// Where beam 1 and beam 2 meet the carriage, in laser coordinates from the point of the straightness.
    pub beams: [[f64; 2]; 2],
    /// Sign of each channel: +1 where it reads as in the forward model.
    pub signs: Channels,
    /// Gain k of the pointing in PSD1.
    pub angle_gain: [f64; 2],
    /// Gain g of distance times pointing in QD2 (beam 1) and QD1 (beam 2).
    pub gain: [[f64; 2]; 2],
    /// Distance p that the beam runs beyond the stated distance, times the gain; QD2, then QD1.
    pub path: [[f64; 2]; 2],
    /// Standard deviation of a reading of each channel.
    pub noise: Channels,
}

/// The readings of one position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Readings {
    /// Distance from head to carriage, mm.
    pub distance: f64,
    /// Change of each channel since the reference reading, mm.
    pub change: Channels,
}

/// The errors at one position, in laser coordinates; mm and rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FiveDof {
    /// EY EZ EA EB EC.
    pub motion: [f64; 5],
    /// Displacements (y, z) of the corner cubes of beam 1 and beam 2, pointing taken out.
    pub beams: [[f64; 2]; 2],
    /// Displacement of one corner cube against the other along their connection: 0 for a rigid carriage.
    pub stretch: f64,
    /// Pointing of beam 1 and beam 2.
    pub pointing: [[f64; 2]; 2],
}

/// Why an instrument cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum HeadError {
    /// A focal length that is none.
    #[error("focal length of {} is {value_mm} mm; it must be above 0 (signs belong to the channels)", detector.name())]
    Focal {
        /// The detector.
        detector: Detector,
        /// Its value.
        value_mm: f64,
    },
    /// Beams too close for roll.
    #[error(
        "the beams are {distance_mm:.3} mm apart, at least {limit_mm} mm are needed: roll is their difference over this distance"
    )]
    Beams {
        /// Distance.
        distance_mm: f64,
        /// Least distance.
        limit_mm: f64,
    },
    /// A sign that is none.
    #[error("sign of {} is {value}; write 1 or -1", detector.name())]
    Sign {
        /// The detector.
        detector: Detector,
        /// Its value.
        value: f64,
    },
    /// A number that is not finite.
    #[error("a number of the instrument is not finite")]
    NotFinite,
}

/// Beams closer than this give no roll, mm.
pub const BEAM_DISTANCE_MIN_MM: f64 = 1.0;

/// Names of the two lateral directions of an axis: the letters that follow it in the cycle x, y, z.
#[must_use]
pub const fn lateral(axis: AxisName) -> [char; 2] {
    match axis.direction() {
        0 => ['y', 'z'],
        1 => ['z', 'x'],
        _ => ['x', 'y'],
    }
}

/// EX EY EZ EA EB EC of the machine from the five errors in laser coordinates of a run of `axis`; positioning is 0.
#[must_use]
pub const fn to_machine(axis: AxisName, [ey, ez, ea, eb, ec]: [f64; 5]) -> [f64; 6] {
    let d = axis.direction();
    let mut motion = [0.0; 6];
    motion[(d + 1) % 3] = ey;
    motion[(d + 2) % 3] = ez;
    motion[3 + d] = ea;
    motion[3 + (d + 1) % 3] = eb;
    motion[3 + (d + 2) % 3] = ec;
    motion
}

impl Head {
    /// An instrument with nominal gains and signs and without noise.
    ///
    /// # Errors
    /// A focal length or the beams make no sense.
    pub fn nominal(focal: [f64; 3], beams: [[f64; 2]; 2]) -> Result<Self, HeadError> {
        let head = Self {
            focal,
            beams,
            signs: [[1.0; 2]; 5],
            angle_gain: [1.0; 2],
            gain: [[1.0; 2]; 2],
            path: [[0.0; 2]; 2],
            noise: [[0.0; 2]; 5],
        };
        head.check()?;
        Ok(head)
    }

    /// Checks what everything below relies on.
    ///
    /// # Errors
    /// A focal length, a sign or the beams make no sense.
    pub fn check(&self) -> Result<(), HeadError> {
        let numbers = [self.angle_gain]
            .into_iter()
            .chain(self.gain)
            .chain(self.path)
            .chain(self.noise)
            .chain(self.beams);
        if numbers.flatten().any(|v| !v.is_finite()) {
            return Err(HeadError::NotFinite);
        }
        for (detector, value_mm) in Detector::ALL.into_iter().zip(self.focal) {
            if !(value_mm.is_finite() && value_mm > 0.0) {
                return Err(HeadError::Focal { detector, value_mm });
            }
        }
        for (detector, signs) in Detector::ALL.into_iter().zip(self.signs) {
            if let Some(&value) = signs.iter().find(|s| s.abs() != 1.0) {
                return Err(HeadError::Sign { detector, value });
            }
        }
        let [a, b] = self.beams;
        let distance_mm = (b[0] - a[0]).hypot(b[1] - a[1]);
        if distance_mm < BEAM_DISTANCE_MIN_MM {
            return Err(HeadError::Beams { distance_mm, limit_mm: BEAM_DISTANCE_MIN_MM });
        }
        Ok(())
    }

    /// The same instrument that takes no pointing drift out.
    #[must_use]
    pub const fn without_drift_compensation(mut self) -> Self {
        self.angle_gain = [0.0; 2];
        self.gain = [[0.0; 2]; 2];
        self.path = [[0.0; 2]; 2];
        self
    }

    /// Pointing of beam 1 and beam 2 from PSD2 and PSD3.
    #[must_use]
    pub fn pointing(&self, change: &Channels) -> [[f64; 2]; 2] {
        let of = |psd: usize| std::array::from_fn(|i| -self.signs[psd][i] * change[psd][i] / self.focal[psd]);
        [of(1), of(2)]
    }

    /// The five errors from the readings of one position.
    ///
    /// # Source  equations 5.2, signs and gains as calibrated
    #[must_use]
    pub fn reduce(&self, readings: &Readings) -> FiveDof {
        let pointing = self.pointing(&readings.change);
        let tilt = |i: usize| {
            let seen = self.signs[0][i] * readings.change[0][i] / self.focal[0];
            (seen - self.angle_gain[i] * pointing[0][i]) / 2.0
        };
        let beams: [[f64; 2]; 2] = std::array::from_fn(|j| {
            // beam 1 ends on QD2, beam 2 on QD1
            let qd = 4 - j;
            std::array::from_fn(|i| {
                let lever = self.gain[j][i] * readings.distance + self.path[j][i];
                self.signs[qd][i] * readings.change[qd][i] / 2.0 + lever * pointing[j][i]
            })
        });
        let roll = self.roll(&beams);
        let [_, [y2, z2]] = self.beams;
        FiveDof {
            motion: [beams[1][0] + roll * z2, beams[1][1] - roll * y2, roll, tilt(1), -tilt(0)],
            stretch: self.stretch(&beams),
            beams,
            pointing,
        }
    }

    /// Roll from the displacements of the two corner cubes: across their connection, by its larger part.
    #[must_use]
    pub fn roll(&self, beams: &[[f64; 2]; 2]) -> f64 {
        let [[y1, z1], [y2, z2]] = self.beams;
        if (y2 - y1).abs() >= (z2 - z1).abs() {
            (beams[1][1] - beams[0][1]) / (y2 - y1)
        } else {
            (beams[0][0] - beams[1][0]) / (z2 - z1)
        }
    }

    fn stretch(&self, beams: &[[f64; 2]; 2]) -> f64 {
        let [[y1, z1], [y2, z2]] = self.beams;
        let length = (y2 - y1).hypot(z2 - z1);
        ((beams[1][0] - beams[0][0]) * (y2 - y1) + (beams[1][1] - beams[0][1]) * (z2 - z1)) / length
    }

    /// Covariance of EY EZ EA EB EC at `distance` from the noise of the channels.
    #[must_use]
    pub fn covariance(&self, distance: f64) -> SMatrix<f64, 5, 5> {
        let mut covariance = SMatrix::zeros();
        for detector in 0..5 {
            for i in 0..2 {
                let mut change = [[0.0; 2]; 5];
                change[detector][i] = self.noise[detector][i];
                let effect = SMatrix::<f64, 5, 1>::from(self.reduce(&Readings { distance, change }).motion);
                covariance += effect * effect.transpose();
            }
        }
        covariance
    }

    /// Standard deviation of [`FiveDof::stretch`] at `distance`.
    #[must_use]
    pub fn stretch_std(&self, distance: f64) -> f64 {
        let mut variance = 0.0;
        for detector in 1..5 {
            for i in 0..2 {
                let mut change = [[0.0; 2]; 5];
                change[detector][i] = self.noise[detector][i];
                variance += self.reduce(&Readings { distance, change }).stretch.powi(2);
            }
        }
        variance.sqrt()
    }
}
