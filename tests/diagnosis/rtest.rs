//! R-tests: from where their readings count, on a machine made up here.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes and reads files")]

use std::fmt::Write as _;

use nalgebra::{Rotation3, Vector3};
use serde_json::Value;

use super::instruments::{diagnose, parameter};
use super::rough::declared;
use crate::support::normal;

/// A table under X, Y and Z.
const TABLE: &str = "format = \"volcomp-model/1\"\nmachine = \"t\"\nchain = \"[w C' b X Y Z t]\"\n[frame]\ntool-tip-mm = [0.0, 0.0, 0.0]\n\
    [axes.c]\npoint-mm = [300.0, 200.0, 0.0]\n";
const CENTRE: [f64; 3] = [300.0, 200.0, 0.0];
const NOISE_UM: f64 = 0.4;

/// What is known of a campaign.
#[derive(Clone, Copy)]
struct Truth {
    /// X is too long, um/mm.
    scale: f64,
    /// The table stands further along Y, um.
    shift: f64,
    /// Everything counts from where the ball was centred.
    centred: bool,
}

/// Deviation of the tool against the table at a position and an angle of the table, um.
fn deviation(truth: Truth, at: Vector3<f64>, turn: &Rotation3<f64>) -> Vector3<f64> {
    let shift = Vector3::new(0.0, truth.shift, 0.0);
    // the pieces on the table turn about its true axis, the control about where it believes it
    Vector3::new(truth.scale * at.x, 0.0, 0.0) - (shift - turn * shift)
}

/// Lines of a laser along X and Y (or none), and two balls on the table.
fn campaign(seed: u64, lines: &[usize], truth: Truth) -> Value {
    let mut noise = normal(seed);
    let mut table =
        "t_s,instrument,setup,run,repeat,x_mm,y_mm,z_mm,c_deg,u_x,u_y,u_z,target_x_mm,target_y_mm,target_z_mm,moving,deviation_um\n"
            .to_owned();
    let (mut t_s, mut run) = (0.0, 0);
    for (setup, axis) in (1..).zip(lines.iter().copied()) {
        let offset = 4.0 * noise();
        for repeat in 1..=5 {
            run += 1;
            for k in 0..21 {
                t_s += 1.5 + 0.3 * f64::from(k % 3);
                let mut at = Vector3::new(300.0, 200.0, 150.0);
                at[axis] = 30.0 * f64::from(k);
                let u: Vector3<f64> = Vector3::ith(axis, 1.0);
                let d = deviation(truth, at, &Rotation3::identity()).dot(&u) + offset + NOISE_UM * noise();
                writeln!(
                    table,
                    "{t_s:.1},laser,{setup},{run},{repeat},{:.3},{:.3},{:.3},0,{},{},{},,,,0,{d:.2}",
                    at.x, at.y, at.z, u.x, u.y, u.z
                )
                .unwrap();
            }
        }
    }
    for (setup, ball) in [(3, Vector3::new(420.0, 200.0, 150.0)), (4, Vector3::new(300.0, 350.0, 90.0))] {
        let offset = Vector3::from_fn(|_, _| 4.0 * noise());
        for repeat in 1..=3 {
            run += 1;
            for k in 0..25 {
                t_s += 2.0;
                let c_deg = 15.0 * f64::from(k);
                // a table that is commanded to +c turns by -c
                let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), -c_deg.to_radians());
                let at = turn * (ball - Vector3::from(CENTRE)) + Vector3::from(CENTRE);
                let zero = deviation(truth, ball, &Rotation3::identity());
                let d =
                    deviation(truth, at, &turn) - if truth.centred { turn * zero } else { Vector3::zeros() };
                let value = d + offset + Vector3::from_fn(|_, _| NOISE_UM * noise());
                rows(
                    &mut table,
                    &format!("{t_s:.1},r-test,{setup},{run},{repeat}"),
                    (at, &format!("{c_deg}")),
                    ball,
                    value,
                );
            }
        }
    }
    report(table, TABLE)
}

/// The three readings of a ball.
fn rows(
    table: &mut String,
    begin: &str,
    (at, turned_deg): (Vector3<f64>, &str),
    ball: Vector3<f64>,
    value: Vector3<f64>,
) {
    for axis in 0..3 {
        let u: Vector3<f64> = Vector3::ith(axis, 1.0);
        writeln!(
            table,
            "{begin},{:.4},{:.4},{:.4},{turned_deg},{},{},{},{},{},{},0,{:.2}",
            at.x, at.y, at.z, u.x, u.y, u.z, ball.x, ball.y, ball.z, value[axis]
        )
        .unwrap();
    }
}

fn report(table: String, machine: &str) -> Value {
    let directory = tempfile::tempdir().unwrap();
    let (path, model) = (directory.path().join("campaign.csv"), directory.path().join("model.toml"));
    std::fs::write(&path, table).unwrap();
    std::fs::write(&model, machine).unwrap();
    diagnose(&path, &["--model", &model.to_string_lossy()]).0
}

#[test]
fn errors_of_the_linear_axes_are_no_location_of_the_table_wherever_the_ball_counts_from() {
    for centred in [false, true] {
        for (scale, shift) in [(0.04, 0.0), (0.0, 6.0), (0.04, 6.0)] {
            let report = campaign(7, &[0, 1], Truth { scale, shift, centred });
            let expected: Vec<&str> = [("rotary-location:c", shift), ("scale:x", scale)]
                .iter()
                .filter(|e| e.1 != 0.0)
                .map(|e| e.0)
                .collect();
            assert_eq!(declared(&report), expected, "centred: {centred}, scale {scale}, shift {shift}");
            if scale > 0.0 {
                let ppm = parameter(&report, "scale", "x", "scale_ppm");
                assert!((ppm - 1e3 * scale).abs() < 2.0, "{ppm} ppm, centred: {centred}");
                let notes = report["notes"].to_string();
                assert_eq!(notes.contains("count from the centring of the ball"), centred, "{notes}");
            }
        }
    }
}

#[test]
fn the_zero_of_the_ball_is_found_from_an_r_test_alone() {
    for centred in [false, true] {
        let report = campaign(9, &[], Truth { scale: 0.04, shift: 6.0, centred });
        assert_eq!(declared(&report), ["rotary-location:c", "scale:x"], "centred: {centred}");
        let notes = report["notes"].to_string();
        assert_eq!(notes.contains("count from the centring of the ball"), centred, "{notes}");
    }
}

/// C on A on the bed, as a swivelling table has them.
const TRUNNION: &str = "format = \"volcomp-model/1\"\nmachine = \"t\"\nchain = \"[w C' A' b X Y Z t]\"\n[frame]\n\
    tool-tip-mm = [0.0, 0.0, 0.0]\n[axes.a]\npoint-mm = [300.0, 200.0, -40.0]\n[axes.c]\npoint-mm = [300.0, 200.0, 0.0]\n";

/// Where the two axes take a point on the table at home; a table that is commanded to + turns by -.
fn swivelled(at: Vector3<f64>, a: f64, c: f64) -> Vector3<f64> {
    let (on_a, on_c) = (Vector3::new(300.0, 200.0, -40.0), Vector3::from(CENTRE));
    let turn = |about, angle: f64| Rotation3::from_axis_angle(&about, -angle);
    turn(Vector3::x_axis(), a) * (turn(Vector3::z_axis(), c) * (at - on_c) + on_c - on_a) + on_a
}

#[test]
fn the_location_of_a_swivel_carries_the_table_on_it_along() {
    const SHIFT_MM: [f64; 3] = [0.0, 0.005, -0.004];
    let mut noise = normal(11);
    let mut table = "t_s,instrument,setup,run,repeat,x_mm,y_mm,z_mm,a_deg,c_deg,u_x,u_y,u_z,target_x_mm,target_y_mm,target_z_mm,moving,deviation_um\n".to_owned();
    let mut t_s = 0.0;
    for (setup, ball) in [(1, Vector3::new(400.0, 200.0, 60.0)), (2, Vector3::new(280.0, 300.0, 110.0))] {
        let offset = Vector3::from_fn(|_, _| 4.0 * noise());
        for (run, a_deg) in [0.0, -40.0, -20.0, 30.0, 0.0].into_iter().enumerate() {
            for k in 0..20 {
                t_s += 2.0;
                let c_deg = 18.0 * f64::from(k);
                let (a, c) = (f64::to_radians(a_deg), f64::to_radians(c_deg));
                let at = swivelled(ball, a, c);
                // both axes stand further along, and the ball was centred on the table as it stands
                let shift = Vector3::from(SHIFT_MM);
                let ball_is_at = swivelled(ball, a, c) + shift;
                let centred = swivelled(ball + shift, a, c);
                let d = 1e3 * (centred - ball_is_at);
                let value = d + offset + Vector3::from_fn(|_, _| NOISE_UM * noise());
                let run = run + 10 * setup;
                rows(
                    &mut table,
                    &format!("{t_s:.1},r-test,{setup},{run},1"),
                    (at, &format!("{a_deg},{c_deg}")),
                    ball,
                    value,
                );
            }
        }
    }
    let report = report(table, TRUNNION);
    assert_eq!(declared(&report), ["rotary-location:a"]);
    for (name, shift_mm) in [("shift_y_um", SHIFT_MM[1]), ("shift_z_um", SHIFT_MM[2])] {
        let found = parameter(&report, "rotary-location", "a", name);
        assert!((found - 1e3 * shift_mm).abs() < 0.3, "{name}: {found}");
    }
}

#[test]
fn a_tilt_of_the_table_that_no_alignment_took_out_is_one_error_beside_lines_over_the_volume() {
    const TILT_ARCSEC: [f64; 3] = [6.0, -4.0, 0.0];
    let tilt = Vector3::from(TILT_ARCSEC).map(|v| v / 3600.0).map(f64::to_radians);
    // the whole table is tilted, at zero, too
    let deviation = |at: Vector3<f64>| -1e3 * tilt.cross(&(at - Vector3::from(CENTRE)));
    let mut noise = normal(13);
    let mut table =
        "t_s,instrument,setup,run,repeat,x_mm,y_mm,z_mm,c_deg,u_x,u_y,u_z,target_x_mm,target_y_mm,target_z_mm,moving,deviation_um\n"
            .to_owned();
    let mut t_s = 0.0;
    for (setup, axis) in [(1, 0), (2, 1), (3, 2)] {
        let offset = 4.0 * noise();
        let u: Vector3<f64> = Vector3::ith(axis, 1.0);
        for k in 0..150 {
            t_s += 1.5;
            // lines that cross the volume, one after the other
            let along = f64::from(k % 25) / 24.0;
            let at = Vector3::new(600.0 * along, 80.0 * f64::from(k / 25), 300.0 * (1.0 - along));
            let d = deviation(at).dot(&u) + offset + NOISE_UM * noise();
            writeln!(
                table,
                "{t_s:.1},laser in flight,{setup},{},1,{:.3},{:.3},{:.3},0,{},{},{},,,,0,{d:.2}",
                k / 75 + 1,
                at.x,
                at.y,
                at.z,
                u.x,
                u.y,
                u.z
            )
            .unwrap();
        }
    }
    for (setup, ball) in [(4, Vector3::new(420.0, 200.0, 150.0)), (5, Vector3::new(300.0, 350.0, 90.0))] {
        let offset = Vector3::from_fn(|_, _| 4.0 * noise());
        for repeat in 1..=3 {
            for k in 0..25 {
                t_s += 2.0;
                let c_deg = 15.0 * f64::from(k);
                let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), -c_deg.to_radians());
                let at = turn * (ball - Vector3::from(CENTRE)) + Vector3::from(CENTRE);
                let d = deviation(at) - turn * deviation(ball);
                let value = d + offset + Vector3::from_fn(|_, _| NOISE_UM * noise());
                let begin = format!("{t_s:.1},r-test,{setup},{repeat},{repeat}");
                rows(&mut table, &begin, (at, &format!("{c_deg}")), ball, value);
            }
        }
    }
    let report = report(table, TABLE);
    assert_eq!(declared(&report), ["rotary-location:c"]);
    for (name, arcsec) in [("tilt_x_arcsec", TILT_ARCSEC[0]), ("tilt_y_arcsec", TILT_ARCSEC[1])] {
        let found = parameter(&report, "rotary-location", "c", name);
        assert!((found - arcsec).abs() < 0.3, "{name}: {found}");
    }
}
