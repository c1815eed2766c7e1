use super::*;
use volcomp_model::curve::{Interpolation, Table};
use volcomp_model::{Chain, Curve, ErrorFunction, ErrorSymbol, ModelSpec};

/// A machine whose EYX is a bow of 10 um in the middle of 100 mm, and whose EZX nobody can correct.
fn model(chain: &str) -> Model {
    let mut spec = ModelSpec::new("m", Chain::parse(chain).unwrap());
    spec.tool_tip = Vec3::new(0.0, 20.0, 50.0);
    let table = |values: Vec<f64>| {
        let at = (0..values.len()).map(|i| 100.0 * i as f64 / (values.len() - 1) as f64).collect();
        ErrorFunction::single(Curve::Table(Table::new(at, values, None, Interpolation::Linear).unwrap()))
    };
    let bow: Vec<f64> = (0..=50u32).map(|i| 0.01 * (1.0 - (f64::from(i) / 25.0 - 1.0).powi(2))).collect();
    for (symbol, values) in [("eyx", bow), ("ezx", vec![0.0, 0.003])] {
        spec.errors.push((ErrorSymbol::parse(symbol).unwrap(), table(values)));
    }
    spec.axes.push(volcomp_model::AxisSpec {
        travel: Some([0.0, 100.0]),
        ..volcomp_model::AxisSpec::new(AxisName::X)
    });
    Model::new(&spec).unwrap()
}

fn request(model: &Model) -> Request<'_> {
    Request {
        model,
        corrected: [true; MAX_AXES],
        start: [None; MAX_AXES],
        work_offset: [0.0; MAX_AXES],
        tolerance: [2e-4, 1e-6],
        limit: [0.2, 1e-3],
    }
}

/// Positions of the axes after every line with motion.
fn positions(text: &str, axes: &str) -> Vec<Vec<f64>> {
    let mut at = vec![0.0; axes.len()];
    let mut out = Vec::new();
    for line in text.lines() {
        let mut moved = false;
        for w in words(line).unwrap() {
            if let Some(k) = axes.find(w.letter) {
                at[k] = w.value;
                moved = true;
            }
        }
        if moved {
            out.push(at.clone());
        }
    }
    out
}

const PROGRAM: &str = "%\n(part 1, X99)\nN10 G21 G90 G54 ; start\nG0 X0 Y0 A0 M8\nN20 g1 x100.0 F500 (cut)\nG4 P0.5\nX50\nM30\n";

#[test]
fn every_position_is_nominal_minus_deviation_and_blocks_follow_the_bow() {
    let model = model("[w A' b X Y t]");
    let out = correct(PROGRAM, &request(&model)).unwrap();
    for kept in
        ["%\n(part 1, X99)\nN10 G21 G90 G54 ; start\n", " M8\n", " F500 (cut)\n", "\nG4 P0.5\n", "\nM30\n"]
    {
        assert!(out.text.contains(kept), "{kept:?} in\n{}", out.text);
    }
    let places = positions(&out.text, "XYA");
    assert_eq!(places.len(), out.blocks_out);
    assert_eq!(out.blocks, 3);
    // a bow of 10 um over 100 mm leaves its chord by 10/n^2 um
    assert!((8..=17).contains(&(out.blocks_out - 2)), "{} blocks", out.blocks_out);
    for place in &places {
        let nominal = 0.01 * (1.0 - (place[0] / 50.0 - 1.0).powi(2));
        assert!((place[1] + nominal).abs() < 2e-4, "{place:?}");
        assert!(place[0] >= 0.0 && place[2] == 0.0);
    }
    assert!((out.largest[2] - 0.01).abs() < 1e-5);
    assert!((out.rest[2] - 0.003).abs() < 1e-9 && out.rest[0] < 1e-9, "{:?}", out.rest);
    assert_eq!(out.rest_line, 5);
}

#[test]
fn an_axis_that_is_left_alone_shows_in_the_rest() {
    let model = model("[w b X Y Z t]");
    let all = correct("G0 X50 Y0 Z0\n", &request(&model)).unwrap();
    assert!(
        all.rest.max() < 1e-12 && all.text.starts_with("G0 X50.000000 Y-0.010000 Z-0.001500\n"),
        "{}",
        all.text
    );
    let mut request = request(&model);
    request.corrected[1] = false;
    let some = correct("G0 X50 Y0 Z0", &request).unwrap();
    assert!((some.rest[1] - 0.01).abs() < 1e-12, "{:?}", some.rest);
    request.work_offset[0] = 50.0;
    request.start = [None, Some(0.0), Some(0.0), None, None, None, None, None];
    assert_eq!(correct("G0 X0", &request).unwrap().text, "G0 X0.000000 Z-0.001500");
}

#[test]
fn what_is_not_corrected_is_refused_with_line_and_remedy() {
    let model = model("[w A' b X Y t]");
    let start = "G0 X1 Y1 A1\n";
    for (text, line, column, said) in [
        ("G2 X1 Y1 I1", 2, 1, "arc"),
        ("G1 F1\nG91 X1", 3, 1, "incremental"),
        ("G41 D1 X1", 2, 1, "cutter compensation"),
        ("G81 X1", 2, 1, "canned cycle"),
        ("G43.4 H1", 2, 1, "tool-centre-point"),
        ("G92 X0", 2, 1, "set position"),
        ("G20", 2, 1, "inch"),
        ("G123", 2, 1, "not known"),
        ("X#1", 2, 1, "number"),
        ("#1=5", 2, 1, "variables"),
        ("/X1", 2, 1, "block delete"),
        ("M98 P1", 2, 1, "subprogram"),
        ("O100", 2, 1, "subprograms"),
        ("G54\nG55", 3, 1, "second work offset"),
        ("T1 M6\nT1 M6\nT2 M6", 4, 4, "second tool"),
        ("Z1", 2, 1, "not in the chain"),
        ("X1 X2", 2, 1, "twice"),
        ("G4 X1", 2, 1, "dwell"),
        ("X120", 2, 1, "travel 0 to 100 mm"),
        ("G1 F100 X99 M5", 2, 13, "M word"),
        ("X1e-05", 2, 1, "exponent"),
        ("G1 F1\nY2 X1E2", 3, 4, "exponent"),
        ("L200", 2, 1, "L200 (subprogram)"),
        ("N20 L200 P3", 2, 5, "subprogram"),
        ("T0101\nT0101\nT0202", 4, 1, "second tool"),
        ("G54 P1", 2, 5, "additional work offset"),
        ("(open", 2, 1, "comment without end"),
    ] {
        let error = correct(&format!("{start}{text}\n"), &request(&model)).unwrap_err();
        assert_eq!((error.line, error.column), (line, column), "{text}: {error}");
        assert!(error.what.contains(said), "{text}: {error}");
    }
    for passed in ["T1 M6\nT2", "T2\nT1 M6", "T0101", "G54 G4 P0.5", "G54\nG64 P0.01", "G1 X1 F1 E2"] {
        assert!(correct(&format!("{start}{passed}\n"), &request(&model)).is_ok(), "{passed}");
    }
    let unknown = correct("G0 X1 Y1", &request(&model)).unwrap_err();
    assert!(
        unknown.what.contains("position of axis A is unknown here") && unknown.what.contains("--start a=")
    );
    assert!(correct("X1 Y1 A1", &request(&model)).unwrap_err().what.contains("before G0 or G1"));
    let narrow = Request { limit: [5e-3, 1e-3], ..request(&model) };
    let error = correct("G0 X50 Y0 A0", &narrow).unwrap_err();
    assert!(error.what.contains("correction of Y at 0 mm is -10.0 µm, limit 5.0 µm"), "{error}");
}

#[test]
fn a_byte_order_mark_is_kept() {
    let model = model("[w b X Y t]");
    let out = correct("\u{feff}G0 X0 Y0\r\n", &request(&model)).unwrap();
    assert_eq!(out.text, "\u{feff}G0 X0.000000 Y0.000000\r\n");
    assert_eq!(correct("\u{feff}G2 X0", &request(&model)).unwrap_err().column, 1);
}

#[test]
fn the_remedy_against_many_parts_names_axis_and_tolerance() {
    let step = ErrorFunction::single(Curve::Table(
        Table::new(
            vec![0.0, 50.0, 50.0 + 1e-9, 100.0],
            vec![0.0, 0.0, 1e-4, 1e-4],
            None,
            Interpolation::Linear,
        )
        .unwrap(),
    ));
    for (symbol, said) in
        [("eax", "of A; enlarge --tolerance-arcsec"), ("eyx", "of Y; enlarge --tolerance-um")]
    {
        let mut spec = ModelSpec::new("m", Chain::parse("[w A' b X Y Z t]").unwrap());
        spec.errors.push((ErrorSymbol::parse(symbol).unwrap(), step.clone()));
        let model = Model::new(&spec).unwrap();
        let request = Request { tolerance: [1e-5, 1e-6], ..request(&model) };
        let error = correct("G0 X1 Y0 Z0 A0\nG1 X99 F1\n", &request).unwrap_err();
        assert!(error.what.contains(said), "{error}");
    }
}

/// A machine whose X stands 8 um further after travel in the negative direction.
fn with_reversal() -> Model {
    let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y t]").unwrap());
    let table = Table::new(vec![0.0, 100.0], vec![0.0; 2], Some(vec![0.008; 2]), Interpolation::Linear);
    let exx = ErrorFunction::single(Curve::Table(table.unwrap()));
    spec.errors.push((ErrorSymbol::parse("exx").unwrap(), exx));
    Model::new(&spec).unwrap()
}

#[test]
fn a_feed_block_behind_a_reversal_begins_where_it_is() {
    let model = with_reversal();
    let text = "G0 X10 Y0\r\nN1 G1 X50 F500\r\nN2 F200 X20 M8 (back)\r\nN3 Y5\r\nX30\r\nG0 X5\r\nG1 X1";
    let out = correct(text, &request(&model)).unwrap();
    let wanted = "G0 X10.000000 Y0.000000\r\nN1 G1 X50.000000 Y0.000000 F500\r\n\
                  F200 X49.992000 Y0.000000\r\nN2 F200 X19.992000 Y0.000000 M8 (back)\r\nN3 Y5.000000 X19.992000\r\n\
                  X20.000000 Y5.000000\r\nX30.000000 Y5.000000\r\nG0 X4.992000 Y5.000000\r\nG1 X0.992000 Y5.000000";
    assert_eq!(out.text, wanted);
    assert_eq!((out.blocks, out.blocks_out), (7, 9));
    // what is within the tolerance needs no block
    let wide = Request { tolerance: [0.01, 1e-6], ..request(&model) };
    assert_eq!(correct(text, &wide).unwrap().blocks_out, 7);
}
