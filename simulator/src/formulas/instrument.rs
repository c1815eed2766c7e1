//! What the instruments make of the machine: mountings, drift, noise, and effects of chance.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use nalgebra::Vector3;

use super::chance::Chance;
use super::laws::{Law, World};
use super::row::Row;
use super::truth::FormulaTruth;

/// White noise of the instruments, um.
const NOISE_UM: &[(&str, f64)] = &[
    ("laser", 0.6),
    ("laser-flight", 0.9),
    ("tracker", 1.8),
    ("load", 0.8),
    ("probe", 0.7),
    ("rtest", 1.0),
    ("dynamic", 0.9),
    ("ballbar", 0.8),
    ("capture", 0.5),
];
/// Unknown offset of a mounting, as a multiple of the noise.
const MOUNTING: f64 = 5.0;
/// Turn of a tracker that nobody knows, rad.
const TRACKER_TURN: f64 = 12e-6;
/// Share of readings that are lost.
const LOST: f64 = 0.004;

/// One reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// What the instrument wrote, um; `None` where it lost the reading.
    pub deviation_um: Option<f64>,
    /// What the effects alone did, um.
    pub effects_um: f64,
    /// Standard deviation of the instrument's white noise, um.
    pub noise_um: f64,
}

/// What nobody knows of a mounting, um, and how it wanders.
struct Mounting {
    offset: Vector3<f64>,
    turn: Vector3<f64>,
    wander: Vector3<f64>,
    waves: [(Vector3<f64>, f64, f64); 2],
    trend: Vector3<f64>,
    begin_s: f64,
    last_s: f64,
}

impl Mounting {
    fn new(truth: &FormulaTruth, row: &Row, sigma: f64, chance: &mut Chance) -> Self {
        let hard = if truth.hard { sigma } else { 0.0 };
        let turn = if row.instrument == "tracker" { TRACKER_TURN } else { 0.0 };
        Self {
            offset: chance.normals() * (MOUNTING * sigma),
            turn: chance.normals() * turn,
            wander: chance.normals() * (truth.drift * sigma),
            waves: [(); 2].map(|()| {
                (chance.normals() * (0.6 * hard), TAU / chance.within(500.0, 2200.0), chance.angle())
            }),
            trend: chance.normals() * (0.5 * hard / 3600.0),
            begin_s: row.t_s,
            last_s: row.t_s,
        }
    }

    /// Where it stands at a reading, um.
    fn at(&mut self, truth: &FormulaTruth, row: &Row, sigma: f64, chance: &mut Chance) -> Vector3<f64> {
        let gone = row.t_s - self.last_s;
        if gone > 0.0 {
            // an Ornstein-Uhlenbeck process, exactly, over any time
            let keep = (-gone / truth.drift_s).exp();
            let fresh = (1.0 - keep * keep).sqrt() * truth.drift * sigma;
            self.wander = self.wander * keep + chance.normals() * fresh;
            self.last_s = row.t_s;
        }
        let t = row.t_s - self.begin_s;
        let waves: Vector3<f64> =
            self.waves.iter().map(|(size, omega, phase)| size * (omega * t + phase).sin()).sum();
        let arm = row.station_mm.map_or_else(Vector3::zeros, |s| row.tip() - Vector3::from(s));
        self.offset + self.wander + waves + self.trend * t + self.turn.cross(&arm) * 1e3
    }
}

/// Effects of chance with their constants.
struct ByChance {
    /// Amplitude and direction, um; frequency, Hz; slow swelling, rad/s.
    vibration: Option<(Vector3<f64>, f64, f64)>,
    /// Share and typical size, um.
    outliers: Option<(f64, f64)>,
    /// Step, um.
    step: Option<f64>,
    /// Across the beam at 2 m, um.
    angles: Option<f64>,
}

impl ByChance {
    fn new(truth: &FormulaTruth) -> Self {
        let size = |name: &str| truth.faults.iter().find(|f| f.name == name).map(|f| f.size_um);
        let mut chance = Chance::new(truth.seed, "by chance");
        let way = chance.direction();
        // within what the capture can see: four periods of it, and half its rhythm
        let (hertz, swell) = (chance.within(16.0, 85.0), chance.within(1.0, 4.0));
        let share = chance.within(0.008, 0.025);
        Self {
            vibration: size("vibration").map(|um| (way * (2.4 * um), hertz, swell)),
            outliers: size("outliers").map(|um| (share, um / share.sqrt())),
            step: size("quantisation").map(|um| 3.46 * um.abs()),
            angles: size("range-noise"),
        }
    }

    /// What they add to a reading, um.
    fn on(&self, row: &Row, phase: f64, chance: &mut Chance) -> f64 {
        let mut um = 0.0;
        if let Some((way, hertz, swell)) = self.vibration {
            let t = row.t_s;
            um += way.dot(&row.u) * (1.0 + 0.3 * (swell * t + phase).sin()) * (TAU * hertz * t + phase).sin();
        }
        if let Some((share, size)) = self.outliers
            && chance.unit() < share
        {
            um += size * chance.either() * (0.35 * chance.normal() - 0.12).exp();
        }
        if let (Some(size), Some(beam), Some(range), "tracker") =
            (self.angles, row.beam(), row.range_mm, row.instrument)
        {
            let across = row.u - beam * beam.dot(&row.u);
            um += across.dot(&chance.normals()) * size * (range / 2000.0).powf(1.5);
        }
        um
    }
}

/// White noise of an instrument, um.
fn noise_um(instrument: &str) -> f64 {
    NOISE_UM.iter().find(|n| n.0 == instrument).map_or(1.0, |n| n.1)
}

/// Measures all rows.
#[must_use]
pub fn measure(truth: &FormulaTruth, laws: &[Law], world: &World<'_>) -> Vec<Reading> {
    let by_chance = ByChance::new(truth);
    let mut chance = Chance::new(world.day, "readings");
    let mut mountings: BTreeMap<i64, Mounting> = BTreeMap::new();
    let mut phases: BTreeMap<i64, f64> = BTreeMap::new();
    let mut reading = |row: &Row| {
        let sigma = truth.noise * noise_um(row.instrument);
        let mounting =
            mountings.entry(row.place[0]).or_insert_with(|| Mounting::new(truth, row, sigma, &mut chance));
        let stands = mounting.at(truth, row, sigma, &mut chance);
        let white = sigma * if truth.hard { chance.heavy() } else { chance.normal() };
        let phase = *phases.entry(row.place[1]).or_insert_with(|| chance.angle());
        let systematic: f64 = laws.iter().map(|law| law(row).dot(&row.u)).sum();
        let mut effects_um = systematic + by_chance.on(row, phase, &mut chance);
        let mut value = stands.dot(&row.u) + white + effects_um;
        if let Some(step) = by_chance.step.filter(|s| *s > 1e-6) {
            // digits are cut off, not rounded
            let cut = (value / step).floor() * step;
            effects_um += cut - value;
            value = cut;
        }
        let lost = chance.unit() < LOST;
        Reading { deviation_um: (!lost).then_some(value), effects_um, noise_um: sigma }
    };
    world.rows.iter().map(&mut reading).collect()
}
