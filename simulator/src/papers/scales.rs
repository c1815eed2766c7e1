//! Thermometers on the scales of X, Y and Z: what they read after the survey, and how model and daemon use it.

use core::net::SocketAddr;
use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Instant;

use anyhow::Context;
use volcomp_units::axes::AxisName;

use crate::instruments::link::SensorLink;
use crate::truth::TruthMachine;
use crate::truth::conditions::{Acting, Conditions};
use crate::twin::Dice;

const AXES: [AxisName; 3] = [AxisName::X, AxisName::Y, AxisName::Z];
/// Temperature of the survey, degC.
pub(super) const SURVEY_DEGC: f64 = 20.0;
/// Expansion coefficient that the maker of the scales states, um/(m K).
const STRAIN_UM_PER_M_K: f64 = 11.5;
/// The sensors in the machine file of the daemon.
pub(super) const SENSORS: &str =
    "[[sensor]]\nname = \"scales\"\nkind = \"temperature\"\nage-limit-ms = 5000\n";

/// What they read at the test, degC, with a standard deviation of `sd_k` of each.
pub(super) fn read(conditions: &Conditions, travel: [[f64; 2]; 3], sd_k: f64, dice: &mut Dice) -> [f64; 3] {
    let heat = Acting { heat: true, load: false, interaction: false, wear: false };
    let only_heat = conditions.clone().with(heat);
    core::array::from_fn(|k| {
        let growth = |q: f64| {
            let mut at = [0.0; 3];
            at[k] = q;
            only_heat.motion(AXES[k], at, 0.0)[k]
        };
        let [low, high] = travel[k];
        let rise_k = (growth(high) - growth(low)) / (high - low) / (1e-6 * STRAIN_UM_PER_M_K);
        SURVEY_DEGC + rise_k + sd_k * dice.normal()
    })
}

/// A model whose positioning errors of X, Y and Z expand with the scales about the middle of the travel.
pub(super) fn add_to_model(model: &str, machine: &TruthMachine) -> anyhow::Result<String> {
    let mut file: toml::Table = model.parse()?;
    let errors = file.get_mut("errors").and_then(toml::Value::as_table_mut).context("errors")?;
    let mut thermal = String::new();
    for (n, axis) in AXES.into_iter().enumerate() {
        let letter = axis.lower();
        let [low, high] = machine.travel(machine.index_of(axis).context("axis")?);
        let mut live = toml::Table::new();
        live.insert("sensor".into(), format!("scale-{letter}").into());
        live.insert("limit-um".into(), 300.0.into());
        live.insert("reference-mm".into(), f64::midpoint(low, high).into());
        let of = errors.entry(format!("e{letter}{letter}")).or_insert_with(|| toml::Table::new().into());
        of.as_table_mut().context("error")?.insert("live".into(), live.into());
        thermal.push_str(&format!(
            "[thermal.scale-{letter}]\nkind = \"expansion\"\n[[thermal.scale-{letter}.input]]\nsensor = \"scales.{}\"\n\
             range-degc = [10, 30]\nstrain-um-per-m-k = [{STRAIN_UM_PER_M_K}]\n",
            n + 1
        ));
    }
    Ok(toml::to_string(&file)? + &thermal)
}

/// One line of the sensors' protocol.
pub(super) fn line(time_s: f64, degc: [f64; 3]) -> String {
    let [x, y, z] = degc;
    format!("{{\"sensor\":\"scales\",\"t_s\":{time_s:.6},\"temperature_degc\":[{x:.3},{y:.3},{z:.3}]}}\n")
}

/// The thermometers, which tell the daemon ten times a second of real time until they are dropped.
pub(super) struct Thermometers {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Thermometers {
    /// Thermometers that read the same all the time, for a daemon whose sensors listen there.
    pub(super) fn start(sensors: SocketAddr, degc: [f64; 3]) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let seen = Arc::clone(&stop);
        let thread = std::thread::spawn(move || {
            let (mut link, begin) = (SensorLink::new(sensors), Instant::now());
            while !seen.load(Ordering::Acquire) {
                link.send(line(begin.elapsed().as_secs_f64(), degc).as_bytes());
                std::thread::sleep(Duration::from_millis(100));
            }
        });
        Self { stop, thread: Some(thread) }
    }
}

impl Drop for Thermometers {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            // it only sends and sleeps
            let _ = thread.join();
        }
    }
}

/// A free port of loopback.
pub(super) fn free_port() -> anyhow::Result<SocketAddr> {
    Ok(std::net::TcpListener::bind("127.0.0.1:0")?.local_addr()?)
}
