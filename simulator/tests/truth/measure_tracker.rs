//! The simulated machine measured with tracker, interferometer lines and circles, and what volcomp makes of it: close to
//! the truth, which is stated here from the machine's own numbers, not by the code under test.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes and reads files")]

use std::path::Path;
use std::process::{Command, Output};

use simulator::truth::chain::Side;
use simulator::truth::kinematics::Sense;
use simulator::truth::{GANTRY_5AX, TruthMachine, VMC_850};
use volcomp::model::axes::{AxisName, Travel};
use volcomp::model::units::{arcsec_from_rad, um_from_mm};
use volcomp::model::{ErrorSymbol, ModelSpec};

fn run(program: &str, directory: &Path, args: &[&str]) -> Output {
    let output = Command::new(program).current_dir(directory).args(args).output().unwrap();
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

/// Measures, and returns the command that the simulator proposes, split at blanks outside quotes.
fn measure(directory: &Path, args: &[&str]) -> Vec<String> {
    let output = run(env!("CARGO_BIN_EXE_cncsim"), directory, &[&["measure"], args].concat());
    let line = String::from_utf8(output.stdout).unwrap();
    let mut words = Vec::new();
    for (i, part) in line.trim().split('"').enumerate() {
        if i % 2 == 1 {
            words.push(part.to_owned());
        } else {
            words.extend(part.split_whitespace().map(str::to_owned));
        }
    }
    words
}

/// Runs a proposed command with more arguments.
fn identify(directory: &Path, words: &[String], more: &[&str]) -> String {
    // the simulator's file holds the product's programs, too
    let args: Vec<&str> = words.iter().map(String::as_str).chain(more.iter().copied()).collect();
    String::from_utf8(run(env!("CARGO_BIN_EXE_cncsim"), directory, &args).stdout).unwrap()
}

fn model(directory: &Path, name: &str) -> ModelSpec {
    let text = std::fs::read_to_string(directory.join(name)).unwrap();
    volcomp::config::model::parse(name, &text).unwrap_or_else(|e| panic!("{e}\n{text}"))
}

/// The six true motions of an axis in the gauge of a model: relative sense, mean of both directions, at `reference`,
/// zero at 0, straightness about its end-point line.
fn truth(machine: &TruthMachine, axis: AxisName, reference: [f64; 3], q: f64) -> [f64; 6] {
    let k = machine.index_of(axis).unwrap();
    let joint = machine.drawing(k).unwrap();
    let sign = if joint.side == Side::Workpiece && joint.sense == Sense::Carriage { -1.0 } else { 1.0 };
    let raw = |q: f64| -> [f64; 6] {
        let [forward, back] = [1, -1].map(|d| machine.true_motion(k, q, d));
        let m: [f64; 6] = std::array::from_fn(|i| sign * (forward[i] + back[i]) / 2.0);
        let [a, b, c] = [m[3], m[4], m[5]];
        let shift = |i: usize| {
            let l: [f64; 3] = std::array::from_fn(|j| reference[j] - joint.reference_mm[i][j]);
            [b * l[2] - c * l[1], c * l[0] - a * l[2], a * l[1] - b * l[0]][i]
        };
        [m[0] + shift(0), m[1] + shift(1), m[2] + shift(2), a, b, c]
    };
    let [low, high] = machine.travel(k);
    let (first, last, zero, here) = (raw(low), raw(high), raw(0.0f64.clamp(low, high)), raw(q));
    std::array::from_fn(|i| {
        let slope = if i < 3 && i != axis.direction() { (last[i] - first[i]) / (high - low) } else { 0.0 };
        here[i] - zero[i] - slope * (q - 0.0f64.clamp(low, high))
    })
}

/// Largest deviation of a model from the truth over the travel: um, arcsec.
fn largest_error(machine: &TruthMachine, spec: &ModelSpec, axis: AxisName) -> (f64, f64) {
    let reference = spec.axis(axis).reference_points[0].point;
    let [low, high] = machine.travel(machine.index_of(axis).unwrap());
    let (mut length, mut angle) = (0.0f64, 0.0f64);
    for step in 0..=40 {
        let q = low + (high - low) * f64::from(step) / 40.0;
        let wanted = truth(machine, axis, reference.into(), q);
        for (i, letter) in ['x', 'y', 'z', 'a', 'b', 'c'].into_iter().enumerate() {
            let symbol = ErrorSymbol::parse(&format!("e{letter}{}", axis.lower())).unwrap();
            let (_, f) = spec.errors.iter().find(|(s, _)| *s == symbol).unwrap();
            let mean = (f.value(q, Travel::Forward) + f.value(q, Travel::Reverse)) / 2.0;
            let error = (mean - wanted[i]).abs();
            if i < 3 {
                length = length.max(um_from_mm(error));
            } else {
                angle = angle.max(arcsec_from_rad(error));
            }
        }
    }
    (length, angle)
}

#[test]
fn tracker_and_lines_find_the_motions_of_carriages_on_either_side() {
    let machine = TruthMachine::from_toml(VMC_850).unwrap();
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    for (letter, axis) in [("x", AxisName::X), ("z", AxisName::Z)] {
        let words = measure(
            d,
            &[
                "threepoint",
                "--axis",
                letter,
                "--stops",
                "41",
                "--runs",
                "3",
                "--noise-angle-arcsec",
                "0.05",
                "--noise-only",
            ],
        );
        let report =
            identify(d, &words, &["--out", "model.toml", "--basis", "table", "--motions", "motions.csv"]);
        assert!(report.contains("residual test passed") && report.contains("passed"), "{report}");
        let (length, angle) = largest_error(&machine, &model(d, "model.toml"), axis);
        assert!(length < 1.5 && angle < 1.2, "{letter} by tracker: {length} um, {angle} arcsec");
        let words = measure(d, &["nineline", "--axis", letter, "--stops", "41", "--runs", "3", "--all"]);
        let report = identify(
            d,
            &words,
            &[
                "--out",
                "model.toml",
                "--basis",
                "table",
                "--compare",
                "motions.csv",
                "--reference-mm",
                "0,0,0",
            ],
        );
        assert!(report.contains("passed") && report.contains("compared at 41 positions"), "{report}");
        let (length, angle) = largest_error(&machine, &model(d, "model.toml"), axis);
        assert!(length < 0.6 && angle < 0.4, "{letter} by lines: {length} um, {angle} arcsec");
    }
}

/// The gantry without the small motions of its head: only locations are left of it.
fn gantry(with_locations: bool) -> String {
    let mut text = String::new();
    let mut location = false;
    for line in GANTRY_5AX.lines() {
        if line.starts_with('[') {
            location = line.starts_with("[location]");
        }
        let head_motion = line.len() > 3
            && line.starts_with('e')
            && matches!(&line[2..3], "a" | "c")
            && line.as_bytes()[3] == b' ';
        if !(head_motion || (location && !with_locations)) {
            text.push_str(line);
            text.push('\n');
        }
    }
    text
}

#[test]
fn circles_find_tip_and_axis_of_the_truth() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    let machine = TruthMachine::from_toml(GANTRY_5AX).unwrap();
    let words = measure(d, &["circles", "--at", "z=-300,c=40,a=-25", "--noise-um", "1"]);
    let json: serde_json::Value = serde_json::from_str(&identify(d, &words, &["--json"])).unwrap();
    let mut q = [0.0; 8];
    for (name, value) in [(AxisName::Z, -300.0), (AxisName::C, 40.0), (AxisName::A, -25.0)] {
        q[machine.index_of(name).unwrap()] = value;
    }
    let pose = machine.pose(&q, &[0; 8]);
    let origin = machine.workpiece_origin_mm();
    for i in 0..3 {
        let tip = json["tip"][i].as_f64().unwrap() - origin[i];
        assert!((tip - pose.tip_mm[i]).abs() < 1.5e-3, "tip {i}: {}", tip - pose.tip_mm[i]);
        let direction = json["axis_direction"][i].as_f64().unwrap();
        assert!((direction - pose.direction[i]).abs() < 6e-6, "axis {i}");
    }
    // at home the spindle's location is written
    let words = measure(d, &["circles", "--noise-um", "0.01"]);
    identify(d, &words, &["--out", "spindle.toml", "--chain", "[w b X Y Z C A (S) t]"]);
    let spec = model(d, "spindle.toml");
    let actual = machine.pose(&[0.0; 8], &[0; 8]);
    let of = |name: &str| {
        let symbol = ErrorSymbol::parse(name).unwrap();
        spec.errors.iter().find(|(s, _)| *s == symbol).unwrap().1.value(0.0, Travel::Forward)
    };
    assert!(
        (of("ea0s") + actual.direction[1]).abs() < 1e-7 && (of("eb0s") - actual.direction[0]).abs() < 1e-7
    );
}

#[test]
fn head_poses_find_the_ram_behind_a_head_with_errors() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    for with_locations in [false, true] {
        let text = gantry(with_locations);
        std::fs::write(d.join("gantry.toml"), &text).unwrap();
        let machine = TruthMachine::from_toml(&text).unwrap();
        let words =
            measure(d, &["ram", "--axis", "z", "--machine", "gantry.toml", "--stops", "15", "--runs", "2"]);
        let mut more = vec!["--out", "ram.toml", "--basis", "table"];
        if with_locations {
            std::fs::write(d.join("head.toml"), head_model()).unwrap();
            more.extend(["--head", "head.toml"]);
        }
        identify(d, &words, &more);
        let (length, angle) = largest_error(&machine, &model(d, "ram.toml"), AxisName::Z);
        assert!(length < 3.0 && angle < 2.0, "locations {with_locations}: {length} um, {angle} arcsec");
    }
}

/// The locations of the truth file, in the product's own format.
fn head_model() -> String {
    let mut text = String::from(
        "format = \"volcomp-model/1\"\nmachine = \"gantry-5ax\"\nchain = \"[w b X Y Z C A (S) t]\"\n[frame]\nworkpiece-origin-mm = [0, 0, -1500]\ntool-tip-mm = [0.15, -0.1, -500]\n[axes.c]\npoint-mm = [0, 0, -100]\n[axes.a]\npoint-mm = [0.15, -0.1, -180]\n",
    );
    for (symbol, value, unit) in [
        ("ex0c", 12.0, "um"),
        ("ey0c", -9.0, "um"),
        ("ea0c", 4.0, "arcsec"),
        ("eb0c", -3.5, "arcsec"),
        ("ey0a", 14.0, "um"),
        ("ez0a", -8.0, "um"),
        ("eb0a", 5.0, "arcsec"),
        ("ec0a", -4.0, "arcsec"),
    ] {
        text.push_str(&format!("[errors.{symbol}.constant]\nvalue-{unit} = {value}\n"));
    }
    text
}
