//! One cycle without its socket and its clock: a message in, a correction out.
//!
//! Everything the cycle does between reading and writing bytes is here, so that a test can run a million cycles
//! under a counting allocator.

use std::sync::Arc;

use crate::core::engine::{Command, Compensator, CycleOutput, EngineConfig, EngineError, RestOffset, State};
use crate::core::geometry::Vec3;
use crate::core::model::Model;
use crate::core::protocol::{CloseReason, Correction, ErrorReport, Message};
use crate::core::units::MonoTime;

/// The engine and its model.
#[derive(Debug, Clone)]
pub struct CycleBody {
    model: Arc<Model>,
    engine: Compensator,
    output: Option<CycleOutput>,
    rest: RestOffset,
    /// Bit k: axis k may be offset.
    moved: u8,
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
}

impl CycleBody {
    /// An engine for the control that `config` was made for.
    ///
    /// # Errors
    /// The configuration does not fit the model.
    pub fn new(config: &EngineConfig, model: Arc<Model>) -> Result<Self, EngineError> {
        let engine = Compensator::new(config, &model)?;
        let moved = config
            .limits
            .iter()
            .enumerate()
            .fold(0, |bits, (k, limits)| bits | u8::from(limits.size > 0.0) << k);
        Ok(Self { model, engine, output: None, rest: config.rest, moved })
    }

    /// A new link has come up.
    pub fn link_up(&mut self, now: MonoTime) {
        self.output = None;
        self.engine.on_link_up(now);
    }

    /// The link is gone.
    pub fn link_down(&mut self, now: MonoTime) {
        self.engine.on_link_down(now);
    }

    /// A command of the operator or the service.
    pub fn command(&mut self, now: MonoTime, command: Command) {
        self.engine.on_command(now, command);
    }

    /// A live value of the model's sensor `channel`, mm or rad.
    pub fn live(&mut self, now: MonoTime, channel: usize, value: f64) {
        self.engine.on_live(now, channel, value);
    }

    /// One message received at `now`.
    ///
    /// # Cycle   no allocation, no panic, bounded time
    pub fn handle(&mut self, now: MonoTime, message: &Message) -> Reaction {
        match message {
            Message::Position(frame) => {
                match self.engine.on_position(now, frame, &self.model) {
                    Some(output) => Reaction::Answer(self.answer(output)),
                    // the control has not told yet which offset it holds
                    None => Reaction::Nothing,
                }
            }
            Message::Tool(tool) => {
                self.engine.on_tool(Vec3::new(tool.tip[0], tool.tip[1], tool.tip[2]));
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

    /// When [`CycleBody::deadline`] wants to be called if no position arrives.
    #[must_use]
    pub fn next_deadline(&self) -> Option<MonoTime> {
        self.engine.next_deadline()
    }

    /// No position has arrived in time; early calls are harmless.
    ///
    /// # Cycle   no allocation, no panic, bounded time
    pub fn deadline(&mut self, now: MonoTime) -> Option<Correction> {
        let output = self.engine.on_deadline(now)?;
        Some(self.answer(output))
    }

    /// The result of the newest cycle of this link.
    #[must_use]
    pub const fn output(&self) -> Option<&CycleOutput> {
        self.output.as_ref()
    }

    /// The present state of the engine.
    #[must_use]
    pub const fn state(&self) -> State {
        self.engine.state()
    }

    /// True where compensation is wanted; a fault ends that.
    #[must_use]
    pub const fn is_enabled(&self) -> bool {
        self.engine.is_enabled()
    }

    /// True once a [`Command::Stop`] has been carried out, as far as this link and the machine's state allow.
    #[must_use]
    pub const fn is_stopped(&self) -> bool {
        self.engine.is_stopped()
    }

    /// True where the control has been sent the offset that is to stay when the daemon is gone. Not so before the
    /// first cycle of a link, and not where drives off or an emergency stop kept the offset from being taken back.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        let Some(output) = &self.output else { return false };
        let zero = |(k, offset): (usize, &f64)| self.moved >> k & 1 == 0 || *offset == 0.0;
        self.is_stopped() && (self.rest == RestOffset::Hold || output.offset.iter().enumerate().all(zero))
    }

    fn answer(&mut self, output: CycleOutput) -> Correction {
        self.output = Some(output);
        self.engine.message(&output)
    }
}
