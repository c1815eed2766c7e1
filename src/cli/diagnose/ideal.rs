//! The machine of a diagnosis without a model: ideal, with the axes of the data.
//!
//! It is written beside the addition, so that `volcomp model extend` has a model that the addition suits: without errors of its
//! own, the whole deviation is what the addition holds.

use crate::prelude::*;
use volcomp_diagnose::session::Session;
use volcomp_effects::machine_state::Machine;
use volcomp_effects::prediction::machine_of;

/// Machine id of the ideal model.
const MACHINE: &str = "ideal";

/// A rotary axis that was tested alone: it carries the workpiece, and the tool tip stands at a radius of its axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rotary {
    pub(super) axis: AxisName,
    pub(super) radius_mm: f64,
}

/// The ideal machine on which one rotary axis was tested.
pub(super) fn rotary_machine(rotary: Rotary) -> Result<(Machine, Model)> {
    let linear = [AxisName::X, AxisName::Y, AxisName::Z].map(|a| (a, None));
    let spec = spec(&linear, Some(rotary))?;
    let model = Model::new(&spec).map_err(internal)?;
    Ok((machine_of(&spec, &model), model))
}

/// The ideal machine of a session as a model file; `None` where none of its axes has a known place in a chain.
pub(super) fn model_file(session: &Session, rotary: Option<Rotary>) -> Result<Option<String>> {
    let axes: Vec<(AxisName, Option<[f64; 2]>)> =
        session.axes.iter().filter(|a| a.is_linear()).map(|a| (a.name(), session.range(*a))).collect();
    if axes.is_empty() && rotary.is_none() {
        return Ok(None);
    }
    let spec = spec(&axes, rotary)?;
    Model::new(&spec).map_err(internal)?;
    let comments = [
        "An ideal machine with the axes of the data, written by volcomp diagnose without --model: it holds no errors.".to_owned(),
        "All axes carry the tool unless the test says otherwise; angular errors depend on the chain: check it.".to_owned(),
    ];
    Ok(Some(config::model::write_file(&ModelFile::new(spec), &comments)))
}

fn internal(e: impl core::fmt::Display) -> Failure {
    failure!(EX_SOFTWARE, "ideal model: {e}")
}

fn spec(axes: &[(AxisName, Option<[f64; 2]>)], rotary: Option<Rotary>) -> Result<ModelSpec> {
    let table = rotary.map_or_else(String::new, |r| format!("{}' ", r.axis));
    let linear: Vec<String> = axes.iter().map(|(a, _)| format!("{a} ")).collect();
    let chain = Chain::parse(&format!("[w {table}b {}t]", linear.concat())).map_err(internal)?;
    let mut spec = ModelSpec::new(MACHINE, chain);
    spec.axes.extend(axes.iter().map(|(name, travel)| AxisSpec { travel: *travel, ..AxisSpec::new(*name) }));
    if let Some(r) = rotary {
        spec.axes.push(AxisSpec::new(r.axis));
        spec.tool_tip[(r.axis.direction() + 1) % 3] = r.radius_mm;
    }
    Ok(spec)
}
