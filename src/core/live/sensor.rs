//! A sensor and how it stands: plausibility, clock, noise, and whether it agrees with its map.

use super::axis::AxisLaser;
use super::health::SensorHealth;
use super::reading::Reading;
use super::rows::{DefaultStd, Gap};
use super::spec::{SensorKind, SensorSpec};
use crate::core::estimate::{
    Acquaintance, Adaptation, Batch, MeasurementNoise, Opinion, Plausibility, Said, SensorClock, Standing,
    Supervisor, Trouble, VALUES_MAX,
};
use crate::core::units::MonoTime;

/// The noise is believed between a tenth and ten times of what is stated; variances.
const NOISE_RANGE: [f64; 2] = [0.01, 100.0];
/// Share of each row in the noise: about 200 rows are remembered.
const NOISE_SHARE: f64 = 0.005;
/// Share of each reading in the running mean of `nu^2 / S`.
const NIS_SHARE: f64 = 0.02;

/// How far a sensor is known.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Stage {
    /// Its readings are only looked at.
    Acquainting(Acquaintance),
    /// They are used.
    Used,
}

/// A sensor.
#[derive(Debug, Clone)]
pub(super) struct SensorState {
    pub(super) spec: SensorSpec,
    pub(super) supervisor: Supervisor,
    pub(super) clock: SensorClock,
    /// Number by which its map knows it.
    pub(super) number: usize,
    pub(super) noise: MeasurementNoise,
    pub(super) stage: Stage,
    pub(super) rejections: u32,
    pub(super) laser: Option<AxisLaser>,
    /// Live value of the model that it tells, and the value.
    pub(super) channel: Option<usize>,
    pub(super) value: Option<f64>,
    /// The last numbers that were believed (temperatures, speeds).
    pub(super) believed: Vec<f64>,
    /// That live value is an angle.
    pub(super) is_angle: bool,
    pub(super) last_at: Option<MonoTime>,
    pub(super) readings: [u64; 3],
    pub(super) without_position: u64,
    innovation: Option<[f64; 3]>,
    nis: Option<f64>,
    values: Vec<f64>,
}

impl SensorState {
    pub(super) fn new(spec: &SensorSpec, laser: Option<AxisLaser>, channel: Option<usize>) -> Self {
        Self {
            supervisor: Supervisor::new(plausibility(spec)),
            clock: SensorClock::new(spec.latency_s),
            number: 0,
            noise: noise(1.0, spec.adapt),
            stage: Stage::Acquainting(Acquaintance::new(spec.acquaintance)),
            rejections: 0,
            laser,
            channel,
            value: None,
            believed: Vec::new(),
            is_angle: false,
            last_at: None,
            readings: [0; 3],
            without_position: 0,
            innovation: None,
            nis: None,
            values: Vec::new(),
            spec: spec.clone(),
        }
    }

    /// Noise of readings that state none.
    pub(super) const fn std(&self) -> DefaultStd {
        DefaultStd { mm: self.spec.std_mm, rad: self.spec.std_rad }
    }

    /// Whether what it says can be; `values` are judged by range, jump and rate.
    pub(super) fn judge(
        &mut self,
        now: MonoTime,
        (at, stepped): (MonoTime, bool),
        reading: &Reading,
        values: &[f64],
    ) -> bool {
        let raw = reading.numbers();
        let was = self.supervisor.standing();
        let said = Said { at, stepped, quality: reading.quality, values, raw: &raw };
        let believed = self.supervisor.accept(now, &said);
        self.values = raw;
        if matches!(was, Standing::Excluded(_)) != matches!(self.supervisor.standing(), Standing::Excluded(_))
        {
            // whatever made it fail, it has to be got to know anew
            self.get_to_know();
        }
        believed
    }

    /// A reading whose numbers are inputs of growths.
    pub(super) fn believe(
        &mut self,
        now: MonoTime,
        when: (MonoTime, bool),
        reading: &Reading,
        numbers: &[f64],
    ) {
        if self.judge(now, when, reading, numbers) {
            self.readings[1] += 1;
            self.believed = numbers.to_vec();
        }
    }

    /// Its readings are only looked at for a while.
    pub(super) fn get_to_know(&mut self) {
        self.stage = Stage::Acquainting(Acquaintance::new(self.spec.acquaintance));
        self.rejections = 0;
        self.value = None;
        // a laser that jumped may have been moved; one that was silent has not
        if self.supervisor.standing() == Standing::Excluded(Trouble::Jump)
            && let Some(laser) = &mut self.laser
        {
            laser.forget();
        }
    }

    /// What was found out about it; true where it may be used.
    pub(super) fn meet(&mut self, opinion: &Opinion, gate: f64) -> bool {
        let [_, high] = NOISE_RANGE;
        let plausible = opinion.variance.is_finite() && opinion.variance <= high;
        if !plausible || opinion.disagreement > gate {
            return false;
        }
        if self.spec.adapt {
            self.noise = noise(opinion.begin_with, true);
        }
        self.stage = Stage::Used;
        true
    }

    /// Notes how a reading went.
    pub(super) fn note(&mut self, batch: &Batch) {
        self.innovation = Some([batch.innovation, batch.expected, batch.worst]);
    }

    /// Notes the consistency of a reading that was used.
    pub(super) fn note_used(&mut self, batch: &Batch) {
        self.readings[1] += 1;
        if batch.rows > 0 {
            let seen = batch.nis / f64::from(batch.rows);
            let before = self.nis.unwrap_or(1.0);
            self.nis = Some(before + NIS_SHARE * (seen - before));
        }
    }

    /// How it goes; `delay` is what its map knows of its delay.
    pub(super) fn health(&self, now: MonoTime, delay: Option<[f64; 2]>) -> SensorHealth {
        let is_tool = matches!(self.spec.kind, SensorKind::Tool { .. });
        SensorHealth {
            name: self.spec.name.clone(),
            kind: self.spec.kind.name(),
            standing: self.supervisor.standing(),
            standing_s: now.seconds_since(self.supervisor.since()),
            age_s: self.supervisor.heard().map(|at| now.seconds_since(at)),
            clock_offset_s: self.clock.offset_s(),
            shift_s: delay,
            readings: self.readings,
            without_position: self.without_position,
            acquaintance: match &self.stage {
                Stage::Acquainting(it) if is_tool => Some(it.progress()),
                _ => None,
            },
            noise_factor: is_tool.then(|| self.noise.variance().sqrt()),
            innovation: self.innovation,
            nis: self.nis,
            referenced: self.laser.as_ref().map(|laser| (laser.coverage(), laser.is_referenced())),
            values: self.values.clone(),
        }
    }
}

fn noise(variance: f64, adapt: bool) -> MeasurementNoise {
    let [low, high] = NOISE_RANGE;
    let adaptation = adapt.then_some(Adaptation { share: NOISE_SHARE, low, high });
    // 1 is between the limits, and so is what was clipped to them: there is nothing to refuse
    MeasurementNoise::new(variance.clamp(low, high), adaptation).unwrap_or_else(|_| MeasurementNoise::unit())
}

/// The limits in the order of the numbers that are judged: see [`judged`].
fn plausibility(spec: &SensorSpec) -> Plausibility {
    let lanes = |of: [f64; 2]| -> [f64; VALUES_MAX] {
        let unit = |k: usize| match spec.kind {
            // two straightnesses, then three angles
            SensorKind::FiveDof { .. } => usize::from(k >= 2),
            // lengths first, angles from the middle on
            _ => usize::from(k >= VALUES_MAX / 2),
        };
        core::array::from_fn(|k| of[unit(k)])
    };
    Plausibility {
        age_limit_s: spec.age_limit_s,
        range: lanes(spec.range),
        jump: lanes(spec.jump),
        rate: lanes(spec.rate),
        frozen_s: spec.frozen_s,
        quality_min: spec.quality_min,
        return_s: spec.return_s,
    }
}

/// Numbers of a gap to be judged: lengths first, angles from the middle on.
pub(super) fn judged(gap: &Gap) -> [f64; VALUES_MAX] {
    let mut out = [0.0; VALUES_MAX];
    let (mut length, mut angle) = (0, VALUES_MAX / 2);
    for (value, is_length) in gap.values.iter().zip(&gap.is_length) {
        let (slot, end) = if *is_length { (&mut length, VALUES_MAX / 2) } else { (&mut angle, VALUES_MAX) };
        if *slot < end {
            out[*slot] = *value;
            *slot += 1;
        }
    }
    out
}
