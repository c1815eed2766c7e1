//! A survey of the simulated machine as files: one table per axis, and a model file without errors to fit into.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;
use volcomp_units::axes::{AxisKind, AxisName};

use crate::instruments::survey::{Survey, SurveyPlan};
use crate::truth::TruthMachine;

/// What a survey left on disk.
#[derive(Debug, Clone, PartialEq)]
pub struct SurveyFiles {
    /// One table of error motions per axis.
    pub tables: Vec<(AxisName, PathBuf)>,
    /// A model file with geometry, but without errors.
    pub base: PathBuf,
    /// Squarenesses for `volcomp fit --squareness`, arcsec.
    pub squareness: String,
}

impl SurveyFiles {
    /// The arguments of `volcomp fit` that turn the files into a model file.
    #[must_use]
    pub fn fit_arguments(&self, model: &Path) -> Vec<String> {
        let mut args = vec!["fit".to_owned()];
        for (axis, path) in &self.tables {
            args.extend(["--errors".to_owned(), path.display().to_string()]);
            args.extend(["--axis".to_owned(), axis.lower().to_string()]);
        }
        args.extend(["--squareness".to_owned(), self.squareness.clone()]);
        args.extend(["--into".to_owned(), self.base.display().to_string()]);
        args.extend(["--out".to_owned(), model.display().to_string()]);
        args
    }
}

/// Surveys a machine and writes what the instruments say into a folder.
///
/// # Errors
/// The plan cannot be carried out, or the folder cannot be written.
pub fn survey_to(machine: &TruthMachine, plan: &SurveyPlan, folder: &Path) -> anyhow::Result<SurveyFiles> {
    let survey = Survey::of(machine, plan)?;
    let mut tables = Vec::new();
    for axis in &survey.axes {
        let path = folder.join(format!("survey-{}.csv", axis.axis.lower()));
        write(&path, &axis.csv())?;
        tables.push((axis.axis, path));
    }
    let base = folder.join("geometry.toml");
    write(&base, &geometry(machine, &survey))?;
    let squareness = format!(
        "ec0y={:.4},eb0z={:.4},ea0z={:.4}",
        survey.ec0y_arcsec, survey.eb0z_arcsec, survey.ea0z_arcsec
    );
    Ok(SurveyFiles { tables, base, squareness })
}

pub(super) fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}

/// The drawing of the machine as a model file without errors.
fn geometry(machine: &TruthMachine, survey: &Survey) -> String {
    let list = |v: [f64; 3]| format!("[{}, {}, {}]", v[0], v[1], v[2]);
    let mut text = String::from("# Geometry of the machine as drawn; the errors are fitted into it.\n");
    let mut line = |s: String| {
        text.push_str(&s);
        text.push('\n');
    };
    line("format = \"volcomp-model/1\"".into());
    line(format!("machine = \"{}\"", machine.machine()));
    line(format!("chain = \"{}\"", machine.chain().text()));
    line("\n[frame]".into());
    line(format!("workpiece-origin-mm = {}", list(machine.workpiece_origin_mm())));
    line(format!("tool-tip-mm = {}", list(machine.tool_tip_mm())));
    for (k, axis) in survey.axes.iter().enumerate() {
        let [low, high] = machine.travel(k);
        line(format!("\n[axes.{}]", axis.axis.lower()));
        match axis.axis.kind() {
            AxisKind::Linear => {
                line(format!("travel-mm = [{low}, {high}]"));
                let [x, y, z] = axis.reference_mm.map(list);
                line(format!("reference-points-mm = {{ x = {x}, y = {y}, z = {z} }}"));
            }
            AxisKind::Rotary => {
                line(format!("travel-deg = [{low}, {high}]"));
                line(format!("point-mm = {}", list(axis.point_mm)));
            }
        }
    }
    for axis in &survey.axes {
        let letters = ['x', 'y', 'z', 'a', 'b', 'c'];
        for (k, value) in axis.location_um_arcsec.iter().enumerate().filter(|(_, v)| **v != 0.0) {
            let unit = if k < 3 { "um" } else { "arcsec" };
            let mut entry = String::new();
            let _ = write!(
                entry,
                "\n[errors.e{}0{}.constant]\nvalue-{unit} = {value}",
                letters[k],
                axis.axis.lower()
            );
            line(entry);
        }
    }
    text
}
