//! The survey: 6D interferometer with tilt test on X, Y, Z, an optical square, and the model made of them.

use std::fmt::Write as _;
use std::fs;

use anyhow::Context;
use volcomp_units::axes::AxisName;

use super::super::{Setting, scales, words};
use super::World;
use crate::drawing::drawing;
use crate::instruments::carriage::{Carriage, Mount};
use crate::instruments::sixd::{CHANNELS, SixD, SixDErrors, run_csv, sign_table, tilt_csv};
use crate::instruments::survey::{Survey, SurveyPlan};
use crate::twin::Dice;

/// Distance of the positions, mm.
const STEP_MM: f64 = 10.0;
/// Runs out and back.
const RUNS: usize = 5;
/// Tilt of the optics in the tilt test, arcsec.
const TILT_ARCSEC: f64 = 20.0;
/// Standard deviation of the optical square's own error with the hard truth, arcsec.
const SQUARE_ARCSEC: f64 = 1.0;

/// What the survey gives besides its files.
pub(super) struct Taken {
    /// Channels whose sign was found.
    pub(super) signs_right: u32,
    /// Readings of EYY in the relative sense: position, cycle, direction, um.
    pub(super) eyy: Vec<(f64, usize, i8, f64)>,
}

/// Takes the survey and writes `PREFIXmodel.toml`.
pub(super) fn take(
    setting: &Setting,
    world: &World,
    prefix: &str,
    systematic: bool,
) -> anyhow::Result<Taken> {
    let mut dice = Dice::new(world.seed, "instruments of paper 004");
    let mut taken = Taken { signs_right: 0, eyy: Vec::new() };
    let mut files = Vec::new();
    for (n, axis) in [AxisName::X, AxisName::Y, AxisName::Z].into_iter().enumerate() {
        let seed = world.seed.wrapping_mul(31).wrapping_add(n as u64);
        let signs = drawn_signs(&mut dice);
        let instrument = instrument(world, axis, signs, seed, systematic)?;
        let carriage = Carriage::new(&world.survey, axis, Mount::Carriage)?;
        let [low, high] = carriage.travel();
        let positions = ((high - low) / STEP_MM).round() as usize + 1;
        let rows = instrument.run(axis, &carriage, positions, RUNS)?;
        if axis == AxisName::Y {
            // the carriage against the relative sense, and the sign of the channel
            let sign = -signs[0];
            let reading = |r: &crate::instruments::sixd::SixDRow| {
                (r.position_mm, r.cycle, r.direction, sign * r.channels[0])
            };
            taken.eyy = rows.iter().map(reading).collect();
        }
        let letter = axis.lower();
        let name = |what: &str| format!("{prefix}{what}-{letter}");
        setting.write(&format!("{}.csv", name("sixd")), &run_csv(&rows))?;
        setting.write(&format!("{}.csv", name("tilt")), &tilt_csv(&instrument.tilts(axis, TILT_ARCSEC)))?;
        // the lengths follow from looking at the set-up; the angles are the tilt test's
        let truth = sign_table(axis, &signs);
        let lengths: Vec<&str> =
            truth.lines().filter(|l| !CHANNELS[3..].iter().any(|c| l.starts_with(c))).collect();
        setting.write(&format!("{}.toml", name("lengths")), &(lengths.join("\n") + "\n"))?;
        identify(setting, world, &instrument, axis, &name)?;
        let found = fs::read_to_string(setting.path(&format!("{}.toml", name("signs"))))?;
        taken.signs_right += right(&found, &truth, letter)?;
        files.push(setting.arg(&format!("{}.toml", name("model"))));
    }
    let square = format!("{prefix}square.toml");
    setting.write(&square, &square_model(world, systematic)?)?;
    let base = format!("{prefix}geometry.toml");
    setting.write(&base, &drawing(&world.survey))?;
    let mut args = words(&["model", "assemble"]);
    args.extend(files);
    args.extend([setting.arg(&square), "--base".to_owned(), setting.arg(&base), "--out".to_owned()]);
    args.push(setting.arg(&format!("{prefix}model.toml")));
    setting.volcomp(&args)?;
    let model = format!("{prefix}model.toml");
    let text = fs::read_to_string(setting.path(&model))?;
    setting.write(&model, &scales::add_to_model(&text, &world.survey, &world.scales)?)?;
    Ok(taken)
}

/// Random signs of the lengths; angles right-handed or, as in table 2 of the paper, with pitch and yaw reversed.
fn drawn_signs(dice: &mut Dice) -> [f64; 6] {
    let lengths = [0; 3].map(|_| dice.sign());
    let mirrored: f64 = lengths.iter().product();
    let hand = dice.sign();
    let [roll, pitch, yaw] = lengths.map(|s| s * mirrored);
    [lengths[0], lengths[1], lengths[2], roll, hand * pitch, hand * yaw]
}

fn instrument(
    world: &World,
    axis: AxisName,
    signs: [f64; 6],
    seed: u64,
    systematic: bool,
) -> anyhow::Result<SixD> {
    let k = world.survey.index_of(axis).context("the machine lacks an axis")?;
    let points = world.survey.drawing(k).context("the machine lacks an axis")?.reference_mm;
    let across = (axis.direction() + 1) % 3;
    Ok(SixD {
        abbe_mm: points[axis.direction()],
        bryan_mm: points[across],
        signs,
        skew_arcsec: [25.0, -14.0],
        noise_um: 0.3,
        noise_arcsec: 0.15,
        errors: if systematic { SixDErrors::shop(seed) } else { SixDErrors::NONE },
        seed,
    })
}

fn identify(
    setting: &Setting,
    world: &World,
    instrument: &SixD,
    axis: AxisName,
    name: &dyn Fn(&str) -> String,
) -> anyhow::Result<()> {
    let list = |v: [f64; 3]| v.map(|x| x.to_string()).join(",");
    let mut args = words(&["identify", "straightness", "--axis", &axis.lower().to_string()]);
    for (option, what, ending) in [
        ("--data", "sixd", "csv"),
        ("--tilt-test", "tilt", "csv"),
        ("--signs", "lengths", "toml"),
        ("--write-signs", "signs", "toml"),
        ("--out", "model", "toml"),
    ] {
        args.extend([option.to_owned(), setting.arg(&format!("{}.{ending}", name(what)))]);
    }
    args.extend(words(&["--chain", world.survey.chain().text(), "--machine", world.survey.machine()]));
    if axis != AxisName::Z {
        args.extend(words(&["--sense", "carriage"]));
    }
    args.push(format!("--abbe-mm={}", list(instrument.abbe_mm)));
    args.push(format!("--bryan-mm={}", list(instrument.bryan_mm)));
    setting.volcomp(&args)?;
    Ok(())
}

/// How many channels of a section agree with the truth.
fn right(found: &str, truth: &str, letter: char) -> anyhow::Result<u32> {
    let table = |text: &str| -> anyhow::Result<toml::Table> {
        let file: toml::Table = text.parse()?;
        file.get(&letter.to_string())
            .and_then(toml::Value::as_table)
            .cloned()
            .with_context(|| format!("no section [{letter}]"))
    };
    let (found, truth) = (table(found)?, table(truth)?);
    Ok(CHANNELS.iter().filter(|c| found.get(**c) == truth.get(**c)).count() as u32)
}

/// The squarenesses that an optical square measures, as a model file.
fn square_model(world: &World, systematic: bool) -> anyhow::Result<String> {
    let plan = SurveyPlan { noise_um: 0.0, noise_arcsec: 0.1, seed: world.seed, ..SurveyPlan::default() };
    let seen = Survey::of(&world.survey, &plan)?;
    let mut dice = Dice::new(world.seed, "square of paper 004");
    let mut text = format!(
        "format = \"volcomp-model/1\"\nmachine = \"{}\"\nchain = \"{}\"\n",
        world.survey.machine(),
        world.survey.chain().text()
    );
    for (name, value) in [("ec0y", seen.ec0y_arcsec), ("eb0z", seen.eb0z_arcsec), ("ea0z", seen.ea0z_arcsec)]
    {
        let error = if systematic { SQUARE_ARCSEC * dice.normal() } else { 0.0 };
        // writing into a string cannot fail
        let _ = write!(text, "\n[errors.{name}.constant]\nvalue-arcsec = {:.4}\n", value + error);
    }
    Ok(text)
}
