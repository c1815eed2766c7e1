use proptest::prelude::*;

use super::*;
use crate::axes::Travel;
use crate::curve::{Curve, ErrorFunction, Fourier, Grid, Interpolation, Table};
use crate::{AxisSpec, ErrorSymbol, normalise};

fn spec(chain: &str) -> ModelSpec {
    let mut spec = ModelSpec::new("m", Chain::parse(chain).unwrap());
    spec.tool_tip = Vec3::new(10.0, -20.0, -150.0);
    for axis in spec.chain.clone().axes().iter().filter(|a| !a.spindle) {
        let travel = if axis.kind() == crate::axes::AxisKind::Rotary { [-1.0, 1.5] } else { [-50.0, 400.0] };
        spec.axes.push(AxisSpec {
            travel: Some(travel),
            point: Vec3::new(3.0, 5.0, -7.0),
            ..AxisSpec::new(axis.name)
        });
    }
    spec
}

fn set(spec: &mut ModelSpec, symbol: &str, curve: Curve) {
    spec.errors.push((ErrorSymbol::parse(symbol).unwrap(), ErrorFunction::single(curve)));
}

fn quiet(a: &ModelSpec, b: &ModelSpec) -> Comparison {
    compare(a, b, |_, _| {}).unwrap()
}

#[test]
fn a_model_is_the_same_as_itself() {
    let mut a = spec("[w X' b Y Z t]");
    set(&mut a, "exx", Curve::Fourier(Fourier::new(0.0, 400.0, 37.0, 0.0, 0.001, &[], &[0.005]).unwrap()));
    let same = quiet(&a, &a);
    assert!(same.is_same());
    let volume = same.volume.unwrap();
    assert_eq!((volume.position.position.norm(), volume.rms_position), (0.0, 0.0));
    assert_eq!((volume.bound_position, volume.bound_rotation), (Some(0.0), Some(0.0)));
}

#[test]
fn a_yaw_is_seen_with_its_lever() {
    let a = spec("[w b X Y Z t]");
    let mut b = a.clone();
    set(
        &mut b,
        "ecx",
        Curve::Table(Table::new(vec![-50.0, 400.0], vec![0.0, 20e-6], None, Interpolation::Linear).unwrap()),
    );
    let found = quiet(&a, &b);
    let [error] = &found.errors[..] else { panic!("{found:?}") };
    assert_eq!((error.largest, error.at, error.stated), (20e-6, 400.0, [false, true]));
    let volume = found.volume.unwrap();
    // lever in x and y: tip (10, -20) and 400 of Y; the X axis itself is not part of it
    let expected = 20e-6 * 10f64.hypot(380.0);
    assert!((volume.position.position.norm() - expected).abs() < 1e-12, "{volume:?}");
    assert!((volume.rotation.rotation.z - 20e-6).abs() < 1e-15);
    assert!(volume.bound_position.unwrap() >= expected && volume.bound_position.unwrap() < 1.8 * expected);
    assert!((volume.offsets[0].unwrap().offset[0] - 20e-6 * 380.0).abs() < 1e-12);
}

#[test]
fn a_spike_between_the_places_of_the_search_is_bounded() {
    let mut a = spec("[w b X Y Z t]");
    let mut b = a.clone();
    let spike = |height: f64| {
        let x = vec![-50.0, 123.4, 123.45, 123.5, 400.0];
        Curve::Table(Table::new(x, vec![0.0, 0.0, height, 0.0, 0.0], None, Interpolation::Linear).unwrap())
    };
    set(&mut a, "exx", spike(0.0));
    set(&mut b, "exx", spike(0.05));
    let found = quiet(&a, &b);
    assert!((found.errors[0].largest - 0.05).abs() < 1e-15);
    assert!(found.volume.unwrap().bound_position.unwrap() >= 0.05);
}

#[test]
fn a_rigid_motion_of_the_workpiece_is_told_apart() {
    let mut a = spec("[w b X Y Z t]");
    set(&mut a, "exx", Curve::Constant(0.004));
    let table = Table::new(vec![-50.0, 400.0], vec![0.0, 0.009], None, Interpolation::Linear).unwrap();
    set(&mut a, "eyx", Curve::Table(table));
    let b = normalise(&a).unwrap().spec;
    let volume = quiet(&a, &b).volume.unwrap();
    assert!(volume.position.position.norm() > 0.004);
    assert!(volume.without_rigid.without_rigid.norm() < 1e-9, "{volume:?}");
    assert!(volume.rms_without_rigid < 1e-9 && volume.rms_position > 0.004);
}

#[test]
fn another_vertical_axis_is_a_change_that_moves_nothing() {
    let a = spec("[w X' b Y Z t]");
    let b = ModelSpec { vertical: Some(AxisName::Y), ..a.clone() };
    let found = quiet(&a, &b);
    assert!(!found.is_same());
    assert!(matches!(found.changes[..], [Change::Vertical([None, Some(AxisName::Y)])]), "{found:?}");
    assert!(found.volume.unwrap().position.position.norm() == 0.0);
}

#[test]
fn the_sense_of_an_axis_is_no_difference_of_what_it_says() {
    let mut a = spec("[w X' b Y Z t]");
    let mut b = a.clone();
    let table = |v: [f64; 2], x: [f64; 2]| {
        Curve::Table(Table::new(x.to_vec(), v.to_vec(), None, Interpolation::Linear).unwrap())
    };
    set(&mut a, "exx", table([0.001, 0.002], [-50.0, 400.0]));
    set(&mut b, "exx", table([-0.002, -0.001], [-400.0, 50.0]));
    b.axes[0].sense = Sense::Carriage;
    let found = quiet(&a, &b);
    assert!(found.errors.is_empty(), "{found:?}");
    assert!(matches!(found.changes[..], [Change::Sense { axis: AxisName::X, .. }]));
    assert!(found.volume.unwrap().position.position.norm() < 1e-12);
}

#[test]
fn chains_with_other_axes_cannot_be_compared_in_the_volume() {
    let found = quiet(&spec("[w b X Y Z t]"), &spec("[w b X Y Z C t]"));
    assert!(found.volume.is_none() && matches!(found.changes[0], Change::Chain(_)));
    // the same axes in another order can
    let found = quiet(&spec("[w b X Y Z t]"), &spec("[w X' b Y Z t]"));
    assert!(found.volume.is_some_and(|v| v.bound_position.is_none()));
}

#[test]
fn both_directions_of_travel_are_compared() {
    let a = spec("[w b X Y Z t]");
    let mut b = a.clone();
    let table = Table::new(vec![-50.0, 400.0], vec![0.001; 2], Some(vec![-0.003; 2]), Interpolation::Linear);
    set(&mut b, "exx", Curve::Table(table.unwrap()));
    let found = quiet(&a, &b);
    assert_eq!((found.errors[0].largest, found.errors[0].travel), (-0.003, Travel::Reverse));
    assert_eq!(found.volume.unwrap().position.pose.travel[0], Travel::Reverse);
}

#[test]
fn without_travel_the_range_of_the_data_is_compared() {
    let mut a = spec("[w X' b Y Z t]");
    for axis in &mut a.axes {
        axis.travel = None;
    }
    let mut b = a.clone();
    let table = |x: f64, v: f64| {
        Curve::Table(Table::new(vec![0.0, x], vec![0.0, v], None, Interpolation::Linear).unwrap())
    };
    set(&mut a, "exx", table(300.0, 0.0));
    // 60 um at the end of the longer curve of the second model, nothing at home
    set(&mut b, "exx", table(500.0, 0.06));
    let found = quiet(&a, &b);
    assert_eq!(
        (found.errors[0].largest, found.errors[0].at, found.errors[0].over),
        (0.06, 500.0, Some([0.0, 500.0]))
    );
    let volume = found.volume.unwrap();
    assert_eq!(volume.ranges, [[0.0, 500.0], [0.0; 2], [0.0; 2]]);
    assert!((volume.position.position.norm() - 0.06).abs() < 1e-12, "{volume:?}");
    assert!(volume.bound_position.unwrap() >= 0.06);
    // positions of a carriage count the other way
    for spec in [&mut a, &mut b] {
        spec.axes[0].sense = Sense::Carriage;
    }
    assert_eq!(quiet(&a, &b).volume.unwrap().ranges[0], [-500.0, 0.0]);
}

#[test]
fn without_travel_the_range_of_a_grid_is_compared() {
    let mut a = spec("[w X' b Y Z t]");
    a.axes.clear();
    let mut b = a.clone();
    let grid = Grid::new(
        vec![(AxisName::X, vec![0.0, 400.0]), (AxisName::Y, vec![0.0, 300.0])],
        vec![0.0, 0.0, 0.0, 0.03],
    )
    .unwrap();
    let function = ErrorFunction { grids: vec![grid], ..ErrorFunction::default() };
    b.errors.push((ErrorSymbol::parse("ezx").unwrap(), function));
    let volume = quiet(&a, &b).volume.unwrap();
    assert_eq!(volume.ranges[..2], [[0.0, 400.0], [0.0, 300.0]]);
    assert!((volume.position.position.norm() - 0.03).abs() < 1e-12, "{volume:?}");
}

#[test]
fn terms_that_the_search_does_not_see_count_by_their_limits() {
    let base = spec("[w b X Y Z C (S) t]");
    let live = |sensor: &str, limit: f64| {
        let live = vec![crate::curve::Live { sensor: sensor.to_owned(), limit, reference: None }];
        ErrorFunction { live, ..ErrorFunction::default() }
    };
    let velocity = |gain: f64, limit: f64| {
        let law = crate::Law::Velocity;
        let dynamics = vec![crate::DynamicTerm { law, gain, growth: 0.0, limit }];
        ErrorFunction { dynamics, ..ErrorFunction::default() }
    };
    for (symbol, a, b, expected) in [
        ("exx", live("a", 0.08), live("a", 0.08), None),
        ("exx", live("a", 0.08), live("a", 0.008), Some(0.072)),
        ("exx", live("a", 0.08), live("b", 0.08), Some(0.16)),
        ("exx", ErrorFunction::default(), live("a", 0.08), Some(0.08)),
        ("exx", velocity(-0.004, 0.15), velocity(-0.004, 0.15), None),
        ("exx", velocity(-0.004, 0.15), velocity(-0.04, 0.15), Some(0.3)),
        ("ecx", ErrorFunction::default(), velocity(1e-6, 1e-5), Some(1e-5)),
    ] {
        let symbol = ErrorSymbol::parse(symbol).unwrap();
        let with = |f: &ErrorFunction| ModelSpec { errors: vec![(symbol, f.clone())], ..base.clone() };
        let found = quiet(&with(&a), &with(&b));
        let listed = found.errors.first().map(|e| e.unsearched);
        assert!(
            listed.zip(expected).is_none_or(|(a, b)| (a - b).abs() < 1e-12)
                && listed.is_some() == expected.is_some(),
            "{symbol} {listed:?} {expected:?}"
        );
        let [position, rotation] = found.unsearched;
        let expected = expected.unwrap_or_default();
        if symbol.is_angle() {
            assert!(position > 1000.0 * expected && rotation == expected, "{:?}", found.unsearched);
        } else {
            assert!((position - expected).abs() < 1e-12 && rotation == 0.0, "{:?}", found.unsearched);
        }
    }
    let mut limited = base.clone();
    limited.axis_mut(AxisName::C).correction_limit = 15e-6;
    let found = quiet(&base, &limited);
    assert!(matches!(found.changes[..], [Change::CorrectionLimit { axis: AxisName::C, .. }]), "{found:?}");
    assert_eq!(found.volume.unwrap().bound_position, Some(0.0));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    /// The bound holds at every pose, and the largest difference found is attained.
    #[test]
    fn the_bound_is_never_exceeded(
        chain in prop::sample::select(vec!["[w X' b Y Z t]", "[w b X Y Z C A (S) t]", "[w C' A' b X Y Z t]", "[w A' b X Y B t]"]),
        values in prop::collection::vec(-1.0..1.0f64, 64),
        shares in prop::collection::vec(0.0..1.0f64, 8),
    ) {
        let a = spec(chain);
        let mut b = a.clone();
        let mut next = values.iter().cycle();
        let mut draw = || next.next().copied().unwrap_or_default();
        for axis in a.chain.axes().iter().filter(|x| !x.spindle) {
            let [low, high] = a.axis(axis.name).travel.unwrap();
            for component in Component::ALL {
                let size = if component.is_angle() { 50e-6 } else { 0.02 };
                let wave = Fourier::new(low, high - low, (high - low) * 0.7, draw() * size, draw() * size, &[draw() * size], &[draw() * size]);
                b.errors.push((ErrorSymbol::Motion { component, axis: axis.name }, ErrorFunction::single(Curve::Fourier(wave.unwrap()))));
            }
        }
        let found = quiet(&a, &b).volume.unwrap();
        let model = Model::new(&b).unwrap();
        let mut pose = super::super::Pose::at([0.0; crate::axes::MAX_AXES]);
        for (k, range) in found.ranges.iter().enumerate() {
            pose.position[k] = range[0] + shares[k] * (range[1] - range[0]);
        }
        let e = model.deviation(&pose);
        prop_assert!(e.position.norm() <= found.bound_position.unwrap());
        prop_assert!(e.rotation.norm() <= found.bound_rotation.unwrap());
        let there = model.deviation(&found.position.pose);
        prop_assert!((there.position - found.position.position).norm() < 1e-12);
        prop_assert!(e.position.norm() <= found.position.position.norm() * 1.05);
    }
}
