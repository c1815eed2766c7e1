//! Deviation that a model predicts for a machine state, in machine axes.

use crate::machine_state::{Axis, Machine, MachineAxis, MachineState, SLOTS};
use volcomp_model::geometry::{Mat3, Vec3, rotation_about};
use volcomp_model::{AxisMotion, DYNAMIC_MAX, Model, ModelSpec, Pose, Side};
use volcomp_units::axes::{AxisKind, MAX_AXES, Travel};
use volcomp_units::um_from_mm;

/// The chain of a model, as far as effects need it.
#[must_use]
pub fn machine_of(spec: &ModelSpec, model: &Model) -> Machine {
    let axes = model
        .axes()
        .filter_map(|a| {
            let axis = Axis::from_name(a.name)?;
            let known = spec.axis(a.name);
            Some(MachineAxis {
                axis,
                workpiece_side: a.side == Side::Workpiece,
                point_mm: known.point,
                reference_points: known.reference_points,
                travel: known.travel,
            })
        })
        .collect();
    let vertical = spec.vertical.and_then(Axis::from_name);
    Machine { axes, tool_tip_mm: model.tool_tip(), gauge_point_mm: spec.gauge_point, vertical }
}

/// The pose of a machine state.
#[must_use]
pub fn pose(model: &Model, m: &MachineState) -> Pose {
    let mut pose = Pose::at([0.0; MAX_AXES]);
    for (k, a) in model.axes().enumerate() {
        if let Some(axis) = Axis::from_name(a.name) {
            pose.position[k] = m.position[axis.slot()];
            if m.direction[axis.slot()] < 0.0 {
                pose.travel[k] = Travel::Reverse;
            }
        }
    }
    if m.tool_length_mm.is_finite() {
        pose.tool_tip = model.tool_tip_for_length(m.tool_length_mm);
    }
    if !model.dynamics().is_empty() {
        pose.dynamic = Some(signals(model, m));
    }
    pose
}

/// The signals of the dynamic terms of a model; of what is not known, those of an axis at rest.
fn signals(model: &Model, m: &MachineState) -> [f64; DYNAMIC_MAX] {
    let mut out = [0.0; DYNAMIC_MAX];
    let axes: Vec<Option<Axis>> = model.axes().map(|a| Axis::from_name(a.name)).collect();
    for (signal, d) in out.iter_mut().zip(model.dynamics()) {
        let Some(slot) = axes.get(d.axis).copied().flatten().map(Axis::slot) else { continue };
        let known = |v: f64, otherwise: f64| if v.is_nan() { otherwise } else { v };
        *signal = d.term.law.signal(&AxisMotion {
            velocity: known(m.velocity[slot], 0.0),
            acceleration: known(m.acceleration[slot], 0.0),
            direction: known(m.direction[slot], 0.0),
            since: known(m.since_mm[slot], f64::INFINITY),
            since_s: known(m.since_s[slot], f64::INFINITY),
        });
    }
    out
}

/// Turns a vector of W into machine axes: out of the rotations of the axes that carry the workpiece.
#[must_use]
pub fn workpiece_to_machine(model: &Model, m: &MachineState) -> Mat3 {
    let mut left = Mat3::identity();
    for a in model.axes().filter(|a| a.side == Side::Workpiece && a.name.kind() == AxisKind::Rotary) {
        if let Some(axis) = Axis::from_name(a.name) {
            left *= rotation_about(a.name.direction(), m.position[axis.slot()]);
        }
    }
    left.transpose()
}

/// The model's deviation in machine axes, um.
#[must_use]
pub fn deviation_um(model: &Model, m: &MachineState) -> Vec3 {
    deviation_with_live_um(model, m, &[])
}

/// The same with live values of the model's sensors, mm or strain; those that are not given are zero. The control's own encoder
/// sees of it what follows the motion.
#[must_use]
pub fn deviation_with_live_um(model: &Model, m: &MachineState, live: &[f64]) -> Vec3 {
    let mut pose = pose(model, m);
    for (slot, value) in pose.live.iter_mut().zip(live) {
        *slot = *value;
    }
    let mut d = model.deviation(&pose);
    if m.is_encoder {
        let still = MachineState { velocity: [0.0; SLOTS], acceleration: [0.0; SLOTS], ..m.clone() };
        pose.dynamic = pose.dynamic.map(|_| signals(model, &still));
        let at_rest = model.deviation(&pose);
        d.position -= at_rest.position;
        d.rotation -= at_rest.rotation;
    }
    let machine = workpiece_to_machine(model, m);
    let d = if m.is_angular() {
        m.u * (machine * d.rotation).dot(&m.lever_mm.cross(&m.u))
    } else {
        machine * d.position
    };
    d.map(um_from_mm)
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_model::{AxisSpec, Chain, Curve, ErrorFunction, ErrorSymbol};

    #[test]
    fn the_head_takes_the_tool_where_the_model_does() {
        let mut spec = ModelSpec::new("fork", Chain::parse("[w b X Z Y C A t]").unwrap());
        spec.tool_tip = Vec3::new(3.0, -2.0, -180.0);
        spec.gauge_point = Some(Vec3::new(3.0, -2.0, 10.0));
        let points = [(Axis::C, Vec3::new(20.0, -10.0, 0.0)), (Axis::A, Vec3::new(0.0, 35.0, 300.0))];
        spec.axes = points.map(|(axis, point)| AxisSpec { point, ..AxisSpec::new(axis.name()) }).into();
        let model = Model::new(&spec).unwrap();
        let machine = machine_of(&spec, &model);
        for turns in [[0.0, 0.0], [0.7, -1.1], [-2.0, 0.4]] {
            let mut m = MachineState {
                position: [500.0, -40.0, 75.0, turns[1], 0.0, turns[0]],
                ..MachineState::default()
            };
            m.head = machine.head(&m.position);
            let tip = Vec3::new(500.0, -40.0, 75.0) + m.head.carries(machine.tool_tip_mm);
            let nominal = model.nominal_tool(&pose(&model, &m));
            assert!((tip - nominal.tip).norm() < 1e-9, "{tip} {}", nominal.tip);
            assert!((m.head.turns(Vec3::z()) - nominal.direction).norm() < 1e-12);
        }
    }

    #[test]
    fn an_encoder_sees_no_static_error_of_the_model() {
        let mut spec = ModelSpec::new("plain", Chain::parse("[w b X Y Z t]").unwrap());
        let shift = ErrorFunction::single(Curve::Constant(5e-3));
        spec.errors.push((ErrorSymbol::parse("EXX").unwrap(), shift));
        let model = Model::new(&spec).unwrap();
        let at_tool = MachineState { position: [40.0, 0.0, 0.0, 0.0, 0.0, 0.0], ..MachineState::default() };
        let at_encoder = MachineState { is_encoder: true, ..at_tool.clone() };
        assert!((deviation_um(&model, &at_tool).x - 5.0).abs() < 1e-9);
        assert_eq!(deviation_um(&model, &at_encoder), Vec3::zeros());
    }
}
