//! EYY by Fourier series, polynomial and volcomp's own choice, against the readings and the true curve.

use std::fmt::Write as _;
use std::fs;

use anyhow::Context;
use volcomp_cli::report_page::{Plot, Style};
use volcomp_units::axes::AxisName;

use super::super::machine::travels;
use super::super::{Setting, words};
use crate::truth::TruthMachine;

/// How the curves compare.
pub(super) struct Curves {
    /// Reduction of the largest residual, Fourier against polynomial, at the mean readings.
    pub(super) fourier_percent: f64,
    /// The same of volcomp's choice, on the true curve.
    pub(super) choice_percent: f64,
    /// Largest error of volcomp's choice on the true curve, um.
    pub(super) choice_um: f64,
    /// Figure 5 of the paper.
    pub(super) plot: Plot,
}

/// Fits and compares.
pub(super) fn compare(
    setting: &Setting,
    machine: &TruthMachine,
    readings: &[(f64, usize, i8, f64)],
) -> anyhow::Result<Curves> {
    let mut means: Vec<(f64, f64, f64)> = Vec::new();
    let mut all = String::from("position_mm,cycle,direction,eyy_um\n");
    for (q, cycle, direction, value) in readings {
        // writing into a string cannot fail
        let _ = writeln!(all, "{q},{cycle},{direction},{value:.4}");
        match means.iter_mut().find(|m| (m.0 - q).abs() < 1e-6) {
            Some(mean) => {
                mean.1 += value;
                mean.2 += 1.0;
            }
            None => means.push((*q, *value, 1.0)),
        }
    }
    means.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut text = String::from("position_mm,eyy_um\n");
    let means: Vec<(f64, f64)> = means.into_iter().map(|(q, sum, n)| (q, sum / n)).collect();
    for (q, value) in &means {
        let _ = writeln!(text, "{q},{value:.4}");
    }
    setting.write("eyy-all.csv", &all)?;
    setting.write("eyy-mean.csv", &text)?;
    let fourier = fit(
        setting,
        machine,
        "fourier",
        "eyy-mean.csv",
        &["--basis", "fourier", "--order", "3", "--period-mm", "auto", "--linear", "no"],
    )?;
    let polynomial =
        fit(setting, machine, "polynomial", "eyy-mean.csv", &["--basis", "chebyshev", "--order", "7"])?;
    let choice = fit(setting, machine, "choice", "eyy-all.csv", &[])?;
    let truth = true_curve(machine)?;
    let (of_polynomial, of_choice) = (error_on(&truth, &polynomial.curve), error_on(&truth, &choice.curve));
    let about = |curve: &[(f64, f64)]| {
        let mean = curve.iter().map(|p| p.1).sum::<f64>() / curve.len().max(1) as f64;
        curve.iter().map(|(q, v)| (*q, v - mean)).collect::<Vec<_>>()
    };
    let plot = Plot::new("Figure 5: EYY and its curves", "position of Y, mm", "EYY, µm")
        .with(Style::Line, "Fourier, order 3", about(&fourier.curve))
        .with(Style::Line, "polynomial, order 7", about(&polynomial.curve))
        .with(Style::Line, "volcomp's choice", about(&choice.curve))
        .with(Style::Dots, "mean readings", about(&means));
    Ok(Curves {
        fourier_percent: 100.0 * (1.0 - fourier.e_max_um / polynomial.e_max_um),
        choice_percent: 100.0 * (1.0 - of_choice / of_polynomial),
        choice_um: of_choice,
        plot,
    })
}

struct Fit {
    e_max_um: f64,
    curve: Vec<(f64, f64)>,
}

fn fit(
    setting: &Setting,
    machine: &TruthMachine,
    name: &str,
    data: &str,
    how: &[&str],
) -> anyhow::Result<Fit> {
    let (json, model) = (format!("eyy-{name}.json"), format!("eyy-{name}.toml"));
    let mut args = words(&["fit", "--axis", "y", "--errors", &setting.arg(data)]);
    args.extend(words(how));
    args.extend(words(&["--chain", machine.chain().text(), "--machine", machine.machine()]));
    args.extend(words(&["--json", &setting.arg(&json), "--out", &setting.arg(&model)]));
    setting.volcomp(&args)?;
    let report: serde_json::Value = serde_json::from_str(&fs::read_to_string(setting.path(&json))?)?;
    let e_max_um = report["eyy"]["emax_um"].as_f64().context("the fit reports no e_max")?;
    // the curve at every millimetre, as the daemon would use it
    let [low, high] = travels(machine)[1];
    let mut points = String::from("x_mm,y_mm,z_mm\n");
    let count = (high - low).round() as u32;
    for i in 0..=count {
        let _ = writeln!(points, "0,{},0", low + (high - low) * f64::from(i) / f64::from(count));
    }
    setting.write("eyy-grid.csv", &points)?;
    let out = format!("eyy-{name}-curve.csv");
    setting.volcomp(&words(&[
        "predict",
        "--model",
        &setting.arg(&model),
        "--points",
        &setting.arg("eyy-grid.csv"),
        "--out",
        &setting.arg(&out),
    ]))?;
    let mut reader = csv::Reader::from_path(setting.path(&out))?;
    let header = reader.headers()?.clone();
    let column =
        |name: &str| header.iter().position(|h| h == name).with_context(|| format!("no column {name}"));
    let (y, dy) = (column("y_mm")?, column("dy_um")?);
    let mut curve = Vec::new();
    for record in reader.records() {
        let record = record?;
        let number = |i: usize| record.get(i).and_then(|t| t.parse::<f64>().ok()).context("not a number");
        curve.push((number(y)?, number(dy)?));
    }
    Ok(Fit { e_max_um, curve })
}

/// The true EYY at every millimetre, mean of both directions, um.
fn true_curve(machine: &TruthMachine) -> anyhow::Result<Vec<(f64, f64)>> {
    let k = machine.index_of(AxisName::Y).context("the machine has no Y")?;
    let [low, high] = machine.travel(k);
    let count = (high - low).round() as u32;
    let at = |i: u32| {
        let q = low + (high - low) * f64::from(i) / f64::from(count);
        let both = [1, -1].map(|d| machine.true_motion(k, q, d)[1]);
        (q, f64::midpoint(both[0], both[1]) * 1e3)
    };
    Ok((0..=count).map(at).collect())
}

/// Largest difference of two curves at the same places, about its middle: the zero of a curve is free.
fn error_on(truth: &[(f64, f64)], curve: &[(f64, f64)]) -> f64 {
    let (low, high) = truth
        .iter()
        .zip(curve)
        .map(|(t, c)| c.1 - t.1)
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), d| (l.min(d), h.max(d)));
    (high - low) / 2.0
}
