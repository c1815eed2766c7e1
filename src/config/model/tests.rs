use proptest::prelude::*;

use super::*;
use volcomp_model::curve::{Chebyshev, Fourier, Grid, HalfRange, Interpolation, Live, Table};
use volcomp_model::spec::{ANGLE_LIMIT, LENGTH_LIMIT, ReferenceBody, ReferencePoint};
use volcomp_model::{AxisSpec, Curve, DynamicTerm, ErrorFunction, Law, Sense, ToolErrors};
use volcomp_units::axes::{AxisKind, AxisName, Travel};

fn write(spec: &ModelSpec, comment: &[String]) -> String {
    write_file(&ModelFile::new(spec.clone()), comment)
}

/// A model file with every kind of curve of `docs/reference/model-files.md`.
const CONTRACT: &str = r#"format = "volcomp-model/1"
machine = "vmc-850"                     # the daemon refuses a model of another machine
chain = "[w X' b Y Z t]"                # workpiece through bed to tool
[frame]
workpiece-origin-mm = [0, 0, 0]         # all geometry in M at home
tool-tip-mm = [0, 0, 0]
# gauge-point-mm = [0, 0, 0]
[axes.x]
travel-mm = [0, 500]
sense = "relative"
reference-points-mm = { x = [0,0,0], y = [0,0,0], z = [0,0,0] }
[errors.exx.table]
position-mm = [0, 10, 20]
value-um = [0, 1.5, 0.7]
interpolation = "linear"
[errors.eyx.fourier]
origin-mm = 0
span-mm = 500
period-mm = 1000
mean-um = 0.2
linear-um = 1.1
cos-um = []
sin-um = [0.5, -0.3]
[errors.eay.chebyshev]
range-mm = [0, 400]
coefficients-arcsec = [0.1, 2.0, -0.4]
[errors.ec0y.constant]
value-arcsec = -3.13
"#;

fn value(spec: &ModelSpec, symbol: &str, at: f64) -> f64 {
    let symbol = ErrorSymbol::parse(symbol).unwrap();
    let (_, function) = spec.errors.iter().find(|(s, _)| *s == symbol).unwrap();
    function.value(at, Travel::Forward)
}

#[test]
fn the_example_of_the_contract_reads_in_mm_and_rad() {
    let spec = parse("m.toml", CONTRACT).unwrap();
    assert_eq!(spec.machine, "vmc-850");
    assert_eq!(spec.chain.to_string(), "[w X' b Y Z t]");
    assert_eq!(spec.axis(AxisName::X).travel, Some([0.0, 500.0]));
    assert!((value(&spec, "exx", 15.0) - 1.1e-3).abs() < 1e-15);
    assert!((value(&spec, "eyx", 0.0) - (0.2 - 1.1) * 1e-3).abs() < 1e-15);
    let arcsec = core::f64::consts::PI / 648_000.0;
    assert!((value(&spec, "eay", 400.0) - 1.7 * arcsec).abs() < 1e-18);
    assert!((value(&spec, "ec0y", 0.0) + 3.13 * arcsec).abs() < 1e-18);
    // the order of the text stays
    let order: Vec<String> = spec.errors.iter().map(|(s, _)| s.to_string()).collect();
    assert_eq!(order, ["EXX", "EYX", "EAY", "EC0Y"]);
}

#[test]
fn byte_order_mark_and_windows_line_ends_change_nothing() {
    let windows = format!("\u{feff}{}", CONTRACT.replace('\n', "\r\n"));
    assert_eq!(parse("m.toml", &windows).unwrap(), parse("m.toml", CONTRACT).unwrap());
}

#[test]
fn several_curves_of_one_symbol_add_up_in_their_order() {
    let text = "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w b X t]\"\n\
        [[errors.exx.fourier]]\nspan-mm = 100\nperiod-mm = 10\nmean-um = 1\n\
        [errors.exx.constant]\nvalue-um = 2\n\
        [[errors.exx.fourier]]\nspan-mm = 100\nperiod-mm = 25\nmean-um = 4\n";
    let spec = parse("m.toml", text).unwrap();
    let kinds: Vec<_> = spec.errors[0].1.curves.iter().map(kind_of).collect();
    assert_eq!(kinds, ["fourier", "constant", "fourier"]);
    assert!((value(&spec, "exx", 3.0) - 7e-3).abs() < 1e-15);
    assert_eq!(parse("m.toml", &write(&spec, &[])).unwrap(), spec);
}

#[test]
fn a_grid_runs_over_the_axes_it_names() {
    let text = "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w b Y C t]\"\naxes.c.point-mm = [0, 0, 0]\n\
        [errors.eyy.grid]\naxes = [\"y\", \"c\"]\ny-mm = [0, 100]\nc-deg = [0, 90, 180]\nvalue-um = [0, 1, 2, 3, 4, 5]\n";
    let spec = parse("m.toml", text).unwrap();
    let grid = &spec.errors[0].1.grids[0];
    let (v, outside) = grid.value(&[50.0, core::f64::consts::FRAC_PI_2]);
    assert!((v - 2.5e-3).abs() < 1e-12 && !outside);
    assert_eq!(parse("m.toml", &write(&spec, &[])).unwrap(), spec);
}

#[test]
fn uncertainty_comes_from_the_error_or_from_the_file() {
    let text = "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w b X t]\"\n\
        [provenance]\nstd-um = 0.5\n[errors.exx]\nstd-um = 0.2\n[errors.exx.constant]\nvalue-um = 2\n\
        [errors.eyx.constant]\nvalue-um = 2\n[errors.eax.constant]\nvalue-arcsec = 1\n";
    let spec = parse("m.toml", text).unwrap();
    let std: Vec<Option<f64>> = spec.errors.iter().map(|(_, f)| f.std).collect();
    assert_eq!(std, [Some(2e-4), Some(5e-4), None]);
}

#[test]
fn provenance_survives_writing() {
    let mut file = parse_file("m.toml", CONTRACT).unwrap();
    file.provenance = Provenance {
        instrument: Some("laser \"A\"\n#2".into()),
        date: Some("2026-01-31".into()),
        temperature_degc: Some(20.25),
        sources: vec![
            SourceEntry {
                source: Some("a.csv".into()),
                source_hash: Some("blake3:01".into()),
                ..Default::default()
            },
            SourceEntry {
                instrument: Some("level".into()),
                date: Some("2026-02-01".into()),
                ..Default::default()
            },
        ],
        ..Provenance::default()
    };
    let symbol = ErrorSymbol::parse("eay").unwrap();
    file.of_errors = vec![(symbol, Provenance { note: Some("level".into()), ..Provenance::default() })];
    let text = write_file(&file, &["made\nby a test\u{7}".into()]);
    assert!(text.starts_with("# made\n# by a test\nformat"), "{text}");
    assert_eq!(parse_file("m.toml", &text).unwrap(), file);
}

#[test]
fn written_numbers_are_those_that_were_read() {
    let text = write(&parse("m.toml", CONTRACT).unwrap(), &[]);
    for line in [
        "value-um = [0, 1.5, 0.7]",
        "linear-um = 1.1",
        "sin-um = [0.5, -0.3]",
        "cos-um = []",
        "coefficients-arcsec = [0.1, 2, -0.4]",
        "value-arcsec = -3.13",
        "travel-mm = [0, 500]",
    ] {
        assert!(text.contains(line), "{line} not in\n{text}");
    }
}

#[test]
fn an_error_without_curves_is_zero_and_not_written() {
    let mut spec = ModelSpec::new("m", Chain::parse("[w b X t]").unwrap());
    spec.errors.push((ErrorSymbol::parse("exx").unwrap(), ErrorFunction::default()));
    assert_eq!(parse("m.toml", &write(&spec, &[])).unwrap().errors, []);
}

#[test]
fn no_text_makes_the_parser_panic() {
    for cut in 0..CONTRACT.len() {
        if let Some(head) = CONTRACT.get(..cut)
            && let Err(e) = parse("m.toml", head)
        {
            assert!(!e.diagnostics.is_empty(), "{head}");
            let _ = e.to_string();
        }
    }
}

/// All numbers of a model in a fixed order, and everything else as text.
fn flat(spec: &ModelSpec) -> (Vec<f64>, Vec<String>) {
    let (mut n, mut t) =
        (Vec::new(), vec![spec.machine.clone(), spec.chain.to_string(), format!("{:?}", spec.vertical)]);
    n.extend(spec.workpiece_origin.iter().chain(spec.tool_tip.iter()));
    n.extend(spec.gauge_point.iter().flat_map(|p| p.iter()));
    for a in &spec.axes {
        t.push(format!("{} {:?} {:?}", a.name, a.sense, a.travel.is_some()));
        n.extend(a.travel.iter().flatten());
        n.extend(a.point.iter());
        for r in &a.reference_points {
            t.push(format!("{:?}", r.body));
            n.extend(r.point.iter());
        }
    }
    for (symbol, f) in &spec.errors {
        t.push(format!("{symbol} {:?}", f.std.is_some()));
        n.extend(f.std);
        for g in &f.grids {
            t.extend(g.axes().map(|a| a.to_string()));
            t.push(g.values().len().to_string());
            n.extend((0..g.axes().len()).flat_map(|i| g.positions(i)).chain(g.values()));
        }
        for c in &f.curves {
            t.push(kind_of(c).to_owned());
            match c {
                Curve::Constant(v) => n.push(*v),
                Curve::Table(c) => {
                    let (p, v, r) = c.columns();
                    t.push(format!("{:?} {} {}", c.interpolation(), p.len(), r.is_some()));
                    n.extend(p.iter().chain(v).chain(r.unwrap_or_default()));
                }
                Curve::Fourier(c) => {
                    n.extend([
                        c.range()[0],
                        c.span(),
                        c.period(),
                        c.mean_and_linear().0,
                        c.mean_and_linear().1,
                    ]);
                    n.extend(c.harmonics().iter().flatten());
                }
                Curve::HalfRange(c) => {
                    let (mean, linear, sin) = c.coefficients();
                    n.extend(c.range().into_iter().chain([mean, linear]).chain(sin));
                }
                Curve::Chebyshev(c) => n.extend(c.range().iter().chain(c.coefficients())),
            }
        }
    }
    (n, t)
}

fn any_curve(limit: f64) -> impl Strategy<Value = Curve> {
    let v = move || -limit..limit;
    let list = move || prop::collection::vec(v(), 1..6);
    let table =
        (prop::collection::vec((0.01..50.0f64, v(), v()), 2..30), -500.0..500.0f64, any::<[bool; 2]>());
    prop_oneof![
        v().prop_map(Curve::Constant),
        table.prop_map(|(rows, start, [cubic, reverse])| {
            let positions = rows.iter().scan(start, |x, (h, _, _)| {
                *x += h;
                Some(*x)
            });
            let rule = if cubic { Interpolation::MonotoneCubic } else { Interpolation::Linear };
            let back = reverse.then(|| rows.iter().map(|r| r.2).collect());
            Curve::Table(
                Table::new(positions.collect(), rows.iter().map(|r| r.1).collect(), back, rule).unwrap(),
            )
        }),
        (-500.0..500.0f64, 0.1..900.0f64, 0.1..900.0f64, v(), v(), list(), list()).prop_map(
            |(origin, span, period, mean, linear, cos, sin)| {
                Curve::Fourier(Fourier::new(origin, span, period, mean, linear, &cos, &sin).unwrap())
            }
        ),
        (-500.0..500.0f64, 0.1..900.0f64, v(), v(), list()).prop_map(|(low, span, mean, linear, sin)| {
            Curve::HalfRange(HalfRange::new(low, low + span, mean, linear, &sin).unwrap())
        }),
        (-500.0..500.0f64, 0.1..900.0f64, list())
            .prop_map(|(low, span, c)| Curve::Chebyshev(Chebyshev::new(low, low + span, c).unwrap())),
    ]
}

/// Over the two axes that every chain of these tests has.
fn any_grid(limit: f64) -> impl Strategy<Value = Grid> {
    let edge = || prop::collection::vec(0.01..50.0f64, 2..5);
    (edge(), edge(), prop::collection::vec(-limit..limit, 16)).prop_map(|(x, y, values)| {
        let risen = |steps: Vec<f64>| -> Vec<f64> {
            let rise = |sum: &mut f64, h: f64| {
                *sum += h;
                Some(*sum)
            };
            steps.into_iter().scan(-40.0, rise).collect()
        };
        let points = x.len() * y.len();
        let axes = vec![(AxisName::Y, risen(y)), (AxisName::X, risen(x))];
        Grid::new(axes, values.into_iter().take(points).collect()).unwrap()
    })
}

fn any_axis(name: AxisName) -> impl Strategy<Value = AxisSpec> {
    let point = || prop::array::uniform3(-1e4..1e4f64).prop_map(Vec3::from);
    let reference = (point(), any::<bool>()).prop_map(|(point, bed)| ReferencePoint {
        point,
        body: if bed { ReferenceBody::Bed } else { ReferenceBody::Carriage },
    });
    (prop::option::of((-1e3..1e3f64, 0.1..1e3f64)), point(), any::<bool>(), prop::array::uniform3(reference))
        .prop_map(move |(travel, point, carriage, reference_points)| {
            let mut axis = AxisSpec::new(name);
            axis.travel = travel.map(|(low, span)| [low, low + span]);
            axis.sense = if carriage { Sense::Carriage } else { Sense::Relative };
            match name.kind() {
                AxisKind::Linear => axis.reference_points = reference_points,
                AxisKind::Rotary => axis.point = point,
            }
            axis
        })
}

/// Any error that a symbol can have, below the size taken for a unit mistake.
fn any_error(symbol: ErrorSymbol) -> impl Strategy<Value = (ErrorSymbol, ErrorFunction)> {
    // three curves of up to nine terms each, and two grids
    let limit = if symbol.is_angle() { ANGLE_LIMIT } else { LENGTH_LIMIT } / 40.0;
    let curves = if symbol.is_constant() {
        prop::collection::vec((-limit..limit).prop_map(Curve::Constant), 1..3).boxed()
    } else {
        prop::collection::vec(any_curve(limit), 1..4).boxed()
    };
    let grids = if symbol.is_constant() { 0..1 } else { 0..3usize };
    let grids = prop::collection::vec(any_grid(limit), grids);
    let sensor = prop_oneof![Just("ram".to_owned()), Just("laser \"1\"".to_owned())];
    let live =
        (sensor, 1e-9..limit, prop::option::of(-1e3..1e3)).prop_map(move |(sensor, limit, reference)| Live {
            sensor,
            limit,
            reference: reference.filter(|_| symbol.axis().kind() == AxisKind::Linear),
        });
    let live = prop::collection::vec(live, if symbol.is_constant() { 0..1 } else { 0..3usize });
    let law = prop_oneof![
        prop_oneof![Just(0.0), 1e-3..1.0f64].prop_map(|build_up| Law::Reversal { build_up }),
        (1e-4..0.1f64, 1e-4..1.0f64).prop_map(|(rise_s, fall_s)| Law::FrictionPeak { rise_s, fall_s }),
        (1e-3..1.0f64).prop_map(|speed| Law::Friction { speed }),
        Just(Law::Velocity),
        Just(Law::Acceleration),
    ];
    let term = (law, -limit..limit, prop_oneof![Just(0.0), -0.1..0.1f64], 1e-9..limit)
        .prop_map(|(law, gain, growth, limit)| DynamicTerm { law, gain, growth, limit });
    let dynamics = prop::collection::vec(term, if symbol.is_constant() { 0..1 } else { 0..3usize });
    (curves, grids, live, dynamics, prop::option::of(0.0..limit)).prop_map(
        move |(curves, grids, live, mut dynamics, std)| {
            // the file lists them law by law
            dynamics.sort_by_key(|d| match d.law {
                Law::Reversal { .. } => 0,
                Law::FrictionPeak { .. } => 1,
                Law::Friction { .. } => 2,
                Law::Velocity => 3,
                Law::Acceleration => 4,
            });
            (symbol, ErrorFunction { curves, grids, live, dynamics, std })
        },
    )
}

fn any_model() -> impl Strategy<Value = ModelSpec> {
    let chain = prop::sample::select(vec!["[w X' b Y Z t]", "[w b X Y Z C A (S) t]", "[w A' b X Y B t]"]);
    chain.prop_flat_map(|text| {
        let chain = Chain::parse(text).unwrap();
        let symbols: Vec<ErrorSymbol> =
            errors::symbols(Some(&chain)).iter().filter_map(|s| ErrorSymbol::parse(s)).collect();
        let valid = move |s: &ErrorSymbol| text.contains('Z') || s.axis() != AxisName::Z;
        let symbols: Vec<_> = symbols.into_iter().filter(valid).collect();
        let errors = prop::sample::subsequence(symbols, 0..6)
            .prop_flat_map(|s| s.into_iter().map(any_error).collect::<Vec<_>>());
        let axes: Vec<_> = chain.axes().iter().map(|a| any_axis(a.name)).collect();
        (axes, errors, prop::option::of(prop::array::uniform3(-1e3..1e3f64))).prop_map(
            move |(axes, errors, gauge)| {
                let mut spec = ModelSpec::new("any-machine", chain.clone());
                spec.gauge_point = gauge.map(Vec3::from);
                if let Some([x, y, z]) = gauge {
                    spec.vertical = Some(AxisName::Y);
                    spec.tool = ToolErrors { tilt: [x * 1e-6, y * 1e-6], length: z * 1e-6 };
                    spec.datum = spec.chain.axes().iter().map(|a| (a.name, 0.25)).collect();
                }
                spec.axes = axes;
                spec.errors = errors;
                spec
            },
        )
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn what_is_written_reads_back(spec in any_model()) {
        let text = write(&spec, &["a comment".to_owned()]);
        let back = parse("m.toml", &text).map_err(|e| TestCaseError::fail(format!("{e}\n{text}")))?;
        let ((numbers, shape), (numbers_back, shape_back)) = (flat(&spec), flat(&back));
        prop_assert_eq!(shape, shape_back);
        prop_assert_eq!(numbers.len(), numbers_back.len());
        for (a, b) in numbers.iter().zip(&numbers_back) {
            prop_assert!((a - b).abs() <= 1e-12 * a.abs(), "{} {}", a, b);
        }
    }

    #[test]
    fn random_text_never_panics(text in "[a-z0-9=\\[\\]\\.\"\n' #,{}-]{0,80}") {
        let _ = parse("m.toml", &format!("format = \"volcomp-model/1\"\n{text}")).map_err(|e| e.to_string());
    }
}

#[test]
fn a_rotary_axis_states_its_largest_correction() {
    let text = "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w b X Y Z C A t]\"\n\
        [axes.c]\npoint-mm = [0, 0, 0]\ncorrection-limit-arcsec = 600\n[axes.a]\npoint-mm = [0, 0, 300]\n";
    let spec = parse("m.toml", text).unwrap();
    let limit = |spec: &ModelSpec, name| spec.axis(name).correction_limit;
    assert_eq!(limit(&spec, AxisName::C), volcomp_units::rad_from_arcsec(600.0));
    assert_eq!(limit(&spec, AxisName::A), 1e-3);
    assert_eq!(parse("m.toml", &write(&spec, &[])).unwrap(), spec);
    for wrong in [
        text.replace("= 600", "= 0"),
        text.replace("[axes.c]", "[axes.x]\ncorrection-limit-arcsec = 9\n[axes.c]"),
    ] {
        assert!(parse("m.toml", &wrong).is_err(), "{wrong}");
    }
}
