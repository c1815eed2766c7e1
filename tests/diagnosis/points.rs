//! Points in the frame of a tracker or a CMM: registration, directions, repetitions and refusals, on a machine made up here.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes and reads files")]

use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::Command;

use nalgebra::{Rotation3, Vector3};

use super::instruments::{cause, diagnose, parameter, text};
use crate::support::normal;

/// X is 12 ppm too long, Y leans by 60 urad towards -X.
const SCALE_X: f64 = 12e-6;
const LEAN_Y: f64 = -60e-6;
/// A table under X, Y and Z.
const TABLE: &str = "format = \"volcomp-model/1\"\nmachine = \"t\"\nchain = \"[w C' b X Y Z t]\"\n[frame]\ntool-tip-mm = [0.0, 0.0, -80.0]\n\
    workpiece-origin-mm = [300.0, 200.0, 0.0]\n[axes.c]\npoint-mm = [310.0, 190.0, 0.0]\n";

#[derive(Clone, Copy, PartialEq)]
enum Columns {
    Cartesian,
    Spherical,
}

/// Points of a grid, twice, with noise of 1 um along and 5 um across the beam; the second time with the table turned by `turn_deg`.
fn points(columns: Columns, turn_deg: Option<f64>) -> Vec<String> {
    let frame = Rotation3::from_euler_angles(0.04, -0.03, 2.2);
    let station = Vector3::new(-1500.0, 300.0, 250.0);
    let measured = match columns {
        Columns::Cartesian => "measured_x_mm,measured_y_mm,measured_z_mm",
        Columns::Spherical => "measured_range_mm,measured_azimuth_deg,measured_elevation_deg",
    };
    let mut rows =
        vec![format!("x_mm,y_mm,z_mm,{}{measured}", if turn_deg.is_some() { "c_deg," } else { "" })];
    let mut noise = normal(3);
    for repeat in 0..2 {
        for k in 0..60 {
            let at = Vector3::new(
                f64::from(k % 5) * 150.0,
                f64::from(k / 5 % 4) * 130.0,
                f64::from(k / 20) * 150.0,
            );
            let turn = turn_deg.map_or(0.0, |t| f64::from(repeat) * t);
            let tip = at + Vector3::new(SCALE_X * at.x + LEAN_Y * at.y, 0.0, 0.0);
            // a table that is commanded to +c turns by -c under the tool, about its axis
            let place = if turn_deg.is_some() {
                let (tip, axis) = (tip + Vector3::new(0.0, 0.0, -80.0), Vector3::new(310.0, 190.0, 0.0));
                let turned =
                    Rotation3::from_axis_angle(&Vector3::z_axis(), turn.to_radians()) * (tip - axis) + axis;
                turned - Vector3::new(300.0, 200.0, 0.0)
            } else {
                tip
            };
            let seen = frame.inverse() * (place - station);
            let range = seen.norm() + 1e-3 * noise();
            let azimuth = seen.y.atan2(seen.x) + 5e-3 * noise() / range;
            let elevation = (seen.z / seen.norm()).asin() + 5e-3 * noise() / range;
            let mut row = format!("{},{},{},", at.x, at.y, at.z);
            if turn_deg.is_some() {
                write!(row, "{turn},").unwrap();
            }
            let [a, b, c] = match columns {
                Columns::Spherical => [range, azimuth.to_degrees(), elevation.to_degrees()],
                Columns::Cartesian => {
                    let ((se, ce), (sa, ca)) = (elevation.sin_cos(), azimuth.sin_cos());
                    [range * ce * ca, range * ce * sa, range * se]
                }
            };
            write!(row, "{a:.5},{b:.8},{c:.8}").unwrap();
            rows.push(row);
        }
    }
    rows
}

fn written(rows: &[String]) -> (tempfile::TempDir, PathBuf) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("points");
    std::fs::write(&path, rows.join("\n") + "\n").unwrap();
    (directory, path)
}

#[test]
fn points_of_a_tracker_name_what_is_wrong_in_either_form() {
    for (columns, turn_deg) in
        [(Columns::Cartesian, None), (Columns::Spherical, None), (Columns::Cartesian, Some(75.0))]
    {
        let (directory, path) = written(&points(columns, turn_deg));
        let model = directory.path().join("model.toml");
        std::fs::write(&model, TABLE).unwrap();
        let model = model.to_string_lossy();
        let extra = if turn_deg.is_some() { vec!["--model", &model] } else { Vec::new() };
        let (report, said) = diagnose(&path, &extra);
        assert_eq!(report["rows"], 360, "three directions of each point");
        assert!(
            said.contains(
                "set-up 1: 120 points, origin of the instrument's frame at (-1500.0, 300.0, 250.0) mm"
            ),
            "{said}"
        );
        assert_eq!(cause(&report, "squareness", "xy")["declared"], true);
        assert_eq!(cause(&report, "scale", "x")["declared"], true, "{turn_deg:?}");
        let scale = parameter(&report, "scale", "x", "scale_ppm");
        assert!((scale - SCALE_X * 1e6).abs() < 3.0, "{scale} ppm, turned by {turn_deg:?}");
        let angle_rad = parameter(&report, "squareness", "xy", "angle_arcsec").to_radians() / 3600.0;
        assert!((angle_rad - LEAN_Y).abs() < 12e-6, "{angle_rad} rad, turned by {turn_deg:?}");
        let noise = report["noise"].as_array().unwrap();
        let white = |name: &str| {
            noise.iter().find(|n| n["instrument"] == name).unwrap()["white_um"].as_f64().unwrap()
        };
        // without a turn of the table both repetitions look along the same directions
        if turn_deg.is_none() {
            assert!((0.7..1.5).contains(&white("tracker range")), "{noise:?}");
            assert!((4.0..6.5).contains(&white("tracker angle")), "{noise:?}");
            assert!(said.contains("repetitions counted"), "{said}");
        }
    }
}

#[test]
fn a_frame_of_another_instrument_has_the_directions_of_the_machine() {
    let mut rows = points(Columns::Cartesian, None);
    for (i, row) in rows.iter_mut().enumerate() {
        *row = if i == 0 { format!("instrument,{row}") } else { format!("cmm,{row}") };
    }
    // a point that was not seen
    let lost = rows[7].split(',').take(4).chain(["", "", ""]).collect::<Vec<_>>().join(",");
    rows[7] = lost;
    let (_directory, path) = written(&rows);
    let (report, _) = diagnose(&path, &[]);
    assert_eq!(report["rows"], 357);
    assert_eq!(report["noise"].as_array().unwrap().len(), 1);
    assert_eq!(cause(&report, "squareness", "xy")["declared"], true);
}

#[test]
fn what_is_no_point_of_its_positions_is_refused_with_line_and_value() {
    let refused = |rows: &[String]| {
        let (_directory, path) = written(rows);
        let done = Command::new(env!("CARGO_BIN_EXE_volcomp")).arg("diagnose").arg(&path).output().unwrap();
        assert_eq!(done.status.code(), Some(65), "{}", text(&done.stdout));
        text(&done.stderr)
    };
    let good = points(Columns::Cartesian, None);
    let edited = |line: usize, edit: &dyn Fn(&mut Vec<String>)| {
        let mut rows = good.clone();
        let mut fields: Vec<String> = rows[line].split(',').map(str::to_owned).collect();
        edit(&mut fields);
        rows[line] = fields.join(",");
        refused(&rows)
    };
    let far = edited(30, &|f| f[4] = (f[4].parse::<f64>().unwrap() + 30.0).to_string());
    assert!(far.contains("points:31: the measured point is 29.") && far.contains("limit 5 mm"), "{far}");
    let half = edited(30, &|f| f[5] = String::new());
    assert!(half.contains("points:31: a point is whole"), "{half}");
    let nowhere = edited(30, &|f| f[0] = String::new());
    assert!(nowhere.contains("points:31: x_mm is empty"), "{nowhere}");
    let line: Vec<String> = good
        .iter()
        .enumerate()
        .filter(|(i, r)| *i == 0 || r.split(',').skip(1).take(2).all(|v| v == "0"))
        .map(|(_, r)| r.clone())
        .collect();
    assert!(refused(&line).contains("off one line"), "{}", refused(&line));
    let metres = edited(0, &|f| f[3] = "measured_x_m".to_owned());
    assert!(metres.contains("measured_x_mm, measured_y_mm, measured_z_mm or measured_range_mm"), "{metres}");
    let turning = refused(&points(Columns::Cartesian, Some(75.0)));
    assert!(turning.contains("axis C turns") && turning.contains("--model"), "{turning}");
}
