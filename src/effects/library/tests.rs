use std::collections::BTreeSet;

use super::{EFFECTS, Shape, forms};
use crate::Signal;
use crate::addition::{Addition, Entry, FORMAT};
use crate::data::Data;
use crate::extend::{Fate, extend};
use crate::machine_state::{Axis, Light, Machine, MachineAxis, MachineState, SLOTS, Source};
use crate::prediction::machine_of;
use crate::{Kind, Lever, RotaryFrame, WIDTH_MAX, unit_of};
use volcomp_model::geometry::Vec3;
use volcomp_model::{AxisSpec, Chain, Model, ModelSpec};

fn evaluated(shape: &Shape, m: &MachineState) -> Vec<Vec3> {
    let mut out = vec![Vec3::zeros(); shape.width()];
    shape.evaluate_with(m, &|_| Some(0), &mut out);
    out
}

/// A five-axis machine on whose model the effects are put.
fn model() -> ModelSpec {
    let mut spec = ModelSpec::new("all", Chain::parse("[w C' A' Y' b X Z t]").unwrap());
    spec.gauge_point = Some(Vec3::zeros());
    spec.tool_tip = Vec3::new(0.0, 0.0, -120.0);
    spec.axes = Axis::ALL
        .into_iter()
        .filter(|a| *a != Axis::B)
        .map(|a| {
            let travel = Some(if a.is_linear() { [-300.0, 300.0] } else { [-1.5, 1.5] });
            AxisSpec { travel, point: Vec3::new(10.0, -20.0, 5.0), ..AxisSpec::new(a.name()) }
        })
        .collect();
    spec
}

/// Data that show every effect.
fn all_data() -> Data {
    let spec = model();
    let mut machine: Machine = machine_of(&spec, &Model::new(&spec).unwrap());
    let b = MachineAxis {
        axis: Axis::B,
        workpiece_side: false,
        point_mm: Vec3::zeros(),
        reference_points: Default::default(),
        travel: None,
    };
    machine.axes.push(b);
    let temperature = |name: &str| (Source::Temperature(name.to_owned()), [18.0, 26.0], 19.0);
    Data {
        machine,
        axes: Axis::ALL.into(),
        range: Axis::ALL.map(|a| Some(if a.is_linear() { [-300.0, 300.0] } else { [-1.5, 1.5] })),
        moves: [true; SLOTS],
        accelerates: [true; SLOTS],
        reverses: [true; SLOTS],
        soonest_s: [0.0; SLOTS],
        nearest: [0.0; SLOTS],
        forces: [true; 3],
        sees: [true; 3],
        positions: core::array::from_fn(|_| (-300..=300).map(f64::from).collect()),
        looked_at: core::array::from_fn(|_| core::array::from_fn(|_| (-300..=300).map(f64::from).collect())),
        targets: core::array::from_fn(|axis| {
            let unequal = |k: i32| 0.14 * f64::from(k) + 0.01 * f64::from(k * k % 7);
            if axis < 3 { (-300..=300).map(f64::from).collect() } else { (-10..=10).map(unequal).collect() }
        }),
        tested: core::array::from_fn(|axis| {
            let unequal = |k: i32| 0.14 * f64::from(k) + 0.01 * f64::from(k * k % 7);
            let scale = if axis < 3 { 200.0 } else { 1.0 };
            core::array::from_fn(|_| (-10..=10).map(|k| scale * unequal(k)).collect())
        }),
        tools: true,
        lengths: true,
        ranges: true,
        lights: Light::ALL.into(),
        angular: true,
        only_angles: false,
        ballbar_setups: vec![0, 1],
        stations: true,
        one_setup: true,
        encoders_only: false,
        clocks: vec![(0, 0.0, 100.0), (1, 0.0, 100.0)],
        sources: vec![temperature("air"), temperature("spindle"), (Source::Spindle, [0.0, 8.0], 0.0)],
        follow_spindle: Vec::new(),
        first: MachineState::default(),
    }
}

/// A moment at which everything is known.
fn moment() -> MachineState {
    MachineState {
        t_s: 10.0,
        position: [120.0, -80.0, 40.0, 0.3, -0.2, 0.9],
        velocity: [12.0, -7.0, 5.0, 0.1, 0.1, -0.2],
        acceleration: [300.0; SLOTS],
        direction: [1.0; SLOTS],
        since_mm: [4.0; SLOTS],
        since_s: [0.02; SLOTS],
        u: Vec3::x(),
        tool_length_mm: 120.0,
        range_mm: 2000.0,
        target_mm: Vec3::new(60.0, 20.0, 30.0),
        station_mm: Vec3::new(-2000.0, 0.0, 0.0),
        reflector_mm: Vec3::zeros(),
        light: Some(Light::Tracker),
        is_ballbar: true,
        setup: 1,
        force_n: [500.0; 3],
        signals: vec![23.0],
        ..MachineState::default()
    }
}

/// What an addition says of a shape.
fn entry(effect: &crate::Effect, subject: &str, shape: Shape) -> Entry {
    let width = shape.width();
    let range = |a: &Axis| (a.column(), if a.is_linear() { [-300.0, 300.0] } else { [-80.0, 80.0] });
    let mut valid: std::collections::BTreeMap<String, [f64; 2]> = Axis::ALL.iter().map(range).collect();
    for a in Axis::ALL {
        valid.insert(a.velocity_column(), [-50.0, 50.0]);
        valid.insert(a.acceleration_column(), [-900.0, 900.0]);
    }
    for (source, range, _) in all_data().sources {
        let per = if source == Source::Spindle { 1000.0 } else { 1.0 };
        valid.insert(source.to_string(), range.map(|v| per * v));
    }
    Entry {
        name: effect.name.to_owned(),
        subject: subject.to_owned(),
        kind: effect.kind,
        probability: 0.9,
        confounded_with: Vec::new(),
        parameter_names: shape.parameters(),
        values: (0..width).map(|k| 2.0 - 0.1 * k as f64).collect(),
        covariance: vec![vec![0.0; width]; width],
        valid,
        shape,
    }
}

#[test]
fn every_effect_has_a_page_and_a_name_of_its_own() {
    let mut names = BTreeSet::new();
    for e in EFFECTS {
        for text in [e.title, e.cause, e.formula, e.looks_like, e.confused_with, e.settles, e.remedy] {
            assert!(!text.trim().is_empty(), "{}: {e:?}", e.name);
        }
        assert_eq!(e.title.contains("{}"), !e.subjects.words().is_empty(), "{}: its title", e.name);
        assert!(e.name.bytes().all(|b| b.is_ascii_lowercase() || b == b'-'), "{}", e.name);
        assert!(names.insert(e.name), "{} stands twice", e.name);
        assert!(!e.subjects.all().is_empty());
    }
    for (e, synonym) in EFFECTS.iter().flat_map(|e| e.synonyms.split(' ').map(move |s| (e, s))) {
        assert!(!synonym.is_empty() && names.insert(synonym), "{}: synonym {synonym:?} stands twice", e.name);
        assert_eq!(crate::Effect::find(synonym).map(|f| f.name), Some(e.name));
    }
}

#[test]
fn every_effect_has_variants_with_all_parts() {
    let (data, m) = (all_data(), moment());
    for e in EFFECTS {
        for subject in e.subjects.all() {
            let shapes = (e.variants)(&data, &subject).unwrap();
            let label = format!("{}:{}", e.name, subject.name);
            // sag is down, and no beam reaches out downwards
            let none = e.kind == Kind::Stochastic || label == "sag:z";
            assert_eq!(shapes.is_empty(), none, "{label} is found with formulas or by tests of its own");
            for shape in shapes {
                let form = shape.form();
                let names = shape.parameters();
                assert!((1..=WIDTH_MAX).contains(&names.len()), "{label}: {names:?}");
                assert_eq!(names.len(), shape.width(), "{label}: {shape:?}");
                for name in names.iter().cloned().chain(shape.fixed().into_iter().map(|f| f.0)) {
                    assert!(
                        unit_of(&name).is_some_and(|(stem, _)| !stem.is_empty()),
                        "{label}: {name} has no unit"
                    );
                }
                assert_eq!(names.iter().collect::<BTreeSet<_>>().len(), names.len(), "{label}: {names:?}");
                let out = evaluated(&shape, &m);
                assert!(out.iter().flatten().all(|v| v.is_finite()), "{label}: {shape:?}");
                assert!(!form.columns().is_empty() && form.is_valid() && form.is_itself(), "{label}");
                assert_eq!(form.changed(1.1).len(), form.changed(0.9).len(), "{label}");
                let _ = shape.drawing();
                let written = toml::to_string(&shape).unwrap();
                assert_eq!(toml::from_str::<Shape>(&written).unwrap(), shape, "{label}: {written}");
            }
        }
    }
}

/// A formula that its own list of columns does not provide for would be predicted wrongly where a column is missing.
#[test]
fn what_a_formula_reads_stands_among_its_columns() {
    let (data, all) = (all_data(), moment());
    for e in EFFECTS.iter().filter(|e| e.kind == Kind::Machine) {
        for subject in e.subjects.all() {
            for shape in (e.variants)(&data, &subject).unwrap() {
                let columns = shape.form().columns();
                let needs = |column: &str| columns.iter().any(|c| c == column);
                for a in Axis::ALL {
                    let without = |column: String, change: &dyn Fn(&mut MachineState, usize)| {
                        let mut m = all.clone();
                        change(&mut m, a.slot());
                        let is_known = evaluated(&shape, &m).iter().flatten().all(|v| v.is_finite());
                        assert!(is_known || needs(&column), "{} without {column}: {shape:?}", e.name);
                    };
                    without(a.acceleration_column(), &|m, k| m.acceleration[k] = f64::NAN);
                    without(a.velocity_column(), &|m, k| m.velocity[k] = f64::NAN);
                    without(format!("dir_{a}"), &|m, k| m.direction[k] = f64::NAN);
                }
            }
        }
    }
}

#[test]
fn every_effect_of_the_machine_is_put_into_a_model_or_says_why_not() {
    let (data, spec) = (all_data(), model());
    let mut taken = BTreeSet::new();
    for e in EFFECTS {
        // the model has no axis B
        for subject in e.subjects.all().into_iter().filter(|s| s.axis != Axis::B) {
            for shape in (e.variants)(&data, &subject).unwrap() {
                let addition = Addition {
                    format: FORMAT.to_owned(),
                    machine: "all".to_owned(),
                    sense: String::new(),
                    base: None,
                    effects: vec![entry(e, &subject.name, shape.clone())],
                };
                addition.check().unwrap();
                let extended = extend(&spec, &[], &addition).unwrap();
                if let Shape::RotaryLocation(location) = &shape {
                    // the constants of a model show at zero, too
                    let is_taken = matches!(extended.fates[0].1, Fate::Taken(_));
                    assert_eq!(is_taken, location.unaligned, "{location:?}");
                }
                match &extended.fates[0].1 {
                    Fate::Taken(symbols) => {
                        assert!(!symbols.is_empty() && e.kind == Kind::Machine, "{}", e.name);
                        taken.insert(e.name);
                    }
                    Fate::Left(why) => {
                        assert!(!why.is_empty() && e.name != "backlash", "{}: {why}: {shape:?}", e.name);
                    }
                }
            }
        }
    }
    let left = EFFECTS.iter().filter(|e| e.kind == Kind::Machine && !taken.contains(e.name));
    let left: Vec<&str> = left.map(|e| e.name).collect();
    assert_eq!(left, ["load"], "effects that this model does not take over");
}

#[test]
fn the_run_of_a_table_on_a_swivel_turns_with_the_swivel() {
    let frame = RotaryFrame {
        axis: Axis::C,
        workpiece_side: true,
        point_mm: [0.0; 3],
        outer: vec![Axis::A],
        outer_points_mm: vec![[0.0; 3]],
        inner: vec![],
        inner_points_mm: vec![],
        tip_mm: [0.0; 3],
        nose_mm: None,
    };
    let runs = |frame| {
        Shape::RotaryMotion(forms::RotaryMotion {
            axis: Axis::C,
            along: vec![Axis::Z],
            low: 2,
            high: 2,
            frame,
        })
    };
    let quarter = core::f64::consts::FRAC_PI_2;
    let m = MachineState { position: [0.0, 0.0, 0.0, quarter, 0.0, quarter], ..MachineState::default() };
    // a table turns against its coordinate: what pointed up points along plus y
    let turned = evaluated(&runs(Some(frame)), &m)[0];
    assert!((turned - Vec3::new(0.0, -2.0, 0.0)).norm() < 1e-12, "{turned}");
    assert!((evaluated(&runs(None), &m)[0] - Vec3::new(0.0, 0.0, -2.0)).norm() < 1e-12);
}

#[test]
fn each_kind_of_light_has_its_own_air_and_a_laser_no_scale_of_a_tracker() {
    let at = |light| MachineState {
        light: Some(light),
        range_mm: 2000.0,
        station_mm: Vec3::new(-2000.0, 0.0, 0.0),
        reflector_mm: Vec3::zeros(),
        u: Vec3::x(),
        ..MachineState::default()
    };
    let scale = Shape::TrackerScale(forms::TrackerScale { signal: None, zero: true });
    assert_eq!(evaluated(&scale, &at(Light::Tracker)), [Vec3::new(2.0, 0.0, 0.0), Vec3::x()]);
    assert_eq!(evaluated(&scale, &at(Light::Laser)), [Vec3::zeros(); 2]);
    let signal = Signal::of(Source::Temperature("air".to_owned()), 0.0);
    for (own, other) in [(Light::Laser, Light::Tracker), (Light::Tracker, Light::Laser)] {
        let path =
            Shape::DeadPath(forms::DeadPath { signal: signal.clone(), light: Some(own), station: None });
        let mut out = [Vec3::zeros(); 2];
        let seen = |light, out: &mut [Vec3]| {
            let m = MachineState { signals: vec![21.0], ..at(light) };
            path.evaluate_with(&m, &|_| Some(0), out);
        };
        seen(own, &mut out);
        assert_eq!(out[1], Vec3::x());
        out.fill(Vec3::zeros());
        seen(other, &mut out);
        assert_eq!(out, [Vec3::zeros(); 2]);
    }
}

#[test]
fn a_moment_bends_a_ram_with_the_square_of_its_reach() {
    let lever = Lever { axes: [false; 3], home_mm: [0.0; 3], tool: false };
    let ram = Shape::Ram(forms::Ram {
        axis: Axis::Y,
        up: Axis::Z,
        start_mm: 0.0,
        reach_mm: 100.0,
        lever,
        moment: true,
        beam: false,
    });
    let mut m = MachineState::default();
    m.position[1] = 50.0;
    let drops: Vec<f64> = evaluated(&ram, &m).iter().map(|d| d.z).collect();
    assert_eq!(drops, [-0.125, -0.0625, -0.25]);
}

#[test]
fn a_horizontal_ram_drops_as_it_comes_out_and_turns_its_tool_down() {
    let lever = Lever { axes: [false; 3], home_mm: [0.0, 0.0, -80.0], tool: false };
    let (axis, up, start_mm, reach_mm) = (Axis::Z, Axis::Y, 0.0, 100.0);
    let ram = forms::Ram { axis, up, start_mm, reach_mm, lever, moment: false, beam: false };
    let mut m = MachineState::default();
    m.position[2] = -50.0;
    // half out: 1/8 at the nose, and 80 mm farther at the slope 3/2 s^2 per reach
    let drop = evaluated(&Shape::Ram(ram), &m)[0];
    assert!((drop - Vec3::new(0.0, -0.125 - 80.0 * 1.5 * 0.25 / 100.0, 0.0)).norm() < 1e-12, "{drop}");
    let mut data = all_data();
    data.machine.vertical = Some(Axis::Y);
    let sag = EFFECTS.iter().find(|e| e.name == "sag").unwrap();
    let shapes: Vec<Shape> =
        sag.subjects.all().iter().flat_map(|s| (sag.variants)(&data, s).unwrap()).collect();
    assert_eq!(shapes.len(), 2 * (6 + 18), "along x and z, none along y");
    for shape in shapes.iter().filter(|s| s.over() == Some(Axis::Z)) {
        let drop = |z: f64| {
            m.position[2] = z;
            evaluated(shape, &m)[0].y
        };
        let [within, out] = [300.0, -300.0].map(drop);
        assert!(out < within - 0.1, "{shape:?}: {within} {out}");
    }
}

#[test]
fn a_ram_that_drops_with_its_tool_becomes_a_displacement_and_an_angle() {
    let mut spec = ModelSpec::new("m", Chain::parse("[w B' X' b Y Z t]").unwrap());
    (spec.gauge_point, spec.tool_tip) = (Some(Vec3::zeros()), Vec3::new(0.0, 0.0, -120.0));
    spec.axes = [Axis::X, Axis::Y, Axis::Z]
        .map(|a| AxisSpec { travel: Some([0.0, 400.0]), ..AxisSpec::new(a.name()) })
        .to_vec();
    let effect = EFFECTS.iter().find(|e| e.name == "sag").unwrap();
    let nose = Lever { axes: [false; 3], home_mm: [0.0; 3], tool: true };
    let (axis, up) = (Axis::Z, Axis::Y);
    let sag = forms::Sag { axis, up, start_mm: 400.0, length_mm: 700.0, tool: true, lever: None };
    let ram =
        forms::Ram { axis, up, start_mm: 700.0, reach_mm: 700.0, lever: nose, moment: false, beam: false };
    for (shape, values) in [(Shape::Sag(sag), vec![60.0, -40.0]), (Shape::Ram(ram), vec![50.0, 12.0])] {
        let valid = ["x_mm", "y_mm", "z_mm"].map(|c| (c.to_owned(), [0.0, 400.0])).into();
        let entry = Entry { values, valid, ..entry(effect, "z", shape) };
        let addition = Addition {
            format: FORMAT.to_owned(),
            machine: "m".to_owned(),
            sense: String::new(),
            base: None,
            effects: vec![entry],
        };
        let extended = extend(&spec, &[], &addition).unwrap();
        let mut symbols = extended.fates[0].1.symbols();
        symbols.sort();
        assert_eq!(symbols, ["EAZ", "EYZ"], "{:?}", extended.fates);
    }
}

#[test]
fn gravity_pulls_against_z_unless_the_model_says_or_its_table_shows_otherwise() {
    let of = |chain: &str, travel: f64, vertical| {
        let mut spec = ModelSpec::new("m", Chain::parse(chain).unwrap());
        spec.vertical = vertical;
        spec.axes = spec.chain.axes().iter().map(|a| AxisSpec::new(a.name)).collect();
        spec.axes.iter_mut().for_each(|a| a.travel = Some([0.0, travel]));
        let machine = machine_of(&spec, &Model::new(&spec).unwrap());
        machine.up()
    };
    assert_eq!(of("[w b X Y Z t]", 7.0, None), Axis::Z);
    assert_eq!(of("[w B' X' b Y Z t]", 7.0, None), Axis::Y);
    // a swivel, a table on a swivel, a head, a rotary attachment on an upright machine
    assert_eq!(of("[w B' X' b Y Z t]", 3.0, None), Axis::Z);
    assert_eq!(of("[w C' B' X' b Y Z t]", 7.0, None), Axis::Z);
    assert_eq!(of("[w b X Y Z B t]", 7.0, None), Axis::Z);
    assert_eq!(of("[w B' X' b Y Z t]", 7.0, Some(Axis::Z.name())), Axis::Z);
    assert_eq!(of("[w b X Y Z t]", 7.0, Some(Axis::Y.name())), Axis::Y);
}

#[test]
fn the_symbol_of_a_pair_is_the_rotation_of_its_later_axis_against_the_first() {
    const ANGLE: f64 = 1e-3;
    let unit = |axis: usize| Vec3::from_fn(|k, _| f64::from(u8::from(k == axis)));
    // first and later axis, and the axis about which the symbol turns
    for (pair, symbol, [first, later, about]) in
        [("xy", "EC0Y", [0, 1, 2]), ("yz", "EA0Z", [1, 2, 0]), ("zx", "EB0Z", [0, 2, 1])]
    {
        let (named, sign) = super::squareness_symbol(pair).unwrap();
        assert_eq!(named, symbol);
        for (along, over) in [(first, later), (later, first)] {
            let tilted = |axis: usize| {
                let mut v = unit(axis);
                if axis == over {
                    v[along] += ANGLE;
                }
                v
            };
            let (a, b) = (tilted(first), tilted(later));
            let turned = a.cross(&b).dot(&unit(about)).atan2(a.dot(&b));
            let nominal = unit(first).cross(&unit(later)).dot(&unit(about)).atan2(0.0);
            assert!((turned - nominal - sign * ANGLE).abs() < 1e-9, "{pair} along {along}");
        }
    }
}

#[test]
fn tables_of_a_process_hold_every_value_of_their_targets_and_those_from_a_line_no_slope() {
    let targets = vec![0.0, 10.0, 25.0, 31.0, 60.0, 75.0];
    let data = Data { tested: core::array::from_fn(|_| [(); 3].map(|()| targets.clone())), ..all_data() };
    let positioning = EFFECTS.iter().find(|e| e.name == "positioning").unwrap();
    let subject = positioning.subjects.all().into_iter().find(|s| s.axis == Axis::X).unwrap();
    let shapes = (positioning.variants)(&data, &subject).unwrap();
    let tables: Vec<&forms::PitchTable> = shapes
        .iter()
        .filter_map(|s| if let Shape::PitchTable(table) = s { Some(table) } else { None })
        .collect();
    assert_eq!(tables.len(), 4);
    for table in tables {
        let at = |x: f64| {
            let mut m = MachineState::default();
            m.position[0] = x;
            evaluated(&Shape::from(table.clone()), &m).iter().map(|d| d.x).collect::<Vec<f64>>()
        };
        let rows: Vec<Vec<f64>> = table.targets_mm.iter().map(|x| at(*x)).collect();
        let width = rows[0].len();
        assert_eq!(width, if table.process.is_from_line() { 4 } else { 5 }, "{:?}", table.process);
        for k in 0..width {
            let sum: f64 = rows.iter().map(|r| r[k]).sum();
            let slope: f64 = rows.iter().zip(&table.targets_mm).map(|(r, x)| r[k] * x).sum();
            assert!(sum.abs() < 1e-12, "{:?} {k}: {sum}", table.process);
            assert!(!table.process.is_from_line() || slope.abs() < 1e-10, "{:?} {k}: {slope}", table.process);
        }
        let a = nalgebra::DMatrix::from_fn(6, width, |i, k| rows[i][k]);
        assert_eq!(a.rank(1e-9), width);
        // straight lines between, held beyond
        let middle: Vec<f64> = rows[1].iter().zip(&rows[2]).map(|(a, b)| 0.5 * (a + b)).collect();
        assert!(at(17.5).iter().zip(&middle).all(|(a, b)| (a - b).abs() < 1e-12));
        assert_eq!(at(90.0), rows[5]);
    }
}

#[test]
fn play_that_every_reading_has_crossed_is_a_step() {
    let backlash = EFFECTS.iter().find(|e| e.name == "backlash").unwrap();
    let subject = backlash.subjects.all().into_iter().find(|s| s.axis == Axis::X).unwrap();
    let plays = |nearest: f64| -> Vec<f64> {
        let data = Data { nearest: [nearest; SLOTS], ..all_data() };
        let shapes = (backlash.variants)(&data, &subject).unwrap();
        let play = |s: &Shape| if let Shape::Backlash(b) = s { b.play.then_some(b.length_mm) } else { None };
        shapes.iter().filter_map(play).collect()
    };
    assert_eq!(plays(0.0).len(), 16);
    assert_eq!(plays(0.05), [0.07, 0.1]);
    assert!(plays(0.2).is_empty());
}
