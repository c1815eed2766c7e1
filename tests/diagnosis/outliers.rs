//! Sessions of one axis that a workshop brings: outliers among the repeats, coarse displays, three tools, three feeds.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes and reads files")]

use std::collections::BTreeSet;
use std::fmt::Write as _;

use serde_json::Value;

use crate::instruments::diagnose;
use crate::support::normal;

fn diagnosed(table: &str, options: &[&str]) -> Value {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("session.csv");
    std::fs::write(&path, table).unwrap();
    diagnose(&path, options).0
}

fn declared(r: &Value) -> BTreeSet<String> {
    crate::cli::declared(r).into_iter().collect()
}

/// White noise of the readings, um.
const NOISE_UM: f64 = 0.5;

/// A test of X with 6 um of backlash and 20 um/m, both directions, and the lines of its outliers, every n-th, 15 times the noise off.
fn line(shape: (usize, usize), every: usize, seed: u64) -> (String, BTreeSet<usize>) {
    warming_line(shape, every, seed, 0.0)
}

/// The same while the scale of X warms by `warming_k` in all, at 11 um/m/K, and its temperature is logged.
fn warming_line(shape: (usize, usize), every: usize, seed: u64, warming_k: f64) -> (String, BTreeSet<usize>) {
    let mut count = 0;
    let off = |row: usize, _: [usize; 2]| {
        if row % every != every / 2 {
            return 0.0;
        }
        count += 1;
        if count % 2 == 0 { 15.0 } else { -15.0 }
    };
    line_with(shape, seed, warming_k, off)
}

/// The same with outliers by row, and by cycle and target, in times the noise.
fn line_with(
    (targets, cycles): (usize, usize),
    seed: u64,
    warming_k: f64,
    mut off: impl FnMut(usize, [usize; 2]) -> f64,
) -> (String, BTreeSet<usize>) {
    let mut noise = normal(seed);
    let mut table =
        "t_s,instrument,setup,run,repeat,pair,x_mm,u_x,u_y,u_z,dir_x,temp_x_degc,deviation_um\n".to_owned();
    let (mut outlying, mut row) = (BTreeSet::new(), 0);
    for cycle in 1..=cycles {
        for sign in [1.0, -1.0] {
            for k in 0..targets {
                let target = if sign > 0.0 { k } else { targets - 1 - k };
                let (x, pair) = (30.0 * target as f64, 2 * target + usize::from(sign < 0.0));
                let kelvin = warming_k * row as f64 / (2 * targets * cycles) as f64;
                let mut deviation_um = 0.02 * x + 0.011 * kelvin * x - 3.0 * sign + NOISE_UM * noise();
                row += 1;
                let off = off(row, [cycle, target]);
                if off != 0.0 {
                    outlying.insert(row + 1);
                    deviation_um += off * NOISE_UM;
                }
                writeln!(
                    table,
                    "{},laser,1,{cycle},{cycle},{pair},{x},1,0,0,{sign},{:.3},{deviation_um:.3}",
                    8 * row,
                    20.0 + kelvin
                )
                .unwrap();
            }
        }
    }
    (table, outlying)
}

/// Whatever their share, and whether or not the readings are averaged, what lies apart from its repeats is listed, and is no noise.
#[test]
fn outliers_are_told_by_their_repeats_however_many_they_are() {
    // a few are listed, many are a cause; five of 66 may be heavy tails
    let cases = [
        (11, 5, 40, Some(false)),
        (11, 5, 14, Some(true)),
        (11, 3, 12, None),
        (31, 5, 60, Some(false)),
        (31, 5, 17, Some(true)),
    ];
    for (targets, cycles, every, are_cause) in cases {
        let (table, outlying) = line((targets, cycles), every, 7);
        let r = diagnosed(&table, &[]);
        let listed = listed(&r);
        let case = format!("{targets} targets, {cycles} cycles, one in {every}");
        assert!(outlying.is_subset(&listed), "{case}: {outlying:?} but {listed:?}");
        assert!(listed.len() <= outlying.len() + 3, "{case}: {outlying:?} but {listed:?}");
        let noise_um = r["gap"]["noise_um"].as_f64().unwrap();
        assert!((0.35..0.65).contains(&noise_um), "{case}: {noise_um}");
        let found = declared(&r);
        for cause in ["backlash:x", "scale:x"] {
            assert!(found.contains(cause), "{case}: {found:?}");
        }
        assert!(are_cause.is_none_or(|c| found.contains("outliers:") == c), "{case}: {found:?}");
    }
}

/// What warms differs from its repeats, too: outliers stand out beside the causes, not beside the gap.
#[test]
fn outliers_beside_a_thermal_expansion_are_a_cause() {
    for (every, are_cause) in [(14, true), (1000, false)] {
        let (table, outlying) = warming_line((11, 5), every, 3, 5.0);
        let r = diagnosed(&table, &[]);
        let (found, listed) = (declared(&r), listed(&r));
        for cause in ["backlash:x", "thermal-expansion:x"] {
            assert!(found.contains(cause), "{found:?}");
        }
        assert!(outlying.is_subset(&listed), "{outlying:?} but {listed:?}");
        assert_eq!(found.contains("outliers:"), are_cause, "{found:?}");
    }
}

/// Two of three repeats that are off together are no majority where their neighbours say otherwise, nor are three that all differ, nor
/// two pairs of four: nothing says what the machine does there, and the rest says what it is.
#[test]
fn a_point_without_a_majority_of_its_repeats_says_nothing() {
    let three_of = |target: usize, off: [f64; 4]| {
        move |row: usize, [cycle, at]: [usize; 2]| {
            let is_forward = ((row - 1) / 11).is_multiple_of(2);
            if at == target && is_forward { off[cycle - 1] } else { 0.0 }
        }
    };
    for (cycles, off) in [
        (3, [40.0, 0.0, 41.0, 0.0]),
        (3, [0.0, 35.0, 60.0, 0.0]),
        (3, [-45.0, 0.0, 45.0, 0.0]),
        (4, [0.0, 50.0, 51.0, 0.0]),
    ] {
        let (table, outlying) = line_with((11, cycles), 3, 0.0, three_of(4, off));
        let r = diagnosed(&table, &[]);
        let (found, listed) = (declared(&r), listed(&r));
        assert!(found.contains("backlash:x") && found.contains("scale:x"), "{off:?}: {found:?}");
        assert!(outlying.is_subset(&listed), "{off:?}: {outlying:?} but {listed:?}");
        assert_eq!(r["verdict"], "explained", "{off:?}");
    }
}

/// One pass to and fro has no repeats, but neighbours: outliers lie off them, a worn place is seen both ways.
#[test]
fn outliers_of_a_line_without_repeats_lie_off_their_neighbours() {
    for seed in 1..=3 {
        let (table, outlying) = line((31, 1), 9, seed);
        let r = diagnosed(&table, &[]);
        let (found, listed) = (declared(&r), listed(&r));
        assert!(found.contains("backlash:x") && found.contains("scale:x"), "{found:?}");
        assert!(
            outlying.is_subset(&listed) && listed.len() <= outlying.len() + 1,
            "{outlying:?} but {listed:?}"
        );
    }
    // a place of one target, both ways
    let (table, _) = line_with((31, 1), 4, 0.0, |_, [_, target]| if target == 12 { 20.0 } else { 0.0 });
    let r = diagnosed(&table, &[]);
    assert_eq!(r["outlying_readings"].as_array().unwrap().len(), 0, "{}", r["outlying_readings"]);
}

/// Of noise alone nothing is an outlier.
#[test]
fn noise_has_no_outliers() {
    for seed in 1..=5 {
        let (table, _) = line((21, 3), usize::MAX, seed);
        let r = diagnosed(&table, &[]);
        assert!(r["outlying_readings"].as_array().unwrap().len() <= 1, "{seed}: {}", r["outlying_readings"]);
        assert!(!declared(&r).contains("outliers:"), "{seed}");
    }
}

/// A circle of 100 mm to and fro, each once, with a spike of `spike_um` at the reversals and worn places of `worn_um` between them, and
/// the lines of its outliers.
fn circles([spike_um, worn_um]: [f64; 2], every: usize) -> (String, BTreeSet<usize>) {
    let mut noise = normal(11);
    let mut table = "t_s,instrument,setup,run,repeat,x_mm,y_mm,u_x,u_y,u_z,moving,deviation_um\n".to_owned();
    let (mut outlying, mut row) = (BTreeSet::new(), 0);
    for (run, sign) in [(1, 1.0), (2, -1.0)] {
        for k in 0..180 {
            let angle_deg = 2.0 * f64::from(k) + 1.0;
            let (sin, cos) = (sign * angle_deg.to_radians()).sin_cos();
            let (x, y) = (100.0 * cos, 100.0 * sin);
            row += 1;
            let since_deg = angle_deg % 90.0;
            let worn = (-0.5 * ((since_deg - 45.0) / 6.0).powi(2)).exp();
            let mut read_um = spike_um * (-since_deg / 1.5).exp() + worn_um * worn + NOISE_UM * noise();
            if row % every == every / 2 {
                outlying.insert(row + 1);
                read_um += if outlying.len() % 2 == 0 { 20.0 } else { -20.0 } * NOISE_UM;
            }
            let t = 0.1 * f64::from(k) + 100.0 * f64::from(run);
            writeln!(table, "{t:.2},ballbar,1,{run},1,{x:.4},{y:.4},{cos:.6},{sin:.6},0,1,{read_um:.3}")
                .unwrap();
        }
    }
    (table, outlying)
}

fn listed(r: &Value) -> BTreeSet<usize> {
    let line = |o: &Value| o["at"].as_str().unwrap().rsplit(':').next().unwrap().parse().unwrap();
    r["outlying_readings"].as_array().unwrap().iter().map(line).collect()
}

/// A circle has no repeats, but a path: outliers lie off it; a spike at a reversal and a worn place are part of it.
#[test]
fn outliers_of_a_circle_without_repeats_lie_off_its_path() {
    let (table, outlying) = circles([0.0; 2], 17);
    let r = diagnosed(&table, &[]);
    let found = listed(&r);
    // the first readings after a reversal are not judged
    assert!(found.is_subset(&outlying) && found.len() + 3 >= outlying.len(), "{outlying:?} but {found:?}");
    assert_eq!(declared(&r), BTreeSet::from(["outliers:".to_owned()]), "{}", r["causes"]);
    let noise_um = r["gap"]["noise_um"].as_f64().unwrap();
    assert!((0.4..0.65).contains(&noise_um), "{noise_um}");

    for sharp in [[60.0 * NOISE_UM, 0.0], [0.0, 600.0 * NOISE_UM]] {
        let r = diagnosed(&circles(sharp, usize::MAX).0, &[]);
        let is_part = listed(&r).is_empty() && !declared(&r).contains("outliers:");
        assert!(is_part, "{sharp:?}: {}", r["outlying_readings"]);
    }
}

/// A cyclic error that circles sample coarsely bends sooner than a cubic: the scatter about the path is then as large.
#[test]
fn a_wave_sampled_coarsely_is_no_outlying_reading() {
    let mut noise = normal(12);
    let mut table = "t_s,instrument,setup,run,repeat,x_mm,y_mm,u_x,u_y,u_z,moving,deviation_um\n".to_owned();
    for (run, sign) in [(1, 1.0), (2, -1.0)] {
        for k in 0..120 {
            let (sin, cos) = (sign * (3.0 * f64::from(k) + 1.5).to_radians()).sin_cos();
            let (x, y) = (100.0 * cos, 100.0 * sin);
            let read_um =
                24.0 * NOISE_UM * (y * std::f64::consts::TAU / 10.0).sin() * sin + NOISE_UM * noise();
            let t = 0.2 * f64::from(k) + 100.0 * f64::from(run);
            writeln!(table, "{t:.2},ballbar,1,{run},1,{x:.4},{y:.4},{cos:.6},{sin:.6},0,1,{read_um:.3}")
                .unwrap();
        }
    }
    let r = diagnosed(&table, &[]);
    assert!(listed(&r).is_empty(), "{}", r["outlying_readings"]);
    assert!(declared(&r).contains("cyclic:y"), "{}", r["causes"]);
}

/// Three probes at a standing spindle that grows, with outliers in time: its neighbours in its own series tell each.
#[test]
fn outliers_at_standstill_lie_off_their_neighbours_in_time() {
    let mut noise = normal(13);
    let header = "t_s,instrument,setup,run,repeat,x_mm,y_mm,z_mm,u_x,u_y,u_z,spindle_rpm,deviation_um\n";
    let mut table = header.to_owned();
    let (mut outlying, mut row) = (BTreeSet::new(), 0);
    for k in 0..180 {
        let warm = 1.0 - (-f64::from(k) / 40.0).exp();
        for (axis, growth_um) in [1.0, 3.0, 30.0].into_iter().enumerate() {
            row += 1;
            let mut read_um = growth_um * warm + NOISE_UM * noise();
            // one reading alone, all three probes at once, and two with a good one between them
            let is_off = row % 17 == 8 && (15..177).contains(&k);
            if is_off || k == 100 || axis == 2 && (k == 60 || k == 62) {
                outlying.insert(row + 1);
                read_um += if row % 2 == 0 { 25.0 } else { -25.0 } * NOISE_UM;
            }
            let u = [0, 1, 2].map(|i| u8::from(i == axis));
            let rpm = if k == 0 { 0 } else { 12_000 };
            let t = 60 * k;
            writeln!(table, "{t},probe,1,1,1,200,100,-300,{},{},{},{rpm},{read_um:.3}", u[0], u[1], u[2])
                .unwrap();
        }
    }
    let r = diagnosed(&table, &[]);
    let found = listed(&r);
    assert!(outlying.is_subset(&found) && found.len() <= outlying.len() + 3, "{outlying:?} but {found:?}");
    let causes = declared(&r);
    assert!(causes.contains("outliers:") && causes.contains("spindle-growth:"), "{causes:?}");
    let noise_um = r["gap"]["noise_um"].as_f64().unwrap();
    assert!((0.4..0.65).contains(&noise_um), "{noise_um}");
}

/// After each of 24 short moves away and back the axis rings: its first readings at standstill are part of the path.
#[test]
fn what_settles_after_a_stop_is_no_outlier() {
    let mut noise = normal(14);
    let mut table = "t_s,instrument,setup,run,repeat,x_mm,u_x,u_y,u_z,moving,deviation_um\n".to_owned();
    for row in 0..24 * 60 {
        let k = row % 60;
        let x = if k < 4 { 50.0 + 5.0 * (f64::from(k) * std::f64::consts::PI / 4.0).sin() } else { 50.0 };
        let rings_um = if k < 4 { 20.0 } else { 20.0 * (-0.6_f64).powi(k - 3) };
        let read_um = rings_um + NOISE_UM * noise();
        let t = 0.01 * f64::from(row);
        writeln!(table, "{t:.2},laser,1,1,1,{x:.4},1,0,0,{},{read_um:.3}", u8::from(k < 4)).unwrap();
    }
    let r = diagnosed(&table, &[]);
    // single ones lie apart from the fit, but not those of every stop from the path
    assert!(listed(&r).len() < 6, "{}", r["outlying_readings"]);
}

/// A campaign of three lines and a plate on a CMM, which is measured `passes` times, each in a setup of its own, turned and displaced;
/// and the lines of the outliers of the plate.
fn lines_and_plate(passes: u32, seed: u64) -> (String, BTreeSet<usize>) {
    let mut noise = normal(seed);
    let mut table =
        "t_s,instrument,setup,run,repeat,pair,x_mm,y_mm,z_mm,u_x,u_y,u_z,deviation_um\n".to_owned();
    let (mut t, mut run, mut row, mut outlying) = (0.0, 0, 1, BTreeSet::new());
    for axis in 0..3 {
        for (cycle, sign) in [(1, 1), (1, -1), (2, 1), (2, -1), (3, 1), (3, -1)] {
            run += 1;
            for k in 0..15 {
                let target = if sign > 0 { k } else { 14 - k };
                let (mut q, mut u) = ([200.0; 3], [0; 3]);
                (q[axis], u[axis]) = (28.0 * f64::from(target), 1);
                // 15 um/m of X, 4 um of backlash of Z, which stands still on the plate
                let systematic_um = [0.015 * q[0], 0.0, -2.0 * f64::from(sign)][axis];
                let (read_um, pair) = (systematic_um + NOISE_UM * noise(), 2 * target + i32::from(sign < 0));
                (t, row) = (t + 8.0, row + 1);
                let ([x, y, z], [along_x, along_y, along_z], setup) = (q, u, axis + 1);
                let state = format!("{setup},{run},{cycle},{pair},{x},{y},{z}");
                writeln!(table, "{t},laser,{state},{along_x},{along_y},{along_z},{read_um:.3}").unwrap();
            }
        }
    }
    for pass in 1..=passes {
        run += 1;
        let turned = 0.02 * (f64::from(pass) - 1.6);
        for point in 0..48 {
            let (x, y) = (60.0 * f64::from(point % 8), 70.0 * f64::from(point / 8));
            // squareness of 30 urad
            let true_um = [0.015 * x - 0.03 * y - turned * y - 7.0, turned * x + 4.0];
            for (axis, systematic_um) in true_um.into_iter().enumerate() {
                let mut read_um = systematic_um + NOISE_UM * noise();
                (t, row) = (t + 4.0, row + 1);
                if pass == 1 && [(0, 1), (19, 0), (26, 0), (26, 1)].contains(&(point, axis)) {
                    outlying.insert(row);
                    read_um += if point == 19 { -12.0 } else { 12.0 } * NOISE_UM;
                }
                let setup = 3 + pass;
                let (pair, u) = (100 + 2 * point + i32::from(axis == 1), [1 - axis, axis]);
                writeln!(
                    table,
                    "{t},cmm,{setup},{run},{pass},{pair},{x},{y},200,{},{},0,{read_um:.3}",
                    u[0], u[1]
                )
                .unwrap();
            }
        }
    }
    (table, outlying)
}

/// Where nothing is repeated, or two mountings hide which of two repeats is the outlier, all other readings tell it.
#[test]
fn outlying_readings_of_a_plate_in_a_campaign_are_far_from_what_all_others_predict() {
    for (passes, seed) in [(1, 21), (2, 22)] {
        let (table, outlying) = lines_and_plate(passes, seed);
        let r = diagnosed(&table, &[]);
        let found = listed(&r);
        assert!(
            outlying.is_subset(&found) && found.len() <= outlying.len() + 1,
            "{passes}: {outlying:?} but {found:?}"
        );
        let causes = declared(&r);
        let are_found = causes.contains("backlash:z") && causes.contains("squareness:xy");
        assert!(are_found, "{passes}: {}", r["causes"]);
    }
}

/// A display of 3 um above noise of 1 um: three values are read in any order, without repeats, whatever the length of the bar.
#[test]
fn a_coarse_display_is_seen_without_repeats() {
    for length_um in [0.0, 6.0] {
        let mut noise = normal(5);
        let mut table =
            "t_s,instrument,setup,run,repeat,x_mm,y_mm,u_x,u_y,u_z,moving,deviation_um\n".to_owned();
        for (run, sign) in [(1, 1.0), (2, -1.0)] {
            for k in 0..120 {
                let (sin, cos) = (sign * (f64::from(k) * 3.0 + 1.0).to_radians()).sin_cos();
                let (x, y) = (100.0 * cos, 100.0 * sin);
                let read_um = 3.0 * (noise() / 3.0).round() + length_um;
                let t = 0.3 * f64::from(k) + 100.0 * f64::from(run);
                writeln!(table, "{t:.2},ballbar,1,{run},1,{x:.4},{y:.4},{cos:.6},{sin:.6},0,1,{read_um}")
                    .unwrap();
            }
        }
        let r = diagnosed(&table, &[]);
        assert!(declared(&r).contains("quantisation:"), "{length_um}: {}", r["causes"]);
        let step = r["causes"].as_array().unwrap().iter().find(|c| c["effect"] == "quantisation").unwrap();
        assert!((step["parameters"]["step_um"]["value"].as_f64().unwrap() - 3.0).abs() < 1e-9);
    }
}

/// A vibration as large as the noise in readings at rest, more than are compared one by one, some of them lost.
#[test]
fn a_vibration_is_seen_in_many_readings_of_which_some_are_lost() {
    let table = |amplitude_um: f64| {
        let mut noise = normal(3);
        let mut table = "t_s,instrument,setup,run,repeat,x_mm,u_x,u_y,u_z,deviation_um\n".to_owned();
        for k in 0..450 {
            let (run, x) = (1 + k / 150, 100 * (1 + k / 150));
            let t = 0.01 * f64::from(k) + 60.0 * f64::from(run);
            let shakes_um = amplitude_um * (core::f64::consts::TAU * 33.0 * t).sin();
            let deviation_um = shakes_um + NOISE_UM * noise();
            if k * 7919 % 13 != 5 {
                writeln!(table, "{t:.3},laser,1,{run},1,{x},1,0,0,{deviation_um:.3}").unwrap();
            }
        }
        table
    };
    let amplitude_um = NOISE_UM * core::f64::consts::SQRT_2;
    let r = diagnosed(&table(amplitude_um), &[]);
    let causes = r["causes"].as_array().unwrap();
    let found = causes.iter().find(|c| c["effect"] == "vibration").unwrap_or_else(|| panic!("{causes:?}"));
    let parameter = |name: &str| found["parameters"][name]["value"].as_f64().unwrap();
    assert!((parameter("frequency_hz") - 33.0).abs() < 0.2, "{found}");
    assert!((parameter("amplitude_um") - amplitude_um).abs() < 0.15, "{found}");
    assert!(!declared(&diagnosed(&table(0.0), &[])).contains("vibration:"));
}

/// One axis alone that moves, in three programs: at three feeds its lag is found, with three tools their length.
#[test]
fn one_axis_in_three_programs_is_judged() {
    let mut noise = normal(9);
    let mut table = "t_s,instrument,setup,run,repeat,pair,x_mm,u_x,u_y,u_z,moving,deviation_um\n".to_owned();
    let mut t = 0.0;
    for (run, speed) in
        (1..).zip([10.0, -10.0, 30.0, -30.0, 90.0, -90.0, 10.0, -10.0, 30.0, -30.0, 90.0, -90.0])
    {
        t += 20.0;
        for k in 0..40 {
            t += 0.05;
            let x = 250.0 + speed * 0.05 * (f64::from(k) - 20.0);
            // 40 us late
            let deviation_um = -speed * 0.04 + NOISE_UM * noise();
            let (repeat, pair) = (1 + (run - 1) / 6, 40 * ((run - 1) % 6) + k);
            writeln!(table, "{t:.3},laser,1,{run},{repeat},{pair},{x:.4},1,0,0,1,{deviation_um:.3}").unwrap();
        }
    }
    let r = diagnosed(&table, &[]);
    assert!(r["verdict"] == "explained", "{}", r["causes"]);
    let found = declared(&r);
    assert!(["servo-mismatch:x", "latency:", "clock-skew:"].iter().any(|c| found.contains(*c)), "{found:?}");

    let mut table =
        "t_s,instrument,setup,run,repeat,pair,x_mm,u_x,u_y,u_z,tool_length_mm,deviation_um\n".to_owned();
    let mut row = 0;
    for (run, tool_mm) in (1..).zip([100.0, 150.0, 250.0, 100.0, 150.0, 250.0]) {
        for k in 0..11 {
            row += 1;
            let deviation_um = -0.1 * tool_mm + NOISE_UM * noise();
            let (repeat, pair) = (1 + (run - 1) / 3, 11 * ((run - 1) % 3) + k);
            writeln!(
                table,
                "{},probe,1,{run},{repeat},{pair},{},0,0,1,{tool_mm},{deviation_um:.3}",
                8 * row,
                40 * k
            )
            .unwrap();
        }
    }
    let r = diagnosed(&table, &[]);
    assert!(declared(&r).contains("tool-length:"), "{}", r["causes"]);
    let cause = &r["causes"][0];
    let ppm = cause["parameters"]["tool_length_ppm"]["value"].as_f64().unwrap();
    // a tool that is longer than stated ends lower
    assert!((ppm - 100.0).abs() < 5.0, "{cause}");
}
