//! Paper 001: a gear inspected on its grinder, whose four axes are identified and corrected one after the other.

mod gear;
mod inspect;
mod survey;
mod world;

use std::fs;

use anyhow::Context;
use serde_json::Value;
use volcomp_cli::report_page::{Plot, Style};

use self::gear::{BALL_MM, Gear};
use self::inspect::{Inspection, evaluate};
use self::world::World;
use super::figure::{Limit, Row, Share};
use super::{Experiment, Measured, Setting, words};
use crate::truth::TruthMachine;
use crate::truth::conditions::Acting;

const BALL: &str = "probe, error of r_c, contacts corrected";
const BALL_RAW: &str = "probe, error of r_c, contacts as read";
const REST: &str = "corrected program, largest rest across the axis of A";
const DIFFERENCE: [&str; 2] =
    ["profile slope, difference to the tester, volcompd", "lead slope, difference to the tester, volcompd"];
const WORSE: &str = "lead grade, grades lost by volcompd";
/// Names of the grades: as programmed, corrected program, volcompd, tester.
const CLASSES: [[&str; 4]; 2] = [
    [
        "profile grade, uncorrected",
        "profile grade, corrected program",
        "profile grade, volcompd",
        "profile grade, tester",
    ],
    [
        "lead grade, uncorrected",
        "lead grade, corrected program",
        "lead grade, volcompd",
        "lead grade, tester",
    ],
];
/// Class of a gear beyond the last one of the standard.
const BEYOND: f64 = 12.0;

/// The experiment.
pub struct Paper001;

impl Experiment for Paper001 {
    fn number(&self) -> &'static str {
        "001"
    }

    fn title(&self) -> &'static str {
        "gear inspected on its grinder"
    }

    fn procedure(&self) -> &'static str {
        "Gear grinder [w A' b X Y B t] with a probe on an arm of 173.7135 mm. All error motions have the sizes of the paper \
         (3 to 5 µm, 13 to 15 arcsec); EAA, EYY and EAY add up along the flanks. A, B, X and Y are identified one after the other, each \
         measured with the ones before corrected (volcomp identify grinder), by an artefact read ten times and reversed. A bar of 15 mm \
         gives the effective radius of the ball. The sample gear (z 31, m 4, 20 deg, b 30) is scanned along the base tangent: A and Y \
         roll together, X moves for the lead; four teeth, both flanks, three passes, ISO 1328-1 by volcomp evaluate gear. Then \
         with the program of volcomp correct, with volcompd over TCP, and on a tester with errors of its own. Hard \
         truth: heat, load, interaction and wear between survey and inspection, used drives, form error of artefact and gear, eccentric \
         clamping."
    }

    fn rows(&self) -> &'static [Row] {
        const ROWS: &[Row] = &[
            Row::limited(CLASSES[0][0], "", Some(8.0), Limit::AtLeast(7.0), 0),
            Row::limited(CLASSES[0][1], "", Some(4.0), Limit::AtMost(4.0), 0),
            Row::limited(CLASSES[0][2], "", Some(4.0), Limit::AtMost(4.0), 0),
            Row::reported(CLASSES[0][3], "", Some(4.0), 0),
            Row::reported(CLASSES[1][0], "", Some(4.0), 0),
            Row::limited(CLASSES[1][1], "", Some(4.0), Limit::AtMost(4.0), 0),
            Row::limited(CLASSES[1][2], "", Some(4.0), Limit::AtMost(4.0), 0),
            Row::reported(CLASSES[1][3], "", Some(4.0), 0),
            Row::limited(WORSE, "", Some(0.0), Limit::AtMost(0.0), 0),
            Row::limited(DIFFERENCE[0], "um", None, Limit::AtMost(3.2), 2),
            Row::limited(DIFFERENCE[1], "um", None, Limit::AtMost(3.5), 2),
            Row::limited(BALL, "um", None, Limit::AtMost(1.5), 2),
            Row::reported(BALL_RAW, "um", None, 2),
            Row::reported(REST, "um", None, 2),
        ];
        ROWS
    }

    fn run(&self, setting: &Setting, progress: &mut dyn FnMut(&str)) -> anyhow::Result<Measured> {
        let world = World::new(setting)?;
        let mut measured = Measured::default();
        survey::axes(setting, &world, "", false, progress)?;
        progress("probe calibration");
        let [raw, corrected] = survey::probe(setting, &world)?;
        measured.values.insert(BALL_RAW, 1e3 * (raw - BALL_MM).abs());
        measured.values.insert(BALL, 1e3 * (corrected - BALL_MM).abs());

        progress("inspection, corrected program, volcompd, tester");
        let clamped = clamped(&world);
        let program = gear::program(corrected);
        let (text, rest_um) = correct(setting, "model.toml", "corrected.nc", &program)?;
        measured.values.insert(REST, rest_um);
        let inspection = Inspection { setting, machine: &world.test, gear: &clamped, noise: true };
        let before = inspection.run("uncorrected", &program, None)?;
        let by_program = inspection.run("program", &text, None)?;
        let live = inspection.run("volcompd", &program, Some("model.toml"))?;
        let tester = evaluate(setting, "tester", &gear::tester(&world.gear, setting.seed, world.hard))?;
        for (names, key) in CLASSES.iter().zip(["profile_class", "lead_class"]) {
            for (name, report) in names.iter().zip([&before, &by_program, &live, &tester]) {
                measured.values.insert(name, report[key].as_f64().unwrap_or(BEYOND));
            }
        }
        let worse = measured.values[CLASSES[1][2]] - measured.values[CLASSES[1][0]];
        measured.values.insert(WORSE, worse);
        for (name, letter) in DIFFERENCE.iter().zip(["alpha", "beta"]) {
            let of = |side: &str| -> anyhow::Result<f64> {
                let key = format!("{side}_fh_{letter}_um");
                let value = |report: &Value| report[&key].as_f64().context("no slope");
                Ok((value(&live)? - value(&tester)?).abs())
            };
            measured.values.insert(name, of("left")?.max(of("right")?));
        }
        measured.plots = plots(setting)?;
        if setting.finds_shares() {
            progress("shares of the causes");
            measured.shares = shares(setting, &world, &clamped, &text, &program, &by_program, progress)?;
        }
        Ok(measured)
    }
}

/// The gear as it is clamped on the grinder: in the middle with the kind truth.
fn clamped(world: &World) -> Gear {
    if world.hard {
        world.gear.clone().clamped(world.seed, "clamping on the grinder")
    } else {
        world.gear.clone()
    }
}

/// The program corrected by `volcomp correct`, and the largest rest across the gear's axis, um.
fn correct(setting: &Setting, model: &str, out: &str, program: &str) -> anyhow::Result<(String, f64)> {
    setting.write("inspection.nc", program)?;
    let report = setting.json(&words(&[
        "correct",
        "--model",
        &setting.arg(model),
        "--gcode",
        &setting.arg("inspection.nc"),
        "--out",
        &setting.arg(out),
        "--json",
    ]))?;
    let rest = report["rest_y_um"].as_f64().context("no rest")?;
    Ok((fs::read_to_string(setting.path(out))?, rest))
}

/// Mean square of the total deviations of all flanks, um2.
fn left_um2(report: &Value) -> anyhow::Result<f64> {
    let keys = ["left_f_alpha_um", "right_f_alpha_um", "left_f_beta_um", "right_f_beta_um"];
    let values: Option<Vec<f64>> = keys.iter().map(|k| report[*k].as_f64()).collect();
    Ok(values.context("no total deviation")?.iter().map(|v| v * v).sum::<f64>() / 4.0)
}

/// Which share of the mean square total deviation after correction goes with each cause: the corrected program runs on the
/// machine without it; for the artefact the survey is repeated with an ideal one.
fn shares(
    setting: &Setting,
    world: &World,
    gear: &Gear,
    text: &str,
    program: &str,
    whole: &Value,
    progress: &mut dyn FnMut(&str),
) -> anyhow::Result<Vec<Share>> {
    let whole = left_um2(whole)?;
    let share = |cause: &str, machine: &TruthMachine, gear: &Gear, noise: bool, text: &str| {
        let inspection = Inspection { setting, machine, gear, noise };
        let rest = left_um2(&inspection.run("without", text, None)?)?;
        anyhow::Ok(Share { cause: cause.to_owned(), share: 1.0 - rest / whole })
    };
    let mut shares = Vec::new();
    if let Some(conditions) = &world.conditions {
        for (cause, acting) in [
            ("heat between survey and inspection", Acting { heat: false, ..Acting::TEST }),
            ("load", Acting { load: false, ..Acting::TEST }),
            ("interaction of the axes", Acting { interaction: false, ..Acting::TEST }),
            ("a month of wear", Acting { wear: false, ..Acting::TEST }),
        ] {
            let mut machine = world.test.clone();
            machine.set_conditions(Some(conditions.clone().with(acting)));
            shares.push(share(cause, &machine, gear, true, text)?);
        }
    }
    shares.push(share("friction peaks and repeatability of the drives", &world.quiet, gear, true, text)?);
    shares.push(share("eccentric clamping", &world.test, &world.gear, true, text)?);
    let round = Gear::PERFECT.clamped(world.seed, "clamping on the grinder");
    shares.push(share("flanks of the gear itself", &world.test, &round, true, text)?);
    shares.push(share("noise of the probe", &world.test, gear, false, text)?);
    survey::axes(setting, world, "ideal-", true, progress)?;
    let (ideal, _) = correct(setting, "ideal-model.toml", "ideal.nc", program)?;
    shares.push(share("artefact of the survey", &world.test, gear, true, &ideal)?);
    Ok(shares)
}

/// Figure 9 and 10 of the paper: the diagrams of one tooth before and after, and on the tester.
fn plots(setting: &Setting) -> anyhow::Result<Vec<Plot>> {
    let mut plots = Vec::new();
    for (direction, label) in [("profile", "roll length, mm"), ("lead", "face width, mm")] {
        for flank in ["left", "right"] {
            let mut plot = Plot::new(
                format!("Figures 9, 10: {direction}, {flank} flank, mean of the teeth"),
                label,
                "deviation, µm",
            );
            for (name, file) in [
                ("uncorrected", "uncorrected"),
                ("corrected program", "program"),
                ("volcompd", "volcompd"),
                ("tester", "tester"),
            ] {
                let text = fs::read_to_string(setting.path(&format!("{file}.csv")))?;
                plot = plot.with(Style::Line, name, mean_trace(&text, direction, flank));
            }
            plots.push(plot);
        }
    }
    Ok(plots)
}

/// Mean over teeth and passes at every position, about its own mean.
fn mean_trace(text: &str, direction: &str, flank: &str) -> Vec<(f64, f64)> {
    let mut cells: std::collections::BTreeMap<i64, (f64, f64, f64)> = std::collections::BTreeMap::new();
    for line in text.lines().skip(1) {
        let fields: Vec<&str> = line.split(',').collect();
        let [d, f, _, _, at, value] = fields[..] else { continue };
        if let (true, true, Ok(at), Ok(value)) =
            (d == direction, f == flank, at.parse::<f64>(), value.parse::<f64>())
        {
            let cell = cells.entry((at * 1e4).round() as i64).or_insert((at, 0.0, 0.0));
            cell.1 += value;
            cell.2 += 1.0;
        }
    }
    let points: Vec<(f64, f64)> = cells.into_values().map(|(at, sum, n)| (at, sum / n)).collect();
    let mean = points.iter().map(|p| p.1).sum::<f64>() / points.len().max(1) as f64;
    points.into_iter().map(|(at, v)| (at, v - mean)).collect()
}
