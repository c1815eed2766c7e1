use nalgebra::{Matrix3, Matrix4, Rotation3, Translation3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use volcomp_model::{AxisSpec, Chain as KinematicChain, Model, Pose};
use volcomp_units::axes::AxisName::{A, B, X, Y};
use volcomp_units::axes::MAX_AXES;

const CHAIN: &str = "[w A' b X Y B t]";
const W0: [f64; 3] = [40.0, 0.0, 0.0];
const T0: [f64; 3] = [45.0, 80.0, 0.0];
const P_B: [f64; 3] = [180.0, 80.0, 60.0];

fn shift(v: [f64; 3]) -> Matrix4<f64> {
    Translation3::new(v[0], v[1], v[2]).to_homogeneous()
}

fn turn(axis: usize, angle: f64) -> Matrix4<f64> {
    let mut about = nalgebra::Vector3::zeros();
    about[axis] = angle;
    Rotation3::new(about).to_homogeneous()
}

/// Covariance of the predicted position of the tip in W, mm^2, from every step of the chain.
fn covariance_at(chain: &Chain, position: &AxisArray, tip: Vec3) -> Matrix3<f64> {
    let row = Row { position: *position, correction: [0.0; 8], tip, deviation: [None; 3] };
    let symbols = |found: &Found| found.motions.iter().map(|m| m.symbol).collect::<Vec<_>>();
    let effects: Vec<_> = chain
        .steps
        .iter()
        .map(|found| effects::Effects::new(&chain.spec, &symbols(found)).unwrap())
        .collect();
    let columns = effects::of_found(&chain.spec, &chain.steps, &effects, &row);
    let found = &columns * &chain.covariance * columns.transpose();
    Matrix3::from_fn(|i, j| found[(i, j)])
}

/// A small motion: Rz Ry Rx, then the shift.
fn motion(e: [f64; 6]) -> Matrix4<f64> {
    shift([e[0], e[1], e[2]]) * turn(2, e[5]) * turn(1, e[4]) * turn(0, e[3])
}

fn about(p: [f64; 3], m: Matrix4<f64>) -> Matrix4<f64> {
    shift(p) * m * shift(p.map(|v| -v))
}

/// Error motions of axis `k` (A X Y B) at its coordinate: up to 5 um and 25 urad, zero at home.
fn truth(k: usize, q: f64) -> [f64; 6] {
    let x = if k == 1 || k == 2 { q / 100.0 } else { q };
    core::array::from_fn(|i| {
        let (phase, rate) = (0.7 * (i + 2 * k) as f64, 1.0 + 0.3 * i as f64);
        let value = (rate * x + phase).sin() - phase.sin();
        value * if i < 3 { 2.5e-3 } else { 12e-6 }
    })
}

const AT_A: [f64; 6] = [0.0, 0.004, -0.006, 0.0, 24e-6, -20e-6];
const AT_B: [f64; 6] = [0.009, 0.0, -0.007, 20e-6, 0.0, 15e-6];

/// The machine by full rotations, equations 2 and `docs/reference/cases.md`: place of the tip in W.
fn place(with_errors: bool, q: &AxisArray, tip: Vec3) -> Vec3 {
    let s = if with_errors { 1.0 } else { 0.0 };
    let e = |k: usize, at: f64| motion(truth(k, at).map(|v| s * v));
    let [a, x, y, b] = [q[0], q[1], q[2], q[3]];
    let location = |l: [f64; 6]| motion(l.map(|v| s * v));
    let ja = turn(0, a) * e(0, a) * location(AT_A).try_inverse().unwrap();
    let jx = shift([x, 0.0, 0.0]) * e(1, x);
    let jy = shift([0.0, y, 0.0]) * e(2, y);
    let jb = about(P_B, location(AT_B) * e(3, b) * turn(1, b));
    let all = shift(W0.map(|v| -v)) * ja * jx * jy * jb;
    all.transform_point(&nalgebra::Point3::from(tip)).coords
}

/// A deviation in the workpiece frame that lies where the tips show it at home: its place there, and its turn, are
/// taken out, as setting up a workpiece does.
fn aligned(at: impl Fn(&AxisArray, Vec3) -> Vec3, q: &AxisArray, tip: Vec3) -> Vec3 {
    const FAR: f64 = 1000.0;
    let home = [0.0; MAX_AXES];
    let first = Vec3::from(T0);
    let from_first = |d: Vec3| (at(&home, first + d * FAR) - at(&home, first)) / FAR;
    let [x, y] = [from_first(Vec3::x()), from_first(Vec3::y())];
    let turn = Vec3::new(y.z, -x.z, x.y);
    let lever = place(false, q, tip) - place(false, &home, first);
    at(q, tip) - at(&home, first) - turn.cross(&lever)
}

fn true_deviation(q: &AxisArray, tip: Vec3) -> Vec3 {
    aligned(|q, tip| place(true, q, tip) - place(false, q, tip), q, tip)
}

fn predicted_deviation(spec: &ModelSpec, q: &AxisArray, tip: Vec3) -> Vec3 {
    let model = Model::new(spec).unwrap();
    let at = |q: &AxisArray, tip| model.deviation(&Pose { tool_tip: Some(tip), ..Pose::at(*q) }).position;
    aligned(at, q, tip)
}

fn drawing() -> ModelSpec {
    let mut spec = ModelSpec::new("grinder", KinematicChain::parse(CHAIN).unwrap());
    spec.workpiece_origin = Vec3::from(W0);
    spec.tool_tip = Vec3::from(T0);
    for (name, travel) in [(A, [-3.0, 3.0]), (X, [-50.0, 350.0]), (Y, [-120.0, 180.0]), (B, [-1.0, 1.0])] {
        let mut axis = AxisSpec::new(name);
        axis.travel = Some(travel);
        if name == B {
            axis.point = Vec3::from(P_B);
        }
        spec.axes.push(axis);
    }
    spec
}

/// Measures a plan on the machine with the corrections of `spec` in force, the artefact lying askew.
fn measure(spec: &ModelSpec, planned: &[Planned], noise: f64, random: &mut ChaCha8Rng) -> Vec<Row> {
    let model = Model::new(spec).unwrap();
    let lying = motion([0.013, -0.021, 0.008, 5e-5, -8e-5, 3e-5]);
    let one = |p: &Planned| {
        let pose = Pose { tool_tip: Some(p.tip), ..Pose::at(p.position) };
        let correction = model.correct(&pose).1.offset;
        let commanded = core::array::from_fn(|k| p.position[k] + correction[k]);
        let seen = lying.transform_point(&nalgebra::Point3::from(place(true, &commanded, p.tip))).coords;
        let deviation = seen - place(false, &p.position, p.tip);
        let noisy = |i: usize, random: &mut ChaCha8Rng| {
            let unit: f64 = StandardNormal.sample(random);
            Some(deviation[i] + noise * unit)
        };
        let deviation = core::array::from_fn(|i| noisy(i, random));
        Row { position: p.position, correction, tip: p.tip, deviation }
    };
    planned.iter().map(one).collect()
}

fn identified(positions: usize, noise: f64, seed: u64) -> Chain {
    identified_axes(&[A, B, X, Y], positions, noise, seed)
}

fn identified_axes(axes: &[AxisName], positions: usize, noise: f64, seed: u64) -> Chain {
    identified_with(&Request::default(), axes, positions, noise, seed)
}

fn identified_with(request: &Request, axes: &[AxisName], positions: usize, noise: f64, seed: u64) -> Chain {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut chain = Chain::new(drawing());
    for &axis in axes {
        let planned = plan(&chain, axis, positions, 60.0).unwrap();
        let rows = measure(chain.spec(), &planned, noise, &mut random);
        chain.identify(&Measured { axis, rows }, request).unwrap();
    }
    chain
}

/// Poses at measured positions of all axes.
fn poses(chain: &Chain) -> Vec<AxisArray> {
    let spec = chain.spec();
    (0..20)
        .map(|i| {
            let mut q = [0.0; MAX_AXES];
            for (j, step) in chain.steps().iter().enumerate() {
                let k = spec.chain.index_of(step.axis).unwrap();
                q[k] = step.positions[(i * (j + 2) + j) % step.positions.len()];
            }
            q
        })
        .collect()
}

#[test]
fn four_steps_without_noise_give_the_machine_back() {
    let chain = identified(7, 0.0, 1);
    let mut before = 0.0f64;
    for q in poses(&chain) {
        for tip in [Vec3::from(T0), Vec3::from([10.0, 120.0, -40.0])] {
            let truth = true_deviation(&q, tip);
            let off = (predicted_deviation(chain.spec(), &q, tip) - truth).norm();
            before = before.max(truth.norm());
            assert!(off < 5e-5, "{q:?}: {off} of {}", truth.norm());
        }
    }
    assert!(before > 0.01, "the machine must have errors worth finding: {before}");
    for step in chain.steps() {
        assert_eq!(step.set_up, SetUp::Rigid);
        assert!(step.rms < 2e-5, "{}: {}", step.axis, step.rms);
        assert!(step.condition < 20.0, "{}", step.condition);
        for m in &step.motions {
            assert_eq!(m.values[step.reference], 0.0);
        }
    }
}

#[test]
fn a_step_of_the_wrong_sign_is_found_and_its_uncertainties_are_enlarged() {
    let request = Request { sigma: Some(3e-4), ..Request::default() };
    let run = |sign: f64| {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let mut chain = Chain::new(drawing());
        // the machine is corrected by the honest chain, the rows of A are read with a sign of their own
        let mut honest = Chain::new(drawing());
        for axis in [A, B, X] {
            let planned = plan(&honest, axis, 9, 60.0).unwrap();
            let rows = measure(honest.spec(), &planned, 3e-4, &mut random);
            honest.identify(&Measured { axis, rows: rows.clone() }, &request).unwrap();
            let sign = if axis == A { sign } else { 1.0 };
            let read = |r: &Row| Row { deviation: r.deviation.map(|d| d.map(|v| sign * v)), ..*r };
            let rows = rows.iter().map(read).collect();
            chain.identify(&Measured { axis, rows }, &request).unwrap();
        }
        chain
    };
    let (right, wrong) = (run(1.0), run(-1.0));
    let test = |chain: &Chain, step: usize| chain.steps()[step].consistency.unwrap();
    assert!((0..3).all(|i| test(&right, i).enlarged == 1.0), "{:?}", right.steps()[1].consistency);
    let failed = test(&wrong, 1);
    assert!(failed.p_value < 1e-6 && failed.enlarged > 3.0, "{failed:?}");
    let worst = wrong.steps()[1].worst;
    assert!(worst.residual.abs() > 5.0 * 3e-4, "{worst:?}");
    // the step and the axis before it, in the report, in the model and in the covariance
    for step in [0, 1] {
        let std = |chain: &Chain| {
            let motion = &chain.steps()[step].motions[0];
            let (_, function) = chain.spec().errors.iter().find(|(s, _)| *s == motion.symbol).unwrap();
            (motion.std[0].total(), function.std.unwrap())
        };
        let ((before, of_model), (after, of_model_after)) = (std(&right), std(&wrong));
        assert!(after > 2.5 * before && of_model_after > 2.5 * of_model, "{step}: {before} {after}");
    }
    let spread = |chain: &Chain| covariance_at(chain, &poses(chain)[3], Vec3::from(T0)).trace().sqrt();
    assert!(spread(&wrong) > 2.5 * spread(&right));
}

#[test]
fn intervals_of_the_whole_chain_hold_the_truth_at_their_rate() {
    const SEEDS: u64 = 2000;
    let at = {
        let chain = identified_axes(&[A, B, X], 3, 1e-3, 0);
        poses(&chain)[7]
    };
    let tip = Vec3::from(T0);
    let truth = true_deviation(&at, tip);
    let mut inside = [0u32; 3];
    for seed in 0..SEEDS {
        let chain = identified_axes(&[A, B, X], 3, 1e-3, seed);
        let covariance = covariance_at(&chain, &at, tip);
        let off = predicted_deviation(chain.spec(), &at, tip) - truth;
        for i in 0..3 {
            inside[i] += u32::from(off[i].abs() < 1.96 * covariance[(i, i)].sqrt());
        }
    }
    for count in inside {
        assert!((1860..=1940).contains(&count), "{inside:?}");
    }
}

#[test]
fn uncertainty_grows_from_step_to_step() {
    let chain = identified(7, 1e-3, 5);
    let steps = chain.steps();
    assert_eq!(steps[0].tip.inherited, 0.0);
    for pair in steps.windows(2) {
        assert!(pair[1].tip.inherited > 0.0);
        assert!(pair[1].chain > pair[0].chain, "{} {}", pair[0].chain, pair[1].chain);
    }
    for step in steps {
        assert!((0.9e-3..1.1e-3).contains(&step.sigma.unwrap()), "{:?}", step.sigma);
        assert!((0.5..2.0).contains(&(step.rms / step.expected_rms.unwrap())), "{step:?}");
        assert!(step.tip.total() >= step.tip.own);
    }
}

#[test]
fn fitted_curves_average_the_noise_of_the_positions() {
    let fitted = Request { curves: Curves::Fitted, ..Request::default() };
    let rms = |request: &Request, noise: f64| {
        let mut sum = 0.0;
        for seed in 0..4 {
            let chain = identified_with(request, &[B, X, Y], 25, noise, seed);
            for q in poses(&chain) {
                let tip = Vec3::from(T0);
                let off = predicted_deviation(chain.spec(), &q, tip) - true_deviation(&q, tip);
                sum += off.norm_squared() / 80.0;
            }
        }
        sum.sqrt()
    };
    assert!(rms(&fitted, 0.0) < 1e-4, "{}", rms(&fitted, 0.0));
    let [lines, curves] = [Request::default(), fitted].map(|r| rms(&r, 1e-3));
    assert!(curves < 0.7 * lines, "{curves} {lines}");
}

#[test]
fn what_is_not_corrected_on_the_machine_is_taken_out_by_calculation() {
    // the axes before are corrected wrongly by 30 um and 20 urad: the rows say so, the result stays
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut chain = Chain::new(drawing());
    for axis in [A, B, X, Y] {
        let planned = plan(&chain, axis, 5, 60.0).unwrap();
        let mut rows = measure(chain.spec(), &planned, 0.0, &mut random);
        for row in &mut rows {
            let before = row.correction;
            row.correction = [20e-6, 0.03, -0.02, -15e-6, 0.0, 0.0, 0.0, 0.0];
            let at = |c: &AxisArray| {
                let commanded = core::array::from_fn(|k| row.position[k] + c[k]);
                place(true, &commanded, row.tip)
            };
            let moved = at(&row.correction) - at(&before);
            row.deviation = core::array::from_fn(|i| row.deviation[i].map(|d| d + moved[i]));
        }
        chain.identify(&Measured { axis, rows }, &Request::default()).unwrap();
    }
    for q in poses(&chain) {
        let tip = Vec3::from(T0);
        let off = (predicted_deviation(chain.spec(), &q, tip) - true_deviation(&q, tip)).norm();
        assert!(off < 2e-4, "{q:?}: {off}");
    }
}

#[test]
fn the_carriage_sense_is_kept() {
    let mut chain = Chain::new(drawing());
    chain.spec.axes[0].sense = volcomp_model::Sense::Carriage;
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let planned = plan(&chain, A, 9, 60.0).unwrap();
    let rows = measure(chain.spec(), &planned, 0.0, &mut random);
    chain.identify(&Measured { axis: A, rows }, &Request::default()).unwrap();
    for a in chain.steps()[0].positions.clone() {
        let mut q = [0.0; MAX_AXES];
        q[0] = a;
        let tip = Vec3::from(T0);
        let off = (predicted_deviation(chain.spec(), &q, tip) - true_deviation(&q, tip)).norm();
        assert!(off < 5e-5, "{a}: {off}");
    }
}

#[test]
fn one_value_per_position_gives_one_motion_and_no_more() {
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let mut chain = Chain::new(drawing());
    let planned: Vec<Planned> =
        plan(&chain, X, 9, 60.0).unwrap().into_iter().filter(|p| p.tip == Vec3::from(T0)).collect();
    let mut rows = measure(chain.spec(), &planned, 0.0, &mut random);
    for row in &mut rows {
        row.deviation[1] = None;
        row.deviation[2] = None;
    }
    let measured = Measured { axis: X, rows };
    let all = chain.identify(&measured, &Request::default()).unwrap_err();
    assert!(matches!(all, GrinderError::Undetermined { rank: 1, unknowns: 6, .. }), "{all}");
    let one = Request { components: vec![Component::X], ..Request::default() };
    let found = chain.identify(&measured, &one).unwrap();
    assert_eq!((found.set_up, found.motions.len()), (SetUp::ShiftOnly, 1));
    let last = found.positions.len() - 1;
    let mut q = [0.0; MAX_AXES];
    q[1] = found.positions[last];
    let seen = true_deviation(&q, Vec3::from(T0)).x;
    // the set-up of the artefact is askew by up to 80 urad, which this kind of measurement cannot know
    assert!((found.motions[0].values[last] - seen).abs() < 80e-6 * 120.0, "{seen}");
}

#[test]
fn what_cannot_be_identified_is_refused() {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let chain = Chain::new(drawing());
    let planned = plan(&chain, A, 5, 60.0).unwrap();
    let good = measure(chain.spec(), &planned, 0.0, &mut random);
    let refused = |axis, rows: Vec<Row>| {
        chain.clone().identify(&Measured { axis, rows }, &Request::default()).unwrap_err()
    };
    let mut early = good.clone();
    early[7].position[1] = 5.0;
    assert!(matches!(refused(A, early), GrinderError::MovesTooEarly { moving: X, .. }));
    let one_tip: Vec<Row> = good.iter().copied().filter(|r| r.tip == Vec3::from(T0)).collect();
    assert!(matches!(refused(A, one_tip), GrinderError::Undetermined { rank: 3, unknowns: 6, .. }));
    let on_a_line: Vec<Row> = good.iter().copied().filter(|r| r.tip.yz() == Vec3::from(T0).yz()).collect();
    assert!(matches!(refused(A, on_a_line), GrinderError::Undetermined { rank: 5, .. }));
    assert!(matches!(refused(AxisName::Z, good.clone()), GrinderError::NotInChain { .. }));
    let at_rest: Vec<Row> = good.iter().copied().filter(|r| r.position[0] == 0.0).collect();
    assert!(matches!(refused(A, at_rest), GrinderError::TooFewPositions { found: 1, .. }));
    assert!(matches!(refused(A, Vec::new()), GrinderError::TooFewPositions { found: 0, .. }));
    let mut twice = chain.clone();
    twice.identify(&Measured { axis: A, rows: good.clone() }, &Request::default()).unwrap();
    let again = twice.identify(&Measured { axis: A, rows: good }, &Request::default()).unwrap_err();
    assert_eq!(again, GrinderError::Twice { axis: A });
    assert!(matches!(plan(&twice, A, 5, 60.0), Err(GrinderError::Twice { .. })));
    let mut bare = drawing();
    bare.axes.clear();
    assert!(matches!(plan(&Chain::new(bare), A, 5, 60.0), Err(GrinderError::NoTravel { .. })));
}
