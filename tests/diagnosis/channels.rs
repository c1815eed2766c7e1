//! A laser of six degrees of freedom, all channels of a mounting under one number: its beam is not parallel to the axis, and its
//! angles have zeros of their own.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes and reads files")]

use std::fmt::Write as _;

use serde_json::Value;

use super::instruments::{diagnose, parameter};
use super::rough::declared;
use crate::support::normal;

const LENGTH_MM: f64 = 500.0;
const LEVER_MM: f64 = 100.0;
const NOISE_UM: f64 = 0.3;

/// Lines along X, Y and Z, there and back three times. `error` of the axis, the direction of travel and the position, mm: a displacement,
/// um, and a rotation, arcsec.
fn lines(seed: u64, error: &dyn Fn(usize, f64, f64) -> ([f64; 3], [f64; 3])) -> Value {
    let mut noise = normal(seed);
    let mut table =
        "t_s,instrument,setup,run,repeat,x_mm,y_mm,z_mm,u_x,u_y,u_z,lever_x_mm,lever_y_mm,lever_z_mm,\
                     moving,deviation_um\n"
            .to_owned();
    let unit = |k: usize| -> [f64; 3] { core::array::from_fn(|j| if j == k { 1.0 } else { 0.0 }) };
    let (mut t_s, mut run) = (0.0, 0);
    for axis in 0..3 {
        let offsets: [f64; 6] = core::array::from_fn(|_| 6.0 * noise());
        // um/mm: 10 um over the length
        let slopes: [f64; 3] = core::array::from_fn(|k| if k == axis { 0.0 } else { 0.02 * noise() });
        for repeat in 1..=3 {
            for sense in [1.0, -1.0] {
                run += 1;
                for k in 0..17 {
                    t_s += 1.3 + 0.2 * f64::from(k % 3);
                    let target = if sense > 0.0 { k } else { 16 - k };
                    let at = LENGTH_MM * f64::from(target) / 16.0;
                    let position: [f64; 3] = core::array::from_fn(|k| if k == axis { at } else { 0.0 });
                    let (displacement, turn) = error(axis, sense, at);
                    for (channel, offset) in offsets.into_iter().enumerate() {
                        let k = channel % 3;
                        // axis = lever x u
                        let (u, lever) = if channel < 3 {
                            (unit(k), None)
                        } else {
                            (unit((k + 2) % 3), Some(unit((k + 1) % 3)))
                        };
                        let seen = match lever {
                            None => displacement[k] + slopes[k] * at,
                            Some(_) => LEVER_MM * 1e3 * (turn[k] / 3600.0).to_radians(),
                        };
                        let deviation = seen + offset + NOISE_UM * noise();
                        let lever = lever
                            .map_or(",,".to_owned(), |l| l.map(|v| (LEVER_MM * v).to_string()).join(","));
                        let [p, u] = [position, u].map(|v| v.map(|v| v.to_string()).join(","));
                        writeln!(
                            table,
                            "{t_s:.1},laser,{axis},{run},{repeat},{p},{u},{lever},0,{deviation:.3}"
                        )
                        .unwrap();
                    }
                }
            }
        }
    }
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("laser.csv");
    std::fs::write(&path, table).unwrap();
    diagnose(&path, &[]).0
}

#[test]
fn the_mounting_of_a_laser_of_six_channels_is_no_error_of_the_machine() {
    for seed in 1..=2 {
        let report = lines(seed, &|_, _, _| ([0.0; 3], [0.0; 3]));
        assert_eq!((declared(&report), &report["verdict"]), (vec![], &Value::from("no-gap")), "seed {seed}");
        let backlash =
            |axis: usize, sense: f64, _: f64| ([if axis == 0 { -sense } else { 0.0 }, 0.0, 0.0], [0.0; 3]);
        let report = lines(10 + seed, &backlash);
        assert_eq!(declared(&report), ["backlash:x"], "seed {seed}");
        assert!((parameter(&report, "backlash", "x", "width_um") - 2.0).abs() < 0.2, "seed {seed}");
    }
}

#[test]
fn angles_and_straightness_of_one_mounting_are_found() {
    let wave = |at: f64| (core::f64::consts::TAU * at / LENGTH_MM).cos();
    let report = lines(21, &|axis, _, at| match axis {
        // yaw of X and what it does to a tool at its zero, and a bend of Y
        0 => ([0.0; 3], [0.0, 0.0, 4.0 * wave(at)]),
        1 => ([3.0 * wave(at), 0.0, 0.0], [0.0; 3]),
        _ => ([0.0; 3], [0.0; 3]),
    });
    assert_eq!(declared(&report), ["angular:ecx", "straightness:exy"]);
}
