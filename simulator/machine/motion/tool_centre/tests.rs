use super::*;
use crate::motion::gcode::interpret;
use crate::motion::{Dynamics, MachineAxes, MotionSource, Trajectory};
use crate::truth::{GANTRY_5AX, VMC_850};

/// Cycle, s.
const CYCLE_S: f64 = 0.002;

fn gantry() -> (TruthMachine, MachineAxes) {
    let machine = TruthMachine::from_toml(GANTRY_5AX).unwrap();
    let axes = MachineAxes::of(&machine).unwrap();
    (machine, axes)
}

/// Commanded axes of the scored cycles with their speed.
fn cycles(text: &str, axes: &MachineAxes) -> Vec<(AxisArray, f64)> {
    let start = axes.middle();
    let program = interpret(text, axes, start).unwrap();
    let mut path = Trajectory::new(start, &program.segments, axes, &Dynamics::default(), CYCLE_S).unwrap();
    let mut list = Vec::new();
    while let Some(cycle) = path.next_cycle() {
        if cycle.scored {
            list.push((cycle.commanded, cycle.feed_mm_per_min));
        }
    }
    list
}

fn distance_to_line(p: [f64; 3], a: [f64; 3], b: [f64; 3]) -> f64 {
    let [p, a, b] = [p, a, b].map(Vector3::from);
    let along = (b - a).normalize();
    ((p - a) - along * along.dot(&(p - a))).norm()
}

#[test]
fn the_tip_stays_on_its_line_while_the_head_sweeps() {
    let (machine, axes) = gantry();
    let text = "G21 G90 F2000\nG0 X1400 Y900 Z-500\n(SCORE OFF)\nG43.4 H1\nG1 A-20 C-90\n(SCORE ON)\n\
                G1 X1600 Y1050 Z-480 A60 C120\n(SCORE OFF)\nG49\nM30\n";
    let list = cycles(text, &axes);
    let at = |x: f64, y: f64, z: f64| machine.nominal(&[x, y, z, 0.0, 0.0, 0.0, 0.0, 0.0]).tip_mm;
    let (from, to) = (at(1400.0, 900.0, -500.0), at(1600.0, 1050.0, -480.0));
    let worst =
        list.iter().map(|(q, _)| distance_to_line(machine.nominal(q).tip_mm, from, to)).fold(0.0, f64::max);
    assert!(worst < 1e-6, "{worst} mm off the line");
    let turned = list.iter().map(|(q, _)| q[4]).fold(f64::NEG_INFINITY, f64::max)
        - list.iter().map(|(q, _)| q[4]).fold(f64::INFINITY, f64::min);
    assert!(turned > 79.0, "A turned by {turned} deg");
}

#[test]
fn an_ideal_machine_keeps_the_tip_within_a_micrometre_while_only_the_head_turns() {
    let (machine, axes) = gantry();
    let text = "G21 G90 F1000\nG0 X1500 Y1000 Z-500\n(SCORE OFF)\nG43.4\n(SCORE ON)\nG1 A80 C170\nG1 A-80 C-170\n\
                (SCORE OFF)\nM30\n";
    let list = cycles(text, &axes);
    let point = machine.nominal(&[1500.0, 1000.0, -500.0, 0.0, 0.0, 0.0, 0.0, 0.0]).tip_mm;
    let off = |q: &AxisArray| (Vector3::from(machine.nominal(q).tip_mm) - Vector3::from(point)).norm();
    let worst = list.iter().map(|(q, _)| off(q)).fold(0.0, f64::max);
    assert!(worst < 1e-3 && list.len() > 100, "{worst} mm, {} cycles", list.len());
    // without it the tip moves by hundreds of millimetres
    let plain = cycles(&text.replace("G43.4", ""), &axes);
    assert!(plain.iter().map(|(q, _)| off(q)).fold(0.0, f64::max) > 100.0);
}

#[test]
fn the_feed_is_that_of_the_tip_and_no_axis_exceeds_its_rate() {
    let (machine, axes) = gantry();
    let text = "G21 G90 F3000\nG0 X1400 Y900 Z-500\n(SCORE OFF)\nG43.4\n(SCORE ON)\nG1 X1600 A40 C150\n(SCORE OFF)\nM30\n";
    let list = cycles(text, &axes);
    let mut fastest = 0.0_f64;
    for pair in list.windows(2) {
        let tip = |q: &AxisArray| Vector3::from(machine.nominal(q).tip_mm);
        let speed = (tip(&pair[1].0) - tip(&pair[0].0)).norm() / CYCLE_S * 60.0;
        assert!((speed - 0.5 * (pair[0].1 + pair[1].1)).abs() < 0.01 * 3000.0, "{speed} {}", pair[0].1);
        fastest = fastest.max(speed);
        for (k, axis) in axes.as_slice().iter().enumerate() {
            let rate = (pair[1].0[k] - pair[0].0[k]).abs() / CYCLE_S * 60.0;
            assert!(rate <= 1.02 * axis.rapid_per_min, "{} {rate}", axis.name);
        }
    }
    assert!(fastest > 1000.0 && fastest < 3030.0, "{fastest}");
}

#[test]
fn switching_off_leaves_the_axes_where_they_are() {
    let (machine, axes) = gantry();
    let start = axes.middle();
    let text = "G90 F1000 G43.4 G1 A30 C40\nG49\nG91 G1 Z10\nM30\n";
    let program = interpret(text, &axes, start).unwrap();
    let plain = interpret("G90 F1000 G1 A30 C40\nM30\n", &axes, start).unwrap();
    assert_eq!((program.end[3], program.end[4]), (plain.end[3], plain.end[4]));
    let tip = |q: &AxisArray| Vector3::from(machine.nominal(q).tip_mm);
    assert!((tip(&program.end) - tip(&start) - Vector3::new(0.0, 0.0, 10.0)).norm() < 1e-9);
}

#[test]
fn both_directions_agree_on_every_chain() {
    for chain in ["[w b X Y Z C A (S) t]", "[w C' A' b X Y Z (S) t]", "[w C' X' b Y Z A (S) t]"] {
        let machine = TruthMachine::from_toml(&GANTRY_5AX.replace("[w b X Y Z C A (S) t]", chain)).unwrap();
        let kinematics = ToolCentre::of(&machine).unwrap();
        let mut programmed = [12.0, -30.0, -45.0, 20.0, -35.0, 0.0, 0.0, 0.0];
        programmed[machine.axes().len()..].fill(0.0);
        let axes = kinematics.axes(&programmed);
        for (back, wanted) in kinematics.programmed(&axes).iter().zip(programmed) {
            assert!((back - wanted).abs() < 1e-9, "{chain}");
        }
        let mut straight = programmed;
        for (k, name) in machine.axes().iter().enumerate() {
            if name.kind() == AxisKind::Rotary {
                straight[k] = 0.0;
            }
        }
        let [a, b] = [axes, straight].map(|q| Vector3::from(machine.nominal(&q).tip_mm));
        assert!((a - b).norm() < 1e-9, "{chain}");
    }
}

#[test]
fn a_machine_without_rotary_axes_and_a_path_beyond_the_travel_are_refused() {
    let mill = TruthMachine::from_toml(VMC_850).unwrap();
    let axes = MachineAxes::of(&mill).unwrap();
    let error = interpret("G43.4", &axes, axes.middle()).unwrap_err();
    assert_eq!(
        error.to_string(),
        "line 1, column 1: G43.4 needs X, Y, Z and a rotary axis; this machine has X Y Z"
    );
    let (_, axes) = gantry();
    // the tip may go there, the axis may not: the head leans by 277 mm
    let run = |a: &str| interpret(&format!("G90 F1000 G43.4 G1 Y1900 A{a}"), &axes, axes.middle());
    assert!(run("60").is_ok());
    let error = run("-60").unwrap_err().to_string();
    assert!(error.contains("axis Y reaches 2177."), "{error}");
}
