//! ISO 230-2 tests of one axis: what the places of the targets let tell apart.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes and reads files")]

use core::f64::consts::TAU;
use std::fmt::Write as _;

use serde_json::Value;

use crate::instruments::diagnose;
use crate::support::normal;

/// The report on a test of X, both directions, with noise of 0.5 um; the deviation in um by number and place of the target.
fn tested(targets_mm: &[f64], cycles: u32, seed: u64, deviation_um: impl Fn(usize, f64) -> f64) -> Value {
    tested_by_direction(targets_mm, cycles, seed, |k, x, _| deviation_um(k, x))
}

/// The same, the deviation by direction of travel, too: 1 or -1.
fn tested_by_direction(
    targets_mm: &[f64],
    cycles: u32,
    seed: u64,
    deviation_um: impl Fn(usize, f64, i32) -> f64,
) -> Value {
    let mut noise = normal(seed);
    let mut table = "cycle,direction,target_mm,deviation_um\n".to_owned();
    for cycle in 1..=cycles {
        let targets = targets_mm.iter().copied().enumerate();
        for (sign, way) in [(1, targets.clone().collect::<Vec<_>>()), (-1, targets.rev().collect())] {
            for (k, x) in way {
                writeln!(table, "{cycle},{sign},{x:.2},{:.3}", deviation_um(k, x, sign) + 0.5 * noise())
                    .unwrap();
            }
        }
    }
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.csv");
    std::fs::write(&path, table).unwrap();
    diagnose(&path, &["--axis", "x"]).0
}

fn declared(r: &Value) -> Vec<&str> {
    let causes = r["causes"].as_array().unwrap().iter().filter(|c| c["declared"] == true);
    causes.map(|c| c["effect"].as_str().unwrap()).collect()
}

/// Targets as ISO 230-2 asks for: (i - 1) p + r, where r covers a pitch of the screw.
fn unequal(count: u32, step_mm: f64, pitch_mm: f64) -> Vec<f64> {
    let r = |i: u32| f64::from(i * i * 7919 % 1009) / 1009.0;
    (0..count).map(|i| step_mm * f64::from(i) + pitch_mm * r(i)).collect()
}

fn equal(count: u32, step_mm: f64) -> Vec<f64> {
    (0..count).map(|i| step_mm * f64::from(i)).collect()
}

#[test]
fn unequal_targets_show_the_pitch_of_a_screw_and_equal_ones_do_not() {
    let wave = |pitch_mm: f64| move |_: usize, x: f64| 2.0 * (TAU * x / pitch_mm + 0.7).sin();
    for (count, step_mm, pitch_mm) in [(21, 20.0, 10.0), (25, 16.0, 5.0), (18, 30.0, 12.0)] {
        let r = tested(&unequal(count, step_mm, pitch_mm), 5, 1, wave(pitch_mm));
        assert_eq!(declared(&r), ["cyclic"], "{pitch_mm}: {}", r["causes"]);
        assert_eq!(r["verdict"], "explained");
        let found = r["causes"][0]["parameters"].to_string() + &r["causes"][0].to_string();
        assert!(found.contains("pitch_mm"), "{found}");
        let r = tested(&equal(count, step_mm + 1.0), 5, 1, wave(pitch_mm));
        assert!(!declared(&r).contains(&"cyclic"), "{pitch_mm}: {}", r["causes"]);
    }
}

/// What goes with the position of an axis seen along itself is its positioning error, whatever bends like that elsewhere.
#[test]
fn a_line_along_its_own_axis_shows_no_sag() {
    for seed in 1..=3 {
        let bent = |x: f64| 15.0 * x * x * (1200.0 - x) / (2.0 * 400.0f64.powi(3));
        let rough = |k: usize| [0.4, -0.7, 0.2, 0.6, -0.3][k % 5];
        let r = tested(&unequal(17, 24.0, 10.0), 5, seed, |k, x| bent(x) + rough(k));
        let found = declared(&r);
        assert!(found.contains(&"positioning"), "{seed}: {}", r["causes"]);
        assert!(found.iter().all(|c| ["positioning", "scale"].contains(c)), "{seed}: {}", r["causes"]);
        assert!(r["cannot_be_seen"].to_string().contains("no readings along the vertical"), "{seed}");
    }
}

#[test]
fn a_fine_line_over_three_pitches_shows_the_wave_and_no_table() {
    for (seed, pitch_mm) in [(1, 5.0), (2, 10.0), (3, 12.0)] {
        let fine = equal(25, pitch_mm / 8.0);
        let r = tested(&fine, 2, seed, |_, x| 2.0 * (TAU * x / pitch_mm).sin());
        assert_eq!(declared(&r), ["cyclic"], "{pitch_mm}: {}", r["causes"]);
    }
}

#[test]
fn errors_of_a_pitch_that_add_up_are_positioning_and_no_wear() {
    for seed in 1..7 {
        let mut step = normal(100 + seed);
        let mut walk = vec![0.0];
        (1..17).for_each(|k| walk.push(walk[k - 1] + 1.5 * step()));
        let white: Vec<f64> = (0..17).map(|_| 2.0 * step()).collect();
        let targets = if seed % 2 == 0 { equal(17, 30.0) } else { unequal(17, 30.0, 8.0) };
        for values in [walk, white] {
            let r = tested(&targets, 5, seed, |k, _| values[k]);
            let all = declared(&r);
            assert!(all.contains(&"positioning"), "{seed}: {}", r["causes"]);
            assert!(all.iter().all(|c| ["positioning", "scale"].contains(c)), "{seed}: {}", r["causes"]);
        }
    }
}

#[test]
fn a_worn_place_alone_is_wear() {
    for seed in 1..4 {
        let centre_mm = 100.0 + 70.0 * seed as f64;
        let bump = |_: usize, x: f64| -8.0 * (-0.5 * ((x - centre_mm) / 30.0).powi(2)).exp();
        let r = tested(&equal(21, 20.0), 5, seed, bump);
        assert_eq!(declared(&r), ["wear"], "{seed}: {}", r["causes"]);
    }
}

/// A foundation that tilts where X passes a place on its way out and back where it passes another one: no formula of the library.
#[test]
fn a_reversal_smaller_than_the_discrepancy_beside_it_is_not_declared() {
    let tilt = |um: f64, [out_mm, back_mm]: [f64; 2]| {
        move |x: f64, sign: i32| if x > if sign > 0 { out_mm } else { back_mm } { um } else { 0.0 }
    };
    for (seed, um, places_mm) in [
        (1, 3.0, [300.0, 150.0]),
        (2, 3.0, [300.0, 100.0]),
        (3, 4.0, [250.0, 200.0]),
        (4, -3.0, [200.0, 120.0]),
    ] {
        let tilt = tilt(um, places_mm);
        let r = tested_by_direction(&unequal(20, 20.0, 3.0), 5, seed, |_, x, sign| tilt(x, sign));
        let causes = r["causes"].as_array().unwrap();
        let backlash = causes.iter().find(|c| c["effect"] == "backlash").unwrap();
        assert_eq!(backlash["declared"], false, "{places_mm:?}: {backlash}");
        assert!(backlash["probability"].as_f64().unwrap() < 0.6, "{places_mm:?}: {backlash}");
        let remark = backlash["remark"].as_str().unwrap();
        assert!(remark.contains("and it may be a part of that"), "{places_mm:?}: {remark}");
        // the mean of both directions is a table or a scale
        assert!(
            declared(&r).iter().all(|c| ["positioning", "scale"].contains(c)),
            "{places_mm:?}: {causes:?}"
        );
        assert_eq!(r["unexplained"]["significant"], true, "{places_mm:?}");
        assert!(r["discrepancy_um"].as_f64().unwrap() > 0.5, "{places_mm:?}: {}", r["discrepancy_um"]);
        // a reversal that is large beside it has a name
        let backlash = |_: usize, x: f64, sign: i32| tilt(x, sign) + 4.0 * um * f64::from(sign);
        let r = tested_by_direction(&unequal(20, 20.0, 3.0), 5, seed, backlash);
        assert!(declared(&r).contains(&"backlash"), "{places_mm:?}: {}", r["causes"]);
    }
}
