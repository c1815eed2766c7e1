//! One link without its socket and its clock: a message in, a correction out.
//!
//! Everything the cycle does between reading and writing bytes is here, so that a test can run a million cycles
//! under a counting allocator.

use std::sync::Arc;

use super::recorder::{Tap, answer_of, request_of};
use volcomp_engine::{
    Command, Compensator, CycleOutput, EngineConfig, EngineError, Event, RestOffset, Shadow, ShadowScore,
    State,
};
use volcomp_model::geometry::Vec3;
use volcomp_model::{Model, SENSORS_MAX};
use volcomp_protocol::record::{self, Entry, LIVE_MAX};
use volcomp_protocol::{CloseReason, ControlHello, Correction, ErrorReport, Message, Position};
use volcomp_units::MonoTime;
use volcomp_units::axes::AxisArray;

/// A recording can carry every live value that a model can use.
const _: () = assert!(SENSORS_MAX <= LIVE_MAX && LIVE_MAX <= u32::BITS as usize);

/// The smallest offset that counts as one of an axis that is not listed, mm or deg.
pub(super) const UNLISTED_MIN: f64 = 1e-6;

/// The engine and its model.
#[derive(Debug, Clone)]
pub struct LinkSession {
    model: Arc<Model>,
    engine: Compensator,
    /// What the engine would do, while it is off.
    shadow: Shadow,
    output: Option<CycleOutput>,
    /// The newest offset was sent because no position came in time.
    late: bool,
    rest: RestOffset,
    /// Bit k: axis k may be offset.
    moved: u8,
    axes: usize,
    /// Where everything that goes into the engine is recorded.
    tap: Option<Tap>,
    /// Live values of one moment, told in front of the newest entry.
    live: Option<Live>,
    /// The newest entry, told after the correction has been sent.
    pending: Pending,
}

/// Reports sent after the answer. A frame's entry is put together only there: it has copies of all that was computed.
#[derive(Debug, Clone)]
enum Pending {
    Nothing,
    Entry(Entry),
    /// A frame; its correction is that of the newest output, where it was answered.
    Frame {
        now: MonoTime,
        frame: Position,
        enabled: bool,
        answered: bool,
    },
}

/// Live values received at the same time.
#[derive(Debug, Clone, Copy)]
struct Live {
    now: MonoTime,
    told: u32,
    values: [f64; LIVE_MAX],
}

/// What a message from the control asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reaction {
    /// Send this correction.
    Answer(Correction),
    /// Nothing to send.
    Nothing,
    /// The control closes the link.
    Closed(CloseReason),
    /// The control reports an error and will close the link.
    Refused(ErrorReport),
    /// A message that a control may not send during a link; its name.
    Unexpected(&'static str),
    /// A message with a value that the protocol does not allow; which one.
    Malformed(&'static str),
}

impl LinkSession {
    /// An engine for the control that `config` was made for.
    ///
    /// # Errors
    /// The configuration does not fit the model.
    pub fn new(config: &EngineConfig, model: Arc<Model>) -> Result<Self, EngineError> {
        let engine = Compensator::new(config, &model)?;
        let shadow = Shadow::new(config, &model)?;
        let moved = config
            .limits
            .iter()
            .enumerate()
            .fold(0, |bits, (k, limits)| bits | u8::from(limits.size > 0.0) << k);
        Ok(Self {
            model,
            engine,
            shadow,
            output: None,
            late: false,
            rest: config.rest,
            moved,
            axes: config.axes.len(),
            tap: None,
            live: None,
            pending: Pending::Nothing,
        })
    }

    /// Takes over from the session before what the control may hold: see [`Compensator::succeed`].
    pub fn succeed(&mut self, before: &Self) {
        self.engine.succeed(&before.engine);
    }

    /// Frames so far that were old or repeated.
    pub(super) const fn strays(&self) -> u64 {
        self.engine.strays()
    }

    /// Records from now on everything that goes into this engine, which was made for the control that said `hello`.
    pub fn record_to(&mut self, mut tap: Tap, now: MonoTime, hello: &ControlHello) {
        tap.send(&Entry::Engine { now, hello: *hello });
        self.tap = Some(tap);
    }

    /// Ends the recording of this engine.
    pub fn take_tap(&mut self) -> Option<Tap> {
        self.record();
        self.tap.take()
    }

    /// Passes the newest entry to the recording. To be called once its correction has been sent; an entry that was
    /// not told goes in front of the next one.
    ///
    /// # Cycle   no allocation, no wait, no panic
    pub fn record(&mut self) {
        if self.tap.is_none() {
            return;
        }
        let entry = match core::mem::replace(&mut self.pending, Pending::Nothing) {
            Pending::Nothing => None,
            Pending::Entry(entry) => Some(entry),
            Pending::Frame { now, frame, enabled, answered } => {
                let answer = if answered { self.recorded() } else { None };
                Some(Entry::Cycle(record::Cycle { now, frame, enabled, answer }))
            }
        };
        let Some(tap) = &mut self.tap else { return };
        if let Some(Live { now, told, values }) = self.live.take() {
            tap.send(&Entry::Live { now, told, values });
        }
        if let Some(entry) = entry {
            tap.send(&entry);
        }
    }

    /// Tells what was not told yet, before anything that its entry depends on changes.
    fn record_pending(&mut self) {
        if !matches!(self.pending, Pending::Nothing) {
            self.record();
        }
    }

    fn note(&mut self, entry: impl FnOnce(&Self) -> Entry) {
        if self.tap.is_some() {
            self.record_pending();
            self.pending = Pending::Entry(entry(self));
        }
    }

    fn note_live(&mut self, now: MonoTime, channel: usize, value: f64) {
        if self.tap.is_none() || channel >= LIVE_MAX {
            return;
        }
        self.record_pending();
        if self.live.is_some_and(|live| live.now != now) {
            self.record();
        }
        let live = self.live.get_or_insert(Live { now, told: 0, values: [0.0; LIVE_MAX] });
        live.told |= 1 << channel;
        live.values[channel] = value;
    }

    /// A new link has come up.
    pub fn link_up(&mut self, now: MonoTime) {
        self.record_pending();
        self.output = None;
        self.late = false;
        self.engine.on_link_up(now);
        self.shadow.on_link_up(now);
        self.note(|_| Entry::LinkUp { now });
    }

    /// The link is gone.
    pub fn link_down(&mut self, now: MonoTime) {
        self.engine.on_link_down(now);
        self.shadow.on_link_down(now);
        self.note(|_| Entry::LinkDown { now });
        self.record();
    }

    /// A command of the operator or the service.
    pub fn command(&mut self, now: MonoTime, command: Command) {
        self.engine.on_command(now, command);
        if let Command::SetGain(gain) = command {
            self.shadow.on_gain(now, gain);
        }
        self.note(|_| Entry::Request { now, request: request_of(command) });
    }

    /// A live value of the model's sensor `channel`, mm or rad.
    pub fn live(&mut self, now: MonoTime, channel: usize, value: f64) {
        self.engine.on_live(now, channel, value);
        self.shadow.on_live(now, channel, value);
        self.note_live(now, channel, value);
    }

    /// The engine goes on with another model, smoothly; `hash` names it in the recording. Gives the old model back, so
    /// that it is not taken apart on the cycle.
    ///
    /// # Errors
    /// The model does not fit the control; the engine goes on with the old one.
    ///
    /// # Cycle   no allocation, no panic, bounded time
    pub fn switch_model(
        &mut self,
        now: MonoTime,
        model: Arc<Model>,
        hash: [u8; 32],
    ) -> Result<Arc<Model>, EngineError> {
        self.engine.on_model(&model)?;
        // what fits the engine fits its shadow
        let _ = self.shadow.on_model(&model);
        self.note(|_| Entry::Model { now, hash });
        Ok(core::mem::replace(&mut self.model, model))
    }

    /// Goes on with a lag that was measured elsewhere: for an engine that takes up a recording in its middle.
    pub(super) const fn assume_lag(&mut self, cycles: Option<u32>) {
        self.engine.assume_lag(cycles);
    }

    /// One message received at `now`.
    ///
    /// # Cycle   no allocation, no panic, bounded time
    pub fn handle(&mut self, now: MonoTime, message: &Message) -> Reaction {
        match message {
            Message::Position(frame) => {
                self.record_pending();
                let output = self.engine.on_position(now, frame, &self.model);
                self.late &= output.is_none_or(|output| output.out_of_order);
                let correction = output.map(|output| self.answer(output));
                if self.tap.is_some() {
                    let (enabled, answered) = (self.engine.is_enabled(), correction.is_some());
                    self.pending = Pending::Frame { now, frame: *frame, enabled, answered };
                }
                // none where the control has not told yet which offset it holds
                correction.map_or(Reaction::Nothing, Reaction::Answer)
            }
            Message::Tool(tool) if tool.tip.iter().any(|v| !v.is_finite()) => {
                Reaction::Malformed("tool tip not finite")
            }
            Message::Tool(tool) => {
                let tip = Vec3::new(tool.tip[0], tool.tip[1], tool.tip[2]);
                self.engine.on_tool(tip);
                self.shadow.on_tool(tip);
                self.note(|_| Entry::Tool { now, tool: *tool });
                Reaction::Nothing
            }
            Message::Heartbeat(_) => Reaction::Nothing,
            Message::Close(close) => Reaction::Closed(close.reason),
            Message::Error(report) => Reaction::Refused(*report),
            Message::DaemonHello(_) => Reaction::Unexpected("daemon hello"),
            Message::ControlHello(_) => Reaction::Unexpected("second control hello"),
            Message::Correction(_) => Reaction::Unexpected("correction"),
        }
    }

    /// When [`LinkSession::deadline`] wants to be called if no position arrives.
    #[must_use]
    pub fn next_deadline(&self) -> Option<MonoTime> {
        self.engine.next_deadline()
    }

    /// No position has arrived in time; early calls are harmless.
    ///
    /// # Cycle   no allocation, no panic, bounded time
    pub fn deadline(&mut self, now: MonoTime) -> Option<Correction> {
        // an early call changes nothing and is no input
        let due = self.engine.next_deadline().is_some_and(|due| now >= due);
        self.record_pending();
        let output = self.engine.on_deadline(now);
        self.late |= output.is_some();
        let correction = output.map(|output| self.answer(output));
        let answered = correction.is_some();
        if due || answered {
            self.note(|session| {
                let answer = if answered { session.recorded() } else { None };
                Entry::Deadline { now, enabled: session.engine.is_enabled(), answer }
            });
        }
        correction
    }

    /// Switches the shadow engine on or off. To be switched on while compensation is off only: it answers what
    /// compensation would do instead.
    ///
    /// # Cycle   no allocation, no panic, bounded time
    pub fn set_shadow(&mut self, now: MonoTime, on: bool) {
        self.shadow.set(now, on);
    }

    /// The shadow engine's share of a cycle: to be called when the answer to `frame` has been sent.
    ///
    /// # Cycle   no allocation, no panic, bounded time
    pub fn run_shadow(&mut self, now: MonoTime, frame: &Position) {
        let _ = self.shadow.on_position(now, frame, &self.model);
    }

    /// The same where no frame came in time; early calls are harmless.
    ///
    /// # Cycle   no allocation, no panic, bounded time
    pub fn run_shadow_on_deadline(&mut self, now: MonoTime) {
        let _ = self.shadow.on_deadline(now);
    }

    /// State and score of the shadow engine; `None` where it is off.
    #[must_use]
    pub const fn shadow(&self) -> Option<(State, &ShadowScore)> {
        if self.shadow.is_on() { Some((self.shadow.state(), self.shadow.score())) } else { None }
    }

    /// The result of the newest cycle of this link.
    #[must_use]
    pub const fn output(&self) -> Option<&CycleOutput> {
        self.output.as_ref()
    }

    /// The engine, for its state and what it waits for.
    #[must_use]
    pub const fn engine(&self) -> &Compensator {
        &self.engine
    }

    /// The change of state that no answer has reported, because none was sent.
    pub const fn take_event(&mut self) -> Option<Event> {
        self.engine.take_event()
    }

    /// True while the newest offset answers no position: a control that sends none may refuse it as too old.
    #[must_use]
    pub const fn is_unanswered(&self) -> bool {
        self.late
    }

    /// True where the control has been sent the offset that is to stay when the daemon is gone. Not so before the
    /// first cycle of a link, and not where drives off or an emergency stop kept the offset from being taken back.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        let Some(output) = &self.output else { return false };
        if self.engine.is_silenced() || self.engine.needs_new_link() || self.late {
            // the control holds something else than what was sent, or may
            return false;
        }
        let zero = |(k, offset): (usize, &f64)| self.moved >> k & 1 == 0 || *offset == 0.0;
        self.engine.is_stopped()
            && (self.rest == RestOffset::Hold || output.offset.iter().enumerate().all(zero))
    }

    /// True where nothing may be sent, and the control has reported that it holds no offset.
    #[must_use]
    pub fn is_released(&self) -> bool {
        self.engine.is_silenced() && self.engine.reports_zero()
    }

    /// Whether the control holds an offset of an axis that the machine file does not list; `applied` in wire units.
    #[must_use]
    pub fn has_unlisted_offset(&self, applied: &AxisArray) -> bool {
        let held = |(k, value): (usize, &f64)| self.moved >> k & 1 == 0 && value.abs() > UNLISTED_MIN;
        applied.iter().take(self.axes).enumerate().any(held)
    }

    /// The newest answer as it is recorded.
    pub(super) fn recorded(&self) -> Option<record::Answer> {
        let output = self.output.as_ref()?;
        Some(answer_of(&self.engine.message(output), output, self.engine.wire(&output.wanted)))
    }

    fn answer(&mut self, output: CycleOutput) -> Correction {
        self.output = Some(output);
        self.engine.message(&output)
    }
}
