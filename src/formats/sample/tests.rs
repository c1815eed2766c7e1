use super::*;
use proptest::prelude::*;
use volcomp_model::Chain;
use volcomp_model::curve::{Chebyshev, Fourier, Table};

const ONE_AXIS: Limits =
    Limits { format: "test", equidistant: false, points: 256, two_directions: true, decimals: 4 };

fn spec(chain: &str, errors: &[(&str, Curve)]) -> ModelSpec {
    let mut spec = ModelSpec::new("m", Chain::parse(chain).unwrap());
    spec.errors = errors
        .iter()
        .map(|(s, c)| (ErrorSymbol::parse(s).unwrap(), ErrorFunction::single(c.clone())))
        .collect();
    spec
}

fn table(x: &[f64], y: &[f64], reverse: Option<&[f64]>) -> Curve {
    Curve::Table(
        Table::new(x.to_vec(), y.to_vec(), reverse.map(<[f64]>::to_vec), Interpolation::Linear).unwrap(),
    )
}

#[test]
fn linear_tables_keep_their_points() {
    let spec =
        spec("[w b X t]", &[("exx", table(&[0.0, 7.0, 30.0], &[0.0, 1e-3, -2e-3], Some(&[1e-3, 0.0, 0.0])))]);
    let motions = Motions::new(&spec, AxisName::X, true).unwrap();
    let found = sample_axis(&motions, &[Component::X], &Sampling::default(), &ONE_AXIS).unwrap();
    assert_eq!(found.positions, [0.0, 7.0, 30.0]);
    assert_eq!(found.columns[0].forward, [0.0, 1e-3, -2e-3]);
    assert_eq!(found.columns[0].reverse.as_deref(), Some(&[1e-3, 0.0, 0.0][..]));
    assert!(found.largest_error < 1e-15);
    let one = Limits { two_directions: false, ..ONE_AXIS };
    let refused = sample_axis(&motions, &[Component::X], &Sampling::default(), &one).unwrap_err();
    assert!(matches!(refused, ExportError::TwoDirections { .. }));
    let mean = Sampling { way: Some(Way::Mean), ..Sampling::default() };
    assert_eq!(sample_axis(&motions, &[Component::X], &mean, &one).unwrap().columns[0].forward[0], 0.5e-3);
}

#[test]
fn the_carriage_sense_is_turned_into_the_relative_one() {
    let mut spec = spec("[w X' b t]", &[("exx", table(&[-30.0, 0.0], &[3e-3, 1e-3], Some(&[4e-3, 2e-3])))]);
    spec.axes.push(AxisSpec { sense: Sense::Carriage, ..AxisSpec::new(AxisName::X) });
    let motions = Motions::new(&spec, AxisName::X, true).unwrap();
    let found = sample_axis(&motions, &[Component::X], &Sampling::default(), &ONE_AXIS).unwrap();
    assert_eq!(found.positions, [0.0, 30.0]);
    // the carriage moves the other way, so the directions change places, too
    assert_eq!(found.columns[0].forward, [-2e-3, -4e-3]);
    assert_eq!(found.columns[0].reverse.as_deref(), Some(&[-1e-3, -3e-3][..]));
}

#[test]
fn a_reversal_error_goes_into_the_two_directions_as_the_model_says() {
    use volcomp_model::{Model, Pose};
    for (chain, sense) in [("[w b X t]", Sense::Relative), ("[w X' b t]", Sense::Carriage)] {
        let mut spec = spec(chain, &[("exx", table(&[-300.0, 300.0], &[0.0, 7e-3], None))]);
        spec.axes.push(AxisSpec { sense, travel: Some([0.0, 300.0]), ..AxisSpec::new(AxisName::X) });
        let term = |law, growth| DynamicTerm { law, gain: 12e-3, growth, limit: 7e-3 };
        spec.errors[0].1.dynamics =
            vec![term(Law::Reversal { build_up: 0.1 }, 1e-3), term(Law::Velocity, 0.0)];
        let model = Model::new(&spec).unwrap();
        let motions = Motions::new(&spec, AxisName::X, false).unwrap();
        let found = sample_axis(&motions, &[Component::X], &Sampling::default(), &ONE_AXIS).unwrap();
        let column = &found.columns[0];
        for (travel, values) in
            [(Travel::Forward, &column.forward), (Travel::Reverse, column.reverse.as_ref().unwrap())]
        {
            for (q, value) in found.positions.iter().zip(values) {
                let mut pose = Pose::at([*q, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
                pose.travel[0] = travel;
                let want = model.correct(&pose).0.position.x;
                assert!((value - want).abs() < 1e-12, "{chain} {q} {travel:?}: {value} instead of {want}");
            }
        }
        assert!(found.largest_error < 0.05e-3 && column.forward[0] < column.reverse.as_ref().unwrap()[0]);
        let one = Limits { two_directions: false, ..ONE_AXIS };
        let refused = sample_axis(&motions, &[Component::X], &Sampling::default(), &one).unwrap_err();
        assert!(matches!(refused, ExportError::TwoDirections { .. }));
        spec.errors[0].1 =
            ErrorFunction { dynamics: vec![term(Law::Velocity, 0.0)], ..ErrorFunction::default() };
        let nothing = sample_positioning(&spec, AxisName::X, &Sampling::default(), &ONE_AXIS).unwrap_err();
        assert!(matches!(nothing, ExportError::NoError { .. }), "{nothing}");
    }
}

#[test]
fn reference_points_are_carried_to_the_origin() {
    let mut spec = spec("[w b X t]", &[("ecx", table(&[0.0, 100.0], &[0.0, 1e-5], None))]);
    let mut axis = AxisSpec::new(AxisName::X);
    axis.reference_points[0].point = Vec3::new(0.0, 200.0, 0.0);
    spec.axes.push(axis);
    let motions = Motions::new(&spec, AxisName::X, true).unwrap();
    assert_eq!(motions.present(), [Component::X, Component::Y, Component::Z, Component::C]);
    // E0 = E - (eps x r): the x component of eps x r is -ecx * ry
    assert!((motions.value(Component::X, 100.0, &[], Way::Forward) - 2e-3).abs() < 1e-15);
    let stored = Motions::new(&spec, AxisName::X, false).unwrap();
    assert_eq!(stored.value(Component::X, 100.0, &[], Way::Forward), 0.0);
    assert_eq!(stored.present(), [Component::C]);
}

#[test]
fn too_many_points_say_what_can_be_had() {
    let waves = Curve::Fourier(Fourier::new(0.0, 1000.0, 5.0, 0.0, 0.0, &[], &[0.01]).unwrap());
    let spec = spec("[w b X t]", &[("exx", waves)]);
    let motions = Motions::new(&spec, AxisName::X, false).unwrap();
    let e = sample_axis(&motions, &[Component::X], &Sampling::default(), &ONE_AXIS).unwrap_err();
    assert!(
        matches!(e, ExportError::TooManyPoints { limit: 256, reached_um, .. } if reached_um > 5.0),
        "{e}"
    );
    let narrow = Sampling { range: Some([0.0, 20.0]), ..Sampling::default() };
    assert!(sample_axis(&motions, &[Component::X], &narrow, &ONE_AXIS).is_ok());
    let step = Sampling { step: Some(30.0), ..Sampling::default() };
    assert_eq!(sample_axis(&motions, &[Component::X], &step, &ONE_AXIS).unwrap().positions[34], 1000.0);
    let bad = Sampling { step: Some(0.0), ..Sampling::default() };
    assert!(matches!(sample_axis(&motions, &[Component::X], &bad, &ONE_AXIS), Err(ExportError::Step { .. })));
}

#[test]
fn positions_that_print_alike_are_one_and_only_the_terms_of_the_table_ask_for_them() {
    let beside = (0..400).map(f64::from).collect::<Vec<_>>();
    let mut spec = spec(
        "[w b X t]",
        &[
            ("exx", table(&[0.0, 399.99999999999994, 500.0], &[0.0, 1e-3, 2e-3], None)),
            ("eax", table(&[0.0, 400.0, 500.0], &[0.0, 1e-3, 2e-3], None)),
            ("ebx", table(&beside, &vec![1e-3; 400], None)),
        ],
    );
    let motions = Motions::new(&spec, AxisName::X, false).unwrap();
    let of = |components: &[Component]| {
        sample_axis(&motions, components, &Sampling::default(), &ONE_AXIS).map(|t| t.positions)
    };
    assert_eq!(of(&[Component::X, Component::A]).unwrap(), [0.0, 399.99999999999994, 500.0]);
    assert_eq!(of(&[Component::X]).unwrap().len(), 3);
    // more points than the format holds, on a straight line
    assert_eq!(of(&[Component::B]).unwrap(), [0.0, 500.0]);
    // a step between two such positions is no rounding
    spec.errors[0].1 =
        ErrorFunction::single(table(&[0.0, 400.0, 400.00001, 500.0], &[0.0, 0.0, 1e-3, 1e-3], None));
    let motions = Motions::new(&spec, AxisName::X, false).unwrap();
    let e = sample_axis(&motions, &[Component::X], &Sampling::default(), &ONE_AXIS).unwrap_err();
    assert!(matches!(e, ExportError::Jump { decimals: 4, reached_um, .. } if reached_um > 0.9), "{e}");
}

proptest! {
    /// The tolerance holds at points that the choice of positions has not looked at.
    #[test]
    fn lines_stay_within_the_tolerance(
        c in prop::collection::vec(-5e-3..5e-3f64, 3..9), sin in prop::collection::vec(-2e-3..2e-3f64, 1..4),
        equidistant: bool, looks in prop::collection::vec(0.0..600.0f64, 50),
    ) {
        let spec = spec("[w b X t]", &[
            ("exx", Curve::Chebyshev(Chebyshev::new(0.0, 600.0, c).unwrap())),
            ("eyx", Curve::Fourier(Fourier::new(0.0, 600.0, 250.0, 0.0, 0.0, &[], &sin).unwrap())),
        ]);
        let motions = Motions::new(&spec, AxisName::X, false).unwrap();
        let limits = Limits { points: 100_000, equidistant, ..ONE_AXIS };
        let found = sample_axis(&motions, &[Component::X, Component::Y], &Sampling::default(), &limits).unwrap();
        prop_assert!(found.largest_error <= 0.05e-3);
        for column in &found.columns {
            let line = Table::new(found.positions.clone(), column.forward.clone(), None, Interpolation::Linear).unwrap();
            for q in &looks {
                let off = line.value(*q, Travel::Forward) - motions.value(column.component, *q, &[], Way::Forward);
                prop_assert!(off.abs() <= 0.055e-3, "{off}");
            }
        }
    }
}
