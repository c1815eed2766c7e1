//! A ram with a head: learning, gates and alarms, observability, delays, what is kept.

use nalgebra::Matrix6;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::Row;
use crate::live::reading::{Seen, ToolReading};
use crate::live::rows::Expected;
use crate::live::spec::MapSpec;
use volcomp_model::axes::MAX_AXES;
use volcomp_model::curve::Live;
use volcomp_model::geometry::Vec3;
use volcomp_model::{AxisSpec, Chain, Curve, ErrorFunction, Pose};

const SYMBOLS: [&str; 6] = ["exz", "eyz", "ezz", "eaz", "ebz", "ecz"];
/// Offset of the ram that the offline map does not know, mm and rad.
const RAM: [f64; 6] = [0.012, -0.008, 0.006, 1.2e-5, -1.6e-5, 0.8e-5];
const NOISE_MM: f64 = 0.004;
const NOISE_RAD: f64 = 6e-6;

fn model_spec() -> ModelSpec {
    let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y Z C A (S) t]").unwrap());
    spec.tool_tip = Vec3::new(0.0, 0.0, -400.0);
    for (name, travel) in [(AxisName::X, 2000.0), (AxisName::Y, 800.0), (AxisName::Z, 600.0)] {
        spec.axes.push(AxisSpec { travel: Some([0.0, travel]), ..AxisSpec::new(name) });
    }
    for name in [AxisName::C, AxisName::A] {
        spec.axes.push(AxisSpec { point: Vec3::new(0.0, 0.0, -180.0), ..AxisSpec::new(name) });
    }
    for (k, symbol) in SYMBOLS.iter().enumerate() {
        let limit = if k < 3 { 0.04 } else { 4e-5 };
        let live = vec![Live { sensor: format!("ram.{symbol}"), limit, reference: None }];
        let curves = vec![Curve::Constant(if k < 3 { 0.003 } else { 2e-6 })];
        let function = ErrorFunction { curves, live, ..ErrorFunction::default() };
        spec.errors.push((ErrorSymbol::parse(symbol).unwrap(), function));
    }
    spec
}

fn of<'a>(spec: &'a ModelSpec, model: &Arc<Model>, hash: [u8; 32]) -> LiveModel<'a> {
    LiveModel { spec, thermal: &[], model: Arc::clone(model), hash }
}

fn live_spec() -> LiveSpec {
    let nodes = [vec![0.0, 1000.0, 2000.0], vec![0.0, 800.0], vec![0.0, 600.0]];
    let sensor = SensorSpec {
        std_mm: NOISE_MM,
        std_rad: NOISE_RAD,
        ..SensorSpec::new("tracker", SensorKind::Tool { map: 0 })
    };
    LiveSpec { sensors: vec![sensor], maps: vec![MapSpec::new("ram", nodes)] }
}

/// A machine on its path, a tracker beside it, and the estimator.
struct Bench {
    estimator: LiveEstimator,
    model: Arc<Model>,
    random: ChaCha8Rng,
    ms: i64,
    /// The tracker: noise over the stated one (lengths, angles), bias, real delay that nobody stated, stamps, whether it is there.
    factor: [f64; 2],
    bias: f64,
    delay_ms: f64,
    skew_ms: i64,
    there: bool,
    reversed: bool,
    /// The head moves.
    head: bool,
    speed: f64,
}

impl Bench {
    fn new(seed: u64) -> Self {
        let spec = model_spec();
        let model = Arc::new(Model::new(&spec).unwrap());
        let estimator = LiveEstimator::new(&live_spec(), of(&spec, &model, [1; 32])).unwrap();
        Self {
            estimator,
            model,
            random: ChaCha8Rng::seed_from_u64(seed),
            ms: 0,
            factor: [1.0; 2],
            bias: 0.0,
            delay_ms: 0.0,
            skew_ms: 0,
            there: true,
            reversed: false,
            head: true,
            speed: 5.0,
        }
    }

    fn position(&self, ms: f64) -> [f64; MAX_AXES] {
        let t = self.speed * ms * 1e-3;
        let head = if self.head { 1.0 } else { 0.0 };
        [
            1000.0 + 900.0 * (0.05 * t).sin(),
            400.0 + 380.0 * (0.083 * t).sin(),
            300.0 + 280.0 * (0.11 * t).cos(),
            head * 1.5 * (0.21 * t).sin(),
            head * 0.6 * (0.31 * t).cos(),
            0.0,
            0.0,
            0.0,
        ]
    }

    fn noise(&mut self) -> f64 {
        StandardNormal.sample(&mut self.random)
    }

    fn normal(&mut self, std: f64) -> Vec3 {
        Vec3::new(std * self.noise(), std * self.noise(), std * self.noise())
    }

    fn now(&self) -> MonoTime {
        MonoTime::from_ns(self.ms * 1_000_000)
    }

    /// 10 ms later, with a reading; the reading of a wild one is off by a millimetre.
    fn step(&mut self, wild: bool) {
        for _ in 0..10 {
            self.ms += 1;
            let at = self.position(self.ms as f64);
            let sample = MotionSample { at: self.now(), commanded: at, actual: at, tool_tip: None };
            self.estimator.on_motion(sample);
        }
        if self.there {
            let mut pose = Pose::at(self.position(self.ms as f64 + self.delay_ms));
            pose.live[..6].copy_from_slice(&RAM);
            let deviation = self.model.deviation(&pose);
            let nominal = self.model.nominal_tool(&pose);
            let off = Vec3::new(self.bias + if wild { 1.0 } else { 0.0 }, 0.0, 0.0);
            let tip = nominal.tip + deviation.position + off + self.normal(self.factor[0] * NOISE_MM);
            let direction = nominal.direction
                + deviation.rotation.cross(&nominal.direction)
                + self.normal(self.factor[1] * NOISE_RAD);
            let direction = if self.reversed { -direction } else { direction };
            let body = Body::Tool(ToolReading {
                tip: Seen::Absolute(tip),
                direction: Some(Seen::Absolute(direction)),
                covariance: None,
            });
            let stamp_ns = (self.ms + 5_000 + self.skew_ms) * 1_000_000;
            self.estimator.on_reading(self.now(), 0, &Reading { stamp_ns, quality: 1.0, body });
        }
        self.estimator.tick(self.now());
    }

    fn run(&mut self, steps: u32) {
        (0..steps).for_each(|_| self.step(false));
    }

    fn sensor(&self) -> crate::live::SensorHealth {
        self.estimator.health(self.now()).sensors.remove(0)
    }

    fn map(&self) -> crate::live::MapHealth {
        self.estimator.health(self.now()).maps.remove(0)
    }

    /// Estimates in the middle of the path.
    fn middle(&self) -> Vec<[f64; 3]> {
        (0..6).map(|c| self.estimator.estimate(0, c, [1000.0, 400.0, 300.0]).unwrap()).collect()
    }
}

#[test]
fn what_the_offline_map_does_not_know_is_learned_with_its_uncertainty() {
    let mut bench = Bench::new(1);
    bench.run(2000);
    for (c, ([value, std, used], truth)) in bench.middle().into_iter().zip(RAM).enumerate() {
        assert!((value - truth).abs() < 4.0 * std, "{c}: {value:e} {truth:e} +- {std:e}");
        assert!((used - truth).abs() < 4.0 * std + 0.2 * truth.abs(), "{c}: {used:e} {truth:e}");
    }
    let sensor = bench.sensor();
    assert_eq!(sensor.status, SensorStatus::Good);
    assert!(sensor.noise_factor.unwrap().iter().all(|f| (f - 1.0).abs() < 0.1), "{sensor:?}");
    assert!((sensor.nis.unwrap() - 1.0).abs() < 0.25, "{sensor:?}");
    assert!((sensor.clock_offset_s.unwrap() - 5.0).abs() < 1e-9);
    let now = bench.now();
    let table = bench.estimator.table(now);
    assert_eq!(table.sources[3], Source::Map { map: 0, component: 3 });
    assert_eq!((bench.map().nodes.len(), bench.map().is_static), (12, false));
}

#[test]
fn noise_stated_five_times_too_small_or_large_is_found() {
    for factor in [[5.0, 5.0], [0.2, 0.2], [5.0, 0.2], [0.2, 5.0]] {
        let mut bench = Bench::new(2);
        bench.factor = factor;
        bench.run(2500);
        let sensor = bench.sensor();
        assert_eq!(sensor.status, SensorStatus::Good, "{sensor:?}");
        for (found, truth) in sensor.noise_factor.unwrap().iter().zip(factor) {
            assert!((found / truth - 1.0).abs() < 0.15, "{factor:?} {sensor:?}");
        }
        assert!((sensor.nis.unwrap() - 1.0).abs() < 0.3, "{sensor:?}");
    }
}

#[test]
fn one_attitude_of_the_tool_leaves_the_turn_about_it_as_it_was() {
    let mut bench = Bench::new(3);
    bench.head = false;
    let before = bench.middle();
    bench.run(1500);
    let after = bench.middle();
    // the tool stands on the ram's own axis: a turn about it shows nowhere
    assert!((after[5][0] - before[5][0]).abs() < 1e-12 && after[5][1] > 0.9 * before[5][1], "{after:?}");
    assert!(after[3][1] < 0.4 * before[3][1] && after[4][1] < 0.4 * before[4][1], "{after:?}");
}

#[test]
fn outliers_are_left_out_and_a_sensor_that_lies_is_excluded_alarmed_and_comes_back() {
    let mut bench = Bench::new(4);
    bench.estimator.sensors[0].supervisor = crate::Supervisor::new(crate::Plausibility {
        age_limit_s: 0.5,
        range: [f64::INFINITY; VALUES_MAX],
        jump: [f64::INFINITY; VALUES_MAX],
        rate: [f64::INFINITY; VALUES_MAX],
        frozen_s: 1.0,
        quality_min: 0.0,
        return_s: 2.0,
    });
    bench.run(800);
    let before = bench.middle();
    let rejected = bench.sensor().readings[2];
    bench.step(true);
    assert_eq!(bench.sensor().readings[2], rejected + 1, "the wild one was beyond the gate");
    bench.run(3);
    bench.bias = 0.3;
    bench.run(8);
    assert_eq!(bench.sensor().status, SensorStatus::Excluded(SensorFault::Disagrees));
    assert!(bench.map().alarm && !bench.map().is_static, "held first");
    bench.run(1100);
    assert!(bench.map().is_static, "given up for the static model");
    let now = bench.now();
    assert_eq!(bench.estimator.table(now).sources[0], Source::None);
    let held = bench.middle();
    assert!((held[0][0] - before[0][0]).abs() < 2e-3, "nothing was learned from the lies: {held:?}");
    bench.bias = 0.0;
    bench.run(60);
    assert_eq!(bench.sensor().status, SensorStatus::Good);
    assert!(!bench.map().alarm && !bench.map().is_static);
}

#[test]
fn a_silent_or_frozen_sensor_a_step_and_a_clock_are_told_by_name() {
    let mut bench = Bench::new(5);
    bench.run(200);
    bench.there = false;
    bench.run(60);
    assert_eq!(bench.sensor().status, SensorStatus::Excluded(SensorFault::Silent));
    bench.there = true;
    bench.run(400);
    assert_eq!(bench.sensor().status, SensorStatus::Good);
    bench.bias = 0.5;
    bench.run(3);
    assert_eq!(bench.sensor().status, SensorStatus::Excluded(SensorFault::Jump));
    bench.bias = 0.0;
    bench.run(400);
    assert_eq!(bench.sensor().status, SensorStatus::Good);
    for skew_ms in [50, 0] {
        bench.skew_ms = skew_ms;
        bench.run(1);
        assert_eq!(bench.sensor().status, SensorStatus::Excluded(SensorFault::Clock), "{skew_ms}");
        bench.run(400);
        assert_eq!(bench.sensor().status, SensorStatus::Good, "{:?}", bench.sensor());
    }
}

#[test]
fn a_delay_that_nobody_stated_is_learned_from_motion() {
    let mut bench = Bench::new(6);
    bench.delay_ms = 2.0;
    bench.run(1500);
    let [shift, std] = bench.sensor().shift_s.unwrap();
    assert!((shift - 2e-3).abs() < (4.0 * std).max(3e-5), "{shift} {std}");
    for (c, ([value, std, _], truth)) in bench.middle().into_iter().zip(RAM).enumerate() {
        assert!((value - truth).abs() < 5.0 * std, "{c}: {value:e} {truth:e} +- {std:e}");
    }
}

#[test]
fn what_was_learned_survives_and_is_less_certain_after_a_week() {
    let mut bench = Bench::new(7);
    bench.run(1500);
    let kept = bench.estimator.kept();
    let mut other = Bench::new(8);
    assert_eq!(other.estimator.restore(&kept, 3600.0), Vec::<String>::new());
    for (a, b) in bench.middle().iter().zip(other.middle()) {
        // an hour of a memory of two
        assert!((a[0] * (-0.5_f64).exp() - b[0]).abs() < 1e-9 && b[1] > a[1], "{a:?} {b:?}");
    }
    let mut long = Bench::new(8);
    let offline = long.middle()[3][1];
    long.estimator.restore(&kept, 7.0 * 24.0 * 3600.0);
    assert!((long.middle()[3][1] / offline - 1.0).abs() < 0.02, "as uncertain as the offline map, no more");
    assert!(long.middle().iter().all(|[value, _, used]| value.abs() < 1e-9 && *used == 0.0), "and faded");
    let mut bad = kept.clone();
    bad[0].values[0].0 = f64::NAN;
    assert!(other.estimator.restore(&bad, 0.0)[0].contains("not numbers"));
    let mut moved = kept.clone();
    moved[0].nodes[0][1] = 900.0;
    assert!(other.estimator.restore(&moved, 0.0)[0].contains("nodes are others"));
    assert!(other.estimator.restore(&[], 0.0)[0].contains("nothing was kept"));
    assert!(other.estimator.forget("ram") && !other.estimator.forget("rom"));
    assert!(other.middle().iter().all(|[value, ..]| *value == 0.0));
}

#[test]
fn a_covariance_and_points_say_the_same_as_a_pose() {
    let mut by_pose = Bench::new(9);
    by_pose.run(60);
    let spec = model_spec();
    let model = Model::new(&spec).unwrap();
    let sample = by_pose.estimator.history.newest().copied().unwrap();
    let channels: Vec<usize> = (0..6).collect();
    let expected = Expected::new(&model, &sample, &[0.0; SENSORS_MAX], &channels);
    let mut pose = Pose::at(sample.commanded);
    pose.live[..6].copy_from_slice(&RAM);
    let (deviation, nominal) = (model.deviation(&pose), model.nominal_tool(&pose));
    let points = [Vec3::zeros(), Vec3::new(0.0, 0.0, 150.0), Vec3::new(80.0, 0.0, 60.0)].map(|offset| {
        let lever = nominal.rotation * offset;
        let position = nominal.tip + lever + deviation.position + deviation.rotation.cross(&lever);
        crate::live::PointReading { offset, position: Seen::Absolute(position), std: Some(0.002) }
    });
    let std = crate::live::rows::DefaultStd { mm: 0.01, rad: 1e-5 };
    let gap = expected.gap(&Body::Points(points.to_vec()), std);
    assert_eq!(gap.rows.len(), 9);
    // the rows explain what was seen
    for Row { value, weights, .. } in &gap.rows {
        let model: f64 = weights.iter().zip(RAM).map(|(w, x)| w * x).sum();
        assert!((value - model).abs() < 1e-8, "{value} {model}");
    }
    let along = Body::Deviation { direction: Vec3::x(), value: deviation.position.x, std: None };
    let gap = expected.gap(&along, std);
    let model: f64 = gap.rows[0].weights.iter().zip(RAM).map(|(w, x)| w * x).sum();
    assert!((gap.rows[0].value - model).abs() < 1e-8);
    let tool = ToolReading {
        tip: Seen::Deviation(deviation.position),
        direction: Some(Seen::Deviation(deviation.rotation.cross(&nominal.direction))),
        covariance: Some(Matrix6::identity() * 1e-6),
    };
    let gap = expected.gap(&Body::Tool(tool), std);
    assert_eq!(gap.rows.len(), 5);
    for Row { value, weights, .. } in &gap.rows {
        let model: f64 = weights.iter().zip(RAM).map(|(w, x)| w * x).sum();
        assert!((value - model).abs() < 1e-8, "{value} {model}");
    }
}

#[test]
fn an_applied_offset_is_no_error_of_the_machine() {
    let model = Model::new(&model_spec()).unwrap();
    let mut sample =
        MotionSample { at: MonoTime::ZERO, commanded: [100.0; 8], actual: [100.0; 8], tool_tip: None };
    sample.commanded[3..].fill(0.3);
    sample.actual = sample.commanded;
    sample.actual[0] += 0.05;
    sample.actual[4] += 1e-4;
    let expected = Expected::new(&model, &sample, &[0.0; SENSORS_MAX], &[]);
    let at = |position| model.nominal_tool(&Pose::at(position));
    let deviation = model.deviation(&Pose::at(sample.commanded));
    let seen = at(sample.actual).tip + deviation.position - at(sample.commanded).tip;
    let std = crate::live::rows::DefaultStd { mm: 0.01, rad: 1e-5 };
    let tool = ToolReading { tip: Seen::Deviation(seen), direction: None, covariance: None };
    assert!(expected.gap(&Body::Tool(tool), std).rows.iter().all(|row| row.value.abs() < 1e-9));
}

#[test]
fn what_does_not_go_together_is_refused_in_words() {
    let spec = model_spec();
    let model = Arc::new(Model::new(&spec).unwrap());
    let make = |live: &LiveSpec| LiveEstimator::new(live, of(&spec, &model, [0; 32]));
    let mut live = live_spec();
    live.maps[0].name = "rom".to_owned();
    let error = make(&live).unwrap_err().to_string();
    assert!(error.contains("rom.eaz"), "{error}");
    let mut live = live_spec();
    live.sensors[0].name = "ram".to_owned();
    assert_eq!(make(&live).unwrap_err(), LiveError::Twice { name: "ram".to_owned() });
    let mut live = live_spec();
    live.sensors[0].kind = SensorKind::Value;
    assert!(make(&live).is_err());
    live.sensors[0].kind = SensorKind::Tool { map: 3 };
    assert_eq!(make(&live).unwrap_err(), LiveError::NoMap { sensor: "tracker".to_owned() });
}

#[test]
fn a_direction_that_points_the_other_way_is_refused_by_name() {
    let mut bench = Bench::new(10);
    bench.run(400);
    let before = bench.middle();
    bench.reversed = true;
    bench.run(100);
    assert_eq!(bench.sensor().status, SensorStatus::Excluded(SensorFault::Reversed));
    for (a, b) in before.iter().zip(bench.middle()) {
        assert!((a[0] - b[0]).abs() < 1e-5, "nothing was learned from it: {a:?} {b:?}");
    }
    bench.reversed = false;
    bench.run(400);
    assert_eq!(bench.sensor().status, SensorStatus::Good);
}

#[test]
fn a_value_counts_from_the_reading_that_it_is_from() {
    let spec = model_spec();
    let model = Arc::new(Model::new(&spec).unwrap());
    let mut live = live_spec();
    live.maps.clear();
    live.sensors = vec![SensorSpec { age_limit_s: 5.0, ..SensorSpec::new("ram.eaz", SensorKind::Value) }];
    let mut it = LiveEstimator::new(&live, of(&spec, &model, [0; 32])).unwrap();
    let at = |ms: i64| MonoTime::from_ns(ms * 1_000_000);
    let say = |it: &mut LiveEstimator, ms: i64, value: f64| {
        let body = Body::Value { value, unit: Some(Kind::Angle) };
        it.on_reading(at(ms), 0, &Reading { stamp_ns: at(ms).ns, quality: 1.0, body });
    };
    say(&mut it, 10, 1e-5);
    // another reading that there was no time for, and long silence: the value is not younger for that
    it.skip(at(1000), 0);
    it.tick(at(4000));
    let channel = it.sensors[0].channel.unwrap();
    assert_eq!(it.table(at(4000)).sources[channel], Source::Value { value: 1e-5, heard: at(10) });
    say(&mut it, 4010, 2e-5);
    assert_eq!(it.table(at(4020)).sources[channel], Source::Value { value: 2e-5, heard: at(4010) });
}

#[test]
fn a_value_in_the_unit_of_another_quantity_is_refused_by_name() {
    let spec = model_spec();
    let model = Arc::new(Model::new(&spec).unwrap());
    let mut live = live_spec();
    live.maps.clear();
    live.sensors = ["ram.eaz", "ram.exz"].map(|name| SensorSpec::new(name, SensorKind::Value)).to_vec();
    let mut it = LiveEstimator::new(&live, of(&spec, &model, [0; 32])).unwrap();
    let say = |it: &mut LiveEstimator, ms: i64, sensor: usize, unit: Option<Kind>| {
        let now = MonoTime::from_ns(ms * 1_000_000);
        let body = Body::Value { value: 1e-5 + 1e-9 * ms as f64, unit };
        it.on_reading(now, sensor, &Reading { stamp_ns: now.ns, quality: 1.0, body });
        it.sensor_statuses().map(|(_, status)| status).collect::<Vec<_>>()[sensor]
    };
    for (sensor, own, other) in [(0, Kind::Angle, Kind::Length), (1, Kind::Length, Kind::Angle)] {
        assert_eq!(say(&mut it, 10, sensor, Some(own)), SensorStatus::Good);
        assert_eq!(say(&mut it, 20, sensor, None), SensorStatus::Good, "binary messages name no unit");
        assert_eq!(say(&mut it, 30, sensor, Some(other)), SensorStatus::Excluded(SensorFault::Kind));
    }
    assert!(it.table(MonoTime::from_ns(40_000_000)).sources.iter().all(|s| *s == Source::None));
}

#[test]
fn a_second_sensor_that_contradicts_is_told_and_the_first_goes_on() {
    let mut bench = Bench::new(11);
    let spec = model_spec();
    let mut live = live_spec();
    live.sensors.push(SensorSpec { name: "other".to_owned(), ..live.sensors[0].clone() });
    bench.estimator = LiveEstimator::new(&live, of(&spec, &bench.model, [1; 32])).unwrap();
    bench.run(400);
    // it says what the first one does, and then something else by less than a jump
    for k in 0..400 {
        bench.step(false);
        let at = bench.position(bench.ms as f64);
        let mut pose = Pose::at(at);
        pose.live[..6].copy_from_slice(&RAM);
        let off = if k > 200 { 0.15 } else { 0.0 };
        let tip = bench.model.nominal_tool(&pose).tip + bench.model.deviation(&pose).position;
        let tip = tip + Vec3::new(off, 0.0, 0.0) + bench.normal(NOISE_MM);
        let body = Body::Tool(ToolReading { tip: Seen::Absolute(tip), direction: None, covariance: None });
        let reading = Reading { stamp_ns: bench.ms * 1_000_000, quality: 1.0, body };
        bench.estimator.on_reading(bench.now(), 1, &reading);
        bench.estimator.tick(bench.now());
    }
    let health = bench.estimator.health(bench.now());
    assert_eq!(health.sensors[0].status, SensorStatus::Good);
    assert_eq!(
        health.sensors[1].status,
        SensorStatus::Excluded(SensorFault::Disagrees),
        "{:?}",
        health.sensors[1]
    );
    assert!(health.maps[0].alarm && health.maps[0].taught && !health.maps[0].is_static, "told");
    bench.run(1500);
    assert!(!bench.map().is_static, "the first one agrees with the map");
}

#[test]
fn a_map_that_nobody_teaches_is_held_and_fades_over_hours() {
    let mut bench = Bench::new(12);
    bench.run(1500);
    let used = bench.middle()[0][2];
    assert!(bench.map().taught && used > 0.009);
    bench.there = false;
    bench.run(300);
    let map = bench.map();
    assert!(!map.taught && map.idle_s > 2.5, "{map:?}");
    assert!((bench.middle()[0][2] / used - 1.0).abs() < 0.01, "a short silence costs nothing");
    let mut last = bench.middle()[0][2];
    let begin = bench.now();
    for minute in 1..=24 * 60 {
        bench.estimator.tick(begin.plus_seconds(60.0 * f64::from(minute)));
        let used = bench.middle()[0][2];
        assert!(used <= last && last - used < 0.03 * 0.012, "minute {minute}: {last} {used}");
        last = used;
    }
    assert!(last.abs() < 1e-6, "{last}");
}

#[test]
fn what_is_larger_than_its_limit_is_told() {
    let mut bench = Bench::new(13);
    let spec = model_spec();
    let mut live = live_spec();
    live.maps[0].limit = [0.006, 5e-5];
    bench.estimator = LiveEstimator::new(&live, of(&spec, &bench.model, [1; 32])).unwrap();
    assert!(!bench.map().limited);
    bench.run(800);
    assert!(
        bench.map().limited && (bench.map().largest[0] - 0.006).abs() < 1e-12,
        "{:?}",
        bench.map().largest
    );
    assert!(bench.estimator.map_states().all(|(_, status)| status.limited));
}

#[test]
fn a_poisoned_beginning_does_not_lock_an_honest_sensor_out() {
    let mut bench = Bench::new(16);
    bench.run(25);
    // the first readings that are used are wild, within what the offline map allows
    bench.bias = 0.03;
    bench.run(2);
    bench.bias = 0.0;
    bench.run(9000);
    assert_eq!(bench.sensor().status, SensorStatus::Good, "{:?}", bench.sensor());
    for (c, ([value, ..], truth)) in bench.middle().into_iter().zip(RAM).enumerate() {
        assert!((value - truth).abs() < if c < 3 { 3e-3 } else { 4e-6 }, "{c}: {value:e} {truth:e}");
    }
}
