//! `[axes.x]`: travel, points, sense.

use super::keys::PositionKeys;
use toml::de::DeValue;

use super::{point, remedy};
use crate::prelude::*;
use volcomp_model::spec::ReferenceBody;
use volcomp_model::{AxisSpec, Sense};

/// Largest correction of a rotary axis.
pub(super) const CORRECTION_LIMIT: &str = "correction-limit-arcsec";
const COMPONENTS: [&str; 3] = ["x", "y", "z"];
const BODIES: [(&str, ReferenceBody); 2] =
    [("carriage", ReferenceBody::Carriage), ("bed", ReferenceBody::Bed)];
const SENSES: [(&str, Sense); 2] = [("relative", Sense::Relative), ("carriage", Sense::Carriage)];

/// Reads all axes; `chain` is absent where it could not be read.
pub(super) fn read(axes: &Section<'_>, chain: Option<&Placed<Chain>>, spec: &mut ModelSpec) {
    for name in axes.names() {
        let Some(axis) = crate::axis_of_key(axes, &name) else { continue };
        let Some(section) = axes.named(&name) else { continue };
        if let Some(chain) = chain.filter(|c| c.value.index_of(axis).is_none()) {
            let e = ModelError::AxisNotInChain { axis };
            section.report_here(e.to_string(), remedy(&e, &chain.value.to_string()));
        }
        let needs_point = axis.kind() == AxisKind::Rotary && axis != AxisName::S;
        spec.axes.push(read_axis(section, axis, needs_point));
    }
    let Some(chain) = chain else { return };
    for axis in chain.value.axes().iter().filter(|a| a.kind() == AxisKind::Rotary && !a.spindle) {
        let name = axis.name;
        if !axes.names().iter().any(|n| crate::key_axis(n.value) == Some(name)) {
            axes.report(Diagnostic::at(
                chain.place.clone(),
                format!(
                    "rotary axis {name} has no [axes.{}], so it is not known where it turns",
                    name.lower()
                ),
                format!("add [axes.{}] with point-mm = [x, y, z], a point on its axis at home", name.lower()),
            ));
        }
    }
}

fn read_axis(section: Section<'_>, name: AxisName, needs_point: bool) -> AxisSpec {
    let keys = PositionKeys::of(name);
    let section = section.because(keys.unit, PositionKeys::reason(name));
    let mut axis = AxisSpec::new(name);
    axis.travel = section.interval(keys.travel).map(|t| t.value.map(keys.read));
    if let Some(sense) = section.choice("sense", &SENSES) {
        axis.sense = sense;
    }
    match name.kind() {
        AxisKind::Linear => {
            read_reference_points(&section, &mut axis);
            refuse(&section, "point-mm", "only a rotary axis turns about a point", "take it out");
            refuse(&section, CORRECTION_LIMIT, "only a rotary axis runs away at a pole", "take it out");
        }
        AxisKind::Rotary => {
            match point(&section, "point-mm") {
                Some(p) => axis.point = p.value,
                None if needs_point => {
                    let remedy = "add point-mm = [x, y, z], a point on the axis of rotation at home";
                    section.require("point-mm", remedy);
                }
                None => {}
            }
            let bound = Allowed::Within { low: 1.0, high: 2000.0 };
            if let Some(limit) = section.number(CORRECTION_LIMIT, bound) {
                axis.correction_limit = rad_from_arcsec(limit.value);
            }
            let why = "reference points belong to linear axes; a rotary axis has point-mm";
            refuse(&section, "reference-points-mm", why, "take it out");
            refuse(&section, "reference-body", why, "take it out");
        }
    }
    section.finish();
    axis
}

/// Reports a key that this kind of axis cannot have.
fn refuse(section: &Section<'_>, key: &'static str, why: &str, remedy: &str) {
    if let Some(value) = section.value(key) {
        section.report(Diagnostic::at(value.place, format!("{}: {why}", section.named_key(key)), remedy));
    }
}

fn read_reference_points(section: &Section<'_>, axis: &mut AxisSpec) {
    let points = section.section("reference-points-mm");
    for (i, component) in COMPONENTS.into_iter().enumerate() {
        if let Some(p) = point(&points, component) {
            axis.reference_points[i].point = p.value;
        }
    }
    points.finish();
    let Some(body) = section.value("reference-body") else { return };
    match body.value {
        DeValue::Table(_) => {
            let bodies = section.section("reference-body");
            for (i, component) in COMPONENTS.into_iter().enumerate() {
                if let Some(body) = bodies.choice(component, &BODIES) {
                    axis.reference_points[i].body = body;
                }
            }
            bodies.finish();
        }
        DeValue::String(text) => {
            if let Some(body) =
                section.word("reference-body", &Placed::new(text.as_ref(), body.place), &BODIES)
            {
                for reference in &mut axis.reference_points {
                    reference.body = body;
                }
            }
        }
        _ => section.wrong_shape("reference-body", &body, "\"carriage\" or \"bed\""),
    }
}
