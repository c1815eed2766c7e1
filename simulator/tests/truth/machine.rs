//! The truth machine as a whole: figures of the shipped machines, determinism, drives, replay, instruments, files.
#![expect(clippy::unwrap_used, clippy::expect_used, reason = "a failure here is a failed test")]

use simulator::instruments::ballbar::{Ballbar, CirclePoint, Circularity};
use simulator::instruments::diagonal::Diagonal;
use simulator::instruments::interferometer::{self, Interferometer, Positioning};
use simulator::instruments::{InstrumentError, no_offset};
use simulator::truth::{GANTRY_5AX, GRINDER_AB, Sample, TruthMachine, VMC_850};
use volcomp::model::axes::{AxisArray, AxisName, MAX_AXES};

const AT_REST: [i8; MAX_AXES] = [0; MAX_AXES];

fn vmc() -> TruthMachine {
    TruthMachine::from_toml(VMC_850).unwrap()
}

fn at(x: f64, y: f64, z: f64) -> AxisArray {
    [x, y, z, 0., 0., 0., 0., 0.]
}

/// A circle of radius 100 in a plane, both ways round, driven at 2 m/min with a 1 ms cycle.
fn circle(machine: &mut TruthMachine, centre: [f64; 3], plane: [usize; 2], seed: u64) -> Circularity {
    let (radius, speed, dt) = (100.0, 2000.0 / 60.0, 0.001);
    let position = |angle: f64| {
        let mut q = at(centre[0], centre[1], centre[2]);
        q[plane[0]] += radius * angle.cos();
        q[plane[1]] += radius * angle.sin();
        q
    };
    machine.reset(seed, &position(0.0));
    let mut points = Vec::new();
    for direction in [1.0, -1.0] {
        let lead_in = 0.3;
        let mut angle = -lead_in;
        while angle < std::f64::consts::TAU {
            angle += speed / radius * dt;
            let q = position(direction * angle);
            let sample = machine.step(dt, &q);
            if angle >= 0.0 {
                points
                    .push(CirclePoint { commanded_mm: machine.nominal(&q).tip_mm, actual_mm: sample.tip_mm });
            }
        }
    }
    let centre_mm = machine.nominal(&at(centre[0], centre[1], centre[2])).tip_mm;
    let ballbar = Ballbar { centre_mm, radius_mm: radius, plane, noise_um: 0.0, seed };
    ballbar.trace(&points).unwrap().circularity().unwrap()
}

#[test]
fn the_default_machine_has_errors_of_realistic_size() {
    let mut machine = vmc();
    assert_eq!(machine.machine(), "vmc-850");
    assert_eq!(machine.axes(), [AxisName::X, AxisName::Y, AxisName::Z]);
    let figures = circle(&mut machine, [425.0, 250.0, -300.0], [0, 1], 1);
    println!("circle R100 in XY: {figures:?}");
    let g = figures.bidirectional_um;
    assert!((20.0..40.0).contains(&g), "circularity {g} um");
    let mut ranges = Vec::new();
    for (from, to) in [
        (at(0., 0., -500.), at(850., 500., 0.)),
        (at(850., 0., -500.), at(0., 500., 0.)),
        (at(0., 500., -500.), at(850., 0., 0.)),
        (at(0., 0., 0.), at(850., 500., -500.)),
    ] {
        ranges.push(Diagonal::of_machine(&machine, [&from, &to], 50, no_offset).unwrap().range_um());
    }
    println!("diagonals: {ranges:?}");
    assert!((30.0..80.0).contains(&ranges[0]), "{ranges:?}");
    for k in 0..3 {
        let [low, high] = machine.travel(k);
        let largest = |i: usize| {
            (0..=100)
                .map(|n| machine.true_motion(k, low + (high - low) * f64::from(n) / 100.0, 0)[i].abs())
                .fold(0.0, f64::max)
        };
        for i in 0..6 {
            let (limit, least) = if i < 3 { (0.025, 0.001) } else { (60e-6, 5e-6) };
            let size = largest(i);
            assert!((least..limit).contains(&size), "axis {k}, component {i}: {size}");
        }
    }
}

#[test]
fn every_shipped_machine_is_exact_at_home_and_has_a_chain() {
    for text in [VMC_850, GANTRY_5AX, GRINDER_AB] {
        let machine = TruthMachine::from_toml(text).unwrap();
        for k in 0..machine.axes().len() {
            for value in machine.true_motion(k, 0.0, 0) {
                assert!(value.abs() < 1e-15, "{}: axis {k} at home: {value}", machine.machine());
            }
        }
        assert!(machine.chain().text().starts_with("[w "));
    }
}

#[test]
fn a_machine_without_errors_has_no_deviation() {
    let text = "
        format = 'volcomp-truth/1'
        machine = 'ideal'
        chain = \"[w C' X' b Y Z B (S) t]\"
        frame = { workpiece-origin-mm = [10, 20, -300], tool-tip-mm = [1, 2, -90] }
        axes = [
            { name = 'X', travel-mm = [-100, 400] }, { name = 'Y', travel-mm = [-100, 300] },
            { name = 'Z', travel-mm = [-200, 0] }, { name = 'B', travel-deg = [-90, 90], point-mm = [0, 5, 70] },
            { name = 'C', travel-deg = [-360, 360], point-mm = [50, 60, -300] },
        ]";
    let mut machine = TruthMachine::from_toml(text).unwrap();
    let q = [120.0, -30.0, -77.0, 35.0, -140.0, 0., 0., 0.];
    let deviation = machine.deviation(&q, &[1; MAX_AXES]);
    for value in deviation.tip_mm.iter().chain(&deviation.rotation_rad) {
        assert!(value.abs() < 1e-12);
    }
    let sample = machine.step(0.001, &q);
    assert_eq!(sample.axis, q);
    assert_eq!(sample.encoder, q);
    for (actual, nominal) in sample.tip_mm.iter().zip(machine.nominal(&q).tip_mm) {
        assert!((actual - nominal).abs() < 1e-10);
    }
}

fn run(machine: &mut TruthMachine, seed: u64) -> Vec<Sample> {
    machine.reset(seed, &at(400., 200., -100.));
    (0..500)
        .map(|n| {
            let t = f64::from(n) * 0.001;
            machine.step(0.001, &at(400. + 30. * t, 200. + 5. * (20. * t).sin(), -100. - t))
        })
        .collect()
}

#[test]
fn the_same_seed_gives_the_same_run_bit_for_bit() {
    let bits = |samples: Vec<Sample>| -> Vec<u64> {
        samples
            .iter()
            .flat_map(|s| s.axis.iter().chain(&s.encoder).chain(&s.tip_mm).chain(&s.direction))
            .map(|v| v.to_bits())
            .collect()
    };
    let first = bits(run(&mut vmc(), 7));
    let mut again = vmc();
    let _ = run(&mut again, 8);
    assert_eq!(first, bits(run(&mut again, 7)), "a reset must leave nothing behind");
    assert_ne!(first, bits(run(&mut again, 8)), "another seed must be another run");
}

#[test]
fn axes_lag_by_speed_times_time_constant_and_encoders_count_in_steps() {
    let mut machine = vmc();
    machine.reset(1, &at(0., 0., 0.));
    let speed = 50.0;
    let mut sample = Sample::default();
    for n in 1..=200 {
        let way = speed * f64::from(n) * 0.001;
        sample = machine.step(0.001, &at(way, way, -way));
    }
    let way = speed * 0.2;
    for (k, tau) in [(0, 0.005), (1, 0.005_02), (2, 0.004_98)] {
        let behind = way - sample.axis[k].abs();
        assert!((behind - speed * tau).abs() < 1e-9, "axis {k}: {behind}");
        let counts = sample.encoder[k] / 1e-4;
        assert!((counts - counts.round()).abs() < 1e-6, "axis {k}: {} is no whole step", sample.encoder[k]);
        assert!((sample.encoder[k] - sample.axis[k]).abs() < 3e-4);
    }
}

#[test]
fn recorded_positions_are_taken_as_they_are() {
    let mut machine = vmc().with_ideal_drives();
    machine.reset(1, &at(10., 10., -10.));
    let q = at(300.123_456, 200.0, -50.5);
    let sample = machine.step_measured(0.002, &q);
    assert_eq!(sample.axis, q);
    assert_eq!(sample.encoder, q);
    let at_rest = machine.pose(&q, &[1, 1, -1, 0, 0, 0, 0, 0]);
    for (moving, still) in sample.tip_mm.iter().zip(at_rest.tip_mm) {
        assert!((moving - still).abs() < 1e-12);
    }
}

#[test]
fn a_longer_tool_carries_angular_errors_further() {
    let mut machine = vmc();
    let q = at(850., 500., -500.);
    let short = machine.deviation(&q, &AT_REST);
    machine.set_tool_tip_mm([0., 0., -320.]);
    let long = machine.deviation(&q, &AT_REST);
    // dx = EB * dz with dz = -200, first order.
    let expected = short.rotation_rad[1] * -200.0;
    assert!((long.tip_mm[0] - short.tip_mm[0] - expected).abs() < 1e-6);
}

fn scale_machine(extra: &str) -> TruthMachine {
    let text = format!(
        "
        format = 'volcomp-truth/1'
        machine = 'scale'
        chain = \"[w X' b Y t]\"
        axes = [{{ name = 'X', travel-mm = [-200, 800]{extra} }}, {{ name = 'Y', travel-mm = [0, 100] }}]
        errors = {{ exx = [{{ slope = {{ rise-um = 50 }} }}] }}"
    );
    TruthMachine::from_toml(&text).unwrap()
}

#[test]
fn an_interferometer_sees_a_scale_error_with_its_sign() {
    let plan = Positioning {
        axis: AxisName::X,
        at: at(0., 50., 0.),
        targets_mm: (0..=10).map(|n| -100.0 + 80.0 * f64::from(n)).collect(),
        cycles: 2,
    };
    let laser = Interferometer { noise_um: 0.0, seed: 1 };
    let rows = laser.positioning(&scale_machine(""), &plan, no_offset).unwrap();
    assert_eq!(rows.len(), 2 * 2 * 11);
    for row in &rows {
        // 50 um per m: actual further than nominal is plus.
        assert!((row.deviation_um - 0.05 * (row.target_mm + 100.0)).abs() < 1e-6, "{row:?}");
    }
    let halved = laser.positioning(&scale_machine(""), &plan, |q| at(-0.5 * 0.05e-3 * q[0], 0., 0.)).unwrap();
    assert!((halved[10].deviation_um - 20.0).abs() < 0.01, "{:?}", halved[10]);
    let text = interferometer::csv(&rows);
    assert!(text.starts_with("cycle,direction,target_mm,deviation_um\n1,1,-100,0.000000\n"), "{text}");
}

#[test]
fn an_interferometer_sees_lost_motion_as_a_difference_of_directions() {
    let plan = Positioning {
        axis: AxisName::X,
        at: at(0., 50., 0.),
        targets_mm: vec![0.0, 100.0, 200.0],
        cycles: 1,
    };
    let laser = Interferometer { noise_um: 0.0, seed: 1 };
    let rows = laser.positioning(&scale_machine(", backlash-um = 8"), &plan, no_offset).unwrap();
    let of = |direction: i8, target: f64| {
        rows.iter().find(|r| r.direction == direction && r.target_mm == target).unwrap().deviation_um
    };
    for target in [0.0, 100.0, 200.0] {
        // Coming back, the carriage stays behind on the plus side.
        assert!((of(-1, target) - of(1, target) - 8.0).abs() < 0.01);
    }
}

#[test]
fn an_interferometer_needs_a_linear_axis_and_targets() {
    let laser = Interferometer { noise_um: 0.0, seed: 1 };
    let mut plan = Positioning { axis: AxisName::Z, at: at(0., 0., 0.), targets_mm: vec![0., 1.], cycles: 1 };
    let refused = laser.positioning(&scale_machine(""), &plan, no_offset).unwrap_err();
    assert_eq!(refused, InstrumentError::NoLinearAxis { axis: AxisName::Z });
    plan = Positioning { axis: AxisName::X, targets_mm: vec![0.], ..plan };
    let refused = laser.positioning(&scale_machine(""), &plan, no_offset).unwrap_err();
    assert_eq!(refused, InstrumentError::TooFew { count: 1, needed: 2 });
}

/// The refusal of the default file after one replacement.
fn refusal(from: &str, to: &str) -> String {
    assert!(VMC_850.contains(from), "{from:?} is not in the default file");
    TruthMachine::from_toml(&VMC_850.replacen(from, to, 1)).expect_err("must be refused").to_string()
}

#[test]
fn mistakes_in_a_truth_file_are_named() {
    let names = |from: &str, to: &str, words: &[&str]| {
        let message = refusal(from, to);
        for word in words {
            assert!(message.contains(word), "{message:?} does not say {word:?}");
        }
    };
    names("volcomp-truth/1\"", "volcomp-truth/9\"", &["volcomp-truth/9", "volcomp-truth/1"]);
    names("[w X' Y' b Z t]\"", "[w X' Y' Z t]\"", &["no b (bed)"]);
    names("[w X' Y' b Z t]\"", "[w X' b Y Z A t]\"", &["axis A", "no [[axes]] entry"]);
    names("[w X' Y' b Z t]\"", "[w X' Y' b t]\"", &["axis Z", "not in the chain"]);
    names("seed = 850", "sead = 850", &["sead", "line"]);
    names("name = \"Y\"", "name = \"X\"", &["axis X has two"]);
    names("name = \"Y\"", "name = \"Q\"", &["unknown axis \"Q\""]);
    names("travel-mm = [0, 850]", "travel-mm = [850, 0]", &["axis X", "travel-mm"]);
    names("travel-mm = [0, 850]", "travel-mm = [10, 850]", &["home (0)"]);
    names("travel-mm = [0, 850]", "travel-mm = [0, nan]", &["axis X", "finite"]);
    names("travel-mm = [0, 850]", "travel-deg = [0, 850]", &["travel-deg", "travel-mm"]);
    names("backlash-um = 0.3", "backlash-um = -1", &["backlash", "0 to 1000"]);
    names("lag-ms = 5.00", "lag-ms = -5.0", &["lag-ms"]);
    names("ec0y-arcsec = -11.0", "ec0y-arcsec = 3000", &["10 mrad"]);
    names("exx = [", "exq = [", &["exq", "line"]);
    names("rise-um = -11", "rise-arcsec = -11", &["exx", "shape 1 (slope)", "rise-um"]);
    names("rise-um = -11", "rise-um = -11000", &["exx", "um", "is the unit right"]);
    names("rise-um = -11", "rise-um = inf", &["finite number"]);
    names("{ slope = { rise-um = -11 } }", "{ ramp = { rise-um = -11 } }", &["ramp", "waviness"]);
    names("period-mm = 340", "period-mm = 0", &["period-mm", "above 0"]);
    names("period-mm = 340", "period-mm = 340, tilt = 1", &["tilt", "amplitude-um, period-mm, phase-deg"]);
    names("{ bow = { height-um = 4.5 } }", "{ slope = { rise-um = 4.5 } }", &["eyx", "squareness"]);
    let samples = "{ samples = { at-mm = [0, 50, 50], value-um = [0, 1, 2] } }";
    names("{ bow = { height-um = 4.5 } }", samples, &["at-mm", "50", "entry 3", "rise"]);
    let samples = "{ samples = { at-mm = [0, 50], value-um = [0, 1, 2] } }";
    names("{ bow = { height-um = 4.5 } }", samples, &["value-um", "3 entries, 2"]);
    names("\n[errors]", "\n[location]\nex0c-um = 3\n[errors]", &["ex0c-um", "no rotary axis"]);
}

#[test]
fn a_location_error_along_the_axis_itself_is_refused() {
    let text = GANTRY_5AX.replace("ex0c-um = 12", "ez0c-um = 12");
    let message = TruthMachine::from_toml(&text).unwrap_err().to_string();
    assert!(message.contains("ez0c-um") && message.contains("ex0c-um"), "{message}");
    let text = GANTRY_5AX.replace("point-mm = [0, 0, -100]", "");
    assert!(TruthMachine::from_toml(&text).unwrap_err().to_string().contains("axis C needs point-mm"));
}
