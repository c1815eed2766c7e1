//! What is refused, what is derived, what is paired.

use super::super::moment::Machine;
use super::*;

mod circles;

/// A line along x, up and down, twice: rows of `docs/reference/session-files.md` 1.
fn line() -> Raw {
    let names = ["t_s", "setup", "run", "repeat", "x_mm", "u_x", "u_y", "u_z", "deviation_um"];
    let mut raw = Raw::made_up("s.csv", &names);
    let mut t = 0.0;
    for repeat in 1..=2 {
        for way in 0..2 {
            for k in 0..10 {
                let x = 10.0 * f64::from(if way == 0 { k } else { 9 - k });
                let d = 2.0 + (x * 0.37).sin() + 0.1 * f64::from(repeat);
                let row = [t, 1.0, f64::from(2 * repeat + way), f64::from(repeat), x, 1.0, 0.0, 0.0, d];
                raw.push("laser", raw.lines.len() as u64 + 2, &row);
                t += 5.0;
            }
        }
    }
    raw
}

fn build(raw: Raw) -> Result<Session, SessionError> {
    Session::build(&[raw], History::default(), Machine::plain())
}

fn with(change: impl Fn(&mut Raw)) -> String {
    let mut raw = line();
    change(&mut raw);
    build(raw).map_or_else(|e| e.to_string(), |s| format!("accepted: {:?}", s.notes))
}

fn column<'a>(raw: &'a mut Raw, name: &str) -> &'a mut Vec<f64> {
    let i = raw.names.iter().position(|n| n == name).unwrap();
    &mut raw.columns[i]
}

#[test]
fn what_cannot_be_right_is_refused_with_its_place() {
    type Case = (&'static str, Box<dyn Fn(&mut Raw)>);
    let cases: [Case; 11] = [
        (
            "s.csv: column deviation_um is missing",
            Box::new(|r| {
                r.names.pop();
                r.columns.pop();
            }),
        ),
        ("s.csv:4: x_mm is empty", Box::new(|r| column(r, "x_mm")[2] = f64::NAN)),
        ("s.csv:7: t_s goes back from 20 s to 1 s;", Box::new(|r| column(r, "t_s")[5] = 1.0)),
        (
            "where a new run begins: each seems to have a clock of its own",
            Box::new(|r| column(r, "t_s").iter_mut().skip(10).for_each(|t| *t -= 50.0)),
        ),
        ("has length 2.0000", Box::new(|r| column(r, "u_x")[0] = 2.0)),
        ("every deviation_um is 0; nothing was measured", Box::new(|r| column(r, "deviation_um").fill(0.0))),
        ("are these mm?", Box::new(|r| column(r, "deviation_um").iter_mut().for_each(|d| *d *= 1e-3))),
        ("are these nm?", Box::new(|r| column(r, "deviation_um").iter_mut().for_each(|d| *d *= 1e5))),
        (
            "are these um? the column is in mm",
            Box::new(|r| column(r, "x_mm").iter_mut().for_each(|d| *d *= 1e3)),
        ),
        (
            "15 usable readings, at least 20 are needed",
            Box::new(|r| column(r, "deviation_um").iter_mut().skip(15).for_each(|d| *d = f64::NAN)),
        ),
        (
            "are these kelvin",
            Box::new(|r| {
                r.names.push("temp_air_degc".into());
                r.columns.push(vec![293.0; 40]);
            }),
        ),
    ];
    for (expected, change) in cases {
        let message = with(change);
        assert!(message.contains(expected), "expected '{expected}', got '{message}'");
    }
}

#[test]
fn speeds_in_another_unit_are_refused() {
    let mut raw = line();
    raw.names.push("vx_mm_per_s".into());
    raw.columns.push(vec![0.0; 40]);
    // fast samples: 10 mm in 20 ms
    for i in 0..40 {
        let (run, k) = (i / 10, i % 10);
        column(&mut raw, "t_s")[i] = 10.0 * run as f64 + 0.02 * k as f64;
        let way = if run % 2 == 0 { 1.0 } else { -1.0 };
        column(&mut raw, "vx_mm_per_s")[i] = way * 500.0 * 60.0;
    }
    let message = build(raw).unwrap_err().to_string();
    assert!(message.contains("times the speed that x_mm and t_s give"), "{message}");
}

#[test]
fn slow_rows_stand_still_and_say_what_is_lost() {
    let s = build(line()).unwrap();
    assert!(s.moments.iter().all(|m| m.velocity[0] == 0.0));
    let note = s.notes.iter().find(|n| n.text.contains("too slow for velocities")).unwrap();
    assert!(note.unidentifiable.contains(&"latency".to_owned()));
    assert!(note.unidentifiable.contains(&"reversal-spike:x".to_owned()));
}

#[test]
fn directions_and_distances_follow_from_the_order() {
    let s = build(line()).unwrap();
    let d: Vec<f64> = s.moments[..20].iter().map(|m| m.direction[0]).collect();
    assert_eq!(&d[..10], &[1.0; 10]);
    assert_eq!(&d[10..], &[-1.0; 10]);
}

#[test]
fn equal_states_of_two_repeats_are_partners_without_a_column() {
    let s = build(line()).unwrap();
    assert!(s.readings.iter().all(|r| r.pair.is_some()));
    let p = s.readings[3].pair;
    let partners: Vec<usize> = (0..40).filter(|i| s.readings[*i].pair == p).collect();
    assert_eq!(partners, [3, 23]);
}

#[test]
fn a_pair_that_numbers_passes_pairs_their_rows_in_order() {
    let mut raw = line();
    raw.names.push("pair".into());
    raw.columns.push((0..40).map(|i| f64::from((i / 10) % 2)).collect());
    let s = build(raw).unwrap();
    let p = s.readings[14].pair;
    let partners: Vec<usize> = (0..40).filter(|i| s.readings[*i].pair == p).collect();
    assert_eq!(partners, [14, 34]);
}

#[test]
fn numbers_in_one_file_leave_the_states_of_another() {
    let mut numbered = line();
    numbered.file = "b.csv".into();
    column(&mut numbered, "deviation_um").iter_mut().for_each(|d| *d = -*d);
    numbered.names.push("pair".into());
    numbered.columns.push((0..40).map(f64::from).collect());
    let s = Session::build(&[line(), numbered], History::default(), Machine::plain()).unwrap();
    assert!(s.readings[..40].iter().all(|r| r.pair.is_some()));
    assert!(s.readings[40..].iter().all(|r| r.pair.is_none()));
}

#[test]
fn rows_that_are_there_twice_count_once() {
    let mut raw = line();
    for c in &mut raw.columns {
        let v = c[39];
        c.push(v);
    }
    raw.instruments.push("laser".into());
    raw.lines.push(42);
    let s = build(raw).unwrap();
    assert_eq!(s.readings.len(), 40);
    assert!(s.notes.iter().any(|n| n.text.contains("1 row was there twice and counts once")));
}

#[test]
fn a_file_given_twice_is_refused() {
    let (first, mut second) = (line(), line());
    second.file = "again.csv".into();
    let build = |raws: &[Raw]| Session::build(raws, History::default(), Machine::plain());
    let message = build(&[first.clone(), second.clone()]).unwrap_err().to_string();
    assert!(message.contains("again.csv: all of its 40 readings stand in s.csv, too"), "{message}");
    // half of it under another name is no better
    for c in &mut second.columns {
        c.truncate(20);
    }
    second.instruments.truncate(20);
    second.lines.truncate(20);
    let message = build(&[second.clone(), first.clone()]).unwrap_err().to_string();
    assert!(message.contains("again.csv: all of its 20 readings"), "{message}");
    // the same program measured again is welcome
    column(&mut second, "deviation_um").iter_mut().for_each(|d| *d += 0.3);
    assert_eq!(build(&[first, second]).unwrap().readings.len(), 60);
}

#[test]
fn copies_with_times_of_their_own_count_once() {
    let mut raw = line();
    // no two readings agree by themselves
    column(&mut raw, "deviation_um").iter_mut().zip(0..).for_each(|(d, i)| *d += 0.0137 * f64::from(i));
    let twice = |c: &[f64], more: f64| c.iter().flat_map(|v| [*v, *v + more]).collect::<Vec<_>>();
    let time = raw.names.iter().position(|n| n == "t_s").unwrap();
    for (i, c) in raw.columns.iter_mut().enumerate() {
        *c = twice(c, if i == time { 1e-3 } else { 0.0 });
    }
    raw.instruments = vec!["laser".into(); 80];
    raw.lines = (2..82).collect();
    let s = build(raw.clone()).unwrap();
    assert_eq!(s.readings.len(), 40);
    assert!(
        s.notes.iter().any(|n| n.text.contains("40 readings repeat the one before them")),
        "{:?}",
        s.notes
    );
    // rounded so coarsely that neighbours agree by chance, nothing is taken for a copy
    column(&mut raw, "deviation_um").iter_mut().for_each(|d| *d = d.round());
    assert_eq!(build(raw).unwrap().readings.len(), 80);
}

#[test]
fn what_is_odd_is_said() {
    type Case = (&'static str, Box<dyn Fn(&mut Raw)>);
    let scaled = |name: &'static str, factor: f64| -> Box<dyn Fn(&mut Raw)> {
        Box::new(move |r| column(r, name).iter_mut().for_each(|v| *v *= factor))
    };
    let more = |name: &'static str, value: f64| -> Box<dyn Fn(&mut Raw)> {
        Box::new(move |r| {
            r.names.push(name.into());
            r.columns.push(vec![value; 40]);
        })
    };
    let cases: [Case; 16] = [
        ("s.csv:2: setup is 1.5; it is a number that counts", Box::new(|r| column(r, "setup").fill(1.5))),
        ("s.csv:2: dir_x is 5; it is a direction of travel", more("dir_x", 5.0)),
        (
            "t_s jumps from 95 s to 1700000100 s",
            Box::new(|r| column(r, "t_s").iter_mut().skip(20).for_each(|t| *t += 1.7e9)),
        ),
        (
            "t_s pauses for 100.0 days",
            Box::new(|r| column(r, "t_s").iter_mut().skip(20).for_each(|t| *t += 8.64e6)),
        ),
        ("t_s is the same in all rows", Box::new(|r| column(r, "t_s").fill(5.0))),
        ("every 5000 s: are these ms?", scaled("t_s", 1e3)),
        ("give 20000 mm/s between readings", scaled("t_s", 1e-4)),
        ("positions stay within 0.090 mm: are these m?", scaled("x_mm", 1e-3)),
        ("x_mm is 5 in all rows", Box::new(|r| column(r, "x_mm").fill(5.0))),
        (
            "no column x_mm, though readings look along x",
            Box::new(|r| {
                let i = r.names.iter().position(|n| n == "x_mm").unwrap();
                r.names[i] = "y_mm".into();
            }),
        ),
        ("reaches 0.120 mm only: are these m?", more("tool_length_mm", 0.12)),
        ("temp_air_degc stays within 0.021 degC of zero", more("temp_air_degc", 0.021)),
        ("no column instrument", Box::new(|r| r.instruments.fill("instrument".into()))),
        ("scatters by 721 µm RMS: are these nm?", scaled("deviation_um", 1e3)),
        ("scatters by 7214 µm RMS in setup 1, limit 3000", scaled("deviation_um", 1e4)),
        (
            "in setup 2, of 2.25 µm in another; is that setup in mm?",
            Box::new(|r| {
                for i in 20..40 {
                    column(r, "setup")[i] = 2.0;
                    column(r, "deviation_um")[i] *= 1e-3;
                }
            }),
        ),
    ];
    for (expected, change) in cases {
        let message = with(change);
        assert!(message.contains(expected), "expected '{expected}', got '{message}'");
    }
    let plain = with(|_| {});
    assert!(!plain.contains("are these") && !plain.contains("one clock"), "{plain}");
}

#[test]
fn a_file_that_says_nothing_is_left_out_beside_one_that_does() {
    let mut silent = line();
    silent.file = "zero.csv".into();
    column(&mut silent, "deviation_um").fill(0.0);
    let session = Session::build(&[line(), silent.clone()], History::default(), Machine::plain()).unwrap();
    assert_eq!(session.readings.len(), line().len());
    assert!(
        session
            .notes
            .iter()
            .any(|n| n.text.starts_with("zero.csv: every deviation_um is 0, so it is left out")),
        "{:?}",
        session.notes
    );
    let mut other = silent.clone();
    other.file = "other.csv".into();
    column(&mut other, "x_mm").iter_mut().for_each(|x| *x += 1.0);
    let e = Session::build(&[silent, other], History::default(), Machine::plain()).unwrap_err().to_string();
    assert!(e.starts_with("zero.csv: every deviation_um is 0; nothing was measured"), "{e}");
}

#[test]
fn what_comes_back_with_every_pass_is_nothing_beside_its_repeats() {
    let s = build(line()).unwrap();
    let left: Vec<f64> = s
        .readings
        .iter()
        .zip(&s.moments)
        .map(|(r, m)| m.position[0].sin() * 9.0 + 0.5 * r.repeat as f64)
        .collect();
    let beside = super::super::noise::beside_repeats(&s, &vec![true; left.len()], &left);
    // two passes half a um apart: a quarter each from their mean, and what the mean takes of the scatter given back
    assert!(beside.iter().all(|b| (b.abs() - 0.25 * 2f64.sqrt()).abs() < 1e-9), "{beside:?}");
    assert_eq!(
        super::super::noise::beside_repeats(&s, &vec![false; left.len()], &left),
        vec![0.0; left.len()]
    );
}

/// Times of a line whose readings at rest are `clock(reading, distance from the one before)` seconds apart.
fn times_of(clock: impl Fn(usize, f64) -> f64) -> Times {
    let mut raw = line();
    // targets at uneven distances
    let places = [0.0, 10.0, 40.0, 60.0, 140.0, 150.0, 200.0, 260.0, 270.0, 300.0];
    let (mut t, mut before) = (0.0, 0.0);
    for i in 0..40 {
        let x = if (i / 10) % 2 == 0 { places[i % 10] } else { places[9 - i % 10] };
        t += if i > 0 { clock(i, f64::abs(x - before)) } else { 0.0 };
        (column(&mut raw, "x_mm")[i], column(&mut raw, "t_s")[i]) = (x, t);
        before = x;
    }
    let session = build(raw).unwrap();
    let told = session.notes.iter().any(|n| n.text.contains("times are"));
    assert_eq!(told, session.times[0] != Times::Measured, "{:?}", session.notes);
    session.times_of(0)
}

#[test]
fn times_that_no_clock_has_shown_are_known() {
    assert_eq!(times_of(|_, _| 1.0), Times::Ordinal, "t_s counts the readings");
    assert_eq!(times_of(|_, _| 28.5), Times::Ordinal, "the same step whatever the distance");
    assert_eq!(times_of(|_, d| if d > 0.0 { 28.5 } else { 16.6 }), Times::Ordinal, "and another at the turn");
    assert_eq!(times_of(|_, d| 5.0 + d / 50.0), Times::Measured, "as the machine moves");
    assert_eq!(times_of(|i, _| 20.0 + 0.01 * (i as f64).sin()), Times::Measured, "a clock shows its jitter");
    // targets at equal distances: a schedule or a clock of whole seconds
    let s = build(line()).unwrap();
    assert_eq!(s.times, [Times::Nominal]);
}

#[test]
fn a_log_at_one_position_and_moving_axes_have_a_clock() {
    let mut log = line();
    column(&mut log, "x_mm").fill(0.0);
    assert_eq!(build(log).unwrap().times, [Times::Measured]);
    let mut moving = line();
    moving.names.push("moving".into());
    moving.columns.push(vec![1.0; 40]);
    assert_eq!(build(moving).unwrap().times, [Times::Measured]);
    let stated = Raw { times: Some(Times::Ordinal), ..line() };
    let s = build(stated).unwrap();
    assert_eq!(s.times, [Times::Ordinal]);
    assert!(s.moments.iter().all(|m| m.since_s[0] == f64::INFINITY), "no duration holds");
}

#[test]
fn marked_readings_are_kept_and_known() {
    let mut raw = line();
    raw.names.push("outlier".into());
    raw.columns.push((0..40).map(|i| f64::from(u8::from(i == 3))).collect());
    let s = build(raw.clone()).unwrap();
    let marked: Vec<u64> = s.readings.iter().filter(|r| r.is_marked).map(|r| r.line).collect();
    assert_eq!((s.readings.len(), marked), (40, vec![5]));
    assert!(s.extra.iter().all(|e| e.name != "outlier"), "no regressor");
    assert!(super::super::noise::outliers(&s, &s.gap(), &[0.0]).contains(&3));
    column(&mut raw, "outlier")[7] = 2.0;
    let message = build(raw).unwrap_err().to_string();
    assert!(message.starts_with("s.csv:9: outlier is 2; it marks a reading as an outlier"), "{message}");
}

#[test]
fn directions_that_a_file_does_not_know_are_not_made_up() {
    let mut raw = line();
    raw.names.push("dir_x".into());
    raw.columns.push(vec![0.0; 40]);
    assert!(build(raw).unwrap().moments.iter().all(|m| m.direction[0] == 0.0));
}

#[test]
fn instruments_read_together_are_thinned_together() {
    let mut raw = line();
    for c in &mut raw.columns {
        c.clear();
    }
    (raw.instruments, raw.lines) = (Vec::new(), Vec::new());
    // five probes read together, each with a setup of its own
    for k in 0..4000u64 {
        for probe in 0..5u64 {
            let d = 2.0 + (0.01 * k as f64).sin() + 0.1 * probe as f64;
            let row = [15.0 * k as f64, probe as f64 + 1.0, 1.0, 1.0, 0.0, 1.0, 0.0, 0.0, d];
            for (c, v) in raw.columns.iter_mut().zip(row) {
                c.push(v);
            }
            raw.instruments.push(format!("probe {probe}"));
            raw.lines.push(5 * k + probe + 2);
        }
    }
    let s = build(raw).unwrap();
    assert!(s.readings.len() <= ROWS_MAX, "{}", s.readings.len());
    let told = |n: &Note| n.text.contains("every second programmed point");
    assert!(s.notes.iter().any(told), "{:?}", s.notes);
    for probe in 0..5 {
        let kept = s.readings.iter().filter(|r| r.instrument == probe).count();
        assert_eq!(5 * kept, s.readings.len(), "probe {probe}");
    }
}

/// Travel along X, at rest at each sample or in motion, with the positions of another axis.
fn travel(t: &[f64], position: &[f64], other: Option<&[f64]>, in_motion: bool) -> motion::Travel {
    let all = [(Axis::X, position), (Axis::Y, other.unwrap_or(position))];
    let run = motion::Run::of(t, [0, t.len()], &all, motion::Moves::Unknown);
    motion::travel(&motion::Run { in_motion, circle: None, ..run }, position, None, 0.0)
}

#[test]
fn an_axis_turns_round_where_the_parabola_through_its_readings_does() {
    // a cosine read every 0.1 s turns round at 1.03 s
    let t: Vec<f64> = (0..20).map(|k| 0.1 * f64::from(k)).collect();
    let position: Vec<f64> = t.iter().map(|t| 100.0 * (0.5 * (t - 1.03)).cos()).collect();
    let found = travel(&t, &position, None, true);
    for (k, t) in t.iter().enumerate() {
        assert_eq!(found.direction[k], if *t < 1.03 { 1.0 } else { -1.0 }, "{t} s");
        if *t > 1.03 {
            let way = 100.0 * (1.0 - (0.5 * (t - 1.03)).cos());
            assert!((found.since[k] - way).abs() < 0.01, "{t} s: {} of {way} mm", found.since[k]);
            assert!((found.since_s[k] - (t - 1.03)).abs() < 1e-3, "{t} s: {}", found.since_s[k]);
        }
    }
}

#[test]
fn two_samples_at_the_same_place_hold_a_vertex_or_a_rest() {
    let t: Vec<f64> = (0..20).map(|k| 0.1 * f64::from(k)).collect();
    // a cosine turns round midway between samples 9 and 10
    let cosine = t.iter().map(|t| (50.0 * (t - 0.95).cos() * 1e5).round() * 1e-5).collect::<Vec<f64>>();
    let found = travel(&t, &cosine, None, true);
    for k in 0..20 {
        assert_eq!(found.direction[k], if k < 10 { 1.0 } else { -1.0 }, "{k}");
    }
    assert!((found.since_s[10] - 0.05).abs() < 1e-3, "{}", found.since_s[10]);
    assert!((found.since[10] - (50.0 - cosine[10])).abs() < 1e-3, "{}", found.since[10]);
    // a line at constant feed that is read twice at its end
    let line: Vec<f64> = (0..20).map(|k| if k < 10 { f64::from(k) } else { f64::from(19 - k) }).collect();
    let found = travel(&t, &line, None, true);
    assert_eq!((found.direction[9], found.direction[10], found.direction[11]), (1.0, 1.0, -1.0));
}

#[test]
fn slow_samples_of_a_steady_motion_have_velocities_where_the_file_says_that_it_moves() {
    let speed = |places: &dyn Fn(usize) -> f64, moving: f64| {
        let mut raw = line();
        for i in 0..40 {
            column(&mut raw, "t_s")[i] = 100.0 * (i / 10) as f64 + 2.0 * (i % 10) as f64;
            let k = if (i / 10) % 2 == 0 { i % 10 } else { 9 - i % 10 };
            column(&mut raw, "x_mm")[i] = places(k);
        }
        raw.names.push("moving".into());
        raw.columns.push(vec![moving; 40]);
        let s = build(raw).unwrap();
        s.moments.iter().map(|m| m.velocity[0]).collect::<Vec<f64>>()
    };
    let steady = |k: usize| 10.0 * k as f64;
    let found = speed(&steady, 1.0);
    assert!(found.iter().enumerate().all(|(i, v)| {
        let way = if (i / 10) % 2 == 0 { 1.0 } else { -1.0 };
        (v - 5.0 * way).abs() < 1e-9
    }));
    assert!(speed(&steady, 0.0).iter().all(|v| *v == 0.0));
    let uneven = |k: usize| [0.0, 10.0, 40.0, 60.0, 140.0, 150.0, 200.0, 260.0, 270.0, 300.0][k];
    assert!(speed(&uneven, 1.0).iter().all(|v| *v == 0.0), "the way between is not known");
}

#[test]
fn the_last_target_of_a_standard_cycle_is_read_from_both_sides() {
    let position = [0.0, 10.0, 20.0, 20.0, 10.0, 0.0, 0.0, 10.0];
    let t: Vec<f64> = (0..position.len()).map(|k| 30.0 * k as f64).collect();
    let direction = |position: &[f64]| travel(&t, position, None, false).direction;
    assert_eq!(direction(&position), [1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 1.0, 1.0]);
    // where every target is read twice without moving, so is the last
    let twice = [0.0, 0.0, 10.0, 10.0, 20.0, 20.0, 10.0, 10.0];
    assert_eq!(direction(&twice), [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, -1.0, -1.0]);
}

#[test]
fn an_axis_waits_at_the_end_of_a_line_of_a_grid() {
    let (x, y) = ([0.0, 10.0, 20.0, 20.0, 10.0, 0.0, 0.0, 10.0], [0.0, 0.0, 0.0, 5.0, 5.0, 5.0, 10.0, 10.0]);
    let t: Vec<f64> = (0..x.len()).map(|k| 5.0 * k as f64).collect();
    assert_eq!(travel(&t, &x, Some(&y), false).direction, [1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 1.0]);
    // from where it was before
    let run = motion::Run::of(&t, [0, t.len()], &[(Axis::X, &x), (Axis::Y, &y)], motion::Moves::Unknown);
    let direction = |position: &[f64], came: f64| motion::travel(&run, position, None, came).direction;
    assert_eq!(direction(&x, -1.0)[..3], [-1.0, 1.0, 1.0]);
    assert_eq!(direction(&y, -1.0), [-1.0, -1.0, -1.0, 1.0, 1.0, 1.0, 1.0, 1.0]);
    assert_eq!(direction(&[7.0; 8], -1.0), [-1.0; 8]);
}

#[test]
fn the_first_point_of_a_grid_is_left_out_and_an_axis_comes_from_the_run_before() {
    let grid = |stated: bool| {
        let mut raw = line();
        for i in 0..40 {
            // five lines of four points, to and fro, twice
            let (row, k) = (i % 20 / 4, i % 4);
            column(&mut raw, "x_mm")[i] = 100.0 * if row % 2 == 0 { k } else { 3 - k } as f64;
            column(&mut raw, "run")[i] = 1.0 + (i / 20) as f64;
        }
        raw.names.extend(["y_mm".into(), "z_mm".into()]);
        raw.columns.push((0..40).map(|i| 100.0 * (i % 20 / 4) as f64).collect());
        raw.columns.push((0..40).map(|i| if i < 20 { 0.0 } else { -50.0 }).collect());
        if stated {
            raw.names.push("dir_x".into());
            raw.columns.push(vec![1.0; 40]);
        }
        build(raw).unwrap()
    };
    let s = grid(false);
    assert_eq!(s.readings.len(), 39);
    assert!(s.notes.iter().any(|n| n.text.contains("first point (1) are left out")));
    let direction = |i: usize| s.moments[i].direction[..3].to_vec();
    assert_eq!((direction(2), direction(3)), (vec![1.0, 1.0, 0.0], vec![1.0, 1.0, 0.0]));
    // from 300 mm back to 0, from 400 mm back to 0, and down, where it stays
    assert_eq!((direction(19), direction(20)), (vec![-1.0, -1.0, -1.0], vec![1.0, -1.0, -1.0]));
    assert_eq!(direction(38), [1.0, 1.0, -1.0]);
    assert_eq!(grid(true).readings.len(), 40);
}

#[test]
fn a_lost_reading_needs_no_direction_and_one_that_was_taken_does() {
    let whole = with(|r| {
        for name in ["deviation_um", "u_x", "u_y", "u_z"] {
            column(r, name)[3] = f64::NAN;
        }
    });
    assert!(whole.contains("1 of 40 readings are lost"), "{whole}");
    assert!(with(|r| column(r, "u_y")[3] = f64::NAN).contains("s.csv:5: u_y is empty"));
}
