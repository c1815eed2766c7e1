//! Machine and errors of 001: sizes of the paper, signs such that A and Y add up on the flank.

use std::f64::consts::TAU;

use super::super::Setting;
use super::super::figure::Truth;
use super::super::machine::{travels, used_drives, varied_text};
use super::gear::{Gear, Y_ZERO_MM};
use crate::truth::TruthMachine;
use crate::truth::conditions::{Acting, ConditionSizes, Conditions};
use crate::twin::Dice;

const TEXT: &str = include_str!("l300g.toml");
/// Phase of the eight waves of EAA per turn: they rise while a measured flank is rolled.
const EAA_PHASE_DEG: f64 = 104.8;
/// Length of the wave of EYY and EAY; both begin to rise at the control diameter.
const WAVE_MM: f64 = 115.0;

/// Machine at survey and test, gear and instruments.
#[derive(Clone)]
pub(super) struct World {
    pub(super) survey: TruthMachine,
    pub(super) test: TruthMachine,
    /// The machine of the test with drives that do not wander.
    pub(super) quiet: TruthMachine,
    pub(super) conditions: Option<Conditions>,
    pub(super) gear: Gear,
    pub(super) hard: bool,
    pub(super) seed: u64,
}

impl World {
    pub(super) fn new(setting: &Setting) -> anyhow::Result<Self> {
        let hard = setting.truth == Truth::Hard;
        let text = |peaks: bool| {
            varied_text(TEXT, setting.seed, |file, dice| {
                draw(file, dice);
                if hard {
                    used_drives(file, setting.seed, peaks);
                }
            })
        };
        let mut quiet = TruthMachine::from_toml(&text(false)?)?;
        let text = text(true)?;
        setting.write("truth.toml", &text)?;
        let mut survey = TruthMachine::from_toml(&text)?;
        let mut test = survey.clone();
        let mut conditions = None;
        let mut gear = Gear::PERFECT;
        if hard {
            let of = |acting| Conditions::new(&ConditionSizes::SHOP, travels(&survey), acting, setting.seed);
            let (at_survey, at_test) = (of(Acting::SURVEY), of(Acting::TEST));
            survey.set_conditions(Some(at_survey));
            test.set_conditions(Some(at_test.clone()));
            quiet.set_conditions(Some(at_test.clone()));
            conditions = Some(at_test);
            gear = Gear::real(setting.seed);
        }
        Ok(Self { survey, test, quiet, conditions, gear, hard, seed: setting.seed })
    }
}

/// Errors of 3 to 5 um and 13 to 15 arcsec, squareness and parallelism of some arcsec.
fn draw(file: &mut toml::Table, dice: &mut Dice) {
    let number = toml::Value::Float;
    let sign = dice.sign();
    let mut errors = toml::Table::new();
    for axis in ["a", "x", "y", "b"] {
        for component in ["ex", "ey", "ez", "ea", "eb", "ec"] {
            let unit = if matches!(component, "ea" | "eb" | "ec") { "arcsec" } else { "um" };
            let size = if unit == "um" { dice.between(3.0, 5.0) } else { dice.between(13.0, 15.0) };
            let name = format!("{component}{axis}");
            let shape = match name.as_str() {
                "eaa" => wave(unit, sign * size, 45.0, EAA_PHASE_DEG, "deg"),
                "eyy" => along_flank(unit, -sign * size),
                "eay" => along_flank(unit, sign * size),
                _ => {
                    let (period, coordinate) = match axis {
                        "a" => (360.0, "deg"),
                        "b" => (140.0, "deg"),
                        "x" => (480.0, "mm"),
                        _ => (220.0, "mm"),
                    };
                    wave(unit, size, period, dice.between(0.0, 360.0), coordinate)
                }
            };
            errors.insert(name, toml::Value::Array(vec![shape]));
        }
    }
    file.insert("errors".into(), toml::Value::Table(errors));
    let mut squareness = toml::Table::new();
    squareness.insert("ec0y-arcsec".into(), number(5.0 * dice.normal()));
    file.insert("squareness".into(), toml::Value::Table(squareness));
    let mut location = toml::Table::new();
    for name in ["ey0a-um", "ez0a-um", "ex0b-um", "ez0b-um"] {
        location.insert(name.into(), number(dice.sign() * dice.between(3.0, 5.0)));
    }
    for name in ["eb0a-arcsec", "ec0a-arcsec", "ea0b-arcsec", "ec0b-arcsec"] {
        location.insert(name.into(), number(4.0 * dice.normal()));
    }
    file.insert("location".into(), toml::Value::Table(location));
}

fn shape(kind: &str, keys: Vec<(String, toml::Value)>) -> toml::Value {
    let mut outer = toml::Table::new();
    outer.insert(kind.to_owned(), toml::Value::Table(keys.into_iter().collect()));
    toml::Value::Table(outer)
}

fn wave(unit: &str, amplitude: f64, period: f64, phase_deg: f64, coordinate: &str) -> toml::Value {
    shape(
        "wave",
        vec![
            (format!("amplitude-{unit}"), toml::Value::Float(amplitude)),
            (format!("period-{coordinate}"), toml::Value::Float(period)),
            ("phase-deg".to_owned(), toml::Value::Float(phase_deg)),
        ],
    )
}

/// A wave on either side of the gear's axis, of opposite sign, so that it adds up with A on both flanks.
fn along_flank(unit: &str, amplitude: f64) -> toml::Value {
    let (mut at, mut values) = (Vec::new(), Vec::new());
    for i in 0..=440u32 {
        let y = 0.5 * f64::from(i);
        let s = y - Y_ZERO_MM;
        let height = -(TAU * (s.abs() - 10.0) / WAVE_MM).cos() * (1.0 - (-(s / 6.0).powi(2)).exp());
        let fade = (-((s.abs() - 36.0).max(0.0) / 15.0).powi(2)).exp();
        at.push(toml::Value::Float(y));
        values.push(toml::Value::Float(amplitude * s.signum() * height * fade));
    }
    shape(
        "samples",
        vec![
            ("at-mm".to_owned(), toml::Value::Array(at)),
            (format!("value-{unit}"), toml::Value::Array(values)),
        ],
    )
}
