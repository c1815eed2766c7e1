//! Calibration of drift gains and channel signs from a log of the resting carriage at two or more distances.
//!
//! The carriage rests, the source's pointing drifts. Everything the channels then show follows from the pointing, so
//! that beam by beam PSD1 over PSD2 gives `k` and the sign of PSD1, and QD over the PSD of its beam gives
//! `s (g d + p)` at each distance d: one distance says nothing about g and p apart, two give both, three test the
//! straight line. Signs follow relative to those of the quadrant detectors, which say where plus is; these are
//! taken from the instrument, or from pushes of the carriage by known amounts where the log has some.
//!
//! The pointing itself is read with noise, which would flatten every slope; its variance, from second differences (a
//! drift is slow, noise is not), is taken out. The scatter about the line gives the noise of the other channels and the
//! uncertainties, so that whatever else moved during the log makes them larger.
//!
//! Source: equations 5.2 (factor d theta to be verified by logging a resting carriage); Fuller, Measurement Error
//! Models, 1987, section 1.2 (slope and its variance with the error variance of x known).

use super::{Channels, Detector, Head};

/// One reading of the log.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RestingReading {
    /// Distance from head to carriage, mm.
    pub distance: f64,
    /// Known displacement of the carriage (y, z), mm; 0 where it was not pushed.
    pub push: [f64; 2],
    /// The channels, mm.
    pub channels: Channels,
}

/// A number with its standard uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Estimate {
    /// The number.
    pub value: f64,
    /// Its standard uncertainty, k = 1.
    pub std: f64,
}

/// The result.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// The instrument with gains, signs and noise as found.
    pub head: Head,
    /// Gain k of the pointing in PSD1.
    pub angle_gain: [Estimate; 2],
    /// Gain g of distance times pointing, beam 1 and beam 2.
    pub gain: [[Estimate; 2]; 2],
    /// Path p beyond the stated distance, beam 1 and beam 2, mm.
    pub path: [[Estimate; 2]; 2],
    /// RMS drift of the pointing of beam 1 and beam 2, rad.
    pub drift: [[f64; 2]; 2],
    /// chi^2 of the straight line over the distances, summed over all channels, and its degrees of freedom.
    pub linearity: (f64, usize),
    /// Signs of the quadrant detectors came from pushes.
    pub pushed: [bool; 2],
    /// Distinct distances, mm.
    pub distances: Vec<f64>,
}

/// Why a log determines nothing.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum RestingError {
    /// One distance only.
    #[error(
        "the log has one distance only ({distance_mm:.1} mm): the gain of the drift and the beam path outside the stated distance are confounded; log the resting carriage at a second distance, as far away as the axis allows"
    )]
    OneDistance {
        /// The distance.
        distance_mm: f64,
    },
    /// Too few readings.
    #[error("{found} readings at {distance_mm:.1} mm, at least {needed} are needed; log longer")]
    TooFew {
        /// The distance.
        distance_mm: f64,
        /// Readings there.
        found: usize,
        /// Readings needed.
        needed: usize,
    },
    /// The pointing stood still.
    #[error(
        "{} {direction}: no pointing drift in the log (scatter {scatter_um:.3} um, noise {noise_um:.3} um); what does not move calibrates nothing: log longer, or tilt the head a little by hand during the log", detector.name()
    )]
    NoDrift {
        /// Detector that watches the pointing.
        detector: Detector,
        /// Lateral direction, 1 or 2.
        direction: u8,
        /// Standard deviation of its readings.
        scatter_um: f64,
        /// Standard deviation of its noise.
        noise_um: f64,
    },
    /// The pointing drifted less than the noise.
    #[error(
        "{} {direction}: drift {drift_um:.3} um rms, noise {noise_um:.3} um; the drift must be at least {limit} times the noise: average the readings, log longer, or tilt the head a little", detector.name(), limit = DRIFT_OVER_NOISE_MIN
    )]
    NoiseAboveDrift {
        /// Detector that watches the pointing.
        detector: Detector,
        /// Lateral direction, 1 or 2.
        direction: u8,
        /// RMS drift.
        drift_um: f64,
        /// Standard deviation of its noise.
        noise_um: f64,
    },
    /// The gain is too uncertain.
    #[error(
        "{} {direction}: drift gain {value:.3} +- {std:.3} (k = 1), limit {limit}; take distances farther apart or log longer", detector.name(), limit = GAIN_STD_MAX
    )]
    Undetermined {
        /// The detector.
        detector: Detector,
        /// Lateral direction, 1 or 2.
        direction: u8,
        /// The gain.
        value: f64,
        /// Its uncertainty.
        std: f64,
    },
    /// A push that does not arrive.
    #[error(
        "{} {direction}: reads {response:.2} per pushed length, expected 2 or -2; is the unit of the push right, and did the carriage follow it?", detector.name()
    )]
    Push {
        /// The detector.
        detector: Detector,
        /// Lateral direction, 1 or 2.
        direction: u8,
        /// Reading over push.
        response: f64,
    },
}

/// Least readings at each distance.
pub const READINGS_MIN: usize = 20;
/// Least ratio of drift to noise, both RMS.
pub const DRIFT_OVER_NOISE_MIN: f64 = 2.0;
/// Largest standard uncertainty of a gain.
pub const GAIN_STD_MAX: f64 = 0.1;

/// Consecutive readings at one distance with one push.
type Block<'a> = &'a [RestingReading];

/// Calibrates an instrument; its focal lengths and quadrant signs are taken as given.
///
/// # Errors
/// The log does not determine gains and signs.
pub fn calibrate(head: &Head, log: &[RestingReading]) -> Result<Calibration, RestingError> {
    let blocks: Vec<Block<'_>> =
        log.chunk_by(|a, b| same(a.distance, b.distance) && a.push == b.push).collect();
    let distances = distances(log)?;
    let noise: Channels =
        std::array::from_fn(|c| std::array::from_fn(|i| noise_of(&blocks, |r| r.channels[c][i])));
    let mut found = Calibration {
        head: Head { noise, ..*head },
        angle_gain: Default::default(),
        gain: Default::default(),
        path: Default::default(),
        drift: [[0.0; 2]; 2],
        linearity: (0.0, 0),
        pushed: [false; 2],
        distances,
    };
    for i in 0..2 {
        for beam in 0..2 {
            found.drift[beam][i] = drift(&blocks, &found.head, beam, i)?;
            found.find_lever(&blocks, beam, i)?;
        }
        found.find_angle_gain(&blocks, i)?;
    }
    Ok(found)
}

/// The distinct distances, increasing.
fn distances(log: &[RestingReading]) -> Result<Vec<f64>, RestingError> {
    let mut all: Vec<f64> = log.iter().map(|r| r.distance).collect();
    all.sort_by(f64::total_cmp);
    all.dedup_by(|a, b| same(*a, *b));
    if all.len() < 2 {
        return Err(RestingError::OneDistance { distance_mm: all.first().copied().unwrap_or(0.0) });
    }
    for &distance_mm in &all {
        let found = log.iter().filter(|r| same(r.distance, distance_mm)).count();
        if found < READINGS_MIN {
            return Err(RestingError::TooFew { distance_mm, found, needed: READINGS_MIN });
        }
    }
    Ok(all)
}

/// Distances within a micrometre are one.
fn same(a: f64, b: f64) -> bool {
    (a - b).abs() < 1e-3
}

/// Noise from second differences, which a slow drift hardly enters.
fn noise_of(blocks: &[Block<'_>], value: impl Fn(&RestingReading) -> f64) -> f64 {
    let seconds =
        blocks.iter().flat_map(|b| b.windows(3)).map(|w| value(&w[0]) - 2.0 * value(&w[1]) + value(&w[2]));
    let (sum, n) = seconds.fold((0.0, 0usize), |(sum, n), d| (sum + d * d, n + 1));
    (sum / (6.0 * n.max(1) as f64)).sqrt()
}

/// RMS pointing of a beam beyond its noise, rad.
fn drift(blocks: &[Block<'_>], head: &Head, beam: usize, i: usize) -> Result<f64, RestingError> {
    let psd = 1 + beam;
    let noise = head.noise[psd][i];
    let pairs = Moments::of(blocks, |r| r.channels[psd][i], |_| 0.0);
    let scatter2 = pairs.xx / pairs.dof;
    let (detector, direction) = (Detector::ALL[psd], i as u8 + 1);
    let noise2 = noise * noise;
    if scatter2 <= noise2 * (1.0 + 3.0 * (2.0 / pairs.dof).sqrt()) {
        let (scatter_um, noise_um) = (scatter2.sqrt() * 1e3, noise * 1e3);
        return Err(RestingError::NoDrift { detector, direction, scatter_um, noise_um });
    }
    let drift = (scatter2 - noise2).sqrt();
    if drift < DRIFT_OVER_NOISE_MIN * noise {
        let (drift_um, noise_um) = (drift * 1e3, noise * 1e3);
        return Err(RestingError::NoiseAboveDrift { detector, direction, drift_um, noise_um });
    }
    Ok(drift / head.focal[psd])
}

impl Estimate {
    /// Refuses a gain that is too uncertain.
    fn check(self, detector: Detector, direction: u8) -> Result<(), RestingError> {
        let Self { value, std } = self;
        if std <= GAIN_STD_MAX && value.abs() > 5.0 * std {
            return Ok(());
        }
        Err(RestingError::Undetermined { detector, direction, value, std })
    }
}

impl Calibration {
    /// By how many standard deviations the nearest gain lies above the halved one (d theta/2, as printed in paper 002).
    #[must_use]
    pub fn halved_gain_excluded(&self) -> f64 {
        let gains = self.gain.as_flattened().iter();
        gains.map(|g| (g.value - 0.5) / g.std.max(1e-12)).fold(f64::INFINITY, f64::min)
    }

    /// True where the gain is a straight line over the distances, within three standard deviations of its test.
    #[must_use]
    pub fn is_straight(&self) -> bool {
        let (chi2, dof) = (self.linearity.0, self.linearity.1 as f64);
        chi2 <= dof + 3.0 * (2.0 * dof).sqrt()
    }

    /// Gain, path and signs of the quadrant detector of a beam in direction `i`.
    fn find_lever(&mut self, blocks: &[Block<'_>], beam: usize, i: usize) -> Result<(), RestingError> {
        let (psd, qd) = (1 + beam, 4 - beam);
        let (detector, direction) = (Detector::ALL[qd], i as u8 + 1);
        let focal = self.head.focal[psd];
        let mut nearest = None;
        let slopes: Vec<(f64, Estimate)> = self
            .distances
            .iter()
            .map(|&d| {
                let here: Vec<Block<'_>> =
                    blocks.iter().copied().filter(|b| same(b[0].distance, d)).collect();
                let moments = Moments::of(&here, |r| r.channels[psd][i], |r| r.channels[qd][i]);
                let (slope, rest) = moments.slope(self.head.noise[psd][i]);
                nearest.get_or_insert_with(|| (rest, noise_of(&here, |r| r.channels[qd][i])));
                (d, slope)
            })
            .collect();
        // near the head the pointing moves the detector least; what it does there from reading to reading is the upper
        // bound, and the better number where the noise of the pointing hides the scatter
        if let Some((rest, bound)) = nearest {
            self.head.noise[qd][i] = if rest > 0.5 * bound * bound { rest.sqrt().min(bound) } else { bound };
        }
        let levers: Vec<(f64, Estimate)> = slopes
            .iter()
            .map(|(d, s)| (*d, Estimate { value: s.value * focal / 2.0, std: s.std * focal / 2.0 }))
            .collect();
        let (gain, path, chi2) = weighted_line(&levers);
        gain.check(detector, direction)?;
        if let Some(response) = push_response(blocks, psd, qd, i, &self.distances) {
            if !(1.6..=2.4).contains(&response.abs()) {
                return Err(RestingError::Push { detector, direction, response });
            }
            self.head.signs[qd][i] = response.signum();
            self.pushed[i] = true;
        }
        let relative = gain.value.signum();
        self.head.signs[psd][i] = relative * self.head.signs[qd][i];
        self.gain[beam][i] = Estimate { value: gain.value.abs(), ..gain };
        self.path[beam][i] = Estimate { value: relative * path.value, ..path };
        self.head.gain[beam][i] = self.gain[beam][i].value;
        self.head.path[beam][i] = self.path[beam][i].value;
        self.linearity.0 += chi2;
        self.linearity.1 += levers.len() - 2;
        Ok(())
    }

    /// Gain of the pointing in PSD1 and its sign; needs the sign of PSD2.
    fn find_angle_gain(&mut self, blocks: &[Block<'_>], i: usize) -> Result<(), RestingError> {
        let moments = Moments::of(blocks, |r| r.channels[1][i], |r| r.channels[0][i]);
        let (slope, rest) = moments.slope(self.head.noise[1][i]);
        self.head.noise[0][i] = rest.sqrt();
        let scale = self.head.focal[1] / self.head.focal[0];
        let gain = Estimate { value: slope.value * scale, std: slope.std * scale };
        gain.check(Detector::Psd1, i as u8 + 1)?;
        self.head.signs[0][i] = -gain.value.signum() * self.head.signs[1][i];
        self.angle_gain[i] = Estimate { value: gain.value.abs(), ..gain };
        self.head.angle_gain[i] = gain.value.abs();
        Ok(())
    }
}

/// Sums of squares and products about the mean of each block.
struct Moments {
    xx: f64,
    xy: f64,
    yy: f64,
    dof: f64,
}

impl Moments {
    fn of(
        blocks: &[Block<'_>],
        x: impl Fn(&RestingReading) -> f64,
        y: impl Fn(&RestingReading) -> f64,
    ) -> Self {
        let mut m = Self { xx: 0.0, xy: 0.0, yy: 0.0, dof: 0.0 };
        for block in blocks {
            let n = block.len() as f64;
            let (cx, cy) = (block.iter().map(&x).sum::<f64>() / n, block.iter().map(&y).sum::<f64>() / n);
            for r in *block {
                let (dx, dy) = (x(r) - cx, y(r) - cy);
                m.xx += dx * dx;
                m.xy += dx * dy;
                m.yy += dy * dy;
            }
            m.dof += n - 1.0;
        }
        m.dof = m.dof.max(1.0);
        m
    }

    /// Slope of y over x where x has the noise `noise_x`: uncertainty, and variance of y that x does not explain.
    fn slope(&self, noise_x: f64) -> (Estimate, f64) {
        let vx = noise_x * noise_x;
        let signal = (self.xx / self.dof - vx).max(f64::MIN_POSITIVE);
        let value = self.xy / self.dof / signal;
        // scatter about the line: noise of y and, through the slope, of x
        let scatter = (self.yy - 2.0 * value * self.xy + value * value * self.xx) / (self.dof - 1.0).max(1.0);
        let scatter = scatter.max(0.0);
        let of_slope = scatter / signal + (vx * scatter + 2.0 * (value * vx).powi(2)) / (signal * signal);
        let std = (of_slope / self.dof).sqrt();
        (Estimate { value, std }, (scatter - value * value * vx).max(0.0))
    }
}

/// Weighted straight line: slope, value at 0, chi^2.
fn weighted_line(points: &[(f64, Estimate)]) -> (Estimate, Estimate, f64) {
    // without noise all points count alike
    let weight = |e: &Estimate| if e.std > 0.0 { 1.0 / (e.std * e.std) } else { 1.0 };
    let exact = points.iter().all(|(_, e)| e.std == 0.0);
    let sum: f64 = points.iter().map(|(_, e)| weight(e)).sum();
    let centre = points.iter().map(|(d, e)| weight(e) * d).sum::<f64>() / sum;
    let mean = points.iter().map(|(_, e)| weight(e) * e.value).sum::<f64>() / sum;
    let dd: f64 = points.iter().map(|(d, e)| weight(e) * (d - centre).powi(2)).sum();
    let slope = points.iter().map(|(d, e)| weight(e) * (d - centre) * (e.value - mean)).sum::<f64>() / dd;
    let at_zero = mean - slope * centre;
    let chi2 = points.iter().map(|(d, e)| weight(e) * (e.value - at_zero - slope * d).powi(2)).sum();
    let std = |variance: f64| if exact { 0.0 } else { variance.sqrt() };
    (
        Estimate { value: slope, std: std(1.0 / dd) },
        Estimate { value: at_zero, std: std(1.0 / sum + centre * centre / dd) },
        if exact { 0.0 } else { chi2 },
    )
}

/// Reading of a quadrant detector per length pushed: least squares on push and pointing at each distance, so that neither takes what the
/// other says; `None` without pushes.
fn push_response(log: &[Block<'_>], psd: usize, qd: usize, i: usize, distances: &[f64]) -> Option<f64> {
    let mut sums = (0.0, 0.0);
    for d in distances {
        let here: Vec<&RestingReading> =
            log.iter().filter(|b| same(b[0].distance, *d)).copied().flatten().collect();
        let n = here.len() as f64;
        let values = here.iter().map(|r| [r.channels[psd][i], r.push[i], r.channels[qd][i]]);
        let mean: [f64; 3] = std::array::from_fn(|k| values.clone().map(|v| v[k]).sum::<f64>() / n);
        let about =
            |k: usize, l: usize| -> f64 { values.clone().map(|v| (v[k] - mean[k]) * (v[l] - mean[l])).sum() };
        let of_pointing = about(0, 1) / about(0, 0).max(f64::MIN_POSITIVE);
        sums.0 += about(1, 1) - of_pointing * about(0, 1);
        sums.1 += about(1, 2) - of_pointing * about(0, 2);
    }
    (sums.0 > 0.0).then(|| sums.1 / sums.0)
}
