//! Thermal displacement during operation: readings of temperature and speed, lagged, become a live value.
//!
//! Heat is slow: an input that is lost leaves its last word standing for [`HOLD_S`], then the thermal displacement is
//! taken back over [`FADE_S`], and comes back at the same pace. A thermal displacement says nothing until each of its
//! inputs has spoken in this run. After a stop the lags that were kept go on as if the first readings had held all
//! the while: short stops are bridged, long ones end where a machine at rest would be.
//!
//! Source: `src/estimate/thermal.rs` (the lags, the fading outside of what the fit has seen).

use serde::{Deserialize, Serialize};

use super::sensor::SensorState;
use super::spec::{LiveError, LiveSpec, SensorKind};
use crate::{Quantity, SensorStatus, Thermal, ThermalDisplacement, ThermalState, VALUES_MAX};
use volcomp_model::units::MonoTime;

/// Interval at which the lags move, s.
const INTERVAL_S: f64 = 0.5;
/// Time for which the last word of an input that is lost stands, s.
pub const HOLD_S: f64 = 60.0;
/// Time over which a thermal displacement with a lost input is taken back, s.
pub const FADE_S: f64 = 60.0;
/// An input must be within its range for so long before it counts as inside again, s.
const INSIDE_S: f64 = 60.0;

/// How a thermal displacement stands; inputs by index.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ThermalStatus {
    /// An input has not spoken yet.
    Waiting(usize),
    /// In use.
    Used,
    /// In use, but an input is outside of what the fit has seen: it fades.
    Outside(usize),
    /// An input is lost: held, then taken back.
    Lost(usize),
}

/// What is kept of a thermal displacement.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SavedThermalState {
    /// Its name.
    pub name: String,
    /// Inputs behind their lags, in the order of the model file.
    pub lagged: Vec<f64>,
    /// Last reading of each input, degC or 1/min.
    pub last: Vec<f64>,
}

/// Where an input comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Origin {
    sensor: usize,
    /// Which of its numbers.
    number: usize,
}

/// A thermal displacement and its lags.
#[derive(Debug, Clone)]
pub(super) struct ThermalDisplacementState {
    pub(super) spec: Thermal,
    /// Live value of the model that it tells.
    pub(super) channel: usize,
    origins: Vec<Origin>,
    lags: ThermalState,
    /// Last believed reading of each input in this run.
    readings: Vec<f64>,
    moved: Option<MonoTime>,
    /// Time that has passed since the lags were kept, s.
    rest_s: f64,
    /// Input that is lost, and since when.
    lost: Option<(usize, MonoTime)>,
    /// Input that is outside, and when it was seen there last.
    outside: Option<(usize, MonoTime)>,
    /// 1 where all inputs are there, 0 where it has been taken back.
    probation: f64,
    growth: ThermalDisplacement,
}

impl ThermalDisplacementState {
    /// A thermal displacement that tells live value `channel` of the model.
    pub(super) fn new(spec: &Thermal, channel: usize, live: &LiveSpec) -> Result<Self, LiveError> {
        let origins: Result<Vec<Origin>, LiveError> =
            spec.inputs.iter().map(|i| origin(&spec.name, &i.sensor, i.quantity, live)).collect();
        Ok(Self {
            channel,
            origins: origins?,
            lags: ThermalState::new(spec),
            readings: vec![f64::NAN; spec.inputs.len()],
            moved: None,
            rest_s: 0.0,
            lost: None,
            outside: None,
            probation: 1.0,
            growth: ThermalDisplacement { value: 0.0, share: 0.0, outside: None },
            spec: spec.clone(),
        })
    }

    /// Time has passed.
    pub(super) fn tick(&mut self, now: MonoTime, sensors: &[SensorState]) {
        if self.moved.is_some_and(|before| now.seconds_since(before) < INTERVAL_S) {
            return;
        }
        let mut lost = None;
        for (k, (origin, reading)) in self.origins.iter().zip(&mut self.readings).enumerate() {
            let sensor = sensors.get(origin.sensor).filter(|s| s.supervisor.status() == SensorStatus::Good);
            match sensor.and_then(|s| s.believed.get(origin.number)) {
                Some(value) => *reading = *value,
                None => lost = lost.or(Some(k)),
            }
        }
        if self.waits_for().is_some() {
            return;
        }
        let dt_s = self.moved.map_or(self.rest_s, |before| now.seconds_since(before));
        self.moved = Some(now);
        self.lags.advance(&self.spec, dt_s, &self.readings);
        self.growth = self.lags.growth(&self.spec);
        // another input that is lost does not begin the hold anew
        self.lost = lost.map(|k| (k, self.lost.map_or(now, |(_, since)| since)));
        let gone = self.lost.is_some_and(|(_, since)| now.seconds_since(since) > HOLD_S);
        let step = dt_s.min(INTERVAL_S * 4.0) / FADE_S;
        self.probation = (self.probation + if gone { -step } else { step }).clamp(0.0, 1.0);
        self.outside = match self.growth.outside {
            Some(k) => Some((k, now)),
            None => self.outside.filter(|(_, seen)| now.seconds_since(*seen) < INSIDE_S),
        };
    }

    /// The first input that has not spoken in this run.
    fn waits_for(&self) -> Option<usize> {
        self.readings.iter().position(|r| r.is_nan())
    }

    /// What it tells, mm or a strain; `None` where it says nothing.
    pub(super) fn value(&self) -> Option<f64> {
        (self.moved.is_some() && self.probation > 0.0).then_some(self.probation * self.growth.value)
    }

    /// Share of it that is used, 0 to 1.
    pub(super) fn share(&self) -> f64 {
        if self.moved.is_some() { self.probation * self.growth.share } else { 0.0 }
    }

    pub(super) fn status(&self) -> ThermalStatus {
        match (self.waits_for(), self.lost, self.outside) {
            (Some(k), ..) => ThermalStatus::Waiting(k),
            (_, Some((k, _)), _) => ThermalStatus::Lost(k),
            (.., Some((k, _))) => ThermalStatus::Outside(k),
            _ => ThermalStatus::Used,
        }
    }

    /// Name of the input that the standing is about.
    pub(super) fn input(&self) -> Option<&str> {
        let k = match self.status() {
            ThermalStatus::Used => return None,
            ThermalStatus::Waiting(k) | ThermalStatus::Outside(k) | ThermalStatus::Lost(k) => k,
        };
        self.spec.inputs.get(k).map(|i| i.sensor.as_str())
    }

    /// What is to be kept, once it has begun.
    pub(super) fn kept(&self) -> Option<SavedThermalState> {
        self.moved?;
        let (lagged, last) = self.lags.kept()?;
        Some(SavedThermalState { name: self.spec.name.clone(), lagged, last })
    }

    /// Puts back what was kept `age_s` ago; false where it cannot be.
    pub(super) fn restore(&mut self, kept: &SavedThermalState, age_s: f64) -> bool {
        let Some(lags) = ThermalState::restored(&self.spec, &kept.lagged, &kept.last) else { return false };
        (self.lags, self.rest_s) = (lags, age_s.max(0.0));
        true
    }
}

/// The sensor of an input: `NAME`, or `NAME.K` for its K-th number, counted from 1.
fn origin(growth: &str, input: &str, quantity: Quantity, live: &LiveSpec) -> Result<Origin, LiveError> {
    let (name, number) = match input.rsplit_once('.').map(|(name, k)| (name, k.parse::<usize>())) {
        Some((name, Ok(k @ 1..=VALUES_MAX))) => (name, k - 1),
        _ => (input, 0),
    };
    let kind = match quantity {
        Quantity::Temperature => SensorKind::Temperature,
        Quantity::Speed => SensorKind::Speed,
    };
    let found = live.sensors.iter().position(|s| s.name == name);
    let Some(sensor) = found else {
        return Err(LiveError::NoInput {
            growth: growth.to_owned(),
            sensor: input.to_owned(),
            name: name.to_owned(),
            kind: kind.name(),
        });
    };
    if live.sensors[sensor].kind != kind {
        return Err(LiveError::InputKind {
            growth: growth.to_owned(),
            sensor: input.to_owned(),
            wanted: kind.name(),
            found: live.sensors[sensor].kind.name(),
        });
    }
    Ok(Origin { sensor, number })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::ThermalInput;
    use crate::live::reading::{Body, Reading};
    use crate::live::spec::SensorSpec;
    use crate::live::table::Source;
    use crate::live::{LiveEstimator, LiveModel};
    use volcomp_model::curve::Live;
    use volcomp_model::{Chain, ErrorFunction, ErrorSymbol, Model, ModelSpec};

    /// 2 um/K at once and 3 um/K behind 10 minutes of the second thermometer of a box; -1 um per 1000/min.
    fn thermal() -> Thermal {
        let input = |sensor: &str, quantity, range, lags_s: &[f64], coefficients: &[f64]| ThermalInput {
            sensor: sensor.to_owned(),
            quantity,
            range,
            reference: if quantity == Quantity::Temperature { 20.0 } else { 0.0 },
            power: 1.0,
            lags_s: lags_s.to_vec(),
            coefficients: coefficients.to_vec(),
        };
        Thermal {
            name: "spindle-z".to_owned(),
            expansion: false,
            offset: 0.0,
            fade_share: 0.5,
            std: None,
            inputs: vec![
                input("box.2", Quantity::Temperature, [20.0, 30.0], &[0.0, 600.0], &[0.002, 0.003]),
                input("spindle", Quantity::Speed, [0.0, 6000.0], &[0.0], &[-0.001]),
            ],
        }
    }

    fn sensor(name: &str, kind: SensorKind) -> SensorSpec {
        let range = [1e6; 2];
        let (jump, frozen_s) = ([f64::INFINITY; 2], f64::INFINITY);
        SensorSpec { range, jump, frozen_s, age_limit_s: 5.0, ..SensorSpec::new(name, kind) }
    }

    fn live() -> LiveSpec {
        let sensors = vec![sensor("box", SensorKind::Temperature), sensor("spindle", SensorKind::Speed)];
        LiveSpec { sensors, maps: Vec::new() }
    }

    fn estimator(live: &LiveSpec, thermal: &[Thermal]) -> Result<LiveEstimator, LiveError> {
        let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y Z t]").unwrap());
        let live_value = vec![Live { sensor: "spindle-z".to_owned(), limit: 0.1, reference: None }];
        let function = ErrorFunction { live: live_value, ..ErrorFunction::default() };
        spec.errors.push((ErrorSymbol::parse("ezz").unwrap(), function));
        let model = Arc::new(Model::new(&spec).unwrap());
        LiveEstimator::new(live, LiveModel { spec: &spec, thermal, model, hash: [0; 32] })
    }

    struct Bench {
        estimator: LiveEstimator,
        now: MonoTime,
        degc: f64,
        rpm: f64,
        box_there: bool,
    }

    impl Bench {
        fn new() -> Self {
            let estimator = estimator(&live(), &[thermal()]).unwrap();
            Self { estimator, now: MonoTime::from_ns(0), degc: 20.0, rpm: 0.0, box_there: true }
        }

        /// So many seconds, a reading of each sensor every second.
        fn run(&mut self, seconds: u32) {
            for _ in 0..seconds {
                self.now = self.now.plus_seconds(1.0);
                let mut bodies = vec![(1, Body::Speed(self.rpm))];
                if self.box_there {
                    bodies.push((0, Body::Temperatures(vec![99.0, self.degc])));
                }
                for (k, body) in bodies {
                    let reading = Reading { stamp_ns: self.now.ns, quality: 1.0, body };
                    self.estimator.on_reading(self.now, k, &reading);
                }
                self.estimator.tick(self.now);
            }
        }

        /// Value sent to the cycle, um.
        fn told_um(&mut self) -> Option<f64> {
            match self.estimator.table(self.now).sources[0] {
                Source::Smooth(value) => Some(1e3 * value),
                Source::None => None,
                other => panic!("{other:?}"),
            }
        }

        fn status(&self) -> ThermalStatus {
            self.estimator.health(self.now).growths[0].status
        }
    }

    #[test]
    fn readings_become_growth_with_its_lags() {
        let mut bench = Bench::new();
        assert_eq!((bench.told_um(), bench.status()), (None, ThermalStatus::Waiting(0)));
        bench.run(2);
        assert!(bench.told_um().unwrap().abs() < 1e-9);
        (bench.degc, bench.rpm) = (30.0, -4000.0);
        bench.run(600);
        let wanted = 2.0 * 10.0 + 3.0 * 10.0 * (1.0 - (-1.0f64).exp()) - 4.0;
        assert!((bench.told_um().unwrap() - wanted).abs() < 0.06, "{:?} {wanted}", bench.told_um());
        assert_eq!(bench.status(), ThermalStatus::Used);
    }

    #[test]
    fn outside_of_what_the_fit_has_seen_the_end_counts_then_it_fades_and_says_which_input() {
        let mut bench = Bench::new();
        bench.degc = 30.0;
        bench.run(3);
        let inside = bench.told_um().unwrap();
        bench.degc = 34.9;
        bench.run(2);
        assert!(bench.told_um().unwrap() >= inside, "the end of the range counts");
        bench.degc = 37.5;
        bench.run(2);
        let health = bench.estimator.health(bench.now).growths.remove(0);
        assert_eq!(health.status, ThermalStatus::Outside(0));
        assert_eq!(health.input.as_deref(), Some("box.2"));
        assert!((health.share - 0.5).abs() < 1e-9 && bench.told_um().unwrap() < 0.65 * inside);
        bench.degc = 41.0;
        bench.run(2);
        assert!(bench.told_um().unwrap().abs() < 1e-9);
        bench.degc = 29.0;
        bench.run(30);
        assert_eq!(bench.status(), ThermalStatus::Outside(0), "not at the border to and fro");
        bench.run(40);
        assert_eq!(bench.status(), ThermalStatus::Used);
    }

    #[test]
    fn a_lost_input_is_held_then_taken_back_slowly_and_comes_back_as_slowly() {
        let mut bench = Bench::new();
        bench.degc = 25.0;
        bench.run(3);
        let before = bench.told_um().unwrap();
        bench.box_there = false;
        bench.run(30);
        assert_eq!(bench.status(), ThermalStatus::Lost(0));
        assert!((bench.told_um().unwrap() - before).abs() < 1.0, "held");
        let mut last = bench.told_um().unwrap();
        for _ in 0..130 {
            bench.run(1);
            let now = bench.told_um().unwrap_or(0.0);
            assert!((now - last).abs() < 0.05 * before, "no step: {last} {now}");
            last = now;
        }
        assert_eq!(bench.told_um(), None, "taken back");
        bench.box_there = true;
        bench.run(10);
        let back = bench.told_um().unwrap();
        assert!(back > 0.0 && back < 0.5 * before, "slowly: {back} {before}");
        bench.run(70);
        assert!(bench.told_um().unwrap() > 0.9 * before);
        assert_eq!(bench.status(), ThermalStatus::Used);
    }

    #[test]
    fn lags_survive_a_restart_and_a_long_rest_ends_at_rest() {
        let mut bench = Bench::new();
        bench.run(2);
        bench.degc = 30.0;
        bench.run(300);
        let kept = bench.estimator.saved_thermal();
        let after = |age_s: f64| {
            let mut other = Bench::new();
            other.degc = 30.0;
            assert_eq!(other.estimator.restore_thermal(&kept, age_s), Vec::<String>::new());
            other.run(2);
            other.told_um().unwrap()
        };
        assert!((after(0.0) - bench.told_um().unwrap()).abs() < 0.1, "as if there had been no stop");
        let mut fresh = Bench::new();
        fresh.degc = 30.0;
        fresh.run(2);
        assert!((after(1e5) - fresh.told_um().unwrap()).abs() < 0.1, "as a machine at rest");
        let mut bad = kept.clone();
        bad[0].lagged[0] = f64::NAN;
        let said = Bench::new().estimator.restore_thermal(&bad, 0.0);
        assert!(said[0].contains("spindle-z"), "{said:?}");
        assert!(Bench::new().estimator.restore_thermal(&[], 0.0).is_empty(), "nothing kept is no mistake");
    }

    #[test]
    fn growths_whose_inputs_nobody_measures_are_refused_in_words() {
        let said = |live: &LiveSpec| estimator(live, &[thermal()]).unwrap_err().to_string();
        let mut without = live();
        without.sensors.remove(0);
        let words = said(&without);
        assert!(words.contains("\"box.2\"") && words.contains("name = \"box\""), "{words}");
        let mut other = live();
        other.sensors[1].kind = SensorKind::Temperature;
        let words = said(&other);
        assert!(words.contains("for a speed") && words.contains("\"temperature\""), "{words}");
        let mut twice = live();
        twice.sensors.push(sensor("spindle-z", SensorKind::Value));
        assert_eq!(
            estimator(&twice, &[thermal()]).unwrap_err(),
            LiveError::TwoSources { channel: "spindle-z".to_owned() }
        );
        let mut unused = thermal();
        unused.name = "nobody".to_owned();
        unused.inputs[0].sensor = "not there".to_owned();
        assert!(estimator(&live(), &[unused]).is_ok(), "what no error names is not fed");
    }
}
