//! What is measured before anything is compensated: positioning, 5-DOF lasers with their calibration, body diagonals.

use anyhow::Context;
use serde_json::Value;
use volcomp_units::axes::{AxisArray, AxisName};
use volcomp_units::rad_from_arcsec;

use super::super::{Setting, words};
use super::{AXES, BOX_MM, LOW_MM, World};
use crate::instruments::carriage::{Carriage, Mount};
use crate::instruments::diagonal::{BodyDiagonals, Diagonal};
use crate::instruments::fivedof::{FiveDofLaser, rest_csv, run_csv};
use crate::truth::TruthMachine;
use crate::twin::Dice;

/// Stops of positioning and lasers.
const STOPS: usize = 21;
/// Runs of the 5-DOF lasers, as in section 3.1 of the paper.
const RUNS: usize = 5;

/// Standard deviation of a detector over 50 ms, and of the mean over a minute that the survey takes at each stop: with the
/// latter roll repeats as in the paper.
const READING_UM: f64 = 0.02;
const MINUTE_UM: f64 = 0.01;

/// Results of the survey.
pub(super) struct Survey {
    /// Scatter of the runs: straightness of X (um) and roll of X (arcsec), largest over both straightnesses, with the drift
    /// compensation, without it, with the printed factor.
    pub(super) straightness_um: [f64; 3],
    pub(super) roll_arcsec: [f64; 3],
    /// Largest error of a squareness, arcsec: angles subtracted, and not.
    pub(super) squareness_arcsec: [f64; 2],
}

/// The instrument of an axis; the same one surveys and stays on the machine.
pub(super) fn laser(machine: &TruthMachine, axis: AxisName, seed: u64) -> FiveDofLaser {
    let k = machine.index_of(axis).unwrap_or(0);
    let point = machine.drawing(k).map_or([0.0; 3], |j| j.reference_mm[(axis.direction() + 1) % 3]);
    FiveDofLaser {
        // some arcsec in the time of the runs
        drift_arcsec: 0.01,
        noise_um: READING_UM,
        ..FiveDofLaser::built_in(point, seed + axis as u64)
    }
}

/// Takes all measurements and writes `model.toml`.
pub(super) fn take(setting: &Setting, world: &World) -> anyhow::Result<Survey> {
    setting.write("base.toml", &base(&world.survey))?;
    positioning(setting, world)?;
    let mut model = "positioning.toml".to_owned();
    let mut checks = Vec::new();
    for axis in AXES {
        let next = format!("laser-{}.toml", axis.lower());
        checks.push(lasers(setting, world, axis, &model, &next)?);
        model = next;
    }
    let of = |error: &str| -> anyhow::Result<[f64; 3]> {
        let rows = checks[0]["drift_check"]["std"].as_array().context("no drift check")?;
        let row = rows.iter().find(|r| r["error"] == error).with_context(|| format!("no {error}"))?;
        Ok(["on", "off", "printed_factor"].map(|k| row[k]["mean"].as_f64().unwrap_or(f64::NAN)))
    };
    let (eyx, ezx) = (of("eyx")?, of("ezx")?);
    let straightness_um = std::array::from_fn(|i| eyx[i].max(ezx[i]));
    Ok(Survey {
        straightness_um,
        roll_arcsec: of("eax")?,
        squareness_arcsec: diagonals(setting, world, &model)?,
    })
}

/// The drawing as a model file without errors.
fn base(machine: &TruthMachine) -> String {
    let mut text = format!(
        "format = \"volcomp-model/1\"\nmachine = \"{}\"\nchain = \"{}\"\n[frame]\nworkpiece-origin-mm = {:?}\ntool-tip-mm = {:?}\n",
        machine.machine(),
        machine.chain().text(),
        machine.workpiece_origin_mm(),
        machine.tool_tip_mm()
    );
    for (k, axis) in machine.axes().into_iter().enumerate() {
        let points = machine.drawing(k).map_or([[0.0; 3]; 3], |j| j.reference_mm);
        let [x, y, z] = points;
        text += &format!(
            "[axes.{}]\ntravel-mm = {:?}\nreference-points-mm = {{ x = {x:?}, y = {y:?}, z = {z:?} }}\n",
            axis.lower(),
            machine.travel(k)
        );
    }
    text
}

/// Set-ups of the interferometer beside each scale: the error of its air and material compensation is another one each time.
const SET_UPS: usize = 3;

/// An interferometer beside each scale, set up three times, two runs in both directions each, averaged.
fn positioning(setting: &Setting, world: &World) -> anyhow::Result<()> {
    let mut dice = Dice::new(setting.seed, "interferometer of paper 002");
    let mut fit = words(&["fit"]);
    for axis in AXES {
        let carriage = Carriage::new(&world.survey, axis, Mount::Relative)?;
        let k = world.survey.index_of(axis).context("axis")?;
        let point = world.survey.drawing(k).context("axis")?.reference_mm[axis.direction()];
        let [low, high] = carriage.travel();
        let scales = [0; SET_UPS].map(|_| world.hard_um_per_m * 1e-3 * dice.normal());
        let scale = scales.iter().sum::<f64>() / SET_UPS as f64;
        let letter = axis.lower();
        let mut text = format!("position_mm,e{letter}{letter}_um\n");
        for i in 0..STOPS {
            let q = low + (high - low) * i as f64 / (STOPS - 1) as f64;
            let runs = [1, -1].repeat(2 * SET_UPS);
            let one =
                |d: &i8| 1e3 * carriage.at(q, *d).displacement(point)[axis.direction()] + 0.3 * dice.normal();
            let mean = runs.iter().map(one).sum::<f64>() / runs.len() as f64;
            text += &format!("{q},{:.4}\n", mean + scale * (q - low));
        }
        let name = format!("positioning-survey-{letter}.csv");
        setting.write(&name, &text)?;
        fit.extend(words(&["--errors", &setting.arg(&name), "--axis", &letter.to_string()]));
    }
    fit.extend(words(&["--into", &setting.arg("base.toml"), "--out", &setting.arg("positioning.toml")]));
    setting.volcomp(&fit).map(drop)
}

/// A 5-DOF laser on an axis: resting log, calibration, runs with drifting pointing.
fn lasers(setting: &Setting, world: &World, axis: AxisName, into: &str, out: &str) -> anyhow::Result<Value> {
    let laser = FiveDofLaser { noise_um: MINUTE_UM, ..laser(&world.survey, axis, setting.seed) };
    // the head is moved by hand while the carriage rests
    let calibrated = FiveDofLaser { drift_arcsec: 0.3, noise_um: READING_UM, ..laser };
    let carriage = Carriage::new(&world.survey, axis, Mount::Carriage)?;
    let (letter, folder) = (axis.lower(), |name: String| setting.arg(&name));
    let [f1, f2, f3] = laser.focal_mm;
    let [a, b] = laser.beams_mm;
    setting.write(
        "head.toml",
        &format!(
            "format = \"volcomp-fivedof/1\"\ninstrument = \"5-DOF laser\"\n\
             focal-mm = {{ psd1 = {f1}, psd2 = {f2}, psd3 = {f3} }}\nbeam-1-mm = {a:?}\nbeam-2-mm = {b:?}\n"
        ),
    )?;
    setting.write(
        &format!("rest-{letter}.csv"),
        &rest_csv(axis, &calibrated.rest(axis, &carriage, 200, 50.0)),
    )?;
    setting.write(&format!("run-{letter}.csv"), &run_csv(axis, &laser.run(axis, &carriage, STOPS, RUNS)?))?;
    let [x, y, z] = laser.point_mm;
    setting.json(&words(&[
        "identify",
        "fivedof",
        "--json",
        "--axis",
        &letter.to_string(),
        "--calibration",
        &setting.arg("head.toml"),
        "--resting",
        &folder(format!("rest-{letter}.csv")),
        "--write-calibration",
        &folder(format!("head-{letter}.toml")),
        "--data",
        &folder(format!("run-{letter}.csv")),
        "--sense",
        "carriage",
        "--point-mm",
        &format!("{x},{y},{z}"),
        "--into",
        &setting.arg(into),
        "--out",
        &setting.arg(out),
    ]))
}

/// Four body diagonals: squareness with the angles of the lasers subtracted, and what it would be without.
fn diagonals(setting: &Setting, world: &World, model: &str) -> anyhow::Result<[f64; 2]> {
    let machine = &world.survey;
    let index = |axis| machine.index_of(axis).unwrap_or(0);
    let plan = BodyDiagonals {
        xyz: AXES.map(index),
        low_mm: LOW_MM,
        high_mm: std::array::from_fn(|i| LOW_MM[i] + BOX_MM[i]),
        steps: 30,
        cycles: 2,
        drift_um: 0.01,
        noise_um: 0.5,
        seed: setting.seed,
    };
    setting.write("diagonals-survey.csv", &Diagonal::body_diagonals(machine, &plan)?)?;
    let list = |[x, y, z]: [f64; 3]| format!("{x},{y},{z}");
    let found = setting.json(&words(&[
        "identify",
        "diagonals",
        "--json",
        "--data",
        &setting.arg("diagonals-survey.csv"),
        "--low-mm",
        &list(LOW_MM),
        "--box-mm",
        &list(BOX_MM),
        "--model",
        &setting.arg(model),
        "--into",
        &setting.arg(model),
        "--out",
        &setting.arg("model.toml"),
    ]))?;
    let (truth, _) = machine.true_geometry();
    let worst = |suffix: &str| {
        [("ec0y", truth.c0y_rad), ("eb0z", truth.b0z_rad), ("ea0z", truth.a0z_rad)]
            .iter()
            .map(|(symbol, rad)| {
                let found = found[format!("{symbol}{suffix}_arcsec")].as_f64().unwrap_or(f64::NAN);
                (rad_from_arcsec(found) - rad).abs().to_degrees() * 3600.0
            })
            .fold(0.0, f64::max)
    };
    Ok([worst(""), worst("_without_subtraction")])
}

/// The middle of all travels.
pub(super) fn middle(machine: &TruthMachine) -> AxisArray {
    std::array::from_fn(|k| {
        let [low, high] = machine.travel(k);
        f64::midpoint(low, high)
    })
}
