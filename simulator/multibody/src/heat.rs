//! Heat of a day: screws, spindle, column and bed as grids, with what the sensors say.

use crate::program::{BEFORE_S, Program};
use crate::random::Stream;
use crate::solid::Rod;

/// Steel and cast iron, 1/K.
const EXPANSION: f64 = 11.5e-6;
/// Interval of the log, s.
const STEP_S: f64 = 60.0;

/// Temperatures and what grows with them.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Time, s.
    pub t_s: f64,
    /// Spindle speed, 1/min.
    pub rpm: f64,
    /// Screws X, Y, Z.
    pub screws: Vec<Rod>,
    /// Growth of the spindle, um.
    pub nose_um: f64,
    /// Rise of the head, um.
    pub head_um: f64,
    /// Bending and rise of the column, um.
    pub column_um: [f64; 2],
    /// Difference between the faces of the bed, K; no sensor sees it.
    pub bed_k: f64,
    /// Coolant, K; no sensor sees it.
    pub coolant_k: f64,
    /// Air, K above 20 degC.
    pub air_k: f64,
    /// Position X with a delay of ten minutes, mm: the load that the foundation feels.
    pub settled_mm: f64,
    /// Sensors: scales X Y Z, head, hall, degC.
    pub sensors: [f64; 5],
}

/// Names of the sensors.
pub const SENSORS: [&str; 5] = ["scale_x", "scale_y", "scale_z", "headstock", "air"];

/// The heat of a day.
#[derive(Debug, Clone)]
pub struct Heat {
    states: Vec<State>,
}

impl Heat {
    /// Simulates a day.
    pub fn new(program: &Program, day: u64) -> Self {
        let mut chance = Stream::new(day, "heat");
        let base = chance.uniform(-0.6, 0.9);
        let swing = chance.uniform(0.4, 0.9);
        let phase = chance.uniform(0.0, std::f64::consts::TAU);
        let rise = chance.uniform(0.8, 1.8);
        let heat = chance.uniform(0.8, 1.25);
        let air_s = [2600.0, 3400.0, 2100.0].map(|s| s * chance.uniform(0.85, 1.2));
        let mut screws: Vec<Rod> = air_s.iter().map(|s| Rod::new(0.6, 16, 1.6e-5, *s, base)).collect();
        let mut nose = Rod::new(0.35, 14, 4.5e-5, 5200.0, base);
        let mut head = Rod::new(0.5, 10, 9e-5, 4800.0, base);
        let mut column = Rod::new(0.4, 10, 1.3e-5, 2.5e4, base);
        let mut bed = Rod::new(0.35, 8, 1.3e-5, 3e4, base);
        let (mut coolant, mut cooling, mut settled) = (0.0, false, 300.0);
        let last = program.segments.last().map_or(0.0, |s| s.begin_s + s.motion.duration);
        let mut states = Vec::new();
        let mut segment = 0;
        let mut t = -BEFORE_S;
        while t < last + 2.0 * STEP_S {
            while program.segments.get(segment + 1).is_some_and(|s| s.begin_s <= t) {
                segment += 1;
            }
            let now = program.segments.get(segment);
            let (rpm, busy) = now.filter(|_| t >= 0.0).map_or((0.0, 0.0), |s| (s.rpm, s.busy));
            let at = now.map_or(300.0, |s| s.motion.at(t - s.begin_s).q[0]);
            let air = base
                + swing * ((std::f64::consts::TAU * t / 2.4e4 + phase).sin() - phase.sin())
                + rise * (t.max(0.0) / 3.6e4).min(1.0);
            for (k, screw) in screws.iter_mut().enumerate() {
                let rate = heat * [1.25e-3, 1.0e-3, 1.6e-3][k] * busy;
                // the nut warms the middle, the bearing one end
                screw.advance(STEP_S, air, |c| {
                    rate * if c == 0 {
                        2.2
                    } else if (3..14).contains(&c) {
                        1.0
                    } else {
                        0.3
                    }
                });
            }
            let bearing = heat * 9e-3 * (rpm / 5000.0_f64).powf(1.5);
            let warm = nose.cells[10];
            nose.advance(STEP_S, air, |c| if c < 3 { bearing } else { 0.0 });
            head.advance(STEP_S, air, |c| if c < 4 { 2.5e-4 * (warm - air) } else { 0.0 });
            column.advance(STEP_S, air, |c| if c == 0 { 4e-4 * (air - base) } else { 0.0 });
            bed.advance(STEP_S, air, |c| if c == 0 { 1.4e-3 * busy * heat } else { 0.0 });
            cooling = if coolant > 1.4 {
                true
            } else if coolant < 0.2 {
                false
            } else {
                cooling
            };
            coolant += STEP_S * if cooling { -2.2e-3 } else { 5e-4 };
            settled += (at - settled) * (1.0 - (-STEP_S / 600.0).exp());
            let mut read = |k: f64| 20.0 + k + 0.02 * chance.normal();
            let sensors = [
                read(screws[0].cells[8]),
                read(screws[1].cells[8]),
                read(screws[2].cells[8]),
                read(nose.cells[6]),
                read(air),
            ];
            states.push(State {
                t_s: t,
                rpm,
                nose_um: 1e6 * EXPANSION * 0.35 * (nose.mean() - base),
                head_um: 1e6 * EXPANSION * 0.5 * (head.mean() - base),
                column_um: [
                    // curvature over the thickness bends the column of 1.2 m
                    1e6 * EXPANSION * column.gradient() / 0.4 * 0.72,
                    1e6 * EXPANSION * 1.2 * (column.mean() - base),
                ],
                bed_k: bed.gradient(),
                coolant_k: coolant,
                air_k: air,
                settled_mm: settled - 300.0,
                screws: screws.clone(),
                sensors,
            });
            t += STEP_S;
        }
        Self { states }
    }

    /// State at a time, linear between the entries of the log.
    pub fn at(&self, t_s: f64) -> Option<State> {
        let first = self.states.first()?;
        let place = ((t_s - first.t_s) / STEP_S).clamp(0.0, (self.states.len() - 1) as f64);
        let (a, b) = (
            self.states.get(place as usize)?,
            self.states.get((place as usize + 1).min(self.states.len() - 1))?,
        );
        let f = place.fract();
        let mix = |x: f64, y: f64| x + f * (y - x);
        let mut s = a.clone();
        for (rod, other) in s.screws.iter_mut().zip(&b.screws) {
            for (x, y) in rod.cells.iter_mut().zip(&other.cells) {
                *x = mix(*x, *y);
            }
        }
        s.t_s = t_s;
        s.nose_um = mix(a.nose_um, b.nose_um);
        s.head_um = mix(a.head_um, b.head_um);
        s.column_um = [0, 1].map(|k| mix(a.column_um[k], b.column_um[k]));
        s.bed_k = mix(a.bed_k, b.bed_k);
        s.coolant_k = mix(a.coolant_k, b.coolant_k);
        s.air_k = mix(a.air_k, b.air_k);
        s.settled_mm = mix(a.settled_mm, b.settled_mm);
        Some(s)
    }

    /// Entries of the log.
    pub fn log(&self) -> &[State] {
        &self.states
    }

    /// Growth of an axis' screw up to a share of its travel, um.
    pub fn growth_um(state: &State, axis: usize, share: f64) -> f64 {
        state.screws.get(axis).map_or(0.0, |rod| 1e6 * EXPANSION * 0.6 * rod.integral(share))
    }
}
