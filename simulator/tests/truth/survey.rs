//! A survey of a machine is a complete model of it: its rows, put into equations 2.1 (`docs/reference/equations.md`) as
//! they are printed there, give the deviations that the exact machine has.
#![expect(clippy::unwrap_used, reason = "a failure here is a failed test")]

use proptest::prelude::*;
use simulator::instruments::survey::{AxisSurvey, Survey, SurveyPlan};
use simulator::truth::kinematics::{Joint, JointState, Kinematics, Squareness};
use simulator::truth::{GANTRY_5AX, GRINDER_AB, TruthMachine, VMC_850};
use volcomp::model::axes::{AxisArray, AxisKind, MAX_AXES};
use volcomp::model::units::{mm_from_um, rad_from_arcsec, rad_from_deg};

const NO_NOISE: SurveyPlan =
    SurveyPlan { step_mm: 5.0, step_deg: 2.0, noise_um: 0.0, noise_arcsec: 0.0, seed: 1, reference_mm: None };

/// EX EY EZ in mm, EA EB EC in rad, between rows joined by straight lines.
fn motion(survey: &AxisSurvey, position: f64) -> [f64; 6] {
    let rows = &survey.rows;
    let right = rows.partition_point(|r| r.position < position).clamp(1, rows.len() - 1);
    let (a, b) = (rows[right - 1], rows[right]);
    let t = (position - a.position) / (b.position - a.position);
    let mix = |a: f64, b: f64| a + t * (b - a);
    std::array::from_fn(|i| {
        if i < 3 {
            mm_from_um(mix(a.shift_um[i], b.shift_um[i]))
        } else {
            rad_from_arcsec(mix(a.tilt_arcsec[i - 3], b.tilt_arcsec[i - 3]))
        }
    })
}

/// Equations 2.1: levers by machine type, reference points subtracted component-wise.
fn first_order(kind: &str, survey: &Survey, q: [f64; 3], tip_home: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = q;
    let levers: [[f64; 3]; 3] = match kind {
        "TXYZ" => [[0., y, z], [0., 0., z], [0.; 3]],
        "XTYZ" => [[x, y, z], [0., 0., z], [0.; 3]],
        "XYTZ" => [[x, y, z], [0., y, z], [0.; 3]],
        "XYZT" => [[x, y, z], [0., y, z], [0., 0., z]],
        _ => panic!("a type of equations 2.1"),
    };
    let mut e = [0.0; 3];
    for (k, lever) in levers.iter().enumerate() {
        let axis = &survey.axes[k];
        let m = motion(axis, q[k]);
        let [a, b, c] = [m[3], m[4], m[5]];
        for i in 0..3 {
            let l: [f64; 3] = std::array::from_fn(|j| tip_home[j] + lever[j] - axis.reference_mm[i][j]);
            let cross = [b * l[2] - c * l[1], c * l[0] - a * l[2], a * l[1] - b * l[0]];
            e[i] += m[i] + cross[i];
        }
    }
    let [c0y, b0z, a0z] = [survey.ec0y_arcsec, survey.eb0z_arcsec, survey.ea0z_arcsec].map(rad_from_arcsec);
    [e[0] - c0y * y + b0z * z, e[1] - a0z * z, e[2]]
}

fn volume(machine: &TruthMachine, steps: i32) -> Vec<[f64; 3]> {
    let at = |k: usize, i: i32| {
        let [low, high] = machine.travel(k);
        low + (high - low) * f64::from(i) / f64::from(steps)
    };
    let range = || 0..=steps;
    range()
        .flat_map(|i| range().flat_map(move |j| range().map(move |k| (i, j, k))))
        .map(|(i, j, k)| [at(0, i), at(1, j), at(2, k)])
        .collect()
}

/// Largest distance between the survey's prediction and the machine over the volume, um.
fn worst_um(kind: &str, machine: &TruthMachine, plan: &SurveyPlan) -> f64 {
    let survey = Survey::of(machine, plan).unwrap();
    volume(machine, 10)
        .into_iter()
        .map(|q| {
            let pose = AxisArray::from([q[0], q[1], q[2], 0., 0., 0., 0., 0.]);
            let truth = machine.deviation(&pose, &[0; MAX_AXES]).tip_mm;
            let model = first_order(kind, &survey, q, machine.tool_tip_mm());
            (0..3).map(|i| (truth[i] - model[i]).powi(2)).sum::<f64>().sqrt() * 1e3
        })
        .fold(0.0, f64::max)
}

fn vmc(chain: &str) -> TruthMachine {
    TruthMachine::from_toml(&VMC_850.replace("\"[w X' Y' b Z t]\"", &format!("\"{chain}\""))).unwrap()
}

#[test]
fn the_model_from_a_survey_is_the_machine_for_every_three_axis_chain() {
    for (kind, chain) in [
        ("TXYZ", "[w b X Y Z t]"),
        ("XTYZ", "[w X' b Y Z t]"),
        ("XYTZ", "[w X' Y' b Z t]"),
        ("XYZT", "[w X' Y' Z' b t]"),
    ] {
        let worst = worst_um(kind, &vmc(chain), &NO_NOISE);
        assert!(worst < 0.1, "{chain}: {worst} um");
    }
}

#[test]
fn a_machine_in_the_carriage_sense_is_surveyed_in_the_relative_sense() {
    let text = VMC_850
        .replace("sense = \"relative\"", "sense = \"carriage\"")
        .replace("name = \"Y\"", "name = \"Y\"\nsense = \"carriage\"");
    let machine = TruthMachine::from_toml(&text).unwrap();
    assert!(worst_um("XYTZ", &machine, &NO_NOISE) < 0.1);
    let differs = machine.deviation(&[850., 500., 0., 0., 0., 0., 0., 0.], &[0; MAX_AXES]);
    let relative = vmc("[w X' Y' b Z t]").deviation(&[850., 500., 0., 0., 0., 0., 0., 0.], &[0; MAX_AXES]);
    assert!((differs.tip_mm[0] - relative.tip_mm[0]).abs() > 0.005, "the sense must matter");
}

#[test]
fn the_default_survey_predicts_the_default_machine_to_its_noise() {
    let machine = vmc("[w X' Y' b Z t]");
    let worst = worst_um("XYTZ", &machine, &SurveyPlan::default());
    assert!(worst < 3.0, "{worst} um");
    assert!(worst > 0.1, "a survey with noise cannot be this good: {worst} um");
}

#[test]
fn squareness_is_found_as_the_file_has_it() {
    let survey = Survey::of(&vmc("[w X' Y' b Z t]"), &NO_NOISE).unwrap();
    let found = [survey.ec0y_arcsec, survey.eb0z_arcsec, survey.ea0z_arcsec];
    for (found, true_value) in found.iter().zip([-11.0, 9.0, -8.0]) {
        assert!((found - true_value).abs() < 2e-3, "{found} for {true_value}");
    }
}

#[test]
fn one_reference_point_for_all_differs_by_a_rigid_rotation_only() {
    let machine = vmc("[w X' Y' b Z t]");
    let survey = Survey::of(&machine, &SurveyPlan { reference_mm: Some([0.0; 3]), ..NO_NOISE }).unwrap();
    let points = volume(&machine, 5);
    let difference = |q: &[f64; 3]| -> [f64; 3] {
        let pose = AxisArray::from([q[0], q[1], q[2], 0., 0., 0., 0., 0.]);
        let truth = machine.deviation(&pose, &[0; MAX_AXES]).tip_mm;
        let model = first_order("XYTZ", &survey, *q, machine.tool_tip_mm());
        std::array::from_fn(|i| truth[i] - model[i])
    };
    // w x p read off three corners, then checked everywhere.
    let along = |q: [f64; 3]| difference(&q);
    let (on_x, on_y, on_z) = (along([850., 0., 0.]), along([0., 500., 0.]), along([0., 0., -500.]));
    let w = [on_y[2] / 500.0, on_z[0] / -500.0, on_x[1] / 850.0];
    for q in &points {
        let d = difference(q);
        let turned = [w[1] * q[2] - w[2] * q[1], w[2] * q[0] - w[0] * q[2], w[0] * q[1] - w[1] * q[0]];
        for i in 0..3 {
            assert!((d[i] - turned[i]).abs() < 1e-4, "{q:?}: {d:?} instead of {turned:?}");
        }
    }
}

/// The survey as a machine of its own, deviations over poses compared: position um, direction arcsec.
fn rebuilt_misses_by(machine: &TruthMachine, poses: &[AxisArray]) -> [f64; 2] {
    let survey = Survey::of(machine, &SurveyPlan { step_mm: 10.0, ..NO_NOISE }).unwrap();
    let links = machine.chain().links();
    let order: Vec<usize> = links.iter().filter_map(|l| machine.index_of(l.axis)).collect();
    let joints = order
        .iter()
        .map(|k| {
            let axis = &survey.axes[*k];
            let [x, y, z, a, b, c] = axis.location_um_arcsec;
            let location = [
                mm_from_um(x),
                mm_from_um(y),
                mm_from_um(z),
                rad_from_arcsec(a),
                rad_from_arcsec(b),
                rad_from_arcsec(c),
            ];
            Joint { location, reference_mm: axis.reference_mm, ..machine.drawing(*k).unwrap() }
        })
        .collect();
    let kinematics = Kinematics {
        joints,
        squareness: Squareness {
            c0y_rad: rad_from_arcsec(survey.ec0y_arcsec),
            b0z_rad: rad_from_arcsec(survey.eb0z_arcsec),
            a0z_rad: rad_from_arcsec(survey.ea0z_arcsec),
        },
        workpiece_origin_mm: machine.workpiece_origin_mm(),
        tool_tip_mm: machine.tool_tip_mm(),
    };
    let mut worst = [0.0_f64; 2];
    for pose in poses {
        let states: Vec<JointState> = order
            .iter()
            .map(|k| {
                let axis = &survey.axes[*k];
                let q = if axis.axis.kind() == AxisKind::Rotary { rad_from_deg(pose[*k]) } else { pose[*k] };
                JointState { q, motion: motion(axis, pose[*k]) }
            })
            .collect();
        let gap = machine.pose(pose, &[0; MAX_AXES]).minus(&kinematics.pose(&states));
        let norm = |v: [f64; 3]| v.iter().map(|c| c * c).sum::<f64>().sqrt();
        worst[0] = worst[0].max(norm(gap.tip_mm) * 1e3);
        worst[1] = worst[1].max(norm(gap.rotation_rad) / rad_from_arcsec(1.0));
    }
    worst
}

fn random_poses(machine: &TruthMachine, count: u32) -> Vec<AxisArray> {
    // A low-discrepancy walk through the travels; no generator needed.
    (1..=count)
        .map(|n| {
            let mut pose = AxisArray::default();
            for (k, value) in pose.iter_mut().enumerate().take(machine.axes().len()) {
                let [low, high] = machine.travel(k);
                let share =
                    (f64::from(n) * [0.618_034, 0.754_878, 0.569_840, 0.819_173, 0.671_044][k]).fract();
                *value = low + share * (high - low);
            }
            pose
        })
        .collect()
}

#[test]
fn a_survey_of_the_machines_with_rotary_axes_predicts_them() {
    for (text, limits) in [(GANTRY_5AX, [2.0, 1.0]), (GRINDER_AB, [2.0, 1.0])] {
        let machine = TruthMachine::from_toml(text).unwrap();
        let poses = random_poses(&machine, 200);
        let size = poses.iter().fold(0.0_f64, |size, pose| {
            let d = machine.deviation(pose, &[0; MAX_AXES]).tip_mm;
            size.max(d.iter().map(|c| c * c).sum::<f64>().sqrt() * 1e3)
        });
        let misses = rebuilt_misses_by(&machine, &poses);
        println!("{}: errors to {size:.1} um, survey misses {misses:?}", machine.machine());
        assert!(size > 20.0);
        assert!(misses[0] < limits[0] && misses[1] < limits[1], "{}: {misses:?}", machine.machine());
    }
}

#[test]
fn tables_have_the_columns_of_the_contract() {
    let survey = Survey::of(&vmc("[w X' Y' b Z t]"), &SurveyPlan::default()).unwrap();
    let csv = survey.axes[1].csv();
    let mut lines = csv.lines();
    assert_eq!(lines.next(), Some("position_mm,exy_um,eyy_um,ezy_um,eay_arcsec,eby_arcsec,ecy_arcsec"));
    assert_eq!(lines.clone().count(), 21);
    assert!(
        lines.all(|line| line.split(',').count() == 7 && line.split(',').all(|n| n.parse::<f64>().is_ok()))
    );
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn any_tool_and_workpiece_offset_is_surveyed_alike(
        tip in prop::array::uniform3(-300.0..300.0f64),
        origin in prop::array::uniform3(-300.0..300.0f64),
    ) {
        let text = VMC_850
            .replace("tool-tip-mm = [0, 0, -120]", &format!("tool-tip-mm = {tip:?}"))
            .replace("workpiece-origin-mm = [0, 0, -620]", &format!("workpiece-origin-mm = {origin:?}"));
        let machine = TruthMachine::from_toml(&text).unwrap();
        prop_assert_eq!(machine.tool_tip_mm(), tip);
        let worst = worst_um("XYTZ", &machine, &NO_NOISE);
        prop_assert!(worst < 0.1, "{} um", worst);
    }
}
