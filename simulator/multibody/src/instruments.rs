//! What instruments make of the machine: noise, drift, mountings, readings lost, faults of chance.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use nalgebra::Vector3;

use crate::faults::Fault;
use crate::program::{Program, Sample};
use crate::random::Stream;

/// White noise, um.
pub fn noise_um(instrument: &str) -> f64 {
    match instrument {
        "laser" | "probe" => 0.5,
        "flight" | "load" | "ballbar" => 0.8,
        "tracker" => 2.0,
        "rtest" => 0.9,
        "dynamic" => 1.0,
        _ => 0.4,
    }
}

/// How nature behaves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nature {
    /// Drift of a mounting in units of the noise, and its correlation time, s.
    pub drift: (f64, f64),
    /// Heavy tails, waves and trends.
    pub hard: bool,
    /// Share of readings that are lost.
    pub lost: f64,
}

struct Mounting {
    offset: Vector3<f64>,
    turn: Vector3<f64>,
    wander: Vector3<f64>,
    last_s: f64,
    begin_s: f64,
    wave: (Vector3<f64>, f64, f64),
    trend: Vector3<f64>,
}

/// What is written for each reading, um; `None` where it is lost. `effects` is what the machine does along u, um.
pub fn read(
    program: &Program,
    effects: &[f64],
    faults: &[Fault],
    nature: Nature,
    day: u64,
) -> Vec<Option<f64>> {
    let mut white = Stream::new(day, "white noise");
    let mut slow = Stream::new(day, "mountings");
    let mut rare = Stream::new(day, "chance");
    let mut mountings: BTreeMap<(i64, &str), Mounting> = BTreeMap::new();
    let mut lost = 0usize;
    program
        .samples
        .iter()
        .zip(effects)
        .map(|(s, effect)| {
            let sigma = noise_um(s.instrument);
            let m = mountings.entry((s.place[0], s.instrument)).or_insert_with(|| {
                let hard = if nature.hard { sigma } else { 0.0 };
                Mounting {
                    offset: slow.normals() * (5.0 * sigma),
                    turn: slow.normals() * if s.instrument == "tracker" { 9e-6 } else { 0.0 },
                    wander: slow.normals() * (nature.drift.0 * sigma),
                    last_s: s.t_s,
                    begin_s: s.t_s,
                    wave: (
                        slow.normals() * (0.5 * hard),
                        slow.uniform(600.0, 2500.0),
                        slow.uniform(0.0, TAU),
                    ),
                    trend: slow.normals() * (0.4 * hard / 3600.0),
                }
            });
            let gone = s.t_s - m.last_s;
            if gone > 0.0 {
                let keep = (-gone / nature.drift.1).exp();
                let fresh = (1.0 - keep * keep).sqrt() * nature.drift.0 * sigma;
                m.wander = m.wander * keep + slow.normals() * fresh;
                m.last_s = s.t_s;
            }
            let t = s.t_s - m.begin_s;
            let arm = arm(s);
            let mounting = m.offset
                + m.wander
                + m.wave.0 * (TAU * t / m.wave.1 + m.wave.2).sin()
                + m.trend * t
                + m.turn.cross(&arm) * 1e3;
            let scatter = if nature.hard { white.heavy() } else { white.normal() };
            let mut um = effect + mounting.dot(&s.u) + sigma * scatter;
            um += by_chance(s, faults, sigma, &mut rare);
            let begins = rare.uniform(0.0, 1.0) < 0.3 * nature.lost;
            lost = if begins { 3 } else { lost.saturating_sub(1) };
            if let Some(digit) = faults.iter().find_map(Fault::digit) {
                um = (um / digit).round() * digit;
            }
            (lost == 0).then_some(um)
        })
        .collect()
}

fn arm(s: &Sample) -> Vector3<f64> {
    s.station.map_or_else(Vector3::zeros, |station| Vector3::from_fn(|k, _| s.command.q[k]) - station)
}

/// Faults of chance at a reading, um; rounding comes last, where the reading is written.
pub fn by_chance(s: &Sample, faults: &[Fault], sigma: f64, rare: &mut Stream) -> f64 {
    let mut um = 0.0;
    for f in faults {
        if let Some((way, hertz)) = f.shake() {
            // the pump's phase slips by a turn in some minutes
            let phase = TAU * (hertz * s.t_s + 0.3 * (s.t_s / 47.0).sin() + 0.21 * s.t_s / 113.0);
            um += way.dot(&s.u) * phase.sin();
        }
        if let Some((share, size)) = f.outliers() {
            let hit = rare.uniform(0.0, 1.0) < share;
            let far = rare.normal();
            if hit {
                um += sigma.max(0.3) * size * (far.signum() * 0.7 + far);
            }
        }
        if let Some(across) = f.range_noise() {
            let noise = rare.normal();
            if let (Some(range), Some(station)) = (s.range_mm, s.station) {
                let along = arm(s).normalize().dot(&s.u);
                let _ = station;
                um += across * (range / 2000.0).powi(2) * (1.0 - along * along).max(0.0).sqrt() * noise;
            }
        }
    }
    um
}
