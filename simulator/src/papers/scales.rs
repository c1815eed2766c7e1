//! Thermometers on the scales of X, Y and Z: what they read after the survey, and how model and daemon use it.

use core::net::SocketAddr;

use anyhow::Context;
use volcomp_units::axes::AxisName;

use crate::truth::TruthMachine;
use crate::truth::conditions::{Acting, Conditions};
use crate::twin::Dice;

const AXES: [AxisName; 3] = [AxisName::X, AxisName::Y, AxisName::Z];
/// Temperature of the survey, degC.
const SURVEY_DEGC: f64 = 20.0;
/// Expansion coefficient that the maker of the scales states, um/(m K).
const STRAIN_UM_PER_M_K: f64 = 11.5;
/// The sensors in the machine file of the daemon.
pub(super) const SENSORS: &str =
    "[[sensor]]\nname = \"scales\"\nkind = \"temperature\"\nage-limit-ms = 5000\n";

/// How right a thermometer is, K: what its calibration leaves, and to what it repeats from the survey to the test.
#[derive(Debug, Clone, Copy)]
pub(super) struct ThermometerErrors {
    /// Thermometers along a scale, of which the mean is reported.
    pub(super) along: u8,
    pub(super) calibration_k: f64,
    pub(super) repeats_k: f64,
}

/// Thermometers on the scales, and what they tell.
#[derive(Debug, Clone)]
pub(super) struct Thermometers {
    /// At the survey, degC: growth counts from there, so that the calibration drops out.
    pub(super) survey_degc: [f64; 3],
    /// At the test.
    pub(super) test_degc: [f64; 3],
    /// When they tell the next time.
    next_s: f64,
}

impl Thermometers {
    /// Without any errors on a machine that has stayed as it was.
    pub(super) const IDEAL: Self =
        Self { survey_degc: [SURVEY_DEGC; 3], test_degc: [SURVEY_DEGC; 3], next_s: f64::NEG_INFINITY };

    /// Thermometers on a machine that the conditions have warmed since the survey.
    pub(super) fn new(
        conditions: &Conditions,
        travel: [[f64; 2]; 3],
        errors: ThermometerErrors,
        dice: &mut Dice,
    ) -> Self {
        let heat = Acting { heat: true, load: false, interaction: false, wear: false };
        let only_heat = conditions.clone().with(heat);
        let mut them = Self::IDEAL;
        let [calibration_k, repeats_k] =
            [errors.calibration_k, errors.repeats_k].map(|k| k / f64::from(errors.along).sqrt());
        for k in 0..3 {
            let growth = |q: f64| {
                let mut at = [0.0; 3];
                at[k] = q;
                only_heat.motion(AXES[k], at, 0.0)[k]
            };
            let [low, high] = travel[k];
            let rise_k = (growth(high) - growth(low)) / (high - low) / (1e-6 * STRAIN_UM_PER_M_K);
            let own = SURVEY_DEGC + calibration_k * dice.normal();
            them.survey_degc[k] = own + repeats_k * dice.normal();
            them.test_degc[k] = own + rise_k + repeats_k * dice.normal();
        }
        them
    }

    /// The same on a machine that has not warmed.
    pub(super) fn cold(&self) -> Self {
        Self { test_degc: self.survey_degc, ..self.clone() }
    }

    /// What they tell the daemon at the test, four times a second.
    pub(super) fn line(&mut self, time_s: f64) -> Option<String> {
        if time_s < self.next_s {
            return None;
        }
        self.next_s = time_s + 0.25;
        let [x, y, z] = self.test_degc;
        Some(format!(
            "{{\"sensor\":\"scales\",\"t_s\":{time_s:.6},\"temperature_degc\":[{x:.3},{y:.3},{z:.3}]}}\n"
        ))
    }
}

/// A model whose positioning errors of X, Y and Z expand with the scales about the middle of the travel.
pub(super) fn add_to_model(
    model: &str,
    machine: &TruthMachine,
    thermometers: &Thermometers,
) -> anyhow::Result<String> {
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
             range-degc = [10, 30]\nreference-degc = {:.3}\nstrain-um-per-m-k = [{STRAIN_UM_PER_M_K}]\n",
            n + 1,
            thermometers.survey_degc[n]
        ));
    }
    Ok(toml::to_string(&file)? + &thermal)
}

/// A free port of loopback.
pub(super) fn free_port() -> anyhow::Result<SocketAddr> {
    Ok(std::net::TcpListener::bind("127.0.0.1:0")?.local_addr()?)
}
