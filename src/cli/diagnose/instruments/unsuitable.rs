//! Files that are recognised and hold nothing that a diagnosis can use: each with the reason and a way on.

use crate::prelude::*;
use volcomp_formats::detect::Format;
use volcomp_formats::reflector_poses::ReflectorPoses;
use volcomp_formats::{b5r, text};

/// The refusal of a file whose format is known.
pub(super) fn format(path: &Path, format: Format) -> Failure {
    let file = path.display();
    let (what, remedy) = match format {
        Format::B5r => return ballbar_figures(path).unwrap_or_else(|unreadable| unreadable),
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
fn ballbar_figures(path: &Path) -> Result<Failure> {
    let bytes = input::read(path, InputKind::Instrument)?;
    let test = b5r::parse(&text::decode(&bytes).text)
        .map_err(|e| format_failure(&path.display().to_string(), &e))?;
    let plane = test.plane.as_deref().map_or_else(String::new, |p| format!(", plane {p}"));
    let figures = test.features.iter().filter_map(|f| {
        let (_, name) = NAMES.iter().find(|(n, _)| *n == f.name)?;
        let unit = f.unit.map_or(f.data_type.as_str(), |u| if u == "um" { "µm" } else { u });
        Some(format!("\n    {name}: {} {}", f.value, unit.replace("um/m", "µm/m")))
    });
    let figures = figures.joined("");
    let listed = if figures.is_empty() { figures } else { format!("\n  its figures:{figures}") };
    Ok(data!(
        path,
        "a ballbar report (.b5r){plane} with {} figures of an analysis and without its readings; a diagnosis needs \
         the readings\n  hint: save the readings as CSV with angle_deg,deviation_um,direction (and feed_mm_per_min) and give \
         that file with --plane and --radius-mm{listed}",
        test.features.len()
    ))
}

/// Joint angles of a robot are no axes of a machine tool.
pub(super) fn robot(path: &Path, poses: &ReflectorPoses) -> Failure {
    let ReflectorPoses { count, sides } = poses;
    let sides = sides.iter().map(|[mean, std]| format!("{mean:.3} ± {std:.3} mm")).joined(", ");
    data!(
        path,
        "{count} poses of three reflectors (sides {sides}: the noise of tracker and reflectors), with joint angles of a robot; \
         its kinematic chain is none of a machine tool\n  hint: for a machine tool write x_mm, y_mm, z_mm and the deviations as a \
         session file with instrument tracker"
    )
}
