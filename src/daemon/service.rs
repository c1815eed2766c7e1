//! The service's side of the channels: drains, logs with bounds, passes requests on.

mod logs;
mod retained_state;

use std::collections::{BTreeSet, VecDeque};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, SystemTime};

use tracing::{info, warn};
use volcomp_state::counters::FILE;

use super::audit::{self, Audit, AuditEntry};
use super::benefit::Benefit;
use super::channels::{LastOffset, Report, Request, ServiceChannels};
use super::clock::Clock;
use super::counters::{Tally, unknown};
use super::handshake;
use super::health::{health, mark_present};
use super::http::{LatencyTotals, Snapshot};
use super::latency::Histograms;
use super::link_end::LinkEnd;
use super::load::Loaded;
use super::logging::LogLimiter;
use super::model_errors::model_errors;
use super::models::guard::{self, Hindrance};
use super::models::{Keeping, Models, Prepared};
use super::rate_limited_warnings::RateLimitedWarnings;
use super::realtime;
use super::recent::Recent;
use super::recorder::Recorder;
use super::sensors::{MapStatus, Sensors};
use super::state_writer::StateWriter;
use super::status::Status;
use super::status_collector::StatusCollector;
use logs::{log_event, log_link_up, log_realtime};
use retained_state::RetentionState;
use volcomp_config::{MachineConfig, Policy};
use volcomp_engine::fault::{Code, reason_code};
use volcomp_engine::{Command, Event, ShadowScore, State};
use volcomp_units::MonoTime;

/// Records taken in one go, so that requests are never kept waiting by statistics.
const RECORDS_AT_ONCE: usize = 4096;
/// Interval at which the counters are kept, s.
const SAVE_S: f64 = 5.0;
/// Interval at which it is looked whether the model may still be used, s.
const LOOK_S: f64 = 1.0;

/// The service's view of the cycle thread.
#[derive(Debug)]
pub(super) struct Service {
    channels: ServiceChannels,
    status_collector: StatusCollector,
    tally: Tally,
    state_writer: StateWriter,
    recorder: Option<Recorder>,
    /// Live estimation, where there are sensors.
    pub(super) sensors: Option<Sensors>,
    models: Models,
    config: Arc<MachineConfig>,
    gain: f64,
    temperature: Option<(f64, MonoTime)>,
    /// An expired model was accepted by somebody.
    expired_accepted: bool,
    shadowing: bool,
    /// A model is being read and compared.
    loading: Arc<AtomicBool>,
    shadow: Option<(State, ShadowScore)>,
    clock: Clock,
    saved: MonoTime,
    looked: MonoTime,
    /// Number of the newest request.
    ticket: u64,
    retained: RetentionState,
    /// Requests that the cycle thread has not looked at, oldest first; a model among them is not freed there.
    waiting: VecDeque<(u64, Request)>,
    failures: LogLimiter,
    links: LogLimiter,
    events: LogLimiter,
    warnings: RateLimitedWarnings,
    recent: Recent,
    latency_totals: LatencyTotals,
    /// What the control kept of axes that are not listed when the last link ended.
    left_unlisted: Option<String>,
    benefit: Benefit,
    /// What lasted when it was looked at last.
    standing: BTreeSet<(Code, String)>,
}

impl Service {
    pub(super) fn new(
        loaded: Arc<Loaded>,
        channels: ServiceChannels,
        state_writer: StateWriter,
        recorder: Option<Recorder>,
        models: Models,
        clock: Clock,
    ) -> Result<Self, hdrhistogram::CreationError> {
        let config = &loaded.config;
        let file = state_writer.directory().map(|directory| directory.join(FILE).display().to_string());
        let mut tally = Tally::open(state_writer.recalled(), file, &config.machine, config.link.cycle_s);
        if let Some(note) = tally.note().filter(|_| state_writer.recalled().is_some()) {
            warn!("{note}");
        }
        if let Some(why) = &models.unknown {
            tally.retained_mut().hold.get_or_insert_with(|| unknown(why));
        }
        let retained = RetentionState::new(tally.retained());
        let gain = config.engine.gain;
        let config = Arc::new(config.clone());
        let mut status_collector = StatusCollector::new(loaded, Arc::clone(&channels.progress), clock)?;
        status_collector.model(&models.active.spec);
        let mut service = Self {
            models,
            config,
            gain,
            sensors: None,
            temperature: None,
            expired_accepted: false,
            shadowing: false,
            loading: Arc::default(),
            shadow: None,
            looked: clock.now(),
            channels,
            status_collector,
            tally,
            state_writer,
            recorder,
            clock,
            saved: clock.now(),
            ticket: 0,
            retained,
            waiting: VecDeque::new(),
            failures: LogLimiter::new(3, Duration::from_secs(60)),
            links: LogLimiter::new(10, Duration::from_secs(10)),
            events: LogLimiter::new(20, Duration::from_secs(1)),
            warnings: RateLimitedWarnings::new(clock.now()),
            recent: Recent::new(clock.now())?,
            latency_totals: LatencyTotals::default(),
            left_unlisted: None,
            benefit: Benefit::default(),
            standing: BTreeSet::new(),
        };
        service.count_found_at_start();
        service.recall();
        service.save();
        Ok(service)
    }

    /// Counts what the start has found in the state directory.
    fn count_found_at_start(&mut self) {
        let damaged = self.tally.note().filter(|_| self.state_writer.recalled().is_some());
        let notes = self.models.notes.iter().map(String::as_str).chain(damaged);
        let found = notes
            .filter_map(|note| note.split_once(": "))
            .filter_map(|(code, text)| Some((Code::parse(code)?, text)));
        let broken = self.state_writer.broken_audit().map(|text| (Code::AUDIT_BROKEN, text));
        for (code, text) in found.chain(broken) {
            self.recent.count(self.looked, code, 1, Some(text.to_owned()));
        }
    }

    /// Whether compensation is wanted.
    pub(super) fn is_wanted(&self) -> bool {
        self.channels.progress.wanted.load(Relaxed)
    }

    /// The one place for a model that is being read.
    pub(super) fn loading(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.loading)
    }

    /// The fault that is latched now, in a line.
    pub(super) fn latched(&self) -> Option<String> {
        self.status_collector.latched()
    }

    /// Why the fault that is latched now cannot be cleared yet.
    pub(super) fn not_clearable(&self) -> String {
        self.status_collector.not_clearable()
    }

    /// Position frames answered so far; `None` without a link.
    pub(super) fn frames(&self) -> Option<u64> {
        let progress = &self.channels.progress;
        progress.state().map(|_| progress.cycles.load(Relaxed))
    }

    /// Whether shadow mode is on.
    pub(super) const fn is_shadowing(&self) -> bool {
        self.shadowing
    }

    /// The machine file.
    pub(super) fn config(&self) -> Arc<MachineConfig> {
        Arc::clone(&self.config)
    }

    /// The models in use and before.
    pub(super) const fn models(&self) -> &Models {
        &self.models
    }

    /// The temperature of the machine, degrees Celsius.
    pub(super) fn set_temperature(&mut self, degc: f64) {
        self.temperature = Some((degc, self.clock.now()));
    }

    /// What speaks against compensating now.
    pub(super) fn hindrances(&self, accept_expired: bool) -> Vec<(Hindrance, Policy)> {
        self.hindrances_of(&self.models.active, accept_expired || self.expired_accepted)
    }

    /// What speaks against compensating with a model.
    pub(super) fn hindrances_of(&self, model: &Prepared, accept_expired: bool) -> Vec<(Hindrance, Policy)> {
        let now = self.clock.now();
        let temperature = self.temperature.map(|(degc, at)| (degc, now.seconds_since(at)));
        let expiry = model.expiry.as_deref().filter(|_| !accept_expired);
        guard::hindrances(&self.config.guard, expiry, SystemTime::now(), temperature)
    }

    /// That the model in use has expired was accepted; remembered only where it has.
    pub(super) fn accept_expiry(&mut self) {
        let expired = self.hindrances_of(&self.models.active, false).len();
        self.expired_accepted |= expired > self.hindrances_of(&self.models.active, true).len();
    }

    /// Another model may be taken into use: the recording has to know its text before.
    pub(super) fn announce(&self, model: &Prepared) {
        if let Some(recorder) = &self.recorder {
            recorder.models.put(&model.origin, &model.text);
        }
    }

    /// Another model is in use; gives what is to be written down about it, off this thread.
    pub(super) fn switched(
        &mut self,
        new: Arc<Prepared>,
        who: Option<String>,
        why: Option<String>,
    ) -> Keeping {
        info!(model = new.origin, hash = new.hash, who, why, "another model is in use");
        self.expired_accepted = false;
        self.benefit.reset();
        self.status_collector.model(&new.spec);
        if let Some(sensors) = &self.sensors {
            sensors.model(&new);
        }
        if realtime::lock_again(&self.config.realtime).is_refused() {
            warn!(code = %Code::REALTIME_REFUSED, "the new model could not be locked into memory (LimitMEMLOCK=)");
        }
        self.models.switched(new, who, why)
    }

    /// Something that should be known about the model in use.
    pub(super) fn note_model(&mut self, note: String) {
        warn!("{note}");
        self.models.notes.push(note);
    }

    /// Takes compensation out where the model may not be used any more and that is what was configured for it.
    fn look_after_the_model(&mut self) {
        self.looked = self.clock.now();
        if !self.is_wanted() {
            return;
        }
        let against = self.hindrances(false);
        let Some((hindrance, _)) = against.iter().find(|(_, policy)| *policy == Policy::RampOut) else {
            return;
        };
        warn!("compensation is ramped out: {hindrance}");
        let result =
            if self.request(Request::Engine(Command::Disable)).is_some() { "ordered" } else { "queue full" };
        self.audit_own("disable", hindrance.to_string(), result, None);
    }

    /// Writes an entry of the daemon's own to the audit log, with the model in use.
    fn audit_own(&self, what: &str, why: String, result: &str, detail: Option<String>) {
        let new_model = Some(self.model_hash().to_owned());
        let entry = AuditEntry { why: Some(why), new_model, detail, ..audit::own(what, result) };
        self.state_writer.audit.write(entry);
    }

    /// Takes in what the cycle thread has reported.
    fn drain_reports(&mut self) {
        while let Ok(report) = self.channels.reports.try_recv() {
            self.report(report);
        }
    }

    /// Takes in what the cycle thread has said since the last call.
    pub(super) fn drain(&mut self) {
        // reports first: a link that came up resets the statistics before its first record
        self.settle_all();
        for _ in 0..RECORDS_AT_ONCE {
            let Ok(record) = self.channels.records.try_recv() else { break };
            self.status_collector.record(&record);
            if record.answered {
                self.recent.record(&record);
                self.latency_totals.record(&record);
                self.tally.record(&record);
            }
        }
        if self.clock.now().seconds_since(self.saved) >= SAVE_S {
            self.save();
        }
        let now = self.clock.now();
        if now.seconds_since(self.looked) >= LOOK_S {
            self.look_after_the_model();
            // one value of the benefit a second
            let (axes, last) = (self.status_collector.axes(), self.status_collector.last());
            self.benefit.look(now, &self.models.active.model, &axes, last, self.gain);
            self.look_at_what_lasts(now);
        }
        if let Some(sensors) = &self.sensors {
            for (code, about) in sensors.warnings() {
                self.recent.count(now, code, 1, Some(about));
            }
        }
        self.recent.look(now, &self.channels.progress);
        let late = self.warnings.look(now, &self.channels.progress);
        if late > 0 {
            self.recent.count(now, Code::LATE_CYCLES, late, None);
        }
        if let Some(recorder) = &self.recorder {
            let lost = recorder.stats.dropped.load(std::sync::atomic::Ordering::Relaxed);
            let lost = self.warnings.look_at_recording(now, lost);
            if lost > 0 {
                self.recent.count(now, Code::RECORDS_LOST, lost, None);
            }
        }
    }

    /// What is wrong with state directory, recording and estimator for as long as it lasts, by number.
    fn what_lasts(&self) -> BTreeSet<(Code, String)> {
        let state = self.state_writer.problem().map(|text| (Code::COUNTERS_NOT_SAVED, text));
        let recording = self.recorder.as_ref().and_then(|recorder| recorder.stats.status().error);
        let recording = recording.map(|text| (Code::RECORDING_STOPPED, text));
        let estimator = self.sensors.iter().flat_map(Sensors::lasting);
        state.into_iter().chain(recording).chain(estimator).collect()
    }

    /// Counts by number what is newly wrong and lasts.
    fn look_at_what_lasts(&mut self, now: MonoTime) {
        let standing = self.what_lasts();
        for (code, text) in standing.difference(&self.standing) {
            self.recent.count(now, *code, 1, Some(text.clone()));
        }
        self.standing = standing;
    }

    pub(super) fn status(&mut self) -> Status {
        self.drain();
        let mut status = self.status_collector.status();
        let active = &self.models.active;
        (status.model, status.model_hash) = (active.origin.clone(), active.hash.clone());
        status.model_choice = self.models.status();
        status.model_choice.temperature_degc = self.config.guard.temperature_degc;
        status.gain = self.gain;
        status.start_inhibit = self.start_inhibit();
        status.temperature_degc = self.temperature.map(|(degc, _)| degc);
        status.hindrances = self.hindrances(false).iter().map(|(h, _)| h.to_string()).collect();
        status.shadow =
            self.shadow.filter(|_| self.shadowing).map(|(s, score)| self.status_collector.shadow(s, &score));
        status.lifetime = self.tally.lifetime(status.cycles, status.late_cycles);
        status.lifetime.audit_lines_lost = self.state_writer.audit.lost();
        // a disk that refuses now is told before what was found at the start
        let unkept = self.state_writer.problem().map(|text| format!("{}: {text}", Code::COUNTERS_NOT_SAVED));
        status.lifetime.note = unkept.or(status.lifetime.note);
        if let Some(sensors) = &self.sensors {
            let health = sensors.health();
            status.maps = health.maps.iter().map(MapStatus::brief).collect();
            (status.sensors, status.growths) = (health.sensors, health.growths);
            status.sensor_notes = health.notes;
            (status.readings_dropped, status.readings_refused) = (health.dropped, health.refused);
        }
        status.recording = self.recorder.as_ref().map(|recorder| recorder.stats.status());
        let now = self.clock.now();
        status.recent = self.recent.status(now);
        let lasting = self.what_lasts();
        mark_present(&mut status, &lasting);
        status.events = self.recent.events(now);
        status.benefit = self.benefit.status();
        status.model_errors = model_errors(&self.models.active.spec);
        status.records_dropped += status.recording.as_ref().map_or(0, |recording| recording.records_dropped);
        status.health = health(&status, &lasting);
        status
    }

    /// All that the HTTP service shows.
    pub(super) fn snapshot(&mut self) -> Snapshot {
        let status = self.status();
        let progress = &self.channels.progress;
        Snapshot {
            status,
            model: Arc::clone(&self.models.active),
            codes: self.recent.totals(),
            latency: self.latency_totals,
            limited_cycles: progress.limited.load(Relaxed),
            soft_limited_cycles: progress.at_soft_limit.load(Relaxed),
        }
    }

    /// Hash of the model in use.
    pub(super) fn model_hash(&self) -> &str {
        &self.models.active.hash
    }

    /// The audit log, for whoever does something that belongs into it.
    pub(super) const fn audit(&self) -> &Audit {
        &self.state_writer.audit
    }

    /// Has the counters kept.
    fn save(&mut self) -> u64 {
        self.saved = self.clock.now();
        let progress = &self.channels.progress;
        let (cycles, late) = (progress.cycles.load(Relaxed), progress.late.load(Relaxed));
        self.state_writer.save(self.tally.counters(cycles, late))
    }

    /// The last words before the daemon ends: what is left of the recording, the counters, a line in the audit log.
    pub(super) fn finish(&mut self, result: &str) {
        self.drain();
        if let Some(sensors) = &self.sensors {
            sensors.finish();
        }
        if let Some(recorder) = &self.recorder {
            recorder.finish();
        }
        self.save();
        self.state_writer.audit.write(audit::own("stop", result));
        self.state_writer.finish();
    }

    pub(super) fn histograms(&mut self) -> Histograms {
        self.drain();
        self.status_collector.histograms()
    }

    pub(super) fn headline(&self) -> String {
        self.status_collector.headline()
    }

    pub(super) fn state(&self) -> &'static str {
        self.status_collector.state()
    }

    fn report(&mut self, report: Report) {
        match report {
            Report::Realtime(report) => {
                self.status_collector.realtime(&report);
                log_realtime(&report);
                if report.has_refusal() {
                    self.recent.count(self.clock.now(), Code::REALTIME_REFUSED, 1, None);
                }
            }
            Report::ConnectFailed { error, pause } => {
                let text = error.to_string();
                if let Some(held_back) = self.failures.admit(self.clock.now()) {
                    let (retry_s, code) = (pause.as_secs_f64(), error.fault());
                    warn!(retry_s, %code, held_back, "no link: {text}");
                }
                self.recent.count(self.clock.now(), error.fault(), 1, Some(text.clone()));
                self.status_collector.connect_failed(error.fault(), text);
            }
            Report::LinkUp { address, hello } => {
                if let Some(held_back) = self.links.admit(self.clock.now()) {
                    log_link_up(&address, &hello, held_back);
                }
                self.tally.set_axes(handshake::announced(&hello).iter().map(|axis| axis.name).collect());
                self.status_collector.link_up(&hello);
            }
            Report::LinkDown { end, cycles } => {
                if let LinkEnd::Stopped { .. } = end {
                    info!(cycles, "link closed: {end}");
                } else {
                    let now = self.clock.now();
                    if let Some(held_back) = self.links.admit(now) {
                        warn!(cycles, code = %end.fault(), held_back, "link down: {end}");
                    }
                    self.recent.drop_out(now);
                    self.recent.count(now, end.fault(), 1, Some(end.to_string()));
                }
                self.left_unlisted = self.status_collector.left_unlisted();
                self.status_collector.link_down(end.fault(), end.to_string());
            }
            Report::Engine(event) => {
                // a fault is latched, so it cannot flood the log, and must not be held back by what came before
                let Event::StateChanged { to, reason, detail, .. } = event;
                let numbers = self.status_collector.numbers(detail.as_ref());
                self.recent.count(self.clock.now(), reason_code(reason), 1, numbers);
                let admitted = self.events.admit(self.clock.now());
                if let Some(held_back) = admitted.or_else(|| (to == State::Faulted).then_some(0)) {
                    log_event(&event, held_back, &self.status_collector);
                }
                self.fault(&event);
                self.status_collector.event(&event);
            }
            Report::Shadow(score) => self.shadow = score,
            Report::ServiceSilent => {
                self.recent.count(self.clock.now(), Code::SERVICE_SILENT, 1, None);
                self.was_silent();
            }
            Report::Stopped { offset: LastOffset::AtRest } => match self.left_unlisted.take() {
                None => info!("the offset is at its rest value"),
                Some(left) => warn!(
                    code = %Code::UNLISTED_OFFSET,
                    "the offset of every axis of the machine file is at its rest value; the control keeps those of others: \
                     {left}; list such an axis again with its limits to have it led to zero, or set it to zero at the control"
                ),
            },
            Report::Stopped { offset: LastOffset::Released } => {
                info!("a fault is latched, nothing was sent, and the control reports no offset");
            }
            Report::Stopped { offset: LastOffset::NoLink } => {
                info!("no link; a control that still holds an offset removes it by its own rule");
            }
            Report::Stopped { offset: LastOffset::OnItsWay } => {
                warn!("stopped before the offset was at its rest value; the control takes it out by itself");
            }
        }
    }
}
