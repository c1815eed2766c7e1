//! What the instruments make of the machine: mounting, drift, noise, and effects of their own.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use super::run::{State, Taken};
use crate::twin::{Dice, Effect, InstrumentTruth, TwinTruth};

/// White noise of the instruments, um.
const NOISE_UM: &[(&str, f64)] = &[
    ("laser", 0.5),
    ("ballbar", 0.7),
    ("tracker", 2.0),
    ("probe", 0.6),
    ("rtest", 0.8),
    ("load", 0.7),
    ("dynamic", 0.5),
    ("capture", 0.4),
];
/// Turn of a tracker that nobody knows, rad.
const TRACKER_TURN: f64 = 10e-6;
/// Air temperature for which lengths in air are right, degC.
const AIR_DEGC: f64 = 20.0;
/// Length of the laser's path before it begins to count, mm.
const DEAD_PATH_MM: f64 = 300.0;

/// One reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// What the instrument wrote, um; `None` where it lost the reading.
    pub deviation_um: Option<f64>,
    /// What the effects alone did, without mounting, drift and noise, um: to scale effects with.
    pub effects_um: f64,
    /// Standard deviation of the instrument's white noise, um.
    pub noise_um: f64,
}

/// White noise of an instrument, um.
#[must_use]
pub fn noise_um(instrument: &str) -> f64 {
    NOISE_UM.iter().find(|(n, _)| *n == instrument).map_or(1.0, |(_, um)| *um)
}

/// A mounting: what nobody knows of it, and how it wanders.
struct Mounting {
    offset: [f64; 3],
    turn: [f64; 3],
    drift: [f64; 3],
    waves: [[f64; 3]; 3],
    trend: [f64; 3],
    first_s: f64,
    last_s: f64,
}

impl Mounting {
    fn new(t: &InstrumentTruth, sigma: f64, tracker: bool, now: f64, dice: &mut Dice) -> Self {
        let mut three = |s: f64| [(); 3].map(|()| s * dice.normal());
        let offset = three(t.mounting * sigma);
        let turn = three(if tracker { TRACKER_TURN } else { 0.0 });
        let drift = three(t.drift * sigma);
        let trend = three(t.trend_per_h * sigma);
        let amplitude = three(std::f64::consts::SQRT_2 * t.waves * sigma);
        let waves = amplitude.map(|a| [a, dice.between(600.0, 2500.0), dice.between(0.0, TAU)]);
        Self { offset, turn, drift, waves, trend, first_s: now, last_s: now }
    }

    /// Where it stands, um.
    fn at(&mut self, t: &InstrumentTruth, sigma: f64, state: &State, dice: &mut Dice) -> [f64; 3] {
        let keep = (-(state.t_s - self.last_s).max(0.0) / t.drift_s).exp();
        if state.t_s > self.last_s {
            for d in &mut self.drift {
                *d = keep * *d + (1.0 - keep * keep).sqrt() * t.drift * sigma * dice.normal();
            }
            self.last_s = state.t_s;
        }
        let since = state.t_s - self.first_s;
        let arm = state.station_mm.map_or([0.0; 3], |s| {
            let p = state.command.linear.map(|a| a.q);
            std::array::from_fn(|i| (p[i] - s[i]) * 1e3)
        });
        let [a, b, c] = self.turn;
        let turned = [b * arm[2] - c * arm[1], c * arm[0] - a * arm[2], a * arm[1] - b * arm[0]];
        std::array::from_fn(|i| {
            let [amplitude, period, phase] = self.waves[i];
            self.offset[i]
                + self.drift[i]
                + self.trend[i] * since / 3600.0
                + amplitude * (TAU * since / period + phase).sin()
                + turned[i]
        })
    }
}

/// Effects of chance with their state.
struct Chance {
    vibration: Option<(f64, f64)>,
    outliers: Option<(f64, f64)>,
    step: Option<f64>,
    range: Option<f64>,
}

/// Measures everything that was taken; `seed` is the day.
#[must_use]
pub fn measure(taken: &Taken, truth: &TwinTruth, seed: u64) -> Vec<Measured> {
    let t = &truth.instruments;
    let of = |name: &str| truth.effects.iter().find(|e| e.name == name);
    let mut constants = Dice::new(truth.seed, "instruments");
    let hertz = constants.between(12.0, 90.0);
    let share = constants.between(0.01, 0.025);
    let chance = Chance {
        vibration: of("vibration").map(|e| (1.41 * e.size_um, e.constant("hertz", hertz))),
        // few and far off: together they have the size as their RMS
        outliers: of("outliers").map(|e| {
            let share = e.constant("share", share).clamp(1e-4, 0.2);
            (share, e.size_um / share.sqrt())
        }),
        step: of("quantisation").map(|e| 12f64.sqrt() * e.size_um.abs()),
        range: of("range-noise").map(|e| e.size_um),
    };
    let mut dice = Dice::new(seed, "noise");
    let mut mountings: BTreeMap<i64, Mounting> = BTreeMap::new();
    let mut phases: BTreeMap<i64, (f64, f64)> = BTreeMap::new();
    let mut lost = 0usize;
    taken
        .states
        .iter()
        .map(|s| {
            let sigma = t.noise * noise_um(s.instrument);
            let tracker = s.instrument == "tracker";
            let mounting = mountings
                .entry(s.place[0])
                .or_insert_with(|| Mounting::new(t, sigma, tracker, s.t_s, &mut dice));
            let stands = mounting.at(t, sigma, s, &mut dice);
            let systematic = s.true_um + of_instrument(s, of("dead-path"), of("tracker-scale"));
            let noise = sigma * if t.heavy_tails { dice.heavy() } else { dice.normal() };
            let mut by_chance = 0.0;
            if let Some((amplitude, hertz)) = chance.vibration {
                let (phase, last) =
                    phases.entry(s.place[1]).or_insert_with(|| (dice.between(0.0, TAU), s.t_s));
                // the pump's speed wanders a little
                *phase += 0.3 * (s.t_s - *last).max(0.0).sqrt() * dice.normal();
                *last = s.t_s;
                by_chance += amplitude * (TAU * hertz * s.t_s + *phase).sin() * s.u[0].hypot(s.u[1]).max(0.5);
            }
            if let Some((share, size)) = chance.outliers
                && dice.between(0.0, 1.0) < share
            {
                by_chance += size * dice.sign() * dice.between(0.7, 1.3);
            }
            if let Some(size) = chance.range
                && let Some(station) = s.station_mm
            {
                by_chance += size * across(s, station) * dice.normal();
            }
            let along: f64 = (0..3).map(|i| s.u[i] * stands[i]).sum();
            let mut value = systematic + along + noise + by_chance;
            let mut rounding = 0.0;
            if let Some(step) = chance.step.filter(|v| *v > 1e-6) {
                let rounded = (value / step).round() * step;
                rounding = rounded - value;
                value = rounded;
            }
            if lost > 0 {
                lost -= 1;
            } else if t.dropouts > 0.0 && dice.between(0.0, 1.0) < t.dropouts / 3.0 {
                // a beam that is broken stays so for a few readings
                lost = 1 + dice.below(5);
            }
            Measured {
                deviation_um: (lost == 0).then_some(value),
                effects_um: systematic + by_chance + rounding,
                noise_um: sigma,
            }
        })
        .collect()
}

/// Noise of angles across the beam, which grows with the range, per unit at 2 m.
fn across(s: &State, station: [f64; 3]) -> f64 {
    let p = s.command.linear.map(|a| a.q);
    let line: [f64; 3] = std::array::from_fn(|i| p[i] - station[i]);
    let range = line.iter().map(|v| v * v).sum::<f64>().sqrt().max(1.0);
    let cos: f64 = (0..3).map(|i| s.u[i] * line[i]).sum::<f64>() / range;
    (1.0 - cos * cos).max(0.0).sqrt() * (range / 2000.0).powi(2)
}

/// Refraction of air of a temperature at normal pressure, n - 1 (an ideal gas).
fn refraction(degc: f64) -> f64 {
    2.71e-4 * (273.15 + AIR_DEGC) / (273.15 + degc)
}

/// What dead path and scale do, um. Sizes are meant per K and metre, and at 300 mm.
fn of_instrument(s: &State, dead_path: Option<&Effect>, scale: Option<&Effect>) -> f64 {
    let mut um = 0.0;
    if let Some(e) = dead_path
        && s.instrument == "laser"
    {
        let wrong = refraction(AIR_DEGC) - refraction(s.air_degc);
        um += e.size_um * wrong * (s.range_mm + DEAD_PATH_MM) * 1e3;
    }
    if let (Some(e), Some(station)) = (scale, s.station_mm) {
        let p = s.command.linear.map(|a| a.q);
        let line: f64 = (0..3).map(|i| s.u[i] * (p[i] - station[i])).sum();
        um += e.size_um * line / 300.0;
    }
    um
}
