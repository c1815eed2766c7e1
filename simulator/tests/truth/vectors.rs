//! The truth machine's exact kinematics against the reference vectors (40-digit values, made elsewhere).
#![expect(
    clippy::expect_used,
    clippy::disallowed_methods,
    reason = "a failure here is a failed test; the vectors are files"
)]

use std::path::Path;

use serde_json::Value;
use simulator::truth::chain::Chain;
use simulator::truth::kinematics::{Joint, JointState, Kinematics, Sense, Squareness};
use simulator::truth::transform::rotation_part;

/// Absolute, mm and rad, from the vector files.
const TOLERANCE: f64 = 2e-10;

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    let list = value.as_array().expect("a list");
    assert_eq!(list.len(), N);
    std::array::from_fn(|i| list[i].as_f64().expect("a number"))
}

fn machine_of(case: &Value) -> (Kinematics, Vec<JointState>) {
    let chain = Chain::parse(case["chain"].as_str().expect("a chain")).expect("a valid chain");
    let mut joints = Vec::new();
    let mut states = Vec::new();
    for link in chain.links() {
        let name = link.axis.letter().to_string();
        let axis = &case["axes"][&name];
        let point_mm = axis.get("point").map_or([0.0; 3], numbers);
        let reference_mm =
            axis.get("ref").map_or([point_mm; 3], |r| [numbers(&r["X"]), numbers(&r["Y"]), numbers(&r["Z"])]);
        let sense = match axis.get("sense").and_then(Value::as_str) {
            Some("carriage") => Sense::Carriage,
            _ => Sense::Relative,
        };
        let location = axis.get("location").map_or([0.0; 6], numbers);
        joints.push(Joint { axis: link.axis, side: link.side, point_mm, reference_mm, sense, location });
        let q = case["q"][&name].as_f64().expect("a coordinate");
        states.push(JointState { q, motion: numbers(&axis["E"]) });
    }
    let angle = |name: &str| case["squareness"].get(name).and_then(Value::as_f64).unwrap_or(0.0);
    let squareness = Squareness { c0y_rad: angle("C0Y"), b0z_rad: angle("B0Z"), a0z_rad: angle("A0Z") };
    let kinematics = Kinematics {
        joints,
        squareness,
        workpiece_origin_mm: numbers(&case["workpiece_origin"]),
        tool_tip_mm: numbers(&case["tool_tip"]),
    };
    (kinematics, states)
}

fn close(id: &str, what: &str, got: &[f64], want: &[f64]) {
    for (g, w) in got.iter().zip(want) {
        assert!((g - w).abs() <= TOLERANCE, "{id}: {what}: {g} instead of {w}, off by {:e}", g - w);
    }
}

fn matrix_close(id: &str, what: &str, got: &nalgebra::Matrix3<f64>, want: &Value) {
    for (i, row) in want.as_array().expect("rows").iter().enumerate() {
        let row: [f64; 3] = numbers(row);
        close(id, what, &[got[(i, 0)], got[(i, 1)], got[(i, 2)]], &row);
    }
}

fn check(file: &str, count: usize) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/vectors").join(file);
    let text = std::fs::read_to_string(&path).expect("the vectors");
    let group: Value = serde_json::from_str(&text).expect("valid JSON");
    let cases = group["cases"].as_array().expect("cases");
    assert!(cases.len() >= count, "{file} holds {} cases, {count} were expected", cases.len());
    for case in cases {
        let id = case["id"].as_str().expect("an id");
        let (kinematics, states) = machine_of(case);
        let (actual, nominal) = (kinematics.pose(&states), kinematics.nominal(&states));
        let deviation = actual.minus(&nominal);
        let expect = &case["expect"];
        close(id, "p_nominal", &nominal.tip_mm, &numbers::<3>(&expect["p_nominal"]));
        close(id, "p_actual_exact", &actual.tip_mm, &numbers::<3>(&expect["p_actual_exact"]));
        close(id, "e_exact", &deviation.tip_mm, &numbers::<3>(&expect["e_exact"]));
        close(id, "theta_exact", &deviation.rotation_rad, &numbers::<3>(&expect["theta_exact"]));
        matrix_close(id, "R_nominal", &rotation_part(&nominal.matrix), &expect["R_nominal"]);
        matrix_close(id, "R_actual_exact", &rotation_part(&actual.matrix), &expect["R_actual_exact"]);
    }
}

#[test]
fn three_axis_chains() {
    check("kin_three_axis.json", 24);
}

#[test]
fn five_axis_gantry() {
    check("kin_gantry.json", 6);
}

#[test]
fn grinder() {
    check("kin_grinder.json", 5);
}
