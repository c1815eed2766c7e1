//! Identities that every model keeps, on random machines of every type.

#![expect(clippy::unwrap_used, reason = "a test stops where its own set-up is wrong")]

use crate::random_machine::{CHAINS, compile, machine, pose};
use proptest::prelude::*;
use volcomp::model::axes::{AxisKind, AxisName, MAX_AXES};
use volcomp::model::curve::{Curve, ErrorFunction, Grid, Interpolation, Live, Table};
use volcomp::model::geometry::Vec3;
use volcomp::model::{
    AxisSpec, Chain, Component, ErrorSymbol, Model, ModelError, ModelSpec, Pose, Sense, Side,
};

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn a_model_without_errors_deviates_nowhere(c in 0..CHAINS.len(), seed in any::<u64>()) {
        let mut spec = machine(CHAINS[c], seed, 1.0);
        spec.errors.clear();
        let model = compile(&spec);
        let (deviation, correction) = model.correct(&pose(&spec, seed));
        prop_assert_eq!(deviation.position, Vec3::zeros());
        prop_assert_eq!(deviation.rotation, Vec3::zeros());
        prop_assert_eq!(correction.offset, [0.0; MAX_AXES]);
        let exact = model.deviation_exact(&pose(&spec, seed));
        prop_assert!(exact.position.amax() < 1e-12 && exact.rotation.amax() < 1e-15);
    }

    /// Halving all errors quarters what the first order leaves out.
    #[test]
    fn first_order_and_exact_differ_in_second_order(c in 0..CHAINS.len(), seed in any::<u64>()) {
        let rest = |scale: f64| {
            let spec = machine(CHAINS[c], seed, scale);
            let model = compile(&spec);
            let p = pose(&spec, seed);
            let (first, exact) = (model.deviation(&p), model.deviation_exact(&p));
            ((first.position - exact.position).norm(), (first.rotation - exact.rotation).norm())
        };
        let ((p1, r1), (p2, r2)) = (rest(8.0), rest(4.0));
        prop_assert!(p1 < 1e-2 && r1 < 1e-4);
        prop_assert!(p2 <= 0.3 * p1 + 1e-11, "{p1} {p2}");
        prop_assert!(r2 <= 0.3 * r1 + 1e-14, "{r1} {r2}");
    }

    /// The deviation of all errors together is the sum of the deviations of each.
    #[test]
    fn first_order_errors_add_up(c in 0..CHAINS.len(), seed in any::<u64>()) {
        let spec = machine(CHAINS[c], seed, 1.0);
        let p = pose(&spec, seed);
        let whole = compile(&spec).deviation(&p);
        let (mut position, mut rotation) = (Vec3::zeros(), Vec3::zeros());
        for error in &spec.errors {
            let one = compile(&ModelSpec { errors: vec![error.clone()], ..spec.clone() }).deviation(&p);
            position += one.position;
            rotation += one.rotation;
        }
        prop_assert!((position - whole.position).amax() < 1e-12);
        prop_assert!((rotation - whole.rotation).amax() < 1e-15);
    }

    /// A curve in the carriage sense, mirrored and with its sign changed, is the same machine in the relative sense.
    #[test]
    fn relative_and_carriage_sense_agree(c in 0..CHAINS.len(), seed in any::<u64>()) {
        let relative = machine(CHAINS[c], seed, 1.0);
        let mut carriage = relative.clone();
        for axis in &mut carriage.axes {
            axis.sense = Sense::Carriage;
        }
        for (symbol, function) in &mut carriage.errors {
            if symbol.is_constant() || !carriage.chain.axes().iter().any(|a| a.name == symbol.axis() && a.side == Side::Workpiece) {
                continue;
            }
            let Curve::Table(t) = &function.curves[0] else { unreachable!("machines are made of tables") };
            let (x, v, _) = t.columns();
            let mirrored = Table::new(
                x.iter().rev().map(|x| -x).collect(), v.iter().rev().map(|v| -v).collect(), None, Interpolation::Linear,
            ).unwrap();
            *function = ErrorFunction::single(Curve::Table(mirrored));
        }
        let p = pose(&relative, seed);
        let (a, b) = (compile(&relative), compile(&carriage));
        prop_assert!((a.deviation(&p).position - b.deviation(&p).position).amax() < 1e-12);
        prop_assert!((a.deviation(&p).rotation - b.deviation(&p).rotation).amax() < 1e-15);
        // exact: inverse motion, so the two differ in second order only
        prop_assert!((a.deviation_exact(&p).position - b.deviation_exact(&p).position).amax() < 1e-4);
    }

    /// After the correction only second order is left of what the chain can control.
    #[test]
    fn the_corrected_pose_is_right_to_second_order(c in 0..CHAINS.len(), seed in any::<u64>()) {
        let mut spec = machine(CHAINS[c], seed, 1.0);
        // errors constant over the small correction, as on the cycle: looked up at the programmed coordinate
        for (_, f) in &mut spec.errors {
            let v = f.value(0.0, Default::default());
            *f = ErrorFunction::single(Curve::Constant(v));
        }
        let model = compile(&spec);
        let p = pose(&spec, seed);
        let (deviation, correction) = model.correct(&p);
        prop_assume!(correction.singular == 0);
        let mut corrected = p;
        for (q, offset) in corrected.position.iter_mut().zip(correction.offset) {
            *q += offset;
        }
        // actual at the corrected pose minus nominal at the programmed one
        let moved = nominal_tip(&spec, &corrected) - nominal_tip(&spec, &p);
        let left = model.deviation_exact(&corrected).position + moved - correction.residual;
        // second order: errors times corrections times levers below 1.5 m, and corrections squared times the same
        let turn = correction.offset.iter().zip(spec.chain.axes())
            .filter(|(_, a)| a.kind() == AxisKind::Rotary).map(|(o, _)| o.abs()).fold(4e-4, f64::max);
        let second_order = 1500.0 * turn * turn;
        prop_assert!(left.norm() < second_order, "{} of {}", left.norm(), deviation.position.norm());
    }

    /// Renaming the directions x -> y -> z -> x gives the renamed deviation.
    #[test]
    fn directions_are_interchangeable(seed in any::<u64>()) {
        let spec = machine("[w X' b Y Z t]", seed, 1.0);
        let turn = |v: Vec3| Vec3::new(v.z, v.x, v.y);
        let next = |name: AxisName| match name { AxisName::X => AxisName::Y, AxisName::Y => AxisName::Z, _ => AxisName::X };
        let mut turned = ModelSpec::new("turned", Chain::parse("[w Y' b Z X t]").unwrap());
        turned.workpiece_origin = turn(spec.workpiece_origin);
        turned.tool_tip = turn(spec.tool_tip);
        for axis in &spec.axes {
            let mut entry = AxisSpec { name: next(axis.name), ..axis.clone() };
            for i in 0..3 {
                entry.reference_points[(i + 1) % 3].point = turn(axis.reference_points[i].point);
            }
            turned.axes.push(entry);
        }
        let mut plain = spec.clone();
        plain.errors.retain(|(s, _)| !s.is_constant());
        for (symbol, f) in &plain.errors {
            let i = symbol.component().index();
            let component = Component::ALL[if i < 3 { (i + 1) % 3 } else { 3 + (i - 2) % 3 }];
            turned.errors.push((ErrorSymbol::Motion { component, axis: next(symbol.axis()) }, f.clone()));
        }
        let p = pose(&spec, seed);
        let (a, b) = (compile(&plain).deviation(&p), compile(&turned).deviation(&p));
        prop_assert!((turn(a.position) - b.position).amax() < 1e-12);
        prop_assert!((turn(a.rotation) - b.rotation).amax() < 1e-15);
    }
}

/// The part of a machine that belongs to the axes of a shorter chain: motions and locations, no squareness.
fn part(whole: &ModelSpec, chain: &str) -> ModelSpec {
    let mut spec = ModelSpec { chain: Chain::parse(chain).unwrap(), ..whole.clone() };
    spec.axes.retain(|a| spec.chain.index_of(a.name).is_some());
    spec.errors.retain(|(s, _)| spec.chain.index_of(s.axis()).is_some());
    spec
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    /// A chain is its workpiece side and its tool side in series: e = e_left(tip at the right's) + R_left e_right.
    #[test]
    fn chains_compose(seed in any::<u64>()) {
        use volcomp::model::geometry::rotation_about;
        let mut whole = machine("[w C' X' b Y Z A t]", seed, 1.0);
        whole.errors.retain(|(s, _)| !matches!(s, ErrorSymbol::Squareness { .. }));
        let (left, right) = (part(&whole, "[w C' X' b t]"), part(&whole, "[w b Y Z A t]"));
        let p = pose(&whole, seed);
        let mut at_left = Pose::at([0.0; MAX_AXES]);
        at_left.position[..2].copy_from_slice(&p.position[..2]);
        let mut at_right = Pose::at([0.0; MAX_AXES]);
        at_right.position[..3].copy_from_slice(&p.position[2..5]);
        at_left.tool_tip = Some(nominal_tip(&right, &at_right) + right.workpiece_origin);
        let turn = rotation_about(2, p.position[0]);
        let (l, r) = (compile(&left).deviation(&at_left), compile(&right).deviation(&at_right));
        let d = compile(&whole).deviation(&p);
        prop_assert!((d.position - (l.position + turn * r.position)).amax() < 1e-12);
        prop_assert!((d.rotation - (l.rotation + turn * r.rotation)).amax() < 1e-15);
    }

    /// A machine seen in a mirror (x to -x): lengths along x and angles about y and z change their sign.
    #[test]
    fn a_mirrored_machine_deviates_as_the_mirror_image(c in 0..4usize, seed in any::<u64>()) {
        let spec = machine(CHAINS[c], seed, 1.0);
        let flip = |v: Vec3| Vec3::new(-v.x, v.y, v.z);
        let mut image = spec.clone();
        image.workpiece_origin = flip(spec.workpiece_origin);
        image.tool_tip = flip(spec.tool_tip);
        for axis in &mut image.axes {
            for r in &mut axis.reference_points {
                r.point = flip(r.point);
            }
        }
        for (symbol, function) in &mut image.errors {
            let sign = match symbol.component() { Component::X | Component::B | Component::C => -1.0, _ => 1.0 };
            let curve = match &function.curves[0] {
                Curve::Table(t) => {
                    let (x, v, _) = t.columns();
                    let v = v.iter().map(|v| sign * v);
                    let (x, v) = if symbol.axis() == AxisName::X {
                        (x.iter().rev().map(|x| -x).collect(), v.rev().collect())
                    } else {
                        (x.to_vec(), v.collect())
                    };
                    Curve::Table(Table::new(x, v, None, Interpolation::Linear).unwrap())
                }
                Curve::Constant(v) => Curve::Constant(sign * v),
                _ => unreachable!("machines are made of tables and constants"),
            };
            *function = ErrorFunction::single(curve);
        }
        let p = pose(&spec, seed);
        let mut q = p;
        let x = spec.chain.index_of(AxisName::X).unwrap();
        q.position[x] = -p.position[x];
        let (a, b) = (compile(&spec), compile(&image));
        for (a, b) in [(a.deviation(&p), b.deviation(&q)), (a.deviation_exact(&p), b.deviation_exact(&q))] {
            prop_assert!((flip(a.position) - b.position).amax() < 1e-10, "{} {}", a.position, b.position);
            let mirrored = Vec3::new(a.rotation.x, -a.rotation.y, -a.rotation.z);
            prop_assert!((mirrored - b.rotation).amax() < 1e-13);
        }
    }
}

/// Sag that grows with the reach of Z as the cross slide moves out: e = (0, 0, k y z) everywhere on the grid.
#[test]
fn a_grid_over_two_axes_acts_at_the_pose() {
    let mut spec = ModelSpec::new("sag", Chain::parse("[w b X Y Z t]").unwrap());
    let axes = vec![(AxisName::Y, vec![0.0, 400.0]), (AxisName::Z, vec![-300.0, 0.0])];
    let grid = Grid::new(axes, vec![0.0, 0.0, 400.0 * -300.0 * 1e-7, 0.0]).unwrap();
    let sag = ErrorFunction { grids: vec![grid], ..ErrorFunction::default() };
    spec.errors.push((ErrorSymbol::parse("ezy").unwrap(), sag.clone()));
    let model = compile(&spec);
    let mut position = [0.0; MAX_AXES];
    position[..3].copy_from_slice(&[50.0, 120.0, -80.0]);
    let d = model.deviation(&Pose::at(position));
    assert!((d.position - Vec3::new(0.0, 0.0, 120.0 * -80.0 * 1e-7)).amax() < 1e-15);
    assert!((model.deviation_exact(&Pose::at(position)).position - d.position).amax() < 1e-12);
    position[2] = -900.0;
    let d = model.deviation(&Pose::at(position));
    assert!((d.position.z - 120.0 * -300.0 * 1e-7).abs() < 1e-15);
    assert_eq!(d.flags.out_of_range, 1 << 1);

    spec.chain = Chain::parse("[w b X Y t]").unwrap();
    spec.errors = vec![(ErrorSymbol::parse("ezy").unwrap(), sag)];
    assert!(matches!(Model::new(&spec), Err(ModelError::GridOverMissingAxis { axis: AxisName::Z, .. })));
}

#[test]
fn a_touched_datum_deviates_by_nothing_and_shifts_all_else_alike() {
    let plain = machine("[w C' b X Y Z t]", 7, 1.0);
    let mut spec = plain.clone();
    spec.datum = vec![(AxisName::X, 120.0), (AxisName::Z, -200.0), (AxisName::C, 0.6)];
    let (model, bare) = (compile(&spec), compile(&plain));
    let touched = model.pose_of(&spec.datum);
    assert!(model.deviation(&touched).position.amax() < 1e-15);
    assert!(model.deviation_exact(&touched).position.amax() < 1e-15);
    assert!(model.correct(&touched).1.residual.amax() < 1e-12);
    let p = pose(&spec, 3);
    let expected = bare.deviation(&p).position - bare.deviation(&touched).position;
    assert!((model.deviation(&p).position - expected).amax() < 1e-14);
    assert_eq!(model.deviation(&p).rotation, bare.deviation(&p).rotation);
    spec.datum = vec![(AxisName::Y, f64::NAN)];
    assert!(matches!(Model::new(&spec), Err(ModelError::Datum { axis: AxisName::Y })));
}

#[test]
fn a_live_value_adds_within_its_limit_and_nonsense_is_nothing() {
    let mut spec = ModelSpec::new("ram", Chain::parse("[w X' b Y Z t]").unwrap());
    let live = |sensor: &str| Live { sensor: sensor.to_owned(), limit: 0.02, reference: None };
    let ezz = ErrorFunction { live: vec![live("ram")], ..ErrorFunction::single(Curve::Constant(0.001)) };
    spec.errors.push((ErrorSymbol::parse("ezz").unwrap(), ezz));
    let exx = ErrorFunction { live: vec![live("laser"), live("ram")], ..ErrorFunction::default() };
    spec.errors.push((ErrorSymbol::parse("exx").unwrap(), exx));
    let model = compile(&spec);
    assert_eq!(model.sensors(), ["ram", "laser"]);
    let mut p = Pose::at([0.0; MAX_AXES]);
    for (ram, laser, x, z) in [
        (0.0, 0.0, 0.0, 0.001),
        (0.005, -0.002, 0.003, 0.006),
        (0.5, 0.0, 0.02, 0.021),
        (f64::NAN, f64::INFINITY, 0.0, 0.001),
    ] {
        p.live[..2].copy_from_slice(&[ram, laser]);
        let d = model.deviation(&p);
        assert!((d.position - Vec3::new(x, 0.0, z)).amax() < 1e-15, "{ram} {laser}: {}", d.position);
    }
}

#[test]
fn a_strain_adds_in_proportion_to_the_distance_from_its_reference() {
    let mut spec = ModelSpec::new("hot", Chain::parse("[w X' b Y Z t]").unwrap());
    let live = vec![Live { sensor: "scale-x".to_owned(), limit: 0.02, reference: Some(100.0) }];
    spec.errors
        .push((ErrorSymbol::parse("exx").unwrap(), ErrorFunction { live, ..ErrorFunction::default() }));
    let model = compile(&spec);
    for (strain, x, expected) in [
        (1e-5, 600.0, 0.005),
        (1e-5, 100.0, 0.0),
        (-1e-5, -100.0, 0.002),
        (1e-4, 600.0, 0.02),
        (f64::NAN, 600.0, 0.0),
        (f64::INFINITY, 100.0, 0.0),
    ] {
        let mut at = [0.0; MAX_AXES];
        at[0] = x;
        let mut p = Pose::at(at);
        p.live[0] = strain;
        let found = model.deviation(&p).position.x;
        assert!((found - expected).abs() < 1e-15, "{strain} at {x}: {found}");
    }
}

/// Nominal tip in W from the definition, by a machine without errors whose tip is shifted: exact transforms only.
fn nominal_tip(spec: &ModelSpec, pose: &Pose) -> Vec3 {
    use volcomp::model::geometry::{rotation_about, unit};
    let mut tip = spec.tool_tip;
    for (k, axis) in spec.chain.axes().iter().enumerate().rev() {
        let q = pose.position[k];
        match axis.kind() {
            AxisKind::Linear => tip += unit(axis.name.direction()) * q,
            AxisKind::Rotary => {
                let p = spec.axis(axis.name).point;
                tip = p + rotation_about(axis.name.direction(), q) * (tip - p);
            }
        }
    }
    tip - spec.workpiece_origin
}
