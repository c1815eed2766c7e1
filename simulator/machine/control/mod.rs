//! The control's end of the link: a TCP server that sends positions and applies offsets.
//!
//! One cycle: take the motion's next position, add the offset in force, let the machine follow, send a position frame,
//! take corrections. In real time the cycles keep absolute deadlines; in lock step each position waits for its answer,
//! so that the same seed gives the same run. Behaviour on the link: `docs/reference/protocol-session.md`, sections 6 to 8.
//!
//! The motion stops where it is while an emergency stop is active or the drives are off, and goes on afterwards.

#![expect(clippy::disallowed_methods, reason = "a simulated control has sockets, threads and a clock")]

mod calls;
mod config;
mod error;
mod link;
mod machine;
mod offset;
mod record;
mod server;
mod summary;
mod wire;

use core::net::SocketAddr;
use core::time::Duration;
use std::sync::PoisonError;
use std::time::Instant;

use volcomp_protocol::{CloseReason, Correction, MachineState, Message, Position, Tool};
use volcomp_units::axes::{AxisArray, MAX_AXES};

use crate::motion::{MotionCycle, MotionSource};
use link::Link;
use offset::{OffsetStage, Verdict};
use server::Server;
use volcomp_monitor::SharedMonitor;

pub use config::{
    Absent, ConfigError, ControlConfig, Happening, Interface, OffsetConfig, OffsetLimits, Pacing,
    ScriptedEvent,
};
pub use error::{ControlError, LinkEnd, LinkEvent};
pub use machine::{IdealMachine, Machine};
pub use record::{CycleRecord, TraceWriter};
pub use summary::{Flow, Observer, RunSummary};
pub use wire::Wire;
pub use wire::{ControlIdentity, IdentityError, Insecure};

/// Positions further apart than this are no continuation, mm or deg.
const START_TOLERANCE: f64 = 1e-6;
/// So far behind its deadlines a real-time control starts counting anew.
const RESYNCHRONISE: Duration = Duration::from_secs(1);

type Listener = Box<dyn FnMut(&LinkEvent)>;

/// A simulated control that listens for a daemon.
pub struct Control {
    config: ControlConfig,
    server: Server,
    link: Option<Link>,
    offset: OffsetStage,
    listener: Option<Listener>,
    monitor: Option<SharedMonitor>,
    links: u64,
    state: MachineState,
    next_event: usize,
    cycle: u64,
    /// The cycle of the newest position that went to the daemon's side.
    newest: Option<u64>,
    cycle_ns: i64,
    present: MotionCycle,
    deadline: Option<Instant>,
    stalled: bool,
    summary: RunSummary,
}

impl Control {
    /// Sets the control up and listens.
    ///
    /// # Errors
    /// A configuration that makes no sense; an address that cannot be listened on.
    pub fn bind(mut config: ControlConfig) -> Result<Self, ControlError> {
        config.check()?;
        config.script.sort_by_key(|e| e.cycle);
        let cycle_ns = (config.cycle_s * 1e9).round() as i64;
        let hello = config.hello(cycle_ns.unsigned_abs());
        let server = Server::bind(config.listen, hello, config.tool, &config)?;
        let ready = if config.ready { MachineState::HOMED | MachineState::ENABLED } else { 0 };
        Ok(Self {
            server,
            link: None,
            offset: OffsetStage::new(&config.offset, &config.axes, config.cycle_s),
            listener: None,
            monitor: None,
            links: 0,
            state: MachineState::from_bits(ready),
            next_event: 0,
            cycle: 0,
            newest: None,
            cycle_ns,
            present: MotionCycle::default(),
            deadline: None,
            stalled: false,
            summary: RunSummary::default(),
            config,
        })
    }

    /// The address it listens on, with the real port.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.server.address
    }

    /// Has every link event told to a function, from within the run.
    pub fn set_listener(&mut self, listener: impl FnMut(&LinkEvent) + 'static) {
        self.listener = Some(Box::new(listener));
    }

    /// Has every position sent and every correction received from now on checked by a monitor.
    pub fn set_monitor(&mut self, monitor: SharedMonitor) {
        if self.link.is_some() {
            monitor.link_opened(self.links);
        }
        self.monitor = Some(monitor);
    }

    /// Puts the machine's commanded position somewhere, before the first run; the machine must stand there too.
    pub fn set_position(&mut self, position: AxisArray) {
        self.present = MotionCycle { commanded: position, ..MotionCycle::default() };
    }

    /// The commanded position.
    #[must_use]
    pub fn position(&self) -> AxisArray {
        self.present.commanded
    }

    /// Corrections are applied from now on, or only received.
    pub fn set_apply(&mut self, apply: bool) {
        self.config.apply = apply;
    }

    /// The state of the machine, without the bits that change with each cycle.
    #[must_use]
    pub fn state(&self) -> MachineState {
        self.state
    }

    /// Something happens to the machine now.
    pub fn happen(&mut self, what: Happening) {
        match what {
            Happening::Set(bits) => self.state.bits |= bits,
            Happening::Clear(bits) => self.state.bits &= !bits,
            Happening::Tool(tool) => {
                self.config.tool = Some(tool);
                *self.server.shared.tool.lock().unwrap_or_else(PoisonError::into_inner) = Some(tool);
                self.send(&Message::Tool(tool));
            }
        }
    }

    /// The tool that the control announces.
    #[must_use]
    pub fn tool(&self) -> Option<Tool> {
        self.config.tool
    }

    /// True while a daemon is connected.
    #[must_use]
    pub fn is_connected(&self) -> bool {
        self.link.is_some()
    }

    /// Waits until a daemon is connected and greeted.
    ///
    /// # Errors
    /// None came in time.
    pub fn wait_for_daemon(&mut self, limit: Duration) -> Result<(), ControlError> {
        if self.link.is_none() {
            let Some(link) = self.server.wait(limit) else {
                return Err(ControlError::NoDaemon { waited: limit });
            };
            self.adopt(link);
        }
        self.report_events();
        Ok(())
    }

    /// Runs a motion to its end, or until the observer has seen enough.
    ///
    /// # Errors
    /// The motion does not start where the machine stands; no daemon where one is waited for; the observer's own.
    pub fn run(
        &mut self,
        motion: &mut dyn MotionSource,
        machine: &mut dyn Machine,
        observer: Observer<'_>,
    ) -> Result<RunSummary, ControlError> {
        let (start, stands) = (motion.start(), self.present.commanded);
        for (k, axis) in self.config.axes.as_slice().iter().enumerate() {
            if (start[k] - stands[k]).abs() > START_TOLERANCE {
                return Err(ControlError::Start { axis: axis.name, start: start[k], stands: stands[k] });
            }
        }
        self.begin();
        loop {
            self.script();
            let moves = self.may_move();
            if moves {
                match motion.next_cycle() {
                    Some(next) => self.present = next,
                    None => break,
                }
            }
            let record = self.cycle(machine, moves)?;
            if observer(&record).map_err(ControlError::Observer)? == Flow::Stop {
                break;
            }
        }
        // what comes next stands still where the motion ended
        self.present = standstill(&self.present);
        Ok(self.finish())
    }

    /// Cycles at standstill until the observer has seen enough, at most so many seconds of simulated time.
    ///
    /// # Errors
    /// No daemon where one is waited for; the observer's own.
    pub fn run_until(
        &mut self,
        machine: &mut dyn Machine,
        limit_s: f64,
        observer: Observer<'_>,
    ) -> Result<RunSummary, ControlError> {
        self.begin();
        self.present = standstill(&self.present);
        let first = self.cycle;
        while ((self.cycle - first) as f64) * self.config.cycle_s < limit_s {
            self.script();
            let record = self.cycle(machine, false)?;
            if observer(&record).map_err(ControlError::Observer)? == Flow::Stop {
                break;
            }
        }
        Ok(self.finish())
    }

    /// Cycles at standstill for so many seconds of simulated time.
    ///
    /// # Errors
    /// No daemon where one is waited for.
    pub fn dwell(&mut self, machine: &mut dyn Machine, seconds: f64) -> Result<RunSummary, ControlError> {
        self.run_until(machine, seconds, &mut |_| Ok(Flow::GoOn))
    }

    /// Keeps the link alive for so long without any cycle (a control that starts up, or whose user thinks).
    pub fn idle(&mut self, time: Duration) {
        let end = Instant::now() + time;
        loop {
            self.take_link();
            self.drain_messages();
            let time_ns = self.time_ns();
            self.on_link(|link| link.keep_alive(time_ns));
            self.report_events();
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return;
            }
            std::thread::sleep(left.min(Duration::from_millis(10)));
        }
    }

    /// Ends the link in order; the control goes on listening until it is dropped.
    pub fn close(&mut self) {
        self.take_link();
        if let Some(link) = self.link.take() {
            link.close(CloseReason::Shutdown);
        }
        self.report_events();
    }

    /// The control is gone without a word, as after a power cut: its connection is reset.
    pub fn vanish(mut self) {
        self.take_link();
        if let Some(link) = self.link.take() {
            link.abort();
        }
    }

    fn begin(&mut self) {
        self.summary = RunSummary::default();
        self.deadline = None;
    }

    fn finish(&mut self) -> RunSummary {
        self.report_events();
        self.summary.duration_s = self.summary.cycles as f64 * self.config.cycle_s;
        self.summary
    }

    fn may_move(&self) -> bool {
        self.state.is_ready()
    }

    fn time_ns(&self) -> i64 {
        i64::try_from(self.cycle).unwrap_or(i64::MAX).saturating_mul(self.cycle_ns)
    }

    /// What the script says about this cycle.
    fn script(&mut self) {
        while let Some(event) = self.config.script.get(self.next_event).filter(|e| e.cycle <= self.cycle) {
            let what = event.what;
            self.next_event += 1;
            self.happen(what);
        }
    }

    /// One cycle with the present position.
    fn cycle(&mut self, machine: &mut dyn Machine, moves: bool) -> Result<CycleRecord, ControlError> {
        let lock_step = match self.config.pacing {
            Pacing::RealTime => {
                self.keep_deadline();
                self.take_link();
                None
            }
            Pacing::LockStep { answer_timeout, absent } => {
                self.take_link();
                if let (None, Absent::Wait(limit)) = (&self.link, absent) {
                    self.wait_for_daemon(limit)?;
                }
                Some(answer_timeout)
            }
        };
        let mut correction = if lock_step.is_none() { self.drain_messages() } else { None };
        let mut present = self.present;
        if !moves {
            present = MotionCycle { moving: false, scored: false, feed_mm_per_min: 0.0, ..present };
        }
        let off = !self.state.has(MachineState::ENABLED) || self.state.has(MachineState::ESTOP);
        let mut applied = self.offset.advance(self.cycle, &present.commanded, !off);
        if !self.config.apply {
            applied.offset = [0.0; MAX_AXES];
        }
        let sample = self.move_machine(machine, &present, &applied.offset);
        let state = self.state_of(&present, &applied);
        let position = Position {
            sequence: sequence(self.cycle),
            control_ns: self.time_ns(),
            state,
            feed_mm_per_min: present.feed_mm_per_min,
            commanded: present.commanded,
            actual: sample.encoder,
            applied: applied.offset,
        };
        self.send(&Message::Position(position));
        self.newest = Some(self.cycle);
        if let Some(limit) = lock_step {
            correction = self.await_answer(limit);
        }
        self.report_events();
        let record = CycleRecord {
            sequence: position.sequence,
            cycle: self.cycle,
            time_s: self.cycle as f64 * self.config.cycle_s,
            commanded: present.commanded,
            applied: applied.offset,
            correction,
            sample,
            state,
            feed_mm_per_min: present.feed_mm_per_min,
            scored: present.scored,
            connected: self.link.is_some(),
            line: present.line,
        };
        self.count(&applied);
        self.cycle += 1;
        Ok(record)
    }

    fn move_machine(
        &self,
        machine: &mut dyn Machine,
        present: &MotionCycle,
        offset: &AxisArray,
    ) -> crate::truth::Sample {
        let base = present.measured.unwrap_or(present.commanded);
        let mut target = base;
        for (value, offset) in target.iter_mut().zip(offset) {
            *value += offset;
        }
        match present.measured {
            Some(_) => machine.step_measured(self.config.cycle_s, &target),
            None => machine.step(self.config.cycle_s, &target),
        }
    }

    fn state_of(&self, present: &MotionCycle, applied: &offset::Applied) -> MachineState {
        let mut bits = self.state.bits;
        for (on, bit) in [
            (present.moving, MachineState::MOVING),
            (applied.limited, MachineState::OFFSET_LIMITED),
            (applied.ramping_out, MachineState::OFFSET_RAMPING_OUT),
        ] {
            if on {
                bits |= bit;
            }
        }
        MachineState::from_bits(bits)
    }

    fn count(&mut self, applied: &offset::Applied) {
        self.summary.cycles += 1;
        self.summary.limited += u64::from(applied.limited);
        self.summary.ramping_out += u64::from(applied.ramping_out);
        for (largest, offset) in self.summary.largest_offset.iter_mut().zip(applied.offset) {
            *largest = largest.max(offset.abs());
        }
    }

    /// Sleeps until this cycle is due.
    fn keep_deadline(&mut self) {
        let period = Duration::from_nanos(self.cycle_ns.unsigned_abs());
        let now = Instant::now();
        let due = self.deadline.map_or(now, |d| d + period);
        self.deadline = Some(due);
        if let Some(early) = due.checked_duration_since(now) {
            std::thread::sleep(early);
            return;
        }
        let behind = now.duration_since(due);
        if behind > period {
            self.summary.late += 1;
        }
        if behind > RESYNCHRONISE {
            self.deadline = Some(now);
        }
    }

    /// Takes over a daemon that was greeted meanwhile.
    fn take_link(&mut self) {
        if self.link.is_none()
            && let Some(link) = self.server.link()
        {
            self.adopt(link);
        }
    }

    fn adopt(&mut self, link: Link) {
        self.offset.link_opened();
        self.stalled = false;
        self.links += 1;
        if let Some(monitor) = &self.monitor {
            monitor.link_opened(self.links);
        }
        self.link = Some(link);
    }

    /// Uses the link; ends it where that fails.
    fn on_link<T>(&mut self, action: impl FnOnce(&mut Link) -> Result<T, LinkEnd>) -> Option<T> {
        match action(self.link.as_mut()?) {
            Ok(value) => Some(value),
            Err(end) => {
                self.end_link(end);
                None
            }
        }
    }

    fn end_link(&mut self, end: LinkEnd) {
        if let Some(link) = self.link.take() {
            self.summary.links_ended += 1;
            link.end(end);
            self.report(&LinkEvent::Ended(end));
        }
    }

    fn send(&mut self, message: &Message) {
        let before = self.link.as_ref().map_or(0, |l| l.left_out);
        self.on_link(|link| link.send(message));
        let Some(link) = &self.link else { return };
        let left_out = link.left_out - before;
        self.summary.left_out += left_out;
        if let (Message::Position(frame), Some(monitor), 0) = (message, &self.monitor, left_out) {
            monitor.position(self.links, frame);
        }
    }

    /// Takes all messages that are there; the last correction.
    fn drain_messages(&mut self) -> Option<Correction> {
        let mut last = None;
        while let Some(Some(message)) = self.on_link(|link| link.receive(Duration::ZERO)) {
            last = self.message(&message).or(last);
        }
        last
    }

    /// Waits for the answer to the position just sent.
    fn await_answer(&mut self, limit: Duration) -> Option<Correction> {
        let mut last = None;
        // a daemon that left one position unanswered is not waited for longer than the cycle, until it answers again
        let period = Duration::from_nanos(self.cycle_ns.unsigned_abs());
        let limit = if self.stalled { limit.min(period) } else { limit };
        let deadline = Instant::now() + limit;
        self.link.as_ref()?;
        loop {
            let left = deadline.saturating_duration_since(Instant::now()).max(Duration::from_micros(1));
            // the same limit every time spares the system call that sets it
            let wait = if left > limit / 2 { limit } else { left };
            match self.on_link(|link| link.receive(wait)) {
                Some(Some(message)) => {
                    let correction = self.message(&message);
                    last = correction.or(last);
                    if correction.is_some_and(|c| c.sequence == sequence(self.cycle)) {
                        self.stalled = false;
                        return last;
                    }
                }
                Some(None) => {}
                None => return last,
            }
            if Instant::now() >= deadline {
                self.summary.unanswered += 1;
                self.stalled = true;
                return last;
            }
        }
    }

    /// What a message of the daemon means; a correction where it is one.
    fn message(&mut self, message: &Message) -> Option<Correction> {
        match message {
            Message::Correction(correction) => {
                if let Some(monitor) = &self.monitor {
                    monitor.correction(self.links, correction);
                }
                match self.newest.map(|_| self.offset.receive(correction, self.cycle, sequence(self.cycle))) {
                    Some(Verdict::Good) => self.summary.corrections += 1,
                    Some(Verdict::NotFinite | Verdict::WrongAge | Verdict::OutOfOrder) | None => {
                        self.summary.rejected += 1;
                    }
                }
                return Some(*correction);
            }
            Message::Heartbeat(_) => {}
            Message::Close(close) => {
                if matches!(close.reason, CloseReason::Shutdown | CloseReason::Operator) {
                    self.offset.link_closed_in_order();
                }
                self.leave(&LinkEvent::Closed { reason: close.reason });
            }
            Message::Error(error) => {
                self.leave(&LinkEvent::ErrorReceived { code: error.code, detail: error.detail });
            }
            Message::DaemonHello(_) | Message::ControlHello(_) | Message::Position(_) | Message::Tool(_) => {
                self.end_link(LinkEnd::Unexpected);
            }
        }
        None
    }

    /// The daemon has left.
    fn leave(&mut self, event: &LinkEvent) {
        if let Some(link) = self.link.take() {
            self.summary.links_ended += 1;
            link.linger();
            self.report(event);
        }
    }

    fn report(&mut self, event: &LinkEvent) {
        if let Some(listener) = &mut self.listener {
            listener(event);
        }
    }

    fn report_events(&mut self) {
        while let Some(event) = self.server.event() {
            self.report(&event);
        }
    }
}

/// The number of a cycle on the wire.
fn sequence(cycle: u64) -> u32 {
    cycle as u32
}

/// The cycle after the last of a motion: same place, nothing moves.
fn standstill(last: &MotionCycle) -> MotionCycle {
    MotionCycle { commanded: last.commanded, ..MotionCycle::default() }
}

impl Drop for Control {
    fn drop(&mut self) {
        self.close();
    }
}
