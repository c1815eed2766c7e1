//! The estimator thread: beside the cycle, never in its way.

use std::path::PathBuf;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use crossbeam_channel::{Receiver, Sender, bounded};
use tracing::{info, warn};

use super::super::models::Prepared;
use super::super::recorder::HealthSlot;
use super::changes::{log_map, log_thermal};
use super::configured::ConfiguredSensor;
use super::cycle_end::{EstimatorEnd, Motion};
use super::follower::Follower;
use super::lock_step::EstimatorTime;
use super::map_writer::{Saving, Writer};
use super::{Arrived, Lost, Note, checkpoint};
use crate::sensor_status::{FilterStatus, code_of, growth_code};
use volcomp_config::SensorsConfig;
use volcomp_engine::fault::Code;
use volcomp_estimate::live::{
    Body, LiveError, LiveEstimator, LiveModel, LiveSpec, LiveTable, MapCondition, ThermalStatus,
};
use volcomp_estimate::{self as estimate};
use volcomp_model::geometry::Vec3;
use volcomp_units::MonoTime;
use volcomp_units::axes::AxisName;

/// Readings in flight.
const READINGS: usize = 4096;
/// Orders in flight.
const ORDERS: usize = 16;
/// Warnings that the service has not counted yet.
const WARNINGS: usize = 1024;
/// Pause between two looks at the queues.
const POLL: Duration = Duration::from_millis(4);
/// Time for readings in one round; what comes on top of it is left out, so that tables, states and positions never wait
/// for readings.
const ROUND_S: f64 = 0.02;
/// An overload counts as over after this time without a reading that was left out, s.
const RELIEF_S: f64 = 10.0;
/// Interval at which what the disk has not taken is written again, s; `keep-s` where that is shorter.
const RETRY_S: f64 = 5.0;
/// Patience with the disk where another model is loaded.
const SWITCH_LIMIT: Duration = Duration::from_secs(1);
/// Interval of new tables, s.
const TABLE_S: f64 = 0.05;
/// The same where a sensor has told a live value meanwhile: no value grows older than it must on its way.
const FRESH_TABLE_S: f64 = 0.01;
/// Interval of health reports, s.
const HEALTH_S: f64 = 0.2;
/// Interval at which health goes into the recording, s.
const RECORD_S: f64 = 1.0;
/// Time for the last word when the daemon ends.
const FINISH_LIMIT: Duration = Duration::from_secs(3);

/// What the service asks of the estimator.
#[derive(Debug)]
pub(crate) enum Order {
    /// Another model is in use.
    Model(Arc<Prepared>),
    /// A map goes back to the offline map.
    Forget(String, Sender<Forgotten>),
    /// The daemon ends.
    End,
}

/// What has become of an order to forget a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Forgotten {
    /// It is done, and handed to the disk under this number.
    Done(u64),
    /// No map has this name.
    NoSuchMap,
    /// There is no live estimation with the model in use.
    Unused,
}

/// The estimator, seen from the service.
#[derive(Debug)]
pub(crate) struct Sensors {
    orders: Sender<Order>,
    ended: Receiver<()>,
    health: Arc<Mutex<FilterStatus>>,
    /// Of what was learned; `None` where it is not written anywhere.
    saving: Option<Saving>,
    warnings: Receiver<(Code, String)>,
    pub(crate) readings: Sender<Arrived>,
    pub(crate) lost: Arc<Lost>,
    pub(crate) known: Arc<[ConfiguredSensor]>,
}

/// What the estimator starts with.
#[derive(Debug)]
pub(crate) struct Start {
    pub(crate) config: SensorsConfig,
    pub(crate) machine: String,
    pub(crate) model: Arc<Prepared>,
    /// The state directory.
    pub(crate) directory: Option<PathBuf>,
    /// Where health goes into the recording.
    pub(crate) record: Option<Arc<HealthSlot>>,
    pub(crate) end: EstimatorEnd,
    pub(crate) time: EstimatorTime,
}

/// An estimator for a model in use.
pub(crate) fn estimator(spec: &LiveSpec, model: &Prepared) -> Result<LiveEstimator, LiveError> {
    let of = LiveModel {
        spec: &model.spec,
        thermal: &model.thermal,
        model: Arc::clone(&model.model),
        hash: hash_of(model),
    };
    LiveEstimator::new(spec, of)
}

/// Hash of a model's file, as the cycle knows it.
pub(crate) fn hash_of(model: &Prepared) -> [u8; 32] {
    *blake3::hash(model.text.as_bytes()).as_bytes()
}

impl Sensors {
    /// Starts the thread. Sensors that do not fit the model are reported and ignored.
    pub(crate) fn start(start: Start) -> std::io::Result<Self> {
        let (orders, order_receiver) = bounded(ORDERS);
        let (readings, reading_receiver) = bounded(READINGS);
        let (end, ended) = bounded::<()>(1);
        let (warning_sender, warnings) = bounded(WARNINGS);
        let health = Arc::new(Mutex::new(FilterStatus::default()));
        let lost = Arc::<Lost>::default();
        let known: Arc<[ConfiguredSensor]> =
            start.config.spec.sensors.iter().map(ConfiguredSensor::new).collect();
        let shared = Shared {
            known: Arc::clone(&known),
            health: Arc::clone(&health),
            warnings: warning_sender,
            lost: Arc::clone(&lost),
        };
        let worker = Worker::new(start, order_receiver, reading_receiver, shared)?;
        let saving = worker.writer.as_ref().map(Writer::saving);
        std::thread::Builder::new().name("volcomp-live".to_owned()).spawn(move || {
            let _end = end;
            worker.run();
        })?;
        Ok(Self { orders, ended, health, saving, warnings, readings, lost, known })
    }

    /// How it goes.
    pub(crate) fn health(&self) -> FilterStatus {
        let mut health = self.lock_health().clone();
        health.dropped = self.lost.dropped.load(Relaxed);
        health.refused = self.lost.refused.load(Relaxed);
        health
    }

    fn lock_health(&self) -> MutexGuard<'_, FilterStatus> {
        self.health.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What is wrong for as long as it lasts, beside what sensors and maps say themselves.
    pub(crate) fn lasting(&self) -> Vec<(Code, String)> {
        self.lock_health().lasting.clone()
    }

    /// What becomes of what was learned on its way to the disk; `None` where it is not written anywhere.
    pub(crate) const fn saving(&self) -> Option<&Saving> {
        self.saving.as_ref()
    }

    /// Every warning since the last call, however short it was: its number, and what it is about.
    pub(crate) fn warnings(&self) -> impl Iterator<Item = (Code, String)> + '_ {
        self.warnings.try_iter().take(WARNINGS)
    }

    /// Another model is in use.
    pub(crate) fn model(&self, model: &Arc<Prepared>) {
        if self.orders.try_send(Order::Model(Arc::clone(model))).is_err() {
            warn!(
                "the estimator does not take orders; live estimation stays with the model before and is not used"
            );
        }
    }

    /// Has a map forgotten; `None` where the estimator does not answer.
    pub(crate) fn forget(&self, name: &str) -> Option<Receiver<Forgotten>> {
        let (answer, answered) = bounded(1);
        self.orders.try_send(Order::Forget(name.to_owned(), answer)).ok()?;
        Some(answered)
    }

    /// Waits until what was learned is kept; gives up where the disk does not answer.
    pub(crate) fn finish(&self) {
        let _ = self.orders.try_send(Order::End);
        if self.ended.recv_timeout(FINISH_LIMIT) == Err(crossbeam_channel::RecvTimeoutError::Timeout) {
            warn!("what sensors taught is not kept within {} s", FINISH_LIMIT.as_secs());
        }
    }
}

/// What the service and the listener see, too.
pub(super) struct Shared {
    known: Arc<[ConfiguredSensor]>,
    health: Arc<Mutex<FilterStatus>>,
    warnings: Sender<(Code, String)>,
    lost: Arc<Lost>,
}

impl Shared {
    /// Has a warning counted; a queue that is full costs the count, the log has it all the same.
    pub(super) fn count(&self, code: Code, about: impl Into<String>) {
        let _ = self.warnings.try_send((code, about.into()));
    }
}

/// More readings than there is time for.
#[derive(Debug, Default)]
struct Overload {
    /// Readings that found the queue full, as counted last.
    dropped: u64,
    /// When one was left out last, while that is going on.
    since: Option<MonoTime>,
}

struct Worker {
    start: Start,
    orders: Receiver<Order>,
    readings: Receiver<Arrived>,
    shared: Shared,
    writer: Option<Writer>,
    /// Why what was learned is not on the disk.
    unsaved: Option<String>,
    overload: Overload,
    estimator: Option<LiveEstimator>,
    follower: Follower,
    /// Tables that the cycle may still hold.
    sent: Vec<Arc<LiveTable>>,
    /// What the start with this model has found.
    notes: Vec<Note>,
    statuses: Vec<estimate::SensorStatus>,
    map_states: Vec<MapCondition>,
    growths: Vec<ThermalStatus>,
    tabled: MonoTime,
    /// A sensor has told a live value since the last table.
    is_fresh: bool,
    recorded: MonoTime,
    told: MonoTime,
    /// By the computer's clock, as the disk's time is.
    kept: Instant,
}

impl Worker {
    fn new(
        start: Start,
        orders: Receiver<Order>,
        readings: Receiver<Arrived>,
        shared: Shared,
    ) -> std::io::Result<Self> {
        let now = start.time.now();
        let writer = start.directory.as_deref().map(Writer::start).transpose()?;
        let mut worker = Self {
            orders,
            readings,
            shared,
            writer,
            unsaved: None,
            overload: Overload::default(),
            estimator: None,
            follower: Follower::default(),
            sent: Vec::new(),
            notes: Vec::new(),
            statuses: Vec::new(),
            map_states: Vec::new(),
            growths: Vec::new(),
            tabled: now,
            is_fresh: false,
            recorded: now,
            told: now,
            kept: Instant::now(),
            start,
        };
        worker.take_model();
        worker.show(now);
        Ok(worker)
    }

    /// Begins anew with the model that is in use.
    fn take_model(&mut self) {
        let model = &self.start.model;
        self.notes.clear();
        self.statuses.clear();
        self.map_states.clear();
        self.growths.clear();
        match estimator(&self.start.config.spec, model) {
            Ok(mut estimator) => {
                if let Some(directory) = &self.start.directory {
                    let of = (self.start.machine.as_str(), model.hash.as_str());
                    let is_behind = self.writer.as_ref().is_some_and(Writer::is_behind);
                    let now = SystemTime::now();
                    self.notes.extend(checkpoint::restore(directory, of, &mut estimator, now, is_behind));
                } else if estimator.learns() {
                    self.notes
                        .push(Note::plain("no state directory: the maps are lost when the daemon ends"));
                }
                for known in self.shared.known.iter() {
                    known.set_unit(
                        estimator.units().find(|(name, _)| *name == known.name).map(|(_, unit)| unit),
                    );
                }
                self.estimator = Some(estimator);
            }
            Err(problem) => {
                let text = format!("no live estimation with this model: {problem}");
                self.notes.push(Note::numbered(Code::LIVE_UNUSED, text));
                self.shared.known.iter().for_each(|known| known.set_unit(None));
                self.estimator = None;
            }
        }
        for note in &self.notes {
            if let Some(code) = note.code {
                warn!("{note}");
                self.shared.count(code, note.text.clone());
            } else {
                info!("{note}");
            }
        }
        self.fit();
    }

    fn fit(&mut self) {
        let names: Vec<AxisName> = self.start.model.model.axes().map(|a| a.name).collect();
        self.follower.fit(&names);
    }

    fn run(mut self) {
        loop {
            let ends = self.take_orders();
            let waited_for = self.take_motions();
            if !ends && !waited_for && self.start.end.lock_step.is_some() {
                // no time passes before the next frame
                continue;
            }
            self.take_readings();
            let now = self.start.time.now();
            if let Some(estimator) = &mut self.estimator {
                estimator.tick(now);
            }
            self.log_changes();
            let interval = if self.is_fresh { FRESH_TABLE_S } else { TABLE_S };
            if now.seconds_since(self.tabled) >= interval {
                (self.tabled, self.is_fresh) = (now, false);
                self.hand_over(now);
            }
            if now.seconds_since(self.told) >= HEALTH_S {
                self.told = now;
                self.look_at_the_disk();
                self.show(now);
            }
            if now.seconds_since(self.recorded) >= RECORD_S {
                self.recorded = now;
                self.record(now);
            }
            if ends {
                self.finish();
                return;
            }
            if self.kept.elapsed().as_secs_f64() >= self.keep_s() {
                self.keep();
            }
            match &self.start.end.lock_step {
                Some(lock_step) => lock_step.tell(now),
                None => std::thread::sleep(POLL),
            }
        }
    }

    /// True where the daemon ends.
    fn take_orders(&mut self) -> bool {
        while let Ok(order) = self.orders.try_recv() {
            match order {
                Order::End => return true,
                Order::Model(model) => {
                    self.keep();
                    // what is put back next is read from the same file
                    if self.writer.as_ref().is_some_and(|writer| !writer.wait(SWITCH_LIMIT)) {
                        warn!("what sensors taught with the model before is not on the disk yet");
                    }
                    self.start.model = model;
                    self.take_model();
                }
                Order::Forget(name, answer) => {
                    let _ = answer.try_send(self.forget(&name));
                }
            }
        }
        false
    }

    /// A map goes back to the offline map, and what is kept is replaced: a restart must not continue the map.
    fn forget(&mut self, name: &str) -> Forgotten {
        match self.estimator.as_mut().map(|estimator| estimator.forget(name)) {
            None => Forgotten::Unused,
            Some(false) => Forgotten::NoSuchMap,
            Some(true) => {
                info!(map = name, "the map restarts from the offline map");
                Forgotten::Done(self.keep())
            }
        }
    }

    /// True where a frame waits.
    fn take_motions(&mut self) -> bool {
        let end = &self.start.end;
        let first = end.lock_step.as_ref().and_then(|_| end.motions.recv_timeout(POLL).ok());
        let mut waited_for = false;
        let mut next = first.or_else(|| self.start.end.motions.try_recv().ok());
        while let Some(motion) = next {
            match motion {
                Motion::Axes { axes } => {
                    self.follower = Follower::new(axes);
                    self.fit();
                }
                Motion::Down => {
                    if let Some(estimator) = &mut self.estimator {
                        estimator.on_link_down();
                    }
                }
                Motion::Tool(tip) => {
                    self.follower.tip = Some(Vec3::from(tip)).filter(|t| t.iter().all(|v| v.is_finite()));
                }
                Motion::At { now, control_ns, commanded, actual } => {
                    let sample = self.follower.sample(now, control_ns, &commanded, &actual);
                    if let Some((sample, estimator)) = sample.zip(self.estimator.as_mut()) {
                        estimator.on_motion(sample);
                    }
                    waited_for = true;
                }
            }
            next = self.start.end.motions.try_recv().ok();
        }
        waited_for
    }

    /// Readings of maps for as long as this round has time, of which the others only count as heard; what tells a value costs nothing
    /// and must not grow old behind them.
    fn take_readings(&mut self) {
        let begin = self.start.time.now();
        let mut left_out = false;
        for Arrived { now, sensor, reading } in self.readings.try_iter().take(READINGS) {
            let Some(estimator) = &mut self.estimator else { continue };
            let Some(sensor) = estimator.sensor(&sensor) else { continue };
            let is_of_map = matches!(reading.body, Body::Tool(_) | Body::Points(_) | Body::Deviation { .. });
            if is_of_map && (left_out || self.start.time.now().seconds_since(begin) > ROUND_S) {
                left_out = true;
                estimator.skip(now, sensor);
            } else {
                estimator.on_reading(now, sensor, &reading);
                self.is_fresh |= !is_of_map;
            }
        }
        self.log_overload(begin, left_out);
    }

    fn log_overload(&mut self, now: MonoTime, left_out: bool) {
        let dropped = self.shared.lost.dropped.load(Relaxed);
        let left_out = left_out || dropped > self.overload.dropped;
        self.overload.dropped = dropped;
        match self.overload.since {
            None if left_out => {
                let code = Code::ESTIMATOR_OVERLOADED;
                warn!(%code, "the estimator does not keep up with its sensors; readings are left out");
            }
            Some(since) if !left_out && now.seconds_since(since) > RELIEF_S => {
                info!("the estimator keeps up with its sensors again");
                self.overload.since = None;
            }
            _ => {}
        }
        if left_out {
            self.overload.since = Some(now);
        }
    }

    /// Changes of sensors and maps go into the log.
    fn log_changes(&mut self) {
        let Some(estimator) = &self.estimator else { return };
        let statuses: Vec<estimate::SensorStatus> = estimator.sensor_statuses().map(|(_, s)| s).collect();
        for (k, (name, status)) in estimator.sensor_statuses().enumerate() {
            let before = self.statuses.get(k).copied().unwrap_or(estimate::SensorStatus::Waiting);
            match status {
                _ if before == status => {}
                estimate::SensorStatus::Good => info!(sensor = name, "the sensor is believed"),
                estimate::SensorStatus::Waiting => {}
                estimate::SensorStatus::Excluded(sensor_fault) => {
                    let (code, cause) = (code_of(sensor_fault), sensor_fault.name());
                    warn!(sensor = name, cause, %code, "the sensor is excluded");
                    self.shared.count(code, name);
                }
            }
        }
        let states: Vec<MapCondition> = estimator.map_states().map(|(_, status)| status).collect();
        for (k, (name, status)) in estimator.map_states().enumerate() {
            log_map(name, self.map_states.get(k).copied().unwrap_or_default(), status, &self.shared);
        }
        let growths: Vec<ThermalStatus> = estimator.thermal_statuses().map(|(_, s, _)| s).collect();
        for (k, (name, status, input)) in estimator.thermal_statuses().enumerate() {
            let before = self.growths.get(k).copied().unwrap_or(ThermalStatus::Waiting(0));
            if before != status {
                log_thermal(name, status, input.unwrap_or_default());
                if let Some(code) = growth_code(status) {
                    self.shared.count(code, name);
                }
            }
        }
        (self.statuses, self.map_states, self.growths) = (statuses, states, growths);
    }

    /// A new table for the cycle.
    fn hand_over(&mut self, now: MonoTime) {
        // a table that only this thread holds is out of use; the newest may still be on its way
        self.sent.retain(|table| Arc::strong_count(table) > 1);
        let Some(estimator) = &mut self.estimator else { return };
        let table = Arc::new(estimator.table(now));
        if self.start.end.tables.try_send(Arc::clone(&table)).is_ok() {
            self.sent.push(table);
        }
    }

    fn show(&self, now: MonoTime) {
        let mut status = match &self.estimator {
            Some(estimator) => FilterStatus::new(&estimator.health(now)),
            None => FilterStatus::unused(&self.start.config.spec),
        };
        let overloaded = "the estimator does not keep up with its sensors".to_owned();
        status.lasting.extend(self.overload.since.map(|_| (Code::ESTIMATOR_OVERLOADED, overloaded)));
        status.lasting.extend(self.unsaved.clone().map(|text| (Code::COUNTERS_NOT_SAVED, text)));
        status.notes = self.notes.iter().map(Note::to_string).collect();
        status.notes.extend(status.lasting.iter().map(|(code, text)| format!("{code}: {text}")));
        *self.shared.health.lock().unwrap_or_else(PoisonError::into_inner) = status;
    }

    /// How it goes, for the recording.
    fn record(&self, now: MonoTime) {
        let Some((slot, estimator)) = self.start.record.as_ref().zip(self.estimator.as_ref()) else { return };
        // numbers and names always become text
        let text = serde_json::to_string(&FilterStatus::new(&estimator.health(now))).unwrap_or_default();
        slot.put(now, text);
    }

    /// What is to be kept; nothing where there is nothing.
    fn kept_text(&self) -> Option<Vec<u8>> {
        let estimator = self.estimator.as_ref().filter(|estimator| estimator.learns())?;
        let (machine, hash) = (&self.start.machine, &self.start.model.hash);
        // numbers and names always become text
        checkpoint::text(machine, hash, estimator, SystemTime::now()).ok()
    }

    /// Interval at which what was learned is kept, s.
    fn keep_s(&self) -> f64 {
        let keep_s = self.start.config.keep_s;
        if self.unsaved.is_some() { keep_s.min(RETRY_S) } else { keep_s }
    }

    /// Hands what was learned to the disk; gives its number.
    fn keep(&mut self) -> u64 {
        self.kept = Instant::now();
        let kept = self.writer.as_ref().zip(self.kept_text());
        kept.map_or(0, |(writer, text)| writer.write(text))
    }

    /// Whether the disk has taken what it was given last; changes go into the log.
    fn look_at_the_disk(&mut self) {
        let problem = self.writer.as_ref().and_then(Writer::problem);
        let unsaved = problem.map(|problem| format!("maps are not saved: {problem}"));
        match (&self.unsaved, &unsaved) {
            (None, Some(text)) => warn!(code = %Code::COUNTERS_NOT_SAVED, "{text}"),
            (Some(_), None) => info!("maps are saved again"),
            _ => {}
        }
        self.unsaved = unsaved;
    }

    /// The last word to the disk, however long that takes: the service does not wait for ever.
    fn finish(&mut self) {
        let last = self.kept_text();
        if let Some(writer) = self.writer.take() {
            writer.finish(last);
        }
    }
}
