//! Tests that read angles (rotary axes, angular error motions) or readings across an axis: what they cannot see is not named.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes and reads files")]

use std::fmt::Write;

use serde_json::Value;

use super::instruments::diagnose;
use super::support::normal;

/// A table with the columns of ISO 230-2 for a rotary axis: five cycles over the whole turn and back; `angle_arcsec` of
/// position (deg) and direction.
fn test(seed: u64, noise_arcsec: f64, angle_arcsec: &dyn Fn(f64, f64) -> f64) -> String {
    test_at(&core::array::from_fn::<f64, 13, _>(|k| 30.0 * k as f64), seed, noise_arcsec, angle_arcsec)
}

/// The same at some targets, deg.
fn test_at(targets: &[f64], seed: u64, noise_arcsec: f64, angle_arcsec: &dyn Fn(f64, f64) -> f64) -> String {
    let mut noise = normal(seed);
    let mut table = "cycle,direction,target_deg,deviation_arcsec\n".to_owned();
    for cycle in 1..=5 {
        for sign in [1.0, -1.0] {
            for k in 0..targets.len() {
                let target = targets[if sign > 0.0 { k } else { targets.len() - 1 - k }];
                let deviation = angle_arcsec(target, sign) + noise_arcsec * noise();
                writeln!(table, "{cycle},{sign},{target},{deviation:.3}").unwrap();
            }
        }
    }
    table
}

fn report(table: &str, model: Option<&str>, axis: &str) -> Value {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("c.csv");
    std::fs::write(&path, table).unwrap();
    let mut options = vec!["--axis", axis];
    let model_path = directory.path().join("model.toml");
    if let Some(model) = model {
        std::fs::write(&model_path, model).unwrap();
        options.extend(["--model", model_path.to_str().unwrap()]);
    }
    diagnose(&path, &options).0
}

fn declared(report: &Value) -> Vec<String> {
    let mut all = super::cli::declared(report);
    all.sort();
    all
}

#[test]
fn an_eccentric_scale_is_no_location_of_the_axis() {
    for (seed, axis) in [(1, "c"), (2, "a"), (3, "b"), (4, "c")] {
        let phase = f64::from(seed as u32) * 1.7;
        let truth = |q: f64, sign: f64| {
            5.0 * ((q.to_radians() + phase).sin() - phase.sin()) + if sign < 0.0 { 2.0 } else { 0.0 }
        };
        let found = report(&test(seed, 0.3, &truth), None, axis);
        assert_eq!(
            declared(&found),
            [format!("backlash:{axis}"), format!("rotary-eccentricity:{axis}")],
            "{seed}"
        );
        for cause in found["causes"].as_array().unwrap() {
            assert_ne!(cause["effect"], "rotary-location", "translations are not seen in angles");
            let group = cause["confounded_with"].to_string();
            assert!(!group.contains("rotary-location") && !group.contains("rotary-motion"), "{group}");
        }
    }
}

#[test]
fn the_wave_of_a_worm_wheel_is_named_with_its_number_of_teeth() {
    for (seed, teeth) in [(11, 72.0), (12, 90.0), (13, 118.0)] {
        // no two distances are equal, so that no slower wave looks the same
        let targets: [f64; 21] =
            core::array::from_fn(|k| 17.0 * k as f64 + 5.0 * ((7 * k * k) % 19) as f64 / 19.0);
        let truth = |q: f64, sign: f64| {
            1.5 * (teeth * q.to_radians() + f64::from(seed as u32)).sin() + if sign < 0.0 { 2.0 } else { 0.0 }
        };
        let found = report(&test_at(&targets, seed, 0.5, &truth), None, "c");
        assert_eq!(declared(&found), ["backlash:c", "cyclic:c"], "{teeth}");
        let causes = found["causes"].as_array().unwrap();
        let wave = causes.iter().find(|c| c["effect"] == "cyclic").unwrap();
        assert_eq!(wave["parameters"]["waves_per_turn_1"]["value"], teeth);
        assert!((wave["parameters"]["pitch_deg"]["value"].as_f64().unwrap() - 360.0 / teeth).abs() < 1e-9);
    }
}

#[test]
fn values_at_the_stations_of_an_indexing_table_are_its_positioning() {
    for seed in [21, 22] {
        let mut station = normal(seed + 100);
        let values: [f64; 13] = core::array::from_fn(|_| 3.0 * station());
        let truth = |q: f64, _: f64| values[(q / 30.0).round() as usize % 12];
        let found = report(&test(seed, 0.5, &truth), None, "c");
        assert_eq!(declared(&found), ["positioning:c"], "{seed}");
    }
}

/// A machine whose rotary axis is displaced, turns with an error of its own, and stands on crooked linear axes.
fn machine(chain: &str) -> String {
    format!(
        r#"format = "volcomp-model/1"
machine = "m"
chain = "{chain}"

[frame]
tool-tip-mm = [3, -4, -200]

[axes.c]
point-mm = [20, -10, 0]

[errors]
ex0c.constant.value-um = 40.0
ey0c.constant.value-um = -25.0
ec0y.constant.value-arcsec = 12.0

[errors.ecc.fourier]
span-deg = 360
period-deg = 360
cos-arcsec = [0.0, 1.5]
sin-arcsec = [6.0]
"#
    )
}

#[test]
fn a_model_predicts_the_angle_on_either_side_of_the_chain() {
    let truth = |q: f64, _: f64| {
        let q = q.to_radians();
        6.0 * q.sin() + 1.5 * (2.0 * q).cos()
    };
    for chain in ["[w C' b X Y Z t]", "[w b X Y Z C t]"] {
        let found = report(&test(5, 0.3, &truth), Some(&machine(chain)), "c");
        let of = |key: &str| found["gap"][key].as_f64().unwrap();
        assert!(of("rms_um") < 1.2 * of("noise_um"), "{chain}: {}", found["gap"]);
        assert_eq!(declared(&found), [""; 0], "{chain}");
        let without = report(&test(5, 0.3, &truth), None, "c");
        assert!(without["gap"]["rms_um"].as_f64().unwrap() > 10.0 * of("rms_um"));
    }
}

/// A session of readings (x mm, value um) of one instrument: five times there and back, with its direction of sensitivity and lever.
fn across(
    setup: &str,
    u: [f64; 3],
    lever: Option<[f64; 3]>,
    seed: u64,
    value_um: &dyn Fn(f64) -> f64,
) -> String {
    let mut noise = normal(seed);
    let mut rows = String::new();
    for repeat in 1..=5 {
        for k in 0..42 {
            let x = 50.0 * f64::from(if k < 21 { k } else { 41 - k });
            let t = f64::from(repeat * 42 + k) * 7.0 + 2000.0 * seed as f64;
            write!(rows, "{t},level,{setup},{repeat},{repeat},{x},0,0,{},{},{},", u[0], u[1], u[2]).unwrap();
            write!(rows, "{:.4}", value_um(x) + 0.1 * noise()).unwrap();
            if let Some(lever) = lever {
                write!(rows, ",{},{},{}", lever[0], lever[1], lever[2]).unwrap();
            }
            rows.push('\n');
        }
    }
    rows
}

const COLUMNS: &str = "t_s,instrument,setup,run,repeat,x_mm,y_mm,z_mm,u_x,u_y,u_z,deviation_um";

fn session(columns: &str, rows: &[String]) -> Value {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("s.csv");
    std::fs::write(&path, format!("{columns}\n{}", rows.concat())).unwrap();
    diagnose(&path, &[]).0
}

#[test]
fn angles_of_a_linear_axis_are_its_angular_error_motions() {
    let um = |arcsec: f64| 100.0 * 1e3 * (arcsec / 3600.0).to_radians();
    // a turn about y moves a point on x against z, one about z along y
    let ebx = across("1", [0.0, 0.0, -1.0], Some([100.0, 0.0, 0.0]), 1, &|x| um(6.0 * (x / 400.0).sin()));
    let ecx = across("2", [0.0, 1.0, 0.0], Some([100.0, 0.0, 0.0]), 2, &|x| um(-9.0 * (x / 300.0).sin()));
    let found = session(&format!("{COLUMNS},lever_x_mm,lever_y_mm,lever_z_mm"), &[ebx, ecx]);
    assert_eq!(declared(&found), ["angular:ebx", "angular:ecx"], "{found}");
}

#[test]
fn the_slope_of_a_straightness_test_is_that_of_its_reference_line() {
    let bow = |x: f64| 6.0 * (1.0 - (x / 500.0 - 1.0).powi(2));
    for slope_um_per_m in [0.0, 20.0, -150.0] {
        let line = |x: f64| slope_um_per_m * x * 1e-3;
        let crooked = across("1", [0.0, 0.0, 1.0], None, 3, &|x| line(x) + bow(x));
        assert_eq!(declared(&session(COLUMNS, &[crooked])), ["straightness:ezx"], "{slope_um_per_m}");
        let straight = session(COLUMNS, &[across("1", [0.0, 0.0, 1.0], None, 4, &line)]);
        assert_eq!(declared(&straight), [""; 0], "{slope_um_per_m}");
        assert!(straight["gap"]["rms_um"].as_f64().unwrap() < 0.15, "{}", straight["gap"]);
    }
}

#[test]
fn a_few_targets_are_a_table_that_does_not_swing_between_them() {
    let values = [1.4, 17.6, -11.5, 3.7, -8.3, -33.7, 0.1, 50.8, -20.1];
    let mut table = "cycle,direction,target_mm,deviation_um\n".to_owned();
    let mut noise = normal(9);
    for cycle in 1..=5 {
        for k in (0..9).chain((0..9).rev()) {
            let direction = if table.lines().count() % 18 < 10 { 1 } else { -1 };
            writeln!(table, "{cycle},{direction},{},{:.3}", 40 * k, values[k] + 1.2 * noise()).unwrap();
        }
    }
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    std::fs::write(d.join("x.csv"), table).unwrap();
    let volcomp = |args: &[&str]| {
        let done = std::process::Command::new(env!("CARGO_BIN_EXE_volcomp"))
            .current_dir(d)
            .args(args)
            .output()
            .unwrap();
        assert!(done.status.success(), "{args:?}: {}", String::from_utf8_lossy(&done.stderr));
    };
    volcomp(&["diagnose", "x.csv", "--axis", "x", "--out", "o"]);
    let found: Value =
        serde_json::from_str(&std::fs::read_to_string(d.join("o/report.json")).unwrap()).unwrap();
    assert_eq!(declared(&found), ["positioning:x"], "{found}");
    volcomp(&["model", "extend", "--model", "o/model.toml", "--add", "o/addition.toml", "--out", "m.toml"]);
    let points: String = (0..=320).map(|x| format!("{x}\n")).collect();
    std::fs::write(d.join("p.csv"), format!("x_mm\n{points}")).unwrap();
    volcomp(&["predict", "--model", "m.toml", "--points", "p.csv", "--out", "e.csv"]);
    let text = std::fs::read_to_string(d.join("e.csv")).unwrap();
    let column = text.lines().next().unwrap().split(',').position(|c| c == "dx_um").unwrap();
    let curve: Vec<f64> =
        text.lines().skip(1).map(|l| l.split(',').nth(column).unwrap().parse().unwrap()).collect();
    let line_um = |k: usize| curve[40 * k] - values[k];
    for k in 1..8 {
        // the values up to the straight line that is a scale
        let expected = line_um(0) + (line_um(8) - line_um(0)) * k as f64 / 8.0;
        assert!((line_um(k) - expected).abs() < 3.0, "{k}: {} {expected}", line_um(k));
    }
    let largest = curve.iter().map(|v| v.abs()).fold(0.0, f64::max);
    assert!(largest < 60.0, "{largest} um between the targets");
}

/// A day at the tool: the spindle runs in blocks, the structure grows with two time constants, a thermometer sits at the nose and
/// another in the hall.
#[test]
fn a_thermometer_that_follows_the_spindle_is_no_ambient_temperature() {
    let mut noise = normal(77);
    let mut log = "t_s,spindle_rpm,z_um,t_front_degC,t_hall_degC\n".to_owned();
    let (mut fast, mut slow, mut nose) = (0.0, 0.0, 0.0);
    for k in 0..1440 {
        let t = 60.0 * f64::from(k);
        let rpm = [0.0, 8000.0, 4000.0, 0.0, 10_000.0, 6000.0][(k / 120 % 6) as usize];
        let follow = |value: f64, tau: f64| value + (rpm / 1000.0 - value) * (60.0 / tau);
        (fast, slow, nose) = (follow(fast, 1000.0), follow(slow, 9000.0), follow(nose, 900.0));
        let hall = 21.0 + 1.5 * (t / 86_400.0 * core::f64::consts::TAU).sin();
        let grown = -(1.0 * fast + 1.5 * slow) + 0.2 * noise();
        writeln!(log, "{t},{rpm},{grown:.2},{:.1},{hall:.1}", 21.0 + 0.8 * nose).unwrap();
    }
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("log.csv");
    let found = |log: &str| {
        std::fs::write(&path, log).unwrap();
        diagnose(&path, &["--series", "z=z_um"])
    };
    let (report, _) = found(&log);
    assert_eq!(declared(&report), ["spindle-growth:"]);
    // as a logger writes it: dates with times, units in brackets, a column of its own
    let mut lines = log.lines();
    lines.next();
    let mut dated = "time,spindle_rpm,z_um,front [°C],hall [°C],door\n".to_owned();
    for (k, line) in lines.enumerate() {
        let (_, rest) = line.split_once(',').unwrap();
        writeln!(dated, "2026-03-02 {:02}:{:02}:00,{rest},0", k / 60, k % 60).unwrap();
    }
    let (report, told) = found(&dated);
    assert_eq!(declared(&report), ["spindle-growth:"]);
    assert!(
        told.contains("2 temperatures, spindle speed") && told.contains("columns not used: door"),
        "{told}"
    );
}

#[test]
fn a_line_at_one_place_of_the_other_axes_shows_a_scale_and_no_angle() {
    let model = "format = \"volcomp-model/1\"\nmachine = \"mill\"\nchain = \"[w X' Y' b Z t]\"\n\
                 [frame]\nworkpiece-origin-mm = [0, 0, -620]\ntool-tip-mm = [0, 0, -120]\n\
                 [axes.x]\ntravel-mm = [0, 850]\n[axes.y]\ntravel-mm = [0, 500]\n[axes.z]\ntravel-mm = [-500, 0]\n";
    let mut noise = normal(5);
    let mut table = "cycle,direction,target_mm,deviation_um\n".to_owned();
    for cycle in 1..=5 {
        for sign in [1.0, -1.0] {
            for k in 0..21 {
                let x = 17.0 + 41.0 * f64::from(if sign > 0.0 { k } else { 20 - k });
                writeln!(table, "{cycle},{sign},{x},{:.2}", -0.017 * x + 0.1 * noise()).unwrap();
            }
        }
    }
    assert_eq!(declared(&report(&table, Some(model), "x")), ["scale:x"]);
}
