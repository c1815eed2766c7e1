//! The kinematic reference vectors: first order and exact.

#![expect(
    clippy::expect_used,
    clippy::disallowed_methods,
    reason = "a test reads files, and stops where its own set-up is wrong"
)]

use std::path::Path;

use serde_json::Value;
use volcomp::model::axes::{AxisName, MAX_AXES};
use volcomp::model::geometry::Vec3;
use volcomp::model::spec::{ReferenceBody, ReferencePoint};
use volcomp::model::{
    AxisSpec, Chain, Component, Curve, ErrorFunction, ErrorSymbol, Model, ModelSpec, Pose, Sense,
};

fn vec3(v: &Value) -> Vec3 {
    Vec3::from_fn(|i, _| v[i].as_f64().expect("number"))
}

/// The model of a case: each error motion a constant at this pose.
fn model(case: &Value) -> Model {
    let chain = Chain::parse(case["chain"].as_str().expect("chain")).expect("chain parses");
    let mut spec = ModelSpec::new(case["id"].as_str().expect("id"), chain);
    spec.workpiece_origin = vec3(&case["workpiece_origin"]);
    spec.tool_tip = vec3(&case["tool_tip"]);
    let mut put = |symbol: ErrorSymbol, value: f64| {
        spec.errors.push((symbol, ErrorFunction::single(Curve::Constant(value))));
    };
    for (letter, axis) in case["axes"].as_object().expect("axes") {
        let name = AxisName::from_letter(letter.chars().next().expect("letter")).expect("axis");
        for component in Component::ALL {
            let value = axis["E"][component.index()].as_f64().expect("number");
            put(ErrorSymbol::Motion { component, axis: name }, value);
            if let Some(location) = axis["location"].as_array() {
                let value = location[component.index()].as_f64().expect("number");
                if value != 0.0 {
                    put(ErrorSymbol::Location { component, axis: name }, value);
                }
            }
        }
    }
    for (key, value) in case["squareness"].as_object().expect("squareness") {
        let symbol = ErrorSymbol::parse(&format!("E{key}")).expect("squareness symbol");
        if value.as_f64() != Some(0.0) {
            put(symbol, value.as_f64().expect("number"));
        }
    }
    for (letter, axis) in case["axes"].as_object().expect("axes") {
        let name = AxisName::from_letter(letter.chars().next().expect("letter")).expect("axis");
        let mut entry = AxisSpec::new(name);
        if axis["sense"] == "carriage" {
            entry.sense = Sense::Carriage;
        }
        if axis["point"].is_array() {
            entry.point = vec3(&axis["point"]);
        }
        let reference = |i: usize| {
            let point = axis["ref"].get(["X", "Y", "Z"][i]).map_or(entry.point, vec3);
            ReferencePoint { point, body: ReferenceBody::Carriage }
        };
        entry.reference_points = [reference(0), reference(1), reference(2)];
        spec.axes.push(entry);
    }
    Model::new(&spec).expect("valid model")
}

fn pose(model: &Model, case: &Value) -> Pose {
    let mut position = [0.0; MAX_AXES];
    for (k, axis) in model.axes().enumerate() {
        position[k] = case["q"][axis.name.to_string()].as_f64().expect("coordinate");
    }
    Pose::at(position)
}

fn assert_close(what: &str, id: &str, got: &Vec3, expected: &Value, tolerance: f64) {
    let difference = (got - vec3(expected)).amax();
    assert!(difference <= tolerance, "{id} {what}: off by {difference:e}, tolerance {tolerance:e}");
}

#[test]
fn first_order_exact_and_corrections_match_the_vectors() {
    let mut cases = 0;
    for file in ["kin_three_axis", "kin_gantry", "kin_grinder"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/vectors/{file}.json"));
        let text = std::fs::read_to_string(&path).expect("the vectors");
        let data: Value = serde_json::from_str(&text).expect("JSON");
        let (first, exact) = (1e-12, data["tolerance"]["exact"].as_f64().expect("tolerance"));
        for case in data["cases"].as_array().expect("cases") {
            let id = case["id"].as_str().expect("id");
            let model = model(case);
            let pose = pose(&model, case);
            let (deviation, correction) = model.correct(&pose);
            let expect = &case["expect"];
            assert_close("e_first", id, &deviation.position, &expect["e_first"], first);
            assert_close("theta_first", id, &deviation.rotation, &expect["theta_first"], first);
            let full = model.deviation_exact(&pose);
            assert_close("e_exact", id, &full.position, &expect["e_exact"], exact);
            assert_close("theta_exact", id, &full.rotation, &expect["theta_exact"], exact);
            for (k, axis) in model.axes().enumerate() {
                let letter = axis.name.to_string();
                let expected = match &expect["five_axis_correction_first"] {
                    Value::Object(five) => five.get(&letter).and_then(Value::as_f64).unwrap_or(0.0),
                    _ if file == "kin_three_axis" => {
                        expect["correction_first"][axis.name.direction()].as_f64().expect("number")
                    }
                    _ => continue,
                };
                let difference = (correction.offset[k] - expected).abs();
                assert!(difference <= 1e-9, "{id} correction {letter}: off by {difference:e}");
            }
            cases += 1;
        }
    }
    assert!(cases >= 35, "only {cases} cases found");
}
