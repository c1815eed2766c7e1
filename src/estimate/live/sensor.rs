//! A sensor and how it stands: plausibility, clock, noise, and whether it agrees with its map.

use super::axis::AxisLaser;
use super::health::SensorHealth;
use super::reading::Reading;
use super::rows::{DefaultStd, Gap};
use super::sensor_probation::SensorProbation;
use super::spec::{SensorKind, SensorSpec};
use crate::{
    Adaptation, Batch, Kind, MeasurementNoise, NoiseAssessment, Plausibility, Said, SensorClock, SensorFault,
    SensorInitialisation, SensorStatus, Supervisor, VALUES_MAX,
};
use volcomp_model::units::MonoTime;

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
    Initialising(SensorInitialisation),
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
    /// Variance of its noise over the stated one: lengths, angles.
    noise: [f64; 2],
    pub(super) stage: Stage,
    pub(super) rejections: u32,
    pub(super) probation: SensorProbation,
    pub(super) laser: Option<AxisLaser>,
    /// Live value of the model that it tells, and the value.
    pub(super) channel: Option<usize>,
    pub(super) value: Option<f64>,
    /// When the reading arrived that its live values are from.
    pub(super) told: MonoTime,
    /// The last numbers that were believed (temperatures, speeds).
    pub(super) believed: Vec<f64>,
    /// What that live value is.
    pub(super) unit: Kind,
    pub(super) last_at: Option<MonoTime>,
    pub(super) readings: [u64; 3],
    pub(super) without_position: u64,
    pub(super) skipped: u64,
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
            noise: [1.0; 2],
            stage: Stage::Initialising(SensorInitialisation::new(spec.initialisation)),
            rejections: 0,
            probation: SensorProbation::default(),
            laser,
            channel,
            value: None,
            told: MonoTime::ZERO,
            believed: Vec::new(),
            unit: Kind::Length,
            last_at: None,
            readings: [0; 3],
            without_position: 0,
            skipped: 0,
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
        let was = self.supervisor.status();
        let said = Said { at, stepped, quality: reading.quality, values, raw: &raw };
        let believed = self.supervisor.accept(now, &said);
        self.values = raw;
        if matches!(was, SensorStatus::Excluded(_))
            != matches!(self.supervisor.status(), SensorStatus::Excluded(_))
        {
            // whatever made it fail, it has to be initialised again
            self.get_to_know();
        }
        believed
    }

    /// A reading whose numbers are inputs of thermal displacements.
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

    /// What it said cannot be judged at all, for this reason.
    pub(super) fn refuse(&mut self, now: MonoTime, fault: SensorFault) {
        self.supervisor.hear(now);
        let was = self.supervisor.status();
        self.supervisor.exclude(now, fault);
        if !matches!(was, SensorStatus::Excluded(_)) {
            self.get_to_know();
        }
    }

    /// Its readings are only looked at for a while.
    pub(super) fn get_to_know(&mut self) {
        self.stage = Stage::Initialising(SensorInitialisation::new(self.spec.initialisation));
        self.rejections = 0;
        self.value = None;
        // a laser that jumped may have been moved; one that was silent has not
        if self.supervisor.status() == SensorStatus::Excluded(SensorFault::Jump)
            && let Some(laser) = &mut self.laser
        {
            laser.forget();
        }
    }

    /// What was found out about it; true where it may be used.
    pub(super) fn meet(&mut self, now: MonoTime, assessment: &NoiseAssessment, gate: f64) -> bool {
        let [_, high] = NOISE_RANGE;
        let plausible = assessment.variance.iter().all(|v| v.is_finite() && *v <= high);
        if !plausible || assessment.disagreement > gate {
            return false;
        }
        if self.spec.adapt {
            let [low, high] = NOISE_RANGE;
            self.noise = assessment.begin_with.map(|v| v.clamp(low, high));
        }
        self.probation.met(now, self.noise);
        self.stage = Stage::Used;
        true
    }

    /// Standard deviation of the noise of a kind over the stated one.
    pub(super) fn noise_factor(&self, kind: Kind) -> f64 {
        self.noise[kind.index()].sqrt()
    }

    /// Noise of rows that were divided by the noise as it is known so far.
    pub(super) fn relative_noise(&self) -> [MeasurementNoise; 2] {
        let [low, high] = NOISE_RANGE;
        self.noise.map(|v| {
            let adaptation = Adaptation { share: NOISE_SHARE, low: low / v, high: high / v };
            // 1 is between the limits, for `v` is: there is nothing to refuse
            MeasurementNoise::new(1.0, self.spec.adapt.then_some(adaptation))
                .unwrap_or_else(|_| MeasurementNoise::unit())
        })
    }

    /// Variance of its noise over the stated one: lengths, angles.
    pub(super) const fn noise(&self) -> [f64; 2] {
        self.noise
    }

    /// What such rows have taught about the noise.
    pub(super) fn learn_noise(&mut self, relative: &[MeasurementNoise; 2]) {
        let [low, high] = NOISE_RANGE;
        for (own, relative) in self.noise.iter_mut().zip(relative) {
            *own = (*own * relative.variance()).clamp(low, high);
        }
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
        let (status, since) = self.supervisor.reported();
        SensorHealth {
            name: self.spec.name.clone(),
            kind: self.spec.kind.name(),
            status,
            status_s: now.seconds_since(since),
            age_s: self.supervisor.heard().map(|at| now.seconds_since(at)),
            clock_offset_s: self.clock.offset_s(),
            shift_s: delay,
            readings: self.readings,
            without_position: self.without_position,
            skipped: self.skipped,
            rests_s: self.probation.rests_s(now),
            initialisation: match &self.stage {
                Stage::Initialising(it) if is_tool => Some(it.progress()),
                _ => None,
            },
            noise_factor: is_tool.then(|| Kind::ALL.map(|kind| self.noise_factor(kind))),
            innovation: self.innovation,
            nis: self.nis,
            referenced: self.laser.as_ref().map(|laser| (laser.coverage(), laser.is_referenced())),
            values: self.values.clone(),
        }
    }
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
    for row in &gap.rows {
        let (slot, end) = match row.kind {
            Kind::Length => (&mut length, VALUES_MAX / 2),
            Kind::Angle => (&mut angle, VALUES_MAX),
        };
        if *slot < end {
            out[*slot] = row.value;
            *slot += 1;
        }
    }
    out
}
