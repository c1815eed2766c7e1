//! What the service has asked of the cycle thread, carried out between two cycles.

use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;

use super::channels::{CycleChannels, Report, Request, StopWish};
use super::handshake;
use super::link_session::LinkSession;
use super::sensors::LiveEnd;
use volcomp_config::{Interface, MachineConfig, StartMode};
use volcomp_engine::{Command, EngineConfig, EngineError, State};
use volcomp_model::Model;
use volcomp_protocol::ControlHello;
use volcomp_protocol::record::Entry;
use volcomp_units::MonoTime;

/// Time beyond ramp and rate limits that a clean stop may take.
const STOP_MARGIN_S: f64 = 2.0;
/// A clean stop never takes longer than this (the service unit's TimeoutStopSec lies above).
const STOP_LIMIT_S: f64 = 60.0;

/// How far a stop has got.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Stop {
    /// Nobody asked for one.
    No,
    /// Ramping out, at the latest until then.
    By(MonoTime),
    /// At once.
    Now,
}

/// What the service has asked for, and the channels to answer it.
#[derive(Debug)]
pub(super) struct Control {
    pub(super) channels: CycleChannels,
    pub(super) stop: Stop,
    stop_limit_s: f64,
    /// Gain asked for by the operator, where it is not the configured one.
    gain: Option<f64>,
    /// Whether the operator wants a shadow engine.
    shadow: bool,
    /// A fault of an earlier run that is latched in the first engine.
    kept_fault: bool,
    service: ServiceWatch,
    /// The model for the next engine.
    model: Arc<Model>,
    /// The cycle's end of live estimation.
    pub(super) live: Option<LiveEnd>,
}

impl Control {
    /// `permitted`: nothing speaks against compensating from the start, where that is configured.
    pub(super) fn new(channels: CycleChannels, config: &MachineConfig, start: Start) -> Self {
        let Start { model, permitted, kept_fault, live, service_silent_s } = start;
        let begins = config.start == StartMode::OnConnect && permitted && !kept_fault;
        channels.progress.wanted.store(begins, Relaxed);
        if kept_fault {
            channels.progress.set_state(State::Faulted);
        }
        let stop_limit_s = stop_limit_s(config);
        let service = ServiceWatch::new(service_silent_s);
        Self {
            channels,
            stop: Stop::No,
            stop_limit_s,
            gain: None,
            shadow: false,
            kept_fault,
            service,
            model,
            live,
        }
    }

    /// Carries out what signals and the service have asked for. Without an engine, orders are kept for the next one.
    ///
    /// # Cycle   no allocation, no lock, no panic
    pub(super) fn take_requests(&mut self, now: MonoTime, mut session: Option<&mut LinkSession>) {
        self.look_for_stop(now, session.as_deref_mut());
        self.look_after_service(now, session.as_deref_mut());
        while let Ok(ticket) = self.channels.requests.try_recv() {
            let late = now >= ticket.expires || self.service.is_silent();
            let refused = if late && !ticket.request.is_safe() {
                true
            } else {
                self.carry_out(now, ticket.request, session.as_deref_mut())
            };
            self.channels.progress.done(ticket.number, refused);
        }
    }

    /// True where the request was refused.
    fn carry_out(&mut self, now: MonoTime, request: Request, session: Option<&mut LinkSession>) -> bool {
        match request {
            Request::Engine(command) => self.order(now, command, session),
            Request::Model { model, hash } => self.take_model(now, (model, hash), session),
            Request::Shadow(on) => {
                self.shadow = on;
                if let Some(session) = session {
                    session.set_shadow(now, on);
                }
                self.channels.report(Report::Shadow(None));
                false
            }
        }
    }

    /// A command for the engine; true where it was refused.
    fn order(&mut self, now: MonoTime, command: Command, session: Option<&mut LinkSession>) -> bool {
        if let Command::SetGain(gain) = command {
            self.gain = Some(gain);
        }
        let progress = &self.channels.progress;
        let Some(session) = session else {
            // a new engine is off and at zero: what it would do is known
            match command {
                Command::Enable => progress.wanted.store(!self.kept_fault, Relaxed),
                Command::KeepFault => {
                    self.kept_fault = true;
                    progress.set_state(State::Faulted);
                    progress.wanted.store(false, Relaxed);
                }
                Command::Disable | Command::Stop => progress.wanted.store(false, Relaxed),
                // what the control holds is not known without a link
                Command::ClearFault | Command::SetGain(_) => {}
            }
            return matches!(command, Command::Enable | Command::ClearFault) && self.kept_fault;
        };
        session.command(now, command);
        self.kept_fault = session.engine().state() == State::Faulted;
        progress.set_state(session.engine().state());
        // the engine has the last word: a fault is not enabled, and only a fault at zero can be cleared
        progress.wanted.store(session.engine().is_enabled(), Relaxed);
        match command {
            Command::Enable => !session.engine().is_enabled(),
            Command::ClearFault => self.kept_fault,
            _ => false,
        }
    }

    /// A stop asked for by a signal: read here, so that it works whatever the service does.
    fn look_for_stop(&mut self, now: MonoTime, session: Option<&mut LinkSession>) {
        match (self.channels.progress.stop(), self.stop) {
            (StopWish::Now, _) => self.stop = Stop::Now,
            (StopWish::Clean, Stop::No) => {
                self.stop = Stop::By(now.plus_seconds(self.stop_limit_s));
                self.order(now, Command::Stop, session);
            }
            (StopWish::Clean | StopWish::No, _) => {}
        }
    }

    /// Nobody could switch compensation off while the service is silent: so it is switched off here.
    fn look_after_service(&mut self, now: MonoTime, session: Option<&mut LinkSession>) {
        let beats = self.channels.progress.service_beats.load(Relaxed);
        if self.service.look(now, beats) && self.channels.progress.wanted.load(Relaxed) {
            self.order(now, Command::Disable, session);
            self.channels.report(Report::ServiceSilent);
        }
    }

    /// The engine of now, and those to come, go on with another model; true where it does not fit.
    fn take_model(
        &mut self,
        now: MonoTime,
        (model, hash): (Arc<Model>, [u8; 32]),
        session: Option<&mut LinkSession>,
    ) -> bool {
        let next = Arc::clone(&model);
        if session.is_none()
            && let Some(tap) = &mut self.channels.tap
        {
            tap.send(&Entry::Model { now, hash });
        }
        if session.is_some_and(|session| session.switch_model(now, model, hash).is_err()) {
            return true;
        }
        self.model = next;
        if let Some(live) = &mut self.live {
            live.model(hash);
        }
        false
    }

    /// Tells a new engine what is wanted of it.
    fn brief(&self, now: MonoTime, session: &mut LinkSession) {
        if let Some(gain) = self.gain {
            session.command(now, Command::SetGain(gain));
        }
        if self.channels.progress.wanted.load(Relaxed) {
            session.command(now, Command::Enable);
        }
        if self.shadow {
            session.set_shadow(now, true);
        }
        if self.kept_fault {
            session.command(now, Command::KeepFault);
        }
    }

    /// An engine for the control that says `hello`: the present one where nothing about the control has changed.
    pub(super) fn prepare(
        &mut self,
        now: MonoTime,
        config: &EngineConfig,
        hello: &ControlHello,
        seat: &mut Option<(ControlHello, LinkSession)>,
    ) -> Result<(), EngineError> {
        if seat.as_ref().is_some_and(|(known, _)| same_machine(known, hello)) {
            return Ok(());
        }
        let mut session = LinkSession::new(config, Arc::clone(&self.model))?;
        if let Some((_, before)) = seat {
            session.succeed(before);
        }
        let of_the_old = seat.as_mut().and_then(|(_, session)| session.take_tap());
        if let Some(tap) = of_the_old.or_else(|| self.channels.tap.take()) {
            session.record_to(tap, now, hello);
        }
        self.kept_fault |= seat.as_ref().is_some_and(|(_, old)| old.engine().state() == State::Faulted);
        self.brief(now, &mut session);
        *seat = Some((*hello, session));
        Ok(())
    }

    /// Passes on what the newest cycle has changed, answered or not. The state first: whoever has read the event sees no older state.
    ///
    /// # Cycle   no allocation, no lock, no panic
    pub(super) fn report(&self, session: &mut LinkSession, answered: bool) {
        let event =
            if answered { session.output().and_then(|output| output.event) } else { session.take_event() };
        let progress = &self.channels.progress;
        progress.set_state(session.engine().state());
        progress.set_waits_for(session.engine().waits_for());
        // a fault ends the wish to compensate, until it is cleared and enabled again
        if session.engine().state() == State::Faulted {
            progress.wanted.store(false, Relaxed);
        }
        if let Some(event) = event {
            self.channels.report(Report::Engine(event));
        }
    }

    /// A link has come up.
    pub(super) fn link_up(&mut self, now: MonoTime, hello: &ControlHello, session: &mut LinkSession) {
        session.link_up(now);
        if let Some(live) = &mut self.live {
            live.link_up(hello);
        }
        self.channels.progress.set_state(session.engine().state());
        self.channels.progress.set_waits_for(None);
        self.channels.progress.set_link(true);
    }

    /// The link is gone.
    pub(super) fn link_down(&mut self, now: MonoTime, session: &mut LinkSession) {
        session.link_down(now);
        if let Some(live) = &mut self.live {
            live.link_down();
        }
        self.channels.progress.set_link(false);
        self.channels.progress.set_state(session.engine().state());
    }

    /// The model for the next engine.
    #[cfg(test)]
    pub(super) const fn model(&self) -> &Arc<Model> {
        &self.model
    }

    pub(super) fn stopping(&self) -> bool {
        self.stop != Stop::No
    }
}

/// The longest a clean stop may take: the ramp, or the largest offset at the lowest rate, whichever is longer; the more cycles
/// stand between two answers, the longer, for none moves the offset by more than two cycles.
fn stop_limit_s(config: &MachineConfig) -> f64 {
    let slowest = config.axes.iter().map(|a| a.limits.size / a.limits.rate).fold(0.0, f64::max);
    let stretched = match config.link.interface {
        Interface::Frames => 1.0,
        Interface::ReadWrite { poll_s } => (0.5 * poll_s / config.link.cycle_s).max(1.0),
    };
    (stretched * config.engine.ramp_s.max(slowest) + STOP_MARGIN_S).min(STOP_LIMIT_S)
}

/// Control time without a sign of life of the service after which compensation is switched off, s.
pub(super) const SERVICE_SILENT_S: f64 = 2.0;
/// The most that one turn counts as silence, s: a process that was stopped as a whole was not silent.
const SILENCE_STEP_S: f64 = 0.1;

/// The cycle thread's look at the service.
#[derive(Debug)]
struct ServiceWatch {
    /// s; 0 never.
    limit_s: f64,
    beats: u64,
    looked: Option<MonoTime>,
    silent_s: f64,
}

impl ServiceWatch {
    const fn new(limit_s: f64) -> Self {
        Self { limit_s, beats: 0, looked: None, silent_s: 0.0 }
    }

    /// True where the limit is passed at this look.
    fn look(&mut self, now: MonoTime, beats: u64) -> bool {
        let passed = self.looked.map_or(0.0, |looked| now.seconds_since(looked));
        self.looked = Some(now);
        if beats != self.beats {
            (self.beats, self.silent_s) = (beats, 0.0);
            return false;
        }
        let before = self.is_silent();
        self.silent_s += passed.clamp(0.0, SILENCE_STEP_S);
        !before && self.is_silent()
    }

    const fn is_silent(&self) -> bool {
        self.limit_s > 0.0 && self.silent_s >= self.limit_s
    }
}

/// How the cycle thread starts.
#[derive(Debug)]
pub(super) struct Start {
    /// The model in use.
    pub(super) model: Arc<Model>,
    /// Nothing speaks against compensating from the start.
    pub(super) permitted: bool,
    /// A fault of an earlier run is still latched.
    pub(super) kept_fault: bool,
    /// [`SERVICE_SILENT_S`]; 0 where nobody beats.
    pub(super) service_silent_s: f64,
    /// The cycle's end of live estimation, where there are sensors.
    pub(super) live: Option<LiveEnd>,
}

/// Whether the engine of one hello also fits the other: same axes in the same order, same cycle.
fn same_machine(a: &ControlHello, b: &ControlHello) -> bool {
    a.machine == b.machine && a.cycle_ns == b.cycle_ns && handshake::announced(a) == handshake::announced(b)
}

#[cfg(test)]
mod tests;
