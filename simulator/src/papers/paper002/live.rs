//! The machine under its control with a laser on each axis, measured without and with the daemon.
//!
//! The control waits for each answer, and the daemon for its estimator, which keeps the control's time: nothing depends on
//! how fast the computer is.

use std::fmt::Write as _;

use anyhow::{Context, bail};
use volcomp_units::axes::AxisName;

use super::super::scales::{Thermometers, free_port};
use super::super::{Setting, shop};
use super::survey::{laser, middle};
use super::{AXES, BOX_MM, LOW_MM, Mode, World};
use crate::control::{CycleRecord, Flow, Interface};
use crate::demo::shop::Shop;
use crate::instruments::carriage::{Carriage, Mount};
use crate::instruments::link::SensorLink;
use crate::instruments::live::LiveRawLaser;
use crate::through::{Point, Selection, Want};
use crate::truth::TruthMachine;
use crate::twin::Dice;

/// Control cycle, s.
const CYCLE_S: f64 = 0.01;
/// Time between readings of a laser, s of the control.
const READ_S: f64 = 0.05;
/// Dwell at a stop, s, and over how many of its last cycles the interferometer averages.
const DWELL_S: f64 = 5.0;
const AVERAGED: usize = 150;
/// Feed between stops, mm/min.
const FEED: f64 = 20_000.0;
/// Targets of positioning, steps of a diagonal.
const TARGETS: usize = 11;
const STEPS: usize = 10;

/// Deviations of positioning (X, Y, Z) and of the diagonals, um, over the distance, mm.
#[derive(Debug, Clone, Default)]
pub(super) struct Curves {
    pub(super) positioning: [Vec<(f64, f64)>; 3],
    pub(super) diagonals: Vec<Vec<(f64, f64)>>,
}

/// Range of values.
pub(super) fn range<'a>(curves: impl IntoIterator<Item = &'a Vec<(f64, f64)>>) -> f64 {
    let (low, high) = curves
        .into_iter()
        .flatten()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), (_, v)| (l.min(*v), h.max(*v)));
    (high - low).max(0.0)
}

/// Control, machine and lasers.
struct Bench {
    shop: Shop,
    /// The machine as the lasers see it.
    seen: TruthMachine,
    lasers: Vec<(AxisName, usize, LiveRawLaser)>,
    link: Option<SensorLink>,
    scales: Thermometers,
}

impl Bench {
    fn open(setting: &Setting, world: &World) -> anyhow::Result<Self> {
        let machine = world.test.clone();
        let mut lasers = Vec::new();
        for axis in AXES {
            let k = machine.index_of(axis).context("axis")?;
            let raw =
                LiveRawLaser::new(laser(&machine, axis, setting.seed), axis, machine.travel(k)[0], READ_S);
            lasers.push((axis, k, raw));
        }
        let shop = shop(&machine, setting.seed, CYCLE_S, Interface::CALLS, |_| middle(&machine))?;
        Ok(Self { shop, seen: machine, lasers, link: None, scales: world.scales.clone() })
    }

    fn run(&mut self, program: &str, want: Want) -> anyhow::Result<Vec<Point>> {
        let mut motion = self.shop.trajectory(program)?;
        let Self { shop, seen, lasers, link, scales } = self;
        let mut selection = Selection::new(want);
        let truth = seen.clone();
        shop.watch(&mut motion, &mut |r: &CycleRecord| {
            selection.see(&truth, r);
            if let Some(link) = link {
                seen.set_time_s(r.time_s);
                let mut text = String::new();
                for (axis, k, laser) in &mut *lasers {
                    let at = &r.sample.axis;
                    let name = format!("laser-{}", axis.lower());
                    let look = || Carriage::new(seen, *axis, Mount::Carriage).map(|c| c.at_position(at, 0));
                    if let Ok(seen) = look() {
                        text += &laser.line(&name, r.time_s, at[*k], || seen).unwrap_or_default();
                    }
                }
                text += &scales.line(r.time_s).unwrap_or_default();
                if !text.is_empty() {
                    link.send_and_wait(text.as_bytes())?;
                }
            }
            Ok(Flow::GoOn)
        })?;
        Ok(selection.finish(&truth))
    }

    /// Each axis once through its whole travel: the lasers find their lines.
    fn reference(&mut self) -> anyhow::Result<()> {
        let mut text = format!("G21 G90 G94 G17\nF{FEED}\n");
        for (axis, k, _) in &self.lasers {
            let [low, high] = self.seen.travel(*k);
            let _ =
                write!(text, "G1 {axis}{low}\nG4 P0.5\nG1 {axis}{high}\nG4 P0.5\nG1 {axis}{low}\nG4 P0.5\n");
        }
        self.run(&(text + "M30\n"), Want::Path(1000)).map(drop)
    }

    /// Positioning of the three axes: deviations over the position.
    fn positioning(&mut self, seed: u64, scale: f64) -> anyhow::Result<[Vec<(f64, f64)>; 3]> {
        let mut dice = Dice::new(seed, "measurement of paper 002");
        let mut curves: [Vec<(f64, f64)>; 3] = Default::default();
        let centre = middle(&self.seen);
        let k = AXES.map(|axis| self.seen.index_of(axis).unwrap_or(0));
        let home = format!("X{} Y{} Z{}", centre[k[0]], centre[k[1]], centre[k[2]]);
        for (i, axis) in AXES.into_iter().enumerate() {
            let [low, high] = self.seen.travel(k[i]);
            let margin = 0.01 * (high - low);
            let target =
                |n: usize| low + margin + (high - low - 2.0 * margin) * n as f64 / (TARGETS - 1) as f64;
            let mut text =
                format!("G21 G90 G94 G17\n(SCORE OFF)\nG0 {home}\nF{FEED}\nG1 {axis}{low}\n(SCORE ON)\n");
            for n in (0..TARGETS).chain((0..TARGETS).rev()) {
                if n == TARGETS - 1 {
                    // the way back begins beyond the last target
                    let _ = write!(
                        text,
                        "G1 {axis}{:.4}\nG4 P{DWELL_S}\n(SCORE OFF)\nG1 {axis}{high}\n(SCORE ON)\n",
                        target(n)
                    );
                    continue;
                }
                let _ = write!(text, "G1 {axis}{:.4}\nG4 P{DWELL_S}\n", target(n));
            }
            let points = self.run(&(text + "(SCORE OFF)\nM30\n"), Want::MeanStops(AVERAGED))?;
            if points.len() != 2 * TARGETS {
                bail!("{} stops of {}", points.len(), 2 * TARGETS);
            }
            let mut unit = [0.0; 3];
            unit[axis.direction()] = 1.0;
            let read = displacement(&points, unit, scale, &mut dice);
            // the mean of both directions, as the paper has it
            curves[i] = (0..TARGETS)
                .map(|n| (target(n), f64::midpoint(read[n], read[2 * TARGETS - 1 - n])))
                .collect();
        }
        Ok(curves)
    }

    /// Deviations of the four body diagonals over the distance.
    fn diagonals(&mut self, seed: u64, scale: f64) -> anyhow::Result<Vec<Vec<(f64, f64)>>> {
        let mut dice = Dice::new(seed, "diagonals of paper 002");
        let mut curves = Vec::new();
        for signs in [[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, -1.0]] {
            let at = |n: usize| {
                let share = n as f64 / STEPS as f64;
                let [x, y, z] = [0, 1, 2]
                    .map(|i| LOW_MM[i] + BOX_MM[i] * if signs[i] > 0.0 { share } else { 1.0 - share });
                format!("X{x:.4} Y{y:.4} Z{z:.4}")
            };
            let mut text = format!("G21 G90 G94 G17\n(SCORE OFF)\nG0 {}\nF{FEED}\n(SCORE ON)\n", at(0));
            for n in 0..=STEPS {
                let _ = write!(text, "G1 {}\nG4 P{DWELL_S}\n", at(n));
            }
            let points = self.run(&(text + "(SCORE OFF)\nM30\n"), Want::MeanStops(AVERAGED))?;
            if points.len() != STEPS + 1 {
                bail!("{} stops of {}", points.len(), STEPS + 1);
            }
            let length = BOX_MM.iter().map(|v| v * v).sum::<f64>().sqrt();
            let unit = [0, 1, 2].map(|i| signs[i] * BOX_MM[i] / length);
            let read = displacement(&points, unit, scale, &mut dice);
            curves
                .push(read.iter().enumerate().map(|(n, v)| (length * n as f64 / STEPS as f64, *v)).collect());
        }
        Ok(curves)
    }
}

/// Displacement from the first point along a beam, actual minus nominal, um, with the scale error (um/m) and the noise of
/// the interferometer.
fn displacement(points: &[Point], unit: [f64; 3], scale: f64, dice: &mut Dice) -> Vec<f64> {
    let along = |p: [f64; 3], q: [f64; 3]| (0..3).map(|i| (q[i] - p[i]) * unit[i]).sum::<f64>();
    points
        .iter()
        .map(|p| {
            let nominal = along(points[0].nominal_mm, p.nominal_mm);
            let actual = along(points[0].actual_mm, p.actual_mm);
            1e3 * (actual - nominal) + 1e-3 * scale * nominal + 0.3 * dice.normal()
        })
        .collect()
}

/// The machine without the daemon.
pub(super) fn before(setting: &Setting, world: &World) -> anyhow::Result<Curves> {
    let mut bench = Bench::open(setting, world)?;
    let positioning = bench.positioning(setting.seed, world.check_um_per_m)?;
    Ok(Curves { positioning, diagonals: bench.diagonals(setting.seed, world.check_um_per_m)? })
}

/// The machine with the daemon and live lasers; `positioning` is left empty where only the diagonals are wanted.
pub(super) fn after(
    setting: &Setting,
    world: &World,
    mode: Mode,
    wants_positioning: bool,
) -> anyhow::Result<Curves> {
    let mut bench = Bench::open(setting, world)?;
    let sensors = free_port()?;
    let config = setting.path(&format!("machine-{}.toml", mode.name()));
    let name = format!("machine-{}.toml", mode.name());
    setting.write(&name, &super::files::machine(setting, &bench.shop.address(), sensors, mode, world)?)?;
    let log = setting.path(&format!("volcompd-{}.log", mode.name()));
    setting.write(&format!("volcompd-{}.log", mode.name()), "")?;
    let daemon = bench.shop.start_daemon(&setting.programs, &config, &log)?;
    bench.link = Some(SensorLink::new(sensors));
    bench.reference()?;
    let positioning = if wants_positioning {
        bench.positioning(setting.seed, world.check_um_per_m)?
    } else {
        Default::default()
    };
    let diagonals = bench.diagonals(setting.seed, world.check_um_per_m)?;
    bench.shop.control().close();
    drop(daemon);
    Ok(Curves { positioning, diagonals })
}
