//! Files that are recognised and hold nothing that a diagnosis can use: each with the reason and a way on.

use crate::prelude::*;
use volcomp_formats::detect::Format;
use volcomp_formats::{b5r, text};

/// The refusal of a file whose format is known.
pub(super) fn format(path: &Path, format: Format) -> Failure {
    let file = path.display();
    let (what, remedy) = match format {
        Format::B5r => return ballbar_figures(path),
        Format::Rtx => (
            "a dynamic laser test (.rtx): displacement over time without the commanded positions".to_owned(),
            format!(
                "read it with volcomp import {file} --out FILE.csv and write the commanded positions beside it as a session file"
            ),
        ),
        Format::Camonitor => (
            "an EPICS camonitor log: values without their meaning".to_owned(),
            format!(
                "read it with volcomp import {file} --out FILE.csv and write target and deviation as cycle,direction,target_mm,deviation_um"
            ),
        ),
        Format::Isg | Format::IsgLis | Format::Heidenhain => (
            "a compensation table of a control, not a measurement".to_owned(),
            format!("read it with volcomp import {file} --out model.toml and give that as --model"),
        ),
        // read as sessions
        _ => ("no session".to_owned(), "write a session file".to_owned()),
    };
    data!(path, "{what}\n  hint: {remedy}")
}

/// Features of a ballbar report in the names of this program.
const NAMES: [(&str, &str); 14] = [
    ("AF_SQUARENESS", "squareness"),
    ("AF_SCALE_MISMATCH", "scale mismatch"),
    ("AF_SERVO_MISMATCH", "servo-mismatch"),
    ("AF_BACKLASH_A_POS", "backlash of the first axis, end +"),
    ("AF_BACKLASH_A_NEG", "backlash of the first axis, end -"),
    ("AF_BACKLASH_B_POS", "backlash of the second axis, end +"),
    ("AF_BACKLASH_B_NEG", "backlash of the second axis, end -"),
    ("AF_LATERAL_PLAY_A_POS", "lateral-play of the first axis, end +"),
    ("AF_LATERAL_PLAY_B_POS", "lateral-play of the second axis, end +"),
    ("AF_STRAIGHTNESS_A", "straightness of the first axis"),
    ("AF_STRAIGHTNESS_B", "straightness of the second axis"),
    ("AF_CYCLIC_ERROR_A_FWD", "cyclic of the first axis"),
    ("AF_CYCLIC_ERROR_B_FWD", "cyclic of the second axis"),
    ("AF_CIRCULARITY", "circularity"),
];

/// A ballbar report holds the results of an analysis: without readings there is neither noise nor residual to judge them by.
fn ballbar_figures(path: &Path) -> Failure {
    let file = path.display();
    let bytes = match input::read(path, input::InputKind::Instrument) {
        Ok(bytes) => bytes,
        Err(failure) => return failure,
    };
    let test = match b5r::parse(&text::decode(&bytes).text) {
        Ok(test) => test,
        Err(e) => return crate::positioning_data::format_failure(&file.to_string(), &e),
    };
    let plane = test.plane.as_deref().map_or_else(String::new, |p| format!(", plane {p}"));
    let figures = test.features.iter().filter_map(|f| {
        let (_, name) = NAMES.iter().find(|(n, _)| *n == f.name)?;
        let unit = f.unit.map_or(f.data_type.as_str(), |u| if u == "um" { "µm" } else { u });
        Some(format!("\n    {name}: {} {}", f.value, unit.replace("um/m", "µm/m")))
    });
    let figures = figures.joined("");
    let listed = if figures.is_empty() { figures } else { format!("\n  its figures:{figures}") };
    data!(
        path,
        "a ballbar report (.b5r){plane} with {} figures of an analysis and without its readings; a diagnosis needs \
         the readings\n  hint: save the readings as CSV with angle_deg,deviation_um,direction (and feed_mm_per_min) and give \
         that file with --plane and --radius-mm{listed}",
        test.features.len()
    )
}

/// Poses of three reflectors on a robot: number, and mean and standard deviation of the three sides, mm.
pub(super) struct Poses {
    count: usize,
    sides: [[f64; 2]; 3],
}

/// Share of a side by which it may vary in a rigid body.
const RIGID: f64 = 1e-3;
/// Fewest poses.
const POSES_MIN: usize = 6;

/// Three points of a rigid body per line, in nine leading columns without a header; `None` for anything else.
pub(super) fn reflector_triples(start: &str) -> Option<Poses> {
    let mut lines: Vec<&str> = start.lines().map(str::trim).filter(|l| !l.is_empty()).collect();
    // the head may end within a line
    if lines.len() > POSES_MIN && !start.ends_with('\n') {
        lines.pop();
    }
    let row = |line: &&str| -> Option<Vec<f64>> {
        let fields =
            line.split(|c: char| c.is_whitespace() || c == ',' || c == ';').filter(|f| !f.is_empty());
        fields.map(|f| f.parse::<f64>().ok().filter(|v| v.is_finite())).collect()
    };
    let rows: Vec<Vec<f64>> = lines.iter().map(row).collect::<Option<_>>()?;
    let width = rows.first().map(Vec::len)?;
    if rows.len() < POSES_MIN || width < 12 || rows.iter().any(|r| r.len() != width) {
        return None;
    }
    let side = |r: &[f64], a: usize, b: usize| {
        (0..3).map(|k| (r[3 * a + k] - r[3 * b + k]).powi(2)).sum::<f64>().sqrt()
    };
    let of = |a: usize, b: usize| {
        let values: Vec<f64> = rows.iter().map(|r| side(r, a, b)).collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        [mean, (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt()]
    };
    let sides = [of(0, 1), of(1, 2), of(2, 0)];
    let rigid = sides.iter().all(|[mean, std]| *mean > 1.0 && std < &(RIGID * mean));
    rigid.then_some(Poses { count: rows.len(), sides })
}

/// Joint angles of a robot are no axes of a machine tool.
pub(super) fn robot(path: &Path, poses: &Poses) -> Failure {
    let sides: Vec<String> =
        poses.sides.iter().map(|[mean, std]| format!("{mean:.3} ± {std:.3} mm")).collect();
    data!(
        path,
        "{} poses of three reflectors (sides {}: the noise of tracker and reflectors), with joint angles of a robot; \
         its kinematic chain is none of a machine tool\n  hint: for a machine tool write x_mm, y_mm, z_mm and the deviations as a \
         session file with instrument tracker",
        poses.count,
        sides.join(", ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_reflectors_of_a_rigid_body_are_told_from_other_tables() {
        let mut text = String::new();
        for k in 0..8 {
            let (s, c) = (f64::from(k) * 0.7).sin_cos();
            let at = |x: f64, y: f64| {
                format!("{} {} {}", 100.0 + x * c - y * s, x * s + y * c, 5.0 * f64::from(k))
            };
            text += &format!("{} {} {} {} 0 0 0\n", at(0.0, 0.0), at(200.0, 0.0), at(0.0, 150.0), k);
        }
        let poses = reflector_triples(&text).unwrap();
        assert_eq!(poses.count, 8);
        assert!((poses.sides[0][0] - 200.0).abs() < 1e-9 && (poses.sides[1][0] - 250.0).abs() < 1e-9);
        let bent = text.replace("100 0 0 ", "101 0 0 ");
        assert!(reflector_triples(&bent).is_none(), "not rigid");
        assert!(reflector_triples("1 2 3\n4 5 6\n").is_none());
        assert!(reflector_triples("a,b\n1,2\n").is_none());
    }
}
