//! `volcomp identify threepoint | nineline | circles | ram` from the outside: every reference vector, refusals, files
//! to models, and real tracker data and geometry references.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes and reads files")]

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;
use volcomp::identify::primitives::{circle_2d, plane, sphere};
use volcomp::model::geometry::Vec3;

fn volcomp(directory: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcomp")).current_dir(directory).args(args).output().unwrap()
}

fn succeed(directory: &Path, args: &[&str]) -> (String, String) {
    let output = volcomp(directory, args);
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{args:?}: {error}");
    (String::from_utf8(output.stdout).unwrap(), error)
}

fn refuse(directory: &Path, args: &[&str], code: i32) -> String {
    let output = volcomp(directory, args);
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{args:?}: {error}");
    assert!(output.stdout.is_empty(), "a refusal prints nothing on stdout");
    error
}

/// The reference vectors of a method.
fn vectors(group: &str) -> String {
    std::fs::read_to_string(format!("{}/tests/vectors/{group}.json", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

/// Every number of `expect` must be in `found`, within the tolerance of its key.
fn compare(place: &str, expect: &Value, found: &Value, tolerance: f64) {
    match expect {
        Value::Number(n) => {
            let (want, got) =
                (n.as_f64().unwrap(), found.as_f64().unwrap_or_else(|| panic!("{place} is missing")));
            assert!((want - got).abs() <= tolerance, "{place}: {got} instead of {want}");
        }
        Value::Array(list) => {
            let got = found.as_array().unwrap_or_else(|| panic!("{place} is missing"));
            assert_eq!(list.len(), got.len(), "{place}");
            for (i, (e, f)) in list.iter().zip(got).enumerate() {
                compare(&format!("{place}[{i}]"), e, f, tolerance);
            }
        }
        Value::Object(map) => {
            for (key, e) in map {
                compare(&format!("{place}.{key}"), e, &found[key], tolerance);
            }
        }
        // a note is for people
        Value::String(_) => assert!(found.is_string(), "{place} is missing"),
        other => assert_eq!(other, found, "{place}"),
    }
}

/// Runs every case of a group through the command line.
fn every_case(group: &str, tolerance: impl Fn(&str, &Value) -> f64) {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    let text = vectors(group);
    std::fs::write(d.join("all.json"), &text).unwrap();
    let file: Value = serde_json::from_str(&text).unwrap();
    let cases = file["cases"].as_array().unwrap();
    assert!(!cases.is_empty());
    for case in cases {
        let id = case["id"].as_str().unwrap();
        std::fs::write(d.join("case.json"), case.to_string()).unwrap();
        let (alone, _) = succeed(d, &["identify", group, "--input", "case.json", "--json"]);
        let (chosen, _) = succeed(d, &["identify", group, "--input", "all.json", "--case", id, "--json"]);
        assert_eq!(alone, chosen, "{id}");
        let found: Value = serde_json::from_str(&alone).unwrap();
        for (key, expect) in case["expect"].as_object().unwrap() {
            compare(&format!("{id} {key}"), expect, &found[key], tolerance(key, expect));
        }
    }
}

/// A share of the largest number in a value.
fn relative(value: &Value, share: f64) -> f64 {
    fn largest(v: &Value) -> f64 {
        match v {
            Value::Array(list) => list.iter().map(largest).fold(0.0, f64::max),
            other => other.as_f64().unwrap_or(0.0).abs(),
        }
    }
    share * largest(value)
}

#[test]
fn threepoint_vectors() {
    every_case("threepoint", |key, expect| match key {
        "E_lsq" => 1e-11,
        "E_rigid_exact" => 1e-10,
        "cov" | "cov_diag_sqrt" => relative(expect, 1e-8),
        _ => relative(expect, 1e-9).max(1e-12),
    });
}

#[test]
fn nineline_vectors() {
    every_case("nineline", |key, expect| if key == "E" { 1e-12 } else { relative(expect, 1e-9) });
}

#[test]
fn circles_vectors() {
    every_case("circles", |key, expect| match key {
        "axis_direction" | "normal_1" | "normal_2" | "direction_error_rotvec" => 1e-10,
        "sigma_predicted" => 1e-9,
        "rms_radial" | "rms_axial" => 1e-10,
        _ => relative(expect, 0.0).max(1e-8),
    });
}

#[test]
fn ram_vectors() {
    every_case("ram", |key, expect| if key == "E_lsq" { 1e-11 } else { relative(expect, 1e-8) });
}

#[test]
fn cases_that_are_wrong_say_where() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    std::fs::write(d.join("all.json"), r#"{"cases": [{"id": "a"}, {"id": "b"}]}"#).unwrap();
    std::fs::write(d.join("cut.json"), "{\"points_platform\": [[1, 2").unwrap();
    std::fs::write(d.join("few.json"), r#"{"points_platform": [[0,0,0],[1,0,0],[0,1,0]], "platform_origin_nominal": [0,0,0], "points_measured": [[0,0,0]], "sigma": 1}"#).unwrap();
    std::fs::write(d.join("name.json"), r#"{"lines_yz": [[0,1]], "x_target": 0, "readings": {"dx2": 0.1}}"#)
        .unwrap();
    let run = |method: &str, file: &str, more: &[&str], code: i32| {
        let args = [&["identify", method, "--input", file], more].concat();
        refuse(d, &args, code)
    };
    assert!(run("threepoint", "all.json", &[], 64).contains("choose one with --case: a, b"));
    assert!(run("threepoint", "all.json", &["--case", "c"], 65).contains("no case c"));
    assert!(run("ram", "cut.json", &[], 65).contains("cut.json:1:"));
    assert!(run("threepoint", "few.json", &[], 65).contains("1 measured points for 3 platform points"));
    assert!(run("nineline", "name.json", &[], 65).contains("reading dx2"));
    assert!(run("circles", "few.json", &[], 65).contains("missing field"));
    assert!(run("circles", "none.json", &[], 74).contains("none.json"));
}

/// Displacement of a carriage point: yaw and pitch that grow with x, straightness that bends.
fn displaced(x: f64, p: [f64; 3]) -> [f64; 3] {
    let (eps, d) = ([2e-8 * x, -3e-8 * x, 5e-8 * x], [1e-5 * x, 4e-8 * x * (x - 500.0), 0.0]);
    [
        p[0] + x + d[0] + eps[1] * p[2] - eps[2] * p[1],
        p[1] + d[1] + eps[2] * p[0] - eps[0] * p[2],
        p[2] + d[2] + eps[0] * p[1] - eps[1] * p[0],
    ]
}

const POINTS: [(&str, [f64; 3]); 4] = [
    ("a", [100.0, 0.0, 0.0]),
    ("b", [-100.0, 120.0, 10.0]),
    ("c", [-90.0, -130.0, -20.0]),
    ("d", [0.0, 0.0, 180.0]),
];

fn write_points(d: &Path) {
    let mut text = String::from("point,x_mm,y_mm,z_mm\n");
    for (name, p) in POINTS {
        text.push_str(&format!("{name},{},{},{}\n", p[0], p[1], p[2]));
    }
    std::fs::write(d.join("points.csv"), text).unwrap();
}

/// Positions 0 to 500 in steps of 25, two cycles with 0.1 um of alternating error; `spoil` changes a point.
fn write_run(d: &Path, spoil: impl Fn(&str, f64) -> [f64; 3]) {
    let mut text = String::from("position_mm,cycle");
    for (name, _) in POINTS {
        text.push_str(&format!(",{name}_x_mm,{name}_y_mm,{name}_z_mm"));
    }
    text.push('\n');
    for cycle in 1..=2 {
        for k in 0..=20 {
            let x = 25.0 * f64::from(k);
            text.push_str(&format!("{x},{cycle}"));
            for (i, (name, p)) in POINTS.iter().enumerate() {
                let s = spoil(name, x);
                let m = displaced(x, *p);
                for j in 0..3 {
                    let wobble = f64::from((k * 7 + cycle * 5 + (i * 3 + j) as i32 * 11) % 7 - 3) * 5e-5;
                    text.push_str(&format!(",{:.7}", m[j] + s[j] + wobble));
                }
            }
            text.push('\n');
        }
    }
    std::fs::write(d.join("run.csv"), text).unwrap();
}

const RUN: [&str; 12] = [
    "identify",
    "threepoint",
    "--axis",
    "x",
    "--points",
    "points.csv",
    "--data",
    "run.csv",
    "--sigma-um",
    "0.15",
    "--chain",
    "[w b X Y Z t]",
];

#[test]
fn files_become_a_model_with_reference_points_and_uncertainty() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    write_points(d);
    write_run(d, |_, _| [0.0; 3]);
    let args = [
        &RUN[..],
        &["--machine", "m1", "--reference-mm", "0,0,0", "--out", "model.toml", "--motions", "motions.csv"],
    ]
    .concat();
    let (report, notes) = succeed(d, &args);
    assert!(
        report.contains("passed") && report.contains("EYX µm") && notes.contains("model written"),
        "{report}{notes}"
    );
    let text = std::fs::read_to_string(d.join("model.toml")).unwrap();
    let spec = volcomp::config::model::parse("model.toml", &text).unwrap();
    let of = |name: &str, x: f64| {
        let symbol = volcomp::model::ErrorSymbol::parse(name).unwrap();
        let (_, f) = spec.errors.iter().find(|(s, _)| *s == symbol).unwrap();
        assert!(f.std.is_some(), "{name} has no standard uncertainty");
        f.value(x, volcomp::model::axes::Travel::Forward)
    };
    for x in [0.0, 140.0, 330.0, 500.0] {
        assert!((of("exx", x) - 1e-5 * x).abs() < 1e-4, "{x}");
        assert!((of("eyx", x) - 4e-8 * x * (x - 500.0)).abs() < 1e-4, "{x}: {}", of("eyx", x));
        assert!((of("ecx", x) - 5e-8 * x).abs() < 1e-6 && (of("ebx", x) + 3e-8 * x).abs() < 1e-6);
    }
    assert_eq!(spec.axes[0].travel, Some([0.0, 500.0]));
    // every error says which files it was made from
    let file = volcomp::config::model::parse_file("model.toml", &text).unwrap();
    assert_eq!(file.of_errors.len(), 6);
    assert!(file.of_errors.iter().all(|(_, p)| p.sources.len() == 2), "{:?}", file.of_errors[0]);
    // the motion table is what volcomp fit reads
    succeed(
        d,
        &["fit", "--errors", "motions.csv", "--axis", "x", "--chain", "[w b X Y Z t]", "--out", "fit.toml"],
    );
    // on the workpiece side the same numbers are minus the motion of the tool
    let primed: Vec<&str> =
        args.iter().map(|a| if a.starts_with("[w") { "[w X' b Y Z t]" } else { a }).collect();
    let text = std::fs::read_to_string(d.join("run.csv")).unwrap();
    let turned: String = text
        .lines()
        .map(|l| if l.starts_with("position") { format!("{l}\n") } else { format!("-{l}\n") })
        .collect();
    std::fs::write(d.join("run.csv"), turned).unwrap();
    succeed(d, &primed);
    let text = std::fs::read_to_string(d.join("model.toml")).unwrap();
    let spec = volcomp::config::model::parse("model.toml", &text).unwrap();
    let exx = volcomp::model::ErrorSymbol::parse("exx").unwrap();
    let (_, f) = spec.errors.iter().find(|(s, _)| *s == exx).unwrap();
    assert!((f.value(-300.0, volcomp::model::axes::Travel::Forward) + 3e-3).abs() < 1e-4);
}

#[test]
fn a_loose_point_is_named_and_a_line_refused() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    write_points(d);
    write_run(d, |name, x| if name == "c" { [0.0, 1e-4 * (x % 100.0), 0.0] } else { [0.0; 3] });
    let (report, warning) = succeed(d, &RUN);
    assert!(
        report.contains("FAILED") && warning.contains("point c explains most of it"),
        "{report}{warning}"
    );
    let (json, _) = succeed(d, &[&RUN[..], &["--json"]].concat());
    let json: Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["rigidity"]["suspect_point"], "c");
    let (sides, _) = succeed(d, &["identify", "threepoint", "--rigidity", "--data", "run.csv"]);
    assert!(sides.contains("point c is loose"), "{sides}");
    std::fs::write(d.join("points.csv"), "point,x_mm,y_mm,z_mm\na,0,0,0\nb,100,0,0\nc,200,0,0\nd,300,0,0\n")
        .unwrap();
    let error = refuse(d, &RUN, 65);
    assert!(error.contains("rotation about the line (1.000 0.000 0.000) is not observable"), "{error}");
    std::fs::write(d.join("points.csv"), "point,x_mm,y_mm,z_mm\na,0,0,0\nB,100,0,0\n").unwrap();
    let error = refuse(d, &RUN, 65);
    assert!(error.contains("unknown column; is B_x_mm meant?"), "{error}");
}

#[test]
fn angles_need_a_frame_and_weights_and_a_registration_needs_spread() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    std::fs::write(d.join("points.csv"), "point,x_mm,y_mm,z_mm\na,0,0,0\nb,100,0,0\nc,0,100,0\n").unwrap();
    let head = "position_mm,a_range_mm,a_azimuth_deg,a_elevation_deg,b_range_mm,b_azimuth_deg,b_elevation_deg,c_range_mm,c_azimuth_deg,c_elevation_deg\n";
    std::fs::write(d.join("run.csv"), format!("{head}0,1,2,3,1,2,3,1,2,3\n")).unwrap();
    let base = [
        "identify",
        "threepoint",
        "--axis",
        "x",
        "--points",
        "points.csv",
        "--data",
        "run.csv",
        "--chain",
        "[w b X Y Z t]",
    ];
    let with = |more: &[&str]| {
        refuse(d, &[&base[..], more].concat(), if more.contains(&"ref.csv") { 65 } else { 64 })
    };
    assert!(with(&[]).contains("give --registration or --tracker-mm"));
    assert!(with(&["--tracker-mm", "1,2,3"]).contains("need weights"));
    assert!(with(&["--sigma-range-um", "1"]).contains("belong together"));
    std::fs::write(
        d.join("ref.csv"),
        "point,machine_x_mm,machine_y_mm,machine_z_mm,x_mm,y_mm,z_mm\nr1,0,0,0,5,5,5\nr2,100,0,0,105,5,5\nr3,200,0,0,205,5,5\n",
    )
    .unwrap();
    let error = with(&["--registration", "ref.csv"]);
    assert!(error.contains("3 reference points lie nearly on a line"), "{error}");
}

#[test]
#[cfg_attr(
    not(data_laser_tracker_3smr_robot),
    ignore = "needs ../shared/data/laser_tracker_3smr_robot or VOLCOMP_DATA"
)]
fn the_noise_of_the_real_tracker_comes_out() {
    let path = concat!(env!("VOLCOMP_DATA_FOLDER"), "/laser_tracker_3smr_robot/N1N2N3Jval.csv");
    let text = std::fs::read_to_string(path).unwrap();
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    let mut csv = String::new();
    for n in ["n1", "n2", "n3"] {
        csv.push_str(&format!("{n}_x_mm,{n}_y_mm,{n}_z_mm,"));
    }
    csv.push_str(&(0..12).map(|i| format!("other{i}")).collect::<Vec<_>>().join(","));
    csv.push('\n');
    // the columns of the file are separated by blanks
    for line in text.lines() {
        csv.push_str(&line.split_whitespace().collect::<Vec<_>>().join(","));
        csv.push('\n');
    }
    std::fs::write(d.join("poses.csv"), csv).unwrap();
    let (json, _) = succeed(d, &["identify", "threepoint", "--rigidity", "--data", "poses.csv", "--json"]);
    let found: Value = serde_json::from_str(&json).unwrap();
    assert_eq!(found["poses"], 36);
    let mut sides: Vec<(f64, f64, f64)> = found["sides"]
        .as_array()
        .unwrap()
        .iter()
        .map(|s| {
            (s["mean"].as_f64().unwrap(), s["std"].as_f64().unwrap(), s["peak_to_peak"].as_f64().unwrap())
        })
        .collect();
    sides.sort_by(|a, b| a.0.total_cmp(&b.0));
    for ((mean, std, range), (want, noise)) in
        sides.iter().zip([(244.055, 0.038), (245.062, 0.030), (349.004, 0.037)])
    {
        assert!((mean - want).abs() < 6e-4 && (std - noise).abs() < 5.1e-4, "{mean} +- {std}");
        assert!(
            (0.13..0.17).contains(&((range * 100.0).round() / 100.0)) || (range - 0.17).abs() < 6e-3,
            "{range}"
        );
    }
    // half of the mean variance of a side
    let sigma = found["sigma"].as_f64().unwrap();
    assert!((sigma - 0.0249).abs() < 6e-4 && found["suspect_point"].is_null(), "{sigma}");
}

#[test]
fn the_geometry_references_come_out() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/geometry_fit_refs");
    let rows = |name: &str| -> Vec<Vec<f64>> {
        std::fs::read_to_string(format!("{folder}/{name}"))
            .unwrap()
            .lines()
            .filter(|l| !l.trim().is_empty())
            .map(|l| l.split_whitespace().map(|v| v.parse().unwrap()).collect())
            .collect()
    };
    for (name, x, y, r, rms) in [
        ("bopp.circle", 124.971_060_5, 85.749_195_7, 41.502_830_8, Some(0.011_194)),
        ("derletztekick.circle", 1_014.141_397_5, 977.771_558_8, 11.295_571_7, Some(0.016_686)),
        ("gander1994.circle", 4.739_782, 2.983_533, 4.714_226, None),
    ] {
        let points: Vec<[f64; 2]> = rows(name).iter().map(|r| [r[0], r[1]]).collect();
        let c = circle_2d(&points).unwrap();
        let digits = if rms.is_some() { 6e-8 } else { 6e-7 };
        for (found, wanted) in [(c.centre[0], x), (c.centre[1], y), (c.radius, r)] {
            assert!((found - wanted).abs() < digits, "{name}: {found} instead of {wanted}");
        }
        assert!(rms.is_none_or(|rms| (c.rms - rms).abs() < 6e-7), "{name}: rms {}", c.rms);
    }
    let points: Vec<[f64; 3]> = rows("jaeger.sphere").iter().map(|r| [r[0], r[1], r[2]]).collect();
    let s = sphere(&points).unwrap();
    let found = [s.centre[0], s.centre[1], s.centre[2], s.radius];
    for (f, w) in found.iter().zip([7.999_806_5, 9.999_724_5, 6.999_306_1, 5.000_542_0]) {
        assert!((f - w).abs() < 6e-8, "{found:?}");
    }
    let points: Vec<Vec3> = rows("niemeier_1135.plane").iter().map(|r| Vec3::new(r[0], r[1], r[2])).collect();
    let p = plane(&points).unwrap();
    let sign = p.distance.signum();
    let found = [p.normal.x * sign, p.normal.y * sign, p.normal.z * sign, p.distance * sign];
    for (f, w) in found.iter().zip([0.286_427, 0.428_733, -0.856_824, 0.858_999]) {
        assert!((f - w).abs() < 6e-7, "{found:?}");
    }
}

/// Points of a circle about the z axis through (10, 20), `per` of them, seen from a frame turned by 90 deg and moved.
fn circle(height: f64, radius: f64, per: u32, turned: bool) -> Vec<[f64; 3]> {
    (0..per)
        .map(|i| {
            let (s, c) = (f64::from(i) * core::f64::consts::TAU / f64::from(per)).sin_cos();
            let p = [10.0 + radius * c, 20.0 + radius * s, height];
            if turned { [p[1] - 500.0, 700.0 - p[0], p[2] + 30.0] } else { p }
        })
        .collect()
}

fn rows(circle: u32, points: &[[f64; 3]]) -> String {
    points.iter().map(|p| format!("{circle},{},{},{}\n", p[0], p[1], p[2])).collect()
}

#[test]
fn two_trackers_give_one_axis_and_say_what_their_frames_cost() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    let head = "circle,x_mm,y_mm,z_mm\n";
    std::fs::write(d.join("one.csv"), format!("{head}{}", rows(1, &circle(150.0, 40.0, 36, false)))).unwrap();
    std::fs::write(d.join("two.csv"), format!("{head}{}", rows(2, &circle(0.0, 50.0, 48, true)))).unwrap();
    let reference = |turned: bool| {
        let mut text = String::from("point,machine_x_mm,machine_y_mm,machine_z_mm,x_mm,y_mm,z_mm\n");
        for (i, p) in
            [[0.0, 0.0, 0.0], [900.0, 0.0, 0.0], [0.0, 800.0, 0.0], [0.0, 0.0, 700.0]].iter().enumerate()
        {
            let s = if turned { [p[1] - 500.0, 700.0 - p[0], p[2] + 30.0] } else { *p };
            text.push_str(&format!("r{i},{},{},{},{},{},{}\n", p[0], p[1], p[2], s[0], s[1], s[2]));
        }
        text
    };
    std::fs::write(d.join("ref1.csv"), reference(false)).unwrap();
    std::fs::write(d.join("ref2.csv"), reference(true)).unwrap();
    let base = [
        "identify",
        "circles",
        "--data",
        "one.csv",
        "--data-2",
        "two.csv",
        "--tip-beyond-mm",
        "80",
        "--sigma-um",
        "5",
        "--json",
    ];
    let registered = ["--registration", "ref1.csv", "--registration-2", "ref2.csv"];
    let found = |more: &[&str]| -> Value {
        serde_json::from_str(&succeed(d, &[&base[..], &registered, more].concat()).0).unwrap()
    };
    let json = found(&[]);
    for (i, (direction, tip)) in [0.0, 0.0, 1.0].into_iter().zip([10.0, 20.0, -80.0]).enumerate() {
        assert!((json["axis_direction"][i].as_f64().unwrap() - direction).abs() < 1e-12);
        assert!((json["tip"][i].as_f64().unwrap() - tip).abs() < 1e-9);
    }
    // both registrations are uncertain by about half the noise of a point
    let share = json["registration_share"].as_f64().unwrap();
    assert!((1e-5..1e-4).contains(&share), "{share}");
    let stated = found(&["--between-um", "10"]);
    assert!((stated["registration_share"].as_f64().unwrap() - 0.01 / 150.0).abs() < 1e-15);
    // without a registration the second tracker's points are somewhere else
    let error = refuse(d, &base, 65);
    assert!(error.contains("from the nominal one"), "{error}");
}

#[test]
fn poses_from_circles_go_to_the_ram_and_a_prior_fixes_a_single_one() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    let text = format!(
        "circle,x_mm,y_mm,z_mm\n{}{}",
        rows(1, &circle(150.0, 40.0, 36, false)),
        rows(2, &circle(0.0, 50.0, 48, false))
    );
    std::fs::write(d.join("c.csv"), text).unwrap();
    let add = [
        "identify",
        "circles",
        "--data",
        "c.csv",
        "--tip-beyond-mm",
        "80",
        "--sigma-um",
        "5",
        "--nominal-tip-mm",
        "9.99,20,-80",
        "--c-deg",
        "0",
        "--a-deg",
        "0",
        "--add-pose",
        "poses.csv",
    ];
    succeed(d, &add);
    succeed(d, &add);
    let poses = std::fs::read_to_string(d.join("poses.csv")).unwrap();
    assert_eq!(poses.lines().count(), 3, "{poses}");
    assert!(poses.lines().nth(1).unwrap().starts_with("0,0,0,10.0000,"), "{poses}");
    let ram = [
        "identify",
        "ram",
        "--poses",
        "poses.csv",
        "--a-axis-mm",
        "0,0,-180",
        "--tool-length-mm",
        "320",
        "--sigma-position-um",
        "2",
        "--sigma-direction-arcsec",
        "2",
    ];
    let error = refuse(d, &ram, 65);
    assert!(
        error.contains("2 head poses determine 5 of six ram errors: rotation about the tool axis"),
        "{error}"
    );
    let (json, note) = succeed(d, &[&ram[..], &["--prior-std-arcsec", "5", "--json"]].concat());
    let json: Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["rank"], 5);
    assert!((json["E_lsq"][0].as_f64().unwrap() - 0.01).abs() < 1e-9, "{json}");
    // nothing but the prior speaks of the free rotation
    assert!((json["sigma"][5].as_f64().unwrap() - 5.0 * core::f64::consts::PI / 648_000.0).abs() < 1e-9);
    assert!(note.contains("the rest is the prior's"), "{note}");
    let error = refuse(d, &[&ram[..], &["--prior-std-arcsec", "5", "--out", "m.toml"]].concat(), 65);
    assert!(error.contains("all poses are at one position of Z"), "{error}");
}
