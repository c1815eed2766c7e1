//! Paper 004: 6D interferometer, curves of waves, and a ballbar circle predicted and compensated.

mod circle;
mod curves;
mod survey;

use anyhow::Context;
use volcomp_cli::report_page::{Plot, Style};

use self::circle::{CENTRE_MM, Circle, RADIUS_MM};
use super::figure::{Limit, Row, Share, Truth};
use super::machine::{travels, used_drives, varied_text};
use super::scales::{ThermometerErrors, Thermometers};
use super::{Experiment, Measured, Setting, words};
use crate::truth::conditions::{Acting, ConditionSizes, Conditions};
use crate::truth::{TruthMachine, VMC_850};
use crate::twin::Dice;

const SIGNS: &str = "signs of channels found by the tilt test, of 18";
const FOURIER: &str = "EYY, e_max at the readings, Fourier order 3 + line against polynomial order 8";
const CHOICE: &str = "EYY, e_max on the true curve, volcomp's choice against polynomial order 7";
const CHOICE_UM: &str = "EYY, e_max on the true curve, volcomp's choice";
const RESIDUAL: &str = "circle, predicted against measured, largest residual";
const IDEAL: &str = "circle, reduction by an ideal correction";
const BEFORE: &str = "circle, roundness G before";
const AFTER: &str = "circle, roundness G compensated";
const REDUCTION: &str = "circle, reduction measured";

/// Thermometers on the scales.
const THERMOMETERS: ThermometerErrors = ThermometerErrors { along: 1, calibration_k: 0.1, repeats_k: 0.04 };

/// The experiment.
pub struct Paper004;

impl Experiment for Paper004 {
    fn number(&self) -> &'static str {
        "004"
    }

    fn title(&self) -> &'static str {
        "6D interferometer, Fourier and polynomial, ballbar circle"
    }

    fn procedure(&self) -> &'static str {
        "Machining centre [w X' Y' b Z t], travels 500, 400, 300 mm. A 6D interferometer of unknown handedness measures each \
         axis every 10 mm in five runs; a tilt test gives signs and parity (volcomp identify straightness --tilt-test). An \
         optical square gives the squarenesses; volcomp model assemble makes the model. EYY is a wave of changing length and \
         amplitude, which no Fourier series of a period contains. A ballbar of 100 mm at (343.507, -285.090, -286.430) \
         measures the circle at F200 in both directions; volcomp predict --circle compares it with the model; volcompd \
         corrects over TCP and the ballbar measures again. Thermometers on the three scales (right to 0.1 K, repeating to 0.04 K) tell volcompd, and the \
         prediction, how warm they are. Hard truth: wavelength, gain, beam bending and drift of the \
         interferometer, 1 arcsec of the square, length of the ballbar; lost motion and friction peaks of used drives; \
         interaction of the axes; heat, a workpiece on the table and a month of wear between survey and circle."
    }

    fn rows(&self) -> &'static [Row] {
        const ROWS: &[Row] = &[
            Row::limited(SIGNS, "", None, Limit::AtLeast(18.0), 0),
            Row::reported(FOURIER, "%", Some(15.0), 1),
            Row::limited(CHOICE, "%", Some(15.0), Limit::AtLeast(15.0), 1),
            Row::limited(CHOICE_UM, "um", Some(1.69), Limit::AtMost(1.69), 2),
            Row::limited(RESIDUAL, "um", Some(4.5), Limit::AtMost(4.5), 2),
            Row::limited(IDEAL, "%", Some(64.3), Limit::AtLeast(64.3), 1),
            Row::reported(BEFORE, "um", Some(19.9), 1),
            Row::limited(AFTER, "um", Some(8.2), Limit::AtMost(8.2), 2),
            Row::limited(REDUCTION, "%", Some(58.8), Limit::AtLeast(58.8), 1),
        ];
        ROWS
    }

    fn run(&self, setting: &Setting, progress: &mut dyn FnMut(&str)) -> anyhow::Result<Measured> {
        let world = World::new(setting)?;
        let mut measured = Measured::default();
        progress("6D interferometer on three axes, tilt test, square");
        let survey = survey::take(setting, &world, "", world.errors_of_instruments)?;
        measured.values.insert(SIGNS, f64::from(survey.signs_right));
        progress("curves of EYY");
        let curves = curves::compare(setting, &world.survey, &survey.eyy)?;
        measured.values.insert(FOURIER, curves.fourier_percent);
        measured.values.insert(CHOICE, curves.choice_percent);
        measured.values.insert(CHOICE_UM, curves.choice_um);
        measured.plots.push(curves.plot);

        progress("circle without compensation");
        let mut circle = Circle::open(setting, &world)?;
        let before = circle.measure()?;
        setting.write("before.csv", &before.csv())?;
        let predicted = predict(setting, &world)?;
        for (name, key) in [(RESIDUAL, "residual_max_um"), (IDEAL, "ideal_reduction_percent")] {
            measured.values.insert(name, predicted[key].as_f64().context("no prediction")?);
        }
        progress("circle with volcompd");
        let after = circle.compensated(setting, "model.toml")?;
        setting.write("after.csv", &after.csv())?;
        let report = setting.json(&words(&[
            "evaluate",
            "iso230-4",
            "--json",
            "--radius-mm",
            &RADIUS_MM.to_string(),
            "--data",
            &setting.arg("after.csv"),
            "--before",
            &setting.arg("before.csv"),
            "--html",
            &setting.arg("circle.html"),
        ]))?;
        let g = |value: &serde_json::Value| value["g_bi_um"].as_f64().context("no circular deviation");
        let (g_before, g_after) = (g(&report["before"])?, g(&report)?);
        measured.values.insert(BEFORE, g_before);
        measured.values.insert(AFTER, g_after);
        measured.values.insert(REDUCTION, 100.0 * (1.0 - g_after / g_before));
        measured.plots.extend(circle::plots(&before, &after));
        if setting.finds_shares() {
            progress("shares of the causes");
            measured.shares = shares(setting, &world, &circle)?;
        }
        Ok(measured)
    }
}

/// The machine at survey and test, and its instruments.
#[derive(Clone)]
struct World {
    survey: TruthMachine,
    test: TruthMachine,
    /// The machine of the test without friction peaks and wander.
    quiet: TruthMachine,
    /// Conditions of the test; none with the kind truth.
    conditions: Option<Conditions>,
    scales: Thermometers,
    seed: u64,
    errors_of_instruments: bool,
}

impl World {
    fn new(setting: &Setting) -> anyhow::Result<Self> {
        let hard = setting.truth == Truth::Hard;
        let text = |peaks: bool| {
            varied_text(VMC_850, setting.seed, |file, dice| {
                change(file, dice);
                if hard {
                    used_drives(file, setting.seed, peaks);
                }
            })
        };
        let mut quiet = TruthMachine::from_toml(&text(false)?)?;
        let text = text(true)?;
        let mut survey = TruthMachine::from_toml(&text)?;
        let mut test = survey.clone();
        setting.write("truth.toml", &text)?;
        let mut conditions = None;
        let mut scales = Thermometers::IDEAL;
        if hard {
            let of = |acting| Conditions::new(&ConditionSizes::SHOP, travels(&survey), acting, setting.seed);
            let (at_survey, at_test) = (of(Acting::SURVEY), of(Acting::TEST));
            survey.set_conditions(Some(at_survey));
            test.set_conditions(Some(at_test.clone()));
            quiet.set_conditions(Some(at_test.clone()));
            let mut dice = Dice::new(setting.seed, "thermometers of paper 004");
            scales = Thermometers::new(&at_test, travels(&survey), THERMOMETERS, &mut dice);
            conditions = Some(at_test);
        }
        Ok(Self { survey, test, quiet, conditions, scales, seed: setting.seed, errors_of_instruments: hard })
    }
}

impl World {
    /// The machine of the test without heat, its thermometers as at the survey.
    fn without_heat(&self, conditions: &Conditions) -> Self {
        let acting = Acting { heat: false, ..Acting::TEST };
        let mut test = self.test.clone();
        test.set_conditions(Some(conditions.clone().with(acting)));
        Self { test, scales: self.scales.cold(), ..self.clone() }
    }
}

/// Travels and points of the paper's machine, its squareness of about 40 arcsec, and EXX and EYY with waves.
fn change(file: &mut toml::Table, dice: &mut Dice) {
    let number = toml::Value::Float;
    let list = |v: &[f64]| toml::Value::Array(v.iter().map(|v| number(*v)).collect());
    if let Some(frame) = file.get_mut("frame").and_then(toml::Value::as_table_mut) {
        frame.insert("workpiece-origin-mm".into(), list(&[0.0, 0.0, -420.0]));
    }
    let axes: [([f64; 2], [[f64; 3]; 3]); 3] = [
        ([0.0, 500.0], [[250.0, -200.0, -540.0], [250.0, -200.0, -420.0], [250.0, -200.0, -420.0]]),
        ([-400.0, 0.0], [[0.0, -200.0, -540.0], [0.0, -200.0, -600.0], [0.0, -200.0, -540.0]]),
        ([-300.0, 0.0], [[0.0, 0.0, -50.0], [0.0, 0.0, -50.0], [0.0, 320.0, 0.0]]),
    ];
    let entries = file.get_mut("axes").and_then(toml::Value::as_array_mut).into_iter().flatten();
    for (entry, (travel, points)) in entries.zip(axes) {
        let Some(entry) = entry.as_table_mut() else { continue };
        entry.insert("travel-mm".into(), list(&travel));
        let mut table = toml::Table::new();
        for (name, point) in ["x", "y", "z"].into_iter().zip(points) {
            table.insert(name.into(), list(&point));
        }
        entry.insert("reference-points-mm".into(), toml::Value::Table(table));
    }
    if let Some(squareness) = file.get_mut("squareness").and_then(toml::Value::as_table_mut) {
        squareness.insert("ec0y-arcsec".into(), number(dice.sign() * dice.between(20.0, 40.0)));
    }
    if let Some(errors) = file.get_mut("errors").and_then(toml::Value::as_table_mut) {
        for (name, low, high) in [("exx", 0.0, 500.0), ("eyy", -400.0, 0.0)] {
            let wave = wave(dice, low, high);
            let mut shapes = vec![shape("samples", [("at-mm", list(&wave.0)), ("value-um", list(&wave.1))])];
            let rise = number(dice.sign() * dice.between(4.0, 12.0));
            shapes.push(shape("slope", [("rise-um", rise), ("", number(0.0))]));
            let pitch = [("pitch-mm", number(10.0)), ("first-um", number(dice.between(0.1, 0.25)))];
            shapes.push(shape("pitch", pitch));
            errors.insert(name.into(), toml::Value::Array(shapes));
        }
    }
}

/// `{ kind = { keys } }`; keys without a name are left out.
fn shape(kind: &str, keys: [(&str, toml::Value); 2]) -> toml::Value {
    let inner: toml::Table =
        keys.into_iter().filter(|(k, _)| !k.is_empty()).map(|(k, v)| (k.to_owned(), v)).collect();
    let mut outer = toml::Table::new();
    outer.insert(kind.to_owned(), toml::Value::Table(inner));
    toml::Value::Table(outer)
}

/// A wave of 2 to 2.5 periods over a travel, whose length and amplitude change on the way: coordinates, um.
fn wave(dice: &mut Dice, low: f64, high: f64) -> (Vec<f64>, Vec<f64>) {
    const COUNT: u32 = 161;
    let turn = std::f64::consts::TAU;
    let waves = dice.between(2.0, 2.5);
    let chirp = dice.sign() * dice.between(0.2, 0.5);
    let (growth, phase) = (dice.sign() * dice.between(0.2, 0.5), dice.between(0.0, turn));
    let amplitude = dice.between(2.8, 4.0);
    (0..COUNT)
        .map(|i| {
            let s = f64::from(i) / f64::from(COUNT - 1);
            let at = turn * waves * (s + chirp * (s * s - s)) + phase;
            (low + (high - low) * s, amplitude * (1.0 + growth * (2.0 * s - 1.0)) * at.sin())
        })
        .unzip()
}

/// The measured circle against the model's.
fn predict(setting: &Setting, world: &World) -> anyhow::Result<serde_json::Value> {
    let centre = CENTRE_MM.map(|v| v.to_string()).join(",");
    let warm: Vec<String> = (1..)
        .zip(world.scales.test_degc)
        .map(|(n, degc)| format!("--reading=scales.{n}={degc:.3}"))
        .collect();
    let mut arguments = words(&[
        "predict",
        "--model",
        &setting.arg("model.toml"),
        "--circle",
        &setting.arg("before.csv"),
        &format!("--centre-mm={centre}"),
        "--radius-mm",
        &RADIUS_MM.to_string(),
        "--json",
        "--html",
        &setting.arg("prediction.html"),
    ]);
    arguments.extend(warm);
    setting.json(&arguments)
}

/// Which share of the form error of the compensated circle each cause explains: the recorded set points are replayed on
/// the machine without it; for heat the circle is run again without, for the instruments the survey is repeated with ideal
/// ones and the circle is run again.
fn shares(setting: &Setting, world: &World, circle: &Circle) -> anyhow::Result<Vec<Share>> {
    let whole = circle.replayed(&world.test)?;
    let share = |rest: f64| 1.0 - rest / whole;
    let mut shares = Vec::new();
    if let Some(conditions) = &world.conditions {
        // heat moves the thermometers too: the circle is run again without it
        let cold = world.without_heat(conditions);
        let mut again = Circle::open(setting, &cold)?;
        again.compensated(setting, "model.toml")?;
        let heat = share(again.replayed(&cold.test)?);
        shares.push(Share { cause: "heat between survey and circle".to_owned(), share: heat });
        let without: [(&str, Acting); 3] = [
            ("workpiece on the table", Acting { load: false, ..Acting::TEST }),
            ("interaction of the axes", Acting { interaction: false, ..Acting::TEST }),
            ("a month of wear", Acting { wear: false, ..Acting::TEST }),
        ];
        for (cause, acting) in without {
            let mut machine = world.test.clone();
            machine.set_conditions(Some(conditions.clone().with(acting)));
            shares.push(Share { cause: cause.to_owned(), share: share(circle.replayed(&machine)?) });
        }
    }
    let drives = share(circle.replayed(&world.quiet)?);
    shares.push(Share { cause: "friction peaks and repeatability of the drives".to_owned(), share: drives });
    survey::take(setting, world, "ideal-", false)?;
    let mut again = Circle::open(setting, world)?;
    again.compensated(setting, "ideal-model.toml")?;
    let instruments = share(again.replayed(&world.test)?);
    shares.push(Share { cause: "interferometer and square".to_owned(), share: instruments });
    Ok(shares)
}

/// A plot of angle and deviation.
fn polar_unrolled(title: &str, series: [(&str, Vec<(f64, f64)>); 2]) -> Plot {
    series
        .into_iter()
        .fold(Plot::new(title, "angle, deg", "radial deviation, µm"), |plot, (label, points)| {
            plot.with(Style::Line, label, points)
        })
}
