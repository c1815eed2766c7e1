use super::*;
use proptest::prelude::*;
use volcomp_model::curve::Chebyshev;
use volcomp_units::axes::Travel;

const GOOD: &str = "// Errors of X, measured 2020\nX EXX EYX EZX EAX EBX ECX // header\n0.0 0.02 0.01 0.07 0.00 0.0042 0.003\n\n10.0 0.00 -0.1 0.01 0.00 0.0011 0.002\n#\nY0C C0Y A0Z P0Z\n0.1 1e-5 -2e-5 120\n# sag\nZ Y EZY\n0 0 0.001\n0 100 0.002\n100 0 0.003\n100 100 0.005\n";

fn chain(text: &str) -> Chain {
    Chain::parse(text).unwrap()
}

fn read(text: &str) -> Result<Tables, FormatError> {
    parse(text, &chain("[w C' b X Y Z t]"), None)
}

fn of<'a>(tables: &'a Tables, name: &str) -> &'a ErrorFunction {
    let symbol = ErrorSymbol::parse(name).unwrap();
    &tables.errors.iter().find(|(s, _)| *s == symbol).unwrap().1
}

#[test]
fn blocks_constants_and_grids() {
    let tables = read(GOOD).unwrap();
    assert!(recognises(GOOD) && !recognises("cycle,direction,target_mm\n1,1,0\n") && !recognises("0 1 2\n"));
    assert_eq!(tables.errors.len(), 10);
    assert_eq!(tables.kinematics, ["P0Z"]);
    assert_eq!(of(&tables, "ebx").value(0.0, Travel::Forward), 0.0042);
    assert!((of(&tables, "eyx").value(5.0, Travel::Forward) + 0.045).abs() < 1e-15);
    assert_eq!(of(&tables, "ec0y").curves, [Curve::Constant(1e-5)]);
    assert_eq!(of(&tables, "ey0c").curves, [Curve::Constant(0.1)]);
    assert_eq!(of(&tables, "ezy").grids[0].value(&[50.0, 50.0]).0, 0.00275);
}

#[test]
fn rows_of_a_grid_in_any_order_and_in_several_blocks() {
    let shuffled = "Z Y EZY\n100 100 5\n0 0 1\n#\nZ Y EZY\n100 0 3\n0 100 2\n";
    let sorted = "Z Y EZY\n0 0 1\n0 100 2\n100 0 3\n100 100 5\n";
    assert_eq!(read(shuffled).unwrap(), read(sorted).unwrap());
    let negative = read("X EXX\n10 1\n-10 2\n-0 3\n").unwrap();
    let Curve::Table(table) = &of(&negative, "exx").curves[0] else { panic!() };
    assert_eq!(table.columns().0, [-10.0, 0.0, 10.0]);
}

#[test]
fn the_body_has_to_be_stated_on_the_workpiece_side() {
    let text = "X EXX ECX\n0 1 2e-3\n10 3 4e-3\n#\nC0Y\n1e-5\n";
    let table_side = chain("[w X' b Y Z t]");
    let e = parse(text, &table_side, None).unwrap_err().to_string();
    assert!(e.starts_with("1:3: the file does not say whose motion"), "{e}");
    let carriage = parse(text, &table_side, Some(Body::Carriage)).unwrap();
    assert_eq!(of(&carriage, "ecx").value(10.0, Travel::Forward), -4e-3);
    assert_eq!(of(&carriage, "ec0y").value(0.0, Travel::Forward), 1e-5);
    let relative = parse(text, &table_side, Some(Body::Relative)).unwrap();
    assert_eq!(of(&relative, "exx").value(0.0, Travel::Forward), 1.0);
}

#[test]
fn mistakes_name_their_place() {
    for (text, expected) in [
        ("", "1:1: a column with an error such as EXX or C0Y is missing"),
        ("X EXX\n", "1:1: a row below this header is missing"),
        ("X EXX\n0 0\n#\nY EYY\n# more\n", "4:1: a row below this header is missing"),
        ("X EXX\n0 0 1\n", "2:5: columns: 2 announced, 3 found"),
        ("X EXX\n 0\n", "2:2: columns: 2 announced, 1 found"),
        ("X EXX\n0 0,1\n", "2:3: '0,1' is not a finite number"),
        ("X EXX\n0 0\n1 7.5\n", "3:3: 7.5 is larger than any error of a machine (5 mm)"),
        ("X EXX\n0 1e31\n", "2:3: '1e31' is not a finite number up to 1e30"),
        ("X EXX\n0 inf\n", "2:3: 'inf' is not a finite number"),
        ("X EXQ\n", "1:3: found 'EXQ', expected a column such as"),
        ("X EXX EXX\n", "1:7: column EXX was given before"),
        ("X Y\n0 0\n", "1:1: found 'X Y', expected a header with at least one error"),
        ("X EXX\n0 1\n0.0 2\n", "3:1: EXX at these arguments was given before, on line 2"),
        ("VXX\n1\n", "VXX is not read: the model has no place for it"),
        ("X0X\n1\n", "X0X is not read"),
        ("X C0Y\n0 1\n", "C0Y is not read: a position error that depends on an axis"),
        ("Y EXX\n0 1\n", "EXX is not read: a component error over another axis alone"),
        ("A EXA\n0 1\n", "1:1: A is not read: its axis is not in the chain"),
        ("C0Y\n0\n2\n", "3:1: found '2', expected one row only"),
        ("X EXX\n0 1\n#\nX Y EXX\n0 0 1\n", "EXX is not read: it was given before with other arguments"),
        ("X Y EXX\n0 0 1\n0 1 1\n1 1 1\n", "1:1: combinations of arguments"),
        ("X Y EXX\n0 0 1\n0 1 1\n", "1:1: a table needs at least 2 positions"),
    ] {
        let message = read(text).unwrap_err().to_string();
        let expected = expected
            .replace("1:1: combinations", "2:1: combinations")
            .replace("1:1: a table", "2:1: a table");
        assert!(message.contains(&expected), "{text:?} gives {message:?}");
    }
}

fn spec(text: &str, chain_text: &str) -> ModelSpec {
    let mut spec = ModelSpec::new("m", chain(chain_text));
    spec.errors = parse(text, &spec.chain, Some(Body::Relative)).unwrap().errors;
    spec
}

#[test]
fn what_is_written_reads_back() {
    let first = spec(GOOD, "[w C' b X Y Z t]");
    for body in [Body::Relative, Body::Carriage] {
        let (text, report) = write(&first, &[], Some(body), &Sampling::default()).unwrap();
        let back = parse(&text, &first.chain, Some(body)).unwrap();
        assert_eq!(
            back.errors,
            {
                let mut e = first.errors.clone();
                e.sort_by_key(|(s, _)| *s);
                e
            },
            "{text}"
        );
        assert_eq!((report.blocks.len(), report.constants), (2, 3));
        assert!(report.blocks.iter().all(|b| b.2 < 1e-12));
    }
}

#[test]
fn what_the_format_cannot_hold_is_refused() {
    let mut two_way = spec("X EXX\n0 0\n10 0\n", "[w b X Y Z t]");
    let table =
        Table::new(vec![0.0, 10.0], vec![0.0, 1.0], Some(vec![1.0, 2.0]), Interpolation::Linear).unwrap();
    two_way.errors[0].1 = ErrorFunction::single(Curve::Table(table));
    let refused = |spec: &ModelSpec, body| write(spec, &[], body, &Sampling::default()).unwrap_err();
    assert!(matches!(refused(&two_way, None), ExportError::TwoDirections { .. }));
    let mean = Sampling { way: Some(Way::Mean), ..Sampling::default() };
    assert!(write(&two_way, &[], None, &mean).unwrap().0.contains("\n10.0 1.5\n"));
    let table_side = spec("X EXX\n0 0\n10 0\n", "[w X' b Y Z t]");
    assert_eq!(refused(&table_side, None), ExportError::SenseNotStated { axis: AxisName::X });
    let empty = ModelSpec::new("m", chain("[w b X t]"));
    assert!(matches!(refused(&empty, None), ExportError::NoError { .. }));
    let axis_u = ModelSpec::new("m", chain("[w b U t]"));
    assert!(matches!(refused(&axis_u, None), ExportError::NoSuchAxis { .. }));
}

proptest! {
    #[test]
    fn the_order_of_coordinates_survives(a in prop::num::f64::NORMAL, b in prop::num::f64::NORMAL) {
        prop_assert_eq!(ordered(a).cmp(&ordered(b)), a.partial_cmp(&b).unwrap());
        prop_assert_eq!(unordered(ordered(a)), a);
    }

    /// A model of smooth curves, written and read, stays within the tolerance.
    #[test]
    fn smooth_curves_survive(c in prop::collection::vec(-5e-3..5e-3f64, 2..8), turn in -1e-5..1e-5f64, q in -100.0..300.0f64) {
        let mut model = ModelSpec::new("m", chain("[w X' b Y Z t]"));
        let put = |name: &str, curve| (ErrorSymbol::parse(name).unwrap(), ErrorFunction::single(curve));
        model.errors = vec![
            put("exx", Curve::Chebyshev(Chebyshev::new(-100.0, 300.0, c).unwrap())),
            put("ecx", Curve::Chebyshev(Chebyshev::new(-100.0, 300.0, vec![0.0, turn]).unwrap())),
        ];
        let (text, report) = write(&model, &[], Some(Body::Carriage), &Sampling::default()).unwrap();
        prop_assert!(report.blocks[0].2 <= 0.05e-3);
        let back = parse(&text, &model.chain, Some(Body::Carriage)).unwrap();
        for ((_, f), (_, b)) in model.errors.iter().zip(&back.errors) {
            prop_assert!((f.value(q, Travel::Forward) - b.value(q, Travel::Forward)).abs() < 0.055e-3);
        }
    }

    #[test]
    fn damaged_files_never_panic(at in 0..GOOD.len(), with in "[A-Z0-9#/.\\-e \n]{0,6}", cut in 0usize..9) {
        let end = (at + cut).min(GOOD.len());
        let text = format!("{}{with}{}", &GOOD[..at], &GOOD[end..]);
        let _ = read(&text);
        let _ = recognises(&text);
    }
}
