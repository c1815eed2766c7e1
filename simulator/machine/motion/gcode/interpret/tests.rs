use core::f64::consts::{FRAC_PI_2, PI};

use super::*;
use crate::motion::axes::AxisSetup;

fn axes() -> MachineAxes {
    MachineAxes::new(
        [AxisName::X, AxisName::Y, AxisName::Z]
            .map(|n| AxisSetup::new(n, [-500.0, 500.0]))
            .into_iter()
            .chain([
                AxisSetup::new(AxisName::A, [-120.0, 30.0]),
                AxisSetup::new(AxisName::C, [-720.0, 720.0]),
            ])
            .collect(),
    )
    .unwrap()
}

fn run(text: &str) -> Result<Program, GcodeError> {
    interpret(text, &axes(), [0.0; 8])
}

fn arc(text: &str) -> (Segment, Arc) {
    let segment = *run(text).unwrap().segments.last().unwrap();
    match segment.shape {
        Shape::Arc(arc) => (segment, arc),
        other => panic!("no arc but {other:?}"),
    }
}

#[test]
fn absolute_and_incremental() {
    let p = run("\u{feff}G90 G1 F100 X10 Y5\r\nG91 X-3\r\n\r\nY1 C90\r\nM30\r\nX999").unwrap();
    assert_eq!(p.end, [7.0, 6.0, 0.0, 0.0, 90.0, 0.0, 0.0, 0.0]);
    assert_eq!(p.segments.iter().map(|s| s.line).collect::<Vec<_>>(), [1, 2, 4]);
}

#[test]
fn quarter_arcs_in_every_plane_and_both_senses() {
    // (text, first axis, second axis, sweep from the first towards the second)
    for (text, u, v, sweep) in [
        ("F1 G0 X10\nG17 G3 X0 Y10 I-10", 0, 1, FRAC_PI_2),
        ("F1 G0 X10\nG17 G2 X0 Y-10 I-10", 0, 1, -FRAC_PI_2),
        ("F1 G0 Z10\nG18 G3 Z0 X10 K-10", 2, 0, FRAC_PI_2),
        ("F1 G0 Z10\nG18 G2 Z0 X-10 K-10", 2, 0, -FRAC_PI_2),
        ("F1 G0 Y10\nG19 G3 Y0 Z10 J-10", 1, 2, FRAC_PI_2),
        ("F1 G0 Y10\nG19 G2 Y0 Z10 J-10", 1, 2, -3.0 * FRAC_PI_2),
    ] {
        let (segment, arc) = arc(text);
        assert_eq!(arc.plane, [u, v], "{text}");
        assert!((arc.sweep - sweep).abs() < 1e-12, "{text}: {}", arc.sweep);
        let middle = segment.point(0.5);
        assert!((middle[u].hypot(middle[v]) - 10.0).abs() < 1e-12);
        // the middle of the arc lies on the side the sense of turning says
        assert_eq!(middle[v] > 0.0, sweep > 0.0, "{text}: {middle:?}");
    }
}

#[test]
fn full_circle_by_centre_only() {
    for text in ["F1 G2 I10", "F1 G2 X0 Y0 I10 J0"] {
        let (segment, arc) = arc(text);
        assert!((arc.sweep + TAU).abs() < 1e-12);
        assert!((segment.point(0.5)[0] - 20.0).abs() < 1e-12);
    }
}

#[test]
fn radius_arcs_take_the_short_or_the_long_way() {
    let (s, a) = arc("F1 G2 X10 Y10 R10");
    assert!((a.sweep + FRAC_PI_2).abs() < 1e-9);
    assert!((a.centre[0] - 10.0).abs() < 1e-9 && a.centre[1].abs() < 1e-9, "{a:?}");
    assert!(s.point(0.5)[1] > s.point(0.5)[0]);
    let (_, a) = arc("F1 G2 X10 Y10 R-10");
    assert!((a.sweep + 3.0 * FRAC_PI_2).abs() < 1e-9);
    let (_, a) = arc("F1 G3 X10 Y10 R10");
    assert!((a.sweep - FRAC_PI_2).abs() < 1e-9);
    assert!(a.centre[0].abs() < 1e-9 && (a.centre[1] - 10.0).abs() < 1e-9);
    let (_, a) = arc("F1 G3 X20 R10");
    assert!((a.sweep.abs() - PI).abs() < 1e-6);
}

#[test]
fn helix_moves_the_third_axis() {
    let (s, _) = arc("F1 G3 X0 Y0 Z4 I5");
    assert_eq!(s.end[2], 4.0);
    assert!((s.point(0.25)[2] - 1.0).abs() < 1e-12);
}

#[test]
fn modal_motion_goes_on_and_feed_is_kept() {
    let p = run("F250 G1 X1\nY1\nF500 Z1").unwrap();
    assert_eq!(p.segments.iter().map(|s| s.feed_per_min).collect::<Vec<_>>(), [250.0, 250.0, 500.0]);
}

#[test]
fn score_marks_and_defaults() {
    let plain = run("F1 G0 X1\nG1 X2").unwrap();
    assert_eq!(plain.segments.iter().map(|s| s.scored).collect::<Vec<_>>(), [false, true]);
    let marked = run("(SCORE OFF)\nF1 G1 X1\n(SCORE ON)\nX2\n(SCORE OFF)\nX3").unwrap();
    assert_eq!(marked.segments.iter().map(|s| s.scored).collect::<Vec<_>>(), [false, true, false]);
}

#[test]
fn mistakes_name_line_column_and_remedy() {
    for (text, line, column, says) in [
        ("G1 X5", 1, 4, "no feed"),
        ("F0", 1, 1, "not above 0"),
        ("F1 G1\nG1 X1 Q5", 2, 7, "not supported"),
        ("G1 B5 F1", 1, 4, "not on this machine, which has X Y Z A C"),
        ("X5", 1, 1, "G0, G1, G2 or G3"),
        ("F1 G1 X1 X2", 1, 10, "twice"),
        ("G0 G1 X1", 1, 4, "exclude each other"),
        ("G90 G91", 1, 5, "exclude each other"),
        ("G20", 1, 1, "inch"),
        ("G54", 1, 1, "not supported"),
        ("G1.5 X1", 1, 1, "not supported"),
        ("M6", 1, 1, "not supported"),
        ("F1 G1 X501", 1, 7, "travel -500 to 500"),
        ("F1 G0 X495\nG3 X495 Y20 J10 I0", 2, 4, "axis X reaches 505"),
        ("G4", 1, 1, "without P"),
        ("G4 P1000", 1, 4, "seconds"),
        ("G4 P-1", 1, 4, "within 0"),
        ("G1 F1 X1 P2", 1, 10, "belongs to G4"),
        ("G1 F1 X1 I2", 1, 10, "belongs to G2 and G3"),
        ("F1 G2 X1", 1, 7, "without centre or radius"),
        ("F1 G2 X1 I1 R1", 1, 10, "both centre and R"),
        ("F1 G2 X1 K1", 1, 10, "does not lie in the plane"),
        ("F1 G2 X10 I4", 1, 11, "4 mm at the start and 6 mm at the end"),
        ("F1 G2 X10 R4", 1, 11, "too small"),
        ("F1 G2 R4", 1, 7, "full circle"),
        ("F1 G1 X1e400", 1, 9, "E400 is not supported"),
        ("G1 X(5) F1", 1, 4, "without a number"),
    ] {
        let e = run(text).expect_err(text);
        let message = e.to_string();
        assert_eq!((e.line, e.column), (line, column), "{text}: {message}");
        assert!(message.contains(says), "{text}: {message}");
    }
}

#[test]
fn a_machine_without_the_plane_says_so() {
    let axes = MachineAxes::new(vec![AxisSetup::new(AxisName::X, [0.0, 9.0])]).unwrap();
    let e = interpret("F1 G2 X1 R5", &axes, [0.0; 8]).unwrap_err();
    assert!(e.to_string().contains("plane XY needs axes"));
}

proptest::proptest! {
    /// Whatever the text, there is an answer; what is accepted stays within travel and can be planned.
    #[test]
    fn any_text_has_an_answer(
        text in "(F[1-9]00 )?(([GM][0-9]{1,2}|[XYZACIJKRPFSN#(/]-?[0-9]{0,3}[.]?[0-9]{0,2}|[;%\n ]|G[0-3] X[0-9]{1,2} Y[0-9] [IJR][0-9]{1,2}\n) ?){0,24}",
    ) {
        use crate::motion::{Dynamics, MotionSource, Trajectory};
        match run(&text) {
            Err(e) => proptest::prop_assert!(e.line >= 1 && e.column >= 1),
            Ok(p) => {
                let axes = axes();
                let mut t = Trajectory::new([0.0; 8], &p.segments, &axes, &Dynamics::default(), 0.01).unwrap();
                proptest::prop_assert!(t.duration_s().is_finite());
                for _ in 0..2000 {
                    let Some(c) = t.next_cycle() else { break };
                    proptest::prop_assert!(c.commanded.iter().all(|v| v.is_finite()));
                    proptest::prop_assert_eq!(axes.outside(&c.commanded), None);
                }
            }
        }
    }
}
