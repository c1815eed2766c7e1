//! Live estimation in simulated time: the daemon's cycle end, the estimator, a tracker and a scale.

use std::sync::Arc;

use volcomp_daemon::{EstimatorEnd, LinkSession, LiveEnd, Motion, live_ends};
use volcomp_estimate::SensorClock;
use volcomp_estimate::live::{
    Body, LiveEstimator, LiveModel, LiveTable, MotionSample, Reading, Seen, ToolReading,
};
use volcomp_model::geometry::Vec3;
use volcomp_model::{Model, Pose};
use volcomp_protocol::{Position, Tool};
use volcomp_units::MonoTime;
use volcomp_units::axes::AxisArray;

use crate::control::Noise;
use crate::machine::{Machine, hash_of};

/// Rounds of the estimator, s.
const ROUND_S: f64 = 0.004;
/// Interval of tables, s.
const TABLE_S: f64 = 0.05;
/// Interval of the tracker's readings, and from measurement to arrival, s.
const TRACKER_S: [f64; 2] = [0.04, 0.008];
/// Interval of the scale's readings, s.
const SCALE_S: f64 = 0.1;
/// Noise of the tracker: tip, mm.
const TRACKER_NOISE: f64 = 0.004;
/// Origin of the sensors' clocks, ns.
const SENSOR_CLOCK_NS: i64 = 77_000_000_000;

/// Estimator and sensors beside the cycle. The axes of the machine are linear and in wire order of the chain.
#[derive(Debug)]
pub(crate) struct LiveLoop {
    cycle_end: LiveEnd,
    estimator_end: EstimatorEnd,
    estimator: LiveEstimator,
    model: Arc<Model>,
    clock: SensorClock,
    tip: Option<Vec3>,
    /// Tables that the cycle may hold.
    tables: Vec<Arc<LiveTable>>,
    /// When round, table, reading of the tracker and of the scale are due, s.
    due_s: [f64; 4],
    /// A reading of the tracker on its way, with its arrival, s.
    underway: Option<(f64, Reading)>,
    /// The scale is silent from here to there, s.
    scale_silent_s: [f64; 2],
    /// The tracker is off by 0.25 mm from here to there, s.
    tracker_biased_s: [f64; 2],
    noise: Noise,
}

impl LiveLoop {
    pub(crate) fn new(machine: &Machine, scale_silent_s: [f64; 2], tracker_biased_s: [f64; 2]) -> Self {
        let hash = hash_of(&machine.model_text);
        let (mut cycle_end, estimator_end) = live_ends(hash);
        cycle_end.link_up(&machine.hello());
        let model = Arc::clone(&machine.model);
        let of = LiveModel { spec: &machine.spec, thermal: &machine.thermal, model, hash };
        Self {
            cycle_end,
            estimator_end,
            estimator: LiveEstimator::new(&machine.config.sensors.spec, of).expect("an estimator"),
            model: Arc::clone(&machine.model),
            clock: SensorClock::new(0.0),
            tip: None,
            tables: Vec::new(),
            due_s: [0.0; 4],
            underway: None,
            scale_silent_s,
            tracker_biased_s,
            noise: Noise(2),
        }
    }

    pub(crate) fn tool(&mut self, tool: &Tool) {
        self.cycle_end.tool(tool);
    }

    /// What follows the answer to a frame on the cycle, and the estimator's share of that cycle.
    pub(crate) fn after(&mut self, now: MonoTime, frame: &Position, body: &mut LinkSession) {
        self.cycle_end.after(now, frame, body);
        let time_s = now.seconds_since(MonoTime::ZERO);
        for motion in self.estimator_end.motions.try_iter() {
            match motion {
                Motion::At { now, control_ns, commanded, actual } => {
                    let at = self.clock.stamp(now, control_ns).at;
                    self.estimator.on_motion(MotionSample { at, commanded, actual, tool_tip: self.tip });
                }
                Motion::Tool([x, y, z]) => self.tip = Some(Vec3::new(x, y, z)),
                Motion::Axes { .. } | Motion::Down => {}
            }
        }
        self.readings(now, time_s, frame);
        if self.is_due(0, time_s, ROUND_S) {
            self.estimator.tick(now);
        }
        if self.is_due(1, time_s, TABLE_S) {
            let table = Arc::new(self.estimator.table(now));
            self.tables.push(Arc::clone(&table));
            self.estimator_end.tables.try_send(table).expect("the cycle takes every table");
        }
    }

    fn is_due(&mut self, what: usize, time_s: f64, interval_s: f64) -> bool {
        let due = time_s >= self.due_s[what];
        if due {
            self.due_s[what] += interval_s;
        }
        due
    }

    fn readings(&mut self, now: MonoTime, time_s: f64, frame: &Position) {
        let [interval_s, delay_s] = TRACKER_S;
        if let Some((arrival_s, reading)) = self.underway.take() {
            if time_s >= arrival_s {
                let tracker = self.estimator.sensor("tracker").expect("in the machine file");
                self.estimator.on_reading(now, tracker, &reading);
            } else {
                self.underway = Some((arrival_s, reading));
            }
        }
        let [from, to] = self.tracker_biased_s;
        if self.is_due(2, time_s, interval_s) {
            let mut tip = self.true_tip(time_s, frame);
            tip += Vec3::new(self.noise.next(), self.noise.next(), self.noise.next()) * (2.0 * TRACKER_NOISE);
            tip.x += if (from..to).contains(&time_s) { 0.25 } else { 0.0 };
            let pose = ToolReading { tip: Seen::Absolute(tip), direction: None, covariance: None };
            self.underway = Some((time_s + delay_s, reading(now, Body::Tool(pose))));
        }
        let [from, to] = self.scale_silent_s;
        if self.is_due(3, time_s, SCALE_S) && !(from..to).contains(&time_s) {
            let value = 0.006 * (0.2 * time_s).sin() + 0.0002 * self.noise.next();
            let scale = self.estimator.sensor("scale").expect("in the machine file");
            self.estimator.on_reading(now, scale, &reading(now, Body::Value { value, unit: None }));
        }
    }

    /// The tip in W where the encoders are, with a ram that has moved since the survey and drifts on, mm.
    fn true_tip(&self, time_s: f64, frame: &Position) -> Vec3 {
        let at = |position: &AxisArray| Pose { tool_tip: self.tip, ..Pose::at(*position) };
        let nominal = self.model.nominal_tool(&at(&frame.actual)).tip;
        let mut pose = at(&frame.commanded);
        for (channel, name) in self.model.sensors().iter().enumerate() {
            pose.live[channel] = match name.as_ref() {
                "ram.exz" => 0.018 + 0.0004 * time_s,
                "ram.eyz" => -0.012,
                "ram.ezz" => 0.009 - 0.0003 * time_s,
                _ => 0.006 * (0.2 * time_s).sin(),
            };
        }
        nominal + self.model.deviation(&pose).position
    }
}

fn reading(now: MonoTime, body: Body) -> Reading {
    Reading { stamp_ns: now.ns + SENSOR_CLOCK_NS, quality: 1.0, body }
}
