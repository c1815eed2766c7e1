//! The circle: run under the control, seen by a ballbar, compensated by the daemon, and replayed without single causes.

use core::net::SocketAddr;

use volcomp_cli::report_page::Plot;

use super::super::scales::Thermometers;
use super::super::{Setting, scales, shop};
use super::{World, polar_unrolled};
use crate::control::{CycleRecord, Flow, Interface};
use crate::demo::shop::Shop;
use crate::instruments::ballbar::{Ballbar, CirclePoint, Trace};
use crate::instruments::link::SensorLink;
use crate::motion::MachineAxes;
use crate::motion::paths::{self, Plane, Turn};
use crate::truth::TruthMachine;
use crate::twin::Dice;
use volcomp_units::axes::MAX_AXES;

/// Centre of the paper's circle, programmed.
pub(super) const CENTRE_MM: [f64; 3] = [343.507, -285.090, -286.430];
/// Radius.
pub(super) const RADIUS_MM: f64 = 100.0;
/// Feed of the paper.
const FEED: f64 = 200.0;
/// Control cycle: at F200 the tool moves 27 um in it.
const CYCLE_S: f64 = 0.008;
/// Time in which the daemon takes in the thermometers before the circle.
const SETTLE_S: f64 = 5.0;
/// One reading out of this many cycles.
const EVERY: usize = 5;

/// The machine under its control, with a ballbar on it.
pub(super) struct Circle {
    shop: Shop,
    ballbar: Ballbar,
    /// Length error of the bar, um.
    length_um: f64,
    scales: Thermometers,
    /// The way of the thermometers to the daemon.
    link: Option<SensorLink>,
    seed: u64,
    /// Recorded cycles of the last circle, run by run.
    runs: Vec<Vec<CycleRecord>>,
}

impl Circle {
    /// A machine in its test conditions, its control listening, the ballbar mounted.
    pub(super) fn open(setting: &Setting, world: &World) -> anyhow::Result<Self> {
        let shop = shop(&world.test, setting.seed, CYCLE_S, Interface::CALLS, MachineAxes::middle)?;
        let mut at = [0.0; MAX_AXES];
        at[..3].copy_from_slice(&CENTRE_MM);
        let centre = shop.machine().nominal(&at).tip_mm;
        let mut dice = Dice::new(setting.seed, "ballbar of paper 004");
        let mounted = [0, 1, 2].map(|i| centre[i] + if i < 2 { 5e-3 * dice.normal() } else { 0.0 });
        let length_um = if world.errors_of_instruments { 0.5 * dice.normal() } else { 0.0 };
        let ballbar = Ballbar {
            centre_mm: mounted,
            radius_mm: RADIUS_MM,
            plane: [0, 1],
            noise_um: 0.1,
            seed: setting.seed,
        };
        let scales = world.scales.clone();
        Ok(Self { shop, ballbar, length_um, scales, link: None, seed: setting.seed, runs: Vec::new() })
    }

    /// The circle counter-clockwise and clockwise.
    pub(super) fn measure(&mut self) -> anyhow::Result<Trace> {
        self.runs.clear();
        for turn in [Turn::CounterClockwise, Turn::Clockwise] {
            let program = paths::circle(&paths::Circle {
                plane: Plane::Xy,
                centre_mm: CENTRE_MM,
                radius_mm: RADIUS_MM,
                feed_mm_per_min: FEED,
                turn,
                overshoot_deg: 20.0,
                ..paths::Circle::default()
            });
            let run = self.run(&program)?;
            self.runs.push(run);
        }
        let machine = self.shop.machine();
        let runs: Vec<Vec<CirclePoint>> = self
            .runs
            .iter()
            .map(|run| {
                let thinned = run.iter().step_by(EVERY);
                thinned.map(|r| point(machine, r, r.sample.tip_mm)).collect()
            })
            .collect();
        self.trace(&runs)
    }

    /// Runs a program, the thermometers telling the daemon, and returns the cycles that count.
    fn run(&mut self, program: &str) -> anyhow::Result<Vec<CycleRecord>> {
        let mut motion = self.shop.trajectory(program)?;
        let Self { shop, scales, link, .. } = self;
        let mut cycles = Vec::new();
        shop.watch(&mut motion, &mut |r: &CycleRecord| {
            if r.scored {
                cycles.push(*r);
            }
            if let (Some(link), Some(line)) = (&mut *link, scales.line(r.time_s)) {
                link.send_and_wait(line.as_bytes())?;
            }
            Ok(Flow::GoOn)
        })?;
        Ok(cycles)
    }

    /// The circle with the daemon and a model.
    pub(super) fn compensated(&mut self, setting: &Setting, model: &str) -> anyhow::Result<Trace> {
        let config = setting.path("machine.toml");
        let sensors = scales::free_port()?;
        setting.write("machine.toml", &self.machine_file(model, sensors))?;
        let log = setting.path("volcompd.log");
        setting.write("volcompd.log", "")?;
        let daemon = self.shop.start_daemon(&setting.programs, &config, &log)?;
        self.link = Some(SensorLink::new(sensors));
        self.run(&format!("G21 G90 G94 G17\n(SCORE OFF)\nG4 P{SETTLE_S}\nM30\n"))?;
        let trace = self.measure()?;
        self.link = None;
        self.shop.control().close();
        drop(daemon);
        Ok(trace)
    }

    /// Mean square of the form error, um2, of the recorded set points on another machine.
    pub(super) fn replayed(&self, machine: &TruthMachine) -> anyhow::Result<f64> {
        let mut runs = Vec::new();
        for run in &self.runs {
            let Some(first) = run.first() else { continue };
            let mut machine = machine.clone();
            let set_point = |r: &CycleRecord| {
                let mut set = r.commanded;
                set.iter_mut().zip(r.applied).for_each(|(q, offset)| *q += offset);
                set
            };
            machine.reset(self.seed, &set_point(first));
            let mut points = Vec::new();
            for (i, r) in run.iter().enumerate() {
                let sample = machine.step(CYCLE_S, &set_point(r));
                if i % EVERY == 0 {
                    points.push(point(&machine, r, sample.tip_mm));
                }
            }
            runs.push(points);
        }
        let trace = self.trace(&runs)?;
        let form: Vec<f64> = centred(&trace).into_iter().map(|(_, d, _)| d).collect();
        let mean = form.iter().sum::<f64>() / form.len().max(1) as f64;
        Ok(form.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / form.len().max(1) as f64)
    }

    fn trace(&self, runs: &[Vec<CirclePoint>]) -> anyhow::Result<Trace> {
        let mut whole = Trace { radius_mm: RADIUS_MM, readings: Vec::new() };
        for points in runs {
            whole = whole.joined(self.ballbar.trace(points)?);
        }
        for reading in &mut whole.readings {
            reading.deviation_um += self.length_um;
        }
        Ok(whole)
    }

    fn machine_file(&self, model: &str, sensors: SocketAddr) -> String {
        let mut text = format!(
            "format = \"volcomp-machine/1\"\nmachine = \"{}\"\nmodel = \"{model}\"\n\n[link]\naddress = \"{}\"\ncycle-ms = {}\ninterface = \"read-write\"\npoll-ms = 0\n\n\
             [engine]\nstart = \"on-connect\"\nramp-s = 1.0\nstale-ms = 10000.0\n\n[realtime]\npriority = 0\nlock-memory = false\n\n\
             [status]\nsocket = \"\"\n\n[log]\ntarget = \"stderr\"\n\n[sensors]\nlisten = \"{sensors}\"\ntime = \"control\"\n\n{}",
            self.shop.machine().machine(),
            self.shop.address(),
            CYCLE_S * 1e3,
            scales::SENSORS,
        );
        for axis in self.shop.machine().axes() {
            text.push_str(&format!(
                "\n[axes.{}]\nlimit-um = 200.0\nrate-um-per-s = 2000.0\nacceleration-um-per-s2 = 40000.0\n",
                axis.lower()
            ));
        }
        text
    }
}

fn point(machine: &TruthMachine, r: &CycleRecord, tip_mm: [f64; 3]) -> CirclePoint {
    CirclePoint { commanded_mm: machine.nominal(&r.commanded).tip_mm, actual_mm: tip_mm }
}

/// Angle (deg), deviation about the least-squares centre (um) and direction of every reading.
fn centred(trace: &Trace) -> Vec<(f64, f64, i8)> {
    let n = trace.readings.len().max(1) as f64;
    let mean = |f: &dyn Fn(f64) -> f64| {
        trace.readings.iter().map(|r| r.deviation_um * f(r.angle_deg.to_radians())).sum::<f64>() / n
    };
    let (cx, cy) = (2.0 * mean(&f64::cos), 2.0 * mean(&f64::sin));
    trace
        .readings
        .iter()
        .map(|r| {
            let a = r.angle_deg.to_radians();
            (r.angle_deg, r.deviation_um - cx * a.cos() - cy * a.sin(), r.direction)
        })
        .collect()
}

/// Figure 9 of the paper, both directions.
pub(super) fn plots(before: &Trace, after: &Trace) -> Vec<Plot> {
    let of = |trace: &Trace, direction: i8| -> Vec<(f64, f64)> {
        let mut points: Vec<(f64, f64)> =
            centred(trace).into_iter().filter(|p| p.2 == direction).map(|p| (p.0, p.1)).collect();
        let step = (points.len() / 720).max(1);
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points.into_iter().step_by(step).collect()
    };
    [(1, "counter-clockwise"), (-1, "clockwise")]
        .into_iter()
        .map(|(direction, name)| {
            polar_unrolled(
                &format!("Figure 9: circle before and after, {name}"),
                [("before", of(before, direction)), ("compensated", of(after, direction))],
            )
        })
        .collect()
}
