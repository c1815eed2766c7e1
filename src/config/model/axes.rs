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
            axes.report_at(
                chain.place.clone(),
                format!(
                    "rotary axis {name} has no [axes.{}], so it is not known where it turns",
                    name.lower()
                ),
                format!("add [axes.{}] with point-mm = [x, y, z], a point on its axis at home", name.lower()),
            );
        }
    }
}

fn read_axis(section: Section<'_>, name: AxisName, needs_point: bool) -> AxisSpec {
    let keys = PositionKeys::of(name);
    let section = section.because(keys.unit, PositionKeys::reason(name));
    let mut axis = AxisSpec::new(name);
    axis.travel = section.interval(keys.travel).map(|t| t.value.map(keys.read));
    axis.sense = section.choice("sense", &SENSES).unwrap_or(axis.sense);
    match name.kind() {
        AxisKind::Linear => {
            read_reference_points(&section, &mut axis);
            forbid(&section, "point-mm", "only a rotary axis turns about a point");
            forbid(&section, CORRECTION_LIMIT, "only a rotary axis runs away at a pole");
        }
        AxisKind::Rotary => {
            axis.point = point(&section, "point-mm").unwrap_or(axis.point);
            if needs_point {
                section
                    .require("point-mm", "add point-mm = [x, y, z], a point on the axis of rotation at home");
            }
            if let Some(limit) = section.number(CORRECTION_LIMIT, Allowed::Within { low: 1.0, high: 2000.0 })
            {
                axis.correction_limit = rad_from_arcsec(limit.value);
            }
            let why = "reference points belong to linear axes; a rotary axis has point-mm";
            forbid(&section, "reference-points-mm", why);
            forbid(&section, "reference-body", why);
        }
    }
    section.finish();
    axis
}

/// Reports a key that this kind of axis cannot have.
fn forbid(section: &Section<'_>, key: &'static str, why: &str) {
    if let Some(value) = section.value(key) {
        section.report_at(value.place, format!("{}: {why}", section.named_key(key)), "take it out");
    }
}

fn read_reference_points(section: &Section<'_>, axis: &mut AxisSpec) {
    section.read("reference-points-mm", |points| {
        for (component, reference) in COMPONENTS.into_iter().zip(&mut axis.reference_points) {
            reference.point = point(points, component).unwrap_or(reference.point);
        }
    });
    let Some(body) = section.value("reference-body") else { return };
    match body.value {
        DeValue::Table(_) => {
            section.read("reference-body", |bodies| {
                for (component, reference) in COMPONENTS.into_iter().zip(&mut axis.reference_points) {
                    reference.body = bodies.choice(component, &BODIES).unwrap_or(reference.body);
                }
            });
        }
        DeValue::String(text) => {
            let word = Placed::new(text.as_ref(), body.place);
            if let Some(body) = section.word("reference-body", &word, &BODIES) {
                axis.reference_points.iter_mut().for_each(|reference| reference.body = body);
            }
        }
        _ => {
            section.wrong_shape::<()>("reference-body", &body, "\"carriage\" or \"bed\"");
        }
    }
}
