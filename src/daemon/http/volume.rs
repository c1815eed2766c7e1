//! The distorted volume of the model in use, for the page to draw.

use serde_json::{Value, json};

use crate::models::Prepared;
use volcomp_model::wireframe::{Wire, Wireframe};
use volcomp_units::um_from_mm;

/// Intervals of a wire.
const POINTS: usize = 24;

/// Wires as `[x, y, z, dx, dy, dz]`: programmed places, mm, and deviations of the tool tip, um; without `wires` where the
/// model has no volume.
pub(super) fn volume(model: &Prepared) -> String {
    let Some(frame) = Wireframe::of(&model.spec, &model.model, POINTS) else {
        return json!({ "model_hash": model.hash }).to_string();
    };
    let wire = |wire: &Wire| -> Value {
        let points: Vec<[f64; 6]> = wire
            .points
            .iter()
            .map(|(p, d)| {
                let [p, d] = [p.map(thousandths), d.map(|v| thousandths(um_from_mm(v)))];
                [p.x, p.y, p.z, d.x, d.y, d.z]
            })
            .collect();
        json!({ "front": wire.front, "points": points })
    };
    json!({
        "model_hash": model.hash,
        "axes": frame.edges.iter().map(|e| json!({ "axis": e.axis.lower(), "range": e.range })).collect::<Vec<_>>(),
        "rotary": frame.rotary,
        "largest_um": um_from_mm(frame.largest()),
        "magnification": frame.magnification(),
        "wires": frame.wires.iter().map(wire).collect::<Vec<_>>(),
    })
    .to_string()
}

fn thousandths(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}
