//! The machine of the simulator and the model of the product, written by two hands, on random machines of every type.

use crate::random_machine::{CHAINS, compile, machine, pose};
use proptest::prelude::*;
use simulator::truth::chain::Side as TruthSide;
use simulator::truth::kinematics::{Joint, JointState, Kinematics, Sense as TruthSense, Squareness};
use volcomp::model::axes::AxisKind;
use volcomp::model::geometry::Vec3;
use volcomp::model::{Component, ErrorSymbol, ModelSpec, Pose, Sense, Side};

/// The simulator's machine, written independently, at the same pose with the same values of the error motions.
fn truth_deviation(spec: &ModelSpec, pose: &Pose) -> ([f64; 3], [f64; 3]) {
    let value = |symbol: ErrorSymbol, q: f64| {
        let found = spec.errors.iter().find(|(s, _)| *s == symbol);
        found.map_or(0.0, |(_, f)| f.value(q, Default::default()))
    };
    let named = |text: &str| ErrorSymbol::parse(text).map_or(0.0, |s| value(s, 0.0));
    let mut joints = Vec::new();
    let mut states = Vec::new();
    for (k, axis) in spec.chain.axes().iter().enumerate() {
        let name = axis.name;
        let entry = spec.axis(name);
        let side = if axis.side == Side::Tool { TruthSide::Tool } else { TruthSide::Workpiece };
        let mut joint = Joint::plain(name, side);
        joint.point_mm = entry.point.into();
        joint.reference_mm = match axis.kind() {
            AxisKind::Linear => entry.reference_points.map(|r| r.point.into()),
            AxisKind::Rotary => [entry.point.into(); 3],
        };
        let carriage = entry.sense == Sense::Carriage;
        joint.sense = if carriage { TruthSense::Carriage } else { TruthSense::Relative };
        if axis.kind() == AxisKind::Rotary {
            let location = |c: Component| ErrorSymbol::parse(&format!("e{}0{name}", c.letter()));
            joint.location = Component::ALL.map(|c| location(c).map_or(0.0, |s| value(s, 0.0)));
        }
        let q = pose.position[k];
        let at = if carriage && axis.side == Side::Workpiece { -q } else { q };
        let motion = Component::ALL.map(|component| value(ErrorSymbol::Motion { component, axis: name }, at));
        joints.push(joint);
        states.push(JointState { q, motion });
    }
    let kinematics = Kinematics {
        joints,
        squareness: Squareness { c0y_rad: named("ec0y"), b0z_rad: named("eb0z"), a0z_rad: named("ea0z") },
        workpiece_origin_mm: spec.workpiece_origin.into(),
        tool_tip_mm: spec.tool_tip.into(),
    };
    let d = kinematics.pose(&states).minus(&kinematics.nominal(&states));
    (d.tip_mm, d.rotation_rad)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, ..ProptestConfig::default() })]

    /// Two programs by two hands, full rotations on both sides, random machines of every type: 1e-6 um.
    #[test]
    fn the_independent_machine_agrees_with_the_exact_evaluation(c in 0..CHAINS.len(), seed in any::<u64>(), carriage in any::<bool>()) {
        let mut spec = machine(CHAINS[c], seed, 1.0);
        for axis in &mut spec.axes {
            axis.sense = if carriage { Sense::Carriage } else { Sense::Relative };
        }
        let p = pose(&spec, seed);
        let exact = compile(&spec).deviation_exact(&p);
        let (tip_mm, rotation_rad) = truth_deviation(&spec, &p);
        prop_assert!((exact.position - Vec3::from(tip_mm)).amax() < 1e-9, "{} {:?}", exact.position, tip_mm);
        prop_assert!((exact.rotation - Vec3::from(rotation_rad)).amax() < 1e-13);
    }
}
