//! Live estimation against a ram that drifts, seed after seed: how much of the error on the path it takes away, that it
//! does no harm where nothing drifts, that its statistics hold, and that it finds the noise of the sensor.
//!
//! The machine is the simulator's (full transforms, own shapes), the estimator the daemon's own. The tracker has noise
//! whose stated size is wrong by five either way, of lengths and angles apart, outliers, dropouts, a delay nobody stated, a clock of its own, and
//! for a while a bias. Some 20 seeds run with all tests; the distribution over 500:
//!
//! `cargo test -p simulator --release --test loops -- --ignored live_monte_carlo --nocapture`

#![expect(clippy::unwrap_used, reason = "a test stops where its own set-up is wrong")]
#![allow(clippy::print_stdout, reason = "the distribution is what the long run is for")]

use std::sync::Arc;

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use simulator::truth::chain::Side;
use simulator::truth::drift::{DriftSize, RamDrift};
use simulator::truth::kinematics::{Joint, JointState, Kinematics, Pose, Squareness};
use volcomp::estimate::live::{
    Body, LiveEstimator, LiveModel, LiveSpec, MapSpec, MotionSample, Reading, Seen, SensorKind, SensorSpec,
    ToolReading,
};
use volcomp::model::axes::{AxisName, MAX_AXES};
use volcomp::model::curve::Live;
use volcomp::model::geometry::Vec3;
use volcomp::model::units::MonoTime;
use volcomp::model::{AxisSpec, Chain, ErrorFunction, ErrorSymbol, Model, ModelSpec};

const SYMBOLS: [&str; 6] = ["exz", "eyz", "ezz", "eaz", "ebz", "ecz"];
const HOUR_S: f64 = 3600.0;
/// Time between readings, s.
const STEP_S: f64 = 2.4;
/// True noise of the tracker: tip, direction.
const NOISE: [f64; 2] = [0.006, 2e-5];
/// C and A axes cross here, the tip is there.
const HEAD_Z: f64 = -180.0;
const TIP_Z: f64 = -500.0;

/// The machine as it is.
fn machine() -> Kinematics {
    let joint = |axis| Joint {
        point_mm: [0.0, 0.0, HEAD_Z],
        reference_mm: if axis == AxisName::C || axis == AxisName::A {
            [[0.0, 0.0, HEAD_Z]; 3]
        } else {
            [[0.0; 3]; 3]
        },
        ..Joint::plain(axis, Side::Tool)
    };
    Kinematics {
        joints: [AxisName::X, AxisName::Y, AxisName::Z, AxisName::C, AxisName::A].map(joint).to_vec(),
        squareness: Squareness::default(),
        workpiece_origin_mm: [0.0; 3],
        tool_tip_mm: [0.0, 0.0, TIP_Z],
    }
}

/// The model that knows nothing of the ram's drift.
fn model() -> (ModelSpec, Arc<Model>) {
    let mut spec = ModelSpec::new("gantry", Chain::parse("[w b X Y Z C A (S) t]").unwrap());
    spec.tool_tip = Vec3::new(0.0, 0.0, TIP_Z);
    for name in [AxisName::C, AxisName::A] {
        spec.axes.push(AxisSpec { point: Vec3::new(0.0, 0.0, HEAD_Z), ..AxisSpec::new(name) });
    }
    for (k, symbol) in SYMBOLS.iter().enumerate() {
        let limit = if k < 3 { 0.1 } else { 1e-4 };
        let live = vec![Live { sensor: format!("ram.{symbol}"), limit, reference: None }];
        spec.errors
            .push((ErrorSymbol::parse(symbol).unwrap(), ErrorFunction { live, ..ErrorFunction::default() }));
    }
    let model = Arc::new(Model::new(&spec).unwrap());
    (spec, model)
}

fn live_spec(stated: [f64; 2]) -> LiveSpec {
    let nodes = [vec![0.0, 1000.0, 2000.0, 3000.0], vec![0.0, 1000.0, 2000.0], vec![-1000.0, 0.0]];
    // what is known of such a ram: its errors go together over half of their shortest wave
    let map = MapSpec { limit: [0.1, 1e-4], correlation_mm: 2500.0, ..MapSpec::new("ram", nodes) };
    let sensor = SensorSpec {
        std_mm: stated[0] * NOISE[0],
        std_rad: stated[1] * NOISE[1],
        // all but 3 ms of it is known
        latency_s: 0.017,
        // a reading every few seconds
        age_limit_s: 60.0,
        range: [2.0, 2e-3],
        jump: [0.5, 1e-3],
        ..SensorSpec::new("tracker", SensorKind::Tool { map: 0 })
    };
    LiveSpec { sensors: vec![sensor], maps: vec![map] }
}

/// Where the axes are: a tour through the volume, the head moving.
fn position(t: f64) -> [f64; MAX_AXES] {
    [
        1500.0 + 1400.0 * (t / 67.0).sin(),
        1000.0 + 900.0 * (t / 47.0).sin(),
        -500.0 + 450.0 * (t / 29.0).cos(),
        2.0 * (t / 37.0).sin(),
        0.9 * (t / 23.0).cos(),
        0.0,
        0.0,
        0.0,
    ]
}

/// What is done to a run.
#[derive(Debug, Clone, Copy)]
struct Plan {
    seed: u64,
    drifts: bool,
    /// Stated noise over the true one: lengths, angles.
    stated: [f64; 2],
    /// Outliers, dropouts, a bias for five minutes.
    trouble: bool,
}

/// What came out of a run.
#[derive(Debug, Clone, Copy)]
struct Outcome {
    seed: u64,
    /// RMS error of the tip with the static model and with what was learned, over the last quarter, mm.
    before: f64,
    after: f64,
    nis: f64,
    /// Learned noise over the true one: lengths, angles.
    noise: [f64; 2],
    excluded: bool,
}

impl Outcome {
    fn reduction(&self) -> f64 {
        1.0 - self.after / self.before
    }
}

struct Run {
    plan: Plan,
    machine: Kinematics,
    drift: RamDrift,
    model: Arc<Model>,
    estimator: LiveEstimator,
    random: ChaCha8Rng,
}

impl Run {
    fn new(plan: Plan) -> Self {
        let per_h = if plan.drifts { [0.03, 3e-5] } else { [0.0; 2] };
        let size = DriftSize { from_survey: [0.002, 2e-6], per_h, wave_mm: 5000.0, ..DriftSize::default() };
        let (spec, model) = model();
        let estimator = LiveEstimator::new(
            &live_spec(plan.stated),
            LiveModel { spec: &spec, thermal: &[], model: Arc::clone(&model), hash: [0; 32] },
        )
        .unwrap();
        let random = ChaCha8Rng::seed_from_u64(plan.seed ^ 0x5EED);
        Self { machine: machine(), drift: RamDrift::new(size, plan.seed), model, estimator, random, plan }
    }

    fn pose(&self, t: f64, with_errors: bool) -> Pose {
        let q = position(t);
        let mut states: Vec<JointState> = (0..5).map(|k| JointState { q: q[k], motion: [0.0; 6] }).collect();
        if with_errors {
            states[2].motion = self.drift.motion([q[0], q[1], q[2]], t);
        }
        self.machine.pose(&states)
    }

    /// Error of the tip without and with what was learned, mm.
    fn errors(&self, t: f64) -> [f64; 2] {
        let truth = self.pose(t, true).minus(&self.pose(t, false)).tip_mm;
        let q = position(t);
        let mut pose = volcomp::model::Pose::at(q);
        for c in 0..6 {
            pose.live[c] = self.estimator.estimate(0, c, [q[0], q[1], q[2]]).unwrap()[2];
        }
        let known = self.model.deviation(&pose).position;
        [Vector3::from(truth).norm(), (Vector3::from(truth) - known).norm()]
    }

    fn normal(&mut self, std: f64) -> Vec3 {
        let mut draw = || -> f64 { StandardNormal.sample(&mut self.random) };
        Vec3::new(draw(), draw(), draw()) * std
    }

    fn even(&mut self) -> f64 {
        use rand::RngExt as _;
        self.random.random::<f64>()
    }

    fn read(&mut self, t: f64) {
        let now = |t: f64| MonoTime::from_ns((t * 1e9) as i64);
        for offset in [-0.03, -0.02, -0.01, 0.0, 0.01, 0.02] {
            let at = position(t + offset);
            let sample = MotionSample { at: now(t + offset), commanded: at, actual: at, tool_tip: None };
            self.estimator.on_motion(sample);
        }
        let (outlier, lost) = (self.even() < 0.02, self.even() < 0.05);
        let seen = self.pose(t, true);
        let mut tip = Vec3::from(seen.tip_mm) + self.normal(NOISE[0]);
        let direction = (Vec3::from(seen.direction) + self.normal(NOISE[1])).normalize();
        let biased = (0.45..0.53).contains(&(t / HOUR_S));
        if self.plan.trouble {
            if lost {
                self.estimator.tick(now(t + 0.02));
                return;
            }
            if outlier {
                tip += self.normal(0.15);
            }
            if biased {
                tip += Vec3::new(0.25, 0.0, 0.0);
            }
        }
        let body = Body::Tool(ToolReading {
            tip: Seen::Absolute(tip),
            direction: Some(Seen::Absolute(direction)),
            covariance: None,
        });
        let reading = Reading { stamp_ns: now(t + 1234.5).ns, quality: 1.0, body };
        self.estimator.on_reading(now(t + 0.02), 0, &reading);
        self.estimator.tick(now(t + 0.02));
    }

    fn go(mut self) -> Outcome {
        let mut squares = [0.0; 2];
        let mut excluded = false;
        let steps = (HOUR_S / STEP_S) as u32;
        for k in 1..=steps {
            let t = f64::from(k) * STEP_S;
            if k > steps * 3 / 4 {
                let [before, after] = self.errors(t);
                squares[0] += before * before;
                squares[1] += after * after;
            }
            self.read(t);
            let standing = self.estimator.sensor_statuses().next().unwrap().1;
            excluded |= matches!(standing, volcomp::estimate::SensorStatus::Excluded(_));
        }
        let health = self.estimator.health(MonoTime::from_ns((HOUR_S * 1e9) as i64));
        let sensor = &health.sensors[0];
        let n = f64::from(steps / 4);
        Outcome {
            seed: self.plan.seed,
            before: (squares[0] / n).sqrt(),
            after: (squares[1] / n).sqrt(),
            nis: sensor.nis.unwrap_or(f64::NAN),
            noise: sensor.noise_factor.map_or([f64::NAN; 2], |f| [0, 1].map(|k| f[k] * self.plan.stated[k])),
            excluded,
        }
    }
}

/// Every run of a plan, on both processors.
#[expect(clippy::disallowed_methods, reason = "runs on several threads")]
fn runs(seeds: std::ops::Range<u64>, plan: impl Fn(u64) -> Plan + Sync) -> Vec<Outcome> {
    let seeds: Vec<u64> = seeds.collect();
    let halves: Vec<&[u64]> = seeds.chunks(seeds.len().div_ceil(2)).collect();
    std::thread::scope(|scope| {
        let plan = &plan;
        let threads: Vec<_> = halves
            .into_iter()
            .map(|half| scope.spawn(move || half.iter().map(|s| Run::new(plan(*s)).go()).collect::<Vec<_>>()))
            .collect();
        threads.into_iter().flat_map(|t| t.join().unwrap()).collect()
    })
}

fn with_drift(seed: u64) -> Plan {
    // right, wrong by five either way, lengths one way and angles the other
    let stated = [[1.0; 2], [5.0; 2], [0.2; 2], [5.0, 0.2], [0.2, 5.0]];
    Plan { seed, drifts: true, stated: stated[(seed % 5) as usize], trouble: true }
}

fn without_drift(seed: u64) -> Plan {
    Plan { drifts: false, ..with_drift(seed) }
}

/// Smallest, 5 %, median, 95 %, largest.
fn quantiles(mut values: Vec<f64>) -> [f64; 5] {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
    [at(0.0), at(0.05), at(0.5), at(0.95), at(1.0)]
}

fn judge(drift: &[Outcome], still: &[Outcome]) {
    let reduction = quantiles(drift.iter().map(Outcome::reduction).collect());
    let harm = quantiles(still.iter().map(|o| o.after / o.before).collect());
    let nis = quantiles(drift.iter().chain(still).map(|o| o.nis).collect());
    let noise = [0, 1].map(|k| quantiles(drift.iter().chain(still).map(|o| o.noise[k]).collect()));
    println!("{} seeds; smallest, 5 %, median, 95 %, largest", drift.len());
    println!("reduction of the RMS error on the path, drift   {reduction:.3?}");
    println!("RMS error after / before, no drift              {harm:.3?}");
    println!("mean squared innovation over its variance       {nis:.3?}");
    println!("learned noise / true noise of lengths           {:.3?}", noise[0]);
    println!("learned noise / true noise of angles            {:.3?}", noise[1]);
    let mut least: Vec<&Outcome> = drift.iter().collect();
    least.sort_by(|a, b| a.reduction().total_cmp(&b.reduction()));
    for o in least.iter().take(5) {
        let [before, after] = [o.before, o.after].map(|mm| 1e3 * mm);
        println!("seed {}: {before:.1} um before, {after:.1} um after", o.seed);
    }
    let left = quantiles(drift.iter().map(|o| 1e3 * o.after).collect());
    println!("RMS error on the path that is left, drift, um   {left:.2?}");
    assert!(drift.iter().all(|o| o.excluded), "the bias was seen in every run");
    assert!(reduction[0] >= 0.70, "reduction {reduction:?}");
    assert!(harm[4] <= 1.05, "harm {harm:?}");
    assert!(nis[0] > 0.6 && nis[4] < 1.5 && (nis[2] - 1.0).abs() < 0.1, "nis {nis:?}");
    assert!(noise.iter().all(|of| of[0] > 0.85 && of[4] < 1.15), "noise {noise:?}");
}

#[test]
fn drift_is_followed_stillness_left_alone_and_noise_found() {
    judge(&runs(0..20, with_drift), &runs(0..20, without_drift));
}

#[test]
#[ignore = "minutes: the distribution over 500 seeds"]
fn five_hundred_seeds() {
    judge(&runs(1000..1500, with_drift), &runs(1000..1500, without_drift));
}
