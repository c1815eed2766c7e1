//! The state machine.

use super::config::{EngineConfig, EngineError};
use super::output::{Command, CycleOutput, State};
use crate::core::axes::AxisArray;
use crate::core::geometry::Vec3;
use crate::core::model::Model;
use crate::core::protocol::Position;
use crate::core::units::MonoTime;

/// Turns positions into bounded corrections.
#[derive(Debug, Clone)]
pub struct Compensator;

impl Compensator {
    /// An engine that is off.
    ///
    /// # Errors
    /// The configuration is incomplete or does not fit the model.
    pub fn new(_config: &EngineConfig, _model: &Model) -> Result<Self, EngineError> {
        Ok(Self)
    }

    /// A new link: the control may hold any offset; the first position frame tells which, and the engine starts there.
    pub fn on_link_up(&mut self, _now: MonoTime) {}

    /// The link is gone: nothing can be sent until [`Compensator::on_link_up`].
    pub fn on_link_down(&mut self, _now: MonoTime) {}

    /// The tool changed: its tip in M at home, mm.
    pub fn on_tool(&mut self, _tip: Vec3) {}

    /// One position frame (wire units) received at `now`; returns the correction that answers it.
    ///
    /// # Cycle   no allocation, no panic, bounded time
    #[must_use]
    pub fn on_position(&mut self, _now: MonoTime, _frame: &Position, _model: &Model) -> CycleOutput {
        unreachable!("placeholder")
    }

    /// When [`Compensator::on_deadline`] wants to be called if no position arrives; `None` while nothing is due.
    #[must_use]
    pub fn next_deadline(&self) -> Option<MonoTime> {
        None
    }

    /// No position has arrived by the deadline: holds, then ramps out. Calling early is harmless and gives `None`.
    #[must_use]
    pub fn on_deadline(&mut self, _now: MonoTime) -> Option<CycleOutput> {
        None
    }

    /// A command of the operator or the service.
    pub fn on_command(&mut self, _now: MonoTime, _command: Command) {}

    /// The present state.
    #[must_use]
    pub const fn state(&self) -> State {
        State::Off
    }

    /// The present offsets in wire order, mm or rad.
    #[must_use]
    pub const fn offset(&self) -> AxisArray {
        [0.0; crate::core::axes::MAX_AXES]
    }
}
