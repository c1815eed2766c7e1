//! Probe calibration and the four axes, one after the other.

use std::fmt::Write as _;
use std::fs;

use anyhow::{Context, anyhow};

use super::super::{Setting, words};
use super::World;
use super::gear::BALL_MM;
use crate::cli::measure::grinder::measure_plan;
use crate::drawing::drawing;
use crate::instruments::grinder::{Artefact, ArtefactPose};
use crate::instruments::probe::{Arm, GaugeBar};
use crate::twin::Dice;

/// Radius of the bar of the paper.
const BAR_MM: f64 = 15.0;
/// Axes in the order of the steps, with their positions: close enough that lines between them do not limit.
const STEPS: [(&str, usize); 4] = [("a", 91), ("b", 9), ("x", 13), ("y", 45)];
/// Noise of a single reading of the artefact, repetitions, and its form error per tip (hard truth), um.
const NOISE_UM: f64 = 0.5;
const REPEATS: u32 = 10;
const FORM_UM: f64 = 0.3;

/// Identifies the four axes into `PREFIXmodel.toml`; with an ideal artefact for the shares of the causes.
pub(super) fn axes(
    setting: &Setting,
    world: &World,
    prefix: &str,
    ideal: bool,
    progress: &mut dyn FnMut(&str),
) -> anyhow::Result<()> {
    let base = setting.arg("drawing.toml");
    setting.write("drawing.toml", &drawing(&world.survey))?;
    let mut known: Vec<String> = Vec::new();
    for (n, (axis, positions)) in STEPS.into_iter().enumerate() {
        progress(&format!("axis {}", axis.to_uppercase()));
        let (poses, readings) = (format!("{prefix}poses-{axis}.csv"), format!("{prefix}{axis}.csv"));
        let mut args = words(&["identify", "grinder", "--basis", "auto", "--drawing", &base]);
        args.extend(known.iter().cloned());
        args.extend(words(&["--positions", &positions.to_string(), "--next"]));
        args.push(format!("{axis}={}", setting.arg(&poses)));
        setting.volcomp(&args)?;
        measure_plan(&world.survey, &setting.path(&poses), &setting.path(&readings), |plan| {
            measure(world, plan, n as u64, ideal)
        })
        .map_err(|e| anyhow!("{e:?}"))?;
        known.extend(["--step".to_owned(), format!("{axis}={}", setting.arg(&readings))]);
    }
    let mut args = words(&["identify", "grinder", "--basis", "auto", "--drawing", &base]);
    args.extend(known);
    args.extend(words(&["--out", &setting.arg(&format!("{prefix}model.toml"))]));
    setting.volcomp(&args)?;
    Ok(())
}

/// The mean of the repetitions, half of them with the artefact reversed: its form error enters with either sign.
fn measure(world: &World, plan: &[ArtefactPose], step: u64, ideal: bool) -> Vec<[f64; 3]> {
    let seed = world.seed.wrapping_mul(4).wrapping_add(step);
    let mut dice = Dice::new(seed, "artefact of paper 001");
    let form: Vec<[f64; 3]> = (0..4).map(|_| [0; 3].map(|_| FORM_UM * dice.normal())).collect();
    let noise_um = if ideal { 0.0 } else { NOISE_UM / f64::from(REPEATS).sqrt() };
    let artefact = Artefact { noise_um, lies_um: 10.0, lies_arcsec: 10.0, seed };
    let mut seen = artefact.measure(&world.survey, plan);
    if world.hard && !ideal {
        // reversal takes away what is fixed to the artefact; a fifth stays
        for (i, reading) in seen.iter_mut().enumerate() {
            (0..3).for_each(|k| reading[k] += 0.2 * form[i % 4][k]);
        }
    }
    seen
}

/// Touches the bar and returns the effective radius of the ball (mm) as it is read, and corrected by the model.
pub(super) fn probe(setting: &Setting, world: &World) -> anyhow::Result<[f64; 2]> {
    let bar = GaugeBar {
        bar_radius_mm: BAR_MM,
        ball_radius_mm: BALL_MM,
        spacing_mm: 0.2,
        both_sides: true,
        noise_um: 0.5,
        seed: world.seed,
    };
    let arm = Arm::of(&world.survey)?;
    let touches = bar.touches(&world.survey)?;
    let mut text = "x_mm,y_mm,a_deg,b_deg\n".to_owned();
    for t in &touches {
        // writing into a string cannot fail
        let _ = writeln!(text, "0,{:.7},0,{:.10}", t.y_mm, t.b_deg);
    }
    setting.write("contacts.csv", &text)?;
    let out = setting.arg("contacts-predicted.csv");
    setting.volcomp(&words(&[
        "predict",
        "--model",
        &setting.arg("model.toml"),
        "--points",
        &setting.arg("contacts.csv"),
        "--out",
        &out,
    ]))?;
    let predicted = fs::read_to_string(&out)?;
    let mut lines = predicted.lines();
    let head: Vec<&str> = lines.next().context("no header")?.split(',').collect();
    let column = |name: &str| head.iter().position(|h| *h == name).context("a column is missing");
    let (dy, dz) = (column("dy_um")?, column("dz_um")?);
    let mut tables = ["y_mm,z_mm\n".to_owned(), "y_mm,z_mm\n".to_owned()];
    for (line, t) in lines.zip(&touches) {
        let fields: Vec<f64> = line.split(',').map(|f| f.parse().unwrap_or(0.0)).collect();
        let z = arm.length_mm * (t.b_deg - arm.zero_deg).to_radians().sin();
        let _ = writeln!(tables[0], "{:.7},{z:.7}", t.y_mm);
        let _ = writeln!(tables[1], "{:.7},{:.7}", t.y_mm + 1e-3 * fields[dy], z + 1e-3 * fields[dz]);
    }
    let mut radii = [0.0; 2];
    for ((name, table), radius) in ["bar", "bar-corrected"].into_iter().zip(&tables).zip(&mut radii) {
        let file = format!("{name}.csv");
        setting.write(&file, table)?;
        let report = setting.json(&words(&[
            "identify",
            "probe",
            "--data",
            &setting.arg(&file),
            "--bar-radius-mm",
            &BAR_MM.to_string(),
            "--json",
        ]))?;
        *radius = report["r_c_geometric"].as_f64().context("no radius")?;
    }
    Ok(radii)
}
