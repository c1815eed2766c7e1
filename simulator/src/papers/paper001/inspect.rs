//! The inspection of the gear on the machine: program, control, daemon, probe, evaluation.

use std::fmt::Write as _;

use anyhow::{Context, ensure};
use serde_json::Value;
use volcomp_units::axes::AxisName;

use super::super::{Setting, shop, words};
use super::gear::{self, BALL_MM, Gear, Readings};
use crate::control::{CycleRecord, Interface};
use crate::demo::shop::Shop;
use crate::motion::MachineAxes;
use crate::truth::TruthMachine;
use crate::twin::Dice;

/// Control cycle, s.
const CYCLE_S: f64 = 0.008;
/// Passes of every flank.
const PASSES: u32 = 3;
/// Noise of the probe, um.
const NOISE_UM: f64 = 0.3;

/// Who measures what.
pub(super) struct Inspection<'a> {
    pub(super) setting: &'a Setting,
    pub(super) machine: &'a TruthMachine,
    pub(super) gear: &'a Gear,
    pub(super) noise: bool,
}

impl Inspection<'_> {
    /// Runs a program, with the daemon where a model is given, and evaluates the gear into `NAME.csv`.
    pub(super) fn run(&self, name: &str, program: &str, model: Option<&str>) -> anyhow::Result<Value> {
        let seed = self.setting.seed;
        let mut shop = shop(self.machine, seed, CYCLE_S, Interface::Frames, MachineAxes::middle)?;
        let daemon = match model {
            None => None,
            Some(model) => {
                let config = machine_file(&shop, model);
                self.setting.write("machine.toml", &config)?;
                self.setting.write("volcompd.log", "")?;
                let log = self.setting.path("volcompd.log");
                Some(shop.start_daemon(&self.setting.programs, &self.setting.path("machine.toml"), &log)?)
            }
        };
        let mut dice = Dice::new(seed, name);
        let mut readings = Readings::new();
        for pass in 1..=PASSES {
            let cycles = shop.program(program)?;
            self.read(&cycles, pass, &mut dice, &mut readings)?;
        }
        if daemon.is_some() {
            shop.control().close();
        }
        drop(daemon);
        evaluate(self.setting, name, &readings)
    }

    /// What the probe says in the scored cycles of a pass.
    fn read(
        &self,
        cycles: &[CycleRecord],
        pass: u32,
        dice: &mut Dice,
        readings: &mut Readings,
    ) -> anyhow::Result<()> {
        let a = self.machine.index_of(AxisName::A).context("no axis A")?;
        let scans: Vec<&[CycleRecord]> =
            cycles.chunk_by(|p, q| q.time_s - p.time_s < 1.5 * CYCLE_S).collect();
        let traces = gear::traces();
        ensure!(scans.len() == traces.len(), "{} scans of {} traces", scans.len(), traces.len());
        for (scan, trace) in scans.into_iter().zip(&traces) {
            let one = |r: &CycleRecord| {
                let pressed = self.gear.pressed_um(trace, r.sample.tip_mm, BALL_MM);
                let noise = if self.noise { NOISE_UM * dice.normal() } else { 0.0 };
                let face = self.machine.nominal(&r.commanded).tip_mm[0];
                (gear::position(trace, r.commanded[a], face), pressed + noise)
            };
            let list: Vec<(f64, f64)> = scan.iter().map(one).collect();
            readings.add(trace, pass, &list);
        }
        Ok(())
    }
}

/// `volcomp evaluate gear` on readings.
pub(super) fn evaluate(setting: &Setting, name: &str, readings: &Readings) -> anyhow::Result<Value> {
    let file = format!("{name}.csv");
    setting.write(&file, readings.csv())?;
    setting.json(&words(&[
        "evaluate",
        "gear",
        "--json",
        "--data",
        &setting.arg(&file),
        "--teeth",
        &gear::TEETH.to_string(),
        "--module-mm",
        &gear::MODULE_MM.to_string(),
        "--face-width-mm",
        &gear::FACE_MM.to_string(),
        "--tip-diameter-mm",
        &gear::TIP_MM.to_string(),
        "--control-diameter-mm",
        &gear::CONTROL_MM.to_string(),
        "--html",
        &setting.arg(&format!("{name}.html")),
    ]))
}

fn machine_file(shop: &Shop, model: &str) -> String {
    let mut text = format!(
        "format = \"volcomp-machine/1\"\nmachine = \"{}\"\nmodel = \"{model}\"\n\n[link]\naddress = \"{}\"\ncycle-ms = {}\n\n\
         [engine]\nstart = \"on-connect\"\nramp-s = 1.0\nstale-ms = 10000.0\n\n[realtime]\npriority = 0\nlock-memory = false\n\n\
         [status]\nsocket = \"\"\n\n[log]\ntarget = \"stderr\"\n",
        shop.machine().machine(),
        shop.address(),
        CYCLE_S * 1e3,
    );
    for axis in shop.machine().axes() {
        let unit = if matches!(axis, AxisName::A | AxisName::B) { "arcsec" } else { "um" };
        // writing into a string cannot fail
        let _ = write!(
            text,
            "\n[axes.{}]\nlimit-{unit} = 200.0\nrate-{unit}-per-s = 2000.0\nacceleration-{unit}-per-s2 = 40000.0\n",
            axis.lower()
        );
    }
    text
}
