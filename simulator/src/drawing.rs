//! A machine as it was drawn: geometry without errors, for an identification to begin with.

use std::fmt::Write as _;

use volcomp_units::axes::AxisKind;

use crate::truth::TruthMachine;

/// The model file `volcomp-model/1` of a machine without errors: chain, frame, travels, reference points in M.
#[must_use]
pub fn drawing(machine: &TruthMachine) -> String {
    let list = |v: [f64; 3]| format!("[{}, {}, {}]", v[0], v[1], v[2]);
    let mut text = format!(
        "format = \"volcomp-model/1\"\nmachine = \"{}\"\nchain = \"{}\"\n\n[frame]\nworkpiece-origin-mm = {}\ntool-tip-mm = {}\n",
        machine.machine(),
        machine.chain().text(),
        list(machine.workpiece_origin_mm()),
        list(machine.tool_tip_mm())
    );
    for (k, axis) in machine.axes().into_iter().enumerate() {
        let [low, high] = machine.travel(k);
        let Some(joint) = machine.drawing(k) else { continue };
        let lines = match axis.kind() {
            AxisKind::Linear => {
                let [x, y, z] = joint.reference_mm.map(list);
                format!("travel-mm = [{low}, {high}]\nreference-points-mm = {{ x = {x}, y = {y}, z = {z} }}")
            }
            AxisKind::Rotary => format!("travel-deg = [{low}, {high}]\npoint-mm = {}", list(joint.point_mm)),
        };
        // writing into a string cannot fail
        let _ = write!(text, "\n[axes.{}]\n{lines}\n", axis.lower());
    }
    text
}
