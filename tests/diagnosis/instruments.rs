//! Files of instruments and controls through `volcomp diagnose`, as they are: the format is detected from the content, what was
//! assumed is stated, and what is known to be in the file comes out.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes and reads files")]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use serde_json::Value;

use crate::support::normal;

/// A small file made up for these tests.
fn made_up(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/formats").join(name)
}

pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

pub(crate) fn run(directory: &Path, path: &Path, extra: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcomp"))
        .current_dir(directory)
        .args(["diagnose", "--json", "--out", "out", "--data"])
        .arg(path)
        .args(extra)
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

/// Report and stderr of a file under a name that gives nothing away.
pub(crate) fn diagnose(path: &Path, extra: &[&str]) -> (Value, String) {
    let directory = tempfile::tempdir().unwrap();
    let plain = directory.path().join("measurement");
    std::fs::copy(path, &plain).unwrap();
    let done = run(directory.path(), Path::new("measurement"), extra);
    assert!(done.status.success(), "{}: {}", path.display(), text(&done.stderr));
    (serde_json::from_slice(&done.stdout).unwrap(), text(&done.stderr))
}

#[test]
fn without_a_folder_the_answer_is_printed_and_nothing_is_written() {
    let directory = tempfile::tempdir().unwrap();
    let plain = directory.path().join("stage.dat");
    std::fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/formats/sessions/stage.dat"), &plain)
        .unwrap();
    let done = Command::new(env!("CARGO_BIN_EXE_volcomp"))
        .current_dir(directory.path())
        .args(["diagnose", "stage.dat"])
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", text(&done.stderr));
    assert!(
        text(&done.stdout)
            .trim_end()
            .ends_with("--out DIR writes report.html, report.json and addition.toml")
    );
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 1);
}

/// What is printed without `--json`.
fn printed(path: &Path, extra: &[&str]) -> String {
    let done =
        Command::new(env!("CARGO_BIN_EXE_volcomp")).arg("diagnose").arg(path).args(extra).output().unwrap();
    assert!(done.status.success(), "{}", text(&done.stderr));
    text(&done.stdout)
}

/// The number behind words.
pub(crate) fn number_after(text: &str, words: &str) -> f64 {
    let rest = text.split_once(words).unwrap_or_else(|| panic!("{words}: {text}")).1;
    rest.split_whitespace().next().unwrap().replace('\u{2212}', "-").parse().unwrap()
}

/// What is printed of an ISO 230-2 test of X: five cycles to the last of 21 targets and back, of which target and deviation (um,
/// by position and direction) are given, with noise in a range of `noise_um`.
fn printed_test(
    target_mm: impl Fn(u32) -> f64,
    deviation_um: impl Fn(f64, f64) -> f64,
    noise_um: f64,
) -> String {
    let mut table = "cycle,direction,target_mm,deviation_um\n".to_owned();
    for cycle in 1..6_u32 {
        for reading in 0..42_u32 {
            let (k, sign) = if reading < 21 { (reading, 1.0) } else { (41 - reading, -1.0) };
            let x = target_mm(k);
            let noise = noise_um * (f64::from((reading * 7919 + cycle * 104_729) % 1009) / 1009.0 - 0.5);
            writeln!(table, "{cycle},{sign},{x:.2},{:.3}", deviation_um(x, sign) + noise).unwrap();
        }
    }
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.csv");
    std::fs::write(&path, table).unwrap();
    printed(&path, &["--axis", "x"])
}

#[test]
fn the_remainder_is_no_larger_than_what_is_left_and_what_is_negligible_stands_last() {
    // of each point in each direction a value of its own, which is no effect
    let own = |x: f64, sign: f64| 0.1 * (1.7 * x + 2.9 * sign).sin();
    let curve = |x: f64, sign: f64| -0.018 * x + 9.0 * (x / 130.0).sin() - 0.135 * sign + own(x, sign);
    let said = printed_test(|k| 8.5 + 41.65 * f64::from(k), curve, 0.35);
    let left = number_after(&said, "expected to leave ");
    assert!(number_after(&said, "of which ") <= left, "{said}");
    assert!(number_after(&said, "\nunexplained: ") <= left, "{said}");
    let backlash = said.lines().find(|l| l.contains("(backlash:x)") && l.contains('±')).unwrap();
    assert!(backlash.ends_with("significant, but negligible in this gap"), "{backlash}");
    assert!(said.find("(scale:x)").unwrap() < said.find("(backlash:x)").unwrap(), "{said}");
}

#[test]
fn the_width_of_a_backlash_that_changes_is_that_in_the_middle_of_the_data() {
    let target = |k: u32| 600.0 + 15.0 * f64::from(k) + 4.0 * f64::from(k * 7 % 5) / 5.0;
    let said = printed_test(target, |x, sign| -0.5 * sign * (6.0 + 0.03 * (x - 752.0)), 0.3);
    assert!((number_after(&said, ", width ") - 6.0).abs() < 0.2, "{said}");
    assert!(said.contains(" µm at X 75"), "at zero it would be -16.6 um: {said}");
}

fn refused(path: &Path, code: i32) -> String {
    let directory = tempfile::tempdir().unwrap();
    let done = run(directory.path(), path, &[]);
    assert_eq!(done.status.code(), Some(code), "{}", text(&done.stderr));
    assert!(!directory.path().join("out").exists(), "nothing is written");
    text(&done.stderr)
}

fn notes(r: &Value) -> String {
    r["notes"].as_array().unwrap().iter().map(|n| n.as_str().unwrap()).collect::<Vec<_>>().join("\n")
}

pub(crate) fn cause<'a>(r: &'a Value, effect: &str, subject: &str) -> &'a Value {
    let all = r["causes"].as_array().unwrap();
    all.iter()
        .find(|c| c["effect"] == effect && c["subject"] == subject)
        .unwrap_or_else(|| panic!("{effect}:{subject}: {all:?}"))
}

pub(crate) fn parameter(r: &Value, effect: &str, subject: &str, name: &str) -> f64 {
    cause(r, effect, subject)["parameters"][name]["value"].as_f64().unwrap()
}

/// Every statement stands on stderr and in the notes of the report.
fn stated(found: &(Value, String), wanted: &[&str]) {
    let notes = notes(&found.0);
    for w in wanted {
        assert!(found.1.contains(w), "{w} on stderr: {}", found.1);
        assert!(notes.contains(w), "{w} in the notes: {notes}");
    }
}

const ORDINAL: &str = "times are ordinal";

#[test]
fn a_positioning_test_of_a_logger() {
    let found = diagnose(&made_up("sessions/stage.dat"), &["--axis", "y"]);
    stated(
        &found,
        &[
            "ISO 230-2 test (.dat)",
            "axis Y, 5 targets, 5 cycles, both directions, 50 readings",
            "the order of the standard test cycle of ISO 230-2 is assumed",
            "line 12: start-up outlier at 5 mm forward, cycle 1",
            "line 13: start-up outlier at 17.5 mm forward, cycle 1",
        ],
    );
    let r = &found.0;
    assert!(notes(r).contains(ORDINAL) && !found.1.contains("assumed; --axis"), "{}", found.1);
    let width = parameter(r, "backlash", "y", "width_um");
    assert!((width - 12.0).abs() < 1.0, "{width}");
    let left_out: Vec<&str> =
        r["outlying_readings"].as_array().unwrap().iter().map(|o| o["at"].as_str().unwrap()).collect();
    assert_eq!(left_out, ["measurement:12", "measurement:13"]);
    // an order has no hours: the page draws over the number of the reading
    let directory = tempfile::tempdir().unwrap();
    assert!(run(directory.path(), &made_up("sessions/stage.dat"), &[]).status.success());
    let page = std::fs::read_to_string(directory.path().join("out/report.html")).unwrap();
    assert!(page.contains("number of the reading") && !page.contains("time, s"), "{page}");
    // without --axis the assumption is stated
    stated(&diagnose(&made_up("sessions/stage.dat"), &[]), &["X assumed; --axis states it"]);
}

#[test]
fn a_laser_test_with_start_and_end() {
    let found = diagnose(&made_up("laser-x.rtl"), &[]);
    stated(
        &found,
        &[
            "Renishaw laser test (.rtl)",
            "axis X, 5 targets, 2 cycles, both directions, 20 readings",
            "times: start and end of the test spread evenly over the readings",
            "material at 20.20 to 20.32 degC",
        ],
    );
    assert!(notes(&found.0).contains("times are nominal"), "{}", notes(&found.0));
    let scale = parameter(&found.0, "scale", "x", "scale_ppm");
    assert!((20.0..28.0).contains(&scale), "{scale}");
}

#[test]
fn a_rotary_laser_test_is_read_with_its_unit() {
    let directory = tempfile::tempdir().unwrap();
    let rotary = std::fs::read_to_string(made_up("laser-x.rtl")).unwrap().replace("Axis: X", "Axis: C");
    let path = directory.path().join("c.rtl");
    std::fs::write(&path, rotary).unwrap();
    let said = refused(&path, 64);
    assert!(said.contains("does not say the unit of its deviations"), "{said}");
    let found = diagnose(&path, &["--deviation-unit", "arcsec"]);
    stated(
        &found,
        &["axis C, 5 targets", "given as displacement at a radius of 100 mm (1 arcsec = 0.485 µm)"],
    );
}

#[test]
fn a_table_sorted_by_target_gives_what_the_order_measured_gives() {
    let measured = diagnose(&made_up("sessions/positioning.csv"), &[]);
    let sorted = diagnose(&made_up("sessions/by-target.csv"), &[]);
    stated(&measured, &["positioning test", "axis X, 6 targets, 4 cycles, both directions, 48 readings"]);
    assert!(!measured.1.contains("sorted by target"), "{}", measured.1);
    stated(&sorted, &["the file is sorted by target or direction"]);
    for key in ["causes", "verdict", "gap", "shrink"] {
        assert_eq!(measured.0[key], sorted.0[key], "{key}");
    }
    let scale = parameter(&measured.0, "scale", "x", "scale_ppm");
    assert!((scale - 30.0).abs() < 3.0, "{scale}");
}

#[test]
fn times_of_a_table_are_taken_from_its_column() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("timed.csv");
    let plain = std::fs::read_to_string(made_up("sessions/positioning.csv")).unwrap();
    let mut timed = String::new();
    for (k, line) in plain.lines().filter(|l| !l.starts_with('#')).enumerate() {
        let t = if k == 0 { "t_s".to_owned() } else { format!("{:.2}", 20.0 * k as f64 + (k as f64).sin()) };
        writeln!(timed, "{t},{line}").unwrap();
    }
    std::fs::write(&path, timed).unwrap();
    let found = diagnose(&path, &[]);
    assert!(!notes(&found.0).contains("times are"), "{}", notes(&found.0));
}

#[test]
fn plates_from_a_cmm_and_as_a_table() {
    for (name, format, holes) in [
        ("sessions/plate.txt", "plate measured on a CMM (Plate: 7, Date: 2020-01-01)", "60 holes"),
        ("sessions/plate.csv", "plate (nominal and measured positions)", "25 holes"),
    ] {
        let found = diagnose(&made_up(name), &[]);
        stated(
            &found,
            &[format, holes, "the order of machining and the directions of approach are not known"],
        );
        let r = &found.0;
        assert!(notes(r).contains(ORDINAL), "{}", notes(r));
        let angle = parameter(r, "squareness", "xy", "angle_arcsec");
        assert!((angle + 20.6).abs() < 4.0, "{name}: {angle}");
        // a right angle that is too wide is positive in ISO 230-1
        let stated = number_after(&printed(&made_up(name), &[]), "EC0Y ");
        assert!((stated + angle).abs() < 0.1, "{name}: {stated}");
        let scale = parameter(r, "scale", "y", "scale_ppm");
        assert!((scale - 60.0).abs() < 12.0, "{name}: {scale}");
        let all = r["causes"].to_string();
        assert!(
            !all.contains("vibration") && !all.contains("backlash"),
            "nothing from the order of a list: {all}"
        );
    }
}

#[test]
fn a_circular_test_with_its_feed() {
    let args = ["--plane", "xy", "--radius-mm", "150", "--centre-mm=100,50,-20"];
    let found = diagnose(&made_up("sessions/ballbar.csv"), &args);
    stated(
        &found,
        &[
            "circular test (angle, deviation, direction)",
            "240 readings, 2 runs, both directions",
            "plane xy\n",
            "centre at 100, 50, -20 mm\n",
            "velocities and times from angle and feed",
        ],
    );
    let width = parameter(&found.0, "backlash", "x", "width_um");
    assert!((width - 8.0).abs() < 1.0, "{width}");
    let assumed = diagnose(&made_up("sessions/ballbar.csv"), &[]);
    stated(&assumed, &["radius 150 mm (assumed; --radius-mm states it)", "plane xy (assumed"]);
}

/// A test of 5 cycles in 21 targets, both directions: scale error of X, and a drift that no cycle repeats.
#[test]
fn a_drift_that_is_the_larger_remainder_is_said_in_the_headline() {
    let mut table = "cycle,direction,target_mm,deviation_um\n".to_owned();
    for row in 0..210_u32 {
        let (cycle, reading) = (row / 42 + 1, row % 42);
        let (k, sign) = if reading < 21 { (reading, 1) } else { (41 - reading, -1) };
        let x = 8.5 + 41.65 * f64::from(k);
        let noise = 0.35 * (f64::from((reading * 7919 + cycle * 104_729) % 1009) / 1009.0 - 0.5);
        let t = f64::from(row + 1);
        let drift = 6.0 * (t / 23.7).sin() + 3.0 * (t / 61.3).sin();
        writeln!(table, "{cycle},{sign},{x:.2},{:.3}", -0.05 * x + drift + noise).unwrap();
    }
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.csv");
    std::fs::write(&path, table).unwrap();
    let said = printed(&path, &["--axis", "x"]);
    let drift = number_after(&said, "of which ");
    assert!(said.contains(&format!("of which {drift:.2} µm is slow drift of unknown source.")), "{said}");
    assert!((drift - number_after(&said, "; slow drift of ")).abs() < 0.02, "{said}");
}

/// An axis with a repeatable value of its own at each of five targets in each direction.
#[test]
fn values_of_single_points_ask_for_a_finer_line() {
    let values = [[12.0, -21.0], [-1.0, 13.0], [-30.0, -22.0], [-9.0, -22.0], [43.0, 0.0]];
    let mut noise = normal(5);
    let mut table = "cycle,direction,target_mm,deviation_um\n".to_owned();
    for cycle in 1..=5 {
        for (side, sign) in [(0, 1), (1, -1)] {
            for step in 0..5 {
                let k = if sign > 0 { step } else { 4 - step };
                let deviation = values[k][side] + 1.5 * noise();
                writeln!(table, "{cycle},{sign},{:.1},{deviation:.3}", 15.0 + 10.2 * k as f64).unwrap();
            }
        }
    }
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.csv");
    std::fs::write(&path, table).unwrap();
    let said = printed(&path, &["--axis", "x"]);
    assert!(said.starts_with("unexplained"), "{said}");
    let left = number_after(&said, "a value for each point and direction leaves ");
    assert!((left - 1.5).abs() < 0.5, "{said}");
    let next = said.split_once("next measurement").unwrap().1;
    assert!(next.lines().next().unwrap().contains("fine steps"), "{said}");
}

#[test]
fn a_capture_as_json_and_as_a_table() {
    let json = diagnose(&made_up("sessions/capture.json"), &[]);
    stated(
        &json,
        &[
            "capture of a SINUMERIK Edge (made by hand)",
            "axes x=1 (X1), y=2 (Y1) assumed from their names",
            "axes left out: 3 (Z1): it turns",
            "of x, y: 800 readings, a row every 2 ms, 2 uninterrupted parts",
        ],
    );
    let table = diagnose(&made_up("sessions/capture.csv"), &[]);
    stated(&table, &["capture of a SINUMERIK Edge as a table", "interpolation cycle of 2 ms assumed"]);
    let named = |r: &Value| {
        let all = r["causes"].as_array().unwrap();
        all.iter().map(|c| format!("{} {} {}", c["effect"], c["subject"], c["declared"])).collect::<Vec<_>>()
    };
    assert_eq!(named(&json.0), named(&table.0));
    assert!(!notes(&json.0).contains("times are"), "the clock of the control");
    let lag = parameter(&json.0, "latency", "", "lag_ms");
    assert!((lag - 8.0).abs() < 0.1, "{lag}");
    // times by count and by sum differ in the last digit
    assert!((lag - parameter(&table.0, "latency", "", "lag_ms")).abs() < 1e-6);
    let directory = tempfile::tempdir().unwrap();
    let done = run(directory.path(), &made_up("sessions/capture.json"), &["--axes", "x=1,y=9"]);
    let said = text(&done.stderr);
    assert!(
        done.status.code() == Some(65) && said.contains("no signal DES_POS|9; --axes names axes"),
        "{said}"
    );
}

#[test]
fn a_log_of_displacement_takes_its_probes_by_number() {
    let found = diagnose(&made_up("sessions/spindle.csv"), &[]);
    stated(
        &found,
        &[
            "log of displacement at one position",
            "180 samples of 5 probes, 2 temperatures, spindle speed",
            "ch1_um along x, ch2_um along x, ch3_um along y, ch4_um along y, ch5_um along z; --series states them",
        ],
    );
    assert!(!notes(&found.0).contains("times are"), "a logger samples evenly");
    let one = diagnose(&made_up("sessions/spindle.csv"), &["--series", "z=ch5_um"]);
    assert!(!one.1.contains("assumed"), "{}", one.1);
    // two columns whose names say nothing are not guessed
    let directory = tempfile::tempdir().unwrap();
    let two = std::fs::read_to_string(made_up("sessions/spindle.csv")).unwrap();
    let two: Vec<String> = two
        .lines()
        .map(|l| {
            l.split(',')
                .enumerate()
                .filter(|(i, _)| ![4, 5, 6].contains(i))
                .map(|(_, f)| f)
                .collect::<Vec<_>>()
                .join(",")
        })
        .collect();
    let path = directory.path().join("two.csv");
    std::fs::write(&path, two.join("\n")).unwrap();
    let said = refused(&path, 64);
    assert!(
        said.contains("2 columns of displacement (ch1_um, ch2_um)") && said.contains("--series"),
        "{said}"
    );
}

#[test]
fn what_holds_no_readings_of_a_machine_is_refused_with_the_reason() {
    let ballbar = refused(&made_up("sessions/figures.b5r"), 65);
    for wanted in [
        "a ballbar report (.b5r), plane XY with 3 figures of an analysis and without its readings",
        "hint: save the readings as CSV with angle_deg,deviation_um,direction",
        "squareness: -12.5 µm/m",
        "backlash of the first axis, end +: 3.25 µm",
    ] {
        assert!(ballbar.contains(wanted), "{wanted}: {ballbar}");
    }
    let robot = refused(&made_up("sessions/reflectors.csv"), 65);
    assert!(
        robot.contains("12 poses of three reflectors (sides 240.0") && robot.contains("a robot"),
        "{robot}"
    );
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("table");
    std::fs::write(&path, "X EXX\n0 0\n10 0.001\n").unwrap();
    let table = refused(&path, 65);
    assert!(table.contains("a compensation table of a control, not a measurement"), "{table}");
    std::fs::write(&path, "Report of a test\n\nB 20.0, E 100.1, M 84.3\n").unwrap();
    let report = refused(&path, 65);
    assert!(
        report.contains("neither a session file") && report.contains("hint: read are ISO 230-2 tests (.dat"),
        "{report}"
    );
}

#[test]
fn the_times_of_session_files_are_judged_by_their_steps() {
    for (name, wanted) in [
        ("sessions/ordinal.csv", "times are ordinal (t_s counts the readings)"),
        ("sessions/same-steps.csv", "times are ordinal (equal steps between readings whatever the distance)"),
    ] {
        let (r, _) = diagnose(&made_up(name), &[]);
        assert!(notes(&r).contains(wanted), "{name}: {}", notes(&r));
        assert!((parameter(&r, "backlash", "x", "width_um") - 10.0).abs() < 1.0, "{name}");
    }
    let (r, _) = diagnose(&made_up("sessions/clock.csv"), &[]);
    assert!(!notes(&r).contains("times are"), "{}", notes(&r));
}

/// Readings at rest at one place with a wave over time.
fn wave(step_s: f64, hertz: f64) -> String {
    let mut text = "t_s,instrument,setup,run,repeat,x_mm,u_x,u_y,u_z,deviation_um\n".to_owned();
    for k in 0..600 {
        let t = f64::from(k) * step_s;
        let noise = (f64::from(k * k) * 2.399).sin();
        let d = 3.0 * (core::f64::consts::TAU * hertz * t).sin() + noise;
        writeln!(text, "{t:.4},probe,1,1,1,100,1,0,0,{d:.4}").unwrap();
    }
    text
}

#[test]
fn a_vibration_needs_readings_fast_enough_to_show_it() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("wave.csv");
    let declared = |step_s: f64, hertz: f64| {
        std::fs::write(&path, wave(step_s, hertz)).unwrap();
        let (r, _) = diagnose(&path, &[]);
        let all = r["causes"].as_array().unwrap();
        all.iter().any(|c| c["effect"] == "vibration")
    };
    assert!(declared(0.005, 12.0), "12 Hz at 200 readings per second");
    assert!(!declared(10.0, 0.01), "a period of 100 s is drift");
    assert!(!declared(1.0, 0.12), "a period of 8 s is drift");
}

#[test]
fn what_is_found_without_a_model_can_be_applied() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    let done = run(d, &made_up("sessions/positioning.csv"), &[]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let volcomp = |args: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_volcomp")).current_dir(d).args(args).output().unwrap()
    };
    let extend = ["model", "extend", "--add", "out/addition.toml"];
    let done = volcomp(&[&extend[..], &["--out", "better.toml", "--model", "out/model.toml"]].concat());
    assert!(done.status.success(), "{}", text(&done.stderr));
    assert!(text(&done.stdout).contains("scale:x: in the model, EXX"), "{}", text(&done.stdout));
    let model = std::fs::read_to_string(d.join("better.toml")).unwrap();
    assert!(model.contains("chain = \"[w b X t]\"") && model.contains("travel-mm = [0, 300]"), "{model}");
    // beside a model that corrects something already it would be counted twice
    let done = volcomp(&[&extend[..], &["--out", "twice.toml", "--model", "better.toml"]].concat());
    let said = text(&done.stderr);
    assert!(done.status.code() == Some(78) && said.contains("found without a model"), "{said}");
    assert!(said.contains("diagnose again with --model"), "{said}");
}

#[test]
fn a_session_file_that_lacks_a_column_stays_a_session_file() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("s.csv");
    std::fs::write(&path, "t_s,setup,run,repeat,x_mm,deviation_um,temp_x_degc\n0,1,1,1,0,1.5,20\n").unwrap();
    let said = refused(&path, 65);
    assert!(said.contains("column u_x is missing"), "{said}");
}

#[test]
fn help_names_the_formats_and_their_page() {
    let help = Command::new(env!("CARGO_BIN_EXE_volcomp")).args(["diagnose", "--help"]).output().unwrap();
    let help = text(&help.stdout);
    for wanted in ["docs/reference/session-files.md", ".rtl", "plate", "order measured", "model.toml"] {
        assert!(help.contains(wanted), "{wanted}: {help}");
    }
}
