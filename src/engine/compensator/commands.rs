//! Commands to the engine, changes of tool and of model.

use super::{Compensator, EngineError, Model, MonoTime, Reason, State, Vec3};
use crate::output::Command;

impl Compensator {
    /// The tool changed: its tip in M at home, mm.
    pub fn on_tool(&mut self, tip: Vec3) {
        if tip.iter().all(|v| v.is_finite()) && self.setpoints.tool_tip != Some(tip) {
            self.setpoints.tool_tip = Some(tip);
            // another lever means another correction: go there smoothly
            self.blend_anew(Reason::ToolChanged);
        }
    }

    /// Another model is used from now on: the offset goes smoothly from the old correction to the new one.
    ///
    /// # Errors
    /// The model has an axis that the control has not; the old model must go on being used.
    pub fn on_model(&mut self, model: &Model) -> Result<(), EngineError> {
        self.setpoints.take(&self.config, model)?;
        self.blend_anew(Reason::ModelChanged);
        Ok(())
    }

    fn blend_anew(&mut self, reason: Reason) {
        if self.follows_target() {
            self.plan(State::RampingIn, reason);
        }
    }

    /// A command of the operator or the service.
    pub fn on_command(&mut self, _now: MonoTime, command: Command) {
        match command {
            Command::Enable => {
                if !self.stopping && self.state != State::Faulted {
                    self.commanded |= !self.enabled;
                    self.enabled = true;
                    if self.state == State::Off {
                        self.state = State::Armed;
                    }
                }
            }
            Command::Disable => self.enabled = false,
            Command::SetGain(gain) => {
                if (0.0..=1.0).contains(&gain) {
                    self.gain_wanted = gain;
                }
            }
            Command::Stop => {
                self.enabled = false;
                self.stopping = true;
                self.stopped |= !self.may_send();
                self.note_stop();
            }
            Command::KeepFault => {
                if matches!(self.state, State::Off | State::Armed) {
                    self.enabled = false;
                    self.state = State::Faulted;
                    self.silenced = true;
                }
            }
            Command::ClearFault => {
                if self.state == State::Faulted && self.may_clear() {
                    self.clear();
                }
            }
        }
    }

    /// Off without a fault, whatever is reported: by itself only for an engine whose offsets nobody applies.
    pub(crate) fn clear(&mut self) {
        self.state = State::Off;
        self.enabled = false;
        if core::mem::replace(&mut self.silenced, false) {
            // what the control holds now is where it starts
            self.synchronised = false;
        }
    }
}
