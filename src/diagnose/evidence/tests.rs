//! Sessions of one program, made here: what is in them is found, and what is not is not named.

use super::super::constants::ROWS_MAX;
use super::super::library::{Label, Library};
use super::super::machine_state::Machine;
use super::super::noise::Random;
use super::super::session::{History, Raw, Session, Times};
use super::{Comparison, compare};

/// An ISO 230-2 test: 9 targets over 400 mm, 5 cycles, both directions; `deviation_um` of position, direction, cycle and time.
fn iso_test(deviation_um: impl FnMut(f64, f64, usize, f64) -> f64) -> Raw {
    iso_test_of(9, deviation_um)
}

/// The same with another number of targets, 50 mm apart.
fn iso_test_of(targets: u32, mut deviation_um: impl FnMut(f64, f64, usize, f64) -> f64) -> Raw {
    let names =
        ["t_s", "setup", "run", "repeat", "x_mm", "u_x", "u_y", "u_z", "deviation_um", "dir_x", "moving"];
    let mut raw = Raw::made_up("iso", &names);
    let mut t = 0.0;
    for cycle in 0..5 {
        for direction in [1.0, -1.0] {
            for k in 0..targets {
                let target = f64::from(if direction > 0.0 { k } else { targets - 1 - k });
                // uneven steps, as the standard asks
                let x = 50.0 * target + 3.0 * (2.3 * target).sin();
                let run = (2 * cycle + usize::from(direction < 0.0)) as f64;
                let d = deviation_um(x, direction, cycle, t);
                let row = [t, 0.0, run, cycle as f64, x, 1.0, 0.0, 0.0, d, direction, 0.0];
                raw.push("laser", raw.lines.len() as u64 + 2, &row);
                t += 20.0;
            }
            t += 15.0;
        }
    }
    raw
}

fn compared(raw: Raw) -> (Comparison, Vec<Label>) {
    let mut session = Session::build(&[raw], History::default(), Machine::plain()).expect("a session");
    let mut library = Library::new(&session, &[]);
    super::super::take_signals(&mut session, &mut library);
    library.variants.retain(|v| v.shape.has_own_name());
    let gap = session.gap();
    let used = vec![true; gap.len()];
    let c =
        compare(&session, &library, &gap, &used, &vec![1.0; session.instruments.len()]).expect("compared");
    (c, library.labels)
}

/// Probability of a label, 0 where no likely set holds it.
fn probability((c, labels): &(Comparison, Vec<Label>), name: &str) -> f64 {
    c.contenders.iter().find(|x| labels[x.label].to_string() == name).map_or(0.0, |x| x.probability)
}

/// The largest probability of any label but those listed.
fn others(found: &(Comparison, Vec<Label>), but: &[&str]) -> (f64, String) {
    let (c, labels) = found;
    let name = |x: &super::Contender| labels[x.label].to_string();
    let all = c.contenders.iter().map(|x| (x.probability, name(x)));
    all.filter(|(_, n)| !but.contains(&n.as_str()))
        .fold((0.0, String::new()), |a, b| if b.0 > a.0 { b } else { a })
}

#[test]
fn a_reversal_error_is_named_beside_a_drift() {
    for seed in 0..4 {
        let mut random = Random::new(seed);
        let raw = iso_test(|_, d, cycle, _| 4.0 * d - 3.0 * cycle as f64 + random.normal());
        let found = compared(raw);
        assert!(probability(&found, "backlash:x") > 0.95, "{seed}: {:?}", found.0.contenders);
        assert!(others(&found, &["backlash:x"]).0 < 0.5, "{seed}: {:?}", found.0.contenders);
        assert!(found.0.shares.drift_um2 > 4.0, "{seed}: {:?}", found.0.shares);
        let chosen: Vec<_> = found.0.contenders.iter().filter(|x| x.chosen).collect();
        assert_eq!(chosen.len(), 1, "{seed}: {chosen:?}");
        assert!((chosen[0].own_um2 / found.0.shares.named_um2 - 1.0).abs() < 1e-9, "{seed}: {chosen:?}");
        assert!((chosen[0].own_um2 / 16.0 - 1.0).abs() < 0.2, "{seed}: {chosen:?}");
    }
}

#[test]
fn a_mean_reversal_error_is_named_where_its_width_scatters_from_target_to_target() {
    for seed in 0..3 {
        let mut random = Random::new(seed);
        let widths: Vec<f64> = (0..16).map(|_| 6.0 + 3.0 * random.normal()).collect();
        let width = |x: f64| widths[(x / 50.0).round() as usize];
        let raw = iso_test_of(16, |x, d, _, _| 0.5 * d * width(x) + 0.6 * random.normal());
        let found = compared(raw);
        assert!(probability(&found, "backlash:x") > 0.9, "{seed}: {:?}", found.0.contenders);
        assert!(found.0.discrepancy > 0.95, "{seed}: {}", found.0.discrepancy);
        // half a width of 3 um from target to target
        let backlash = &found.0.contenders[0];
        assert!(backlash.beside_um2 > 0.5 && backlash.beside_um2 < backlash.own_um2, "{seed}: {backlash:?}");
    }
}

/// One reading at each of 24 places, of which one is an outlier.
#[test]
fn one_bad_reading_is_no_table_of_positions() {
    let mut random = Random::new(8);
    let mut raw =
        iso_test_of(24, |x, _, _, _| random.normal() + if x > 400.0 && x < 430.0 { 25.0 } else { 0.0 });
    raw.columns.iter_mut().for_each(|c| c.truncate(24));
    raw.instruments.truncate(24);
    raw.lines.truncate(24);
    let found = compared(raw);
    assert!(probability(&found, "positioning:x") < 0.5, "{:?}", found.0.contenders);
}

/// A value of its own for every reading is noise.
#[test]
fn a_table_of_positions_needs_targets_that_are_read_twice() {
    let has_table = |rows: usize| {
        let mut raw = iso_test_of(24, |x, _, _, _| (0.01 * x).sin());
        raw.columns.iter_mut().for_each(|c| c.truncate(rows));
        raw.instruments.truncate(rows);
        raw.lines.truncate(rows);
        let session = Session::build(&[raw], History::default(), Machine::plain()).expect("a session");
        Library::new(&session, &[]).variants.iter().any(|v| v.shape.is_process())
    };
    assert!(has_table(48) && !has_table(24));
}

#[test]
fn a_scale_and_a_position_error_are_told_apart() {
    for seed in 10..14 {
        let mut random = Random::new(seed);
        let scale = compared(iso_test(|x, _, _, _| 0.02 * x + random.normal()));
        assert!(probability(&scale, "scale:x") > 0.95, "{seed}: {:?}", scale.0.contenders);
        let table = compared(iso_test(|x, _, _, _| 5.0 * (x / 70.0).sin() + random.normal()));
        assert!(probability(&table, "positioning:x") > 0.95, "{seed}: {:?}", table.0.contenders);
    }
}

/// White noise, drift, heavy tails, a random walk, steps from cycle to cycle, scatter per point.
#[test]
fn noise_of_six_kinds_has_no_mechanical_name() {
    for seed in 0..24u64 {
        let mut random = Random::new(100 + seed);
        let mut walk = 0.0;
        let steps: Vec<f64> = (0..5).map(|_| 4.0 * random.normal()).collect();
        let points: Vec<f64> = (0..18).map(|_| 3.0 * random.normal()).collect();
        let raw = iso_test(|x, d, cycle, t| {
            let white = random.normal();
            walk += 0.8 * random.normal();
            match seed % 6 {
                0 => white,
                1 => white + 8.0 * (t / 900.0).sin(),
                // Student's t with two degrees of freedom
                2 => white / ((random.normal().powi(2) + random.normal().powi(2)) / 2.0).sqrt(),
                3 => white + walk,
                4 => white + steps[cycle],
                _ => white + points[(x / 49.0) as usize % 9 + if d > 0.0 { 0 } else { 9 }],
            }
        });
        let found = compared(raw);
        let (p, name) = others(&found, &[]);
        assert!(p < 0.6, "{seed}: {name} {p}");
    }
}

#[test]
fn outliers_count_less_and_hide_nothing() {
    let mut random = Random::new(77);
    let mut k = 0;
    let raw = iso_test(|_, d, _, _| {
        k += 1;
        let outlier = if k == 21 || k == 60 { 100.0 } else { 0.0 };
        4.0 * d + outlier + random.normal()
    });
    let found = compared(raw);
    assert_eq!(found.0.outlying.iter().map(|(i, _)| *i).collect::<Vec<_>>(), [20, 59]);
    assert!(probability(&found, "backlash:x") > 0.95, "{:?}", found.0.contenders);
}

/// Sixteen holes measured in x and y with a squareness of 90 um/m and a noise of 2 um; the hole 3 is off by `error_um`, um.
fn plate(seed: u64, error_um: [f64; 2]) -> Raw {
    let mut random = Random::new(seed);
    let names =
        ["t_s", "setup", "run", "repeat", "x_mm", "y_mm", "u_x", "u_y", "u_z", "deviation_um", "moving"];
    let mut raw = Raw { times: Some(Times::Ordinal), ..Raw::made_up("plate", &names) };
    for hole in 0..16u32 {
        let k = 7 * hole % 16;
        let [x, y] = [k % 4, k / 4].map(|i| 60.0 * f64::from(i));
        for (axis, error_um) in error_um.into_iter().enumerate() {
            let bad = if hole == 3 { error_um } else { 0.0 };
            let d = if axis == 0 { 0.09 * y } else { 0.0 } + bad + 2.0 * random.normal();
            let u = [0, 1].map(|i| f64::from(u8::from(i == axis)));
            let row = [f64::from(hole), 0.0, 0.0, 0.0, x, y, u[0], u[1], 0.0, d, 0.0];
            raw.push("cmm", u64::from(hole) + 2, &row);
        }
    }
    raw
}

#[test]
fn a_bad_hole_is_left_out_in_both_coordinates_and_hides_nothing() {
    for (seed, error_um) in [[70.0, 50.0], [77.0, 15.0], [-80.0, 0.0], [9.0, 9.0]].into_iter().enumerate() {
        let found = compared(plate(seed as u64, error_um));
        let out: Vec<usize> = found.0.outlying.iter().map(|(i, _)| *i).collect();
        assert_eq!(out, [6, 7], "{error_um:?}: {:?}", found.0.outlying);
        assert!(found.0.white_um < 4.0, "{error_um:?}: {}", found.0.white_um);
        assert!(probability(&found, "squareness:xy") > 0.9, "{error_um:?}: {:?}", found.0.contenders);
    }
}

/// A ballbar at one feed: every reading looks its own way, and each direction of travel stays apart.
#[test]
fn readings_that_turn_are_averaged_along_the_path() {
    let names: Vec<&str> =
        "t_s setup run repeat x_mm y_mm u_x u_y u_z deviation_um dir_x dir_y moving".split(' ').collect();
    let n = 3000;
    let mut raw = Raw::made_up("ballbar", &names);
    for k in 0..n {
        let t = k as f64 * 0.02;
        let (sin, cos) = (std::f64::consts::TAU * k as f64 / n as f64).sin_cos();
        let (x, y) = (100.0 + 50.0 * cos, 100.0 + 50.0 * sin);
        let row =
            [t, 0.0, 0.0, 0.0, x, y, cos, sin, 0.0, 9.0 * sin * cos, (-sin).signum(), cos.signum(), 1.0];
        raw.push("ballbar", k as u64 + 2, &row);
    }
    let session = Session::build(&[raw], History::default(), Machine::plain()).expect("a session");
    let groups = super::grouping::groups(&session, &vec![true; n]).expect("groups");
    assert!(groups.len() <= 2 * ROWS_MAX && groups.len() > ROWS_MAX / 2, "{}", groups.len());
    let mut rows = groups.concat();
    rows.sort_unstable();
    assert_eq!(rows, (0..n).collect::<Vec<_>>());
    for group in &groups {
        let (first, last) = (&session.moments[group[0]], &session.moments[group[group.len() - 1]]);
        assert_eq!(first.direction, last.direction, "{group:?}");
        assert!(first.u.dot(&last.u) > 0.99, "{group:?}");
    }
}

/// A laser at twelve targets beside long captures, at rest and in motion: it keeps its targets, whatever share of the readings it has.
#[test]
fn long_captures_do_not_take_the_targets_of_a_laser() {
    let names: Vec<&str> =
        "t_s setup run repeat x_mm y_mm u_x u_y u_z deviation_um moving".split(' ').collect();
    let mut raw = Raw::made_up("campaign", &names);
    let mut push = |class: &str, setup: f64, k: usize, place: [f64; 2], u: [f64; 3], moving: f64| {
        let t = setup * 1e4 + k as f64;
        let row = [t, setup, setup, 0.0, place[0], place[1], u[0], u[1], u[2], (t % 7.0) - 3.0, moving];
        raw.push(class, raw.lines.len() as u64 + 2, &row);
    };
    for k in 0..900 {
        push("indicator", 0.0, k, [250.0, 100.0], [0.0, 1.0, 0.0], 0.0);
    }
    for k in 0..900 {
        push("scale", 1.0, k, [f64::from(k as u32) * 0.3, 100.0], [1.0, 0.0, 0.0], 1.0);
    }
    for k in 0..48 {
        let x = 45.0 * f64::from([0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11][k % 12]);
        push("laser", 2.0, 2 * k, [x, 100.0], [1.0, 0.0, 0.0], 0.0);
        push("laser", 2.0, 2 * k + 1, [x, 100.0], [0.0, 1.0, 0.0], 0.0);
    }
    let session = Session::build(&[raw], History::default(), Machine::plain()).expect("a session");
    let n = session.readings.len();
    let groups = super::grouping::groups(&session, &vec![true; n]).expect("groups");
    assert!(groups.len() <= 2 * ROWS_MAX && groups.len() > ROWS_MAX / 2, "{}", groups.len());
    assert_eq!(groups.concat().len(), n);
    let laser = session.instruments.iter().position(|i| i == "laser").expect("a laser");
    let x = |i: usize| session.moments[i].position[0];
    let of_class = |name: &str| {
        let class = session.instruments.iter().position(|i| i == name);
        groups.iter().filter(|g| Some(session.readings[g[0]].instrument) == class).count()
    };
    // its course in time
    assert!(of_class("indicator") >= 20, "{}", of_class("indicator"));
    let mut targets = 0;
    for group in groups.iter().filter(|g| session.readings[g[0]].instrument == laser) {
        assert!(group.iter().all(|i| (x(*i) - x(group[0])).abs() < 1e-9), "{group:?}");
        targets += 1;
    }
    assert!(targets >= 24, "{targets}");
}

#[test]
fn what_means_cancel_is_zero() {
    let step = 0.1 + 0.2;
    let data = [0.1, 1.0, 0.2, 1.0, -step, 1.0];
    assert_eq!(super::mean_of_members(&[vec![4, 5, 6]], &data, 2), [0.0, 1.0]);
}

#[test]
fn the_same_input_gives_the_same_answer() {
    let make = || {
        let mut random = Random::new(5);
        compared(iso_test(|x, d, _, _| 2.0 * d + 0.01 * x + random.normal())).0
    };
    assert_eq!(make(), make());
}
